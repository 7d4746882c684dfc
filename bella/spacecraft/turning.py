"""Points given in HEE, such as the sources of a burst, in the other frames and back."""

import numpy as np

from bella.spacecraft.ephemeris import position
from bella.spacecraft.frames import frame_axes, hci_axes, hee_axes, points_of
from bella.units import FloatArray


def hee_to(frame: str, point_rsun: FloatArray, utc: np.datetime64) -> FloatArray:
    """Points of HEE in another frame of the same instant.

    Parameters
    ----------
    frame : str
        One of :data:`bella.spacecraft.frames.FRAMES`.
    point_rsun : numpy.ndarray, shape (N, 3)
        HEE, any unit.
    utc : numpy.datetime64
        The instant of both frames.

    Returns
    -------
    numpy.ndarray, shape (N, 3)

    Raises
    ------
    InputError
        If the frame is not known, or a point has not three coordinates.
    NoDataError
        If the ephemeris does not cover Earth at that instant.
    """
    return points_of(point_rsun) @ _hee_to(frame, utc).T


def hee_from(frame: str, point_rsun: FloatArray, utc: np.datetime64) -> FloatArray:
    """Points of another frame in HEE of the same instant: the inverse of :func:`hee_to`.

    Parameters
    ----------
    frame : str
        One of :data:`bella.spacecraft.frames.FRAMES`.
    point_rsun : numpy.ndarray, shape (N, 3)
        In `frame`, any unit.
    utc : numpy.datetime64
        The instant of both frames.

    Returns
    -------
    numpy.ndarray, shape (N, 3)

    Raises
    ------
    InputError
        If the frame is not known, or a point has not three coordinates.
    NoDataError
        If the ephemeris does not cover Earth at that instant.
    """
    return points_of(point_rsun) @ _hee_to(frame, utc)


def _hee_to(frame: str, utc: np.datetime64) -> FloatArray:
    """Rotation from HEE to a frame, shape (3, 3): matrix @ vector."""
    instant = utc.astype("datetime64[ns]")
    earth = (position("EARTH", [instant], "hci") @ hci_axes())[0]
    return np.asarray(frame_axes(frame, earth, instant) @ hee_axes(earth, instant).T)

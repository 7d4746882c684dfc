"""Points given in HEE, such as the sources of a burst, in the other frames and back."""

import numpy as np
import numpy.typing as npt

from bella.exceptions import InputError
from bella.spacecraft.ephemeris import position
from bella.spacecraft.frames import frame_axes, hci_axes, hee_axes
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
    return _points(point_rsun) @ _hee_to(frame, utc).T


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
    return _points(point_rsun) @ _hee_to(frame, utc)


def polar(point_rsun: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance, longitude and latitude of points of any frame.

    Parameters
    ----------
    point_rsun : numpy.ndarray, shape (N, 3)

    Returns
    -------
    range_rsun, longitude_deg, latitude_deg : numpy.ndarray, shape (N,)
        Longitude -180 to 180 degrees.
    """
    x, y, z = _points(point_rsun).T
    in_plane = np.hypot(x, y)
    return np.hypot(in_plane, z), np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, in_plane))


def cartesian(range_rsun: npt.ArrayLike, longitude_deg: npt.ArrayLike, latitude_deg: npt.ArrayLike) -> FloatArray:
    """Points from distance, longitude and latitude: the inverse of :func:`polar`.

    Parameters
    ----------
    range_rsun, longitude_deg, latitude_deg : array_like
        Broadcast to shape (N,).

    Returns
    -------
    numpy.ndarray, shape (N, 3)
    """
    longitude, latitude = np.radians(longitude_deg), np.radians(latitude_deg)
    x, y, z = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)
    shape = np.broadcast_shapes(np.shape(range_rsun), np.shape(x), np.shape(z))
    unit = np.stack([np.broadcast_to(axis, shape) for axis in (x, y, z)], axis=-1)
    return np.asarray(np.asarray(range_rsun, dtype=np.float64)[..., None] * unit).reshape(-1, 3)


def _hee_to(frame: str, utc: np.datetime64) -> FloatArray:
    """Rotation from HEE to a frame, shape (3, 3): matrix @ vector."""
    instant = utc.astype("datetime64[ns]")
    earth = (position("EARTH", [instant], "hci") @ hci_axes())[0]
    return np.asarray(frame_axes(frame, earth, instant) @ hee_axes(earth, instant).T)


def _points(point_rsun: FloatArray) -> FloatArray:
    points = np.asarray(point_rsun, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points of shape {points.shape} are not N x 3: give x, y and z for each")
    return points

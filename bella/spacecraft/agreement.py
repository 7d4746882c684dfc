"""Positions that come inside data files, held against the ephemeris."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bella.exceptions import InputError
from bella.spacecraft.ephemeris import WIND_SYSTEMATIC_RSUN, position
from bella.spacecraft.frames import check_frame
from bella.units import R_SUN_KM, FloatArray

TOLERANCE_KM = 50_000.0
"""How far apart file and table may be: 0.17 s of light. Predicted and reconstructed trajectories differ by less."""

DISAGREEMENT_FLAG = "position_disagrees"


class Placed(NamedTuple):
    """Positions of an observatory, and where they are from."""

    position_rsun: FloatArray
    """Shape (N, 3), solar radii, in the frame that was asked about."""
    source: str
    """``file`` or ``ephemeris``."""
    largest_difference_km: float
    """NaN where there was nothing to compare."""
    flag: str
    """``position_disagrees``, or empty."""


def largest_difference_km(observatory: str, utc: npt.ArrayLike, position_km: npt.ArrayLike, frame: str) -> float:
    """Largest distance between given positions and the ephemeris.

    Parameters
    ----------
    observatory : str
        One of the observatories of the ephemeris.
    utc : array_like of datetime64
        Instants, UTC, shape (N,).
    position_km : array_like
        Heliocentric positions, km, shape (N, 3); rows that are not finite are left out.
    frame : str
        Their frame, of the instant of each: ``hee``, ``heeq``, ``hci`` or ``carrington``.

    Returns
    -------
    float
        km.

    Raises
    ------
    InputError
        If shapes do not match, no row is finite, or observatory or frame is not known.
    NoDataError
        If the ephemeris does not cover the instants.
    """
    instants, given, known = _checked(utc, position_km)
    if not known.any():
        raise InputError(f"none of the given positions of {observatory} is finite: leave them out")
    expected = position(observatory, instants[known], check_frame(frame)) * R_SUN_KM
    return float(np.linalg.norm(given[known] - expected, axis=1).max())


def prefer_given(
    observatory: str,
    utc: npt.ArrayLike,
    position_km: npt.ArrayLike | None,
    frame: str,
    tolerance_km: float | None = None,
) -> Placed:
    """Positions of a file where it has them and they agree with the ephemeris, else those of the ephemeris.

    Parameters
    ----------
    observatory : str
        One of the observatories of the ephemeris.
    utc : array_like of datetime64
        Instants, UTC, shape (N,).
    position_km : array_like or None
        Heliocentric positions of the file, km, shape (N, 3); None where it has none.
    frame : str
        Frame of the file's positions, and of the answer.
    tolerance_km : float, optional
        Default ``TOLERANCE_KM``; for Wind, whose orbit about L1 the ephemeris does not have, 3 solar radii.

    Returns
    -------
    Placed
        The file's positions where they are complete and within the tolerance. Where they are not complete, or disagree,
        those of the ephemeris, in the second case with the flag.

    Raises
    ------
    InputError
        As :func:`largest_difference_km`.
    NoDataError
        If the ephemeris does not cover the instants.
    """
    instants = np.atleast_1d(np.asarray(utc, dtype="datetime64[ns]"))
    if position_km is None or not np.isfinite(np.asarray(position_km, dtype=np.float64)).any():
        return Placed(position(observatory, instants, frame), "ephemeris", float("nan"), "")
    difference_km = largest_difference_km(observatory, instants, position_km, frame)
    allowed_km = _tolerance_km(observatory) if tolerance_km is None else tolerance_km
    if difference_km > allowed_km:
        return Placed(position(observatory, instants, frame), "ephemeris", difference_km, DISAGREEMENT_FLAG)
    _, given, known = _checked(instants, position_km)
    if not known.all():
        return Placed(position(observatory, instants, frame), "ephemeris", difference_km, "")
    return Placed(given / R_SUN_KM, "file", difference_km, "")


def require_agreement(
    observatory: str, utc: npt.ArrayLike, position_km: npt.ArrayLike, frame: str, tolerance_km: float | None = None
) -> None:
    """Refuse positions that are not where the ephemeris has the observatory.

    Parameters
    ----------
    observatory, utc, position_km, frame, tolerance_km
        As for :func:`prefer_given`.

    Raises
    ------
    InputError
        If they differ by more than the tolerance, or as :func:`largest_difference_km`.
    NoDataError
        If the ephemeris does not cover the instants.
    """
    allowed_km = _tolerance_km(observatory) if tolerance_km is None else tolerance_km
    difference_km = largest_difference_km(observatory, utc, position_km, frame)
    if difference_km > allowed_km:
        raise InputError(
            f"positions of {observatory} are up to {difference_km:.0f} km from the ephemeris, more than "
            f"{allowed_km:.0f}: check that they are heliocentric, in km, in {frame.upper()}, and their times UTC"
        )


def _tolerance_km(observatory: str) -> float:
    return 3.0 * WIND_SYSTEMATIC_RSUN * R_SUN_KM if observatory == "WIND" else TOLERANCE_KM


def _checked(
    utc: npt.ArrayLike, position_km: npt.ArrayLike
) -> tuple[npt.NDArray[np.datetime64], FloatArray, npt.NDArray[np.bool_]]:
    instants = np.atleast_1d(np.asarray(utc, dtype="datetime64[ns]"))
    given = np.atleast_2d(np.asarray(position_km, dtype=np.float64))
    if given.shape != (instants.size, 3):
        raise InputError(
            f"{instants.size} instants go with positions of shape {given.shape}: give one x, y, z for each"
        )
    return instants, given, np.asarray(np.isfinite(given).all(axis=1))

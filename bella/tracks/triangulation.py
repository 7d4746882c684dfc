"""Goniopolarimetric triangulation: where the directions of arrival at several spacecraft come closest to one another.

Every direction is a line through its spacecraft; the source is the point with the least weighted square distance from
the lines (Krupar et al. 2012, J. Geophys. Res. 117, A06101, doi:10.1029/2011JA017333, for two). A direction known to
an angle sigma misses a source at distance d by d sigma, so the weights are found together with the source.
"""

from dataclasses import dataclass

import numpy as np

from bella.exceptions import InputError
from bella.units import FloatArray

PARALLEL = "parallel_lines"
"""The lines are so nearly parallel that the source along them is not known."""

BEHIND = "behind_spacecraft"
"""The point lies behind a spacecraft, seen along its direction of arrival: the angles contradict one another."""

PARALLEL_CONDITION = 1e4
"""Condition number of the unweighted normal matrix from which lines count as parallel: about one degree between two."""

ITERATIONS = 10
NEAREST_RSUN = 1.0


@dataclass(frozen=True)
class Triangulation:
    """Source that several directions of arrival point to.

    Attributes
    ----------
    position_rsun : ndarray, shape (3,)
        Solar radii, in the frame of the input; NaN where the lines are parallel.
    covariance_rsun2 : ndarray, shape (3, 3)
        From the errors of the angles alone, and linear in them: too narrow near the line through two spacecraft.
    condition_number : float
        Of the weighted normal matrix, large where the geometry is poor; of the unweighted one for parallel lines.
    miss_rsun : ndarray, shape (N,)
        Distance of the source from each line, solar radii.
    flags : tuple of str
    """

    position_rsun: FloatArray
    covariance_rsun2: FloatArray
    condition_number: float
    miss_rsun: FloatArray
    flags: tuple[str, ...]


def direction(colatitude_deg: FloatArray, azimuth_deg: FloatArray) -> FloatArray:
    """Unit vectors of arrival directions, towards the source.

    Parameters
    ----------
    colatitude_deg, azimuth_deg : numpy.ndarray, shape (N,)
        Angle from the Z axis, and from X towards Y, degrees.

    Returns
    -------
    numpy.ndarray, shape (N, 3)
    """
    colatitude, azimuth = np.radians(colatitude_deg), np.radians(azimuth_deg)
    in_plane = np.sin(colatitude)
    return np.stack([in_plane * np.cos(azimuth), in_plane * np.sin(azimuth), np.cos(colatitude)], axis=-1)


def triangulate(receiver_rsun: FloatArray, towards: FloatArray, sigma_deg: FloatArray) -> Triangulation:
    """Point closest to two or more lines of sight, with its error.

    Parameters
    ----------
    receiver_rsun : numpy.ndarray, shape (N, 3)
        Positions of the spacecraft, solar radii, Cartesian, any frame.
    towards : numpy.ndarray, shape (N, 3)
        Directions of arrival in the same frame, of any length.
    sigma_deg : numpy.ndarray, shape (N,)
        Standard deviation of each direction, degrees.

    Returns
    -------
    Triangulation
        With the flag ``parallel_lines`` and NaN, or the flag ``behind_spacecraft``, where the geometry has no answer.

    Raises
    ------
    InputError
        If there are fewer than two lines, shapes do not match, or a number is not usable.
    """
    place, unit, sigma = _checked(receiver_rsun, towards, sigma_deg)
    across = np.eye(3) - unit[:, :, None] * unit[:, None, :]
    # weights would make lines of unlike errors look parallel
    condition = float(np.linalg.cond(across.sum(axis=0)))
    if condition > PARALLEL_CONDITION:
        nowhere = np.full((3, 3), np.nan)
        return Triangulation(nowhere[0], nowhere, condition, np.full(len(unit), np.nan), (PARALLEL,))
    source, precision = _closest(place, across, sigma)
    along = np.einsum("ni,ni->n", source - place, unit)
    miss = np.linalg.norm(np.einsum("nij,nj->ni", across, source - place), axis=1)
    flags = (BEHIND,) if (along <= 0).any() else ()
    return Triangulation(source, np.asarray(np.linalg.inv(precision)), float(np.linalg.cond(precision)), miss, flags)


def _closest(place: FloatArray, across: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weighted least-squares point and its normal matrix; weights follow the distance of the point found before."""
    distance = np.ones(len(place))
    for _ in range(ITERATIONS):
        weight = 1.0 / (distance * sigma) ** 2
        precision = np.einsum("n,nij->ij", weight, across)
        source = np.linalg.solve(precision, np.einsum("n,nij,nj->i", weight, across, place))
        distance = np.maximum(np.linalg.norm(source - place, axis=1), NEAREST_RSUN)
    return source, precision


def _checked(
    receiver_rsun: FloatArray, towards: FloatArray, sigma_deg: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions, unit vectors, and errors in radians."""
    place, toward = np.asarray(receiver_rsun, dtype=np.float64), np.asarray(towards, dtype=np.float64)
    sigma = np.asarray(sigma_deg, dtype=np.float64)
    if place.ndim != 2 or place.shape != toward.shape or place.shape[1] != 3 or sigma.shape != place.shape[:1]:
        raise InputError(f"shapes {place.shape}, {toward.shape} and {sigma.shape} are not N x 3, N x 3 and N")
    if len(place) < 2:
        raise InputError("one line of sight does not place a source: give directions from two spacecraft or more")
    length = np.linalg.norm(toward, axis=1)
    if not (np.isfinite(sigma).all() and (sigma > 0).all()):
        raise InputError("an error is not a finite angle above 0: leave that spacecraft out")
    if not (np.isfinite(place).all() and np.isfinite(length).all() and (length > 0).all()):
        raise InputError("a position or direction is missing or zero: leave that spacecraft out")
    return place, toward / length[:, None], np.radians(sigma)

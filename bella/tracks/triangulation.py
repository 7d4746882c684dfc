"""Goniopolarimetric triangulation: where the directions of arrival at several spacecraft come closest to one another.

Every direction is a line through its spacecraft; the source is the point with the least weighted square distance from
the lines (Krupar et al. 2012, J. Geophys. Res. 117, A06101, doi:10.1029/2011JA017333, for two). A direction known to
an angle sigma misses a source at distance d by d sigma, so the weights are found together with the source.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from bella.arrivals import evenly_spread
from bella.exceptions import InputError
from bella.records import finite
from bella.spacecraft import polar
from bella.tracks.directions import DirectionTerms
from bella.units import FloatArray

PARALLEL = "parallel_lines"
"""The lines are so nearly parallel that the source along them is not known."""

BEHIND = "behind_spacecraft"
"""The point lies behind a spacecraft, seen along its direction of arrival: the angles contradict one another."""

PARALLEL_CONDITION = 1e4
"""Condition number of the unweighted normal matrix from which lines count as parallel: about one degree between two."""

ITERATIONS = 10
"""Of the weights, which follow the distance of the source: ten leave 0.03 solar radii (300 simulated geometries)."""

NEAREST_RSUN = 1.0
"""Distance of a source from a spacecraft that weights are made for, at least."""

FLOOR_DEG = 3.0
"""Error that all directions of a spacecraft share beside their scatter: refraction, scattering and calibration."""

SHOWN_FREQUENCIES = 5
NEAR_LN_F = 0.06
"""Channels of two spacecraft this near in the logarithm of frequency are taken for one."""


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
    """

    position_rsun: FloatArray
    covariance_rsun2: FloatArray
    condition_number: float
    miss_rsun: FloatArray
    flags: tuple[str, ...]


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


def triangulation_companion(terms: DirectionTerms | None) -> dict[str, Any]:
    """Sources at a few frequencies where the directions of two or more spacecraft come closest.

    Parameters
    ----------
    terms : DirectionTerms or None
        As :func:`bella.tracks.direction_terms` returns them; None where there are no directions.

    Returns
    -------
    dict
        Ready for JSON: ``rows`` of frequency, spacecraft, distance with its error, longitude, latitude, condition
        number of the geometry, largest miss, and flags.

    Raises
    ------
    InputError
        If there are no directions, or no two spacecraft have one near the same frequency.
    """
    if terms is None:
        raise InputError("there are no wave directions: they come with STEREO L3 and Wind RAD1 L3 files")
    names = np.array(terms.observatories)
    rows = [_row(frequency, names[near], terms, near) for frequency, near in _shared(names, terms.frequency_mhz)]
    if not rows:
        raise InputError("no two spacecraft have wave directions near the same frequency: add files of another")
    return {
        "model": f"where directions cross (Krupar et al. 2012), errors of their scatter and {FLOOR_DEG:g} deg",
        "rows": rows,
        "flags": [],
    }


def _shared(names: np.ndarray, frequency_mhz: FloatArray) -> list[tuple[float, np.ndarray]]:
    """A few frequencies that two spacecraft have, and for each the place of the nearest direction of every one."""
    bands = {name: frequency_mhz[names == name] for name in np.unique(names)}
    if len(bands) < 2:
        return []
    low = sorted(band.min() for band in bands.values())[1]
    high = sorted(band.max() for band in bands.values())[-2]
    if low > high:
        return []
    found: dict[tuple[int, ...], float] = {}
    inside = frequency_mhz[(frequency_mhz >= low) & (frequency_mhz <= high)]
    for wanted in inside[evenly_spread(inside, SHOWN_FREQUENCIES)]:
        apart = np.abs(np.log(frequency_mhz / wanted))
        near = [one for name in bands if apart[one := _nearest(apart, names == name)] <= NEAR_LN_F]
        if len(near) > 1:
            found.setdefault(tuple(near), float(wanted))
    return [(frequency, np.array(near)) for near, frequency in found.items()]


def _nearest(apart: FloatArray, chosen: np.ndarray) -> int:
    places = np.flatnonzero(chosen)
    return int(places[apart[places].argmin()])


def _row(frequency_mhz: float, names: np.ndarray, terms: DirectionTerms, near: np.ndarray) -> dict[str, Any]:
    source = triangulate(terms.receiver_rsun[near], terms.towards[near], terms.total_deg[near])
    return {"frequency_mhz": frequency_mhz, "observatories": [str(name) for name in names], **_place(source)}


def _place(source: Triangulation) -> dict[str, Any]:
    """Numbers of a source, None where the geometry has none."""
    beside = {"condition_number": finite(source.condition_number), "flags": list(source.flags)}
    numbers = ("range_rsun", "range_sd_rsun", "longitude_deg", "latitude_deg", "miss_rsun")
    if not np.isfinite(source.position_rsun).all():
        return dict.fromkeys(numbers) | beside
    distance, longitude, latitude = (float(one[0]) for one in polar(source.position_rsun[None]))
    outwards = source.position_rsun / distance
    sd = float(np.sqrt(outwards @ source.covariance_rsun2 @ outwards))
    return dict(zip(numbers, (distance, sd, longitude, latitude, float(source.miss_rsun.max())), strict=True)) | beside

"""What wave directions say of a burst beside its arrival times: sources where they cross, and one fit to everything."""

from typing import Any

import numpy as np

from bella.exceptions import InputError
from bella.spacecraft import polar
from bella.tracks.directions import DirectionTerms
from bella.tracks.triangulation import Triangulation, triangulate
from bella.units import FloatArray

FLOOR_DEG = 3.0
"""Error that all directions of a spacecraft share beside their scatter: refraction, scattering and calibration."""
SHOWN_FREQUENCIES = 5
NEAR_LN_F = 0.06
"""Channels of two spacecraft this near in the logarithm of frequency are taken for one."""


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
    for wanted in np.geomspace(low, high, SHOWN_FREQUENCIES):
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
    condition = source.condition_number if np.isfinite(source.condition_number) else None
    beside = {"condition_number": condition, "flags": list(source.flags)}
    numbers = ("range_rsun", "range_sd_rsun", "longitude_deg", "latitude_deg", "miss_rsun")
    if not np.isfinite(source.position_rsun).all():
        return dict.fromkeys(numbers) | beside
    distance, longitude, latitude = (float(one[0]) for one in polar(source.position_rsun[None]))
    outwards = source.position_rsun / distance
    sd = float(np.sqrt(outwards @ source.covariance_rsun2 @ outwards))
    return dict(zip(numbers, (distance, sd, longitude, latitude, float(source.miss_rsun.max())), strict=True)) | beside

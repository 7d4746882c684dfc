"""How much a spectrum looks like the leading edge of a drifting burst, at every minute.

In every channel the mean over the rise and early decay of a burst is held against the mean of the minutes before it.
Channels are then shifted by the delay of a beam through the heliosphere and summed, for several beam speeds, for no
drift, and for beams that would fall into the Sun: what fits about as well without a drift, or upwards, is no beam that
leaves the Sun, or too narrow a band to tell.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bella.bursts.search_grid import CHANNELS, FREQUENCY_MHZ, STEP_S
from bella.bursts.widths import decay_s, rise_half_width_s
from bella.heliosphere import DENSITY_MODELS, emission_range_rsun
from bella.units import C_RSUN_S, FloatArray

BEAM_SPEEDS_C = tuple(float(speed) for speed in np.geomspace(0.04, 0.45, 10))
SLOWING = 0.37
"""Beams slow down as r^-0.37 (Krupar et al. 2015, A&A 580, A137, doi:10.1051/0004-6361/201425308)."""

TEMPLATE_CONTRAST = 10.0
BEFORE_RECORDS = 8
"""So many minutes before the rise are what it is held against."""

LOWEST_MATCH, HIGHEST_MATCH = -3.0, 15.0
HIT = 3.0
"""A channel with this match, in standard deviations, sees the burst."""

ENOUGH_HITS = 10


class Match(NamedTuple):
    """How well a drift fits, for every minute of arrival at the highest frequency."""

    score: FloatArray
    """Shape (drifts, minutes): beams that leave the Sun, as many as `BEAM_SPEEDS_C`, then drifts that are none."""
    hit: npt.NDArray[np.bool_]
    """Which channels see it, bool, shape (drifts, minutes, CHANNELS)."""
    measured: npt.NDArray[np.bool_]
    """Which channels have data at all, bool, shape (CHANNELS,)."""


@lru_cache(maxsize=1)
def drift_delays_s() -> FloatArray:
    """Delay of every channel after the highest one.

    Returns
    -------
    numpy.ndarray, shape (drifts, CHANNELS)
        s; for each beam speed, then for no drift, then upwards for each beam speed. A beam through the density of
        Leblanc et al. 1998 (doi:10.1023/A:1005049730506), harmonic emission, the speed given being that at 10 solar
        radii.
    """
    range_rsun = emission_range_rsun(FREQUENCY_MHZ, DENSITY_MODELS["leblanc"], 2)
    travelled = 10.0**-SLOWING * range_rsun ** (1 + SLOWING) / (1 + SLOWING)
    travelled -= travelled.min()
    drifting = travelled / (C_RSUN_S * np.array(BEAM_SPEEDS_C)[:, None])
    return np.concatenate([drifting, np.zeros((1, CHANNELS)), -drifting])


@lru_cache(maxsize=1)
def _pulses() -> tuple[FloatArray, ...]:
    """Weights of the minutes from the onset on, by channel: a pulse in dB as a minute sees it, up to one decay."""
    weights = []
    for frequency in FREQUENCY_MHZ:
        rise, decay = rise_half_width_s(float(frequency)), decay_s(float(frequency))
        time_s = np.arange(0.0, 2 * rise + max(decay, STEP_S), 1.0)
        shape = np.where(time_s < 2 * rise, np.exp(-0.5 * ((time_s - 2 * rise) / rise) ** 2), 1.0)
        shape *= np.exp(-np.maximum(time_s - 2 * rise, 0) / decay)
        decibel = 10 * np.log10(1 + TEMPLATE_CONTRAST * shape)
        minute = (time_s // STEP_S).astype(int)
        pulse = np.bincount(minute, weights=decibel)
        weights.append(pulse / pulse.sum())
    return tuple(weights)


def channel_match(excess_db: FloatArray, noise_db: FloatArray) -> FloatArray:
    """Match of a rise that begins in a minute, in standard deviations of noise.

    Parameters
    ----------
    excess_db : numpy.ndarray, shape (N, CHANNELS)
        dB over background; NaN where nothing was measured.
    noise_db : numpy.ndarray, shape (CHANNELS,)

    Returns
    -------
    numpy.ndarray, shape (N, CHANNELS)
        NaN where less than half of the pulse or of the minutes before it was measured.
    """
    match = np.full(excess_db.shape, np.nan)
    before = np.full(BEFORE_RECORDS, 1.0 / BEFORE_RECORDS)
    for channel, pulse in enumerate(_pulses()):
        if not np.isfinite(noise_db[channel]):
            continue
        known = np.isfinite(excess_db[:, channel]).astype(np.float64)
        values = np.nan_to_num(excess_db[:, channel])
        # a sample just before the onset may hold part of the rise: it belongs to neither side
        inside, in_weight, in_square = _weighted(values, known, pulse, 0)
        earlier, early_weight, early_square = _weighted(values, known, before, -BEFORE_RECORDS - 1)
        enough = (in_weight > 0.5) & (early_weight > 0.5)
        sd = noise_db[channel] * np.sqrt(in_square + early_square)
        match[enough, channel] = (inside - earlier)[enough] / sd[enough]
    return match


def _weighted(
    values: FloatArray, known: FloatArray, weights: FloatArray, first: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weighted mean over the records from `first` on, the weight that was known, and the variance in units of noise."""
    total, weight, square = (
        _forward(series, taps, first)
        for series, taps in ((values * known, weights), (known, weights), (known, weights**2))
    )
    safe = np.maximum(weight, 1e-9)
    return total / safe, weight, square / safe**2


def _forward(series: FloatArray, taps: FloatArray, first: int) -> FloatArray:
    """Sum of taps times the records that follow, the first tap at record `first` after each."""
    padded = np.concatenate([np.zeros(max(-first, 0)), series, np.zeros(taps.size + max(first, 0))])
    summed = np.convolve(padded, taps[::-1], mode="valid")
    begin = max(first, 0)
    return np.asarray(summed[begin : begin + series.size])


def drift_match(match: FloatArray) -> Match:
    """Score of every drift at every minute.

    Parameters
    ----------
    match : numpy.ndarray, shape (N, CHANNELS)
        As from :func:`channel_match`.

    Returns
    -------
    Match
    """
    records = np.rint(drift_delays_s() / STEP_S).astype(np.intp)
    index = np.arange(len(match))[None, :, None] + records[:, None, :]
    inside = (index >= 0) & (index < len(match))
    shifted = match[np.clip(index, 0, len(match) - 1), np.arange(CHANNELS)]
    shifted = np.where(inside, shifted, np.nan)
    known = np.isfinite(shifted)
    clipped = np.clip(np.where(known, shifted, 0.0), LOWEST_MATCH, HIGHEST_MATCH)
    hit = known & (shifted > HIT)
    number = np.maximum(known.sum(axis=2), 1)
    score = clipped.sum(axis=2) / np.sqrt(number) * np.minimum(1.0, hit.sum(axis=2) / ENOUGH_HITS)
    return Match(score, hit, np.asarray(np.isfinite(match).any(axis=0)))

"""The coarse grid on which bursts are searched, and how much it looks like the leading edge of a drifting burst.

The grid has minutes, and channels evenly spaced in the logarithm of frequency. A receiver that visits a channel less
often than every minute has each sample in all the minutes that are nearest to it; its noise is that of samples.

In every channel the mean over the rise and early decay of a burst is compared with the mean of the minutes before it.
Channels are then shifted by the delay of a beam through the heliosphere and summed, for several beam speeds, for no
drift, and for beams that would fall into the Sun: what fits about as well without a drift, or upwards, is no beam that
leaves the Sun, or too narrow a band to tell.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.bursts.light_curves import decay_s
from bella.heliosphere import DENSITY_MODELS, emission_range_rsun
from bella.spectra import over_background, relative_power, sample_times
from bella.units import C_RSUN_S, FloatArray

STEP_S = 60.0
LOWEST_MHZ, HIGHEST_MHZ = 0.1, 14.0
CHANNELS = 56
SPIKE_RECORDS = (1, 2)
"""How many minutes a calibration lasts."""

EDGES_MHZ: FloatArray = np.geomspace(LOWEST_MHZ, HIGHEST_MHZ, CHANNELS + 1)
FREQUENCY_MHZ: FloatArray = np.sqrt(EDGES_MHZ[1:] * EDGES_MHZ[:-1])
BEAM_SPEEDS_C = tuple(float(speed) for speed in np.geomspace(0.04, 0.45, 10))
SLOWING = 0.37
"""Beams slow down as r^-0.37 (Krupar et al. 2015, A&A 580, A137, doi:10.1051/0004-6361/201425308)."""

TEMPLATE_CONTRAST = 10.0
TEMPLATE_RISE_S, TEMPLATE_RISE_SLOPE = 1.5, -0.77
"""Half width of the rise of the pulse at 30 MHz, and its slope: Reid & Kontar 2018, A&A 614, A69. Many bursts rise more
slowly at low frequencies; the onset, which the minute of a match is, then is where a fast one would begin."""

BEFORE_RECORDS = 8
"""Minutes before the rise that it is compared with."""


@dataclass(frozen=True)
class DetectionThresholds:
    """Numbers that decide what is a burst, what is alone, and what is the same burst at two spacecraft.

    Where no other origin is named they were chosen on simulated days of seeds 1 and 2; what they reach on the days of
    another seed is in docs/detection.md.

    Attributes
    ----------
    score : float
        Least score of the matched filter of a candidate, in standard deviations of noise.
    apart_minutes : int
        The highest of maxima this near to one another is the candidate.
    support_above_mhz, support_channels : float, int
        So many channels above this frequency have to see a burst: Earth's kilometric radiation stays below 0.6 MHz.
    kilometric_below_mhz, kilometric_channels, kilometric_all : float, int, int
        Or so many above this one, so many in all, and a clear drift.
    wide_below_mhz, wide_channels : float, int
        So many channels below this frequency tell a burst from arcs of Jupiter, which seldom reach below it.
    clear_margin : float
        By how much a drift has to fit better than any that is none where the channels alone do not tell.
    fast_margin : float
        Where they tell, a fit without drift may be better by this: fast beams take a minute through most channels.
    slow_margin : float
        Added to it, and to that of an upward drift, for each further minute that shares a sample: a receiver that looks
        every three minutes sees no drift that takes less.
    slow_clear_margin : float
        Taken from `clear_margin` for the same reason, of bursts that few channels above `support_above_mhz` see. Chosen
        in key parameters of seeds 11 and 12.
    longest_revisit_minutes : float
        A channel that is visited less often is not searched: of simulated bursts of 10 dB fewer than half are found
        then.
    narrow_channels : int
        Candidates in fewer channels are refused if they last too long at one frequency.
    longest, longest_above : float
        How long, in units of a minute and two decay times; the second where it is not seen below `wide_below_mhz`. Arcs
        of Jupiter and lanes of Type II bursts last longer.
    depth_db : float
        Something lasts while it is above half of its peak in dB, and no further than this below the peak.
    before_s, after_s : float
        A burst is alone if no other begins within so long before and after it.
    weak_share : float
        Another with less than this share of its score does not count.
    second_peak_db, second_peak_share_of_height : float
        A light curve that falls and rises again by so much, or by this share of its height if that is less, has two.
    second_peak_share : float
        If so many of the channels have two, the burst is not alone.
    smoothed_share_of_decay : float
        Light curves are smoothed by this share of the decay time: what wavers faster is the receiver.
    relative_background : float
        Background, over the maximum, that is put under fluxes that have none: receivers scatter by about 5 per cent.
    noise_db : float
        Channels whose noise is less count as if it were this: what is left of a background is never flat to less.
    spike_db, spike_share, spike_below_mhz : float
        A column that rises and falls at once by so much in this share of the channels below this frequency is the
        receiver's: bursts last for minutes there.
    lowest_match, highest_match : float
        Limits of what one channel adds to a score.
    hit : float
        A channel with this match, in standard deviations, sees the burst.
    hits : int
        A score of fewer channels is lowered in proportion.
    slack_s : float
        By how much a window is wider than light travel: onsets are known to the minute of the grid.
    seed_score, seed_hits : float, int
        What a search of the window of a burst that another spacecraft received has to find.
    spacecraft : int
        Fewest that place a burst: three arrival times for two coordinates and a time of emission.
    spread_rsun : float
        Spacecraft nearer to one line than this cannot tell two sides of it: 23 s of light.
    low_mhz, low_channels : float, int
        Sources are localised below this frequency, where a minute is short against light travel; so many channels there
        have to be seen by three spacecraft.
    weak_score : float
        A spacecraft with a lower score times no edge well, and may as well have received another burst.
    """

    score: float = 6.0
    apart_minutes: int = 4
    support_above_mhz: float = 0.8
    support_channels: int = 6
    kilometric_below_mhz: float = 0.6
    kilometric_channels: int = 3
    kilometric_all: int = 14
    wide_below_mhz: float = 2.0
    wide_channels: int = 4
    clear_margin: float = 1.2
    fast_margin: float = 1.1
    slow_margin: float = 0.05
    slow_clear_margin: float = 0.1
    longest_revisit_minutes: float = 6.0
    narrow_channels: int = 20
    longest: float = 2.7
    longest_above: float = 2.0
    depth_db: float = 10.0
    before_s: float = 20 * 60.0
    after_s: float = 30 * 60.0
    weak_share: float = 0.3
    second_peak_db: float = 2.0
    second_peak_share_of_height: float = 0.4
    second_peak_share: float = 0.25
    smoothed_share_of_decay: float = 0.5
    relative_background: float = 0.05
    noise_db: float = 0.25
    spike_db: float = 2.0
    spike_share: float = 0.5
    spike_below_mhz: float = 1.0
    lowest_match: float = -3.0
    highest_match: float = 15.0
    hit: float = 3.0
    hits: int = 10
    slack_s: float = 60.0
    seed_score: float = 6.0
    seed_hits: int = 10
    spacecraft: int = 3
    spread_rsun: float = 10.0
    low_mhz: float = 2.0
    low_channels: int = 4
    weak_score: float = 16.0


THRESHOLDS = DetectionThresholds()


def over_quiet(spectrum: xr.Dataset) -> xr.Dataset:
    """Measured channels over their background, as bursts are searched in and timed on.

    Parameters
    ----------
    spectrum : xarray.Dataset
        A dynamic spectrum of any quantity, best of a whole day.

    Returns
    -------
    xarray.Dataset
        In decibels over background without channels marked as interpolated; a relative flux, whose background was taken
        away, stays what it is.

    Raises
    ------
    InputError
        If the quantity of the spectrum is not known.
    """
    measured = spectrum
    if "interpolated" in spectrum and spectrum["interpolated"].any():
        measured = spectrum.isel(frequency=np.flatnonzero(spectrum["interpolated"].to_numpy() == 0))
    is_without = spectrum.attrs["quantity"] == "relative_flux" or measured.sizes["frequency"] == 0
    return measured if is_without else over_background(measured)


class SearchGrid(NamedTuple):
    """A spectrum on the grid."""

    start: np.datetime64
    """UTC of the beginning of the first minute."""
    excess_db: FloatArray
    """Mean over background, dB, shape (minutes, CHANNELS); NaN where nothing was measured."""
    noise_db: FloatArray
    """Scatter of quiet minutes, shape (CHANNELS,); NaN for channels without data."""
    revisit: FloatArray | float = 1.0
    """Minutes that share one sample, shape (CHANNELS,): 1 where there is one in every minute."""

    def revisit_of(self, channel: int) -> float:
        """Minutes that share one sample of a channel."""
        return float(np.broadcast_to(self.revisit, CHANNELS)[channel])


def search_grid(over: xr.Dataset) -> SearchGrid:
    """Put a spectrum on the grid, clean of single-minute columns, in dB over background.

    Parameters
    ----------
    over : xarray.Dataset
        As :func:`over_quiet` returns it.
    """
    start = over["time"].to_numpy()[0].astype("datetime64[m]")
    if over.sizes["frequency"] == 0:
        minutes = int((over["time"].to_numpy()[-1] - start) / np.timedelta64(60, "s")) + 1
        return SearchGrid(start, np.full((minutes, CHANNELS), np.nan), np.full(CHANNELS, np.nan))
    over = _raised(over) if over.attrs["quantity"] == "relative_flux" else over
    held, revisit = _held(_despiked(_binned(over, start)))
    smooth = _median_of_three(held)
    return SearchGrid(start.astype("datetime64[ns]"), smooth, _noise_db(smooth), revisit)


def _raised(spectrum: xr.Dataset) -> xr.Dataset:
    """Decibels over a background that is put under a flux which has none and is relative to its maximum."""
    power = relative_power(spectrum)
    decibel = 10.0 * np.log10(1.0 + np.maximum(power, 0.0) / (power.max("time") * THRESHOLDS.relative_background))
    return spectrum.assign(intensity=decibel)


def _binned(over: xr.Dataset, start: np.datetime64) -> FloatArray:
    """Mean of the samples in every cell."""
    column = np.searchsorted(EDGES_MHZ, over["frequency"].to_numpy(), side="right") - 1
    times, intensity = sample_times(over).to_numpy(), over["intensity"].to_numpy()
    inside = times[:, (column >= 0) & (column < CHANNELS)]
    last = inside.max() if inside.size else start
    mean = np.full((max(int((last - start) / np.timedelta64(1, "s") // STEP_S), 0) + 1, CHANNELS), np.nan)
    for channel in range(CHANNELS):  # one by one, as a day may have a sample every 6 ms
        of = column == channel
        row = ((times[:, of] - start) / np.timedelta64(1, "s") // STEP_S).astype(np.intp)
        values = intensity[:, of].astype(np.float64)
        known = np.isfinite(values) & (row >= 0)
        count = np.bincount(row[known], minlength=len(mean))
        total = np.bincount(row[known], weights=values[known], minlength=len(mean))
        mean[:, channel] = total / np.where(count, count, np.nan)
    return mean


def _despiked(excess_db: FloatArray) -> FloatArray:
    """Without columns that rise and fall at once in most channels where bursts last for many minutes."""
    low = excess_db[:, THRESHOLDS.spike_below_mhz > FREQUENCY_MHZ]
    known = np.maximum(np.isfinite(low).sum(axis=1), 1)
    is_spike = np.zeros(len(excess_db), dtype=bool)
    for length in SPIKE_RECORDS:
        before, after = _shifted(low, 1), _shifted(low, -length)
        up = (low > before + THRESHOLDS.spike_db) & (_shifted(low, 1 - length) > after + THRESHOLDS.spike_db)
        begins = up.sum(axis=1) > THRESHOLDS.spike_share * known
        for record in range(length):
            is_spike |= np.roll(begins, record)
    return np.where(is_spike[:, None], np.nan, excess_db)


def _held(excess_db: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Each sample in the minutes nearest to it, and how many share one; channels visited too seldom without data."""
    filled, revisit = excess_db.copy(), np.ones(CHANNELS)
    minute = np.arange(len(excess_db))
    for channel in range(CHANNELS):
        known = np.flatnonzero(np.isfinite(excess_db[:, channel]))
        if known.size < 2:
            continue
        gap = np.diff(known)
        revisit[channel] = gap[gap <= 2.0 * np.median(gap)].mean()
        if np.median(gap) <= 1.0:
            revisit[channel] = 1.0
            continue
        if revisit[channel] > THRESHOLDS.longest_revisit_minutes:
            filled[:, channel] = np.nan
            continue
        after = np.clip(np.searchsorted(known, minute), 1, known.size - 1)
        nearest = np.where(minute - known[after - 1] <= known[after] - minute, known[after - 1], known[after])
        near = np.abs(nearest - minute) <= np.ceil(0.5 * revisit[channel])
        filled[near, channel] = excess_db[nearest[near], channel]
    return filled, revisit


def _shifted(values: FloatArray, records: int) -> FloatArray:
    """Values of so many records earlier (later, below 0); NaN beyond the ends."""
    moved = np.full_like(values, np.nan)
    if records > 0:
        moved[records:] = values[:-records]
    elif records < 0:
        moved[:records] = values[-records:]
    else:
        moved[:] = values
    return moved


def _median_of_three(excess_db: FloatArray) -> FloatArray:
    """Median over neighbouring channels that have data: single disturbed channels go, edges in time stay."""
    known = np.flatnonzero(np.isfinite(excess_db).any(axis=0))
    if known.size < 3:
        return excess_db
    padded = np.pad(excess_db[:, known], ((0, 0), (1, 1)), mode="edge")
    stacked = np.stack([padded[:, :-2], padded[:, 1:-1], padded[:, 2:]])
    smooth = np.full_like(excess_db, np.nan)
    smooth[:, known] = np.where(np.isfinite(stacked).all(axis=0), np.sort(stacked, axis=0)[1], padded[:, 1:-1])
    return smooth


def _noise_db(excess_db: FloatArray) -> FloatArray:
    """Scatter about 0 dB by the negative side, which bursts do not reach."""
    negative = np.where(excess_db < 0, excess_db, np.nan)
    count = np.isfinite(negative).sum(axis=0)
    squares = np.nansum(negative**2, axis=0)
    noise = np.maximum(np.sqrt(squares / np.maximum(count, 1)), THRESHOLDS.noise_db)
    return np.where(np.isfinite(excess_db).any(axis=0), noise, np.nan)


class Match(NamedTuple):
    """How well a drift fits, for every minute of arrival at the highest frequency."""

    score: FloatArray
    """Shape (drifts, minutes): beams that leave the Sun, as many as `BEAM_SPEEDS_C`, then drifts that are none."""
    hit: npt.NDArray[np.bool_]
    """Which channels see it, bool, shape (drifts, minutes, CHANNELS)."""
    measured: npt.NDArray[np.bool_]
    """Which channels have data at all, bool, shape (CHANNELS,)."""
    revisit: float = 1.0
    """Minutes that share one sample, median of the channels: a drift by less is not seen."""


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
        rise = TEMPLATE_RISE_S * (frequency / 30.0) ** TEMPLATE_RISE_SLOPE
        decay = float(decay_s(frequency))
        time_s = np.arange(0.0, 2 * rise + max(decay, STEP_S), 1.0)
        shape = np.where(time_s < 2 * rise, np.exp(-0.5 * ((time_s - 2 * rise) / rise) ** 2), 1.0)
        shape *= np.exp(-np.maximum(time_s - 2 * rise, 0) / decay)
        decibel = 10 * np.log10(1 + TEMPLATE_CONTRAST * shape)
        minute = (time_s // STEP_S).astype(int)
        pulse = np.bincount(minute, weights=decibel)
        weights.append(pulse / pulse.sum())
    return tuple(weights)


def channel_match(excess_db: FloatArray, noise_db: FloatArray, revisit: FloatArray | float = 1.0) -> FloatArray:
    """Match of a rise that begins in a minute, in standard deviations of noise.

    Parameters
    ----------
    excess_db : numpy.ndarray, shape (N, CHANNELS)
        dB over background; NaN where nothing was measured.
    noise_db : numpy.ndarray, shape (CHANNELS,)
    revisit : numpy.ndarray, shape (CHANNELS,), or float
        Minutes that share one sample.

    Returns
    -------
    numpy.ndarray, shape (N, CHANNELS)
        NaN where less than half of the pulse or of the minutes before it was measured.
    """
    match = np.full(excess_db.shape, np.nan)
    before = np.full(BEFORE_RECORDS, 1.0 / BEFORE_RECORDS)
    shared = np.broadcast_to(revisit, CHANNELS)
    for channel, pulse in enumerate(_pulses()):
        if not np.isfinite(noise_db[channel]):
            continue
        known = np.isfinite(excess_db[:, channel]).astype(np.float64)
        values = np.nan_to_num(excess_db[:, channel])
        # a sample just before the onset may hold part of the rise: it belongs to neither side
        inside, in_weight, in_square = _weighted(values, known, pulse, 0)
        earlier, early_weight, early_square = _weighted(values, known, before, -BEFORE_RECORDS - 1)
        enough = (in_weight > 0.5) & (early_weight > 0.5)
        # minutes that share a sample have its noise in common
        variance = np.minimum(shared[channel] * in_square, 1.0) if shared[channel] > 1.0 else in_square
        variance = variance + (
            np.minimum(shared[channel] * early_square, 1.0) if shared[channel] > 1.0 else early_square
        )
        sd = noise_db[channel] * np.sqrt(variance)
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


def drift_match(match: FloatArray, revisit: FloatArray | float = 1.0) -> Match:
    """Score of every drift at every minute.

    Parameters
    ----------
    match : numpy.ndarray, shape (N, CHANNELS)
        As from :func:`channel_match`.
    revisit : numpy.ndarray, shape (CHANNELS,), or float
        Minutes that share one sample.
    """
    records = np.rint(drift_delays_s() / STEP_S).astype(np.intp)
    score = np.empty((len(records), len(match)))
    hit = np.empty((len(records), *match.shape), dtype=bool)
    shifted = np.empty_like(match)
    for drift, delays in enumerate(records):  # one at a time, as a long spectrum would take much memory
        for channel, delay in enumerate(delays):
            shifted[:, channel] = _shifted(match[:, channel], -int(delay))
        known = np.isfinite(shifted)
        clipped = np.clip(np.where(known, shifted, 0.0), THRESHOLDS.lowest_match, THRESHOLDS.highest_match)
        hit[drift] = known & (shifted > THRESHOLDS.hit)
        enough = np.minimum(1.0, hit[drift].sum(axis=1) / THRESHOLDS.hits)
        score[drift] = clipped.sum(axis=1) / np.sqrt(np.maximum(known.sum(axis=1), 1)) * enough
    measured = np.asarray(np.isfinite(match).any(axis=0))
    shared = np.broadcast_to(revisit, CHANNELS)[measured]
    return Match(score, hit, measured, float(np.median(shared)) if shared.size else 1.0)

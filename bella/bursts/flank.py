"""Half-rise times below the cadence, from the rising flank alone.

A light curve is fitted up to one sample after its first maximum, so a second burst in the decay has no say. Channels
that no curve fits, and those whose half-maximum in the same stretch says otherwise, are refused.

The shape is a Gaussian rise smeared by an exponential decay, averaged over the integration time of each sample; time,
rise and decay run over a grid, amplitude and background are integrated out, so the error of the time is that of its
whole posterior, also where the flank falls between two samples and no slope is known.

The priors of rise and decay are log-normal about the observed laws of :mod:`bella.bursts.widths`. Their spreads and the
errors of shape below were chosen on simulated bursts of other shapes (``python -m benchmarks.edges --seed 0``), so that
errors over stated sigmas have a standard deviation near 1; other seeds bear it out.

Times on trial are steps of one grid, so the sums over the samples are correlations of the tabulated curves with the
weights of the samples, and all times are had at once from a Fourier transform.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import fft
from scipy.special import chdtrc

from bella.bursts.edge import EDGES_DISAGREE, FIT_FAILED, GAP, NO_FLANK, NO_SAMPLES, NO_SIGNAL, SATURATED, Edge, no_edge
from bella.bursts.first_maximum import first_maximum
from bella.bursts.flank_shapes import Averaging, Shapes, shapes, shared_frequency_mhz
from bella.bursts.half_maximum import FLUX_SCATTER, GAP_CADENCES, LEVEL, half_maximum_edge, quiet_noise, spacing_s
from bella.bursts.widths import rise_half_width_s
from bella.units import FloatArray

BoolArray = npt.NDArray[np.bool_]

RISES_BEFORE = 8.0
"""How much of the background before the first guess is fitted with the flank, in half widths of the rise."""

RISES_AFTER, CADENCES_AFTER = 3.0, 2.0
"""How long after the first guess the fit ends at the latest: so many half widths of the rise and a record, or so many
records. Two bursts without a dip between them have their common maximum later than any single one.
"""

SIGNAL_SIGMAS = 7.0
"""A maximum of fewer standard deviations of the quiet samples is none; of pure noise those below a quarter of the
maximum scatter by two thirds of all.
"""

MISFIT_PROBABILITY = 1e-3
"""The best curve must fit better than noise alone would leave it so rarely."""

SHAPE_ERROR = 0.01
"""Share of the maximum by which a light curve may depart from the fitted shape and from the nodes of the grid."""

TOP_ERROR = 1.5
"""The highest sample was chosen for being high and the one after it may hold another burst: their errors times this."""

SHAPE_SIGMA = 0.025
"""Error of the time that more samples do not lessen, in half widths of the rise: no burst has quite this shape."""

DISAGREE_SIGMAS = 3.0
LINE_BIAS = 0.1
"""Bias of the half-maximum from the straight line between two samples, in records."""

FLANK_WIDTHS = 2.0
"""Duration of the flank from background to maximum along its steepest slope, in half widths of the rise. Of many noisy
samples on it, the half-maximum takes the last below one half and is late by the error of a sample over that slope.
"""

FLANK_RISES = 2.5
"""Half widths of the rise before the first guess from which on no sample may be missing."""

FLAT_SAMPLES, FLAT_RISES = 3, 0.5
"""A light curve that stays at its highest value for so many samples and half widths of the rise has been cut off."""

SAMPLES_ON_RISE, HIGH_SAMPLES = 3.0, 8
"""With so many samples on the half width of the rise, and above half of the maximum, neighbours differ by their scatter
more than by the burst.
"""

LARGEST_SCATTER = 0.15
"""Neighbours that differ by more are not noise: receivers scatter by 0.02 to 0.14 of the power."""

FEWEST = 4
STEPS_PER_RISE, STEPS_PER_CADENCE = 24, 60


class Grid(NamedTuple):
    """Times on trial of a channel and the stretch of its light curve that is fitted, about the first guess."""

    step_s: float
    reach: int
    """Trial times are up to so many steps before and after the guess."""
    before: int
    """The fit begins so many steps before the guess."""
    after: int
    """It ends so many steps after it."""


def _grid(frequency_mhz: float, cadence_s: float) -> Grid:
    rise_s = rise_half_width_s(frequency_mhz)
    step = max(rise_s / STEPS_PER_RISE, cadence_s / STEPS_PER_CADENCE)
    before = max(RISES_BEFORE * rise_s, FEWEST * cadence_s)
    after = max(RISES_AFTER * rise_s + cadence_s, CADENCES_AFTER * cadence_s)
    return Grid(step, *(math.ceil(span / step) for span in (1.5 * (rise_s + cadence_s), before, after)))


class Averaged(NamedTuple):
    """Samples of a channel that are means of the same kind, and the curves as these see them."""

    chosen: BoolArray
    """Shape (N,)."""
    curves: Shapes


def _averaged(grid: Grid, frequency_mhz: float, integration_s: float, apart_s: FloatArray) -> list[Averaged]:
    first = -grid.before - grid.reach
    points = fft.next_fast_len(grid.after + grid.reach + 2 - first, real=True)
    return [
        Averaged(
            apart_s == one, shapes(frequency_mhz, grid.step_s, first, points, Averaging(integration_s, float(one)))
        )
        for one in np.unique(apart_s)
    ]


def _sample_error(power: FloatArray, scatter: float, peak: int) -> FloatArray:
    """Noise of the quiet samples, and a share of the signal; power with maximum 1 at the peak."""
    error = np.hypot(max(quiet_noise(power, 1.0), SHAPE_ERROR), scatter * np.maximum(power, 0.0))
    error[peak:] *= TOP_ERROR
    return np.asarray(error)


def _deposit(position: FloatArray, weight: FloatArray, points: int) -> FloatArray:
    """Weights of samples on the two points of the grid around each, shape (points,)."""
    below = np.floor(position).astype(np.intp)
    share = position - below
    low = np.bincount(below, weight * (1 - share), points)
    return np.asarray(low + np.bincount(below + 1, weight * share, points))


def _explained(
    position: FloatArray, power: FloatArray, weight: FloatArray, grid: Grid, kinds: list[Averaged]
) -> tuple[FloatArray, FloatArray]:
    """Sums over the samples of curve x power and curve x curve about their means, shape (K, trials) each.

    `position` counts steps from the earliest trial time to the sample, less the first point of the curves.
    """
    total = weight.sum()
    sums = [_correlations(position[of], power[of], weight[of], grid, curves) for of, curves in kinds]
    sum_shape, product, square = (np.sum(parts, axis=0) for parts in zip(*sums, strict=True))
    spread = square - sum_shape**2 / total
    possible = (product > 0) & (spread > 1e-9 * total)
    return np.where(possible, product, 0.0), np.where(possible, spread, np.inf)


def _correlations(
    position: FloatArray, power: FloatArray, weight: FloatArray, grid: Grid, curves: Shapes
) -> list[FloatArray]:
    """Sums over samples of one kind of curve, curve x power and curve x curve, shape (K, trials) each."""
    points = curves.samples.shape[1]
    # at the latest trial time the samples lie 2 * reach steps farther left on the curve
    offset = position - 2 * grid.reach
    deposited = fft.rfft([_deposit(offset, weight, points), _deposit(offset, weight * power, points)]).conj()
    trials = slice(2 * grid.reach, None, -1)
    pairs = [(curves.transform, 0), (curves.transform, 1), (curves.square_transform, 0)]
    return [np.asarray(fft.irfft(of * deposited[which], points)[:, trials]) for of, which in pairs]


def _fitted(time: FloatArray, power: FloatArray, error: FloatArray, grid: Grid, kinds: list[Averaged]) -> Edge:
    """Mean and standard deviation of the posterior; time from the first guess.

    The background has a flat prior, the amplitude one over itself: a flat one would prefer that a single sample has
    caught the foot of a burst without bound. Where even the best curve misses by more than the errors of the samples,
    these are widened to what it misses by.
    """
    weight = 1.0 / error**2
    relative = power - np.average(power, weights=weight)
    position = time / grid.step_s + grid.reach - kinds[0].curves.first
    product, spread = _explained(position, relative, weight, grid, kinds)
    explained = product**2 / spread
    if not explained.max() > 0:
        return no_edge(NO_FLANK)
    free, misfit = time.size - 2, float((weight * relative**2).sum() - explained.max())
    if chdtrc(free, misfit) < MISFIT_PROBABILITY:
        return no_edge(FIT_FAILED)
    explained /= max(1.0, misfit / free)
    with np.errstate(divide="ignore", invalid="ignore"):
        log = 0.5 * explained + np.where(product > 0, 0.5 * np.log(spread) - np.log(product), -np.inf)
    log += kinds[0].curves.log_prior[:, None]
    probability = np.exp(log - log.max()).sum(axis=0)
    trial = grid.step_s * np.arange(-grid.reach, grid.reach + 1)
    mean = float(np.average(trial, weights=probability))
    variance = float(np.average((trial - mean) ** 2, weights=probability))
    return Edge(mean, math.sqrt(variance + grid.step_s**2 / 12), "")


class Channel(NamedTuple):
    """Light curve of a channel without its missing samples."""

    time_s: FloatArray
    power: FloatArray
    cadence_s: float
    frequency_mhz: float
    integration_s: float
    apart_s: FloatArray
    """Between the two visits that a sample is the mean of, 0 where there was one; shape (N,)."""
    scatter: float = FLUX_SCATTER
    """Standard deviation of a sample as a share of its power."""


def _scatter(channel: Channel) -> float:
    """Scatter of samples about the mean of their neighbours while the burst is high, if there are enough of them."""
    middle = channel.power[1:-1]
    high = middle > LEVEL * channel.power.max(initial=0.0)
    if channel.cadence_s * SAMPLES_ON_RISE > rise_half_width_s(channel.frequency_mhz) or high.sum() < HIGH_SAMPLES:
        return FLUX_SCATTER
    relative = (middle - 0.5 * (channel.power[2:] + channel.power[:-2]))[high] / middle[high]
    scatter = 1.4826 * float(np.median(np.abs(relative))) / math.sqrt(1.5)
    return min(max(scatter, FLUX_SCATTER), LARGEST_SCATTER)


def _channel_edge(channel: Channel) -> Edge:
    if channel.time_s.size < FEWEST:
        return no_edge(NO_SAMPLES)
    rise = rise_half_width_s(channel.frequency_mhz)
    peak = first_maximum(channel.power, rise / channel.cadence_s, channel.scatter)
    straight = half_maximum_edge(channel.time_s, channel.power, channel.cadence_s, float(channel.time_s[peak]))
    if straight.flag:
        return straight
    if channel.power[peak] < SIGNAL_SIGMAS * quiet_noise(channel.power, float(channel.power[peak])):
        return no_edge(NO_SIGNAL)
    if _saturated(channel, peak, rise):
        return no_edge(SATURATED)
    edge = _half_rise(channel, peak, straight.arrival_s)
    if edge.flag:
        return edge
    edge = edge._replace(sigma_s=math.hypot(edge.sigma_s, SHAPE_SIGMA * rise))
    return no_edge(EDGES_DISAGREE) if _disagree(edge, straight, channel, peak) else edge


def _disagree(edge: Edge, straight: Edge, channel: Channel, peak: int) -> bool:
    height = channel.power[: peak + 1] / channel.power[peak]
    flank_s = FLANK_WIDTHS * rise_half_width_s(channel.frequency_mhz)
    late = flank_s * math.hypot(quiet_noise(height, 1.0), channel.scatter)
    joint = math.hypot(edge.sigma_s, straight.sigma_s, LINE_BIAS * channel.cadence_s, late)
    return abs(edge.arrival_s - straight.arrival_s) > DISAGREE_SIGMAS * joint


def _saturated(channel: Channel, peak: int, rise_s: float) -> bool:
    lower = np.flatnonzero(channel.power[peak:] < channel.power[peak])
    flat = int(lower[0]) if lower.size else channel.power.size - peak
    return flat >= FLAT_SAMPLES and channel.time_s[peak + flat - 1] - channel.time_s[peak] >= FLAT_RISES * rise_s


def _half_rise(channel: Channel, peak: int, guess_s: float) -> Edge:
    """Fit of the background, the rise, and one sample after the maximum."""
    shared_mhz = shared_frequency_mhz(channel.frequency_mhz)
    grid = _grid(shared_mhz, channel.cadence_s)
    time, height = channel.time_s[: peak + 2] - guess_s, channel.power[: peak + 2] / channel.power[peak]
    error = _sample_error(height, channel.scatter, peak)
    inside = (time >= -grid.before * grid.step_s) & (time <= grid.after * grid.step_s)
    if inside.sum() < FEWEST:
        return no_edge(NO_SAMPLES)
    flank = time[1:] >= -FLANK_RISES * rise_half_width_s(channel.frequency_mhz)
    if np.diff(time)[flank].max() > GAP_CADENCES * channel.cadence_s:
        return no_edge(GAP)
    kinds = _averaged(grid, shared_mhz, channel.integration_s, channel.apart_s[: peak + 2][inside])
    edge = _fitted(time[inside], height[inside], error[inside], grid, kinds)
    return edge._replace(arrival_s=guess_s + edge.arrival_s)


class SampleAveraging(NamedTuple):
    """What samples are the means of."""

    integration_s: FloatArray | float
    """Time that one visit averages over, s, shape () or (C,)."""
    apart_s: FloatArray | float
    """Time between the two visits that a sample is the mean of, s, shape () or (N, C); 0 where there was one."""


def flank_edges(
    time_s: FloatArray,
    power: FloatArray,
    cadence_s: float,
    frequency_mhz: FloatArray,
    averaging: FloatArray | float | SampleAveraging,
) -> list[Edge]:
    """Half-rise time of every channel.

    Parameters
    ----------
    time_s : numpy.ndarray, shape (N,) or (N, C)
        Middles of the samples, ascending, s.
    power : numpy.ndarray, shape (N, C)
        Power above background in any unit; NaN where there are no data.
    cadence_s : float
        Time between records, s.
    frequency_mhz : numpy.ndarray, shape (C,)
        MHz.
    averaging : float, numpy.ndarray of shape (C,), or SampleAveraging
        Time that one sample averages over, s; or that and which samples are the mean of two visits.

    Returns
    -------
    list of Edge
        Mean and standard deviation of the posterior; or NaN with a reason of :mod:`bella.bursts.edge`, among them
        ``edges_disagree``, where the half-maximum says otherwise, and ``saturated``.
    """
    times = np.broadcast_to(time_s if time_s.ndim == 2 else time_s[:, None], power.shape)
    over = averaging if isinstance(averaging, SampleAveraging) else SampleAveraging(averaging, 0.0)
    means_s, apart_s = (
        np.broadcast_to(over.integration_s, frequency_mhz.shape),
        np.broadcast_to(over.apart_s, power.shape),
    )
    channels = []
    for index, frequency in enumerate(frequency_mhz):
        known = np.isfinite(power[:, index])
        time = times[known, index]
        light_curve = (time, power[known, index], spacing_s(time, cadence_s))
        channels.append(Channel(*light_curve, float(frequency), float(means_s[index]), apart_s[known, index]))
    return [_channel_edge(channel._replace(scatter=_scatter(channel))) for channel in channels]

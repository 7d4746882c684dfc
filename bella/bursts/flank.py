"""Half-rise times below the cadence, from the rising flank alone.

A light curve is fitted up to one sample after its first maximum, so a second burst in the decay has no say. Channels
that no curve fits, and those whose half-maximum in the same stretch says otherwise, are refused.

The shape is a Gaussian rise smeared by an exponential decay, averaged over the integration time of each sample; time,
rise and decay run over a grid, amplitude and background are integrated out, so the error of the time is that of its
whole posterior, also where the flank falls between two samples and no slope is known.

The priors of rise and decay are log-normal about the rise of the burst and the observed law of decays. Their spreads
and the errors of shape below were chosen on simulated bursts of other shapes. What a light curve departs from these
shapes is not in the error: it is estimated for the whole burst (:mod:`bella.bursts.noise`).

Times on trial are steps of one grid, so the sums over the samples are correlations of the tabulated curves with the
weights of the samples, and all times are had at once from a Fourier transform.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray
from scipy import fft
from scipy.special import chdtrc, log_ndtr, ndtr

from bella.bursts.edges import (
    EDGES_DISAGREE,
    FIT_FAILED,
    FLUX_SCATTER,
    GAP,
    GAP_CADENCES,
    LEVEL,
    NO_FLANK,
    NO_SAMPLES,
    NO_SIGNAL,
    SATURATED,
    Edge,
    cut_off_with_others,
    first_maximum,
    half_maximum_edge,
    is_cut_off,
    no_edge,
    quiet_noise,
    spacing_s,
)
from bella.bursts.light_curves import LightCurves, RiseOfBurst, decay_s, own_rise
from bella.units import FloatArray

RISE_SPREAD, DECAY_SPREAD = 0.4, 0.35
"""Standard deviations of the logarithms of rise and decay about their laws."""

SPREADS = (-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)
"""Nodes of rise and decay, in standard deviations of their priors."""

WIDTH_STEP = 0.08
"""Channels whose rise and decay differ by less than this share are fitted with the same curves."""

HALF_WIDTH_SD = math.sqrt(2 * math.log(2))
"""Half width at half maximum of a Gaussian, in its standard deviations."""

RATIO_STEP = 0.05
"""Step of the logarithm of decay over rise between tabulated curves."""

BEFORE_SD, AFTER_SD, STEPS_PER_SD = 8.0, 40.0, 40
UNIT_TIME = np.linspace(-BEFORE_SD, AFTER_SD, int((BEFORE_SD + AFTER_SD) * STEPS_PER_SD) + 1)
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

DISAGREE_SIGMAS = 3.0
LINE_BIAS = 0.1
"""Bias of the half-maximum from the straight line between two samples, in records."""

FLANK_WIDTHS = 2.0
"""Duration of the flank from background to maximum along its steepest slope, in half widths of the rise. Of many noisy
samples on it, the half-maximum takes the last below one half and is late by the error of a sample over that slope.
"""

FLANK_RISES = 2.5
"""Half widths of the rise before the first guess from which on no sample may be missing."""

SAMPLES_ON_RISE, HIGH_SAMPLES = 3.0, 8
"""With so many samples on the half width of the rise, and above half of the maximum, neighbours differ by their scatter
more than by the burst.
"""

LARGEST_SCATTER = 0.15
"""Neighbours that differ by more are not noise: receivers scatter by 0.02 to 0.14 of the power."""

FEWEST = 4
STEPS_PER_RISE, STEPS_PER_CADENCE = 24, 60


class UnitCurve(NamedTuple):
    """Curve whose rise has a standard deviation of 1."""

    integral: FloatArray
    """Running integral at :data:`UNIT_TIME`, from 0 towards 1."""
    height: float
    """Maximum of the curve."""
    half_rise: float
    """When it has risen to half of that."""


@lru_cache(maxsize=512)
def unit_curve(step: int) -> UnitCurve:
    """Gaussian smeared by an exponential.

    Parameters
    ----------
    step : int
        Logarithm of the decay in standard deviations of the rise, in units of ``RATIO_STEP``.
    """
    tail = float(np.exp(step * RATIO_STEP))
    smeared = np.exp(np.minimum(0.5 / tail**2 - UNIT_TIME / tail + log_ndtr(UNIT_TIME - 1 / tail), 0.0))
    density = smeared / tail
    top = int(density.argmax())
    half_rise = np.interp(LEVEL * density[top], density[: top + 1], UNIT_TIME[: top + 1])
    return UnitCurve(ndtr(UNIT_TIME) - smeared, float(density[top]), float(half_rise))


class Averaging(NamedTuple):
    """What a sample is the mean of."""

    integration_s: float
    """Time that one visit averages over, s."""
    apart_s: float = 0.0
    """Time between the two visits that a sample is the mean of, s; 0 where there was one."""


class Shapes(NamedTuple):
    """Curves of maximum 1 about their half-rise, and how likely they are beforehand."""

    first: int
    """Of the half-rise, in steps before the first point is this many (not above zero)."""
    samples: FloatArray
    """Means over what a sample averages, shape (K, G)."""
    transform: NDArray[np.complex128]
    """Fourier transform of the samples, shape (K, G // 2 + 1)."""
    square_transform: NDArray[np.complex128]
    """The same of their squares."""
    log_prior: FloatArray
    """Shape (K,)."""


def _rounded(time_s: float) -> float:
    """Rise or decay that a channel is fitted with: one for all that are near it, so that curves are made once."""
    return float(np.exp(round(float(np.log(time_s)) / WIDTH_STEP) * WIDTH_STEP))


@lru_cache(maxsize=256)
def shapes(widths_s: tuple[float, float], step_s: float, first: int, points: int, averaging: Averaging) -> Shapes:
    """Curves of a frequency.

    Parameters
    ----------
    widths_s : tuple of float
        Half width of the rise, and decay time, s.
    step_s : float
        Spacing of the points, s.
    first, points : int
        Of the first point, in steps after the half-rise, and their number, G.
    averaging : Averaging
        What a sample is the mean of.
    """
    time = step_s * (first + np.arange(points))
    rows, prior = [], []
    for of_rise in SPREADS:
        sd = widths_s[0] / HALF_WIDTH_SD * np.exp(of_rise * RISE_SPREAD)
        for of_decay in SPREADS:
            tail = widths_s[1] * np.exp(of_decay * DECAY_SPREAD)
            in_sd = Averaging(averaging.integration_s / sd, averaging.apart_s / sd)
            rows.append(_means(time / sd, in_sd, round(float(np.log(tail / sd)) / RATIO_STEP)))
            prior.append(-0.5 * (of_rise**2 + of_decay**2))
    samples = np.array(rows)
    return Shapes(first, samples, fft.rfft(samples), fft.rfft(samples**2), np.array(prior))


def _means(time: FloatArray, averaging: Averaging, step: int) -> FloatArray:
    if averaging.apart_s:
        visit = averaging._replace(apart_s=0.0)
        return np.asarray(0.5 * sum(_means(time + side * averaging.apart_s, visit, step) for side in (-0.5, 0.5)))
    curve, width = unit_curve(step), averaging.integration_s
    upto = [np.interp(curve.half_rise + time + half, UNIT_TIME, curve.integral) for half in (-0.5 * width, 0.5 * width)]
    return np.asarray((upto[1] - upto[0]) / (width * curve.height))


BoolArray = npt.NDArray[np.bool_]


class Grid(NamedTuple):
    """Times on trial of a channel and the stretch of its light curve that is fitted, about the first guess."""

    step_s: float
    reach: int
    """Trial times are up to so many steps before and after the guess."""
    before: int
    """The fit begins so many steps before the guess."""
    after: int
    """It ends so many steps after it."""


def _grid(rise_s: float, cadence_s: float) -> Grid:
    step = max(rise_s / STEPS_PER_RISE, cadence_s / STEPS_PER_CADENCE)
    before = max(RISES_BEFORE * rise_s, FEWEST * cadence_s)
    after = max(RISES_AFTER * rise_s + cadence_s, CADENCES_AFTER * cadence_s)
    return Grid(step, *(math.ceil(span / step) for span in (1.5 * (rise_s + cadence_s), before, after)))


class Averaged(NamedTuple):
    """Samples of a channel that are means of the same kind, and the curves as these see them."""

    chosen: BoolArray
    """Shape (N,)."""
    curves: Shapes


def _averaged(grid: Grid, widths_s: tuple[float, float], integration_s: float, apart_s: FloatArray) -> list[Averaged]:
    first = -grid.before - grid.reach
    points = fft.next_fast_len(grid.after + grid.reach + 2 - first, real=True)
    return [
        Averaged(apart_s == one, shapes(widths_s, grid.step_s, first, points, Averaging(integration_s, float(one))))
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
    """Mean and standard deviation of the posterior; time from the first guess. Height and background are fitted."""
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
    log = np.where(product > 0, 0.5 * explained, -np.inf)
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
    rise_s: float
    """Half width of the rise at its frequency."""
    decay_s: float
    integration_s: float
    apart_s: FloatArray
    """Between the two visits that a sample is the mean of, 0 where there was one; shape (N,)."""
    scatter: float = FLUX_SCATTER
    """Standard deviation of a sample as a share of its power."""


def _scatter(channel: Channel) -> float:
    """Scatter of samples about the mean of their neighbours while the burst is high, if there are enough of them."""
    middle = channel.power[1:-1]
    high = middle > LEVEL * channel.power.max(initial=0.0)
    if channel.cadence_s * SAMPLES_ON_RISE > channel.rise_s or high.sum() < HIGH_SAMPLES:
        return FLUX_SCATTER
    relative = (middle - 0.5 * (channel.power[2:] + channel.power[:-2]))[high] / middle[high]
    scatter = 1.4826 * float(np.median(np.abs(relative))) / math.sqrt(1.5)
    return min(max(scatter, FLUX_SCATTER), LARGEST_SCATTER)


def _channel_edge(channel: Channel) -> Edge:
    if channel.time_s.size < FEWEST:
        return no_edge(NO_SAMPLES)
    rise = channel.rise_s
    peak = first_maximum(channel.power, rise / channel.cadence_s, channel.scatter)
    straight = half_maximum_edge(channel.time_s, channel.power, channel.cadence_s, float(channel.time_s[peak]))
    if straight.flag:
        return straight
    if channel.power[peak] < SIGNAL_SIGMAS * quiet_noise(channel.power, float(channel.power[peak])):
        return no_edge(NO_SIGNAL)
    if is_cut_off(channel.time_s, channel.power, peak, rise):
        return no_edge(SATURATED)
    edge = _half_rise(channel, peak, straight.arrival_s)
    if edge.flag:
        return edge
    return no_edge(EDGES_DISAGREE) if _disagree(edge, straight, channel, peak) else edge


def _disagree(edge: Edge, straight: Edge, channel: Channel, peak: int) -> bool:
    height = channel.power[: peak + 1] / channel.power[peak]
    flank_s = FLANK_WIDTHS * channel.rise_s
    late = flank_s * math.hypot(quiet_noise(height, 1.0), channel.scatter)
    joint = math.hypot(edge.sigma_s, straight.sigma_s, LINE_BIAS * channel.cadence_s, late)
    return abs(edge.arrival_s - straight.arrival_s) > DISAGREE_SIGMAS * joint


def _half_rise(channel: Channel, peak: int, guess_s: float) -> Edge:
    """Fit of the background, the rise, and one sample after the maximum."""
    widths_s = _rounded(channel.rise_s), _rounded(channel.decay_s)
    grid = _grid(widths_s[0], channel.cadence_s)
    time, height = channel.time_s[: peak + 2] - guess_s, channel.power[: peak + 2] / channel.power[peak]
    error = _sample_error(height, channel.scatter, peak)
    inside = (time >= -grid.before * grid.step_s) & (time <= grid.after * grid.step_s)
    if inside.sum() < FEWEST:
        return no_edge(NO_SAMPLES)
    flank = time[1:] >= -FLANK_RISES * channel.rise_s
    if np.diff(time)[flank].max() > GAP_CADENCES * channel.cadence_s:
        return no_edge(GAP)
    kinds = _averaged(grid, widths_s, channel.integration_s, channel.apart_s[: peak + 2][inside])
    edge = _fitted(time[inside], height[inside], error[inside], grid, kinds)
    return edge._replace(arrival_s=guess_s + edge.arrival_s)


class SampleAveraging(NamedTuple):
    """What samples are the means of."""

    integration_s: FloatArray | float
    """Time that one visit averages over, s, shape () or (C,)."""
    apart_s: FloatArray | float
    """Time between the two visits that a sample is the mean of, s, shape () or (N, C); 0 where there was one."""


def flank_edges(  # noqa: PLR0913 - one light curve has as many parts
    time_s: FloatArray,
    power: FloatArray,
    cadence_s: float,
    frequency_mhz: FloatArray,
    averaging: FloatArray | float | SampleAveraging,
    *,
    rises: RiseOfBurst | None = None,
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
    rises : RiseOfBurst
        Half width of the rise at each frequency; that which the light curves show unless given.

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
    if rises is None:
        rises = own_rise([LightCurves("", frequency_mhz, times, power, 0.0, cadence_s, means_s, apart_s)])
    rise, decay = rises.rise_s(frequency_mhz), decay_s(frequency_mhz)
    for index in range(frequency_mhz.size):
        known = np.isfinite(power[:, index])
        time = times[known, index]
        light_curve = (time, power[known, index], spacing_s(time, cadence_s))
        channels.append(
            Channel(*light_curve, float(rise[index]), float(decay[index]), float(means_s[index]), apart_s[known, index])
        )
    found = [_channel_edge(channel._replace(scatter=_scatter(channel))) for channel in channels]
    flag = np.array([one.flag for one in found], dtype=object)
    cut_off = cut_off_with_others(frequency_mhz, power, rise / cadence_s, flag)
    return [no_edge(SATURATED) if cut else one for one, cut in zip(found, cut_off, strict=True)]

"""Half-rise times below the cadence, from the rising flank alone.

A light curve is fitted up to one sample after its highest sample, so a second burst in the decay has no say as long as
it does not rise above the first; where it does, its own flank may be timed, and nothing here tells.

The shape is a Gaussian rise smeared by an exponential decay, averaged over the integration time of each sample; time,
rise and decay run over a grid, amplitude and background are integrated out exactly, so the error of the time is that
of its whole posterior, also where the flank falls between two samples and no slope is known.

The priors of rise and decay are log-normal about the observed laws of :mod:`bella.bursts.widths`.
"""

import math
from functools import lru_cache

import numpy as np
from scipy.special import log_ndtr, ndtr

from bella.bursts.edges import (
    FLUX_SCATTER,
    GAP,
    GAP_CADENCES,
    LEVEL,
    NO_FLANK,
    NO_SAMPLES,
    Edge,
    half_maximum_edge,
    quiet_noise,
)
from bella.bursts.widths import HALF_WIDTH_SD, decay_s, rise_half_width_s
from bella.units import FloatArray

RISE_SPREAD, DECAY_SPREAD = 0.5, 0.4
"""Standard deviations of the logarithms of rise and decay about their laws."""

SPREADS = (-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)
"""Nodes of rise and decay, in standard deviations of their priors."""

TIMES = 161
RISES_BEFORE = 8.0
"""How much of the background before the flank is fitted with it, in half widths of the rise."""

SHAPE_ERROR = 0.04
"""Share of a sample by which a light curve may depart from the fitted shape and from the nodes of the grid."""

FEWEST = 4
SAMPLES_AFTER_PEAK = 1


@lru_cache(maxsize=4096)
def _landmarks(sd_s: float, tail_s: float) -> tuple[float, float]:
    """Height of the smeared Gaussian at its maximum, 1/s, and when it has risen to half of that, s."""
    time = np.linspace(-4 * sd_s, 4 * sd_s + 2 * tail_s, 4001)
    density = np.gradient(_integral(time, sd_s, tail_s), time)
    top = int(density.argmax())
    return float(density[top]), float(np.interp(LEVEL * density[top], density[: top + 1], time[: top + 1]))


def _integral(time_s: FloatArray, sd_s: float, tail_s: float) -> FloatArray:
    """Running integral of a Gaussian smeared by an exponential, 0 to 1."""
    x = time_s / sd_s
    smeared = np.exp(np.minimum(0.5 * (sd_s / tail_s) ** 2 - time_s / tail_s + log_ndtr(x - sd_s / tail_s), 0.0))
    return np.asarray(ndtr(x) - smeared)


def _samples(after_s: FloatArray, integration_s: float, sd_s: float, tail_s: float) -> FloatArray:
    """Mean of the curve of maximum 1 over samples whose middles are so long after the half-rise."""
    height, half_s = _landmarks(sd_s, tail_s)
    low, high = after_s + half_s - 0.5 * integration_s, after_s + half_s + 0.5 * integration_s
    return np.asarray((_integral(high, sd_s, tail_s) - _integral(low, sd_s, tail_s)) / (integration_s * height))


def _flank(time_s: FloatArray, power: FloatArray, before_s: float) -> slice:
    """Background, rise, and one sample after the maximum."""
    peak = int(power.argmax())
    first = int(np.searchsorted(time_s, time_s[peak] - before_s))
    return slice(max(0, min(first, peak - FEWEST)), peak + 1 + SAMPLES_AFTER_PEAK)


def _sample_error(power: FloatArray) -> FloatArray:
    """Noise of the quiet samples, and a share of the signal."""
    maximum = float(power.max())
    relative = np.hypot(FLUX_SCATTER, SHAPE_ERROR)
    return np.asarray(np.hypot(max(quiet_noise(power, maximum), 1e-3 * maximum), relative * np.maximum(power, 0.0)))


def _log_evidence(shape: FloatArray, power: FloatArray, error: FloatArray) -> FloatArray:
    """Evidence of each shape, samples on the last axis, with amplitude and background integrated out."""
    weight = 1.0 / error**2
    total, mean_power = weight.sum(), (weight * power).sum() / weight.sum()
    inner = shape - ((weight * shape).sum(axis=-1) / total)[..., None]
    spread = (weight * inner**2).sum(axis=-1)
    product = (weight * inner * (power - mean_power)).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        evidence = 0.5 * product**2 / spread - 0.5 * np.log(spread)
    return np.where((product > 0) & (spread > 0), evidence, -np.inf)


def _posterior(
    trial_s: FloatArray, time_s: FloatArray, power: FloatArray, frequency_mhz: float, integration_s: float
) -> FloatArray:
    """Posterior of each trial time, rise and decay integrated over their priors."""
    error, after = _sample_error(power), time_s - trial_s[:, None]
    layers = []
    for of_rise in SPREADS:
        for of_decay in SPREADS:
            rise = rise_half_width_s(frequency_mhz) * math.exp(of_rise * RISE_SPREAD)
            decay = decay_s(frequency_mhz) * math.exp(of_decay * DECAY_SPREAD)
            shape = _samples(after, integration_s, rise / HALF_WIDTH_SD, decay)
            layers.append(_log_evidence(shape, power, error) - 0.5 * (of_rise**2 + of_decay**2))
    log = np.array(layers)
    return np.asarray(np.exp(log - log.max()).sum(axis=0))


def flank_edge(
    time_s: FloatArray, power: FloatArray, cadence_s: float, frequency_mhz: float, integration_s: float
) -> Edge:
    """Half-rise time of a light curve.

    Parameters
    ----------
    time_s : numpy.ndarray, shape (N,)
        Middles of the samples, ascending, s.
    power : numpy.ndarray, shape (N,)
        Power above background in any unit; NaN where there are no data.
    cadence_s : float
        Time between records, s.
    frequency_mhz : float
        MHz.
    integration_s : float
        Time that one sample averages over, s.

    Returns
    -------
    Edge
        Mean and standard deviation of the posterior; or NaN with a reason of :mod:`bella.bursts.edges`.
    """
    first_guess = half_maximum_edge(time_s, power, cadence_s)
    if first_guess.flag:
        return first_guess
    known = np.isfinite(power)
    time, height = time_s[known], power[known] / np.nanmax(power)
    rise = rise_half_width_s(frequency_mhz)
    flank = _flank(time, height, max(RISES_BEFORE * rise, FEWEST * cadence_s) + rise)
    time, height = time[flank], height[flank]
    if time.size < FEWEST:
        return Edge(math.nan, math.nan, NO_SAMPLES)
    if np.diff(time).max() > GAP_CADENCES * cadence_s:
        return Edge(math.nan, math.nan, GAP)
    reach = 1.5 * cadence_s + 1.5 * rise
    trial = first_guess.arrival_s + np.linspace(-reach, reach, TIMES)
    probability = _posterior(trial, time, height, frequency_mhz, integration_s)
    if not probability.sum() > 0:
        return Edge(math.nan, math.nan, NO_FLANK)
    mean = float(np.average(trial, weights=probability))
    return Edge(mean, math.sqrt(float(np.average((trial - mean) ** 2, weights=probability))), "")

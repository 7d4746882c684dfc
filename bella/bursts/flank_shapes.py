"""Light curves that a flank is fitted with: a Gaussian rise smeared by an exponential decay, as samples see them.

The running integral of such a curve depends on two numbers, the time and the decay, both in standard deviations of the
rise. It is tabulated once; the curves of a frequency are read off it.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.special import log_ndtr, ndtr

from bella.bursts.half_maximum import LEVEL
from bella.bursts.widths import HALF_WIDTH_SD, decay_s, rise_half_width_s
from bella.units import FloatArray

RISE_SPREAD, DECAY_SPREAD = 0.4, 0.35
"""Standard deviations of the logarithms of rise and decay about their laws."""

SPREADS = (-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)
"""Nodes of rise and decay, in standard deviations of their priors."""

FREQUENCY_STEP = 0.08
"""Channels whose frequencies differ by less than this share are fitted with the same curves."""

RATIO_STEP = 0.05
"""Step of the logarithm of decay over rise between tabulated curves."""

BEFORE_SD, AFTER_SD, STEPS_PER_SD = 8.0, 40.0, 40


class UnitCurve(NamedTuple):
    """Curve whose rise has a standard deviation of 1."""

    integral: FloatArray
    """Running integral at :data:`UNIT_TIME`, from 0 towards 1."""
    height: float
    """Maximum of the curve."""
    half_rise: float
    """When it has risen to half of that."""


UNIT_TIME = np.linspace(-BEFORE_SD, AFTER_SD, int((BEFORE_SD + AFTER_SD) * STEPS_PER_SD) + 1)


@lru_cache(maxsize=512)
def unit_curve(step: int) -> UnitCurve:
    """Gaussian smeared by an exponential.

    Parameters
    ----------
    step : int
        Logarithm of the decay in standard deviations of the rise, in units of ``RATIO_STEP``.

    Returns
    -------
    UnitCurve
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


def shared_frequency_mhz(frequency_mhz: float) -> float:
    """Frequency whose curves a channel is fitted with, MHz: one for all near it, so that they are made once."""
    return float(np.exp(round(float(np.log(frequency_mhz)) / FREQUENCY_STEP) * FREQUENCY_STEP))


@lru_cache(maxsize=256)
def shapes(frequency_mhz: float, step_s: float, first: int, points: int, averaging: Averaging) -> Shapes:
    """Curves of a frequency.

    Parameters
    ----------
    frequency_mhz : float
        MHz.
    step_s : float
        Spacing of the points, s.
    first, points : int
        Of the first point, in steps after the half-rise, and their number, G.
    averaging : Averaging
        What a sample is the mean of.

    Returns
    -------
    Shapes
    """
    time = step_s * (first + np.arange(points))
    rows, prior = [], []
    for of_rise in SPREADS:
        sd = rise_half_width_s(frequency_mhz) / HALF_WIDTH_SD * np.exp(of_rise * RISE_SPREAD)
        for of_decay in SPREADS:
            tail = decay_s(frequency_mhz) * np.exp(of_decay * DECAY_SPREAD)
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

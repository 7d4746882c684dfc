"""Half-maximum edges of light curves.

The edge of a channel is where the rising flank that leads to its maximum crosses half of the maximum *power*, by linear
interpolation between the two samples around the crossing. Amplitudes (Wind) are squared first: half of an amplitude is
a quarter of the power, which the built-in burst reached 5 s (2 MHz) to 80 s (0.2 MHz) earlier.

How sure: the error of a sample near the crossing, carried over by the slope of the flank, and the error of drawing a
straight line between samples, added in quadrature. The second is ``cadence / sqrt(12)`` when the flank falls between
two samples, and shrinks in proportion to the number of samples on it. Simulated bursts scatter by as much at 3 MHz and
by a half to a quarter of it from 1 MHz down, so this errs on the wide side.
"""

import math

import numpy as np

from bella.bursts.edge import GAP, NO_DECAY, NO_FLANK, NO_SAMPLES, NO_SIGNAL, Edge, no_edge
from bella.units import FloatArray

LEVEL = 0.5
"""Fraction of the maximum power at which a flank is timed."""

FLUX_SCATTER = 0.05
"""Typical fractional scatter of a sample of Wind and STEREO one-minute spectra, beside the noise before the burst."""

QUIET_SAMPLES = 4
"""From so few samples before the flank on, their scatter is taken as the noise."""

GAP_CADENCES = 1.5
"""Samples around the crossing that lie further apart than this many records leave the flank unknown."""


def half_maximum_edge(time_s: FloatArray, power: FloatArray, cadence_s: float, last_s: float = math.inf) -> Edge:
    """Time at which the flank that leads to the maximum crosses half of it.

    The last sample below half maximum before the peak and the one after it are the two around the crossing, so an
    earlier spike of noise or precursor burst is passed over.

    Parameters
    ----------
    time_s : numpy.ndarray
        Times of the samples, ascending, s, shape (N,).
    power : numpy.ndarray
        Power above background in any unit, shape (N,); NaN where there are no data.
    cadence_s : float
        Time between records, s.
    last_s : float
        The maximum is looked for up to this time, so that a later burst is passed over.

    Returns
    -------
    Edge
        With a reason and NaN when there is no edge: ``no_samples`` (fewer than three), ``no_signal`` (nothing above
        zero), ``no_flank`` (above half maximum from the first sample on), ``no_decay`` (highest at the last sample, so
        the maximum is unknown), ``gap_in_flank``.
    """
    known = np.isfinite(power)
    time_s, power = time_s[known], power[known]
    samples, early = power.size, time_s <= last_s
    time_s, power = time_s[early], power[early]
    if samples < 3 or power.size == 0:
        return no_edge(NO_SAMPLES)
    peak = int(power.argmax())
    half = LEVEL * power[peak]
    if not half > 0.0:
        return no_edge(NO_SIGNAL)
    below = np.flatnonzero(power[:peak] < half)
    if below.size == 0:
        return no_edge(NO_FLANK)
    if peak == samples - 1:
        return no_edge(NO_DECAY)
    return _crossing(time_s, power, cadence_s, int(below[-1]))


def _crossing(time_s: FloatArray, power: FloatArray, cadence_s: float, last_below: int) -> Edge:
    interval_s = time_s[last_below + 1] - time_s[last_below]
    if interval_s > GAP_CADENCES * cadence_s:
        return no_edge(GAP)
    maximum = power.max()
    slope = (power[last_below + 1] - power[last_below]) / interval_s
    arrival_s = time_s[last_below] + (LEVEL * maximum - power[last_below]) / slope
    sample_error = math.hypot(quiet_noise(power[: last_below + 1], maximum), FLUX_SCATTER * LEVEL * maximum)
    samples_on_flank = max(1.0, maximum / slope / cadence_s)
    line_error_s = cadence_s / math.sqrt(12.0) / samples_on_flank
    return Edge(float(arrival_s), math.hypot(sample_error / slope, line_error_s), "")


def spacing_s(time_s: FloatArray, cadence_s: float) -> float:
    """Time between samples of a channel: of one that is sampled in every other record only, the rest is no gap.

    Parameters
    ----------
    time_s : numpy.ndarray, shape (N,)
        Times of its samples without those that are missing, ascending, s.
    cadence_s : float
        Time between records, s.

    Returns
    -------
    float
        s, not below the cadence.
    """
    return max(cadence_s, float(np.median(np.diff(time_s)))) if time_s.size > 1 else cadence_s


def quiet_noise(power: FloatArray, maximum: float) -> float:
    """Scatter of the samples below a quarter of the maximum.

    Parameters
    ----------
    power : numpy.ndarray, shape (N,)
        In any unit.
    maximum : float
        In the same unit.

    Returns
    -------
    float
        Standard deviation in that unit, by the median absolute deviation; 0 where too few samples are quiet.
    """
    quiet = power[power < 0.25 * maximum]
    if quiet.size < QUIET_SAMPLES:
        return 0.0
    return 1.4826 * float(np.median(np.abs(quiet - np.median(quiet))))

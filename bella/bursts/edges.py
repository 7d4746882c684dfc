"""The edge of one light curve: when a burst rises, how sure that is, or why nothing is known.

*half maximum*: where the rising flank that leads to the maximum crosses half of the maximum *power*, by linear
interpolation between the two samples around the crossing. Amplitudes (Wind) are squared first: half of an amplitude is
a quarter of the power, which the built-in burst reached 5 s (2 MHz) to 80 s (0.2 MHz) earlier. How sure: the error of a
sample near the crossing, carried over by the slope of the flank, and the error of drawing a straight line between
samples, added in quadrature. The second is ``cadence / sqrt(12)`` when the flank falls between two samples, and
shrinks in proportion to the number of samples on it.

*Gauss-Hermite*: the edge of the paper, one width before the peak of a Gauss-Hermite curve fitted to a light curve:
Canizares et al. 2024, A&A 684, A182, doi:10.1051/0004-6361/202347747; the curve is that of van der Marel & Franx 1993,
ApJ 407, 525, doi:10.1086/172534. The published fit has no bounds, one start and no error; here the width is positive,
the skewness is bounded, several starts are tried, and the covariance of the fit gives the error of the edge. It lies
before the half-rise of simulated bursts, by 10 s and more at 0.5 MHz, and by how much depends on the cadence and the
window; it breaks when a second burst stands in the decay. It is kept to compare with the paper, not as the default.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d
from scipy.optimize import OptimizeResult, least_squares

from bella.units import FloatArray

NO_SAMPLES, NO_SIGNAL, NO_FLANK, NO_DECAY, GAP = "no_samples", "no_signal", "no_flank", "no_decay", "gap_in_flank"
SATURATED, EDGES_DISAGREE = "saturated", "edges_disagree"
FIT_FAILED, PEAK_OUTSIDE = "fit_failed", "peak_outside"
"""Why a channel has no edge; what each means stands in :data:`bella.flags.EDGE_FLAGS`."""

LEVEL = 0.5
"""Fraction of the maximum power at which a flank is timed."""

FLUX_SCATTER = 0.05
"""Typical fractional scatter of a sample of Wind and STEREO one-minute spectra, beside the noise before the burst."""

QUIET_SAMPLES = 4
"""From so few samples before the flank on, their scatter is taken as the noise."""

GAP_CADENCES = 1.5
"""Samples around the crossing that lie further apart than this many records leave the flank unknown."""

QUALIFIES = 0.6
"""A maximum counts from this share of the highest on."""

DIP_SIGMAS = 3.5
SMALLEST_DIP = 0.12
"""A maximum is over when the power has fallen below it by so much: in its noise, and as a share of it."""

RISE_SAMPLES = 3
"""With this many samples or more on the rise, three of them are averaged first."""

FLAT_SAMPLES, FLAT_RISES, FLAT_SHARE = 3, 0.5, 1e-3
"""A light curve that stays within such a share of its maximum for so many samples and half widths of the rise has been
cut off. The share is below any scatter, and above what the background, which is taken away, changes meanwhile.
"""

CEILING_CHANNELS, CEILING_RATIO, CEILING_SHARE = 3, 2.0, 0.05
"""With so many channels cut off, those within such a ratio of one in frequency are cut off too where they reach its
level within such a share: too short for their cadence, their flat maxima are one or two samples.
"""

SHORT, PAIRED, PAIRED_CHANNELS, NEAREST_CHANNELS, PAIRED_SHARE = 2.0, 0.8, 5, 5, 0.4
"""A channel with fewer samples on the rise than the first number is too short to show that it is cut off; with more
than the second it can have two equal samples at its maximum, which 0.01 of those that are not cut off have (14 of 1429
channels, recorded and simulated). Where so many of a spacecraft have, short channels are cut off for which such a share
of so many nearest in frequency has.
"""

WIDTHS_BEFORE_PEAK = 1.0
C0, C1, C2, C3, C4 = math.sqrt(6) / 4, -math.sqrt(3), -math.sqrt(6), 2 * math.sqrt(3) / 3, math.sqrt(6) / 3
"""Coefficients of the Hermite polynomials (van der Marel & Franx 1993)."""

PARAMETERS = 6
WIDEST_H3, WIDEST_H4 = 0.4, 0.3
START_WIDTHS = (1.0, 2.5, 6.0)
"""Widths to start from, in spacings of the samples."""

DIFFERENCE = 1e-5
FARTHEST_WIDTHS = 6.0
NEGLIGIBLE = 1e-9


class Edge(NamedTuple):
    """Where a light curve rises."""

    arrival_s: float
    """Seconds on the time axis of the light curve; NaN without an edge."""
    sigma_s: float
    """Standard deviation, s; NaN without an edge."""
    flag: str
    """Empty, or why there is no edge."""


def no_edge(reason: str) -> Edge:
    """Edge of a light curve that has none.

    Parameters
    ----------
    reason : str
        A name of :data:`bella.flags.EDGE_FLAGS`.

    Returns
    -------
    Edge
        Time and standard deviation NaN.
    """
    return Edge(math.nan, math.nan, reason)


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


def first_maximum(power: FloatArray, samples_on_rise: float, scatter: float = FLUX_SCATTER) -> int:
    """First maximum that is high enough and followed by a significant dip, else the highest sample.

    Parameters
    ----------
    power : numpy.ndarray, shape (N,)
        Power above background in any unit, all finite, N at least one.
    samples_on_rise : float
        Number of samples in the half width of the rise.
    scatter : float
        Standard deviation of a sample as a share of its power.

    Returns
    -------
    int
        The highest sample up to where the maximum is over.
    """
    width = 3 if samples_on_rise >= RISE_SAMPLES else 1
    smooth = uniform_filter1d(power, width, mode="nearest")
    highest = np.maximum.accumulate(smooth)
    noise = np.hypot(quiet_noise(power, float(power.max())), scatter * highest) / np.sqrt(width)
    dip = np.maximum(DIP_SIGMAS * noise, SMALLEST_DIP * highest)
    over = np.flatnonzero((highest >= QUALIFIES * highest[-1]) & (highest - smooth >= dip))
    stop = int(over[0]) if over.size else power.size
    return int(power[: max(stop, 1)].argmax())


def is_cut_off(time_s: FloatArray, power: FloatArray, top: int, rise_s: float) -> bool:
    """Whether a receiver was saturated: the light curve is flat about its maximum.

    Parameters
    ----------
    time_s, power : numpy.ndarray, shape (N,)
        All finite.
    top : int
        The maximum.
    rise_s : float
        Half width of the rise.
    """
    other = np.flatnonzero(np.abs(power - power[top]) > FLAT_SHARE * power[top])
    place = int(np.searchsorted(other, top))
    begin, end = np.concatenate([[-1], other, [power.size]])[place : place + 2]
    flat_s = time_s[begin + 1 : end]
    return bool(flat_s.size >= FLAT_SAMPLES and flat_s[-1] - flat_s[0] >= FLAT_RISES * rise_s)


def cut_off_with_others(
    frequency_mhz: FloatArray, power: FloatArray, samples_on_rise: FloatArray, flag: npt.NDArray[np.object_]
) -> npt.NDArray[np.bool_]:
    """Channels of a spacecraft that were cut off, by what those beside them show.

    Parameters
    ----------
    frequency_mhz, samples_on_rise : numpy.ndarray, shape (C,)
        Ascending frequencies, and the half width of the rise in samples.
    power : numpy.ndarray, shape (N, C)
        NaN where there are no data.
    flag : numpy.ndarray of str, shape (C,)
        ``saturated`` where :func:`is_cut_off` holds, empty where nothing is wrong.

    Returns
    -------
    numpy.ndarray of bool, shape (C,)
        Those that are flagged ``saturated`` already are among them.
    """
    cut_off = flag == SATURATED
    known = np.nan_to_num(power)
    highest, top = known.max(axis=0), known.argmax(axis=0)
    padded = np.pad(known, ((1, 1), (0, 0)))
    column = np.arange(top.size)
    beside = np.maximum(padded[top, column], padded[top + 2, column])
    telling = (cut_off | (flag == "")) & (samples_on_rise >= PAIRED) & (samples_on_rise < SHORT)
    paired = telling & (beside >= (1 - FLAT_SHARE) * highest)
    if paired.sum() >= PAIRED_CHANNELS:
        apart = np.abs(np.subtract.outer(np.log(frequency_mhz), np.log(frequency_mhz[telling])))
        nearest = np.argsort(apart, axis=1, kind="stable")[:, :NEAREST_CHANNELS]
        cut_off = cut_off | ((samples_on_rise < SHORT) & (paired[telling][nearest].mean(axis=1) >= PAIRED_SHARE))
    if cut_off.sum() < CEILING_CHANNELS:
        return np.asarray(cut_off)
    at = np.log(frequency_mhz[cut_off])
    away = np.abs(np.log(frequency_mhz)[:, None] - at).min(axis=1)
    ceiling = np.interp(np.log(frequency_mhz), at, highest[cut_off])
    return np.asarray(cut_off | ((away <= np.log(CEILING_RATIO)) & (np.abs(highest / ceiling - 1) <= CEILING_SHARE)))


def gauss_hermite(time_s: FloatArray, parameters: npt.ArrayLike) -> FloatArray:
    """Gauss-Hermite curve.

    Parameters
    ----------
    time_s : numpy.ndarray
        Any shape, s.
    parameters : array_like, shape (6,)
        Height of the Gaussian over the background; its centre, s, and width, s; skewness h3; peakedness h4; background.

    Returns
    -------
    numpy.ndarray
        The shape of `time_s`.
    """
    height, centre_s, width_s, h3, h4, background = np.asarray(parameters, dtype=np.float64)
    x = (np.asarray(time_s) - centre_s) / width_s
    shape = 1 + h3 * x * (C3 * x**2 + C1) + h4 * (C0 + C2 * x**2 + C4 * x**4)
    return np.asarray(height * np.exp(-0.5 * x**2) * shape + background)


def mode_widths(h3: float, h4: float) -> float:
    """Where the curve is highest, in widths from its centre.

    Parameters
    ----------
    h3, h4 : float

    Returns
    -------
    float
        The root of the derivative that belongs to the highest maximum.
    """
    # a tiny leading coefficient spoils all roots of the companion matrix
    h3, h4 = (0.0 if abs(h) < NEGLIGIBLE else h for h in (h3, h4))
    derivative = [
        C4 * h4,
        C3 * h3,
        h4 * (C2 - 4 * C4),
        h3 * (C1 - 3 * C3),
        1 + h4 * (C0 - 2 * C2),
        -C1 * h3,
    ]
    roots = np.roots(derivative)
    # a small h4 puts roots far out, where the exponential leaves nothing
    real = roots[(np.abs(roots.imag) < 1e-9) & (np.abs(roots.real) < FARTHEST_WIDTHS)].real
    return float(real[np.argmax(gauss_hermite(real, [1.0, 0.0, 1.0, h3, h4, 0.0]))])


def gauss_hermite_edge(time_s: FloatArray, power: FloatArray) -> Edge:
    """Time one width before the peak of the fitted curve.

    Parameters
    ----------
    time_s : numpy.ndarray, shape (N,)
        Times of the samples, ascending, s.
    power : numpy.ndarray, shape (N,)
        Power above background in any unit; NaN where there are no data.

    Returns
    -------
    Edge
        With a reason and NaN when there is none: ``no_samples`` (not more than the six parameters), ``no_signal``,
        ``fit_failed``, ``peak_outside`` (the fitted peak or edge is outside the samples).
    """
    known = np.isfinite(power)
    time, height = time_s[known], power[known]
    if time.size <= PARAMETERS:
        return no_edge(NO_SAMPLES)
    if not height.max() > 0:
        return no_edge(NO_SIGNAL)
    fit = _best_fit(time, height / height.max())
    if fit is None:
        return no_edge(FIT_FAILED)
    arrival = _edge_s(fit.x)
    mode = arrival + WIDTHS_BEFORE_PEAK * fit.x[2]
    if not time[0] <= arrival < mode <= time[-1]:
        return no_edge(PEAK_OUTSIDE)
    sigma = _edge_sigma_s(fit, time.size)
    return Edge(arrival, sigma, "") if math.isfinite(sigma) else no_edge(FIT_FAILED)


def _edge_s(parameters: FloatArray) -> float:
    _, centre, width, h3, h4, _ = parameters
    return float(centre + width * (mode_widths(h3, h4) - WIDTHS_BEFORE_PEAK))


def _best_fit(time: FloatArray, height: FloatArray) -> OptimizeResult | None:
    """The fit of least residual from several starts; the samples weigh alike, as in the paper."""
    top, spacing, span = int(height.argmax()), float(np.median(np.diff(time))), float(time[-1] - time[0])
    low = [0.0, time[0], 0.25 * spacing, -WIDEST_H3, -WIDEST_H4, -1.0]
    high = [10.0, time[-1], span, WIDEST_H3, WIDEST_H4, 1.0]
    scale = [1.0, spacing, spacing, 0.1, 0.1, 0.1]

    def _residual(p: FloatArray) -> FloatArray:
        return gauss_hermite(time, p) - height

    fits = []
    for width in START_WIDTHS:
        start = np.clip([1.0, time[top], width * spacing, 0.1, 0.0, 0.0], low, high)
        fits.append(least_squares(_residual, start, bounds=(low, high), x_scale=scale))
    return min((fit for fit in fits if fit.success), key=lambda fit: float(fit.cost), default=None)


def _edge_sigma_s(fit: OptimizeResult, samples: int) -> float:
    """Standard deviation of the edge from the scatter of the residuals and the slope of the curve."""
    scatter = 2 * fit.cost / (samples - PARAMETERS)
    slope = np.empty(PARAMETERS)
    for i in range(PARAMETERS):
        step = np.zeros(PARAMETERS)
        step[i] = DIFFERENCE * max(1.0, abs(fit.x[i]))
        slope[i] = (_edge_s(fit.x + step) - _edge_s(fit.x - step)) / (2 * step[i])
    variance = scatter * slope @ np.linalg.pinv(fit.jac.T @ fit.jac) @ slope
    return math.sqrt(variance) if variance > 0 else math.nan

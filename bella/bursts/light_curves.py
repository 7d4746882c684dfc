"""Light curves of a burst, the rise that they show, and which of their samples a profile is fitted to."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bella.bursts.edges import (
    GAP,
    GAP_CADENCES,
    NO_FLANK,
    NO_SAMPLES,
    NO_SIGNAL,
    SATURATED,
    cut_off_with_others,
    first_maximum,
    half_maximum_edge,
    is_cut_off,
    quiet_noise,
    spacing_s,
)
from bella.heliosphere.scattering import rise_s
from bella.units import FloatArray

BoolArray = npt.NDArray[np.bool_]

FEWEST_SPACECRAFT, FEWEST_CHANNELS = 3, 4
"""Of a burst, and of each spacecraft, for a profile: two spacecraft leave width and time of each too free."""

START_RISES, START_CADENCES = 2.0, 0.7
"""Standard deviation of the arrival time about the half-maximum, in rise times and in cadences."""

BEFORE_RISES, AFTER_RISES, BEFORE_CADENCES, AFTER_CADENCES = 6.0, 6.0, 2.5, 2.0
"""Samples that are fitted: so many rise times and records before and after the first guess at most."""

FALLEN = 0.8
"""A light curve is fitted up to the sample in which it has fallen to this share of its maximum."""

FINEST_RISES = 0.2
"""Samples that are closer than this share of the rise are averaged."""

SIGNAL_SIGMAS = 7.0
"""Least maximum over the noise before the burst."""

FEWEST_SAMPLES = 5

QUIET = 0.25
"""Share of the maximum below which a light curve must have begun.
"""

LEAST_SCATTER, USUAL_SCATTER, LARGEST_SCATTER = 0.02, 0.04, 0.15
"""Scatter of a sample of a receiver as a share of its power: at least, where it cannot be measured, and at most."""

FLANK_RISES = 1.0
"""No sample may be missing so many rise times about the arrival."""

IN_LINE = 0.5
"""A channel starts from its own half-maximum where that lies this near the line through the next two channels on one
side, or one on each, in units of the rise and the cadence: a wrong one does not."""

DECAY_AT_1_MHZ_S, DECAY_SLOPE = 72.0, -0.97
"""Decay time of bursts, Kontar et al. 2019, ApJ 884, 122, doi:10.3847/1538-4357/ab40bb."""

QUARTERS_TO_RISE = 0.77
"""Time from a quarter to three quarters of the maximum over the half width, of a Gaussian."""

LEVEL_SD, TILT_SD, RISE_SCATTER = 0.6, 0.25, 0.25
"""Of ln rise of a burst about that of a typical one, its slope, and single channels about both."""


@dataclass(frozen=True)
class LightCurves:
    """Light curves of a burst at one spacecraft.

    Attributes
    ----------
    frequency_mhz : ndarray, shape (C,)
        Ascending.
    time_s : ndarray, shape (N, C)
        Middles of the samples, ascending, s after a time that all spacecraft share.
    power : ndarray, shape (N, C)
        Power above background; NaN where there is none or it belongs to something else.
    background : float
        Power of the background in the same unit: 1, or 0 where it is not known.
    integration_s : ndarray, shape (C,)
        Time that one visit averages over.
    apart_s : ndarray, shape (N, C)
        Time between the two visits that a sample is the mean of; 0 where there was one.
    """

    observatory: str
    frequency_mhz: FloatArray
    time_s: FloatArray
    power: FloatArray
    background: float
    cadence_s: float
    integration_s: FloatArray
    apart_s: FloatArray


@dataclass
class Craft:
    """Samples of one spacecraft, padded to the same number in each channel."""

    index: int
    light: LightCurves
    frequency_mhz: FloatArray
    time_s: FloatArray
    power: FloatArray
    integration_s: FloatArray
    apart_s: FloatArray
    known: BoolArray
    noise: FloatArray
    scatter: FloatArray
    background: FloatArray
    start_s: FloatArray
    start_sd_s: FloatArray
    log_width: FloatArray
    rows: npt.NDArray[np.intp]
    arrival_s: FloatArray
    height: FloatArray
    base: FloatArray
    weight: FloatArray
    variance: FloatArray
    spacing_s: FloatArray
    shape_error: float = 0.0
    decay_error: float = 0.0
    excess: float = 1.0


@dataclass
class Start:
    """First guesses of one spacecraft."""

    half_s: FloatArray
    peak: npt.NDArray[np.intp]
    flag: npt.NDArray[np.object_]
    rise_s: FloatArray
    curve_s: FloatArray


def decay_s(frequency_mhz: FloatArray) -> FloatArray:
    """Decay time of a typical burst, 72 (f / MHz)^-0.97 s, same shape as the frequencies."""
    return np.asarray(DECAY_AT_1_MHZ_S * np.asarray(frequency_mhz, dtype=np.float64) ** DECAY_SLOPE)


@dataclass(frozen=True)
class RiseOfBurst:
    """Half width of the rise of one burst: that of a typical burst, with its own level and slope."""

    level: float = 0.0
    slope: float = 0.0

    def rise_s(self, frequency_mhz: FloatArray) -> FloatArray:
        """Half width of the rise at frequencies, s."""
        return np.asarray(rise_s(frequency_mhz) * np.exp(self.level + self.slope * np.log(frequency_mhz)))


def own_rise(lights: Sequence[LightCurves]) -> RiseOfBurst:
    """Half width of the rise of a burst, by the time from a quarter to three quarters of the maximum.

    Returns
    -------
    RiseOfBurst
        From the channels that resolve their rise; that of a typical burst where none does.
    """
    log_f, ratio = [], []
    for light in lights:
        for j, frequency in enumerate(light.frequency_mhz):
            known = np.isfinite(light.power[:, j])
            time, power = light.time_s[known, j], light.power[known, j]
            if time.size < FEWEST_SAMPLES:
                continue
            spacing = spacing_s(time, light.cadence_s)
            top = first_maximum(power, float(rise_s(frequency)) / spacing)
            if not power[top] > SIGNAL_SIGMAS * quiet_noise(power, float(power[top])) or top in {0, power.size - 1}:
                continue
            quarter, three = (_crossing_s(time[: top + 1], power[: top + 1], share) for share in (0.25, 0.75))
            width = (three - quarter) / QUARTERS_TO_RISE
            smear = max(float(light.integration_s[j]), spacing)
            if width > 1.5 * smear:
                log_f.append(np.log(frequency))
                ratio.append(0.5 * np.log(width**2 - 0.4 * smear**2) - np.log(float(rise_s(frequency))))
    if not log_f:
        return RiseOfBurst()
    terms = np.stack([np.ones(len(log_f)), np.array(log_f)], axis=-1)
    value, weight = np.array(ratio), np.ones(len(log_f))
    prior = np.diag([LEVEL_SD**-2, TILT_SD**-2])
    coefficients = np.array([np.median(value), 0.0])
    for _ in range(20):
        weight = 1.0 / (1.0 + ((value - terms @ coefficients) / RISE_SCATTER) ** 2)
        normal = terms.T * weight / RISE_SCATTER**2
        coefficients = np.linalg.solve(normal @ terms + prior, normal @ value)
    return RiseOfBurst(float(coefficients[0]), float(coefficients[1]))


def _crossing_s(time_s: FloatArray, power: FloatArray, share: float) -> float:
    """Last time before the end at which a light curve crosses a share of its last sample."""
    level = share * power[-1]
    below = np.flatnonzero(power[:-1] < level)
    if below.size == 0:
        return float("nan")
    i = int(below[-1])
    return float(time_s[i] + (level - power[i]) / (power[i + 1] - power[i]) * (time_s[i + 1] - time_s[i]))


def first_guess(light: LightCurves, rises: RiseOfBurst) -> Start:
    """Half-maximum of each channel, and a curve through them from which all channels start.

    A robust curve, but the half-maximum itself where the channels beside it agree: times of a source that passes close
    by a receiver, or whose density waves, bend by more than a curve of few terms does.
    """
    number = light.frequency_mhz.size
    rise = rises.rise_s(light.frequency_mhz)
    half, flag, peaks = np.full(number, np.nan), np.full(number, "", dtype=object), np.zeros(number, dtype=np.intp)
    for j in range(number):
        known = np.flatnonzero(np.isfinite(light.power[:, j]))
        time, power = light.time_s[known, j], light.power[known, j]
        if time.size < FEWEST_SAMPLES:
            flag[j] = NO_SAMPLES
            continue
        spacing = spacing_s(time, light.cadence_s)
        top = first_maximum(power, float(rise[j]) / spacing)
        peaks[j] = known[top]
        edge = half_maximum_edge(time, power, spacing, float(time[top]))
        flag[j], half[j] = edge.flag, edge.arrival_s
        if not flag[j] and power[top] < SIGNAL_SIGMAS * quiet_noise(power, float(power[top])):
            flag[j] = NO_SIGNAL
        if not flag[j] and is_cut_off(time, power, top, float(rise[j])):
            flag[j] = SATURATED
    flag[cut_off_with_others(light.frequency_mhz, light.power, rise / light.cadence_s, flag)] = SATURATED
    scale_s, good = np.hypot(rise, light.cadence_s), np.isfinite(half) & (flag == "")
    curve_s = _robust_curve(light.frequency_mhz, half, good, scale_s)
    known = np.flatnonzero(good)
    own = known[_in_line(np.log(light.frequency_mhz[known]), (half - curve_s)[known], IN_LINE * scale_s[known])]
    curve_s[own] = half[own]
    return Start(half, peaks, flag, rise, curve_s)


def _robust_curve(
    frequency_mhz: FloatArray, half_s: FloatArray, good: npt.NDArray[np.bool_], scale_s: FloatArray
) -> FloatArray:
    """Curve a + b / f + c / f^2 through the half-maxima, with Cauchy weights; NaN where fewer than four are known."""
    if good.sum() < FEWEST_CHANNELS:
        return np.full(half_s.shape, np.nan)
    x = 1.0 / frequency_mhz
    terms = np.stack([np.ones_like(x), x, x**2], axis=-1)
    middle = np.median(half_s[good])
    ridge = np.diag([1e-9, 1e-7, 1e-4])
    weight = np.ones(int(good.sum()))
    scale = 0.5 * scale_s[good]
    coefficients: FloatArray = np.zeros(3)
    for _ in range(15):
        normal = terms[good].T * (weight / scale**2)
        solved = np.linalg.solve(normal @ terms[good] + ridge, normal @ (half_s[good] - middle))
        coefficients = np.asarray(solved, dtype=np.float64)
        away = (half_s[good] - middle - terms[good] @ coefficients) / scale
        weight = 1.0 / (1.0 + away**2)
    return np.asarray(middle + terms @ coefficients)


def _in_line(x: FloatArray, y: FloatArray, near: FloatArray) -> npt.NDArray[np.bool_]:
    """Which points lie near the line through the next two on the left, on the right, or one on each side."""
    found = np.zeros(x.size, dtype=bool)
    for one, other in ((-2, -1), (-1, 1), (1, 2)):
        i = np.arange(max(0, -one), x.size - max(0, other))
        share = (x[i] - x[i + one]) / (x[i + other] - x[i + one])
        line = (1.0 - share) * y[i + one] + share * y[i + other]
        found[i] |= np.abs(line - y[i]) <= near[i]
    return found


def fitted_samples(light: LightCurves, start: Start, index: int) -> Craft | None:
    """Samples to fit of the channels of a spacecraft; None where too few channels are good."""
    kept: list[tuple[int, FloatArray, FloatArray, FloatArray, float, float, int]] = []
    scatter = _receiver_scatter(light, start)
    for j in range(light.frequency_mhz.size):
        if start.flag[j] or not np.isfinite(start.curve_s[j]):
            start.flag[j] = start.flag[j] or NO_FLANK
            continue
        chosen = _channel_samples(light, start, j)
        if isinstance(chosen, str):
            start.flag[j] = chosen
        else:
            kept.append((j, *chosen))
    if len(kept) < FEWEST_CHANNELS:
        return None
    most = max(one[1].size for one in kept)
    shape = (len(kept), most)
    time, power, apart, known = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=bool)
    for row, (_, times, powers, aparts, *_) in enumerate(kept):
        time[row, : times.size], power[row, : times.size], apart[row, : times.size] = times, powers, aparts
        time[row, times.size :] = times[-1]
        known[row, : times.size] = True
    rows = np.array([one[0] for one in kept])
    height = np.array([one[2].max() for one in kept])
    noise = np.array([one[4] for one in kept])
    frequency, rise = light.frequency_mhz[rows], start.rise_s[rows]
    return Craft(
        index=index,
        light=light,
        frequency_mhz=frequency,
        time_s=time,
        power=power / height[:, None],
        integration_s=np.maximum(np.array([one[5] for one in kept]), 0.05 * rise),
        apart_s=apart,
        known=known,
        noise=noise / height,
        scatter=scatter / np.sqrt(np.array([one[6] for one in kept]))[:, None],
        background=light.background / height,
        start_s=start.curve_s[rows],
        start_sd_s=START_RISES * rise + START_CADENCES * light.cadence_s,
        log_width=np.log(rise),
        rows=rows,
        arrival_s=start.curve_s[rows].copy(),
        height=np.ones(rows.size),
        base=np.zeros(rows.size),
        weight=np.zeros(shape),
        variance=np.ones(shape),
        spacing_s=np.array([np.median(np.diff(one[1])) for one in kept]),
    )


def _receiver_scatter(light: LightCurves, start: Start) -> float:
    """Scatter of samples about the mean of their neighbours near the maximum, where they resolve the burst."""
    found = []
    for j in np.flatnonzero(start.flag == ""):
        known = np.isfinite(light.power[:, j])
        power = light.power[known, j]
        if 4 * light.cadence_s > start.rise_s[j] or power.size < 5:
            continue
        middle = power[1:-1]
        high = middle > 0.5 * power.max()
        found.append((middle - 0.5 * (power[2:] + power[:-2]))[high] / middle[high])
    away = np.concatenate(found) if found else np.empty(0)
    if away.size < 10:
        return USUAL_SCATTER
    return float(np.clip(1.4826 * np.median(np.abs(away)) / np.sqrt(1.5), LEAST_SCATTER, LARGEST_SCATTER))


def _channel_samples(
    light: LightCurves, start: Start, j: int
) -> tuple[FloatArray, FloatArray, FloatArray, float, float, int] | str:
    """Times, powers, times between visits, noise, integration and samples averaged of a channel, or a flag."""
    known = np.flatnonzero(np.isfinite(light.power[:, j]))
    time, power, apart = light.time_s[known, j], light.power[known, j], light.apart_s[known, j]
    rise, cadence = float(start.rise_s[j]), spacing_s(time, light.cadence_s)
    middle = float(start.curve_s[j])
    if abs(start.half_s[j] - middle) < rise + cadence:
        middle = float(start.half_s[j])
    integration = float(light.integration_s[j])
    inside = time >= middle - BEFORE_RISES * rise - BEFORE_CADENCES * cadence
    inside &= time <= middle + AFTER_RISES * rise + AFTER_CADENCES * cadence
    time, power, apart = time[inside], power[inside], apart[inside]
    if time.size < FEWEST_SAMPLES:
        return NO_SAMPLES
    near = np.abs(time - middle) <= FLANK_RISES * rise + cadence
    if near.sum() < 2 or np.diff(time)[near[1:] & near[:-1]].max(initial=0.0) > GAP_CADENCES * cadence:
        return GAP
    together = int(FINEST_RISES * rise // cadence)
    if together > 1:
        whole = time.size // together * together
        time, power, apart = (one[-whole:].reshape(-1, together).mean(axis=1) for one in (time, power, apart))
        integration += (together - 1) * cadence
        cadence *= together
    top = first_maximum(power, rise / cadence)
    early = power[time < middle - 2.5 * rise - 0.5 * cadence - 0.5 * integration]
    noise = float(1.4826 * np.median(np.abs(early - np.median(early)))) if early.size >= 4 else 0.0
    noise = max(noise, 0.5 * quiet_noise(power, float(power[top])), light.background * 1e-3)
    if power[top] < SIGNAL_SIGMAS * noise:
        return NO_SIGNAL
    end = _end(power, top, noise)
    if end < FEWEST_SAMPLES or power[:top].min(initial=np.inf) > QUIET * power[top]:
        return NO_SAMPLES
    return time[:end], power[:end], apart[:end], noise, integration, max(together, 1)


def _end(power: FloatArray, top: int, noise: float) -> int:
    """Where the fit of a light curve ends: it has fallen, or rises again."""
    after = power[top:]
    lowest = np.minimum.accumulate(after)
    over = (after < FALLEN * power[top]) | (after - lowest > 0.12 * power[top] + 4 * noise)
    stop = int(np.argmax(over)) if over.any() else after.size - 1
    return top + stop + 1

"""Light curves of bursts at one frequency: several published families, and how rise and decay vary with frequency.

A family is a function of time and of one shape parameter, which stands for the decay time over the half width of the
rise. Every curve here has its maximum 1 and has risen to one half at time 0, whatever its family.

The rise and decay laws are the simulator's own. None of their numbers is used by detection, timing or tracks, and none
of those is used here: a method must not be judged on the laws that it assumes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.special import erfcx

from bella.exceptions import InputError
from bella.units import FloatArray

IntArray = npt.NDArray[np.intp]
Shape = Callable[[FloatArray, FloatArray], FloatArray]

SHAPES = 160
"""Values of the shape parameter at which the landmarks of a family are tabulated."""

BISECTIONS = 70
GRID_SCALE, GRID_STEP, GRID_FIRST, GRID_LAST = 2.0, 0.02, -2.7, 5.3
"""Times, in half widths of the rise, at which a curve is tabulated: 2 sinh(s) from s = -2.7 (-15) to 5.3 (200)."""

FAINT = 1e-4
"""A curve is over where it has fallen to this share of its maximum."""

REFERENCE_MHZ = 0.5
RISE_S, RISE_SLOPE, RISE_BEND_SD = (30.0, 115.0), (-1.25, -0.75), 0.04
"""Range of the half width of the rise at 0.5 MHz and of its slope, and scatter of its bend.

The bursts of 2012-06-07 and 2020-07-21 rise in 186, 90, 37, 11 s and 170, 71, 30, 11 s at 0.2, 0.5, 1 and 2 MHz. The
laws extrapolated from higher frequencies are 2.4 to 2.6 times faster at 0.2 MHz: the range holds both.
"""

DECAY_S, DECAY_SLOPE = (105.0, 225.0), (-1.08, -0.92)
"""Range of the decay time at 0.5 MHz and of its slope.

193 s and -0.95 as of Alvarez & Haddock 1973, Sol. Phys. 30, 175, doi:10.1007/BF00156186; shorter times and slopes of
-0.97 and -1.00 +- 0.01 were measured since (Kontar et al. 2019, ApJ 884, 122, doi:10.3847/1538-4357/ab40bb; Vecchio et
al. 2024, ApJL 974, L18). Bursts scatter about the laws.
"""

GRID: FloatArray = GRID_SCALE * np.sinh(np.arange(GRID_FIRST, GRID_LAST, GRID_STEP))
_MIDDLE: FloatArray = 0.5 * (GRID[1:] + GRID[:-1])


@dataclass(frozen=True)
class Family:
    """A family of light curves.

    Attributes
    ----------
    shape : callable
        Height at a time, in the unit of the family, for a shape parameter; unimodal.
    parameters : tuple of float
        Lowest and highest shape parameter.
    span : callable
        Times between which the curve rises and falls to 1/e, for a shape parameter.
    """

    source: str
    shape: Shape
    parameters: tuple[float, float]
    span: Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def _norris(x: FloatArray, q: FloatArray) -> FloatArray:
    """exp(-a/t - t/b) with t = x sqrt(a b) and q = sqrt(a/b)."""
    late = np.maximum(x, 1e-6)
    return np.where(x > 0, np.exp(-q * (late + 1.0 / late - 2.0)), 0.0)


def _gauss_exponential(x: FloatArray, q: FloatArray) -> FloatArray:
    return np.where(x < 0, np.exp(-0.5 * np.minimum(x, 0.0) ** 2), np.exp(-np.maximum(x, 0.0) / q))


def _bi_gauss(x: FloatArray, q: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-0.5 * np.where(x < 0, x, x / q) ** 2))


def _emg(x: FloatArray, q: FloatArray) -> FloatArray:
    """Gaussian of standard deviation 1 convolved with an exponential decay of time constant q."""
    argument = (1.0 / q - x) / math.sqrt(2.0)
    # far behind the Gaussian erfcx overflows where the product is a plain exponential
    early = np.exp(-0.5 * x**2) * erfcx(np.maximum(argument, -5.0))
    late = 2.0 * np.exp(np.minimum(0.5 / q**2 - x / q, 0.0))
    return np.where(argument > -5.0, early, late)


def _gamma(x: FloatArray, q: FloatArray) -> FloatArray:
    late = np.maximum(x, 1e-12) / q
    return np.where(x > 0, np.exp(q * (np.log(late) - late + 1.0)), 0.0)


def _logistic_exponential(x: FloatArray, q: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-np.logaddexp(0.0, -x) - x / q))


def _log_normal(x: FloatArray, q: FloatArray) -> FloatArray:
    return np.where(x > 0, np.exp(-0.5 * (np.log(np.maximum(x, 1e-12)) / q) ** 2), 0.0)


FAMILIES = {
    "norris": Family(
        "exp(-a/t - t/b); Norris et al. 2005, ApJ 627, 324, doi:10.1086/430294",
        _norris,
        (0.03, 20.0),
        lambda q: (np.full(q.shape, 1e-3), 3.0 + 3.0 / q),
    ),
    "gauss_exponential": Family(
        "Gaussian rise, exponential decay; the form commonly fitted since Evans et al. 1973, Sol. Phys. 31, 501, "
        "doi:10.1007/BF00152825",
        _gauss_exponential,
        (0.8, 20.0),
        lambda q: (np.full(q.shape, -6.0), 2.0 * q),
    ),
    "bi_gauss": Family(
        "two half Gaussians; Reid & Kontar 2018, A&A 614, A69, doi:10.1051/0004-6361/201732298",
        _bi_gauss,
        (0.8, 8.0),
        lambda q: (np.full(q.shape, -6.0), 3.0 * q),
    ),
    "emg": Family(
        "Gaussian convolved with an exponential decay; Grushka 1972, Anal. Chem. 44, 1733, doi:10.1021/ac60319a011",
        _emg,
        (0.2, 20.0),
        lambda q: (np.full(q.shape, -6.0), 8.0 + 6.0 * q),
    ),
    "gamma": Family(
        "t^q exp(-t): scattered waves that have to diffuse; Williamson 1972, MNRAS 157, 55, doi:10.1093/mnras/157.1.55",
        _gamma,
        (0.7, 30.0),
        lambda q: (np.full(q.shape, 1e-6), 3.0 * q + 6.0 * np.sqrt(q)),
    ),
    "logistic_exponential": Family(
        "logistic rise, exponential decay: an exponentially growing source that saturates",
        _logistic_exponential,
        (1.5, 40.0),
        lambda q: (np.full(q.shape, -12.0), 12.0 + 4.0 * q),
    ),
    "log_normal": Family(
        "log-normal pulse, the one family that is not log-concave",
        _log_normal,
        (0.1, 0.95),
        lambda q: (np.exp(-6.0 * q), np.exp(3.0 * q)),
    ),
}
"""Families by name."""


@dataclass(frozen=True)
class PulseLaw:
    """Family of the light curves of a burst, and how fast they rise and decay at each frequency.

    Attributes
    ----------
    family : str
        A name of `FAMILIES`.
    rise_s : float
        Half width of the rise at 0.5 MHz, from half of the maximum to the maximum, s.
    rise_slope : float
        Its logarithmic slope with frequency there.
    rise_bend : float
        Half of the change of that slope with ln f.
    decay_s : float
        Time from the maximum to 1/e of it at 0.5 MHz, s.
    decay_slope : float
        Its logarithmic slope with frequency.
    """

    family: str = "norris"
    rise_s: float = 64.0
    rise_slope: float = -1.0
    rise_bend: float = 0.0
    decay_s: float = 150.0
    decay_slope: float = -1.02

    def __post_init__(self) -> None:
        if self.family not in FAMILIES:
            raise InputError(f"light curve {self.family!r} is not known; choose one of {', '.join(FAMILIES)}")
        for name in ("rise_s", "decay_s"):
            if not 0 < getattr(self, name) < np.inf:
                raise InputError(f"{name} is {getattr(self, name):g}; give a number of seconds above zero")

    def rises_s(self, frequency_mhz: FloatArray) -> FloatArray:
        """Half width of the rise at each frequency, s."""
        x = np.log(np.asarray(frequency_mhz, dtype=np.float64) / REFERENCE_MHZ)
        return np.asarray(self.rise_s * np.exp(self.rise_slope * x + self.rise_bend * x**2))

    def decays_s(self, frequency_mhz: FloatArray) -> FloatArray:
        """Decay time at each frequency, s; as near to it as the family allows with its rise."""
        wanted = self.decay_s * (np.asarray(frequency_mhz, dtype=np.float64) / REFERENCE_MHZ) ** self.decay_slope
        rise = self.rises_s(frequency_mhz)
        return np.asarray(rise * np.clip(wanted / rise, *decay_over_rise(self.family)))

    def curves(self, frequency_mhz: FloatArray) -> "Pulses":
        """Light curves at N frequencies."""
        return pulses(self.family, self.rises_s(frequency_mhz), self.decays_s(frequency_mhz))


def draw_pulse_law(rng: np.random.Generator, family: str | None = None) -> PulseLaw:
    """Draw the light curves of a burst.

    Parameters
    ----------
    family : str, optional
        A name of `FAMILIES`; drawn if none is given.
    """
    return PulseLaw(
        family=family or str(rng.choice(list(FAMILIES))),
        rise_s=float(np.exp(rng.uniform(*np.log(RISE_S)))),
        rise_slope=float(rng.uniform(*RISE_SLOPE)),
        rise_bend=float(RISE_BEND_SD * rng.standard_normal()),
        decay_s=float(np.exp(rng.uniform(*np.log(DECAY_S)))),
        decay_slope=float(rng.uniform(*DECAY_SLOPE)),
    )


@dataclass(frozen=True)
class Pulses:
    """Light curves of N pulses, tabulated.

    Attributes
    ----------
    rise_s : ndarray, shape (N,)
        Half widths of the rise, s.
    height : ndarray, shape (N, M)
        At `GRID` times the half width of the rise.
    integral : ndarray, shape (N, M)
        Of the height up to there, in half widths of the rise.
    """

    rise_s: FloatArray
    height: FloatArray
    integral: FloatArray

    def reach_s(self) -> tuple[FloatArray, FloatArray]:
        """When each pulse begins and is over, after its half-rise, s; shape (N,) each."""
        seen = self.height > FAINT
        first = np.maximum(seen.argmax(axis=1) - 1, 0)
        last = np.minimum(GRID.size - seen[:, ::-1].argmax(axis=1), GRID.size - 1)
        return GRID[first] * self.rise_s, GRID[last] * self.rise_s

    def at(self, pulse: IntArray | int, time_s: FloatArray) -> FloatArray:
        """Height of pulses at times after their half-rise.

        Parameters
        ----------
        pulse : ndarray of int, or int
            Which pulse; any shape.
        time_s : ndarray
            s, the same shape.

        Returns
        -------
        ndarray
            Between 0 and 1, the same shape.
        """
        cell, share, _ = _cells(time_s / self.rise_s[pulse])
        low, high = self.height[pulse, cell], self.height[pulse, cell + 1]
        return np.asarray(low + share * (high - low))

    def mean(self, pulse: IntArray | int, start_s: FloatArray, stop_s: FloatArray) -> FloatArray:
        """Mean of pulses over intervals, as a receiver that integrates measures it.

        Parameters
        ----------
        pulse : ndarray of int, or int
            Which pulse; any shape.
        start_s, stop_s : ndarray
            Ends of the intervals after the half-rise, s; the same shape, stop after start.

        Returns
        -------
        ndarray
            Between 0 and 1, the same shape.
        """
        rise = self.rise_s[pulse]
        return np.asarray(
            (self._upto(pulse, stop_s / rise) - self._upto(pulse, start_s / rise)) * rise / (stop_s - start_s)
        )

    def _upto(self, pulse: IntArray | int, u: FloatArray) -> FloatArray:
        """Integral up to a time by cubic Hermite interpolation: its derivative, the height, is tabulated too."""
        cell, s, width = _cells(u)
        low, high = self.integral[pulse, cell], self.integral[pulse, cell + 1]
        slope_low, slope_high = width * self.height[pulse, cell], width * self.height[pulse, cell + 1]
        rest = 1.0 - s
        return np.asarray(
            rest**2 * ((1.0 + 2.0 * s) * low + s * slope_low) + s**2 * ((3.0 - 2.0 * s) * high - rest * slope_high)
        )


def _cells(u: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Cell of the grid that holds each time, the place in it from 0 to 1, and its width."""
    inside = np.clip(u, GRID[0], GRID[-1])
    cell = ((np.arcsinh(inside / GRID_SCALE) - GRID_FIRST) / GRID_STEP).astype(np.intp)
    cell = np.clip(cell, 0, GRID.size - 2)
    width = GRID[cell + 1] - GRID[cell]
    return cell, np.clip((inside - GRID[cell]) / width, 0.0, 1.0), width


def pulses(family: str, rise_s: FloatArray, decay_s: FloatArray) -> Pulses:
    """Light curves with given rise and decay times.

    Parameters
    ----------
    family : str
        A name of `FAMILIES`.
    rise_s : ndarray, shape (N,)
        Half width of the rise, from half of the maximum to the maximum, s.
    decay_s : ndarray, shape (N,)
        Time from the maximum to 1/e of it, s; the nearest that the family allows is taken.
    """
    marks = _landmarks(family)
    ratio = np.clip(decay_s / rise_s, marks.ratio_ends[0], marks.ratio_ends[1])
    q = np.exp(marks.log_parameter(np.log(ratio)))[:, None]
    half, top = marks.half_rise(np.log(ratio))[:, None], marks.top(np.log(ratio))[:, None]
    shape = FAMILIES[family].shape
    peak = shape(top, q)
    height = shape(half + GRID * (top - half), q) / peak
    middle = shape(half + _MIDDLE * (top - half), q) / peak
    step = np.diff(GRID) * (height[:, :-1] + 4.0 * middle + height[:, 1:]) / 6.0
    return Pulses(np.asarray(rise_s), height, np.concatenate([np.zeros((len(q), 1)), np.cumsum(step, axis=1)], axis=1))


@dataclass(frozen=True)
class _Landmarks:
    """Of a family, as functions of ln of the decay time over the half width of the rise."""

    ratio_ends: tuple[float, float]
    log_parameter: CubicSpline
    half_rise: CubicSpline
    top: CubicSpline


def decay_over_rise(family: str) -> tuple[float, float]:
    """Least and largest decay time over half width of the rise that a family has.

    Parameters
    ----------
    family : str
        A name of `FAMILIES`.
    """
    return _landmarks(family).ratio_ends


@lru_cache(maxsize=len(FAMILIES))
def _landmarks(family: str) -> _Landmarks:
    known = FAMILIES[family]
    q = np.geomspace(*known.parameters, SHAPES)
    first, last = known.span(q)
    top = _highest(known.shape, q, first, last)
    peak = known.shape(top, q)
    half = _crossing(known.shape, q, 0.5 * peak, (first, top))
    fallen = _crossing(known.shape, q, peak / math.e, (last, top))
    ratio = (fallen - top) / (top - half)
    order = np.argsort(ratio)
    spline = [CubicSpline(np.log(ratio[order]), values[order]) for values in (np.log(q), half, top)]
    return _Landmarks((float(ratio.min()), float(ratio.max())), *spline)


def _highest(shape: Shape, q: FloatArray, first: FloatArray, last: FloatArray) -> FloatArray:
    """Times of the maxima of unimodal curves, by ternary search on the logarithm of the height."""
    low, high = first.copy(), last.copy()
    for _ in range(2 * BISECTIONS):
        left, right = low + (high - low) / 3, high - (high - low) / 3
        rises = shape(left, q) < shape(right, q)
        low, high = np.where(rises, left, low), np.where(rises, high, right)
    return np.asarray(0.5 * (low + high))


def _crossing(shape: Shape, q: FloatArray, level: FloatArray, ends: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Times at which curves pass a level between a low and a high end, by bisection."""
    low, high = (end.copy() for end in ends)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        below = shape(middle, q) < level
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(0.5 * (low + high))

"""Light curve of a burst in one channel: a Gaussian rise smeared by a decay, as scattering leaves it.

Widths follow frequency as observed. The smearing kernel is a gamma distribution, so that
the curve is none of those that are later fitted to it.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import stats
from scipy.signal import fftconvolve

from bella.units import FloatArray

HALF_WIDTH_SD = math.sqrt(2 * math.log(2))
"""Half width at half maximum of a Gaussian, in its standard deviations."""


def rise_half_width_s(frequency_mhz: float) -> float:
    """Half width of the rise, 1.5 (f / 30 MHz)^-0.77 s: Reid & Kontar 2018, A&A 614, A69."""
    return float(1.5 * (frequency_mhz / 30.0) ** -0.77)


def decay_s(frequency_mhz: float) -> float:
    """Decay time, 72 (f / MHz)^-0.97 s: Kontar et al. 2019, ApJ 884, 122."""
    return float(72.0 * frequency_mhz**-0.97)


GAMMA_SHAPE = 1.3
STEPS_PER_SD = 40
BEFORE_SD = 6.0
DECAYS = 14.0


@dataclass(frozen=True)
class LightCurve:
    """Running integral of a light curve with maximum 1 that has risen to one half at time 0.

    Attributes
    ----------
    time_s : ndarray, shape (M,)
        Ascending, evenly spaced, s.
    integral_s : ndarray, shape (M,)
        Integral up to that time, s.
    """

    time_s: FloatArray
    integral_s: FloatArray

    def mean(self, start_s: FloatArray, stop_s: FloatArray) -> FloatArray:
        """Mean over intervals, as a receiver that integrates sees it.

        Parameters
        ----------
        start_s, stop_s : ndarray
            Ends of the intervals after the half-rise, s; any shape, stop after start.

        Returns
        -------
        ndarray
            Between 0 and 1.
        """
        upto = [np.interp(edge, self.time_s, self.integral_s) for edge in (start_s, stop_s)]
        return np.asarray((upto[1] - upto[0]) / (stop_s - start_s))


@lru_cache(maxsize=1024)
def light_curve(
    frequency_mhz: float, rise_factor: float = 1.0, decay_factor: float = 1.0, gamma_shape: float = GAMMA_SHAPE
) -> LightCurve:
    """Light curve of a burst at a frequency.

    Parameters
    ----------
    frequency_mhz : float
    rise_factor, decay_factor : float
        By how much rise and decay are slower than observed on average.
    gamma_shape : float
        Shape of the smearing kernel; 1 is an exponential decay.

    Returns
    -------
    LightCurve
    """
    sd = rise_factor * rise_half_width_s(frequency_mhz) / HALF_WIDTH_SD
    decay = decay_factor * decay_s(frequency_mhz)
    step = sd / STEPS_PER_SD
    rise = np.arange(-BEFORE_SD * sd, BEFORE_SD * sd, step)
    tail = np.arange(0, DECAYS * decay, step) + 0.5 * step
    kernel = stats.gamma.pdf(tail, gamma_shape, scale=decay / gamma_shape)
    curve = fftconvolve(np.exp(-0.5 * (rise / sd) ** 2), kernel)
    time = rise[0] + 0.5 * step + step * np.arange(curve.size)
    curve = np.maximum(curve / curve.max(), 0.0)
    top = int(curve.argmax())
    half_rise = np.interp(0.5, curve[: top + 1], time[: top + 1])
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (curve[1:] + curve[:-1]) * step)])
    return LightCurve(time - half_rise, integral)

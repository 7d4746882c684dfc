"""Where the first burst of a light curve ends, so that a second one in its decay is passed over."""

import numpy as np
from scipy.ndimage import uniform_filter1d

from bella.bursts.half_maximum import FLUX_SCATTER, quiet_noise
from bella.units import FloatArray

QUALIFIES = 0.6
"""A maximum counts from this share of the highest on."""

DIP_SIGMAS = 3.5
SMALLEST_DIP = 0.12
"""A maximum is over when the power has fallen below it by so much: in its noise, and as a share of it."""

RISE_SAMPLES = 3
"""With this many samples or more on the rise, three of them are averaged first."""


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

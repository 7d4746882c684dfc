"""How fast a burst rises and decays at each frequency, as observed."""

import math

HALF_WIDTH_SD = math.sqrt(2 * math.log(2))
"""Half width at half maximum of a Gaussian, in its standard deviations."""


def rise_half_width_s(frequency_mhz: float) -> float:
    """Half width at half maximum of the rise, 1.5 (f / 30 MHz)^-0.77 s.

    Reid & Kontar 2018, A&A 614, A69, doi:10.1051/0004-6361/201732298.

    Parameters
    ----------
    frequency_mhz : float

    Returns
    -------
    float
        s.
    """
    return float(1.5 * (frequency_mhz / 30.0) ** -0.77)


def decay_s(frequency_mhz: float) -> float:
    """Decay time, 72 (f / MHz)^-0.97 s.

    Kontar et al. 2019, ApJ 884, 122, doi:10.3847/1538-4357/ab40bb.

    Parameters
    ----------
    frequency_mhz : float

    Returns
    -------
    float
        s.
    """
    return float(72.0 * frequency_mhz**-0.97)

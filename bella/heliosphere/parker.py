"""The Parker spiral in the ecliptic plane: r = v_sw / Omega (phi_0 - phi) + r_0, and the rotation behind it.

Which rotation was used decides the solar wind speed that a spiral stands for (v_sw is proportional to Omega): the
period is always an argument, and is stored with results.
"""

import math

import numpy as np

from bella.units import DAY_S, R_SUN_KM, FloatArray

SIDEREAL_ROTATION_D = 25.38
"""Sidereal rotation period of the Carrington system, days.

Thompson 2006, A&A 449, 791, doi:10.1051/0004-6361:20054262.

HEE of a fixed epoch does not rotate, so this is the period for a spiral seen in it.
"""

PAPER_FIGURES_ROTATION_D = 24.47
"""Sidereal period at the equator, days, with which the published spirals of the 2012-06-07 burst are drawn.

Canizares et al. 2024, A&A 684, A182, doi:10.1051/0004-6361/202347747, and the code published with it.
"""

SYNODIC_ROTATION_D = 27.2753
"""Mean synodic rotation period of the Carrington system, days (as seen from Earth; Thompson 2006)."""

SPIRAL_ORIGIN_RSUN = 1.0


def angular_speed_rad_s(rotation_period_d: float) -> float:
    """Angular speed of the Sun.

    Parameters
    ----------
    rotation_period_d : float
        Rotation period, days.

    Returns
    -------
    float
        rad/s.
    """
    return 2.0 * math.pi / (rotation_period_d * DAY_S)


def spiral_longitude_deg(
    range_rsun: FloatArray,
    phi0_deg: float | FloatArray,
    v_sw_km_s: float | FloatArray,
    rotation_period_d: float = SIDEREAL_ROTATION_D,
) -> FloatArray:
    """Longitude of a Parker spiral at a distance from the Sun.

    Parameters
    ----------
    range_rsun : numpy.ndarray
        Heliocentric distance, solar radii, any shape.
    phi0_deg : float or numpy.ndarray
        Longitude at 1 solar radius, degrees, positive to the west; a shape that goes with `range_rsun`.
    v_sw_km_s : float or numpy.ndarray
        Solar wind speed, km/s; a shape that goes with `range_rsun`.
    rotation_period_d : float
        Rotation period of the Sun, days.

    Returns
    -------
    numpy.ndarray
        Degrees, positive to the west, not wrapped; the common shape.

    Notes
    -----
    Parker 1958, ApJ 128, 664, doi:10.1086/146579: constant radial speed, frozen-in field, far above the source surface.
    """
    winding_rad_rsun = angular_speed_rad_s(rotation_period_d) * R_SUN_KM / v_sw_km_s
    return phi0_deg - np.degrees(winding_rad_rsun) * (range_rsun - SPIRAL_ORIGIN_RSUN)

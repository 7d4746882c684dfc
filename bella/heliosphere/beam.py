"""Travel of an electron beam along a Parker spiral."""

import math

import numpy as np

from bella.heliosphere.parker import (
    SIDEREAL_ROTATION_D,
    SPIRAL_ORIGIN_RSUN,
    angular_speed_rad_s,
    spiral_longitude_deg,
)
from bella.units import C_RSUN_S, R_SUN_KM, FloatArray

TRAVEL_NODES = 8
"""Nodes of the travel integral: six digits out to 2 au."""

TRAVEL_RULE = np.polynomial.legendre.leggauss(TRAVEL_NODES)


def spiral_path_rsun(
    range_rsun: FloatArray, v_sw_km_s: float | FloatArray, rotation_period_d: float = SIDEREAL_ROTATION_D
) -> FloatArray:
    """Length of a Parker spiral from 1 solar radius to a distance from the Sun.

    Parameters
    ----------
    range_rsun : numpy.ndarray
        Heliocentric distance, solar radii, any shape.
    v_sw_km_s : float or numpy.ndarray
        Solar wind speed, km/s; a shape that goes with `range_rsun`.
    rotation_period_d : float
        Rotation period of the Sun, days.

    Returns
    -------
    numpy.ndarray
        Solar radii, the common shape.

    Notes
    -----
    S(r) = [r sqrt(1 + k^2 r^2) + asinh(k r) / k] / 2 with k = Omega / v_sw is the arc length of the spiral r = phi / k
    of Parker 1958, ApJ 128, 664, doi:10.1086/146579.
    """
    k = angular_speed_rad_s(rotation_period_d) * R_SUN_KM / v_sw_km_s
    return np.asarray(_arc(np.asarray(range_rsun, dtype=np.float64), k) - _arc(np.array(SPIRAL_ORIGIN_RSUN), k))


def _arc(range_rsun: FloatArray, k: float | FloatArray) -> FloatArray:
    return np.asarray(0.5 * (range_rsun * np.sqrt(1 + (k * range_rsun) ** 2) + np.arcsinh(k * range_rsun) / k))


def beam_travel_s(
    range_rsun: FloatArray,
    beam_speed_c: float | FloatArray,
    v_sw_km_s: float | FloatArray,
    rotation_period_d: float = SIDEREAL_ROTATION_D,
) -> FloatArray:
    """Time that a beam of constant speed takes from 1 solar radius along the spiral.

    Parameters
    ----------
    range_rsun : numpy.ndarray
        Heliocentric distance, solar radii, any shape.
    beam_speed_c : float or numpy.ndarray
        Speed of the beam along the field, in units of c; a shape that goes with `range_rsun`.
    v_sw_km_s : float or numpy.ndarray
        Solar wind speed, km/s; a shape that goes with `range_rsun`.
    rotation_period_d : float
        Rotation period of the Sun, days.

    Returns
    -------
    numpy.ndarray
        s, the common shape.
    """
    return spiral_path_rsun(range_rsun, v_sw_km_s, rotation_period_d) / (beam_speed_c * C_RSUN_S)


def slowing_travel_s(
    range_rsun: FloatArray,
    beam_speed_c: float | FloatArray,
    deceleration: float | FloatArray,
    v_sw_km_s: float | FloatArray,
    rotation_period_d: float = SIDEREAL_ROTATION_D,
) -> FloatArray:
    """Time that a beam takes from 1 solar radius along the spiral when its speed falls as a power of the distance.

    Parameters
    ----------
    range_rsun : numpy.ndarray
        Heliocentric distance, solar radii, any shape.
    beam_speed_c : float or numpy.ndarray
        Speed of the beam at 1 solar radius, in units of c; a shape that goes with `range_rsun`.
    deceleration : float or numpy.ndarray
        Exponent d of the speed v(r) = v(1) r^-d; a shape that goes with `range_rsun`.
    v_sw_km_s : float or numpy.ndarray
        Solar wind speed, km/s; a shape that goes with `range_rsun`.
    rotation_period_d : float
        Rotation period of the Sun, days.

    Returns
    -------
    numpy.ndarray
        s, the common shape.

    Notes
    -----
    t = Int sqrt(1 + k^2 r^2) r^d dr / v(1), by Gauss-Legendre in ln r. Beams slow down (Krupar et al. 2015,
    A&A 580, A137, doi:10.1051/0004-6361/201425308), about as r^-0.3 (Azzollini & Kontar 2025, arXiv:2504.18312).
    """
    k = angular_speed_rad_s(rotation_period_d) * R_SUN_KM / v_sw_km_s
    log_range = np.log(np.asarray(range_rsun, dtype=np.float64))
    total = np.zeros(np.broadcast_shapes(log_range.shape, np.shape(beam_speed_c), np.shape(deceleration), np.shape(k)))
    for node, weight in zip(*TRAVEL_RULE, strict=True):
        at = 0.5 * (1 + node) * log_range
        total += weight * np.exp((1 + deceleration) * at) * np.sqrt(1 + (k * np.exp(at)) ** 2)
    return np.asarray(0.5 * log_range * total / (beam_speed_c * C_RSUN_S))


def spiral_position_rsun(
    range_rsun: FloatArray,
    phi0_deg: float | FloatArray,
    v_sw_km_s: float | FloatArray,
    rotation_period_d: float = SIDEREAL_ROTATION_D,
) -> FloatArray:
    """Cartesian position on a Parker spiral in the ecliptic plane.

    Parameters
    ----------
    range_rsun : numpy.ndarray
        Heliocentric distance, solar radii, shape (..., N).
    phi0_deg : float or numpy.ndarray
        Longitude at 1 solar radius, degrees, positive to the west; a shape that goes with `range_rsun`.
    v_sw_km_s : float or numpy.ndarray
        Solar wind speed, km/s; a shape that goes with `range_rsun`.
    rotation_period_d : float
        Rotation period of the Sun, days.

    Returns
    -------
    numpy.ndarray
        Solar radii, HEE, shape (..., N, 3).
    """
    longitude = np.asarray(spiral_longitude_deg(range_rsun, phi0_deg, v_sw_km_s, rotation_period_d)) * math.pi / 180
    return np.stack([range_rsun * np.cos(longitude), range_rsun * np.sin(longitude), np.zeros_like(longitude)], axis=-1)

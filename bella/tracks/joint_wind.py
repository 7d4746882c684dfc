"""Field line of a wind whose speed changes at given distances: its longitudes, and integrals along it.

Between two knots the field is a Parker spiral (Parker 1958, ApJ 128, 664, doi:10.1086/146579) of the wind there; the
line is continuous, its direction is not.
"""

from collections.abc import Callable, Sequence

import numpy as np

from bella.heliosphere import spiral_longitude_deg, spiral_position_rsun
from bella.units import FloatArray

Winds = Sequence[FloatArray]
"""Speed of each segment from the Sun outwards, km/s, shapes that go with the distances."""


def field_line_position_rsun(
    range_rsun: FloatArray,
    phi0_deg: FloatArray,
    winds_km_s: Winds,
    knots_rsun: Sequence[float],
    rotation_period_d: float,
) -> FloatArray:
    """Positions on field lines in the ecliptic plane.

    Parameters
    ----------
    range_rsun : ndarray, shape (N, F)
        Solar radii.
    phi0_deg : ndarray, shape (N, 1)
        HEE longitude at 1 solar radius, degrees.
    winds_km_s : sequence of ndarray, shape (N, 1) each
        One more than there are knots.
    knots_rsun : sequence of float
        Ascending, solar radii.
    rotation_period_d : float
        Days.

    Returns
    -------
    ndarray, shape (N, F, 3)
        HEE, solar radii.
    """
    if not knots_rsun:
        return spiral_position_rsun(range_rsun, phi0_deg, winds_km_s[0], rotation_period_d)
    turned_deg = along_field_line(
        range_rsun, winds_km_s, knots_rsun, lambda r, wind: spiral_longitude_deg(r, 0.0, wind, rotation_period_d)
    )
    longitude = np.radians(phi0_deg + turned_deg)
    return np.stack([range_rsun * np.cos(longitude), range_rsun * np.sin(longitude), np.zeros_like(longitude)], axis=-1)


def along_field_line(
    range_rsun: FloatArray,
    winds_km_s: Winds,
    knots_rsun: Sequence[float],
    integral: Callable[[FloatArray, FloatArray], FloatArray],
) -> FloatArray:
    """Integral from 1 solar radius along a field line, in each segment with the wind there.

    Parameters
    ----------
    range_rsun : ndarray, shape (N, F)
        Solar radii.
    winds_km_s, knots_rsun
        As for :func:`field_line_position_rsun`.
    integral : callable
        Of distance and speed: the integral from 1 solar radius in a wind of one speed, such as the travel of a beam.

    Returns
    -------
    ndarray, shape (N, F)
    """
    if not knots_rsun:
        return integral(range_rsun, winds_km_s[0])
    total = integral(np.minimum(range_rsun, knots_rsun[0]), winds_km_s[0])
    for wind, inner, outer in zip(winds_km_s[1:], knots_rsun, (*knots_rsun[1:], np.inf), strict=True):
        total = total + integral(np.clip(range_rsun, inner, outer), wind) - integral(np.full((1, 1), inner), wind)
    return np.asarray(total)

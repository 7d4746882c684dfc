"""Solar wind that rotates with the Sun: its speed at every distance and Carrington longitude, from one inner boundary.

Streams of unlike speed run into one another by Burgers' equation, which in the frame of the Sun is a march outward in
distance; on top of it every parcel goes on accelerating (Riley & Lionello 2011, Sol. Phys. 270, 575,
doi:10.1007/s11207-011-9766-x; Owens et al. 2020, Sol. Phys. 295, 43, doi:10.1007/s11207-020-01605-3).
"""

from dataclasses import dataclass

import numpy as np

from bella.exceptions import InputError
from bella.heliosphere import SIDEREAL_ROTATION_D, angular_speed_rad_s
from bella.units import R_SUN_KM, FloatArray

ACCELERATION = 0.15
"""Share of its speed at the reference distance that the wind gains far from the Sun (Riley & Lionello 2011)."""

ACCELERATION_SCALE_RSUN = 50.0
REFERENCE_RSUN = 30.0
"""Where the acceleration is counted from, whatever the inner boundary."""

INNER_RSUN = 30.0
OUTER_RSUN = 240.0
STEP_RSUN = 1.0
SLOWEST_KM_S, FASTEST_KM_S = 150.0, 3000.0


@dataclass(frozen=True)
class SteadyWind:
    """Speed of a wind that rotates with the Sun.

    Attributes
    ----------
    range_rsun : ndarray, shape (R,)
        Ascending from the inner boundary, solar radii.
    longitude_deg : ndarray, shape (L,)
        Carrington longitudes, the middles of equal bins, degrees.
    speed_km_s : ndarray, shape (R, L)
    """

    range_rsun: FloatArray
    longitude_deg: FloatArray
    speed_km_s: FloatArray

    def at(self, range_rsun: FloatArray, longitude_deg: FloatArray) -> FloatArray:
        """Speed at points.

        Parameters
        ----------
        range_rsun, longitude_deg : numpy.ndarray, shape (N,)
            Solar radii, and Carrington longitude in degrees.

        Returns
        -------
        numpy.ndarray, shape (N,)
            km/s; NaN inside the inner boundary and beyond the outer one.
        """
        return interpolated(self.speed_km_s[:, :, None], self.range_rsun, range_rsun, longitude_deg)[:, 0]


def boundary_longitudes_deg(bins: int) -> FloatArray:
    """Middles of equal longitude bins.

    Parameters
    ----------
    bins : int

    Returns
    -------
    numpy.ndarray, shape (bins,)
        Degrees.
    """
    return np.asarray((np.arange(bins) + 0.5) * 360.0 / bins)


def accelerated_speed_km_s(
    speed_km_s: FloatArray, range_rsun: FloatArray, from_rsun: FloatArray | float = INNER_RSUN
) -> FloatArray:
    """Speed of an undisturbed parcel further out: v0 (1 + a (1 - exp(-(r - 30) / 50))) over the same at the start.

    Parameters
    ----------
    speed_km_s : numpy.ndarray
        Speed at `from_rsun`, km/s.
    range_rsun : numpy.ndarray
        Where it is wanted, solar radii; broadcast with `speed_km_s`.
    from_rsun : float or numpy.ndarray
        Solar radii; broadcast with the others.

    Returns
    -------
    numpy.ndarray
        km/s.
    """
    return np.asarray(speed_km_s * _gain(np.asarray(range_rsun)) / _gain(np.asarray(from_rsun)))


def _gain(range_rsun: FloatArray) -> FloatArray:
    return np.asarray(1.0 + ACCELERATION * (1.0 - _decayed(range_rsun)))


def _decayed(range_rsun: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-(range_rsun - REFERENCE_RSUN) / ACCELERATION_SCALE_RSUN))


def steady_wind(
    boundary_km_s: FloatArray,
    inner_rsun: float = INNER_RSUN,
    outer_rsun: float = OUTER_RSUN,
    rotation_period_d: float = SIDEREAL_ROTATION_D,
) -> SteadyWind:
    """Wind everywhere from its speed at an inner boundary.

    Parameters
    ----------
    boundary_km_s : numpy.ndarray, shape (L,)
        Speed in L equal bins of Carrington longitude, km/s.
    inner_rsun, outer_rsun : float
        Solar radii.
    rotation_period_d : float
        Sidereal, days.

    Returns
    -------
    SteadyWind

    Raises
    ------
    InputError
        If a speed is not finite or not that of a solar wind, or the boundaries are not in order.
    """
    boundary = np.asarray(boundary_km_s, dtype=np.float64)
    check_boundary(boundary, inner_rsun, outer_rsun)
    range_rsun, speed = marched(boundary[:, None], inner_rsun, outer_rsun, rotation_period_d)
    return SteadyWind(range_rsun, boundary_longitudes_deg(boundary.size), speed[:, :, 0])


def check_boundary(boundary: FloatArray, inner_rsun: float, outer_rsun: float) -> None:
    """Refuse a boundary that no solar wind has.

    Parameters
    ----------
    boundary : numpy.ndarray, shape (L,)
        Speeds, km/s.
    inner_rsun, outer_rsun : float
        Solar radii.

    Raises
    ------
    InputError
        If a speed is not finite or not that of a solar wind, or the boundaries are not in order.
    """
    if boundary.ndim != 1 or boundary.size < 8:
        raise InputError(f"a boundary of shape {boundary.shape} is too coarse; give at least 8 longitudes in one array")
    if not np.all((boundary >= SLOWEST_KM_S) & (boundary <= FASTEST_KM_S)):
        raise InputError(f"speeds at the boundary must lie between {SLOWEST_KM_S:g} and {FASTEST_KM_S:g} km/s")
    if not 1.0 <= inner_rsun < outer_rsun:
        raise InputError(f"boundaries at {inner_rsun:g} and {outer_rsun:g} solar radii are not in order")


def marched(
    boundary_km_s: FloatArray, inner_rsun: float, outer_rsun: float, rotation_period_d: float
) -> tuple[FloatArray, FloatArray]:
    """Many winds at once, marched outward by upwind steps in distance.

    A parcel further out left the Sun at a larger Carrington longitude than the one it is at now, so the difference is
    taken towards larger longitude: v(r + dr) = v + (dr Omega / dphi) (v(phi + dphi) - v) / v.

    Parameters
    ----------
    boundary_km_s : numpy.ndarray, shape (L, W)
        Speeds of W winds at the inner boundary, km/s.
    inner_rsun, outer_rsun : float
        Solar radii.
    rotation_period_d : float
        Sidereal, days.

    Returns
    -------
    range_rsun : numpy.ndarray, shape (R,)
    speed_km_s : numpy.ndarray, shape (R, L, W)
    """
    width_rad = 2.0 * np.pi / boundary_km_s.shape[0]
    rigid_km_s = angular_speed_rad_s(rotation_period_d) * STEP_RSUN * R_SUN_KM / width_rad
    substeps = max(1, int(np.ceil(rigid_km_s / boundary_km_s.min())))  # the step that keeps the march stable
    range_rsun = np.arange(inner_rsun, outer_rsun + 0.5 * STEP_RSUN, STEP_RSUN)
    speed = np.empty((range_rsun.size, *boundary_km_s.shape))
    speed[0] = boundary_km_s
    for i in range(1, range_rsun.size):
        now = speed[i - 1]
        for _ in range(substeps):
            now = now + rigid_km_s / substeps * (np.roll(now, -1, axis=0) - now) / now
        speed[i] = accelerated_speed_km_s(now, range_rsun[i], range_rsun[i - 1])
    return range_rsun, speed


def interpolated(
    speed_km_s: FloatArray, grid_rsun: FloatArray, range_rsun: FloatArray, longitude_deg: FloatArray
) -> FloatArray:
    """Speeds of many winds at points, linear in distance and longitude.

    Parameters
    ----------
    speed_km_s : numpy.ndarray, shape (R, L, W)
    grid_rsun : numpy.ndarray, shape (R,)
    range_rsun, longitude_deg : numpy.ndarray, shape (N,)
        Solar radii, and Carrington longitude in degrees.

    Returns
    -------
    numpy.ndarray, shape (N, W)
        km/s; NaN outside the grid.
    """
    bins = speed_km_s.shape[1]
    along = (np.asarray(range_rsun) - grid_rsun[0]) / (grid_rsun[1] - grid_rsun[0])
    # a distance that a turn of frames has rounded is still on the boundary
    inside = (along >= -1e-9) & (along <= grid_rsun.size - 1 + 1e-9)
    row = np.clip(np.nan_to_num(along).astype(int), 0, grid_rsun.size - 2)
    turned = np.asarray(longitude_deg) / 360.0 * bins - 0.5
    left = np.floor(turned).astype(int)
    up, right = (along - row)[:, None], (turned - left)[:, None]
    low, high = left % bins, (left + 1) % bins
    near = (1 - right) * speed_km_s[row, low] + right * speed_km_s[row, high]
    far = (1 - right) * speed_km_s[row + 1, low] + right * speed_km_s[row + 1, high]
    return np.where(inside[:, None], (1 - up) * near + up * far, np.nan)

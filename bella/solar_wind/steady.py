"""Steady solar wind that rotates with the Sun: its speed at every distance and longitude, and its field lines.

The speed follows from an inner boundary by Burgers' equation, solved outward in distance in the frame of the Sun; in
addition every parcel accelerates (Riley & Lionello 2011, Sol. Phys. 270, 575, doi:10.1007/s11207-011-9766-x; Owens et
al. 2020, Sol. Phys. 295, 43, doi:10.1007/s11207-020-01605-3). A field line obeys dphi/dr = -Omega / v(r, phi).
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
"""Distances of the acceleration law of Riley & Lionello (2011), which counts from 30 solar radii."""

INNER_RSUN = 30.0
"""Inner boundary of the models whose equations are used here."""

OUTER_RSUN = 240.0
"""Beyond 1 au (215 solar radii), so that every spacecraft there is inside."""

STEP_RSUN = 1.0
SLOWEST_KM_S, FASTEST_KM_S = 150.0, 3000.0
"""Limits of a speed at the boundary, beyond those of any solar wind: 3000 km/s is that of Owens et al. (2020)."""

FEWEST_LONGITUDES = 8


@dataclass(frozen=True)
class SteadyWind:
    """Speed of a wind that rotates with the Sun.

    Attributes
    ----------
    range_rsun : ndarray, shape (R,)
        Ascending from the inner boundary, solar radii.
    longitude_deg : ndarray, shape (L,)
        Carrington longitudes, the middles of equal bins, degrees.
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
    """Middles of equal longitude bins, degrees."""
    return np.asarray((np.arange(bins) + 0.5) * 360.0 / bins)


def accelerated_speed_km_s(
    speed_km_s: FloatArray, range_rsun: FloatArray, from_rsun: FloatArray | float = INNER_RSUN
) -> FloatArray:
    """Speed of an undisturbed parcel at another distance, in proportion to 1 + a (1 - exp(-(r - 30) / 50))."""
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
    """Raise InputError if a boundary is not that of a solar wind."""
    if boundary.ndim != 1 or boundary.size < FEWEST_LONGITUDES:
        raise InputError(
            f"a boundary of shape {boundary.shape} is too coarse; give at least {FEWEST_LONGITUDES} longitudes "
            "in one array"
        )
    if not np.all((boundary >= SLOWEST_KM_S) & (boundary <= FASTEST_KM_S)):
        raise InputError(f"speeds at the boundary must lie between {SLOWEST_KM_S:g} and {FASTEST_KM_S:g} km/s")
    if not 1.0 <= inner_rsun < outer_rsun:
        raise InputError(f"boundaries at {inner_rsun:g} and {outer_rsun:g} solar radii are not in order")


def marched(
    boundary_km_s: FloatArray, inner_rsun: float, outer_rsun: float, rotation_period_d: float
) -> tuple[FloatArray, FloatArray]:
    """Solve many winds at once, outward by upwind steps: v(r + dr) = v + (dr Omega / dphi) (v(phi + dphi) - v) / v.

    The difference is taken towards larger longitude, where the parcel came from.

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
    # allow for rounding by a change of frames
    inside = (along >= -1e-9) & (along <= grid_rsun.size - 1 + 1e-9)
    row = np.clip(np.nan_to_num(along).astype(int), 0, grid_rsun.size - 2)
    turned = np.asarray(longitude_deg) / 360.0 * bins - 0.5
    left = np.floor(turned).astype(int)
    up, right = (along - row)[:, None], (turned - left)[:, None]
    low, high = left % bins, (left + 1) % bins
    near = (1 - right) * speed_km_s[row, low] + right * speed_km_s[row, high]
    far = (1 - right) * speed_km_s[row + 1, low] + right * speed_km_s[row + 1, high]
    return np.where(inside[:, None], (1 - up) * near + up * far, np.nan)


def field_lines_deg(
    wind: SteadyWind,
    range_rsun: float,
    longitude_deg: FloatArray,
    rotation_period_d: float = SIDEREAL_ROTATION_D,
    speed_factor: FloatArray | None = None,
) -> FloatArray:
    """Carrington longitudes of the field lines through points at one distance, at every distance of a wind.

    Parameters
    ----------
    range_rsun : float
        Distance of the points, solar radii.
    longitude_deg : ndarray, shape (D,)
        Carrington longitude of each, degrees.
    rotation_period_d : float
        Sidereal, days.
    speed_factor : ndarray, shape (D, R), optional
        Factor on the speed along each line at `wind.range_rsun`; 1 by default.

    Returns
    -------
    ndarray, shape (D, R)
        Degrees, without jumps. In a wind of one speed this is the spiral of Parker 1958, ApJ 128, 664,
        doi:10.1086/146579.

    Raises
    ------
    InputError
        If the points are not between the boundaries of the wind.
    """
    grid = wind.range_rsun
    if not grid[0] <= range_rsun <= grid[-1]:
        raise InputError(
            f"{range_rsun:g} solar radii is not between the boundaries {grid[0]:g} and {grid[-1]:g}: "
            "choose a source between them"
        )
    start = np.asarray(longitude_deg, dtype=np.float64)
    factor = np.ones((start.size, grid.size)) if speed_factor is None else speed_factor
    omega = np.degrees(angular_speed_rad_s(rotation_period_d)) * R_SUN_KM

    def _slope(at_rsun: float, at_deg: FloatArray) -> FloatArray:
        along = (at_rsun - grid[0]) / (grid[1] - grid[0])
        left = min(int(along), grid.size - 2)
        faster = (1 - along + left) * factor[:, left] + (along - left) * factor[:, left + 1]
        return np.asarray(-omega / (faster * wind.at(np.full(at_deg.size, at_rsun), at_deg)))

    lines = np.empty((start.size, grid.size))
    outward = int(np.searchsorted(grid, range_rsun))
    for stops in (range(outward, grid.size), range(outward - 1, -1, -1)):
        here, now = range_rsun, start
        for index in stops:  # the midpoint rule
            step = grid[index] - here
            middle = now + 0.5 * step * _slope(here, now)
            now = now + step * _slope(here + 0.5 * step, middle)
            here = float(grid[index])
            lines[:, index] = now
    return lines

"""The field line of a steady wind through a point: dphi/dr = -Omega / v(r, phi)."""

import numpy as np

from bella.exceptions import InputError
from bella.heliosphere import SIDEREAL_ROTATION_D, angular_speed_rad_s
from bella.solar_wind.steady import SteadyWind
from bella.units import R_SUN_KM, FloatArray


def field_line_longitude_deg(
    wind: SteadyWind, range_rsun: float, longitude_deg: float, rotation_period_d: float = SIDEREAL_ROTATION_D
) -> FloatArray:
    """Carrington longitude of the field line through a point, at every distance of a wind.

    In a wind of one speed this is the spiral of Parker 1958, ApJ 128, 664, doi:10.1086/146579.

    Parameters
    ----------
    wind : SteadyWind
    range_rsun, longitude_deg : float
        The point: solar radii, and Carrington longitude in degrees.
    rotation_period_d : float
        Sidereal, days.

    Returns
    -------
    numpy.ndarray, shape (R,)
        Degrees at each of `wind.range_rsun`, without jumps.

    Raises
    ------
    InputError
        If the point is not between the boundaries of the wind.
    """
    grid = wind.range_rsun
    if not grid[0] <= range_rsun <= grid[-1]:
        raise InputError(
            f"{range_rsun:g} solar radii is not between the boundaries {grid[0]:g} and {grid[-1]:g}: "
            "choose a source between them"
        )
    line = np.empty(grid.size)
    outward = np.searchsorted(grid, range_rsun)
    line[outward:] = _traced(wind, range_rsun, longitude_deg, grid[outward:], rotation_period_d)
    line[:outward] = _traced(wind, range_rsun, longitude_deg, grid[:outward][::-1], rotation_period_d)[::-1]
    return line


def _traced(
    wind: SteadyWind, range_rsun: float, longitude_deg: float, stops_rsun: FloatArray, rotation_period_d: float
) -> FloatArray:
    """Longitudes at a run of distances away from the point, by the midpoint rule."""
    omega = np.degrees(angular_speed_rad_s(rotation_period_d)) * R_SUN_KM

    def _slope(at_rsun: float, at_deg: float) -> float:
        return float(-omega / wind.at(np.array([at_rsun]), np.array([at_deg]))[0])

    longitudes = []
    for stop in stops_rsun:
        step = stop - range_rsun
        middle_deg = longitude_deg + 0.5 * step * _slope(range_rsun, longitude_deg)
        longitude_deg += step * _slope(range_rsun + 0.5 * step, middle_deg)
        range_rsun = stop
        longitudes.append(longitude_deg)
    return np.asarray(longitudes)

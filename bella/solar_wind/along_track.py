"""What a wind says about the track of a burst: its speed at the sources, and the field line through one of them."""

from dataclasses import dataclass

import numpy as np

from bella.exceptions import InputError
from bella.heliosphere import SIDEREAL_ROTATION_D, spiral_longitude_deg
from bella.solar_wind.field_line import field_line_longitude_deg
from bella.solar_wind.steady import SteadyWind
from bella.solar_wind.upwind import WindHistory
from bella.spacecraft import cartesian, hee_from, hee_to, polar
from bella.units import FloatArray, within_half_turn_deg


@dataclass(frozen=True)
class FieldLine:
    """The field line of a wind through a source.

    Attributes
    ----------
    range_rsun : ndarray, shape (R,)
        Ascending from the inner boundary of the wind, solar radii.
    longitude_deg : ndarray, shape (R,)
        HEE longitude at each, degrees, without jumps.
    """

    range_rsun: FloatArray
    longitude_deg: FloatArray

    def rms_from_spiral_deg(
        self,
        phi0_deg: float,
        v_sw_km_s: float,
        limits_rsun: tuple[float, float],
        rotation_period_d: float = SIDEREAL_ROTATION_D,
    ) -> float:
        """How far the field line is from a Parker spiral, root mean square in longitude.

        Parameters
        ----------
        phi0_deg, v_sw_km_s : float
            HEE longitude at 1 solar radius in degrees, and speed of the spiral.
        limits_rsun : tuple of float
            Distances between which they are compared, solar radii.
        rotation_period_d : float
            Rotation period of the spiral, days.

        Returns
        -------
        float
            Degrees.

        Raises
        ------
        InputError
            If the field line has no point between the limits.
        """
        inside = (self.range_rsun >= limits_rsun[0]) & (self.range_rsun <= limits_rsun[1])
        if not inside.any():
            raise InputError(
                f"the field line has no point from {limits_rsun[0]:g} to {limits_rsun[1]:g} solar radii: choose limits "
                f"between {self.range_rsun[0]:g} and {self.range_rsun[-1]:g}"
            )
        spiral = spiral_longitude_deg(self.range_rsun[inside], phi0_deg, v_sw_km_s, rotation_period_d)
        apart = within_half_turn_deg(self.longitude_deg[inside] - spiral)
        return float(np.sqrt(np.mean(apart**2)))


def speed_at_sources_km_s(wind: SteadyWind | WindHistory, source_rsun: FloatArray, utc: np.datetime64) -> FloatArray:
    """Speed of the wind at the sources of a burst.

    Parameters
    ----------
    wind : SteadyWind or WindHistory
    source_rsun : numpy.ndarray, shape (N, 3)
        HEE, solar radii.
    utc : numpy.datetime64
        Time of the burst; in the hour that one lasts the wind turns by half a degree.

    Returns
    -------
    numpy.ndarray, shape (N,)
        km/s; NaN inside the inner boundary of the wind and beyond its outer one.

    Raises
    ------
    InputError
        If the time is not within those of the wind, or sources do not have three coordinates.
    """
    range_rsun, longitude_deg, _ = polar(hee_to("carrington", source_rsun, utc))
    return _at_time(wind, utc).at(range_rsun, longitude_deg)


def field_line_through(
    wind: SteadyWind | WindHistory,
    source_rsun: FloatArray,
    utc: np.datetime64,
    rotation_period_d: float = SIDEREAL_ROTATION_D,
) -> FieldLine:
    """Field line of a wind through a source, in HEE.

    Parameters
    ----------
    wind : SteadyWind or WindHistory
    source_rsun : numpy.ndarray, shape (3,)
        HEE, solar radii; the line keeps its heliographic latitude.
    utc : numpy.datetime64
        Time of the burst.
    rotation_period_d : float
        Sidereal, days.

    Returns
    -------
    FieldLine

    Raises
    ------
    InputError
        If the source is not between the boundaries of the wind, or the time not within those of the wind.
    """
    (range_rsun,), (carrington_deg,), (latitude_deg,) = polar(hee_to("carrington", source_rsun[None], utc))
    now = _at_time(wind, utc)
    line = field_line_longitude_deg(now, float(range_rsun), float(carrington_deg), rotation_period_d)
    _, longitude_deg, _ = polar(hee_from("carrington", cartesian(now.range_rsun, line, latitude_deg), utc))
    return FieldLine(now.range_rsun, np.unwrap(longitude_deg, period=360.0))


def _at_time(wind: SteadyWind | WindHistory, utc: np.datetime64) -> SteadyWind:
    return wind.snapshot(utc) if isinstance(wind, WindHistory) else wind

"""The wind that a burst crossed, measured in situ and carried to its track, as it is stored and served."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bella.exceptions import InputError, NoDataError
from bella.flags import NOT_COMPUTED
from bella.heliosphere import spiral_longitude_deg, spiral_position_rsun
from bella.heliosphere.parker import SPIRAL_ORIGIN_RSUN
from bella.solar_wind.along_track import FieldLine, field_line_through, speed_at_sources_km_s
from bella.solar_wind.assimilation import HALF_ROTATION, WindAssimilation, drawn_winds
from bella.solar_wind.folder import InSitu
from bella.solar_wind.steady import SteadyWind
from bella.spacecraft import position_hee
from bella.units import FloatArray, within_half_turn_deg

LADDER_RSUN = (30.0, 50.0, 75.0, 100.0, 125.0, 150.0, 175.0, 200.0)
"""Distances at which the wind along a track is given, as far as the track reaches."""

DRAWS = 32
SEED = 1
MODEL = (
    "wind that turns with the Sun, from the hourly speeds of one rotation by Gauss-Newton with a climatological prior "
    "(cost of Lang & Owens 2019)"
)


@dataclass(frozen=True)
class TrackSpiral:
    """The spiral that was fitted to a track.

    Attributes
    ----------
    phi0_deg, v_sw_km_s : float
        HEE longitude at 1 solar radius, degrees, and speed.
    rotation_period_d : float
    range_rsun : ndarray, shape (F,)
        Distances of the sources of the track, solar radii.
    utc : numpy.datetime64
        Time of the burst and epoch of HEE.
    """

    phi0_deg: float
    v_sw_km_s: float
    rotation_period_d: float
    range_rsun: FloatArray
    utc: np.datetime64

    def at(self, range_rsun: FloatArray) -> FloatArray:
        """Points of the spiral.

        Parameters
        ----------
        range_rsun : ndarray, shape (N,)
            Solar radii.

        Returns
        -------
        ndarray, shape (N, 3)
            HEE, solar radii.
        """
        return spiral_position_rsun(range_rsun, self.phi0_deg, self.v_sw_km_s, self.rotation_period_d)

    def middle_rsun(self, wind: SteadyWind) -> float:
        """Distance of the middle one of the sources that are inside a wind.

        Parameters
        ----------
        wind : SteadyWind

        Returns
        -------
        float
            Solar radii.

        Raises
        ------
        NoDataError
            If there is none.
        """
        inner, outer = wind.range_rsun[[0, -1]]
        inside = self.range_rsun[(self.range_rsun >= inner) & (self.range_rsun <= outer)]
        if not inside.size:
            raise NoDataError(
                f"no source is between {inner:g} and {outer:g} solar radii, where the wind is known: add frequencies"
            )
        return float(np.median(inside))


def wind_companion(found: WindAssimilation, in_situ: InSitu, spiral: TrackSpiral | None) -> dict[str, Any]:
    """Wind of one rotation, along a track and at the spacecraft, and its field line against the fitted spiral.

    Parameters
    ----------
    found : WindAssimilation
        Of the speeds `in_situ`.
    in_situ : InSitu
    spiral : TrackSpiral or None
        None where none was fitted: then there is no track to compare with.

    Returns
    -------
    dict
        Ready for JSON: ``observatories`` with measured and modelled speeds and their misfit, ``boundary`` with its
        speeds and errors, ``along_track``, ``field_line``, ``left_out`` and flags.
    """
    winds = drawn_winds(found, DRAWS, SEED)
    return {
        "model": MODEL,
        "rotation_period_d": found.rotation_period_d,
        "days": round(2 * float(HALF_ROTATION / np.timedelta64(1, "D")), 1),
        "observatories": [_at_spacecraft(name, found, winds, in_situ) for name in found.rmse_km_s],
        "boundary": _boundary(found),
        "along_track": along_track(found.wind, winds, spiral) if spiral else [],
        "field_line": _compared(found, winds, spiral),
        "left_out": list(in_situ.left_out),
        "files": [file.name for file in in_situ.used],
        "flags": [],
    }


def _at_spacecraft(name: str, found: WindAssimilation, winds: Sequence[SteadyWind], in_situ: InSitu) -> dict[str, Any]:
    """What a spacecraft measured at the burst, and what the wind is there."""
    measured = in_situ.at(found.around_utc).get(name)
    model: dict[str, float | None]
    try:
        here = position_hee(name, [found.around_utc], found.around_utc)
        (model,) = _speeds(found.wind, winds, here, found.around_utc)
    except NoDataError:  # the ephemeris may end within the rotation
        model = {"mean": None, "sd": None}
    return {
        "observatory": name,
        "hours": int(in_situ.speeds[name].size),
        "measured_km_s": measured,
        "v_sw_km_s": model,
        "prior_rmse_km_s": round(found.prior_rmse_km_s[name], 1),
        "rmse_km_s": round(found.rmse_km_s[name], 1),
    }


def _speeds(
    wind: SteadyWind, winds: Sequence[SteadyWind], place_rsun: FloatArray, utc: np.datetime64
) -> list[dict[str, float | None]]:
    """Speed of the most probable wind at points, and its error from the drawn ones."""
    mean = speed_at_sources_km_s(wind, place_rsun, utc)
    sd = np.std([speed_at_sources_km_s(one, place_rsun, utc) for one in winds], axis=0)
    return [{"mean": _plain(m), "sd": _plain(s)} for m, s in zip(mean, sd, strict=True)]


def _plain(value: float) -> float | None:
    return round(float(value), 1) if np.isfinite(value) else None


def _boundary(found: WindAssimilation) -> dict[str, Any]:
    """Speeds at the inner boundary in equal bins of Carrington longitude from 0."""
    return {
        "range_rsun": float(found.wind.range_rsun[0]),
        "first_longitude_deg": float(found.wind.longitude_deg[0]),
        "step_deg": float(found.wind.longitude_deg[1] - found.wind.longitude_deg[0]),
        "v_sw_km_s": np.round(found.boundary_km_s, 1).tolist(),
        "sd_km_s": np.round(found.boundary_sd_km_s, 1).tolist(),
    }


def along_track(wind: SteadyWind, winds: Sequence[SteadyWind], spiral: TrackSpiral) -> list[dict[str, Any]]:
    """Speed of the wind at some distances along the fitted spiral, as far as the track reaches.

    Parameters
    ----------
    wind : SteadyWind
        Most probable.
    winds : sequence of SteadyWind
        Drawn from its posterior, for the errors.
    spiral : TrackSpiral

    Returns
    -------
    list of dict
        ``range_rsun`` and ``v_sw_km_s`` with mean and sd; empty where the track is inside the inner boundary.
    """
    low, high = float(np.nanmin(spiral.range_rsun)), float(np.nanmax(spiral.range_rsun))
    distance = np.array([one for one in LADDER_RSUN if low <= one <= high])
    if not distance.size:
        return []
    speeds = _speeds(wind, winds, spiral.at(distance), spiral.utc)
    return [{"range_rsun": float(r), "v_sw_km_s": speed} for r, speed in zip(distance, speeds, strict=True)]


def line_of_track(wind: SteadyWind, spiral: TrackSpiral, rotation_period_d: float) -> FieldLine:
    """Field line of a wind through the middle of a track.

    Parameters
    ----------
    wind : SteadyWind
    spiral : TrackSpiral
    rotation_period_d : float
        Of the wind, sidereal, days.

    Returns
    -------
    FieldLine

    Raises
    ------
    NoDataError
        If no source is between the boundaries of the wind.
    """
    middle = spiral.at(np.array([spiral.middle_rsun(wind)]))[0]
    return field_line_through(wind, middle, spiral.utc, rotation_period_d)


def longitude_at_sun_deg(wind: SteadyWind, spiral: TrackSpiral, rotation_period_d: float) -> float:
    """HEE longitude at 1 solar radius of the field line through the middle of a track.

    Below the inner boundary of the wind the line is a spiral of the speed there.

    Parameters
    ----------
    wind : SteadyWind
    spiral : TrackSpiral
    rotation_period_d : float
        Of the wind, sidereal, days.

    Returns
    -------
    float
        Degrees.

    Raises
    ------
    NoDataError
        If no source is between the boundaries of the wind.
    """
    line = line_of_track(wind, spiral, rotation_period_d)
    inner, longitude = line.range_rsun[:1], line.longitude_deg[:1]
    angle = np.radians(longitude[0])
    # a hair outside: turning between frames rounds
    place = 1.000001 * float(inner[0]) * np.array([[np.cos(angle), np.sin(angle), 0.0]])
    speed = float(speed_at_sources_km_s(wind, place, spiral.utc)[0])
    bend = spiral_longitude_deg(np.array([SPIRAL_ORIGIN_RSUN, float(inner[0])]), 0.0, speed, rotation_period_d)
    return float(longitude[0] + bend[0] - bend[1])


def _compared(found: WindAssimilation, winds: Sequence[SteadyWind], spiral: TrackSpiral | None) -> dict[str, Any]:
    """Where the field line through the middle of the track meets the Sun, and how far that is from the spiral."""
    if spiral is None:
        return {"flags": [NOT_COMPUTED], "reason": "there is no joint fit to compare with: add frequencies"}
    try:
        return _field_line(found, winds, spiral)
    except (InputError, NoDataError) as error:
        return {"flags": [NOT_COMPUTED], "reason": str(error)}


def _field_line(found: WindAssimilation, winds: Sequence[SteadyWind], spiral: TrackSpiral) -> dict[str, Any]:
    phi0, *drawn = (longitude_at_sun_deg(one, spiral, found.rotation_period_d) for one in (found.wind, *winds))
    away = [within_half_turn_deg(one - phi0) for one in drawn]
    line = line_of_track(found.wind, spiral, found.rotation_period_d)
    limits = float(np.nanmin(spiral.range_rsun)), float(np.nanmax(spiral.range_rsun))
    rms = line.rms_from_spiral_deg(spiral.phi0_deg, spiral.v_sw_km_s, limits, spiral.rotation_period_d)
    return {
        "through_rsun": round(spiral.middle_rsun(found.wind), 1),
        "phi0_deg": {"mean": round(within_half_turn_deg(phi0), 2), "sd": round(float(np.std(away)), 2)},
        "apart_deg": round(within_half_turn_deg(phi0 - spiral.phi0_deg), 2),
        "rms_deg": round(rms, 2),
        "flags": [],
    }

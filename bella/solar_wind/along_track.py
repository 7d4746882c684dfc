"""The measured wind along the track of a burst: its speed, its field line, and the record that a fit takes from it."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bella.exceptions import InputError, NoDataError
from bella.flags import NOT_COMPUTED
from bella.heliosphere import SIDEREAL_ROTATION_D, spiral_longitude_deg, spiral_position_rsun
from bella.heliosphere.parker import SPIRAL_ORIGIN_RSUN
from bella.records import MeasuredWind
from bella.solar_wind.assimilation import HALF_ROTATION, Places, Speeds, WindAssimilation
from bella.solar_wind.in_situ import InSitu
from bella.solar_wind.steady import INNER_RSUN, OUTER_RSUN, field_lines_deg
from bella.spacecraft import cartesian, hee_from, hee_to, polar, position_hee
from bella.units import FloatArray, within_half_turn_deg

LADDER_RSUN = (30.0, 50.0, 75.0, 100.0, 125.0, 150.0, 175.0, 200.0)
"""Distances at which the wind along a track is given, as far as the track reaches."""

LINE_STEP = 6
"""Distances of the wind grid per point at which the errors along a line are drawn: 6 solar radii, 3 h of travel."""

DRAWS, SEED = 200, 1
"""Draws of a field line: its standard deviation is good to 5 %."""

MODEL = (
    "steady wind that rotates with the Sun and a correlated model error, from the hourly speeds of one rotation "
    "(weak-constraint variational assimilation)"
)


@dataclass(frozen=True)
class TrackSpiral:
    """Parker spiral that was fitted to a track.

    Attributes
    ----------
    phi0_deg, v_sw_km_s : float
        HEE longitude at 1 solar radius, degrees, and speed.
    range_rsun : ndarray, shape (F,)
        Distances of the sources of the track, solar radii.
    utc : numpy.datetime64
        Time of the burst and epoch of HEE.
    phi0_sd_deg : float
        Standard deviation of the longitude.
    """

    phi0_deg: float
    v_sw_km_s: float
    rotation_period_d: float
    range_rsun: FloatArray
    utc: np.datetime64
    phi0_sd_deg: float = 0.0

    def at(self, range_rsun: FloatArray) -> FloatArray:
        """HEE positions on the spiral at distances of shape (N,): shape (N, 3), solar radii."""
        return spiral_position_rsun(range_rsun, self.phi0_deg, self.v_sw_km_s, self.rotation_period_d)

    def middle_rsun(self) -> float:
        """Median distance of the sources that are inside the wind.

        Raises
        ------
        NoDataError
            If there is none.
        """
        inside = self.range_rsun[(self.range_rsun >= INNER_RSUN) & (self.range_rsun <= OUTER_RSUN)]
        if not inside.size:
            raise NoDataError(
                f"no source is between {INNER_RSUN:g} and {OUTER_RSUN:g} solar radii, where the wind is known: "
                "add frequencies"
            )
        return float(np.median(inside))


@dataclass(frozen=True)
class FieldLine:
    """Field line of the measured wind through a source, with draws from its posterior.

    Attributes
    ----------
    range_rsun : ndarray, shape (R,)
        1 solar radius, and ascending from the inner boundary of the wind.
    longitude_deg : ndarray, shape (R,)
        HEE longitude of the most probable line, degrees, without jumps.
    drawn_longitude_deg : ndarray, shape (D, R)
        Of lines drawn from the posterior, through the source or through sources drawn as well.
    """

    range_rsun: FloatArray
    longitude_deg: FloatArray
    drawn_longitude_deg: FloatArray = field(repr=False)

    def phi0_sd_deg(self) -> float:
        """Standard deviation of the longitude at 1 solar radius, degrees."""
        away = within_half_turn_deg(self.drawn_longitude_deg[:, 0] - self.longitude_deg[0])
        return float(np.std(away))

    def rms_from_spiral_deg(
        self,
        phi0_deg: float,
        v_sw_km_s: float,
        limits_rsun: tuple[float, float],
        rotation_period_d: float = SIDEREAL_ROTATION_D,
    ) -> float:
        """Root mean square difference in longitude from a Parker spiral between two distances, degrees.

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


def speed_at_sources(found: WindAssimilation, source_rsun: FloatArray, utc: np.datetime64) -> Speeds:
    """Speed of the measured wind at sources at HEE positions of shape (N, 3), solar radii, at the time of a burst."""
    return found.speeds(Places.of_hee(source_rsun, utc))


def field_line_through(
    found: WindAssimilation, source_rsun: FloatArray, utc: np.datetime64, longitude_sd_deg: float = 0.0
) -> FieldLine:
    """Field line of the measured wind through a source.

    Parameters
    ----------
    source_rsun : numpy.ndarray, shape (3,)
        HEE, solar radii; the line keeps its heliographic latitude.
    utc : numpy.datetime64
        Time of the burst.
    longitude_sd_deg : float
        Standard deviation of the longitude of the source; the lines drawn start from longitudes drawn with it.

    Returns
    -------
    FieldLine
        Below the inner boundary it is a spiral of the speed there.

    Raises
    ------
    InputError
        If the source is not between the boundaries of the wind.
    """
    (range_rsun,), (carrington_deg,), (latitude_deg,) = polar(hee_to("carrington", source_rsun[None], utc))
    range_rsun = float(np.clip(range_rsun, INNER_RSUN, OUTER_RSUN)) if _on_edge(range_rsun) else float(range_rsun)
    random, period_d, grid = np.random.default_rng(SEED), found.rotation_period_d, found.wind.range_rsun
    first = field_lines_deg(found.wind, range_rsun, np.array([carrington_deg]), period_d)[0]
    on_line = Places(grid[::LINE_STEP], first[::LINE_STEP], np.full(grid[::LINE_STEP].size, utc))
    speeds = found.speeds(on_line)
    drawn = random.multivariate_normal(speeds.ln_km_s, speeds.covariance, DRAWS, method="eigh")
    change = np.vstack([speeds.ln_km_s, drawn]) - np.log(found.wind.at(on_line.range_rsun, on_line.longitude_deg))
    factor = np.exp([np.interp(grid, on_line.range_rsun, one) for one in change])
    start = carrington_deg + np.append(0.0, longitude_sd_deg * random.standard_normal(DRAWS))
    lines = field_lines_deg(found.wind, range_rsun, start, period_d, factor)
    inner_km_s = factor[:, 0] * found.wind.at(np.full(len(lines), grid[0]), lines[:, 0])
    turned = spiral_longitude_deg(np.array([[SPIRAL_ORIGIN_RSUN, grid[0]]]), 0.0, inner_km_s[:, None], period_d)
    lines = np.column_stack([lines[:, 0] + turned[:, 0] - turned[:, 1], lines])
    distance = np.append(SPIRAL_ORIGIN_RSUN, grid)
    point = cartesian(np.tile(distance, len(lines)), lines.ravel(), latitude_deg)
    _, longitude_deg, _ = polar(hee_from("carrington", point, utc))
    unwrapped = np.unwrap(longitude_deg.reshape(lines.shape), period=360.0, axis=1)
    return FieldLine(distance, unwrapped[0], unwrapped[1:])


def _on_edge(range_rsun: float) -> bool:
    """Whether a distance is outside the wind by no more than the rounding of a change of frames."""
    return bool(np.abs(range_rsun - np.array([INNER_RSUN, OUTER_RSUN])).min() < 1e-6)


def measured_wind(found: WindAssimilation, spiral: TrackSpiral) -> MeasuredWind:
    """Mean speed of the measured wind along the field line of a burst, from 1 solar radius outward, with its errors.

    Parameters
    ----------
    spiral : TrackSpiral
        Of the true sources, that is corrected for scattering: the wind bends their field line, not that of the apparent
        sources. The error of its longitude counts as well.

    Notes
    -----
    A spiral of speed V turns by Omega (r - 1) / V. From the angle by which each drawn line turns follows its V, so the
    errors of model and boundary, their correlation with distance and the shear of the wind are all in it.
    """
    through_rsun = float(np.clip(np.median(spiral.range_rsun), INNER_RSUN, OUTER_RSUN))
    source = spiral.at(np.array([through_rsun]))[0]
    line = field_line_through(found, source, spiral.utc, spiral.phi0_sd_deg)
    distance = np.array(LADDER_RSUN)
    turned = [
        np.interp(distance, line.range_rsun, one) - one[0] for one in (line.longitude_deg, *line.drawn_longitude_deg)
    ]
    per_speed = spiral_longitude_deg(distance, 0.0, 1.0, found.rotation_period_d)
    speed = per_speed / np.array(turned)
    return MeasuredWind(
        range_rsun=LADDER_RSUN,
        v_sw_km_s=tuple(speed[0].round(1).tolist()),
        sd_km_s=tuple(np.std(speed[1:], axis=0).round(1).tolist()),
        correlation=tuple(tuple(row) for row in np.corrcoef(speed[1:].T).round(3).tolist()),
    )


def wind_companion(found: WindAssimilation, in_situ: InSitu, spiral: TrackSpiral | None) -> dict[str, Any]:
    """Wind of one rotation, along a track and at the spacecraft, and its field line beside the fitted spiral.

    Parameters
    ----------
    found : WindAssimilation
        Of the speeds `in_situ`.
    spiral : TrackSpiral or None
        None where none was fitted.

    Returns
    -------
    dict
        Ready for JSON: ``observatories`` with measured and modelled speeds and the test without them, ``boundary``
        with its speeds and errors, ``along_track``, ``field_line``, ``left_out`` and flags.
    """
    return {
        "model": MODEL,
        "rotation_period_d": found.rotation_period_d,
        "days": round(2 * float(HALF_ROTATION / np.timedelta64(1, "D")), 1),
        "observatories": [_at_spacecraft(name, found, in_situ) for name in found.left_out],
        "boundary": _boundary(found),
        "along_track": along_track(found, spiral) if spiral else [],
        "field_line": _compared(found, spiral),
        "left_out": list(in_situ.left_out),
        "files": [file.name for file in in_situ.used],
        "flags": [],
    }


def _at_spacecraft(name: str, found: WindAssimilation, in_situ: InSitu) -> dict[str, Any]:
    """Measured and modelled speed at a spacecraft at the time of the burst, and how well the others predict it."""
    model: dict[str, float | None] = {"mean": None, "sd": None}
    try:
        here = position_hee(name, [found.around_utc], found.around_utc)
        (model,) = _summaries(speed_at_sources(found, here, found.around_utc))
    except NoDataError:  # the ephemeris may end within the rotation
        pass
    test = found.left_out[name]
    return {
        "observatory": name,
        "hours": int(in_situ.speeds[name].size),
        "measured_km_s": in_situ.at(found.around_utc).get(name),
        "v_sw_km_s": model,
        "prior_rmse_km_s": round(test.climate_rmse_km_s, 1),
        "rmse_km_s": round(test.rmse_km_s, 1),
        "z_rms": round(test.z_rms, 2),
    }


def _summaries(speeds: Speeds) -> list[dict[str, float | None]]:
    return [{"mean": _plain(m), "sd": _plain(s)} for m, s in zip(speeds.mean_km_s, speeds.sd_km_s, strict=True)]


def _plain(value: float) -> float | None:
    return round(float(value), 1) if np.isfinite(value) else None


def _boundary(found: WindAssimilation) -> dict[str, Any]:
    """Speeds at the inner boundary at the time of the burst, in equal bins of Carrington longitude from 0."""
    speeds = found.boundary()
    return {
        "range_rsun": float(found.wind.range_rsun[0]),
        "first_longitude_deg": float(found.wind.longitude_deg[0]),
        "step_deg": float(found.wind.longitude_deg[1] - found.wind.longitude_deg[0]),
        "v_sw_km_s": np.round(speeds.mean_km_s, 1).tolist(),
        "sd_km_s": np.round(speeds.sd_km_s, 1).tolist(),
    }


def along_track(found: WindAssimilation, spiral: TrackSpiral) -> list[dict[str, Any]]:
    """Speed of the wind at some distances along a spiral, as far as the track reaches.

    Returns
    -------
    list of dict
        ``range_rsun`` and ``v_sw_km_s`` with mean and sd; empty where the track is inside the inner boundary.
    """
    low, high = float(np.nanmin(spiral.range_rsun)), float(np.nanmax(spiral.range_rsun))
    distance = np.array([one for one in LADDER_RSUN if low <= one <= high])
    if not distance.size:
        return []
    speeds = _summaries(speed_at_sources(found, spiral.at(distance), spiral.utc))
    return [{"range_rsun": float(r), "v_sw_km_s": speed} for r, speed in zip(distance, speeds, strict=True)]


def line_of_track(found: WindAssimilation, spiral: TrackSpiral) -> FieldLine:
    """Field line of the measured wind through the middle of a track.

    Raises
    ------
    NoDataError
        If no source is between the boundaries of the wind.
    """
    return field_line_through(found, spiral.at(np.array([spiral.middle_rsun()]))[0], spiral.utc)


def _compared(found: WindAssimilation, spiral: TrackSpiral | None) -> dict[str, Any]:
    """Longitude at 1 solar radius of the field line through the middle of a track, beside that of the spiral."""
    if spiral is None:
        return {"flags": [NOT_COMPUTED], "reason": "there is no joint fit to compare with: add frequencies"}
    try:
        line = line_of_track(found, spiral)
        limits = max(float(np.nanmin(spiral.range_rsun)), INNER_RSUN), float(np.nanmax(spiral.range_rsun))
        rms = line.rms_from_spiral_deg(spiral.phi0_deg, spiral.v_sw_km_s, limits, spiral.rotation_period_d)
    except (InputError, NoDataError) as error:
        return {"flags": [NOT_COMPUTED], "reason": str(error)}
    phi0 = within_half_turn_deg(float(line.longitude_deg[0]))
    return {
        "through_rsun": round(spiral.middle_rsun(), 1),
        "phi0_deg": {"mean": round(phi0, 2), "sd": round(line.phi0_sd_deg(), 2)},
        "apart_deg": round(within_half_turn_deg(phi0 - spiral.phi0_deg), 2),
        "rms_deg": round(rms, 2),
        "flags": [],
    }

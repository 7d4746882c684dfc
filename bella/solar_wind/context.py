"""Footpoint of a burst on the Sun, the regions near it, and the spacecraft that were magnetically connected to it.

The footpoint is the longitude of the fitted spiral at 1 solar radius. Below some 2.5 solar radii the field is not that
of a spiral and spreads by 10 degrees and more, so that a match is a hint and no identification.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from bella.exceptions import InputError, NoDataError
from bella.flags import NOT_COMPUTED
from bella.heliosphere import SIDEREAL_ROTATION_D, spiral_longitude_deg
from bella.solar_wind.source_regions import Regions, SourceRegion
from bella.spacecraft import cartesian, hee_to, polar, position
from bella.units import FloatArray, within_half_turn_deg

FOOTPOINT_RSUN = 1.0
CREDIBLE = 0.95
ASSUMED_WIND_KM_S = 400.0
SLOW_KM_S, FAST_KM_S = 300.0, 600.0
NEAREST_REGIONS, MOST_REGIONS = 3, 8
"""Fewest regions that are kept, whether they match or not, and most."""

LEVELS = {"q2_5": 0.025, "q16": 0.16, "q50": 0.5, "q84": 0.84, "q97_5": 0.975}


@dataclass(frozen=True)
class Longitudes:
    """A longitude with its uncertainty.

    Attributes
    ----------
    mean_deg : float
        Circular mean: HEE and Stonyhurst -180 to 180, Carrington 0 to 360.
    sd_deg : float
        Root mean square distance from it, degrees.
    low_deg, high_deg : float
        95 per cent credible interval about the mean, without a jump: they may pass 180 degrees.
    draws_deg : ndarray, shape (D,)
        Draws, within half a turn of the mean.
    """

    mean_deg: float
    sd_deg: float
    low_deg: float
    high_deg: float
    draws_deg: FloatArray


@dataclass(frozen=True)
class Footpoint:
    """Footpoint of the field line of a burst.

    Attributes
    ----------
    hee, stonyhurst, carrington : Longitudes
        In the three systems; at 1 solar radius in the plane of the ecliptic.
    latitude_deg : float
        Heliographic latitude of the ecliptic there, degrees: the track does not measure a latitude.
    """

    hee: Longitudes
    stonyhurst: Longitudes
    carrington: Longitudes
    latitude_deg: float
    utc: np.datetime64


def footpoint(phi0_deg: FloatArray, utc: np.datetime64) -> Footpoint:
    """Footpoint in solar longitudes from draws of the longitude at 1 solar radius.

    Parameters
    ----------
    phi0_deg : numpy.ndarray, shape (D,)
        HEE longitudes of the spiral at 1 solar radius: draws of a fit, degrees.
    utc : numpy.datetime64
        Time of the burst.

    Raises
    ------
    InputError
        If there is no draw, or one is not finite.
    """
    draws = np.asarray(phi0_deg, dtype=np.float64)
    if draws.ndim != 1 or not draws.size or not np.isfinite(draws).all():
        raise InputError("a footpoint needs finite draws of its longitude in one array: give those of a fitted spiral")
    place = cartesian(FOOTPOINT_RSUN, draws, 0.0)
    _, stonyhurst, latitude = polar(hee_to("heeq", place, utc))
    _, carrington, _ = polar(hee_to("carrington", place, utc))
    three = _summary(draws), _summary(stonyhurst), _summary(carrington, least_deg=0.0)
    return Footpoint(*three, float(np.mean(latitude)), utc)


def _summary(draws_deg: FloatArray, least_deg: float = -180.0) -> Longitudes:
    centre = float(np.degrees(np.angle(np.mean(np.exp(1j * np.radians(draws_deg))))))
    mean = (centre - least_deg) % 360.0 + least_deg
    apart = within_half_turn_deg(draws_deg - mean)
    low, high = np.quantile(apart, [0.5 - 0.5 * CREDIBLE, 0.5 + 0.5 * CREDIBLE])
    return Longitudes(mean, float(np.sqrt(np.mean(apart**2))), mean + float(low), mean + float(high), mean + apart)


def regions_near(foot: Footpoint, regions: Iterable[SourceRegion]) -> pd.DataFrame:
    """Regions by how far they are from a footpoint in longitude, turned to its time.

    Returns
    -------
    pandas.DataFrame
        Nearest first: ``kind, name, longitude_deg, latitude_deg, width_deg, remark``; ``distance_deg`` from the mean
        of the footpoint to the middle, west positive; ``edge_deg`` to the nearest edge, 0 inside; ``probability``
        that the footpoint lies between its edges; and ``matches``: it reaches into the 95 per cent interval.
    """
    rows = [_against(foot.stonyhurst, region.at(foot.utc)) for region in regions]
    columns = ["kind", "name", "longitude_deg", "latitude_deg", "width_deg", "remark"]
    columns += ["distance_deg", "edge_deg", "probability", "matches"]
    frame = pd.DataFrame(rows, columns=columns)
    return frame.sort_values(["edge_deg", "name"], kind="stable", ignore_index=True)


def _against(longitude: Longitudes, region: SourceRegion) -> tuple[object, ...]:
    half = 0.5 * region.width_deg
    distance = float(within_half_turn_deg(region.longitude_deg - longitude.mean_deg))
    inside = np.abs(within_half_turn_deg(longitude.draws_deg - region.longitude_deg)) <= half
    low, high = longitude.low_deg - longitude.mean_deg, longitude.high_deg - longitude.mean_deg
    return (
        region.kind,
        region.name,
        region.longitude_deg,
        region.latitude_deg,
        region.width_deg,
        region.remark,
        distance,
        max(abs(distance) - half, 0.0),
        float(np.mean(inside)),
        distance - half <= high and distance + half >= low,
    )


def connection_angles(
    foot: Footpoint, speed_km_s: Mapping[str, float], rotation_period_d: float = SIDEREAL_ROTATION_D
) -> pd.DataFrame:
    """How far from the source each spacecraft was connected to the Sun.

    Parameters
    ----------
    speed_km_s : mapping of str to float
        Solar wind speed at each spacecraft.
    rotation_period_d : float
        Sidereal, days.

    Returns
    -------
    pandas.DataFrame
        ``observatory, range_rsun, longitude_deg`` (Stonyhurst), ``speed_km_s``, ``mapped_deg`` its own footpoint by
        the spiral of that speed, ``connection_angle_deg`` that less the footpoint of the source, west positive, and
        ``connection_angle_sd_deg`` from the draws of the source alone.

    Raises
    ------
    InputError
        If a speed is not above 0, or a spacecraft is not known.
    NoDataError
        If the ephemeris lacks a spacecraft at that time.

    Notes
    -----
    Ballistic mapping along the spiral of Parker 1958, ApJ 128, 664, doi:10.1086/146579 (Nolte & Roelof 1973, Sol. Phys.
    33, 241, doi:10.1007/BF00152395), good to some 10 degrees.
    """
    if not all(np.isfinite(speed) and speed > 0 for speed in speed_km_s.values()):
        raise InputError("a solar wind speed is not above 0: leave that spacecraft out")
    rows = []
    for name, speed in speed_km_s.items():
        (range_rsun,), (longitude,), _ = polar(position(name, [foot.utc], "heeq"))
        bend = float(spiral_longitude_deg(np.array(range_rsun), 0.0, speed, rotation_period_d))
        mapped = float(within_half_turn_deg(longitude - bend))
        apart = float(within_half_turn_deg(mapped - foot.stonyhurst.mean_deg))
        rows.append((name, range_rsun, longitude, speed, mapped, apart, foot.stonyhurst.sd_deg))
    columns = ["observatory", "range_rsun", "longitude_deg", "speed_km_s"]
    columns += ["mapped_deg", "connection_angle_deg", "connection_angle_sd_deg"]
    return pd.DataFrame(rows, columns=columns)


def footpoint_companion(
    phi0_deg: FloatArray,
    utc: np.datetime64,
    observatories: Iterable[str],
    measured_km_s: Mapping[str, float] | None = None,
    regions: Regions | None = None,
) -> dict[str, Any]:
    """Footpoint in solar longitudes, how far from it each spacecraft was connected to the Sun, and what is near it.

    Parameters
    ----------
    phi0_deg : numpy.ndarray, shape (D,)
        HEE longitudes of the spiral at 1 solar radius: draws of a fit, degrees.
    utc : numpy.datetime64
        Time of the burst.
    measured_km_s : mapping of str to float, optional
        Speed of the wind at spacecraft at that time; where there is none it is assumed.
    regions : Regions, optional
        Active regions and coronal holes about that time.

    Returns
    -------
    dict
        Ready for JSON: ``stonyhurst`` and ``carrington`` with mean, sd and quantiles, degrees, ``latitude_deg``; for
        each observatory ``connection_angle_deg``, west positive, with the measured or assumed wind, a slow and a fast
        one; and ``regions``, nearest first.

    Raises
    ------
    InputError
        If there is no draw, or one is not finite.
    """
    foot, measured = footpoint(phi0_deg, utc), measured_km_s or {}
    return {
        "model": "longitude of the joint fit at 1 solar radius; connections by the wind measured at the spacecraft, "
        f"where it was, else one of {ASSUMED_WIND_KM_S:g} km/s, assumed",
        "stonyhurst": longitudes_json(foot.stonyhurst),
        "carrington": longitudes_json(foot.carrington),
        "latitude_deg": foot.latitude_deg,
        "connections": [_connection(foot, name, measured.get(name)) for name in observatories],
        "regions": regions_json(foot, regions or Regions((), (), (), "no regions were given")),
        "flags": [],
    }


def regions_json(foot: Footpoint, given: Regions) -> dict[str, Any]:
    """Regions nearest to a footpoint.

    Returns
    -------
    dict
        Ready for JSON: ``rows`` of :func:`bella.solar_wind.regions_near`, all that match and at least some; or a flag
        and the reason why there is none.
    """
    if given.reason:
        return {"flags": [NOT_COMPUTED], "reason": given.reason}
    near = regions_near(foot, given.regions)
    near = near[near["matches"] | (near.index < NEAREST_REGIONS)].head(MOST_REGIONS)
    return {
        "rows": [{name: _plain(value) for name, value in row.items()} for row in near.to_dict("records")],
        "files": [file.name for file in given.used],
        "left_out": list(given.left_out),
        "flags": [],
    }


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 3)
    return bool(value) if isinstance(value, np.bool_) else value


def longitudes_json(longitude: Longitudes) -> dict[str, float]:
    """Longitude with its uncertainty.

    Returns
    -------
    dict of str to float
        Mean, sd and quantiles, degrees; the quantiles do not jump, so that they may pass 180 or 360.
    """
    quantiles = np.quantile(longitude.draws_deg, list(LEVELS.values())).tolist()
    return {"mean": longitude.mean_deg, "sd": longitude.sd_deg} | dict(zip(LEVELS, quantiles, strict=True))


def _connection(foot: Footpoint, observatory: str, measured_km_s: float | None) -> dict[str, Any]:
    """Connection of one spacecraft; one without an ephemeris has a reason instead."""
    speed = ASSUMED_WIND_KM_S if measured_km_s is None else measured_km_s
    try:
        middle, slow, fast = (
            connection_angles(foot, {observatory: one}, SIDEREAL_ROTATION_D).iloc[0]
            for one in (speed, SLOW_KM_S, FAST_KM_S)
        )
    except (InputError, NoDataError) as error:
        return {"observatory": observatory, "flags": [NOT_COMPUTED], "reason": str(error)}
    angle = "connection_angle_deg"
    return {
        "observatory": observatory,
        "connection_angle_deg": {"mean": float(middle[angle]), "sd": float(middle[f"{angle[:-4]}_sd_deg"])},
        "mapped_deg": float(middle["mapped_deg"]),
        "v_sw_km_s": speed,
        "measured": measured_km_s is not None,
        "at_300_km_s_deg": float(slow[angle]),
        "at_600_km_s_deg": float(fast[angle]),
        "flags": [],
    }

"""Footpoint of a burst and the spacecraft that were connected to it, as they are stored and served."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from bella.exceptions import InputError, NoDataError
from bella.flags import NOT_COMPUTED
from bella.heliosphere import SIDEREAL_ROTATION_D
from bella.solar_wind.context import Footpoint, Longitudes, connection_angles, footpoint, regions_near
from bella.solar_wind.folder import Regions
from bella.units import FloatArray

ASSUMED_WIND_KM_S = 400.0
SLOW_KM_S, FAST_KM_S = 300.0, 600.0
NEAREST_REGIONS, MOST_REGIONS = 3, 8
"""Regions that are kept although they do not match, and at most."""

LEVELS = {"q2_5": 0.025, "q16": 0.16, "q50": 0.5, "q84": 0.84, "q97_5": 0.975}


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
    observatories : iterable of str
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

    Parameters
    ----------
    foot : Footpoint
    given : Regions

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

    Parameters
    ----------
    longitude : Longitudes

    Returns
    -------
    dict of str to float
        Mean, sd and quantiles, degrees; the quantiles do not jump, so that they may pass 180 or 360.
    """
    quantiles = np.quantile(longitude.draws_deg, list(LEVELS.values())).tolist()
    return {"mean": longitude.mean_deg, "sd": longitude.sd_deg} | dict(zip(LEVELS, quantiles, strict=True))


def _connection(foot: Footpoint, observatory: str, measured_km_s: float | None) -> dict[str, Any]:
    """Connection of one spacecraft; an unknown one does not take those of the others away."""
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

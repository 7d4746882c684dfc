"""Footpoint of a burst and the spacecraft that were connected to it, as they are stored and served."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from bella.exceptions import InputError, NoDataError
from bella.flags import NOT_COMPUTED
from bella.heliosphere import SIDEREAL_ROTATION_D
from bella.solar_wind.context import Footpoint, Longitudes, connection_angles, footpoint
from bella.units import FloatArray

ASSUMED_WIND_KM_S = 400.0
SLOW_KM_S, FAST_KM_S = 300.0, 600.0
LEVELS = {"q2_5": 0.025, "q16": 0.16, "q50": 0.5, "q84": 0.84, "q97_5": 0.975}


def footpoint_companion(phi0_deg: FloatArray, utc: np.datetime64, observatories: Iterable[str]) -> dict[str, Any]:
    """Footpoint in solar longitudes, and how far from it each spacecraft was connected to the Sun.

    Parameters
    ----------
    phi0_deg : numpy.ndarray, shape (D,)
        HEE longitudes of the spiral at 1 solar radius: draws of a fit, degrees.
    utc : numpy.datetime64
        Time of the burst.
    observatories : iterable of str

    Returns
    -------
    dict
        Ready for JSON: ``stonyhurst`` and ``carrington`` with mean, sd and quantiles, degrees, ``latitude_deg``, and
        for each observatory ``connection_angle_deg``, west positive, with the assumed wind, a slow and a fast one.

    Raises
    ------
    InputError
        If there is no draw, or one is not finite.
    """
    foot = footpoint(phi0_deg, utc)
    return {
        "model": f"longitude of the joint fit at 1 solar radius; connections by a wind of {ASSUMED_WIND_KM_S:g} km/s, "
        "assumed",
        "stonyhurst": longitudes_json(foot.stonyhurst),
        "carrington": longitudes_json(foot.carrington),
        "latitude_deg": foot.latitude_deg,
        "connections": [_connection(foot, name) for name in observatories],
        "flags": [],
    }


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


def _connection(foot: Footpoint, observatory: str) -> dict[str, Any]:
    """Connection of one spacecraft; an unknown one does not take those of the others away."""
    try:
        middle, slow, fast = (
            connection_angles(foot, {observatory: speed}, SIDEREAL_ROTATION_D).iloc[0]
            for speed in (ASSUMED_WIND_KM_S, SLOW_KM_S, FAST_KM_S)
        )
    except (InputError, NoDataError) as error:
        return {"observatory": observatory, "flags": [NOT_COMPUTED], "reason": str(error)}
    angle = "connection_angle_deg"
    return {
        "observatory": observatory,
        "connection_angle_deg": {"mean": float(middle[angle]), "sd": float(middle[f"{angle[:-4]}_sd_deg"])},
        "mapped_deg": float(middle["mapped_deg"]),
        "v_sw_km_s": ASSUMED_WIND_KM_S,
        "at_300_km_s_deg": float(slow[angle]),
        "at_600_km_s_deg": float(fast[angle]),
        "flags": [],
    }

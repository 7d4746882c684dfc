"""What the page of a burst says of wave directions and of the fit to everything that is known."""

from collections.abc import Mapping
from typing import Any

from api.rendering import written_interval, written_number
from bella.flags import DISAGREE_SD

Fit = Mapping[str, Any]
INGREDIENTS = {"wave_directions": "wave directions", "wind_prior": "speeds of the measured wind"}


def crossing_words(companions: Fit) -> str:
    """Where wave directions cross.

    Parameters
    ----------
    companions : mapping
        As stored.

    Returns
    -------
    str
        Empty where no burst of that solution has directions of two spacecraft.
    """
    rows = [row for row in companions.get("triangulation", {}).get("rows", []) if row["range_rsun"] is not None]
    if not rows:
        return ""
    names = ", ".join(dict.fromkeys(name for row in rows for name in row["observatories"]))
    return f"Those of {names} come closest, distance and longitude: {'; '.join(map(_placed, rows))}."


def _placed(row: Fit) -> str:
    distance = written_interval({"mean": row["range_rsun"], "sd": row["range_sd_rsun"]}, 0)
    longitude = f"{written_number(row['longitude_deg'])}°"
    where = " (behind a spacecraft)" if row["flags"] else ""
    return f"{row['frequency_mhz']:.2g} MHz at {distance} R☉, {longitude}{where}"


def fused_words(companions: Fit) -> str:
    """What each ingredient adds to the fit of everything.

    Parameters
    ----------
    companions : mapping
        As stored.

    Returns
    -------
    str
        Empty where there are arrival times alone.
    """
    ingredients = companions.get("fused", {}).get("ingredients")
    return " ".join(_ingredient(one) for one in ingredients) if ingredients else ""


def _ingredient(one: Fit) -> str:
    longitude, wind = (f"{one['sd_ratio'][parameter]:.2f}" for parameter in ("phi0_deg", "v_sw_km_s"))
    apart = " They contradict the others." if one["tension"] > DISAGREE_SD else ""
    return (
        f"With the {INGREDIENTS[one['name']]} the 68 % interval of the longitude is {longitude} times and that of the "
        f"wind {wind} times as wide as without; they move the answer by {one['tension']:.1f} standard "
        f"deviations.{apart}"
    )

"""Wind around a burst, its footpoint and the regions near it, as the burst page shows them."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from api.rendering import DASH, written_interval, written_number, written_speed
from bella.answer import interval_68

Fit = Mapping[str, Any]
APART_SD = 2.0


@dataclass(frozen=True)
class WindTable:
    """What spacecraft measured of the wind, and what the wind that explains it is there.

    Attributes
    ----------
    rows : list of (str, str, str, str)
        Spacecraft; speed measured at the burst; that of the model, with its error; root mean square error of the
        climate, and of the wind of the other spacecraft.
    note : str
        How it was made; where it was not, why.
    """

    rows: list[tuple[str, str, str, str]]
    note: str


def wind_table(tracks: Iterable[Fit]) -> WindTable | None:
    """Table of the wind around a burst, which all its solutions share.

    Parameters
    ----------
    tracks : iterable of mapping
        Track fits as kept in the catalogue.

    Returns
    -------
    WindTable or None
        None where no solution says anything of the wind.
    """
    known = [wind for track in tracks if (wind := track.get("companions", {}).get("wind"))]
    if not known:
        return None
    wind = next((one for one in known if "observatories" in one), known[0])
    if "observatories" not in wind:
        return WindTable([], f"Not computed: {wind.get('reason', 'no reason is kept')}.")
    return WindTable([_row(one) for one in wind["observatories"]], _note(wind))


def _row(one: Fit) -> tuple[str, str, str, str]:
    measured = one.get("measured_km_s")
    shown = DASH if measured is None else f"{measured:.0f}"
    misfit = f"{one['prior_rmse_km_s']:.0f} \N{RIGHTWARDS ARROW} {one['rmse_km_s']:.0f}"
    return one["observatory"], shown, written_interval(one["v_sw_km_s"], 0), misfit


def _note(wind: Fit) -> str:
    left_out = _left_out(wind)
    inner = wind["boundary"]["range_rsun"]
    tested = ", ".join(f"{one['observatory']} {one['z_rms']:.2f}" for one in wind["observatories"] if "z_rms" in one)
    test = f" Error over its stated size where a spacecraft was left out, rms: {tested}." if tested else ""
    return (
        f"Hourly speeds of {wind['days']:.0f} days around the burst, explained by a wind that rotates with the Sun "
        f"from {inner:.0f} R☉ on, and by a model error that is correlated in longitude, time and distance. The last "
        "column is the error in km/s of the climate, and of the wind of the other spacecraft where this one was left "
        f"out.{test}{left_out}"
    )


def _left_out(one: Fit) -> str:
    return "".join(f" {words[0].upper()}{words[1:]}." for words in one.get("left_out", ()))


def track_wind_words(track: Fit) -> str:
    """The wind along a track, and its field line against the fitted spiral.

    Parameters
    ----------
    track : mapping
        Track fit as kept in the catalogue.

    Returns
    -------
    str
        Empty where the wind was not computed.
    """
    wind, joint = track.get("companions", {}).get("wind", {}), track.get("joint") or {}
    if "along_track" not in wind:
        return ""
    return " ".join(filter(None, (_along(wind["along_track"], joint), _line(wind["field_line"], joint))))


def _along(steps: list[Fit], joint: Fit) -> str:
    if not steps:
        return ""
    shown = [steps[0], *steps[1:-1][len(steps[1:-1]) // 2 :][:1], *steps[1:][-1:]]
    each = ", ".join(f"{written_interval(one['v_sw_km_s'], 0)} km/s at {one['range_rsun']:.0f} R☉" for one in shown)
    return f"Along the spiral {each}; for the joint fit: {written_speed(joint, ' km/s')}."


def _line(line: Fit, joint: Fit) -> str:
    if "phi0_deg" not in line:
        return f"No field line: {line['reason']}."
    apart, sd = line["apart_deg"], math.hypot(line["phi0_deg"]["sd"], joint["phi0_deg"]["sd"])
    verdict = "more than" if abs(apart) > APART_SD * sd else "within what"
    turned = f"{written_number(abs(apart))}° {'west' if apart >= 0 else 'east'} of the spiral"
    return (
        f"The field line of this wind through the spiral at {line['through_rsun']:.0f} R☉, the middle of the track, "
        f"meets the Sun at {_middle(line['phi0_deg'])}°, {turned}, {verdict} their errors allow."
    )


def footpoint_words(foot: Fit) -> str:
    """Footpoint with its intervals, the connection of each spacecraft, and the regions near it.

    Parameters
    ----------
    foot : mapping
        As it is stored.

    Returns
    -------
    str
        Empty where nothing is stored.
    """
    if "stonyhurst" not in foot:
        return f"not computed: {foot['reason']}" if "reason" in foot else ""
    places = "; ".join(f"{name.capitalize()} {_interval(foot[name])}" for name in ("stonyhurst", "carrington"))
    each = [f"{one['observatory']} {_connection(one)}" for one in foot["connections"]]
    return (
        f"{places}. The spacecraft were connected to places so far west of it (negative: east), by the wind at each "
        f"and in brackets by 600 to 300 km/s: {', '.join(each)}.{_regions(foot.get('regions', {}))}"
    )


def _interval(longitude: Fit) -> str:
    low68, high68, low95, high95 = (written_number(longitude[end]) for end in ("q16", "q84", "q2_5", "q97_5"))
    return f"{_middle(longitude)}° (68 %: {low68} to {high68}°, 95 %: {low95} to {high95}°)"


def _middle(longitude: Fit) -> str:
    known = interval_68(longitude)
    return written_number(known[0]) if known else DASH


def _connection(one: Fit) -> str:
    if "connection_angle_deg" not in one:
        return "not known"
    ends = (written_number(one[f"at_{speed}_km_s_deg"]) for speed in (600, 300))
    kind = "measured" if one.get("measured") else "assumed"
    wind = f"by {one.get('v_sw_km_s', 400.0):.0f} km/s, {kind}"
    return f"{_middle(one['connection_angle_deg'])}° {wind} ({' to '.join(ends)}°)"


def _regions(regions: Fit) -> str:
    """Regions near a footpoint; where none were asked for, the page has nothing to say."""
    if "rows" not in regions:
        return ""
    left_out = _left_out(regions)
    if not regions["rows"]:
        return f" No active region or coronal hole is listed.{left_out}"
    each = "; ".join(_region(one) for one in regions["rows"])
    return (
        " Nearest on the Sun (Stonyhurst longitude, and the probability that the footpoint lies in its extent; a hint "
        f"only, as the field below 2.5 R☉ spreads): {each}.{left_out}"
    )


def _region(one: Fit) -> str:
    inside = "" if one["matches"] else ", outside the 95 % interval"
    return f"{one['kind']} {one['name']} at {written_number(one['longitude_deg'])}°, {one['probability']:.2f}{inside}"

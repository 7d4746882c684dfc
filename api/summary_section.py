"""Where a burst was and how well that is known, in one paragraph at the head of the section about tracks."""

from collections.abc import Mapping
from typing import Any

from api.rendering import DASH, written_interval, written_number, written_speed
from api.wording import flag_meaning
from bella.answer import NO_SPIRAL, NOT_MEASURED, interval_68, wind_gap

Fit = Mapping[str, Any]
DOUBTS = frozenset({"several_tracks", "poor_fit", "poor_weights", "phi0_not_constrained", "ingredients_disagree"})
RESTS_ON = "The errors hold if one beam on one spiral is what happened, and if its waves came straight."


def summary_words(edge: str, track: Fit) -> str:
    """Where the source went, where its field line starts, and what the errors rest on.

    Parameters
    ----------
    edge : str
        Words for the definition of the edge that the track was timed by.
    track : mapping
        Track fit as kept in the catalogue.

    Returns
    -------
    str
        Empty where the track has no joint fit with a longitude.
    """
    joint = track.get("joint") or {}
    if (joint.get("phi0_deg") or {}).get("mean") is None:
        return ""
    beside = track.get("companions", {})
    way = _way(beside.get("density_excess", {}))
    named = edge if edge.startswith("Gauss") else edge[0].lower() + edge[1:]
    said = [
        f"Timed by its {named}, {way}its field line starts at the Sun at {_place(joint)}; positive: west of Earth.",
        _measured(beside.get("fused", {})),
        *(_doubts(joint) or [RESTS_ON]),
    ]
    return " ".join(filter(None, said))


def _doubts(joint: Fit) -> list[str]:
    """What says that the errors do not hold."""
    return [flag_meaning(flag) for flag in joint.get("flags", ()) if flag in DOUBTS]


def _way(excess: Fit) -> str:
    """Distances at the highest and the lowest frequency."""
    rows = sorted(filter(_has_distance, excess.get("rows", [])), key=lambda row: -row["frequency_mhz"])
    if len(rows) < 2:
        return ""
    first, last = (
        f"{written_interval({'mean': row['range_rsun'], 'sd': row['range_sd_rsun']}, 0)} R☉ from the Sun at "
        f"{row['frequency_mhz']:.2g} MHz"
        for row in (rows[0], rows[-1])
    )
    return f"the burst appears {first} and {last}; "


def _has_distance(row: Fit) -> bool:
    """Whether a source is farther from the Sun than its error."""
    distance = row.get("range_rsun")
    return distance is not None and distance > (row["range_sd_rsun"] or 0.0)


def _place(fit: Fit) -> str:
    """Longitude with its intervals, and the wind of a fit, or that there is none."""
    phi0 = fit["phi0_deg"]
    parts = [("68 %", "q16", "q84"), ("95 %", "q2_5", "q97_5")]
    known = [(name, phi0.get(low), phi0.get(high)) for name, low, high in parts]
    ends = [f"{name}: {written_number(a)} to {written_number(b)}°" for name, a, b in known if None not in {a, b}]
    within = f" ({', '.join(ends)})" if ends else ""
    gap = wind_gap(fit)
    words = {NO_SPIRAL: ", and no speed of the wind follows", NOT_MEASURED: "; the speed of the wind is not measured"}
    speed = words.get(gap) or (f", in a wind of {written_speed(fit)} km/s" if interval_68(fit.get("v_sw_km_s")) else "")
    middle, *_ = interval_68(phi0) or (None,)
    return f"{written_number(middle)}°{within}{speed}" if middle is not None else DASH


def _measured(fused: Fit) -> str:
    """The same by the fit to all that is known, where it knows more than arrival times."""
    if (fused.get("phi0_deg") or {}).get("mean") is None:
        return ""
    known = {"wave_directions": "wave directions", "wind_prior": "the wind measured in situ"}
    names = [known[one["name"]] for one in fused.get("ingredients", ()) if one["name"] in known]
    return f"With {' and '.join(names)}: {_place(fused)}." if names else ""

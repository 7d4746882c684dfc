"""What the page of a burst says of the models of beam, density and wind that were weighed."""

from collections.abc import Mapping
from typing import Any

from api.rendering import written_interval, written_speed

Fit = Mapping[str, Any]
PLAIN = "free distance, free time of emission"
"""Name of the model of the joint fit."""

WORTH_NAMING = 0.1
"""Probability from which a model is named."""


def model_words(companions: Fit) -> str:
    """Models by their probability, and the longitude whichever it is.

    Parameters
    ----------
    companions : mapping
        As stored.

    Returns
    -------
    str
        Empty where none were weighed.
    """
    found = companions.get("models", {})
    if not found.get("rows"):
        return ""
    each = "; ".join(_model(row) for row in found["rows"] if row["probability"] >= WORTH_NAMING)
    return (
        f"Probability by the arrival times alone, longitude and wind: {each}. Averaged over all, the longitude is "
        f"{written_interval(found['phi0_deg'], 1)}°."
    )


def _model(row: Fit) -> str:
    return f"{_words(row['name'])} {row['probability']:.0%}, {written_interval(row['phi0_deg'], 1)}°, {_wind(row)}"


def _words(name: str) -> str:
    return "as the joint fit has it" if name == PLAIN else name.removeprefix(f"{PLAIN}, ")


def _wind(row: Fit) -> str:
    """Speed of the wind; where it changes on the way, that of each part."""
    parts = row.get("winds") or []
    if len(parts) < 2:
        return written_speed(row, " km/s")
    flags = row.get("flags", ())
    speeds = [written_speed({"v_sw_km_s": part["v_sw_km_s"], "flags": flags}, " km/s") for part in parts]
    beyond = [f" beyond {part['from_rsun']:.0f} R☉" for part in parts[1:]]
    return ", then ".join(speed + where for speed, where in zip(speeds, ["", *beyond], strict=True))

"""What the page of a burst says of the models of beam, density and wind that were weighed."""

from collections.abc import Mapping
from typing import Any

from api.rendering import written_interval, written_speed

Fit = Mapping[str, Any]
PLAIN = "joint spiral"
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
    named = [row for row in found["rows"] if row["probability"] >= WORTH_NAMING]
    each = "; ".join(
        f"{_words(row['name'])} {row['probability']:.0%}, {written_interval(row['phi0_deg'], 1)}°, "
        f"{written_speed(row, ' km/s')}"
        for row in named
    )
    return (
        f"Probability by the arrival times alone, longitude and wind: {each}. Averaged over all, the longitude is "
        f"{written_interval(found['phi0_deg'], 1)}°."
    )


def _words(name: str) -> str:
    return name.removeprefix(f"{PLAIN}, ") if name != PLAIN else "as the joint fit has it"

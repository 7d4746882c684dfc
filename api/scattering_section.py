"""What the page of a burst says of scattering: apparent and corrected sources, and the wind of the corrected spiral."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from api.rendering import DASH, written_interval, written_speed

Fit = Mapping[str, Any]

HARMONICS = ("fundamental", "harmonic")


class ScatteringTable(NamedTuple):
    """Rows of cells, one per frequency, and the sentence below them."""

    rows: list[list[str]]
    words: str


def scattering_table(companions: Fit) -> ScatteringTable | None:
    """Table of apparent and corrected sources.

    Parameters
    ----------
    companions : mapping
        As stored: ``scattering``, and ``density_excess`` for what is not corrected.

    Returns
    -------
    ScatteringTable or None
        None where a solution does not have the companion; without rows, and with the reason, where it was not computed.
    """
    found = companions.get("scattering")
    if not found:
        return None
    if "rows" not in found:
        return ScatteringTable([], f"not computed: {found.get('reason', '')}")
    apparent = {row["frequency_mhz"]: row for row in companions.get("density_excess", {}).get("rows", [])}
    rows = [_row(row, apparent.get(row["frequency_mhz"], {})) for row in found["rows"]]
    return ScatteringTable(rows, _words(found))


def _row(row: Fit, apparent: Fit) -> list[str]:
    cells = [_two_digits(row["frequency_mhz"]), _distance(row["apparent_rsun"], row["apparent_sd_rsun"])]
    cells.append(_ratio(apparent.get("harmonic")))
    for word in HARMONICS:
        one = row[word]
        late = DASH if one["delay_s"] is None else f"{one['delay_s']:.0f}"
        cells += [_distance(one["range_rsun"], one["range_sd_rsun"]), late, _ratio(one["excess"])]
    return cells


def _distance(value: float | None, sd: float | None) -> str:
    return written_interval({"mean": value, "sd": sd}, 1)


def _ratio(value: Fit | None) -> str:
    return DASH if not value or value["mean"] is None else _two_digits(value["mean"])


def _two_digits(value: float) -> str:
    return f"{value:#.2g}".rstrip(".")


def _words(found: Fit) -> str:
    spirals = [
        f"{longitude}° and {wind} as {word}"
        for word, spiral in found["joint"].items()
        for longitude, wind in [(written_interval(spiral["phi0_deg"], 1), written_speed(spiral, " km/s"))]
    ]
    moved = (
        f" With sources moved outward only, the spiral of the joint fit becomes {', '.join(spirals)}; moved along the "
        "field they would leave it as it is."
        if spirals
        else ""
    )
    return f"Model: {found['source']}. Not in the errors: {found['not_in_errors']}.{moved}"

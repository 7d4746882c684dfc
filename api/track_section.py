"""The section of the burst page about tracks: parameters by method, and what their disagreements mean."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, NamedTuple

from api.direction_section import crossing_words, fused_words
from api.model_section import model_words
from api.remarks import remarks_of
from api.rendering import DASH, written_interval, written_number, written_speed
from api.scattering_section import ScatteringTable, scattering_table
from api.schemas import SolutionReply
from api.wind_section import footpoint_words, track_wind_words
from bella.answer import NO_SPIRAL, interval_68, wind_gap

Fit = Mapping[str, Any]

METHODS = {
    "joint": "Joint",
    "fused": "Fused",
    "two_step": "Two-step",
    "piecewise": "Piecewise",
    "semp": "SEMP",
    "published": "Paper",
}
ROWS = {
    "phi0_deg": ("φ₀ at 1 R☉ (°)", 1),
    "v_sw_km_s": ("Solar wind (km/s)", 0),
    "beam_speed_c": ("Beam (c)", 3),
    "release_utc": ("Beam at 1 R☉ (UTC)", 0),
}
"""Words and decimals of each parameter."""


class Cell(NamedTuple):
    """What a method says of a parameter, and its 95 % interval where that is not the one of a Gaussian."""

    words: str
    interval: str = ""


@dataclass(frozen=True)
class TrackSection:
    """What the page says of the track of one solution.

    Attributes
    ----------
    solution : SolutionReply
    methods : list of str
        Words of the columns.
    rows : list of (str, list of Cell)
        Parameter, and what each method says of it.
    remarks : list of str
    footpoint : str
        Where the field line starts on the Sun, and which spacecraft was connected to there; empty where not asked.
    wind : str
        The measured wind along the track; empty where there is none.
    figures : list of (str, str, str)
        Title, address and description of each figure that was drawn.
    scattering : ScatteringTable or None
        Apparent and corrected sources; None where not asked.
    directions : str
        Where wave directions cross; empty where there are none.
    fused : str
        What each ingredient adds to the fused fit; empty where there are arrival times alone.
    models : str
        Models by their evidence; empty where none were weighed.
    """

    solution: SolutionReply
    methods: list[str]
    rows: list[tuple[str, list[Cell]]]
    remarks: list[str]
    footpoint: str
    wind: str
    figures: list[tuple[str, str, str]]
    scattering: ScatteringTable | None = None
    directions: str = ""
    fused: str = ""
    models: str = ""


def track_section(solution: SolutionReply, track: Fit, figures: list[tuple[str, str, str]]) -> TrackSection | None:
    """Section of a solution.

    Parameters
    ----------
    solution : SolutionReply
    track : mapping
        Track fit as kept in the catalogue.
    figures : list of (str, str, str)

    Returns
    -------
    TrackSection or None
        None where the solution was published without a joint fit.
    """
    if not track.get("joint"):
        return None
    fits = fits_of(track)
    rows = [(words, [cell(fit, name, digits) for fit in fits.values()]) for name, (words, digits) in ROWS.items()]
    rows += [("Residual", [Cell(_residual(fit)) for fit in fits.values()])]
    rows += [("Rotation period (d)", [Cell(_period(fit)) for fit in fits.values()])]
    beside = track.get("companions", {})
    foot = footpoint_words(beside.get("footpoint", {}))
    methods, remarks = [METHODS[name] for name in fits], remarks_of(fits, track)
    wind, scattered = track_wind_words(track), scattering_table(beside)
    more = crossing_words(beside), fused_words(beside), model_words(beside)
    return TrackSection(solution, methods, rows, remarks, foot, wind, figures, scattered, *more)


def fits_of(track: Fit) -> dict[str, Fit]:
    """Fits of a track by method, in the order of the columns.

    Parameters
    ----------
    track : mapping

    Returns
    -------
    dict of str to mapping
    """
    known = {**track.get("companions", {}), **track}
    # most bursts have arrival times alone, and a column of dashes says no more than the joint one
    return {name: known[name] for name in METHODS if known.get(name) and (name != "fused" or "phi0_deg" in known[name])}


def cell(fit: Fit, name: str, digits: int) -> Cell:
    """What a method says of a parameter.

    Parameters
    ----------
    fit : mapping
    name : str
        Such as ``phi0_deg``.
    digits : int
        Decimals.

    Returns
    -------
    Cell
        Median with its 68 % interval; a dash where there is nothing.
    """
    if name == "v_sw_km_s" and wind_gap(fit):
        return Cell(wind_gap(fit))
    if name == "v_sw_km_s" and fit.get("segments"):
        return Cell(", ".join(_segment(one) for one in fit["segments"]))
    value = fit.get(name)
    if isinstance(value, int | float):
        return Cell(f"{value:.{digits}f} assumed")
    if name == "release_utc":
        return Cell(_moment(value or {}))
    return Cell(written_interval(value, digits), _within(value, digits))


def _within(value: Fit | None, digits: int) -> str:
    if not value or "contraction" not in value or value.get("q2_5") is None:
        return ""
    low, high = (written_number(value[end], digits) for end in ("q2_5", "q97_5"))
    return f"{low} to {high}"


def _segment(segment: Fit) -> str:
    return NO_SPIRAL if interval_68(segment["v_sw_km_s"]) is None else written_speed(segment)


def _moment(value: Fit) -> str:
    """Time of day with its 68 % interval."""
    middle, low, high = (value.get(name) for name in ("q50", "q16", "q84"))
    if middle and low and high:
        return f"{middle[11:19]} ({low[11:19]} to {high[11:19]})"
    if not value.get("mean"):
        return DASH
    mean, sd = datetime.fromisoformat(value["mean"]), timedelta(seconds=value.get("sd") or 0.0)
    return f"{mean:%H:%M:%S} ({mean - sd:%H:%M:%S} to {mean + sd:%H:%M:%S})"


def _residual(fit: Fit) -> str:
    if fit.get("rms_s") is not None:
        return f"{fit['rms_s']:.0f} s"
    return f"{fit['rms_deg']:.1f}°" if fit.get("rms_deg") is not None else DASH


def _period(fit: Fit) -> str:
    period = fit.get("rotation_period_d")
    return f"{period:.2f}" if period else DASH

"""What the page of a burst needs to speak of its track: methods side by side, and how far they disagree, as numbers."""

import math
from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from api.drawing import Looked
from api.links import figure_path
from bella.answer import interval_68
from bella.catalogue import Solution
from bella.flags import DISAGREE_SD
from bella.settings import COLLAPSED_FIGURE, WIND_FIGURE, Settings
from bella.units import within_half_turn_deg

Fit = Mapping[str, Any]

METHODS = ("joint", "fused", "two_step", "piecewise", "semp", "published")
FIGURES = (WIND_FIGURE, COLLAPSED_FIGURE)
DOUBTS = frozenset({"several_tracks", "poor_fit", "poor_weights", "phi0_not_constrained", "ingredients_disagree"})
"""Flags with which the errors of a joint fit do not hold."""

NOTABLE = 3.0
"""Ratio of errors from which one is called too small."""

APART_SD = 2.0
LARGE_MISFIT = 1.5
"""Ratio from which a misfit, or a difference of beams, is worth a sentence."""

PLAIN_MODEL = "free distance, free time of emission"
"""Name of the model of the joint fit."""

WORTH_NAMING = 0.1
"""Probability from which a model is named."""


def track_page(looked: Looked, settings: Settings) -> dict[str, Any]:
    """What the templates need for the track of the answer that is shown."""
    solution, track = looked.shown, looked.track
    if solution is None or not track.get("joint"):
        return {"track": None, "fits": {}, "facts": {}, "kept_figures": []}
    return {
        "track": track,
        "fits": fits_of(track),
        "facts": facts_of(track),
        "kept_figures": _kept(solution, settings),
    }


def _kept(solution: Solution, settings: Settings) -> list[tuple[str, Markup, str]]:
    """Name, drawing and address of the figures that the run has drawn; a run may have been killed before it did."""
    paths = [(name, settings.solution_figure(solution.burst_id, solution.solution_id, name)) for name in FIGURES]
    return [
        (name, Markup(path.read_text(encoding="utf-8")), figure_path(solution, name))  # noqa: S704
        for name, path in paths
        if path.is_file()
    ]


def fits_of(track: Fit) -> dict[str, Fit]:
    """Fits of a track by method, in the order of the columns.

    Parameters
    ----------
    track : mapping
        Track fit as kept in the catalogue.
    """
    known = {**track.get("companions", {}), **track}
    # most bursts have arrival times alone, and a column of dashes says no more than the joint one
    return {name: known[name] for name in METHODS if known.get(name) and (name != "fused" or "phi0_deg" in known[name])}


def facts_of(track: Fit) -> dict[str, Any]:
    """Numbers that the sentences about a track are made with; None where there is nothing to say.

    Parameters
    ----------
    track : mapping
        Track fit as kept in the catalogue.

    Returns
    -------
    dict
        `has_longitude`; `way`, rows of the highest and the lowest frequency with a distance; `doubts`, flags;
        `too_small`, `rotation`, `semp`, `paper`, how methods disagree; `crossings`; `models`; `line`, the field line of
        the measured wind; `along`, wind at the begin, the middle and the end of the track.
    """
    joint, beside = track.get("joint") or {}, track.get("companions", {})
    two_step, semp = track.get("two_step") or {}, beside.get("semp") or {}
    wind = beside.get("wind") or {}
    models = [one for one in (beside.get("models") or {}).get("rows", ()) if one["probability"] >= WORTH_NAMING]
    crossings = (beside.get("triangulation") or {}).get("rows", ())
    return {
        "has_longitude": _mean(joint, "phi0_deg") is not None,
        "way": _way(beside.get("density_excess") or {}),
        "doubts": [flag for flag in joint.get("flags", ()) if flag in DOUBTS],
        "too_small": _too_small(joint, two_step),
        "rotation": _rotation(track, two_step),
        "semp": _against_semp(joint, semp),
        "paper": _against_paper(joint, track.get("published") or {}),
        "crossings": [row for row in crossings if row["range_rsun"] is not None],
        "models": models,
        "line": _line(wind.get("field_line"), joint),
        "along": _three(wind.get("along_track") or []),
        "disagree_sd": DISAGREE_SD,
        "plain_model": PLAIN_MODEL,
    }


def _way(excess: Fit) -> tuple[Fit, Fit] | None:
    """Sources of the highest and the lowest frequency that are farther from the Sun than their errors."""
    known = [row for row in excess.get("rows", ()) if row.get("range_rsun") is not None]
    known = [row for row in known if row["range_rsun"] > (row["range_sd_rsun"] or 0.0)]
    ordered = sorted(known, key=lambda row: -row["frequency_mhz"])
    return (ordered[0], ordered[-1]) if len(ordered) > 1 else None


def _three(steps: list[Fit]) -> list[Fit]:
    return [steps[0], *steps[1:-1][len(steps[1:-1]) // 2 :][:1], *steps[1:][-1:]] if steps else []


def _too_small(joint: Fit, line: Fit) -> dict[str, float] | None:
    mine, formal = _sd(joint, "v_sw_km_s"), _sd(line, "v_sw_km_s")
    if not mine or not formal or mine < NOTABLE * formal:
        return None
    return {"formal": formal, "mine": mine, "ratio": mine / formal}


def _rotation(track: Fit, two_step: Fit) -> dict[str, Any] | None:
    other = next(iter(track.get("two_step_other_rotations", {}).items()), None)
    if other is None or not _mean(two_step, "v_sw_km_s") or not _mean(other[1], "v_sw_km_s"):
        return None
    return {"other": other[0], "change": float(track["rotation_period_d"]) / float(other[0]) - 1.0}


def _against_semp(joint: Fit, semp: Fit) -> dict[str, Any] | None:
    if _mean(joint, "phi0_deg") is None or _mean(semp, "phi0_deg") is None:
        return None
    apart = abs(within_half_turn_deg(float(joint["phi0_deg"]["mean"] - semp["phi0_deg"]["mean"])))
    error = math.hypot(_sd(joint, "phi0_deg") or 0.0, _sd(semp, "phi0_deg") or 0.0)
    mine, theirs = _mean(joint, "beam_speed_c"), _mean(semp, "beam_speed_c")
    is_other = bool(mine and theirs and max(mine, theirs) >= LARGE_MISFIT * min(mine, theirs))
    return {
        "apart_deg": apart,
        "is_more": apart > APART_SD * error,
        "misfit": semp if semp.get("error_scale", 1.0) >= LARGE_MISFIT else None,
        "beams": (mine, theirs) if is_other else None,
    }


def _against_paper(joint: Fit, paper: Fit) -> int | None:
    """How many of two numbers of a paper the 95 % intervals of the joint fit hold."""
    if not paper or _mean(joint, "phi0_deg") is None:
        return None
    ends = [(joint[name], paper[name]["mean"]) for name in ("phi0_deg", "v_sw_km_s")]
    return sum(bool(mine["q2_5"] <= theirs <= mine["q97_5"]) for mine, theirs in ends)


def _line(line: Fit | None, joint: Fit) -> dict[str, Any] | None:
    """Field line of the measured wind: why there is none, or where it starts beside the fitted spiral."""
    if not line:
        return None
    if "phi0_deg" not in line:
        return {"reason": line["reason"]}
    sd = math.hypot(line["phi0_deg"]["sd"], joint["phi0_deg"]["sd"])
    middle = interval_68(line["phi0_deg"])
    return {
        "phi0_deg": middle[0] if middle else None,
        "through_rsun": line["through_rsun"],
        "apart_deg": line["apart_deg"],
        "is_more": abs(line["apart_deg"]) > APART_SD * sd,
    }


def _mean(fit: Fit, name: str) -> float | None:
    value = fit.get(name)
    return value.get("mean") if isinstance(value, Mapping) else None


def _sd(fit: Fit, name: str) -> float | None:
    value = fit.get(name)
    return value.get("sd") if isinstance(value, Mapping) else None

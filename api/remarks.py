"""Why the methods do not agree about a track, in plain English and from their numbers."""

import math
from collections.abc import Mapping
from typing import Any

from api.wording import flag_meaning
from bella.units import within_half_turn_deg

Fit = Mapping[str, Any]
SAID = frozenset({"formal_errors"})
NOTABLE = 3.0
"""Ratio of errors from which one is called too small."""

APART_SD = 2.0
LARGE_MISFIT = 1.5
"""Ratio from which a misfit, or a difference of beams, is worth a sentence."""


def remarks_of(fits: Mapping[str, Fit], track: Fit) -> list[str]:
    """Remarks on the disagreements of one solution.

    Parameters
    ----------
    fits : mapping of str to mapping
        By method.
    track : mapping
        Track fit as kept in the catalogue.

    Returns
    -------
    list of str
    """
    joint = fits.get("joint", {})
    said = [
        _too_small(joint, fits.get("two_step", {})),
        _rotation(track),
        _against_semp(joint, fits.get("semp", {})),
        _pieces(fits.get("piecewise", {})),
        _against_paper(joint, fits.get("published", {})),
        *(_flags(name, fits.get(name, {})) for name in ("joint", "piecewise", "semp")),
    ]
    return [remark for remark in said if remark]


def _turn(one: Fit, other: Fit) -> float:
    """Angle between two longitudes, degrees."""
    return abs(within_half_turn_deg(float(one["phi0_deg"]["mean"] - other["phi0_deg"]["mean"])))


def _joint_sd(one: Fit, other: Fit) -> float:
    return float(math.hypot(_sd(one, "phi0_deg") or 0.0, _sd(other, "phi0_deg") or 0.0))


def _too_small(joint: Fit, line: Fit) -> str:
    mine, formal = _sd(joint, "v_sw_km_s"), _sd(line, "v_sw_km_s")
    if not mine or not formal or mine < NOTABLE * formal:
        return ""
    return (
        f"The two-step line claims ± {formal:.0f} km/s where the joint fit finds ± {mine:.0f}, {mine / formal:.0f} "
        "times as much: its positions lie on smooth arrival curves and share their errors. Do not use its errors."
    )


def _rotation(track: Fit) -> str:
    other = next(iter(track.get("two_step_other_rotations", {}).items()), None)
    speed = _mean(track.get("two_step") or {}, "v_sw_km_s")
    if other is None or not speed or not _mean(other[1], "v_sw_km_s"):
        return ""
    ratio = float(track["rotation_period_d"]) / float(other[0])
    return (
        f"Speeds scale with the inverse of the rotation period: with {other[0]} d instead of "
        f"{track['rotation_period_d']:.2f} d each is {abs(1 - ratio):.1%} {'lower' if ratio < 1 else 'higher'}. "
        "SEMP uses the synodic period."
    )


def _against_semp(joint: Fit, semp: Fit) -> str:
    mine, theirs = _mean(joint, "phi0_deg"), _mean(semp, "phi0_deg")
    if mine is None or theirs is None:
        return ""
    apart, error = _turn(joint, semp), _joint_sd(joint, semp)
    verdict = "more than" if apart > APART_SD * error else "within what"
    return (
        "SEMP takes distances from a density model and the wind as known. Its longitude is "
        f"{apart:.0f}° from that of the joint fit, {verdict} their errors allow.{_misfit(semp)}{_beams(joint, semp)}"
    )


def _misfit(semp: Fit) -> str:
    if semp.get("error_scale", 1.0) < LARGE_MISFIT:
        return ""
    return (
        f" It misses the arrival times by {semp['rms_s']:.0f} s, {semp['error_scale']:.1f} times their errors, by "
        "which its own errors were widened: no single beam at these distances explains them."
    )


def _beams(joint: Fit, semp: Fit) -> str:
    mine, theirs = _mean(joint, "beam_speed_c"), _mean(semp, "beam_speed_c")
    if not mine or not theirs or max(mine, theirs) < LARGE_MISFIT * min(mine, theirs):
        return ""
    return f" A beam of {mine:.2f} c against {theirs:.2f} c: speeds scale with the distances that a method believes in."


def _pieces(fit: Fit) -> str:
    if not fit.get("segments"):
        return ""
    count = len(fit["segments"])
    speeds = "one speed" if count == 1 else f"{count} speeds"
    left_out = fit.get("masked", 0)
    near = f" {left_out} positions nearer to the Sun than three of their errors are left out." if left_out else ""
    return f"Of broken spirals with up to three knots the positions ask for {speeds}.{near}"


def _against_paper(joint: Fit, paper: Fit) -> str:
    if not paper or _mean(joint, "phi0_deg") is None:
        return ""
    inside = [_holds(joint, paper, name) for name in ("phi0_deg", "v_sw_km_s")]
    words = {2: "hold both numbers", 1: "hold one of the two numbers", 0: "hold neither number"}[sum(inside)]
    return f"The 95 % intervals of the joint fit {words} of the paper (doi:{paper['doi']})."


def _holds(joint: Fit, paper: Fit, name: str) -> bool:
    return bool(joint[name]["q2_5"] <= paper[name]["mean"] <= joint[name]["q97_5"])


def _flags(name: str, fit: Fit) -> str:
    words = {"joint": "Joint", "piecewise": "Piecewise", "semp": "SEMP"}[name]
    said = [fit.get("reason") or flag_meaning(flag) for flag in fit.get("flags", ()) if flag not in SAID]
    return f"{words}: {' '.join(said)}" if said else ""


def _mean(fit: Fit, name: str) -> float | None:
    value = fit.get(name)
    return value.get("mean") if isinstance(value, Mapping) else None


def _sd(fit: Fit, name: str) -> float | None:
    value = fit.get(name)
    return value.get("sd") if isinstance(value, Mapping) else None

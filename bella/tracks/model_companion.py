"""Which model of beam, density and wind the arrival times ask for, and the longitude whichever it is."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np

from bella.exceptions import NoDataError
from bella.tracks.joint import ModelEvidence, compare_models, wind_knots
from bella.tracks.joint_fit import JointFit, beside_mean, summarise, wind_segments
from bella.tracks.joint_ingredients import Ingredients, JointOptions
from bella.tracks.joint_model import JointModel

MOST_KNOTS = 2
DRAWS = 2000
"""Of each model: evidence is good to 0.05 with as many."""


def variants(fit: JointFit, known: Ingredients) -> list[JointModel]:
    """Models to hold against that of a fit: other beams, other density laws, winds that change on the way.

    Parameters
    ----------
    fit : JointFit
    known : Ingredients
        What it was fitted to.

    Returns
    -------
    list of JointModel
        The model of the fit first.
    """
    knots = [wind_knots(fit, known.arrivals.frequency_mhz, number) for number in range(1, MOST_KNOTS + 1)]
    return [*fit.model.variants, *(replace(fit.model, knots_rsun=places) for places in dict.fromkeys(knots))]


def model_companion(known: Ingredients, fit: JointFit, seed: int) -> dict[str, Any]:
    """Models by their evidence, and the longitude averaged over them (Hoeting et al. 1999, doi:10.1214/ss/1009212519).

    Parameters
    ----------
    known : Ingredients
        What the joint fit was fitted to.
    fit : JointFit
    seed : int

    Returns
    -------
    dict
        Ready for JSON: ``rows`` with model, logarithm of the evidence over that of the best, probability, longitude and
        wind, the best first; ``phi0_deg`` averaged; and flags.

    Raises
    ------
    NoDataError
        If there is no joint fit.
    InputError
        If no model explains the times.
    """
    if not fit.draws:
        raise NoDataError(f"there is no joint fit ({', '.join(fit.flags)}): add frequencies")
    ranked = compare_models(known, variants(fit, known), JointOptions(DRAWS, seed))
    return {
        "model": "six models, equally probable beforehand, by their evidence",
        "rows": [_row(one) for one in ranked],
        "phi0_deg": _averaged(ranked),
        "flags": [],
    }


def _row(one: ModelEvidence) -> dict[str, Any]:
    shown = {
        name: {"mean": one.fit.summary[name].mean, "sd": one.fit.summary[name].sd} for name in ("phi0_deg", "v_sw_km_s")
    }
    judged = {"log_bayes_factor": one.log_bayes_factor, "probability": one.probability, "flags": list(one.fit.flags)}
    return {"name": one.fit.model.name, **judged, **shown, **wind_segments(one.fit)}


def _averaged(ranked: list[ModelEvidence]) -> dict[str, float]:
    """Longitude of the mixture of all posteriors."""
    longitude = np.concatenate([one.fit.draws["phi0_deg"] for one in ranked])
    weight = np.concatenate(
        [np.full(size, one.probability / size) for one in ranked if (size := one.fit.draws["phi0_deg"].size)]
    )
    weight /= weight.sum()
    said = asdict(summarise(beside_mean(longitude, weight), weight, 0.0))
    return {name: float(value) for name, value in said.items() if name != "contraction"}

"""The fused fit of a burst: what arrival times, wave directions and a known wind say together, and what each adds.

Every ingredient is left out once. Whether it contradicts the others is read from how much worse all together are fitted
than the ingredient and the others apart, at the maxima of their posteriors: chi square with as many degrees of freedom
as parameters are measured twice (Raveri & Hu 2019, Phys. Rev. D 99, 043506, doi:10.1103/PhysRevD.99.043506).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import chi2, norm

from bella.flags import DISAGREE_SD
from bella.tracks.joint import fit_ingredients
from bella.tracks.joint_fit import RELEASE, JointFit, joint_json
from bella.tracks.joint_ingredients import Ingredients, JointOptions
from bella.tracks.joint_model import JointModel
from bella.tracks.joint_modes import find_modes
from bella.tracks.joint_observed import Observed
from bella.tracks.joint_robust import robust_modes
from bella.units import within_half_turn_deg

LEAST_SHARED = 0.5
"""Parameters measured twice, at least: of fewer nothing can be said."""
HIGHEST_TENSION = 37.0
"""Where its probability cannot be written any more."""


@dataclass(frozen=True)
class IngredientWeight:
    """What one ingredient adds to a fit.

    Attributes
    ----------
    name : str
        One of `Ingredients.names`.
    chi2 : float
        Its squared residuals at the best track of all ingredients.
    number : int
        Of its residuals.
    without : JointFit
        The fit of all the others; without numbers where they do not suffice.
    shift_sd : dict of str to float
        Mean with it less the mean without, in standard deviations without it, by parameter.
    sd_ratio : dict of str to float
        Standard deviation with it over that without it, by parameter: 1 where it adds nothing.
    tension : float
        How far its own answer is from that of all the others, in standard deviations of the difference.
    """

    name: str
    chi2: float
    number: int
    without: JointFit
    shift_sd: dict[str, float]
    sd_ratio: dict[str, float]
    tension: float


@dataclass(frozen=True)
class FusedFit:
    """A joint fit and the weight of each of its ingredients.

    Attributes
    ----------
    fit : JointFit
        Of all ingredients, with the flag ``ingredients_disagree`` where a tension is above 3.
    ingredients : tuple of IngredientWeight
        Empty where there is one ingredient only.
    """

    fit: JointFit
    ingredients: tuple[IngredientWeight, ...]


def fit_fused(known: Ingredients, model: JointModel | None = None, options: JointOptions | None = None) -> FusedFit:
    """Fit all that is known of a burst, and once more without each ingredient.

    Parameters
    ----------
    known : Ingredients
    model : JointModel, optional
    options : JointOptions, optional
        The fits without an ingredient never fall back to PyMC.

    Returns
    -------
    FusedFit
    """
    chosen, options = model or JointModel(), options or JointOptions()
    fit = fit_ingredients(known, chosen, options)
    if len(known.names) == 1 or not fit.summary:
        return FusedFit(fit, ())
    fast = replace(options, fallback=False)
    tension = _tensions(known, chosen, robust=options.robust)
    weights = tuple(
        _weight(name, tension[name], fit, fit_ingredients(known.without(name), chosen, fast)) for name in known.names
    )
    if max(tension.values()) > DISAGREE_SD:
        fit = replace(fit, flags=(*fit.flags, "ingredients_disagree"))
    return FusedFit(fit, weights)


def fused_json(fused: FusedFit) -> dict[str, Any]:
    """Fused fit as it is stored and served.

    Parameters
    ----------
    fused : FusedFit

    Returns
    -------
    dict
        Ready for JSON: as :func:`bella.tracks.joint_json`, and ``ingredients``.
    """
    return joint_json(fused.fit) | {"ingredients": [_weight_json(one) for one in fused.ingredients]}


def _weight_json(one: IngredientWeight) -> dict[str, Any]:
    without = {
        name: {"mean": value.mean, "sd": value.sd} for name, value in one.without.summary.items() if name != RELEASE
    }
    return {
        "name": one.name,
        "chi2": one.chi2,
        "number": one.number,
        "without": without,
        "shift_sd": one.shift_sd,
        "sd_ratio": one.sd_ratio,
        "tension": one.tension,
    }


def _weight(name: str, tension: float, fit: JointFit, without: JointFit) -> IngredientWeight:
    squares, number = fit.account.squares[name]
    shared = [one for one in fit.model.parameters if one in without.summary]
    shift = {one: _shift(fit.summary[one].mean - without.summary[one].mean, without, one) for one in shared}
    ratio = {one: fit.summary[one].sd / without.summary[one].sd for one in shared}
    return IngredientWeight(name, squares, number, without, shift, ratio, tension)


def _shift(difference: float, without: JointFit, name: str) -> float:
    """In standard deviations; longitudes the short way round."""
    if name == "phi0_deg":
        difference = within_half_turn_deg(difference)
    return difference / without.summary[name].sd


def _tensions(known: Ingredients, model: JointModel, *, robust: bool) -> dict[str, float]:
    """Tension of each ingredient with all the others; bad arrival times count as little as they do in the fit."""
    observed = known.observed()
    weighted = robust_modes(model, observed)[1] if robust else observed
    together, measured = _best(model, weighted)
    found = {}
    for name in known.names:
        rest, alone = (_best(model, one) for one in weighted.split(name))
        worse = together - rest[0] - alone[0]
        found[name] = _standard_deviations(worse, rest[1] + alone[1] - measured)
    return found


def _best(model: JointModel, observed: Observed) -> tuple[float, float]:
    """Squared residuals at the best track, and how many parameters were measured rather than taken from the prior."""
    modes = find_modes(model, observed)
    squares = observed.misfit(observed.residual(model, modes.z[:1]))[0][0]
    return float(squares), len(model.parameters) - float(np.trace(modes.covariance[0]))


def _standard_deviations(worse: float, shared: float) -> float:
    """Those of a normal deviate, either side, that is as improbable."""
    probability = chi2.sf(max(worse, 0.0), max(shared, LEAST_SHARED))
    return min(float(norm.isf(probability / 2)), HIGHEST_TENSION) if probability > 0 else HIGHEST_TENSION

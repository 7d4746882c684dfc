"""From an arrival table to the track of its burst: the joint fit, and the two-step fit of the paper beside it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from bella.arrivals import MIN_OBSERVATORIES, ArrivalGrid, arrival_grid, check_arrivals, locate_receivers
from bella.heliosphere import PAPER_FIGURES_ROTATION_D
from bella.multilateration import localise
from bella.multilateration.priors import apply_sigma_rule, find_preset
from bella.tracks.fused import fit_fused, fused_json
from bella.tracks.joint import ModelEvidence, compare_models, wind_knots
from bella.tracks.joint_directions import DirectionTerms, direction_terms
from bella.tracks.joint_fit import JointFit, wind_segments
from bella.tracks.joint_ingredients import Ingredients, JointOptions
from bella.tracks.joint_model import JointModel
from bella.tracks.joint_observed import WindPrior
from bella.tracks.spiral import track_fit

FRAME = "HEE"
FEW_DRAWS = 100
"""The two-step fit takes the means, which are exact: draws would only cost time."""


@dataclass(frozen=True)
class TrackRecipe:
    """How the track of a burst is fitted.

    Attributes
    ----------
    model : JointModel
    preset : str
        A name of `bella.multilateration.PRESETS`: timing errors of both fits, priors of the positions.
    common_sd_s : float or None
        Standard deviation of the offset that all channels of a receiver share in the joint fit, s; None: the table's.
    others : sequence of JointModel
        Models to compare with `model`.
    most_knots : int
        Models in which the wind changes at up to so many distances are compared as well.
    directions : pandas.DataFrame or None
        Wave directions, as :func:`bella.tracks.joint_directions.check_directions` returns them.
    floor_deg : float
        Error that all directions of a spacecraft share beside their own, degrees.
    wind : WindPrior or None
        Speed of the wind along the track as known from elsewhere.
    options : JointOptions
        With PyMC where importance sampling fails.
    """

    model: JointModel = field(default_factory=JointModel)
    preset: str = "default"
    common_sd_s: float | None = None
    others: Sequence[JointModel] = ()
    most_knots: int = 0
    directions: pd.DataFrame | None = None
    floor_deg: float = 0.0
    wind: WindPrior | None = None
    options: JointOptions = field(default_factory=partial(JointOptions, fallback=True))


def fit_track(
    arrivals: pd.DataFrame, recipe: TrackRecipe | None = None, advance: Callable[[int], None] = lambda _: None
) -> dict[str, Any]:
    """Fit the track of a burst jointly, and in two steps for comparison.

    Parameters
    ----------
    arrivals : pandas.DataFrame
        As :func:`bella.arrivals.check_arrivals` returns it.
    recipe : TrackRecipe, optional
    advance : callable
        Told how many frequencies of the two-step fit are done since the last call.

    Returns
    -------
    dict
        Ready for JSON: frame, rotation period, ``joint`` and ``two_step``, and ``models``, where models were compared.

    Raises
    ------
    InputError
        If the table, or a choice of the recipe, is wrong.
    NoDataError
        If the time is outside the ephemeris.
    """
    chosen = recipe or TrackRecipe()
    preset = find_preset(chosen.preset)
    table = check_arrivals(arrivals)
    located = locate_receivers(table)
    grid = apply_sigma_rule(arrival_grid(located, heard_by=1), preset)
    known = Ingredients(grid, chosen.common_sd_s, _directions(chosen, located, grid.reference_utc), chosen.wind)
    fused = fit_fused(known, chosen.model, chosen.options)
    two_step = track_fit(
        _positions(table, grid, chosen.preset, advance),
        rotation_period_d=chosen.model.rotation_period_d,
        other_rotations_d=(PAPER_FIGURES_ROTATION_D,),
    )
    return two_step | {"joint": fused_json(fused)} | _compared(known, chosen, fused.fit)


def _directions(recipe: TrackRecipe, located: pd.DataFrame, epoch: np.datetime64) -> DirectionTerms | None:
    if recipe.directions is None:
        return None
    return direction_terms(recipe.directions, located, epoch, recipe.floor_deg)


def _positions(table: pd.DataFrame, grid: ArrivalGrid, preset: str, advance: Callable[[int], None]) -> xr.Dataset:
    """Position of each frequency; of none where no frequency is heard by three receivers."""
    if (np.isfinite(grid.arrival_s).sum(axis=1) >= MIN_OBSERVATORIES).any():
        return localise(table, preset=preset, draws=FEW_DRAWS, advance=advance)
    return xr.Dataset({name: ("frequency", np.empty(0)) for name in ("x_rsun", "y_rsun")}, attrs={"frame": FRAME})


def _compared(known: Ingredients, recipe: TrackRecipe, fit: JointFit) -> dict[str, Any]:
    if not (recipe.others or recipe.most_knots) or not fit.summary:
        return {}
    plain = (recipe.model, *recipe.others)
    knots = [wind_knots(fit, known.arrivals.frequency_mhz, number) for number in range(1, recipe.most_knots + 1)]
    models = [*plain, *(replace(model, knots_rsun=places) for places in knots for model in plain)]
    return {
        "models": [_model_json(one) for one in compare_models(known, models, replace(recipe.options, fallback=False))]
    }


def _model_json(one: ModelEvidence) -> dict[str, Any]:
    return {
        "model": one.fit.model.name,
        "log_bayes_factor": one.log_bayes_factor,
        "probability": one.probability,
    } | wind_segments(one.fit)

"""From an arrival table to the track of its burst: the joint fit, and the two-step fit of the paper beside it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from bella.arrivals import MIN_OBSERVATORIES, ArrivalGrid, arrival_grid, check_arrivals, locate_receivers
from bella.heliosphere import PAPER_FIGURES_ROTATION_D
from bella.multilateration import localise
from bella.multilateration.priors import apply_sigma_rule, find_preset
from bella.tracks.joint import compare_models, fit_joint
from bella.tracks.joint_fit import joint_json
from bella.tracks.joint_model import JointModel
from bella.tracks.two_step import track_fit

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
    seed : int
    """

    model: JointModel = field(default_factory=JointModel)
    preset: str = "default"
    common_sd_s: float | None = None
    others: Sequence[JointModel] = ()
    seed: int = 0


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
    grid = apply_sigma_rule(arrival_grid(locate_receivers(table), heard_by=1), preset)
    joint = fit_joint(grid, chosen.model, common_sd_s=chosen.common_sd_s, seed=chosen.seed)
    two_step = track_fit(
        _positions(table, grid, chosen.preset, advance),
        rotation_period_d=chosen.model.rotation_period_d,
        other_rotations_d=(PAPER_FIGURES_ROTATION_D,),
    )
    return two_step | {"joint": joint_json(joint)} | _compared(grid, chosen)


def _positions(table: pd.DataFrame, grid: ArrivalGrid, preset: str, advance: Callable[[int], None]) -> xr.Dataset:
    """Position of each frequency; of none where no frequency is heard by three receivers."""
    if (np.isfinite(grid.arrival_s).sum(axis=1) >= MIN_OBSERVATORIES).any():
        return localise(table, preset=preset, draws=FEW_DRAWS, advance=advance)
    return xr.Dataset({name: ("frequency", np.empty(0)) for name in ("x_rsun", "y_rsun")}, attrs={"frame": FRAME})


def _compared(grid: ArrivalGrid, recipe: TrackRecipe) -> dict[str, Any]:
    if not recipe.others:
        return {}
    ranked = compare_models(grid, (recipe.model, *recipe.others), common_sd_s=recipe.common_sd_s, seed=recipe.seed)
    return {
        "models": [
            {
                "model": one.fit.model.name,
                "log_bayes_factor": one.log_bayes_factor,
                "probability": one.probability,
            }
            for one in ranked
        ]
    }

"""From the arrival times of a burst to everything that is said of its track."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from bella.arrivals import MIN_OBSERVATORIES, ArrivalGrid, arrival_grid, check_arrivals, locate_receivers
from bella.exceptions import InputError
from bella.flags import APPARENT_SOURCE
from bella.heliosphere import PAPER_FIGURES_ROTATION_D
from bella.heliosphere.scattering import LITERATURE_DELAY
from bella.multilateration import localise
from bella.multilateration.priors import apply_sigma_rule, find_preset
from bella.records import Track
from bella.tracks.compare import fused_companion, models_companion
from bella.tracks.directions import direction_terms
from bella.tracks.fit import DRAWS, TrackFit, fit_track
from bella.tracks.model import TrackModel, WindPrior
from bella.tracks.preliminary import fit_preliminary
from bella.tracks.spiral import track_fit
from bella.units import FloatArray

FEW_DRAWS = 100
"""The two-step fit takes the means, which are exact: draws would only cost time."""

LEAST_OBSERVATORIES = 2


@dataclass(frozen=True)
class TrackRecipe:
    """How the track of a burst is fitted.

    Attributes
    ----------
    model : TrackModel
    preset : str
        A name of `bella.multilateration.PRESETS`: timing errors of both fits, priors of the positions.
    covariance_s2 : ndarray, shape (N, N), or None
        Full covariance of the rows of the table.
    compare : bool
        Weigh models with laws as well.
    directions : pandas.DataFrame or None
        Wave directions, as :func:`bella.tracks.directions.check_directions` returns them.
    floor_deg : float
        Error that all directions of a spacecraft share beside their own, degrees.
    wind : WindPrior or None
        Wind of the apparent spiral as measured in situ.
    other_edges : pandas.DataFrame or None
        Arrival table of the same burst by another definition of the edge: a track of two spacecraft is published where
        both agree.
    draws, seed : int
    """

    model: TrackModel = field(default_factory=TrackModel)
    preset: str = "default"
    covariance_s2: FloatArray | None = None
    compare: bool = False
    directions: pd.DataFrame | None = None
    floor_deg: float = 0.0
    wind: WindPrior | None = None
    other_edges: pd.DataFrame | None = None
    draws: int = DRAWS
    seed: int = 0


def fit_table(
    arrivals: pd.DataFrame, recipe: TrackRecipe | None = None, advance: Callable[[int], None] = lambda _: None
) -> Track:
    """Fit the track of a burst jointly, and in two steps for comparison.

    Parameters
    ----------
    arrivals : pandas.DataFrame
        Arrival table of two spacecraft or more.
    recipe : TrackRecipe, optional
    advance : callable
        Is called with how many frequencies of the two-step fit are done since the last call.

    Returns
    -------
    Track

    Raises
    ------
    InputError
        If the table, or a choice of the recipe, is wrong.
    NoDataError
        If the time is outside the ephemeris, or two spacecraft alone say too little
        (:class:`~bella.exceptions.NotPlacedError`).
    """
    chosen = recipe or TrackRecipe()
    table = check_arrivals(arrivals, received_by=LEAST_OBSERVATORIES)
    located = locate_receivers(table)
    grid = arrival_grid(located, received_by=1, covariance_s2=chosen.covariance_s2)
    preset = find_preset(chosen.preset)
    grid = apply_sigma_rule(grid, preset)
    if len(grid.observatories) < MIN_OBSERVATORIES:
        return _preliminary(grid, chosen.other_edges)
    terms = None
    if chosen.directions is not None:
        terms = direction_terms(chosen.directions, located, grid.reference_utc, chosen.floor_deg)
    model = chosen.model if chosen.model.delay != LITERATURE_DELAY else replace(chosen.model, delay=preset.delay)
    fit = fit_track(grid, model, draws=chosen.draws, seed=chosen.seed)
    companions: dict[str, dict[str, Any]] = {}
    if fit.draws and (terms is not None or chosen.wind is not None):
        companions["fused"] = fused_companion(fit, grid, terms, chosen.wind, chosen.seed)
    if fit.draws and chosen.compare:
        companions["models"] = models_companion(fit, grid, chosen.seed)
    line = track_fit(
        _positions(table, grid, chosen, advance),
        rotation_period_d=chosen.model.rotation_period_d,
        other_rotations_d=(PAPER_FIGURES_ROTATION_D,),
    )
    return track_record(fit, line, companions)


def _preliminary(grid: ArrivalGrid, other_edges: pd.DataFrame | None) -> Track:
    """What two spacecraft say: regions of the longitude, a side and distances."""
    other = None
    if other_edges is not None:
        located = locate_receivers(check_arrivals(other_edges, source="other edges", received_by=LEAST_OBSERVATORIES))
        other = arrival_grid(located, received_by=1)
        if set(other.observatories) != set(grid.observatories):
            raise InputError("other edges are of other spacecraft: give both tables of one burst")
        if other.edge == grid.edge:
            raise InputError(f"both tables have the edge {grid.edge}: give another one, such as half_maximum")
    record = fit_preliminary(grid, other)
    return Track(remark=APPARENT_SOURCE, rotation_period_d=record.rotation_period_d, joint=record)


def track_record(fit: TrackFit, line: dict[str, Any], companions: dict[str, dict[str, Any]]) -> Track:
    """Everything that is said of a track, in one record.

    Parameters
    ----------
    fit : TrackFit
    line : dict
        Two-step fit, as :func:`bella.tracks.spiral.track_fit` returns it.
    companions : dict

    Returns
    -------
    Track
    """
    return Track(
        remark=APPARENT_SOURCE,
        rotation_period_d=fit.record.rotation_period_d,
        joint=fit.record,
        two_step=line["two_step"],
        two_step_other_rotations=line.get("two_step_other_rotations", {}),
        companions=companions,
    )


def _positions(
    table: pd.DataFrame, grid: ArrivalGrid, recipe: TrackRecipe, advance: Callable[[int], None]
) -> xr.Dataset:
    """Position of each frequency; of none where no frequency is received by three receivers."""
    if (np.isfinite(grid.arrival_s).sum(axis=1) >= MIN_OBSERVATORIES).any():
        return localise(
            table, preset=recipe.preset, draws=FEW_DRAWS, advance=advance, covariance_s2=recipe.covariance_s2
        )
    return xr.Dataset({name: ("frequency", np.empty(0)) for name in ("x_rsun", "y_rsun")}, attrs={"frame": "HEE"})


def with_joint_draws(posterior: xr.Dataset, fit: TrackFit) -> xr.Dataset:
    """Solution with the draws of its joint fit beside those of its positions.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.
    fit : TrackFit

    Returns
    -------
    xarray.Dataset
        With ``joint_draws`` (joint_draw, joint_parameter), ``release_s`` counted from the ``reference_time`` of the
        draws, and ``joint_range_rsun`` (joint_draw, joint_frequency); without them where nothing was fitted.
    """
    if not fit.draws:
        return posterior
    described = {
        "units": "as the name of the parameter says",
        "long_name": "equally weighted posterior draws of the joint fit",
        "comment": f"One source on one spiral, fitted to all arrival times together; {APPARENT_SOURCE}",
        "model": fit.record.model,
        "rotation_period_d": fit.record.rotation_period_d,
        "reference_time": f"{np.datetime_as_string(fit.reference_utc, unit='ms')}Z",
    }
    frequency_mhz = np.array([row.frequency_mhz for row in fit.record.profile])
    drawn = np.stack(list(fit.draws.values()), axis=-1).astype(np.float32)
    distance = fit.range_rsun(frequency_mhz).astype(np.float32)
    return posterior.assign(
        joint_draws=(("joint_draw", "joint_parameter"), drawn, described),
        joint_range_rsun=(
            ("joint_draw", "joint_frequency"),
            distance,
            {"units": "R_sun", "long_name": "distance of the source from the Sun, draws of the joint fit"},
        ),
    ).assign_coords(
        joint_parameter=(
            "joint_parameter",
            np.array(list(fit.draws), dtype=str),
            {"long_name": "parameter of the joint fit"},
        ),
        joint_frequency=("joint_frequency", frequency_mhz, {"units": "MHz", "long_name": "frequency"}),
    )

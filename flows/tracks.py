"""What a solution says of its track: joint and two-step fit, and what stands beside them."""

from collections.abc import Callable
from typing import Any

import pandas as pd
import xarray as xr

from bella.arrivals import ArrivalGrid, arrival_grid
from bella.catalogue import Series
from bella.exceptions import GeometryError, InputError, NoDataError
from bella.flags import NOT_COMPUTED
from bella.multilateration.priors import apply_sigma_rule, find_preset
from bella.settings import Settings
from bella.tracks import JointFit, piecewise_fit, track_fit
from bella.tracks.companions import density_companion, semp_companion
from bella.tracks.published import MOST_FREQUENCIES, joint_track, thinned, with_joint_draws
from flows.solar_wind import Surroundings, footpoint_of, wind_of

TRACK_RECIPE = {
    "most_frequencies": MOST_FREQUENCIES,
    "companions": ["semp", "piecewise", "density_excess", "footpoint", "wind"],
}
"""Choices that decide the track of a solution; another one makes a new version."""


def fitted_track(
    posterior: xr.Dataset, arrivals: pd.DataFrame, series: Series, settings: Settings, around: Surroundings
) -> tuple[dict[str, Any], xr.Dataset]:
    """Fit the track of a solution by every method.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.
    arrivals : pandas.DataFrame
        The located arrival table that it was made from.
    series : Series
    settings : Settings
    around : Surroundings
        Wind and Sun around the burst.

    Returns
    -------
    track : dict
        Ready for JSON: the two-step fit as :func:`bella.tracks.track_fit` returns it, with ``joint`` and
        ``companions``.
    posterior : xarray.Dataset
        With the draws of the joint fit.
    """
    grid = apply_sigma_rule(arrival_grid(arrivals, heard_by=1), find_preset(series.preset))
    two_step = track_fit(posterior)
    joint, fit = joint_track(grid, two_step["rotation_period_d"], settings.draws, settings.seed)
    track = two_step | {"joint": joint, "companions": companions(posterior, grid, fit, around)}
    track["companions"]["wind"] = attempted(lambda: wind_of(posterior, joint, around))
    return track, with_joint_draws(posterior, fit)


def companions(posterior: xr.Dataset, grid: ArrivalGrid, fit: JointFit, around: Surroundings) -> dict[str, Any]:
    """Everything that stands beside the fits of a track; what cannot be computed says why, and stops nothing.

    Parameters
    ----------
    posterior : xarray.Dataset
    grid : ArrivalGrid
        Arrival times with the timing errors of the solution.
    fit : JointFit
    around : Surroundings

    Returns
    -------
    dict
        Ready for JSON: ``semp``, ``weighted``, ``piecewise``, ``density_excess`` and ``footpoint``.
    """
    spirals = attempted(lambda: piecewise_fit(posterior))
    return {
        "semp": attempted(lambda: semp_companion(thinned(grid))),
        "weighted": spirals.get("weighted", spirals),
        "piecewise": spirals.get("piecewise", spirals),
        "density_excess": attempted(lambda: density_companion(posterior)),
        "footpoint": attempted(lambda: footpoint_of(fit, grid.observatories, around)),
    }


def attempted(compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Result, or a flag and the reason why there is none.

    Parameters
    ----------
    compute : callable

    Returns
    -------
    dict
    """
    try:
        return compute()
    except (GeometryError, InputError, NoDataError) as error:
        return {"flags": [NOT_COMPUTED], "reason": str(error)}

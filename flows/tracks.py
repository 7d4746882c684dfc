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
from bella.solar_wind.connection import footpoint_companion
from bella.tracks import JointFit, piecewise_fit, track_fit
from bella.tracks.companions import density_companion, semp_companion
from bella.tracks.published import MOST_FREQUENCIES, joint_track, thinned, with_joint_draws

TRACK_RECIPE = {
    "most_frequencies": MOST_FREQUENCIES,
    "companions": ["semp", "piecewise", "density_excess", "footpoint"],
}
"""Choices that decide the track of a solution; another one makes a new version."""


def fitted_track(
    posterior: xr.Dataset, arrivals: pd.DataFrame, series: Series, settings: Settings
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
    track = two_step | {"joint": joint, "companions": companions(posterior, grid, fit)}
    return track, with_joint_draws(posterior, fit)


def companions(posterior: xr.Dataset, grid: ArrivalGrid, fit: JointFit) -> dict[str, Any]:
    """Everything that stands beside the fits of a track; what cannot be computed says why, and stops nothing.

    Parameters
    ----------
    posterior : xarray.Dataset
    grid : ArrivalGrid
        Arrival times with the timing errors of the solution.
    fit : JointFit

    Returns
    -------
    dict
        Ready for JSON: ``semp``, ``weighted``, ``piecewise``, ``density_excess`` and ``footpoint``.
    """

    def _footpoint() -> dict[str, Any]:
        if not fit.draws:
            raise NoDataError(f"there is no joint fit ({', '.join(fit.flags)}): add frequencies")
        return footpoint_companion(fit.draws["phi0_deg"], fit.reference_utc, grid.observatories)

    spirals = attempted(lambda: piecewise_fit(posterior))
    return {
        "semp": attempted(lambda: semp_companion(thinned(grid))),
        "weighted": spirals.get("weighted", spirals),
        "piecewise": spirals.get("piecewise", spirals),
        "density_excess": attempted(lambda: density_companion(posterior)),
        "footpoint": attempted(_footpoint),
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

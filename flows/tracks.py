"""What a solution says of its track: joint and two-step fit, and what stands beside them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pandas as pd
import xarray as xr

from bella.arrivals import ArrivalGrid, arrival_grid
from bella.catalogue import Series
from bella.exceptions import GeometryError, InputError, NoDataError
from bella.flags import APPARENT_SOURCE, NOT_COMPUTED
from bella.multilateration.priors import apply_sigma_rule, find_preset
from bella.settings import Settings
from bella.tracks import Ingredients, JointFit, JointOptions, piecewise_fit, track_fit
from bella.tracks.companions import density_companion, semp_companion
from bella.tracks.direction_companions import FLOOR_DEG, fused_companion, triangulation_companion
from bella.tracks.model_companion import model_companion
from bella.tracks.published import FEWEST_DRAWS, MOST_FREQUENCIES, as_fitted, joint_track, with_joint_draws
from bella.tracks.scattering_companion import scattering_companion
from flows.directions import directed
from flows.solar_wind import Surroundings, footpoint_of, wind_of

TRACK_RECIPE = {
    "most_frequencies": MOST_FREQUENCIES,
    "found_bursts": "channel edges",
    "directions": f"turned by {FLOOR_DEG:g} deg, each spacecraft's alike",
    "companions": [
        "semp",
        "piecewise",
        "density_excess",
        "scattering",
        "footpoint",
        "wind",
        "triangulation",
        "fused",
        "models",
    ],
}
"""Choices that decide the track of a solution; another one makes a new version."""


@dataclass(frozen=True)
class Timing:
    """Arrival times of a burst with one definition of the edge.

    Attributes
    ----------
    arrivals : DataFrame
        Located arrival table that the positions come from.
    channels : DataFrame or None
        Located arrival table of the channels themselves, for the joint fit; None: it is made from `arrivals`.
    directions : DataFrame or None
        Wave directions of the burst, where its spectra carry them.
    """

    arrivals: pd.DataFrame
    channels: pd.DataFrame | None = None
    directions: pd.DataFrame | None = None


def fitted_track(
    posterior: xr.Dataset, timing: Timing, series: Series, settings: Settings, around: Surroundings
) -> tuple[dict[str, Any], xr.Dataset]:
    """Fit the track of a solution by every method.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.
    timing : Timing
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
    is_curve = timing.channels is None
    table = timing.arrivals if timing.channels is None else timing.channels
    timed = apply_sigma_rule(arrival_grid(table, heard_by=1), find_preset(series.preset))
    two_step = track_fit(posterior)
    period_d = two_step["rotation_period_d"]
    joint, fit = joint_track(timed, period_d, settings.draws, settings.seed, from_curve=is_curve)
    options, used = JointOptions(max(settings.draws, FEWEST_DRAWS), settings.seed), as_fitted(timed, joint)
    beside = companions(posterior, used, fit, around)
    beside["wind"] = attempted(lambda: wind_of(posterior, joint, beside["scattering"], around))
    beside["models"] = attempted(lambda: model_companion(Ingredients(used), fit, settings.seed))
    beside |= more_than_times(timing, used, period_d, options)
    track = two_step | {"remark": APPARENT_SOURCE, "joint": joint, "companions": beside}
    return track, with_joint_draws(posterior, fit)


def more_than_times(
    timing: Timing, grid: ArrivalGrid, rotation_period_d: float, options: JointOptions
) -> dict[str, Any]:
    """What wave directions add to the arrival times.

    The wind measured in situ is not among them: it bends the field line of the true sources, not of the apparent ones.

    Parameters
    ----------
    timing : Timing
    grid : ArrivalGrid
        Arrival times as the joint fit took them.
    rotation_period_d : float
        Rotation period of the Sun, days.
    options : JointOptions

    Returns
    -------
    dict
        Ready for JSON: ``triangulation`` and ``fused``.
    """
    terms = directed(timing.directions, timing.arrivals, grid.reference_utc)
    known = Ingredients(grid, directions=terms)
    return {
        "triangulation": attempted(lambda: triangulation_companion(terms)),
        "fused": attempted(lambda: fused_companion(known, rotation_period_d, options)),
    }


def companions(posterior: xr.Dataset, grid: ArrivalGrid, fit: JointFit, around: Surroundings) -> dict[str, Any]:
    """Everything that stands beside the fits of a track; what cannot be computed says why, and stops nothing.

    Parameters
    ----------
    posterior : xarray.Dataset
    grid : ArrivalGrid
        Arrival times as the joint fit took them.
    fit : JointFit
    around : Surroundings

    Returns
    -------
    dict
        Ready for JSON: ``semp``, ``weighted``, ``piecewise``, ``density_excess``, ``scattering`` and ``footpoint``.
    """
    spirals = attempted(lambda: piecewise_fit(posterior))
    density = attempted(lambda: density_companion(posterior))
    return {
        "semp": attempted(lambda: semp_companion(grid)),
        "weighted": spirals.get("weighted", spirals),
        "piecewise": spirals.get("piecewise", spirals),
        "density_excess": density,
        "scattering": attempted(lambda: scattering_companion(density, fit)),
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

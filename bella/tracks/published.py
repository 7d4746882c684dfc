"""The joint fit of a solution, as it is stored and served: from few enough frequencies for its errors to be honest.

Arrival times on a smooth curve t(f) share their errors. A curve through some forty channels of a spacecraft says no
more than these channels, at however many frequencies it is read, so no more than forty are taken. Even so the
errors are too small, as the curve has few terms: bursts that are found are fitted from the edges of their channels.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from scipy.special import chdtri

from bella.arrivals import ArrivalGrid
from bella.flags import APPARENT_SOURCE
from bella.tracks.joint import fit_joint
from bella.tracks.joint_fit import RELEASE, JointFit, joint_json
from bella.tracks.joint_ingredients import DRAWS
from bella.tracks.joint_model import JointModel

MOST_FREQUENCIES = 40
"""Channels of one STEREO receiver between 0.15 and 2 MHz; coverage was measured with as many."""

FEWEST_DRAWS = 100
TABLE = "arrival table"
"""Where the times of a joint fit come from that lie on a curve."""
POOR_FIT = "poor_fit"
MOST_DOUBLED = 64.0
LEAST_PROBABILITY = 1e-280
"""Below this a probability is too near to what a number can hold to give a chi-squared back."""


def thinned(grid: ArrivalGrid, most: int = MOST_FREQUENCIES) -> ArrivalGrid:
    """Keep frequencies that are spread evenly in logarithm.

    Parameters
    ----------
    grid : ArrivalGrid
    most : int

    Returns
    -------
    ArrivalGrid
        With `most` frequencies or fewer, the lowest and highest among them.
    """
    if grid.frequency_mhz.size <= most:
        return grid
    wanted = np.geomspace(grid.frequency_mhz[0], grid.frequency_mhz[-1], most)
    return grid.take(np.unique(np.abs(np.log(grid.frequency_mhz[:, None] / wanted)).argmin(axis=0)))


def joint_track(
    grid: ArrivalGrid, rotation_period_d: float, draws: int = DRAWS, seed: int = 0, *, from_curve: bool = True
) -> tuple[dict[str, Any], JointFit]:
    """Joint fit of a solution.

    Parameters
    ----------
    grid : ArrivalGrid
        With the timing errors of the solution.
    rotation_period_d : float
        Rotation period of the Sun, days.
    draws : int
        Of which 100 are made in any case.
    seed : int
    from_curve : bool
        The times lie on a smooth curve, of which no more than forty frequencies are taken; otherwise they are the edges
        of channels, independent of one another, and all are.

    Returns
    -------
    joint : dict
        Ready for JSON: as :func:`bella.tracks.joint_json` returns it, with ``times`` (where they come from),
        ``frequencies`` (fitted), ``of_frequencies`` (there were), and ``error_scale`` (by which the errors of edges of
        channels were widened, as in :func:`explained`).
    fit : JointFit
    """
    few = thinned(grid) if from_curve else grid
    model = JointModel(rotation_period_d=rotation_period_d)

    def fitted(scale: float) -> JointFit:
        """Fit with all errors larger by a factor."""
        widened = replace(few, sigma_s=scale * few.sigma_s)
        return fit_joint(widened, model, draws=max(draws, FEWEST_DRAWS), seed=seed)

    size = int(np.isfinite(few.arrival_s).sum())
    fit, scale = (fitted(1.0), 1.0) if from_curve else explained(fitted, size)
    said = joint_json(fit) | {"error_scale": scale}
    count, total = few.frequency_mhz.size, grid.frequency_mhz.size
    times = TABLE if from_curve else "channel edges"
    said["model"] += f"; {times}, {count} of {total} frequencies, timing errors of the solution, {_offsets(fit)}"
    return said | {"times": times, "frequencies": count, "of_frequencies": total}, fit


def as_fitted(grid: ArrivalGrid, joint: Mapping[str, Any]) -> ArrivalGrid:
    """Arrival times as the joint fit of a solution took them.

    Parameters
    ----------
    grid : ArrivalGrid
        That :func:`joint_track` was given.
    joint : mapping
        That it returned.

    Returns
    -------
    ArrivalGrid
    """
    few = thinned(grid) if joint["times"] == TABLE else grid
    return replace(few, sigma_s=float(joint["error_scale"]) * few.sigma_s)


def _offsets(fit: JointFit) -> str:
    if not fit.account.common_assumed:
        return "offsets of the arrival table"
    shared = ", ".join(f"{name} {fit.account.common_sd_s[name]:.1f} s" for name in fit.account.common_assumed)
    return f"offsets assumed of {shared}"


def explained(fitted: Callable[[float], JointFit], size: int) -> tuple[JointFit, float]:
    """Fit with errors as stated or, where the model misses the times by more, with errors as large as the misfit.

    Parameters
    ----------
    fitted : callable
        Fit with all errors larger by a factor.
    size : int
        Number of arrival times.

    Returns
    -------
    fit : JointFit
        With the flag ``poor_fit`` where the errors were widened.
    scale : float
        By what.

    Notes
    -----
    The factor is the root of chi-squared per degree of freedom (Birge 1932, doi:10.1103/PhysRev.40.207). Where the
    misfit is so large that it has no probability, or that no posterior is found, errors are doubled first.
    """
    fit, scale = fitted(1.0), 1.0
    if POOR_FIT not in fit.flags:
        return fit, scale
    while POOR_FIT in fit.flags and _misfit_p(fit) < LEAST_PROBABILITY and scale < MOST_DOUBLED:
        scale *= 2
        fit = fitted(scale)
    if POOR_FIT in fit.flags and _misfit_p(fit) > 0:
        scale *= math.sqrt(float(chdtri(size - 1, _misfit_p(fit))) / (size - 1))
        fit = fitted(scale)
    return replace(fit, flags=tuple(dict.fromkeys((*fit.flags, POOR_FIT)))), scale


def _misfit_p(fit: JointFit) -> float:
    return 0.0 if fit.quality is None else fit.quality.misfit_p


def with_joint_draws(posterior: xr.Dataset, fit: JointFit) -> xr.Dataset:
    """Solution with the draws of its joint fit beside those of its positions.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.
    fit : JointFit

    Returns
    -------
    xarray.Dataset
        With ``joint_draws`` (joint_draw, joint_parameter), ``release_s`` counted from the ``reference_time`` of the
        draws; without them where nothing was fitted.
    """
    if not fit.draws:
        return posterior
    names = (*fit.model.parameters, RELEASE)
    described = {
        "units": "as the name of the parameter says",
        "long_name": "equally weighted posterior draws of the joint fit",
        "comment": f"Spiral, beam and density law fitted to all arrival times together; {APPARENT_SOURCE}",
        "model": fit.model.name,
        "rotation_period_d": fit.model.rotation_period_d,
        "reference_time": f"{np.datetime_as_string(fit.reference_utc, unit='ms')}Z",
    }
    drawn = np.stack([fit.draws[name] for name in names], axis=-1).astype(np.float32)
    return posterior.assign(joint_draws=(("joint_draw", "joint_parameter"), drawn, described)).assign_coords(
        joint_parameter=("joint_parameter", np.array(names, dtype=str), {"long_name": "parameter of the joint fit"})
    )

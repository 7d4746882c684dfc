"""The joint fit of a solution, as it is stored and served: from few enough frequencies for its errors to be honest.

Arrival times on a smooth curve t(f) share their errors. A curve through some forty channels of a spacecraft says no
more than these channels, at however many frequencies it is read, so no more than forty are taken.
"""

from typing import Any

import numpy as np
import xarray as xr

from bella.arrivals import ArrivalGrid
from bella.tracks.joint import fit_joint
from bella.tracks.joint_fit import RELEASE, JointFit, joint_json
from bella.tracks.joint_ingredients import DRAWS
from bella.tracks.joint_model import JointModel

MOST_FREQUENCIES = 40
"""Channels of one STEREO receiver between 0.15 and 2 MHz; coverage was measured with as many."""

FEWEST_DRAWS = 100


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
    grid: ArrivalGrid, rotation_period_d: float, draws: int = DRAWS, seed: int = 0
) -> tuple[dict[str, Any], JointFit]:
    """Joint fit of a solution.

    Parameters
    ----------
    grid : ArrivalGrid
        With the timing errors of the solution; thinned here.
    rotation_period_d : float
        Rotation period of the Sun, days.
    draws : int
        Of which 100 are made in any case.
    seed : int

    Returns
    -------
    joint : dict
        Ready for JSON: as :func:`bella.tracks.joint_json` returns it, with ``frequencies`` (fitted) and
        ``of_frequencies`` (there were).
    fit : JointFit
    """
    few = thinned(grid)
    fit = fit_joint(few, JointModel(rotation_period_d=rotation_period_d), draws=max(draws, FEWEST_DRAWS), seed=seed)
    said = joint_json(fit)
    count, total = few.frequency_mhz.size, grid.frequency_mhz.size
    said["model"] += f"; {count} of {total} frequencies, timing errors of the solution, {_offsets(fit)}"
    return said | {"frequencies": count, "of_frequencies": total}, fit


def _offsets(fit: JointFit) -> str:
    if not fit.account.common_assumed:
        return "offsets of the arrival table"
    shared = ", ".join(f"{name} {fit.account.common_sd_s[name]:.1f} s" for name in fit.account.common_assumed)
    return f"offsets assumed of {shared}"


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
        "comment": "Spiral, beam and density law fitted to the arrival times of all frequencies together.",
        "model": fit.model.name,
        "rotation_period_d": fit.model.rotation_period_d,
        "reference_time": f"{np.datetime_as_string(fit.reference_utc, unit='ms')}Z",
    }
    drawn = np.stack([fit.draws[name] for name in names], axis=-1).astype(np.float32)
    return posterior.assign(joint_draws=(("joint_draw", "joint_parameter"), drawn, described)).assign_coords(
        joint_parameter=("joint_parameter", np.array(names, dtype=str), {"long_name": "parameter of the joint fit"})
    )

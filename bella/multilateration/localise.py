"""From an arrival table to the posterior of the source at every frequency, whatever the method."""

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import pandas as pd
import xarray as xr

from bella.arrivals import ArrivalGrid, arrival_grid, check_arrivals, check_covariance, locate_receivers
from bella.exceptions import InputError
from bella.heliosphere.scattering import DirectionalDelay
from bella.multilateration.exact import exact_posterior
from bella.multilateration.nuts import nuts_posterior
from bella.multilateration.priors import Preset, apply_sigma_rule, find_preset
from bella.multilateration.solution import Recipe, solution_dataset
from bella.multilateration.summary import Posterior
from bella.multilateration.tdoa_posterior import tdoa_posterior
from bella.units import FloatArray


class Method(Protocol):
    """What localises: any function that turns arrival times into a posterior."""

    def __call__(self, grid: ArrivalGrid, recipe: Recipe, advance: Callable[[int], None]) -> Posterior:
        """Compute the posterior of each frequency of the grid."""


METHODS: dict[str, Method] = {"posterior": exact_posterior, "nuts": nuts_posterior, "tdoa": tdoa_posterior}
"""``posterior``: exact, on adaptive cells. ``nuts``: the same model sampled with PyMC, the reference. ``tdoa``: time
differences in closed form or by least squares, at the speed of light and without a prior."""


def check_choices(preset: str | Preset, method: str, dimensions: int = 2) -> None:
    """Refuse what :func:`localise` would refuse, before anything is started.

    Parameters
    ----------
    preset : str or Preset
    method : str
    dimensions : int

    Raises
    ------
    InputError
        Names the choice that is not known, and those that are.
    """
    if isinstance(preset, str):
        find_preset(preset)
    if method not in METHODS:
        raise InputError(f"method {method!r} is not known; choose one of {', '.join(METHODS)}")
    if dimensions not in {2, 3}:
        raise InputError(
            f"{dimensions} dimensions are not supported; use 2, the source in the ecliptic plane, or 3, in space"
        )


def localise(  # noqa: PLR0913
    arrivals: pd.DataFrame,
    *,
    preset: str | Preset = "default",
    method: str = "posterior",
    dimensions: int = 2,
    draws: int = 4000,
    seed: int = 0,
    covariance_s2: FloatArray | None = None,
    delay: DirectionalDelay | None = None,
    advance: Callable[[int], None] = lambda _: None,
) -> xr.Dataset:
    """Locate the source of a burst at every frequency heard by three or more receivers.

    The model is that of Canizares et al. (2024, A&A, doi:10.1051/0004-6361/202347747).

    Parameters
    ----------
    arrivals : pandas.DataFrame
        As :func:`bella.arrivals.check_arrivals` returns it.
    preset : str or Preset
        A name of `bella.multilateration.PRESETS`, or a preset of one's own.
    method : str
        A name of `bella.multilateration.METHODS`.
    dimensions : int
        2: the source is in the ecliptic plane. 3: it is anywhere in space, which takes four receivers, not all in one
        plane with it, to say more of the third coordinate than the prior does.
    draws : int
        Posterior draws to keep per frequency.
    seed : int
    covariance_s2 : ndarray, shape (N, N), optional
        Full covariance of the rows of the table, s^2, in place of its `sigma_s`, `shape_sd_s` and `offset_sd_s`.
    delay : DirectionalDelay, optional
        In place of that of the preset.
    advance : callable
        Told how many frequencies are done since the last call.

    Returns
    -------
    xarray.Dataset
        As :func:`bella.multilateration.solution.solution_dataset` describes.

    Raises
    ------
    InputError
        If preset, method or dimensions are not known, the table cannot be localised, the covariance is not that of its
        rows, or `draws` is below 1.
    NoDataError
        If the time is outside the ephemeris.
    ConvergenceError
        If the method ends without an answer.
    """
    chosen = find_preset(preset) if isinstance(preset, str) else preset
    check_choices(chosen, method, dimensions)
    if draws < 1:
        raise InputError(f"{draws} draws are too few; ask for 1 or more")
    chosen = chosen if delay is None else replace(chosen, delay=delay)
    table = locate_receivers(check_arrivals(arrivals))
    if covariance_s2 is not None:
        check_covariance(covariance_s2, len(table))
    grid = apply_sigma_rule(arrival_grid(table, covariance_s2=covariance_s2), chosen)
    recipe = Recipe(method, chosen, dimensions, draws, seed)
    return solution_dataset(grid, METHODS[method](grid, recipe, advance), recipe)

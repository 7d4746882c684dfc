"""From an arrival table to the posterior of the source at every frequency, as one labelled dataset."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
import pandas as pd
import xarray as xr

import bella
from bella.arrivals import ArrivalGrid, arrival_grid, check_arrivals, check_covariance, locate_receivers
from bella.exceptions import InputError
from bella.flags import APPARENT_SOURCE
from bella.heliosphere.scattering import DirectionalDelay
from bella.multilateration.checks import (
    SHIFT_S,
    ClockCheck,
    check_clocks,
    clock_shift_rsun,
    flags_of,
    late_clocks,
    predictive_check,
)
from bella.multilateration.likelihood import evaluate
from bella.multilateration.nuts import nuts_posterior
from bella.multilateration.posterior import AXES, Draws, Moments, Posterior, Recipe, exact_posterior, parameters
from bella.multilateration.priors import Preset, Priors, apply_sigma_rule, find_preset
from bella.multilateration.problems import problems_of
from bella.multilateration.regions import LEVELS, Region
from bella.multilateration.tdoa import tdoa_posterior
from bella.units import FloatArray

FORMAT_VERSION = 1


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
    """Locate the source of a burst at every frequency received by three or more receivers.

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
        As :func:`solution_dataset` describes.

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
    posterior = METHODS[method](grid, recipe, advance)
    check = check_clocks(grid, posterior.moments.mean, chosen.priors, chosen.delay)
    if check.is_doubtful and method == "posterior" and not chosen.noise.bad_probability:
        clocks = late_clocks(grid, check, recipe, posterior.moments.log_evidence)
        posterior = exact_posterior(grid, recipe, lambda _: None, clocks)
    return solution_dataset(grid, posterior, recipe, check)


VARIABLES = {
    **{f"{axis}_rsun": ("Rsun", f"posterior mean of {axis}") for axis in "xy"},
    "z_rsun": ("Rsun", "posterior mean of z; 0 for a source held in the ecliptic plane"),
    **{f"cov_{a}{b}_rsun2": ("Rsun2", f"posterior covariance of {a} and {b}") for a, b in ("xy", "xz", "yz")},
    **{f"cov_{axis}{axis}_rsun2": ("Rsun2", f"posterior variance of {axis}") for axis in AXES},
    **{f"mode_{axis}_rsun": ("Rsun", f"{axis} of the highest posterior density") for axis in AXES},
    **{f"area{part}_rsun2": ("Rsun2", f"area of the {part} % highest-density region of (x, y)") for part in (68, 95)},
    **{f"volume{level}_rsun3": ("Rsun3", f"volume of the {level} % highest-density region") for level in (68, 95)},
    "modes": ("1", "number of separate maxima of the density"),
    "emission_s": ("s", "posterior mean of the emission time after reference_time"),
    "emission_sd_s": ("s", "posterior standard deviation of the emission time"),
    "v_over_c": ("1", "posterior mean of the propagation speed"),
    "v_over_c_sd": ("1", "posterior standard deviation of the propagation speed"),
    "above_c_probability": ("1", "posterior probability that the propagation speed is above that of light"),
    **{f"contraction_{axis}": ("1", f"posterior over prior standard deviation of {axis}") for axis in AXES},
    "contraction_v": ("1", "posterior over prior standard deviation of the propagation speed"),
    "contraction_emission": ("1", "posterior over prior standard deviation of the emission time"),
    **{f"prior_pull_{axis}_rsun": ("Rsun", f"move of the mean of {axis} by the prior, first order") for axis in AXES},
    "kappa": ("1", "posterior mean of the directional delay, in half widths of the rise"),
    "kappa_sd": ("1", "posterior standard deviation of the directional delay, in half widths of the rise"),
    "contraction_kappa": ("1", "posterior over prior standard deviation of the directional delay"),
    "misfit": ("1", "weighted sum of squared residuals at the highest posterior density"),
    "predictive_p": ("1", "posterior predictive p-value of the sum of squared residuals"),
    "log_evidence": ("1", "natural logarithm of the evidence"),
    "draw_ess": ("1", "effective number of draws"),
    "residual_s": ("s", "arrival time less posterior prediction"),
    "residual_p": ("1", "posterior predictive p-value of the residual"),
    "clock_offset_s": ("s", "how late the receiver is at all frequencies, if it alone is"),
    "clock_offset_sd_s": ("s", "standard deviation of that"),
    **{
        f"clock_shift_{axis}_rsun": ("Rsun", f"move of {axis} if the clock of the receiver were {SHIFT_S:g} s late")
        for axis in AXES
    },
    "bad_probability": ("1", "posterior probability that the arrival time is bad"),
    "mode_weight": ("1", "share of the probability in the basin of each mode, largest first"),
    "mode_mean_rsun": ("Rsun", "mean position in the basin of each mode"),
}
"""Units and meaning of every number of a solution."""


def solution_dataset(
    grid: ArrivalGrid, posterior: Posterior, recipe: Recipe, check: ClockCheck | None = None
) -> xr.Dataset:
    """Label a posterior with its frequencies, units, inputs and recipe.

    Parameters
    ----------
    grid : ArrivalGrid
        With the timing errors that were used.
    check : ClockCheck, optional
        Of the clocks; made from the posterior where it is left out.

    Returns
    -------
    xarray.Dataset
        Draws (frequency, draw, parameter) and, for each frequency, mean, covariance, mode, areas and outlines of the
        68 and 95 % regions, contractions, evidence, flags, and the arrival times they came from.
    """
    of_receiver, predictive_p = of_receivers(grid, posterior, recipe.preset)
    summary = summarise(grid, posterior, recipe.preset) | {"predictive_p": predictive_p}
    dataset = xr.Dataset(
        _named("frequency", summary)
        | _named("frequency observatory", of_receiver)
        | {"draws": (("frequency", "draw", "parameter"), _stacked(posterior.draws), _draws_described())}
        | _modes(posterior.regions)
        | _outlines(posterior.regions)
        | _inputs(grid),
        coords=_coordinates(grid, recipe.dimensions),
        attrs=_provenance(grid, recipe),
    )
    if check is None:
        check = check_clocks(grid, posterior.moments.mean, recipe.preset.priors, recipe.preset.delay)
    dataset["clock_offset_s"] = ("observatory", check.offset_s, _described("clock_offset_s"))
    dataset["clock_offset_sd_s"] = ("observatory", check.offset_sd_s, _described("clock_offset_sd_s"))
    dataset.attrs["clock_offset"] = check.message
    dataset["flags"] = (
        "frequency",
        np.array(flags_of(dataset, posterior.remarks), dtype=str),
        {"long_name": "quality flags", "units": "1"},
    )
    return dataset


Variable = tuple[tuple[str, ...], np.ndarray, dict[str, str]]


def _named(dims: str, columns: Mapping[str, np.ndarray]) -> dict[str, Variable]:
    return {name: (tuple(dims.split()), values, _described(name)) for name, values in columns.items()}


def _described(name: str) -> dict[str, str]:
    units, long_name = VARIABLES[name]
    return {"units": units, "long_name": long_name}


def _modes(regions: Sequence[Region]) -> dict[str, Variable]:
    columns = of_modes(regions)
    return _named("frequency mode", {"mode_weight": columns["mode_weight"]}) | _named(
        "frequency mode xyz", {"mode_mean_rsun": columns["mode_mean_rsun"]}
    )


def _draws_described() -> dict[str, str]:
    return {"units": "as the name of the parameter says", "long_name": "equally weighted posterior draws"}


def _stacked(draws: Draws) -> np.ndarray:
    columns = [*np.moveaxis(draws.position, -1, 0), draws.emission_s, draws.v_over_c]
    return np.stack(columns, axis=-1).astype(np.float32)


def _outlines(regions: Sequence[Region]) -> dict[str, Variable]:
    longest = max(len(outline) for region in regions for outline in region.outlines)
    padded = np.full((len(LEVELS), len(regions), longest, 2), np.nan, dtype=np.float32)
    for row, region in enumerate(regions):
        for level, outline in enumerate(region.outlines):
            padded[level, row, : len(outline)] = outline
    return {
        f"region{round(100 * level)}": (
            ("frequency", "vertex", "axis"),
            padded[i],
            {"units": "Rsun", "long_name": f"outline of the {round(100 * level)} % highest-density region"},
        )
        for i, level in enumerate(LEVELS)
    }


def _inputs(grid: ArrivalGrid) -> dict[str, Variable]:
    of_receiver = ("frequency", "observatory")
    position = {"units": "Rsun", "long_name": "HEE position of the receiver"}
    return {
        "arrival_s": (of_receiver, grid.arrival_s, {"units": "s", "long_name": "arrival time after reference_time"}),
        "sigma_s": (of_receiver, grid.sigma_s, {"units": "s", "long_name": "timing error used"}),
        "shape_sd_s": (of_receiver, grid.shape_sd_s, {"units": "s", "long_name": "error smooth along frequency"}),
        "rise_s": (of_receiver, grid.rise_s, {"units": "s", "long_name": "half width of the rise"}),
        "delay_s": (of_receiver, grid.delay_s, {"units": "s", "long_name": "delay beyond light travel, taken off"}),
        "delay_sd_s": (of_receiver, grid.delay_sd_s, {"units": "s", "long_name": "uncertainty of that delay"}),
        "offset_sd_s": (
            of_receiver,
            grid.offset_sd_s,
            {"units": "s", "long_name": "size of the offset that all channels of the receiver share"},
        ),
        "receiver_rsun": ((*of_receiver, "xyz"), grid.receiver_rsun, position),
    }


def _coordinates(grid: ArrivalGrid, dimensions: int) -> dict[str, object]:
    return {
        "frequency": ("frequency", grid.frequency_mhz, {"units": "MHz", "long_name": "frequency of the channel"}),
        "parameter": np.array(parameters(dimensions), dtype=str),
        "observatory": np.array(grid.observatories, dtype=str),
        "axis": np.array(["x", "y"], dtype=str),
        "xyz": np.array(["x", "y", "z"], dtype=str),
    }


def _provenance(grid: ArrivalGrid, recipe: Recipe) -> dict[str, object]:
    priors = recipe.preset.priors
    return {
        "Conventions": "CF-1.11",
        "title": "Posterior of the apparent source of a Type III radio burst, one per frequency",
        "comment": f"{APPARENT_SOURCE}, nor for refraction",
        "frame": "HEE",
        "reference_time": f"{np.datetime_as_string(grid.reference_utc, unit='ms')}Z",
        "method": recipe.method,
        "preset": recipe.preset.name,
        "edge": grid.edge,
        "dimensions": recipe.dimensions,
        "tau_rsun": priors.tau_rsun,
        "position_prior_power": priors.power,
        "position_prior_sd_rsun": priors.position_sd_rsun(recipe.dimensions),
        "kappa_prior": recipe.preset.delay.kappa,
        "kappa_prior_sd": recipe.preset.delay.kappa_sd,
        "v_prior_sd_over_c": priors.v_sd_c,
        "v_max_over_c": priors.v_max_c,
        "bad_arrival_probability": recipe.preset.noise.bad_probability,
        "bad_arrival_sd_s": recipe.preset.noise.bad_sd_s,
        "emission_half_width_s": priors.emission_half_width_s,
        "sigma_rule": recipe.preset.rule,
        "seed": recipe.seed,
        "bella_version": bella.__version__,
        "format_version": FORMAT_VERSION,
    }


def summarise(grid: ArrivalGrid, posterior: Posterior, preset: Preset) -> dict[str, FloatArray]:
    """Numbers of each frequency, shape (F,).

    Returns
    -------
    dict of str to ndarray
        A subset of `VARIABLES`; those of z and the volumes only for a source in space.
    """
    moments, priors = posterior.moments, preset.priors
    return {
        **_of_position(posterior, priors),
        **_of_delay(moments, preset),
        "emission_s": moments.emission_s,
        "emission_sd_s": moments.emission_sd_s,
        "v_over_c": moments.v_over_c,
        "v_over_c_sd": moments.v_over_c_sd,
        "above_c_probability": moments.above_c,
        "contraction_v": np.where(moments.v_over_c_sd > 0, moments.v_over_c_sd / priors.speed_sd_c, 1.0),
        "contraction_emission": moments.emission_sd_s / (priors.emission_half_width_s / np.sqrt(3)),
        "misfit": _misfit(grid, posterior, preset),
        "log_evidence": moments.log_evidence,
        "draw_ess": posterior.draws.effective,
    }


def _of_position(posterior: Posterior, priors: Priors) -> dict[str, FloatArray]:
    moments, regions = posterior.moments, posterior.regions
    axes = AXES[: moments.mean.shape[1]]
    prior_sd_rsun = priors.position_sd_rsun(len(axes))
    highest = np.array([region.mode_rsun for region in regions])
    columns: dict[str, FloatArray] = {"z_rsun": np.zeros(len(regions))}
    for i, axis in enumerate(axes):
        columns[f"{axis}_rsun"] = moments.mean[:, i]
        columns[f"mode_{axis}_rsun"] = highest[:, i]
        columns[f"contraction_{axis}"] = np.sqrt(moments.covariance[:, i, i]) / prior_sd_rsun
        columns[f"prior_pull_{axis}_rsun"] = moments.prior_pull[:, i]
        columns |= {f"cov_{axis}{axes[j]}_rsun2": moments.covariance[:, i, j] for j in range(i, len(axes))}
    for i, level in enumerate(round(100 * level) for level in LEVELS):
        columns[f"area{level}_rsun2"] = np.array([region.area_rsun2[i] for region in regions])
        if len(axes) == len(AXES):
            columns[f"volume{level}_rsun3"] = np.array([region.volume_rsun3[i] for region in regions])
    columns["modes"] = np.array([region.modes.weight.size for region in regions], dtype=np.int16)
    return columns


def _of_delay(moments: Moments, preset: Preset) -> dict[str, FloatArray]:
    """Of a delay that is fixed, or that there is not, nothing is measured: its contraction is 1."""
    free = preset.delay.kappa_sd > 0
    return {
        "kappa": moments.kappa,
        "kappa_sd": moments.kappa_sd,
        "contraction_kappa": moments.kappa_sd / preset.delay.kappa_sd if free else np.ones_like(moments.kappa),
    }


def _misfit(grid: ArrivalGrid, posterior: Posterior, preset: Preset) -> FloatArray:
    """Of the likeliest component of the noise at the highest density, shape (F,)."""
    highest = np.array([region.mode_rsun for region in posterior.regions]).T
    problems = problems_of(grid, preset.priors, len(highest), preset.noise, preset.delay)
    local = evaluate(problems, highest)
    likeliest = local.log_density.argmax(axis=0)
    return np.asarray(np.take_along_axis(local.misfit, likeliest[None], axis=0)[0])


def of_receivers(grid: ArrivalGrid, posterior: Posterior, preset: Preset) -> tuple[dict[str, FloatArray], FloatArray]:
    """Residuals of each receiver, shape (F, n), and the predictive p-value of each frequency, shape (F,)."""
    check = predictive_check(grid, posterior.draws, posterior.moments.bad_probability)
    bad = np.where(np.isfinite(grid.arrival_s), posterior.moments.bad_probability, np.nan)
    columns = {"residual_s": check.residual_s, "residual_p": check.receiver_p, "bad_probability": bad}
    moments = posterior.moments
    shift = clock_shift_rsun(grid, moments.mean, moments.covariance, preset.priors, preset.delay)
    columns |= {f"clock_shift_{axis}_rsun": shift[..., i] for i, axis in enumerate(AXES[: shift.shape[-1]])}
    return columns, check.burst_p


def of_modes(regions: Sequence[Region]) -> Mapping[str, FloatArray]:
    """Weight (F, J) and mean position (F, J, 3) of modes; weight 0 and position NaN where there are fewer than J."""
    most = max(region.modes.weight.size for region in regions)
    weight = np.zeros((len(regions), most))
    mean = np.full((len(regions), most, 3), np.nan)
    for row, region in enumerate(regions):
        number, dimensions = region.modes.mean_rsun.shape
        weight[row, :number] = region.modes.weight
        mean[row, :number] = 0.0
        mean[row, :number, :dimensions] = region.modes.mean_rsun
    return {"mode_weight": weight, "mode_mean_rsun": mean}

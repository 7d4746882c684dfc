"""The posterior of a burst as one labelled dataset: what the store keeps and everything downstream reads."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

import bella
from bella.arrivals import ArrivalGrid
from bella.flags import APPARENT_SOURCE
from bella.multilateration.clocks import check_clocks
from bella.multilateration.draws import Draws
from bella.multilateration.flags import flags_of
from bella.multilateration.priors import Preset
from bella.multilateration.regions import LEVELS, Region
from bella.multilateration.summary import AXES, VARIABLES, Posterior, of_modes, of_receivers, summarise

FORMAT_VERSION = 1


@dataclass(frozen=True)
class Recipe:
    """How a posterior was made."""

    method: str
    preset: Preset
    dimensions: int
    draws: int
    seed: int


def solution_dataset(grid: ArrivalGrid, posterior: Posterior, recipe: Recipe) -> xr.Dataset:
    """Label a posterior with its frequencies, units, inputs and recipe.

    Parameters
    ----------
    grid : ArrivalGrid
        With the timing errors that were used.
    posterior : Posterior
    recipe : Recipe

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


def parameters(dimensions: int) -> tuple[str, ...]:
    """Names of the parameters of a draw, in order."""
    return (*(f"{axis}_rsun" for axis in AXES[:dimensions]), "emission_s", "v_over_c")


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

"""The posterior of a burst as one labelled dataset: what the store keeps and everything downstream reads."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

import bella
from bella.arrivals import ArrivalGrid
from bella.multilateration.draws import Draws
from bella.multilateration.flags import flags_of
from bella.multilateration.likelihood import evaluate, problems_of
from bella.multilateration.moments import Moments
from bella.multilateration.priors import Preset
from bella.multilateration.regions import LEVELS, Region
from bella.units import FloatArray

FORMAT_VERSION = 1
PARAMETERS = ("x_rsun", "y_rsun", "emission_s", "v_over_c")


@dataclass(frozen=True)
class Posterior:
    """What any method hands over for the frequencies of a grid."""

    draws: Draws
    moments: Moments
    regions: Sequence[Region]


@dataclass(frozen=True)
class Recipe:
    """How a posterior was made."""

    method: str
    preset: Preset
    dimensions: int
    draws: int
    seed: int


_VARIABLES = {
    "x_rsun": ("Rsun", "posterior mean of x"),
    "y_rsun": ("Rsun", "posterior mean of y"),
    "z_rsun": ("Rsun", "z of the plane of the source"),
    "cov_xx_rsun2": ("Rsun2", "posterior variance of x"),
    "cov_xy_rsun2": ("Rsun2", "posterior covariance of x and y"),
    "cov_yy_rsun2": ("Rsun2", "posterior variance of y"),
    "mode_x_rsun": ("Rsun", "x of the highest posterior density"),
    "mode_y_rsun": ("Rsun", "y of the highest posterior density"),
    "area68_rsun2": ("Rsun2", "area of the 68 % highest-density region"),
    "area95_rsun2": ("Rsun2", "area of the 95 % highest-density region"),
    "modes": ("1", "number of separate maxima of the density"),
    "emission_s": ("s", "posterior mean of the emission time after reference_time"),
    "emission_sd_s": ("s", "posterior standard deviation of the emission time"),
    "v_over_c": ("1", "posterior mean of the propagation speed"),
    "v_over_c_sd": ("1", "posterior standard deviation of the propagation speed"),
    "contraction_x": ("1", "posterior over prior standard deviation of x"),
    "contraction_y": ("1", "posterior over prior standard deviation of y"),
    "contraction_v": ("1", "posterior over prior standard deviation of the propagation speed"),
    "misfit": ("1", "weighted sum of squared residuals at the highest posterior density"),
    "log_evidence": ("1", "natural logarithm of the evidence"),
    "draw_ess": ("1", "effective number of draws"),
}


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
    summary = _summary(posterior, recipe.preset) | {"misfit": _misfit(grid, posterior, recipe)}
    dataset = xr.Dataset(
        {name: ("frequency", values, _described(name)) for name, values in summary.items()}
        | {"draws": (("frequency", "draw", "parameter"), _stacked(posterior.draws), _draws_described())}
        | _outlines(posterior.regions)
        | _inputs(grid),
        coords=_coordinates(grid),
        attrs=_provenance(grid, recipe),
    )
    dataset["flags"] = (
        "frequency",
        np.array(flags_of(dataset), dtype=str),
        {"long_name": "quality flags", "units": "1"},
    )
    return dataset


def _described(name: str) -> dict[str, str]:
    units, long_name = _VARIABLES[name]
    return {"units": units, "long_name": long_name}


def _draws_described() -> dict[str, str]:
    return {"units": "as the name of the parameter says", "long_name": "equally weighted posterior draws"}


def _summary(posterior: Posterior, preset: Preset) -> dict[str, FloatArray]:
    moments, regions = posterior.moments, posterior.regions
    sd = np.sqrt(np.einsum("bii->bi", moments.covariance))
    modes = np.array([region.mode_rsun for region in regions])
    areas = np.array([region.area_rsun2 for region in regions])
    return {
        "x_rsun": moments.mean[:, 0],
        "y_rsun": moments.mean[:, 1],
        "z_rsun": np.zeros(len(regions)),
        "cov_xx_rsun2": moments.covariance[:, 0, 0],
        "cov_xy_rsun2": moments.covariance[:, 0, 1],
        "cov_yy_rsun2": moments.covariance[:, 1, 1],
        "mode_x_rsun": modes[:, 0],
        "mode_y_rsun": modes[:, 1],
        "area68_rsun2": areas[:, 0],
        "area95_rsun2": areas[:, 1],
        "modes": np.array([region.modes for region in regions], dtype=np.int16),
        "emission_s": moments.emission_s,
        "emission_sd_s": moments.emission_sd_s,
        "v_over_c": moments.v_over_c,
        "v_over_c_sd": moments.v_over_c_sd,
        "contraction_x": sd[:, 0] / preset.priors.tau_rsun,
        "contraction_y": sd[:, 1] / preset.priors.tau_rsun,
        "contraction_v": moments.v_over_c_sd / preset.priors.v_sd_c,
        "log_evidence": moments.log_evidence,
        "draw_ess": posterior.draws.effective,
    }


def _misfit(grid: ArrivalGrid, posterior: Posterior, recipe: Recipe) -> FloatArray:
    problems = problems_of(grid, recipe.preset.priors, recipe.dimensions)
    modes = np.array([region.mode_rsun for region in posterior.regions])
    return evaluate(problems, modes.T, np.arange(problems.count)).misfit


def _stacked(draws: Draws) -> np.ndarray:
    columns = [*np.moveaxis(draws.position, -1, 0), draws.emission_s, draws.v_over_c]
    return np.stack(columns, axis=-1).astype(np.float32)


def _outlines(regions: Sequence[Region]) -> dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]]:
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


def _inputs(grid: ArrivalGrid) -> dict[str, tuple[tuple[str, ...], FloatArray, dict[str, str]]]:
    of_receiver = ("frequency", "observatory")
    position = {"units": "Rsun", "long_name": "HEE position of the receiver"}
    return {
        "arrival_s": (of_receiver, grid.arrival_s, {"units": "s", "long_name": "arrival time after reference_time"}),
        "sigma_s": (of_receiver, grid.sigma_s, {"units": "s", "long_name": "timing error used"}),
        "receiver_rsun": ((*of_receiver, "xyz"), grid.receiver_rsun, position),
    }


def _coordinates(grid: ArrivalGrid) -> dict[str, object]:
    return {
        "frequency": ("frequency", grid.frequency_mhz, {"units": "MHz", "long_name": "frequency of the channel"}),
        "parameter": np.array(PARAMETERS, dtype=str),
        "observatory": np.array(grid.observatories, dtype=str),
        "axis": np.array(["x", "y"], dtype=str),
        "xyz": np.array(["x", "y", "z"], dtype=str),
    }


def _provenance(grid: ArrivalGrid, recipe: Recipe) -> dict[str, object]:
    priors = recipe.preset.priors
    return {
        "Conventions": "CF-1.11",
        "title": "Posterior of the apparent source of a Type III radio burst, one per frequency",
        "comment": "Apparent source: no correction for scattering or refraction.",
        "frame": "HEE",
        "reference_time": f"{np.datetime_as_string(grid.reference_utc, unit='ms')}Z",
        "method": recipe.method,
        "preset": recipe.preset.name,
        "edge": grid.edge,
        "dimensions": recipe.dimensions,
        "tau_rsun": priors.tau_rsun,
        "v_prior_sd_over_c": priors.v_sd_c,
        "emission_half_width_s": priors.emission_half_width_s,
        "sigma_rule": recipe.preset.rule,
        "seed": recipe.seed,
        "bella_version": bella.__version__,
        "format_version": FORMAT_VERSION,
    }

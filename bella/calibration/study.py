"""Truth against posterior, source by source."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bella.arrivals import ArrivalGrid
from bella.calibration.coverage import Coverage
from bella.calibration.ranks import fractional_ranks
from bella.calibration.strata import Stratum
from bella.calibration.truths import Truths, arrival_grid, draw_truths
from bella.exceptions import InputError
from bella.multilateration.posterior import AXES, Posterior, Recipe, exact_posterior
from bella.multilateration.priors import Preset
from bella.multilateration.problems import Problems, problems_of
from bella.multilateration.regions import LEVELS, log_density
from bella.units import FloatArray

DRAWS = 999
"""Draws per source: ranks then take 1000 values, which bins of equal width share evenly."""
TOGETHER = 25
"""Sources whose draws have their density evaluated at once."""

FEWEST_SOURCES = 20


@dataclass(frozen=True)
class Comparison:
    """What the sources of a stratum say of their posteriors.

    Attributes
    ----------
    ranks : dict of str to ndarray, shape (B,)
        Fractional ranks of x, y, z, emission time, speed, and the density at the position.
    covered : dict of float to ndarray of bool, shape (B,)
        Whether the position lies in the highest-density region of each level.
    effective_share : ndarray, shape (B,)
        Effective number of draws over their number.
    """

    stratum: Stratum
    ranks: dict[str, FloatArray]
    covered: dict[float, npt.NDArray[np.bool_]]
    effective_share: FloatArray

    @property
    def sources(self) -> int:
        """Number of sources B."""
        return int(self.effective_share.size)

    @property
    def coverage(self) -> dict[float, Coverage]:
        """Coverage of each level."""
        return {level: Coverage(level, int(inside.sum()), self.sources) for level, inside in self.covered.items()}


def check_sources(number: int) -> None:
    """Refuse a number of sources that says nothing.

    Raises
    ------
    InputError
        If it is below `FEWEST_SOURCES`.
    """
    if number < FEWEST_SOURCES:
        raise InputError(f"{number} sources say nothing about calibration; give --sources {FEWEST_SOURCES} or more")


def run_stratum(stratum: Stratum, sources: int, seed: int, advance: Callable[[int], None]) -> Comparison:
    """Draw sources, fit them with the exact posterior, and compare.

    Parameters
    ----------
    sources : int
        Their number.
    seed : int
        Each stratum has random numbers of its own: the answer does not depend on which others are run.
    advance : callable
        Told how many sources are done since the last call.

    Raises
    ------
    InputError
        If there are too few sources.
    ConvergenceError
        If a posterior cannot be computed; it names the source by its number, as a frequency.
    """
    check_sources(sources)
    rng = np.random.default_rng([seed, zlib.crc32(stratum.name.encode())])
    truths = draw_truths(stratum, sources, rng)
    grid = arrival_grid(stratum, truths, rng)
    posterior = exact_posterior(grid, recipe_of(stratum, int(rng.integers(2**31))), advance)
    return compare(stratum, truths, grid, posterior, rng)


def recipe_of(stratum: Stratum, seed: int) -> Recipe:
    """Recipe with which a stratum is fitted."""
    preset = Preset(stratum.name, stratum.priors, "table", noise=stratum.noise, delay=stratum.delay)
    return Recipe("posterior", preset, stratum.dimensions, DRAWS, seed)


def compare(
    stratum: Stratum, truths: Truths, grid: ArrivalGrid, posterior: Posterior, rng: np.random.Generator
) -> Comparison:
    """Compare truths with posteriors.

    Besides the parameters, the density at the position is ranked: it sees regions of the wrong size or shape that no
    single parameter shows (Modrák et al. 2025, doi:10.1214/23-BA1404).

    Parameters
    ----------
    posterior : Posterior
        Of the rows of the grid.
    rng : numpy.random.Generator
        Breaks ties.
    """
    problems = problems_of(grid, stratum.priors, stratum.dimensions, stratum.noise, stratum.delay)
    draws, at_truth = posterior.draws, log_density(problems, truths.position_rsun.T)
    pairs = {
        **{AXES[i]: (truths.position_rsun[:, i], draws.position[..., i]) for i in range(stratum.dimensions)},
        "emission": (truths.emission_s, draws.emission_s),
        "speed": (truths.v_over_c, draws.v_over_c),
        "density": (at_truth, _density_of_draws(problems, draws.position)),
    }
    threshold = np.array([region.log_threshold for region in posterior.regions])
    return Comparison(
        stratum,
        ranks={name: fractional_ranks(truth, drawn, rng) for name, (truth, drawn) in pairs.items()},
        covered={level: at_truth >= threshold[:, i] for i, level in enumerate(LEVELS)},
        effective_share=draws.effective / draws.emission_s.shape[1],
    )


def _density_of_draws(problems: Problems, position: FloatArray) -> FloatArray:
    """Log density at draws (B, L, D), as (B, L), a few problems at a time so that memory stays bounded."""
    parts = [slice(first, first + TOGETHER) for first in range(0, len(position), TOGETHER)]
    return np.concatenate(
        [
            log_density(problems.at(some).spread(), np.moveaxis(position[some].astype(np.float64), -1, 0))
            for some in parts
        ]
    )

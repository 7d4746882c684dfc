"""Simulation-based calibration in small, and coverage of the regions (Talts et al. 2018, arXiv:1804.06788)."""

from functools import lru_cache

import numpy as np
import pytest
from scipy import stats

from bella.multilateration.posterior import Posterior, Recipe, exact_posterior
from bella.multilateration.priors import Preset, Priors
from tests.multilateration.geometry import CADENCE_S, EVENT, grid_of, inside, on_spiral

SIMULATIONS, DRAWS, BINS = 200, 1000, 10
TESTS = 4 * 2 * 2


@lru_cache
def simulated(v_sd_c: float) -> tuple[np.ndarray, Posterior]:
    """Truths (simulation, x y emission v) drawn from the prior, and the posterior of their noisy arrival times."""
    rng = np.random.default_rng(20120607)
    priors = Priors(v_sd_c=v_sd_c)
    position = rng.normal(0, priors.tau_rsun, (SIMULATIONS, 2))
    v, emission = rng.normal(1, v_sd_c, SIMULATIONS), rng.uniform(-3000, 3000, SIMULATIONS)
    grid = grid_of(
        np.c_[position, np.zeros(SIMULATIONS)],
        EVENT,
        CADENCE_S,
        noise=rng.standard_normal((SIMULATIONS, 3)),
        v_over_c=v,
        emission_s=emission,
    )
    recipe = Recipe("posterior", Preset("case", priors, "table"), 2, DRAWS, 11)
    return np.c_[position, emission, v], exact_posterior(grid, recipe, lambda _: None)


@pytest.mark.parametrize("v_sd_c", [0.001, 0.1])
def test_truths_rank_evenly_among_the_draws(v_sd_c) -> None:
    truth, posterior = simulated(v_sd_c)
    draws = posterior.draws
    columns = (draws.position[..., 0], draws.position[..., 1], draws.emission_s, draws.v_over_c)
    for column, name in zip(range(4), "xytv", strict=True):
        rank = ((columns[column] < truth[:, column, None]).sum(axis=1) + 0.5) / (DRAWS + 1)
        assert stats.kstest(rank, "uniform").pvalue > 0.001 / TESTS, name
        counts = np.histogram(rank, bins=BINS, range=(0, 1))[0]
        assert stats.chisquare(counts).pvalue > 0.001 / TESTS, name


@pytest.mark.parametrize("v_sd_c", [0.001, 0.1])
def test_sources_from_the_prior_lie_in_their_regions_as_often_as_said(v_sd_c) -> None:
    truth, posterior = simulated(v_sd_c)
    check_coverage(truth[:, :2], posterior)


def test_sources_on_a_spiral_lie_in_their_regions_as_often_as_said() -> None:
    rng = np.random.default_rng(7)
    sources = np.array([on_spiral(r) for r in rng.uniform(10, 150, SIMULATIONS)])
    grid = grid_of(sources, EVENT, CADENCE_S, noise=rng.standard_normal((SIMULATIONS, 3)))
    recipe = Recipe("posterior", Preset("case", Priors(), "table"), 2, 10, 0)

    check_coverage(sources[:, :2], exact_posterior(grid, recipe, lambda _: None))


def check_coverage(sources: np.ndarray, posterior: Posterior) -> None:
    for i, level in enumerate((0.68, 0.95)):
        hits = sum(
            bool(inside(region.outlines[i], source[None])[0])
            for region, source in zip(posterior.regions, sources, strict=True)
        )
        low, high = stats.binom.interval(0.999, SIMULATIONS, level)
        assert low <= hits <= high, level

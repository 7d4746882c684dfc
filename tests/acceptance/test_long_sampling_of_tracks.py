"""The joint fit against sampling of the identical posterior, so long that its own error is below what is asked."""

import numpy as np
import pytest

from bella.tracks import Ingredients, JointModel, JointOptions, WindPrior, fit_ingredients, fit_joint, sample_joint_nuts
from bella.tracks.joint_nuts import try_nuts
from tests.tracks.bursts import simulated, standard, towards_source

pytestmark = pytest.mark.acceptance
MODEL = JointModel()


@pytest.mark.parametrize("offset_s", [0.0, 20.0])
def test_mean_within_a_twentieth_and_width_within_a_sixteenth(offset_s: float) -> None:
    grid = simulated(standard(MODEL, 30.0, 400.0), MODEL, np.random.default_rng(3))
    fit = fit_joint(grid, common_sd_s=offset_s, draws=40_000)
    sampled = sample_joint_nuts(grid, common_sd_s=offset_s, draws=40_000)

    assert sampled["effective"] > 5_000
    for name, found in fit.summary.items():
        sd = sampled[name].std()
        assert abs(found.mean - sampled[name].mean()) <= 0.05 * sd, name
        assert abs(found.sd / sd - 1) <= 1 / 16, name


def test_all_ingredients_have_the_same_posterior() -> None:
    z, rng = standard(MODEL, 30.0, 400.0), np.random.default_rng(1)
    grid = simulated(z, MODEL, rng)
    known = Ingredients(grid, None, towards_source(z, MODEL, rng), WindPrior(395.0, 25.0))
    fit = fit_ingredients(known, MODEL, JointOptions(draws=40_000, robust=False))
    sampled = try_nuts(MODEL, known.observed(), JointOptions(draws=40_000))
    assert sampled is not None
    for name, found in fit.summary.items():
        sd = sampled[name].std()
        assert abs(found.mean - sampled[name].mean()) <= 0.05 * sd, name
        assert abs(found.sd / sd - 1) <= 1 / 16, name


def test_pymc_stands_in_where_importance_sampling_fails() -> None:
    """Errors of minutes and two slopes leave a posterior that bends too much."""
    rng = np.random.default_rng(4)
    grid = simulated(rng.standard_normal(5), MODEL, rng, scale=5.0)
    bent = JointModel(two_slope=True)
    weak = fit_ingredients(Ingredients(grid), bent)
    long = fit_ingredients(Ingredients(grid), bent, JointOptions(draws=40_000))
    fit = fit_ingredients(Ingredients(grid), bent, JointOptions(fallback=True))
    assert (weak.account.sampler, fit.account.sampler) == ("importance", "nuts")
    assert "poor_weights" in weak.flags
    assert "poor_weights" not in fit.flags
    for name, found in fit.summary.items():
        assert abs(found.mean - long.summary[name].mean) < 0.3 * found.sd, name

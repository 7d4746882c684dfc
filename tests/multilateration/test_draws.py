"""Draws of the exact posterior: do they say what its moments say, and are they draws at all?"""

import numpy as np
import pytest
from scipy import stats

from bella.multilateration.cells import divide
from bella.multilateration.posterior import Draws, Moments, draw, moments_of
from bella.multilateration.problems import problems_of
from tests.multilateration.geometry import CADENCE_S, EVENT, FIVE, NARROW, WIDE, grid_of, on_spiral, sd_of, spread

NUMBER = 4000
CASES = {
    "event": (on_spiral(75), EVENT, CADENCE_S, NARROW),
    "event, free speed": (on_spiral(75), EVENT, CADENCE_S, WIDE),
    "five receivers, free speed": (on_spiral(100), FIVE, 7.0, WIDE),
    "five receivers, coarse timing, free speed": (on_spiral(150), FIVE, 20.0, WIDE),
    "two branches": ((186.0, -45.0, 0.0), spread(40), 7.0, NARROW),
    "near one line": ((40.0, 60.0, 0.0), spread(170), 20.0, WIDE),
    "wide": ((-30.0, -100.0, 0.0), spread(10), 60.0, NARROW),
}


def solve(name: str, number: int = NUMBER, seed: int = 3) -> tuple[Moments, Draws, float]:
    source, receivers, sigma_s, priors = CASES[name]
    problems = problems_of(grid_of(source, receivers, sigma_s, emission_s=-77.0), priors, 2)
    cells = divide(problems)
    return moments_of(problems, cells), draw(problems, cells, number, np.random.default_rng(seed)), priors.v_sd_c


@pytest.mark.parametrize("name", CASES)
def test_draws_have_the_exact_moments(name) -> None:
    exact, draws, _ = solve(name)
    position = draws.position[0]
    error = 4.5 / np.sqrt(0.9 * NUMBER)

    np.testing.assert_allclose((position.mean(axis=0) - exact.mean[0]) / sd_of(exact)[0], 0, atol=error)
    np.testing.assert_allclose(position.std(axis=0) / sd_of(exact)[0], 1, atol=1.2 * error)
    correlation = exact.covariance[0, 0, 1] / sd_of(exact)[0].prod()
    assert np.corrcoef(position.T)[0, 1] == pytest.approx(correlation, abs=error)
    for values, mean, sd in (
        (draws.emission_s[0], exact.emission_s[0], exact.emission_sd_s[0]),
        (draws.v_over_c[0], exact.v_over_c[0], exact.v_over_c_sd[0]),
    ):
        assert (values.mean() - mean) / sd == pytest.approx(0, abs=error)
        assert values.std() / sd == pytest.approx(1, abs=1.2 * error)


@pytest.mark.parametrize("name", CASES)
def test_draws_are_as_many_as_they_are_said_to_be_and_in_no_order(name) -> None:
    _, draws, _ = solve(name)

    assert draws.position.shape == (1, NUMBER, 2)
    assert 0.98 * NUMBER <= draws.effective[0] <= NUMBER * (1 + 1e-9)
    for values in (*draws.position[0].T, draws.emission_s[0], draws.v_over_c[0]):
        # rank correlation of neighbours; the moments of ranks do not depend on the shape of the posterior
        ranks = stats.rankdata(values)
        assert abs(np.corrcoef(ranks[:-1], ranks[1:])[0, 1]) < 4.5 / np.sqrt(NUMBER)
        halves = stats.ks_2samp(values[: NUMBER // 2], values[NUMBER // 2 :])
        assert halves.pvalue > 1e-4


def test_arrival_times_follow_from_each_draw() -> None:
    """Residuals of draws have the size of the timing errors: emission time, speed and position belong together."""
    source, receivers, sigma_s, _ = CASES["five receivers, free speed"]
    grid = grid_of(source, receivers, sigma_s, emission_s=-77.0)
    _, draws, _ = solve("five receivers, free speed")
    distance = np.linalg.norm(draws.position[0][:, None, :] - receivers[:, :2], axis=2)
    model = draws.emission_s[0][:, None] + distance / (draws.v_over_c[0][:, None] * 299_792.458 / 695_700.0)
    chi2 = (((model - grid.arrival_s[0]) / sigma_s) ** 2).sum(axis=1)

    # noise-free data: the posterior of 4 nearly Gaussian parameters spreads chi2 as 4 degrees of freedom do
    assert chi2.mean() == pytest.approx(4, abs=0.5)


def test_the_seed_decides() -> None:
    one, same, other = (solve("event, free speed", seed=seed)[1] for seed in (3, 3, 4))

    np.testing.assert_array_equal(one.position, same.position)
    np.testing.assert_array_equal(one.v_over_c, same.v_over_c)
    np.testing.assert_array_equal(one.emission_s, same.emission_s)
    assert not np.array_equal(one.position, other.position)


def test_problems_solved_together_keep_their_own_draws() -> None:
    sources = np.array([on_spiral(10), on_spiral(80), (-120.0, 60.0, 0.0), on_spiral(150)])
    problems = problems_of(grid_of(sources, FIVE, 5.0), NARROW, 2)
    cells = divide(problems)
    exact, draws = moments_of(problems, cells), draw(problems, cells, 500, np.random.default_rng(0))

    np.testing.assert_allclose((draws.position.mean(axis=1) - exact.mean) / sd_of(exact), 0, atol=4.5 / np.sqrt(450))
    assert (draws.effective > 450).all()


@pytest.mark.parametrize("number", [1, 2, 7])
def test_few_draws_are_possible(number) -> None:
    _, draws, _ = solve("event, free speed", number=number)

    assert draws.position.shape == (1, number, 2)
    assert np.isfinite(draws.position).all()
    assert np.isfinite(draws.v_over_c).all()

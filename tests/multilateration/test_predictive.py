"""Residuals of the arrival times against the posterior, and whether they are likely."""

from dataclasses import replace

import numpy as np
import pytest

from tests.multilateration.geometry import CADENCE_S, EVENT, FIVE, ROBUST, first, grid_of, on_spiral


def test_noise_free_times_leave_no_residual_where_the_posterior_is_narrow() -> None:
    solved = first(grid_of(on_spiral(60), FIVE, 2.0), draws=4000)

    np.testing.assert_allclose(solved["residual_s"], 0.0, atol=0.2)
    assert float(solved["predictive_p"]) > 0.6
    assert (solved["residual_p"] > 0.3).all()


def test_residuals_add_up_to_nothing_because_the_emission_time_is_free() -> None:
    noise = np.array([0.4, -1.1, 0.6, 0.9, -0.7])
    solved = first(grid_of(on_spiral(60), FIVE, np.array([60.0, 38.0, 38.0, 16.0, 20.0]), noise=noise), draws=2000)

    assert float((solved["residual_s"] / solved["sigma_s"] ** 2).sum()) == pytest.approx(0, abs=1e-6)


def test_residuals_are_those_of_a_least_squares_fit_where_the_posterior_is_narrow() -> None:
    """Five times, three parameters: the residual lies in the two directions that no parameter can follow."""
    grid = grid_of(on_spiral(60), FIVE, 2.0, noise=np.array([0.5, -0.5, 0.25, 0.75, -1.0]))
    offset = on_spiral(60) - FIVE
    design = np.c_[np.ones(5), offset[:, :2] / np.linalg.norm(offset, axis=1)[:, None]]
    noise_s = np.array([1.0, -1.0, 0.5, 1.5, -2.0])
    expected = noise_s - design @ np.linalg.lstsq(design, noise_s, rcond=None)[0]

    np.testing.assert_allclose(first(grid, draws=4000)["residual_s"], expected, atol=0.15)


def test_a_late_time_has_an_unlikely_residual() -> None:
    grid = grid_of(on_spiral(60), FIVE, 5.0)
    late = replace(grid, arrival_s=grid.arrival_s + np.array([[0, 0, 0, 60.0, 0]]))
    solved = first(late, draws=2000)

    assert float(solved["predictive_p"]) < 1e-3
    assert float(solved["residual_p"].min()) < 0.01
    robust = first(late, preset=ROBUST, draws=2000)
    assert int(np.abs(robust["residual_s"]).argmax("observatory")) == 3
    assert float(robust["residual_s"][3]) == pytest.approx(60, abs=10)


def test_p_values_of_good_times_are_not_small() -> None:
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((40, 5))
    small = 0
    for row in noise:
        small += float(first(grid_of(on_spiral(60), FIVE, 30.0, noise=row), draws=400)["predictive_p"]) < 0.05
    assert small <= 3


def test_receivers_that_are_missing_have_no_residual() -> None:
    grid = grid_of([on_spiral(60), on_spiral(60)], FIVE, 20.0)
    arrival = grid.arrival_s.copy()
    arrival[0, 4] = np.nan
    from bella.multilateration.localise import solution_dataset
    from bella.multilateration.posterior import Recipe, exact_posterior
    from bella.multilateration.priors import PRESETS

    recipe = Recipe("posterior", PRESETS["default"], 2, 400, 0)
    gap = replace(grid, arrival_s=arrival)
    solved = solution_dataset(gap, exact_posterior(gap, recipe, lambda _: None), recipe)

    for name in ("residual_s", "residual_p", "bad_probability"):
        assert np.isnan(solved[name]).values.tolist() == [[False] * 4 + [True], [False] * 5], name
    assert np.isfinite(solved["predictive_p"]).all()


def test_three_receivers_fit_nearly_anything() -> None:
    late = grid_of(on_spiral(60), EVENT, CADENCE_S, noise=np.array([2.0, -2.0, 2.0]))
    assert float(first(late, draws=1000)["predictive_p"]) > 0.2

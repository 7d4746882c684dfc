"""The exact posterior against a brute-force sum, against itself, and at the edge of what it takes."""

from dataclasses import replace

import numpy as np
import pytest

from bella.exceptions import BellaError, ConvergenceError
from bella.multilateration import cells as cells_module
from bella.multilateration.localise import solution_dataset
from bella.multilateration.posterior import BATCH, Recipe, exact_posterior
from bella.multilateration.priors import PRESETS, Preset
from tests.multilateration.geometry import (
    CADENCE_S,
    EVENT,
    FIVE,
    FOUR,
    NARROW,
    WIDE,
    brute_force,
    grid_of,
    moments,
    on_spiral,
    sd_of,
    spread,
)

PAIR = np.array([0.8, -1.1, 0.4])
CASES = {
    "event": (on_spiral(75), EVENT, CADENCE_S, NARROW, 0.0),
    "event, free speed": (on_spiral(150), EVENT, CADENCE_S, WIDE, PAIR),
    "40 deg": ((-30.0, -100.0, 0.0), spread(40), 60.0, NARROW, PAIR),
    "40 deg, 7 s, two branches": ((186.0, -45.0, 0.0), spread(40), 7.0, NARROW, 0.0),
    "40 deg, 7 s, free speed": ((186.0, -45.0, 0.0), spread(40), 7.0, WIDE, PAIR),
    "170 deg, free speed": ((60.0, 80.0, 0.0), spread(170), 30.0, WIDE, PAIR),
    "five receivers, free speed": (on_spiral(100), FIVE, 16.0, WIDE, 0.0),
    "one poor clock, 60 Rsun": (on_spiral(60), EVENT, (5.0, 120.0, 5.0), NARROW, 0.0),
    "one poor clock, 20 Rsun": (on_spiral(20), EVENT, (5.0, 5.0, 120.0), NARROW, PAIR),
    "one poor clock, free speed": (on_spiral(110), EVENT, (120.0, 5.0, 5.0), WIDE, PAIR),
    "out of the plane": (on_spiral(60), EVENT + np.array([[0, 0, 30.0], [0, 0, -20.0], [0, 0, 5.0]]), 30.0, WIDE, PAIR),
}


@pytest.mark.parametrize("name", CASES)
def test_agrees_with_a_brute_force_sum(name) -> None:
    source, receivers, sigma_s, priors, noise = CASES[name]
    grid = grid_of(source, receivers, sigma_s, noise=noise)
    brute = brute_force(grid, priors)
    solved = moments(grid, priors)

    np.testing.assert_allclose(solved.mean[0], brute.mean, atol=0.01)
    np.testing.assert_allclose(sd_of(solved)[0], np.sqrt(np.diag(brute.covariance)), atol=0.01)
    assert solved.covariance[0, 0, 1] == pytest.approx(brute.covariance[0, 1], abs=0.5, rel=1e-3)
    assert solved.log_evidence[0] == pytest.approx(brute.log_evidence, abs=1e-3)
    assert solved.v_over_c[0] == pytest.approx(brute.v_over_c, abs=1e-2 * priors.v_sd_c)
    assert solved.v_over_c_sd[0] == pytest.approx(brute.v_over_c_sd, rel=1e-2)


@pytest.mark.parametrize("name", CASES)
def test_finer_cells_change_nothing(name) -> None:
    source, receivers, sigma_s, priors, noise = CASES[name]
    grid = grid_of(source, receivers, sigma_s, noise=noise)
    usual, fine = moments(grid, priors), moments(grid, priors, tolerance=0.6)

    np.testing.assert_allclose(usual.mean / sd_of(fine), fine.mean / sd_of(fine), atol=1e-3)
    np.testing.assert_allclose(sd_of(usual), sd_of(fine), rtol=1e-3)
    np.testing.assert_allclose(usual.log_evidence, fine.log_evidence, atol=1e-3)
    np.testing.assert_allclose(usual.emission_s, fine.emission_s, atol=1e-3 * fine.emission_sd_s[0])


def test_noise_free_posteriors_hold_the_emission_time_and_the_prior_its_width() -> None:
    grid = grid_of(on_spiral(50), FIVE, 1.0, emission_s=-1234.5)
    solved = moments(grid)
    far = moments(grid_of(on_spiral(50), EVENT, 1e6))

    assert solved.emission_s[0] == pytest.approx(-1234.5, abs=0.1)
    np.testing.assert_allclose(sd_of(far), NARROW.tau_rsun, rtol=1e-3)
    np.testing.assert_allclose(far.mean, 0.0, atol=0.1)


def many(count: int):
    rng = np.random.default_rng(5)
    sources = np.c_[rng.normal(0, 60, (count, 2)), np.zeros(count)]
    return grid_of(sources, EVENT, CADENCE_S, noise=rng.standard_normal((count, 3)))


def posterior_of(grid, preset=PRESETS["paper"], draws=50, seed=1):
    return exact_posterior(grid, Recipe("posterior", preset, 2, draws, seed), lambda _: None)


def test_a_frequency_alone_and_among_others_is_the_same() -> None:
    grid = many(60)
    together = posterior_of(grid)

    for row in (0, BATCH[2] - 1, BATCH[2], 59):
        alone = posterior_of(grid.take(np.array([row])))
        assert alone.moments.mean[0].tolist() == pytest.approx(together.moments.mean[row].tolist(), rel=1e-12)
        assert alone.moments.log_evidence[0] == pytest.approx(together.moments.log_evidence[row], rel=1e-12)
        assert alone.regions[0].area_rsun2 == pytest.approx(together.regions[row].area_rsun2, rel=1e-9)
        assert alone.regions[0].modes.weight.tolist() == together.regions[row].modes.weight.tolist()


def test_every_frequency_is_reported_once() -> None:
    told: list[int] = []
    exact_posterior(many(60), Recipe("posterior", PRESETS["default"], 2, 10, 0), told.append)

    assert sum(told) == 60


def test_groups_that_need_many_cells_are_divided_and_give_the_same(monkeypatch) -> None:
    grid = many(12)
    whole = posterior_of(grid)
    monkeypatch.setattr(cells_module, "MAX_CELLS_TOGETHER", 1_000)
    divided = posterior_of(grid)

    np.testing.assert_allclose(divided.moments.mean, whole.moments.mean, rtol=1e-12)
    np.testing.assert_allclose(divided.moments.covariance, whole.moments.covariance, rtol=1e-12)
    assert divided.draws.position.shape == whole.draws.position.shape


def test_too_sharp_a_posterior_is_an_error_that_names_its_frequency(monkeypatch) -> None:
    monkeypatch.setattr(cells_module, "MAX_CELLS", 2_000)
    monkeypatch.setattr(cells_module, "MAX_CELLS_TOGETHER", 2_000)
    grid = many(30)
    grid.sigma_s[28] = 0.2, 200.0, 0.2

    with pytest.raises(ConvergenceError, match=rf"^{grid.frequency_mhz[28]:g} MHz: .* larger sigma_s"):
        posterior_of(grid.take(np.arange(27, 30)))


def finite(grid, priors) -> str:
    """Flags of the only frequency, after every number of its solution was seen to be finite."""
    preset = Preset("case", priors, "table")
    recipe = Recipe("posterior", preset, 2, 100, 0)
    dataset = solution_dataset(grid, exact_posterior(grid, recipe, lambda _: None), recipe)
    for name in dataset.data_vars:
        if dataset[name].dtype.kind == "f" and not name.startswith(("region", "mode_mean", "clock_")):
            assert np.isfinite(dataset[name]).all(), name
    assert np.isfinite(dataset["region95"]).any()
    return str(dataset["flags"].item())


@pytest.mark.parametrize("priors", [NARROW, WIDE], ids=["narrow", "wide"])
@pytest.mark.parametrize("receivers", [EVENT, FIVE], ids=["three", "five"])
@pytest.mark.parametrize("sigma_s", [1e-9, 1e-6, 1e-3, 0.3, 86_400.0, 1e9])
def test_any_error_gives_finite_numbers_or_a_clear_refusal(receivers, sigma_s, priors) -> None:
    try:
        flags = finite(grid_of(on_spiral(75), receivers, sigma_s), priors)
    except ConvergenceError as error:
        message = str(error)
    else:
        message = ""
    if message:
        assert sigma_s <= 1e-3
        assert "larger sigma_s" in message
        assert len(message.splitlines()) == 1
    else:
        assert ("position_not_constrained" in flags) == (sigma_s > 1e4)


@pytest.mark.parametrize("priors", [NARROW, WIDE], ids=["narrow", "wide"])
@pytest.mark.parametrize("sigma_s", [60.0, 7.0, 0.1])
def test_delays_beyond_light_time_are_flagged(sigma_s, priors) -> None:
    for receivers in (EVENT, FIVE):
        grid = grid_of(on_spiral(75), receivers, sigma_s)
        late = replace(grid, arrival_s=3000.0 * np.arange(len(receivers), dtype=float)[None])
        try:
            said = finite(late, priors)
        except ConvergenceError as error:
            said = str(error)
        assert "arrivals_inconsistent" in said or (sigma_s < 10 and "no position explains the arrival times" in said)


@pytest.mark.parametrize("priors", [NARROW, WIDE], ids=["narrow", "wide"])
def test_receivers_at_one_place_tell_nothing(priors) -> None:
    flags = finite(grid_of(on_spiral(75), EVENT[[0, 0, 0]], 7.0), priors)

    assert "position_not_constrained" in flags
    assert "arrivals_inconsistent" not in flags
    contradicting = replace(grid_of(on_spiral(75), EVENT[[0, 0, 0]], 7.0), arrival_s=np.array([[0.0, 100.0, 200.0]]))
    assert "arrivals_inconsistent" in finite(contradicting, priors)
    assert "position_not_constrained" in finite(grid_of(on_spiral(75), EVENT[[0, 0, 1]], 60.0), priors)


@pytest.mark.parametrize("priors", [NARROW, WIDE], ids=["narrow", "wide"])
def test_odd_places_give_finite_numbers(priors) -> None:
    assert "arrivals_inconsistent" not in finite(grid_of(EVENT[0], EVENT, 7.0), priors)
    assert "arrivals_inconsistent" not in finite(grid_of(on_spiral(75), 90 * EVENT, 7.0), priors)
    assert "position_not_constrained" in finite(grid_of(on_spiral(75), 0 * EVENT, 7.0), priors)


def test_consistent_times_are_rarely_called_inconsistent() -> None:
    rng = np.random.default_rng(2)
    for receivers, priors in ((EVENT, NARROW), (FOUR, NARROW), (FIVE, WIDE)):
        shape = (100, len(receivers))
        sources = np.c_[rng.normal(0, priors.tau_rsun, (100, 2)), np.zeros(100)]
        grid = grid_of(sources, receivers, 30.0, noise=rng.standard_normal(shape))
        recipe = Recipe("posterior", Preset("case", priors, "table"), 2, 10, 0)
        dataset = solution_dataset(grid, exact_posterior(grid, recipe, lambda _: None), recipe)
        assert not dataset["flags"].str.contains("arrivals_inconsistent").any()
        # what is left of n - 1 differences after a source was fitted
        assert 0 <= float(dataset["misfit"].mean()) < len(receivers)


def test_too_sharp_is_a_bella_error_through_and_through() -> None:
    with pytest.raises(BellaError):
        finite(grid_of(on_spiral(75), EVENT, 1e-6), WIDE)

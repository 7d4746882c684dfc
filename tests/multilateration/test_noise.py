"""Errors beyond the stated ones: offsets, delays, bad arrival times, and a largest speed."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bella.multilateration import localise
from bella.multilateration.cells import divide
from bella.multilateration.posterior import draw, moments_of
from bella.multilateration.priors import PRESETS, Noise, Priors
from bella.multilateration.problems import problems_of
from bella.multilateration.regions import log_density, regions_of
from tests.multilateration import geometry
from tests.multilateration.geometry import (
    CADENCE_S,
    EVENT,
    FIVE,
    FOUR,
    NARROW,
    WIDE,
    brute_force,
    first,
    grid_of,
    moments,
    on_spiral,
    sd_of,
    table_of,
)

BELOW_C = geometry.BELOW_C.priors
ROBUST = PRESETS["robust"].noise


def shifted(grid, receiver: int, late_s: float):
    arrival = grid.arrival_s.copy()
    arrival[:, receiver] += late_s
    return replace(grid, arrival_s=arrival)


def test_offsets_and_delays_widen_the_error_and_a_known_delay_is_taken_off() -> None:
    plain = grid_of(on_spiral(75), EVENT, np.hypot(np.hypot(30.0, 20.0), 10.0), noise=np.array([0.5, -0.8, 0.3]))
    grid = replace(
        plain,
        arrival_s=plain.arrival_s + np.array([[100.0, 40.0, -7.0]]),
        sigma_s=np.full((1, 3), 30.0),
        delay_s=np.array([[100.0, 40.0, -7.0]]),
        delay_sd_s=np.full((1, 3), 20.0),
        offset_sd_s=np.full((1, 3), 10.0),
    )
    one, other = moments(grid, WIDE), moments(plain, WIDE)

    np.testing.assert_allclose(one.mean, other.mean, rtol=1e-9)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-9)
    np.testing.assert_allclose(one.log_evidence, other.log_evidence, rtol=1e-9)
    np.testing.assert_allclose(one.emission_s, other.emission_s, rtol=1e-9)


def test_a_delay_in_the_table_does_what_it_says() -> None:
    table = table_of(grid_of(on_spiral(75), FOUR, 7.0))
    late = table.assign(arrival_utc=table["arrival_utc"] + np.timedelta64(50, "s"), delay_s=50.0)
    uncertain = table.assign(delay_sd_s=15.0, offset_sd_s=12.0)
    plain, corrected, wide = (localise(some, preset=geometry.PLAIN, draws=10) for some in (table, late, uncertain))

    np.testing.assert_allclose(corrected["x_rsun"], plain["x_rsun"], atol=1e-6)
    assert corrected.attrs["reference_time"] != plain.attrs["reference_time"]
    moved_s = pd.Timestamp(corrected.attrs["reference_time"]) - pd.Timestamp(plain.attrs["reference_time"])
    late_s = moved_s.total_seconds() + (corrected["emission_s"] - plain["emission_s"])
    np.testing.assert_allclose(late_s, 0, atol=1e-3)
    expected = localise(table.assign(sigma_s=np.sqrt(7.0**2 + 15.0**2 + 12.0**2)), preset=geometry.PLAIN, draws=10)
    np.testing.assert_allclose(wide["cov_xx_rsun2"], expected["cov_xx_rsun2"], rtol=1e-9)
    assert (wide["sigma_s"] == 7.0).all()
    assert (wide["offset_sd_s"] == 12.0).all()


SPEED_CASES = {
    "truth at 0.9 c, five": (on_spiral(75), FIVE, 7.0, 0.9),
    "truth at 1.1 c, five": (on_spiral(75), FIVE, 7.0, 1.1),
    "three": (on_spiral(75), EVENT, CADENCE_S, 1.0),
}


@pytest.mark.parametrize("name", SPEED_CASES)
def test_a_largest_speed_agrees_with_a_brute_force_sum(name) -> None:
    source, receivers, sigma_s, speed = SPEED_CASES[name]
    grid = grid_of(source, receivers, sigma_s, v_over_c=speed)
    brute, solved = brute_force(grid, BELOW_C), moments(grid, BELOW_C)

    np.testing.assert_allclose(solved.mean[0], brute.mean, atol=0.02)
    np.testing.assert_allclose(sd_of(solved)[0], np.sqrt(np.diag(brute.covariance)), atol=0.02)
    assert solved.log_evidence[0] == pytest.approx(brute.log_evidence, abs=2e-3)
    assert solved.v_over_c[0] == pytest.approx(brute.v_over_c, abs=2e-4)
    assert solved.v_over_c_sd[0] == pytest.approx(brute.v_over_c_sd, rel=1e-2)
    assert solved.above_c[0] == 0


@pytest.mark.parametrize("name", SPEED_CASES)
def test_draws_keep_to_the_largest_speed_and_to_the_moments(name) -> None:
    source, receivers, sigma_s, speed = SPEED_CASES[name]
    problems = problems_of(grid_of(source, receivers, sigma_s, v_over_c=speed), BELOW_C, 2)
    cells = divide(problems)
    solved, drawn = moments_of(problems, cells), draw(problems, cells, 8000, np.random.default_rng(1))

    assert drawn.v_over_c.max() <= 1
    assert drawn.effective[0] >= 0.85 * 8000
    assert drawn.v_over_c.mean() == pytest.approx(solved.v_over_c[0], abs=4 * solved.v_over_c_sd[0] / np.sqrt(6000))
    assert drawn.v_over_c.std() == pytest.approx(solved.v_over_c_sd[0], rel=0.05)
    error = (drawn.position[0].mean(axis=0) - solved.mean[0]) / sd_of(solved)[0]
    assert np.abs(error).max() < 4 / np.sqrt(6000)


def test_arrival_times_that_prefer_a_speed_above_c_are_flagged() -> None:
    fast, slow = (grid_of(on_spiral(75), FIVE, 7.0, v_over_c=v) for v in (1.2, 0.9))

    assert "speed_above_c" in first(fast, preset=geometry.FREE)["flags"].item()
    assert "speed_above_c" not in first(slow, preset=geometry.FREE)["flags"].item()
    assert "speed_above_c" not in first(fast, preset=geometry.BELOW_C)["flags"].item()
    assert float(first(slow, preset=geometry.FREE)["above_c_probability"]) < 0.01
    three = first(grid_of(on_spiral(75), EVENT, 7.0, v_over_c=0.9), preset=geometry.FREE)
    assert float(three["above_c_probability"]) == pytest.approx(0.5, abs=0.1)


ROBUST_CASES = {
    "four, all good": (FOUR, 30.0, 0.0),
    "four, one late by 300 s": (FOUR, 30.0, 300.0),
    "three, one late by 60 s": (EVENT, 30.0, 60.0),
    "five, one early by 200 s": (FIVE, 16.0, -200.0),
}


@pytest.mark.parametrize("name", ROBUST_CASES)
def test_bad_arrival_times_agree_with_a_brute_force_sum(name) -> None:
    receivers, sigma_s, late_s = ROBUST_CASES[name]
    grid = shifted(grid_of(on_spiral(75), receivers, sigma_s), 1, late_s)
    brute, solved = brute_force(grid, NARROW, noise=ROBUST, pitch=1.0), moments(grid, noise=ROBUST)

    np.testing.assert_allclose(solved.mean[0], brute.mean, atol=0.01)
    np.testing.assert_allclose(sd_of(solved)[0], np.sqrt(np.diag(brute.covariance)), atol=0.02)
    assert solved.log_evidence[0] == pytest.approx(brute.log_evidence, abs=1e-3)


def test_draws_of_a_mixture_agree_with_its_moments() -> None:
    grid = shifted(grid_of([on_spiral(75), on_spiral(30)], FOUR, 30.0), 1, 120.0)
    problems = problems_of(grid, WIDE, 2, ROBUST)
    cells = divide(problems)
    solved, drawn = moments_of(problems, cells), draw(problems, cells, 8000, np.random.default_rng(1))

    assert (drawn.effective >= 0.8 * 8000).all()
    error = (drawn.position.mean(axis=1) - solved.mean) / sd_of(solved)
    assert np.abs(error).max() < 4.5 / np.sqrt(6000)
    np.testing.assert_allclose(drawn.position.std(axis=1), sd_of(solved), rtol=0.06)
    np.testing.assert_allclose(
        drawn.emission_s.mean(axis=1), solved.emission_s, atol=4.5 * solved.emission_sd_s.max() / 77
    )
    np.testing.assert_allclose(drawn.emission_s.std(axis=1), solved.emission_sd_s, rtol=0.06)
    assert all(region.area_rsun2[0] > 0 for region in regions_of(problems, cells))


def has_truth(grid, noise: Noise, truth) -> bool:
    """Whether the 95 % region of a grid holds a position."""
    problems = problems_of(grid, NARROW, 2, noise)
    (region,) = regions_of(problems, divide(problems))
    return bool(log_density(problems, truth[:2, None])[0] >= region.log_threshold[1])


@pytest.mark.parametrize("receiver", range(4))
def test_one_bad_arrival_time_of_four_is_survived(receiver) -> None:
    """Four receivers leave one difference to spare: it shows that a time is bad, but not always which."""
    truth = on_spiral(75)
    grid = shifted(grid_of(truth, FOUR, 10.0), receiver, 400.0)
    plain, robust = (first(grid, preset=one) for one in (geometry.PLAIN, geometry.ROBUST))

    assert "arrivals_inconsistent" in plain["flags"].item()
    assert not has_truth(grid, Noise(), truth)
    assert has_truth(grid, ROBUST, truth)
    assert "bad_arrival" in robust["flags"].item()
    assert "arrivals_inconsistent" not in robust["flags"].item()
    assert float(robust["bad_probability"][receiver]) > 0.4
    error = np.linalg.norm(robust["mode_mean_rsun"].to_numpy() - truth, axis=1)
    assert float(robust["mode_weight"][error < 12].sum()) > 0.4


@pytest.mark.parametrize("receiver", range(5))
def test_one_bad_arrival_time_of_five_is_named(receiver) -> None:
    truth = on_spiral(75)
    robust = first(shifted(grid_of(truth, FIVE, 7.0), receiver, 400.0), preset=geometry.ROBUST)

    assert int(robust["bad_probability"].argmax("observatory")) == receiver
    assert float(robust["bad_probability"].max()) > 0.95
    assert np.hypot(float(robust["x_rsun"]) - truth[0], float(robust["y_rsun"]) - truth[1]) < 10


def test_robustness_has_a_price() -> None:
    """With good times the error grows by little with five receivers; fewer cannot tell good from bad as well."""
    rng = np.random.default_rng(4)
    price = {}
    for name, receivers in (("three", EVENT), ("four", FOUR), ("five", FIVE)):
        noise = rng.standard_normal((15, len(receivers)))
        grid = grid_of([on_spiral(r) for r in np.linspace(20, 140, 15)], receivers, 10.0, noise=noise)
        rows = [grid.take(np.array([row])) for row in range(15)]
        price[name] = np.median([sd_of(moments(row, noise=ROBUST)) / sd_of(moments(row)) for row in rows])

    assert 1.0 < price["five"] < 1.15
    assert price["five"] < price["four"] < 1.5
    assert price["three"] > price["four"]


def test_more_receivers_may_have_two_bad_ones() -> None:
    noise = Noise(bad_probability=0.1)
    assert [len(noise.bad_sets(n)) for n in (3, 4, 7, 8, 12)] == [4, 5, 8, 37, 79]
    assert Noise().bad_sets(5).tolist() == [[False] * 5]


def test_a_receiver_that_is_missing_cannot_be_bad() -> None:
    grid = grid_of([on_spiral(75), on_spiral(75)], FIVE, 20.0)
    arrival = grid.arrival_s.copy()
    arrival[0, 4] = np.nan
    gap, four = replace(grid, arrival_s=arrival), grid_of(on_spiral(75), FOUR, 20.0)
    with_gap, alone = moments(gap, noise=ROBUST), moments(four, noise=ROBUST)

    np.testing.assert_allclose(with_gap.mean[0], alone.mean[0], rtol=1e-6)
    np.testing.assert_allclose(with_gap.log_evidence[0], alone.log_evidence[0], rtol=1e-6)
    assert with_gap.bad_probability[0, 4] == 0


def test_the_pull_of_the_prior_is_the_change_of_the_mean_with_its_precision() -> None:
    grid = grid_of([on_spiral(150), on_spiral(40)], EVENT, CADENCE_S)
    tau = NARROW.tau_rsun
    step = 0.01
    looser, tighter = (moments(grid, Priors(tau_rsun=tau / np.sqrt(1 + sign * step))) for sign in (-1, 1))

    slope = (tighter.mean - looser.mean) / (2 * step)
    np.testing.assert_allclose(moments(grid).prior_pull, slope, atol=0.02)
    assert moments(grid).prior_pull[0, 0] < -2

"""Physics, likelihood and priors of the joint model against direct sums, integrals and dense matrices."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from bella.heliosphere import SIDEREAL_ROTATION_D, angular_speed_rad_s, spiral_path_rsun
from bella.tracks import JointModel, JointPriors
from bella.tracks.joint_likelihood import log_likelihood, residual_s, timed_channels
from bella.tracks.joint_model import FASTEST_WIND_KM_S
from bella.units import C_RSUN_S, R_SUN_KM
from tests.tracks.bursts import FREQUENCY_MHZ, RELEASE_S, simulated, standard

MODEL = JointModel()


def arc(range_rsun: float, k: float) -> float:
    return (range_rsun * math.sqrt(1 + (k * range_rsun) ** 2) + math.asinh(k * range_rsun) / k) / 2


def test_delay_is_travel_along_the_spiral_and_light() -> None:
    """a = 40, b = -1, 0.15 c, 400 km/s, 30 degrees, written out for one frequency and a receiver out of the plane."""
    receiver = np.array([[[200.0, -30.0, 25.0]]])
    delay = MODEL.delay_s(standard(MODEL, 30.0, 400.0)[None], np.array([0.22]), receiver)[0, 0, 0]
    k = angular_speed_rad_s(SIDEREAL_ROTATION_D) * R_SUN_KM / 400.0
    angle = math.radians(30.0) - k * 99.0
    light = math.dist((100 * math.cos(angle), 100 * math.sin(angle), 0.0), receiver[0, 0])
    assert delay == pytest.approx((arc(100.0, k) - arc(1.0, k)) / (0.15 * C_RSUN_S) + light / C_RSUN_S, rel=1e-12)


def test_arc_length_takes_many_winds_at_once() -> None:
    winds = np.array([300.0, 400.0, 700.0])
    together = spiral_path_rsun(np.array([[20.0, 100.0, 215.0]]), winds[:, None])
    for wind, row in zip(winds, together, strict=True):
        k = angular_speed_rad_s(SIDEREAL_ROTATION_D) * R_SUN_KM / wind
        expected = [quad(lambda r, k=k: math.sqrt(1 + (k * r) ** 2), 1.0, far)[0] for far in (20.0, 100.0, 215.0)]
        np.testing.assert_allclose(row, expected, rtol=1e-10)


def test_two_slopes_meet_at_the_break() -> None:
    model = JointModel(two_slope=True, break_mhz=0.4)
    z = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, -2.0]])
    parameters = model.natural(z)
    frequency = np.array([0.1, 0.2, 0.4 - 1e-9, 0.4 + 1e-9, 0.8, 1.6])
    log_range = np.log(model.range_rsun(parameters, frequency)[0])
    slope = np.diff(log_range) / np.diff(np.log(frequency))
    assert slope[0] == pytest.approx(-1.3)
    assert slope[4] == pytest.approx(-0.85)
    assert log_range[3] == pytest.approx(log_range[2], abs=1e-7)


def test_speeds_at_or_above_that_of_light_have_no_probability() -> None:
    at_c = math.log(1 / 0.15) / 0.5
    z = np.zeros((3, 5))
    z[:, 4] = at_c - 1e-6, at_c + 1e-6, at_c + 1.0
    assert list(np.isfinite(MODEL.log_prior(z, FREQUENCY_MHZ))) == [True, False, False]
    accelerating = JointModel(deceleration=True)
    z = np.zeros((2, 6))
    z[:, 4], z[:, 5] = at_c - 0.2, (0.0, -1.0)
    assert list(np.isfinite(accelerating.log_prior(z, FREQUENCY_MHZ))) == [True, False]


def test_no_wind_blows_inwards() -> None:
    z = np.zeros((2, 5))
    z[:, 1] = (-3.1, -2.9)
    assert list(np.isfinite(MODEL.log_prior(z, FREQUENCY_MHZ))) == [False, True]
    assert MODEL.natural(z).v_sw_km_s[0] == FASTEST_WIND_KM_S


@pytest.mark.parametrize("model", [MODEL, JointModel(deceleration=True), JointModel(JointPriors(phi0_sd_deg=150.0))])
def test_the_prior_adds_up_to_one(model: JointModel) -> None:
    """By importance sampling from uniform longitudes and wide normals."""
    rng = np.random.default_rng(4)
    z = 1.3 * rng.standard_normal((200_000, len(model.parameters)))
    log_drawn = norm.logpdf(z[:, 1:], scale=1.3).sum(axis=1) - math.log(model.turn)
    z[:, 0] = model.turn * rng.uniform(-0.5, 0.5, len(z))
    assert np.exp(model.log_prior(z, FREQUENCY_MHZ) - log_drawn).mean() == pytest.approx(1.0, abs=0.015)


def test_the_prior_is_one_on_the_circle() -> None:
    sides = np.zeros((2, 5))
    sides[:, 0] = np.array([180.0, -180.0]) / 60.0
    east, west = MODEL.log_prior(sides, FREQUENCY_MHZ)
    assert east == pytest.approx(west)


def test_natural_parameters_are_those_of_the_priors() -> None:
    ones = MODEL.natural(np.ones((1, 5)))
    expected = (60.0, 400 / 1.3, 40 * math.exp(0.7), -0.85, 0.15 * math.exp(0.5), 0.0, -0.85)
    found = [float(value[0]) for value in list(vars(ones).values())[:7]]
    np.testing.assert_allclose(found, expected)
    assert ones.outer_v_sw_km_s.shape == (1, 0)


@given(
    offset_s=st.floats(0.0, 1e3),
    seed=st.integers(0, 1000),
    missing=st.lists(st.integers(0, 23), max_size=12, unique=True),
)
@settings(max_examples=30, deadline=None)
def test_likelihood_is_that_of_the_dense_covariance(offset_s: float, seed: int, missing: list[int]) -> None:
    """With the release time under a Gaussian so wide that it stands for the flat prior."""
    rng = np.random.default_rng(seed)
    grid = simulated(standard(MODEL, 30.0, 400.0), MODEL, rng).take(np.arange(0, 40, 5))
    arrival = grid.arrival_s.copy()
    arrival.ravel()[missing] = np.nan
    channels = timed_channels(dataclasses.replace(grid, arrival_s=arrival), offset_s)
    z = rng.standard_normal((1, 5))
    heard, column = np.isfinite(arrival), np.broadcast_to(np.arange(3), arrival.shape)
    covariance = np.diag(grid.sigma_s[heard] ** 2) + offset_s**2 * (column[heard][:, None] == column[heard])
    residual = residual_s(MODEL, channels, z)[0][heard]
    precision = np.linalg.inv(covariance)
    release_s = precision.sum(axis=0) @ residual / precision.sum()
    log_fit, found_s = log_likelihood(MODEL, channels, z)
    profile = multivariate_normal(np.zeros(residual.size), covariance).logpdf(residual - release_s)
    assert found_s[0] == pytest.approx(release_s, rel=1e-6, abs=1e-6)
    assert log_fit[0] == pytest.approx(profile + 0.5 * math.log(2 * math.pi / precision.sum()), rel=1e-7, abs=1e-5)
    assert np.isfinite(log_fit[0])


def test_weighing_agrees_with_the_misfit() -> None:
    grid = simulated(standard(MODEL, 30.0, 400.0), MODEL, np.random.default_rng(2))
    channels = timed_channels(grid, 25.0)
    residual = residual_s(MODEL, channels, np.random.default_rng(3).standard_normal((4, 5)))
    misfit, release_s = channels.misfit(residual)
    np.testing.assert_allclose((residual * channels.weigh(residual)).sum(axis=(1, 2)), misfit, rtol=1e-9)
    shifted, later_s = channels.misfit(residual + 123.0)
    np.testing.assert_allclose(shifted, misfit, rtol=1e-7)
    np.testing.assert_allclose(later_s - release_s, 123.0)


def test_known_delays_are_taken_off_and_their_doubt_added() -> None:
    grid = simulated(standard(MODEL, 30.0, 400.0), MODEL, None)
    late = dataclasses.replace(
        grid,
        arrival_s=grid.arrival_s + 70.0,
        delay_s=np.full(grid.arrival_s.shape, 70.0),
        delay_sd_s=np.full(grid.arrival_s.shape, 20.0),
    )
    z = standard(MODEL, 30.0, 400.0)[None]
    (_, plain_s), (_, late_s) = (log_likelihood(MODEL, timed_channels(one), z) for one in (grid, late))
    assert plain_s[0] == pytest.approx(RELEASE_S) == late_s[0]
    np.testing.assert_allclose(timed_channels(late).precision, 1 / (grid.sigma_s**2 + 400.0))

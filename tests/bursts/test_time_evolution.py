import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bella.bursts import TimeEvolution, fit_time_evolution
from bella.exceptions import InputError

FREQUENCY_MHZ = np.geomspace(0.15, 2.0, 40)


def test_the_published_curve_of_wind_at_one_megahertz() -> None:
    curve = TimeEvolution(np.array([-0.099, 55.685, 515.361]), np.zeros((3, 3)))

    np.testing.assert_allclose(curve.arrival_s(np.array([1.0, 0.2])), [570.947, 791.311], atol=1e-9)


@given(st.tuples(st.floats(-10, 10), st.floats(-200, 200), st.floats(-1000, 1000)))
@settings(max_examples=50, deadline=None)
def test_a_curve_of_this_form_is_found_again(coefficients: tuple[float, float, float]) -> None:
    truth = TimeEvolution(np.array(coefficients), np.zeros((3, 3)))

    fit = fit_time_evolution(FREQUENCY_MHZ, truth.arrival_s(FREQUENCY_MHZ), np.full(40, 10.0))

    np.testing.assert_allclose(fit.coefficients, coefficients, atol=1e-7)


def test_the_covariance_is_that_of_repeated_measurements() -> None:
    random = np.random.default_rng(42)
    truth = TimeEvolution(np.array([1.4, 120.0, 530.0]), np.zeros((3, 3)))
    sigma_s = np.where(FREQUENCY_MHZ < 0.5, 20.0, 5.0)

    exact_s = truth.arrival_s(FREQUENCY_MHZ)
    noisy = [fit_time_evolution(FREQUENCY_MHZ, random.normal(exact_s, sigma_s), sigma_s) for _ in range(3000)]

    scatter = np.cov([fit.coefficients for fit in noisy], rowvar=False)
    np.testing.assert_allclose(scatter, noisy[0].covariance, rtol=0.12)
    np.testing.assert_allclose(np.mean([fit.coefficients for fit in noisy], axis=0), truth.coefficients, rtol=0.05)


def test_channels_without_an_edge_are_left_out() -> None:
    arrival_s = TimeEvolution(np.array([1.0, 100.0, 500.0]), np.zeros((3, 3))).arrival_s(FREQUENCY_MHZ)
    arrival_s[5] = np.nan

    np.testing.assert_allclose(
        fit_time_evolution(FREQUENCY_MHZ, arrival_s, np.ones(40)).coefficients, [1.0, 100.0, 500.0], atol=1e-8
    )


def test_two_frequencies_are_too_few() -> None:
    with pytest.raises(InputError, match="three frequencies, not 2"):
        fit_time_evolution(np.array([1.0, 1.0, 2.0]), np.zeros(3), np.ones(3))


def test_a_sigma_of_zero_is_refused() -> None:
    with pytest.raises(InputError, match="sigma is not above zero"):
        fit_time_evolution(FREQUENCY_MHZ, FREQUENCY_MHZ, np.zeros(40))

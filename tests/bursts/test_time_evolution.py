import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bella.bursts import (
    TimeEvolution,
    best_time_evolution,
    common_offset_s,
    fit_time_evolution,
    robust_time_evolution,
)
from bella.bursts.time_evolution import BASES
from bella.exceptions import InputError

FREQUENCY_MHZ = np.geomspace(0.15, 2.0, 40)
FITS = (fit_time_evolution, robust_time_evolution)


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


def beam_s(frequency_mhz: np.ndarray) -> np.ndarray:
    """A beam that neither basis has been made for, s."""
    return 600 + 130 * frequency_mhz**-0.9 - 25 * frequency_mhz**-0.4


def test_five_terms_follow_what_three_cannot() -> None:
    misses = []
    for basis in ("paper", "five_term"):
        fit = fit_time_evolution(FREQUENCY_MHZ, beam_s(FREQUENCY_MHZ), np.full(40, 5.0), basis)
        misses.append(np.abs(fit.arrival_s(FREQUENCY_MHZ) - beam_s(FREQUENCY_MHZ)).max())

    assert misses[0] > 1
    assert misses[1] < 0.1


@pytest.mark.parametrize("basis", BASES)
def test_both_fits_agree_on_clean_channels(basis: str) -> None:
    arrival_s = np.random.default_rng(1).normal(beam_s(FREQUENCY_MHZ), 20.0)
    sigma_s = np.full(40, 200.0)  # so wide that no residual counts as an outlier

    plain = fit_time_evolution(FREQUENCY_MHZ, arrival_s, sigma_s, basis)
    robust = robust_time_evolution(FREQUENCY_MHZ, arrival_s, sigma_s, basis)

    np.testing.assert_allclose(robust.arrival_s(FREQUENCY_MHZ), plain.arrival_s(FREQUENCY_MHZ), atol=1e-6)


def test_wrong_channels_hardly_move_the_robust_fit() -> None:
    random = np.random.default_rng(2)
    sigma_s = np.full(40, 8.0)
    arrival_s = random.normal(beam_s(FREQUENCY_MHZ), sigma_s)
    arrival_s[[4, 15, 28, 33]] += [300.0, 200.0, 250.0, 400.0]

    plain, robust = (fit(FREQUENCY_MHZ, arrival_s, sigma_s, "paper") for fit in FITS)

    off = [np.sqrt(np.mean((fit.arrival_s(FREQUENCY_MHZ) - beam_s(FREQUENCY_MHZ)) ** 2)) for fit in (plain, robust)]
    assert off[0] > 25
    assert off[1] < 6
    assert robust.inflation > 1.2


def test_covariance_of_the_robust_fit_is_that_of_repeated_measurements() -> None:
    """Every tenth channel is an outlier, sigmas are stated a third too small."""
    random = np.random.default_rng(3)
    truth = TimeEvolution(np.array([1.4, 120.0, 530.0]), np.zeros((3, 3)))
    at = np.array([0.2, 0.5, 1.5])
    found, stated = [], []
    for _ in range(400):
        error = random.normal(0.0, 12.0, 40) + (random.random(40) < 0.1) * random.normal(0.0, 100.0, 40)
        arrival_s = truth.arrival_s(FREQUENCY_MHZ) + error
        fit = robust_time_evolution(FREQUENCY_MHZ, arrival_s, np.full(40, 8.0), "paper")
        found.append(fit.arrival_s(at) - truth.arrival_s(at))
        stated.append(np.diag(fit.covariance_s2(at)))

    pull = np.sqrt(np.mean(np.array(found) ** 2 / np.array(stated), axis=0))
    assert (pull > 0.7).all()
    assert (pull < 1.25).all()


def test_channels_that_err_together_widen_the_covariance() -> None:
    random = np.random.default_rng(4)
    alone = random.normal(0.0, 10.0, 40)
    together = np.repeat(random.normal(0.0, 10.0, 8), 5)

    fits = [
        robust_time_evolution(FREQUENCY_MHZ, beam_s(FREQUENCY_MHZ) + error, np.full(40, 10.0), "paper")
        for error in (alone, together)
    ]

    assert fits[1].inflation > 2 * fits[0].inflation


@given(st.lists(st.floats(0.1, 15.0), min_size=2, max_size=12, unique=True))
@settings(max_examples=30, deadline=None)
def test_times_at_common_frequencies_have_a_full_covariance(at: list[float]) -> None:
    arrival_s = np.random.default_rng(5).normal(beam_s(FREQUENCY_MHZ), 8.0)
    fit = robust_time_evolution(FREQUENCY_MHZ, arrival_s, np.full(40, 8.0))

    covariance = fit.covariance_s2(np.array(at))

    np.testing.assert_allclose(covariance, covariance.T, atol=1e-9 * covariance.max())
    assert np.linalg.eigvalsh(covariance).min() > -1e-6 * np.linalg.eigvalsh(covariance).max()
    assert np.linalg.matrix_rank(covariance, tol=1e-6 * covariance.max()) <= 5


def test_a_channel_is_no_better_known_than_its_rise_allows() -> None:
    arrival_s = np.random.default_rng(6).normal(beam_s(FREQUENCY_MHZ), 8.0)

    tiny, small = (robust_time_evolution(FREQUENCY_MHZ, arrival_s, np.full(40, sigma)) for sigma in (1e-6, 1e-3))

    np.testing.assert_array_equal(tiny.covariance, small.covariance)


def test_the_basis_is_chosen_by_what_the_channels_can_tell() -> None:
    frequency_mhz = np.geomspace(0.2, 10.0, 120)
    random = np.random.default_rng(7)
    paper = TimeEvolution(np.array([1.4, 120.0, 530.0]), np.zeros((3, 3))).arrival_s(frequency_mhz)
    sigma_s = 2.1 * frequency_mhz**-0.77

    simple = best_time_evolution(frequency_mhz, random.normal(paper, sigma_s), sigma_s)
    bent = best_time_evolution(frequency_mhz, random.normal(3 * beam_s(frequency_mhz), sigma_s), sigma_s)
    few = best_time_evolution(frequency_mhz[::30], beam_s(frequency_mhz[::30]), sigma_s[::30])

    assert (simple.basis, bent.basis, few.basis) == ("paper", "five_term", "paper")


def test_offset_of_snapshots_is_their_cadence_where_bursts_are_short() -> None:
    at = np.array([0.5, 1.9, 5.0])

    np.testing.assert_allclose(common_offset_s(at, 38.0, 2.0), [2.0, 2.0, 38.0 / 12**0.5])
    np.testing.assert_allclose(common_offset_s(at, 60.0, 60.0), 2.0)
    np.testing.assert_allclose(common_offset_s(at, 3.0, 0.1), 2.0)


def test_what_cannot_be_fitted_is_said() -> None:
    ones = np.ones(4)
    with pytest.raises(InputError, match="'cubic' is not a basis of t"):
        fit_time_evolution(ones, ones, ones, "cubic")
    with pytest.raises(InputError, match="five frequencies, not 4"):
        robust_time_evolution(FREQUENCY_MHZ[:4], ones, ones)
    with pytest.raises(InputError, match="3 edges say nothing of their scatter"):
        best_time_evolution(FREQUENCY_MHZ[:3], ones[:3], ones[:3])

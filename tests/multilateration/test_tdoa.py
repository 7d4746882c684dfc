"""Differences of arrival times: a published track, exact sources, errors by Monte Carlo, and geometry that fails."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bella.exceptions import GeometryError, InputError
from bella.multilateration import tdoa
from bella.multilateration.priors import Priors
from bella.multilateration.tdoa import Roots, both_roots, solve
from bella.multilateration.tdoa_fit import SEARCH_RSUN, descend, information, misfit, timing_of
from bella.units import C_RSUN_S
from tests.multilateration.geometry import EVENT, FIVE, FOUR, grid_of, moments, polar, spread

HEIGHTS = np.array([[0, 0, 30.0], [0, 0, -20.0], [0, 0, 5.0], [0, 0, -40.0], [0, 0, 60.0]])
RAISED = FIVE + HEIGHTS
SOURCES = np.array([[30.0, -12.0, 0], [-80.0, 45.0, 0], [3.0, 1.0, 0], [10.0, 150.0, 0], [-70.0, -90.0, 0]])
IN_SPACE = SOURCES + np.array([[0, 0, 20.0], [0, 0, -35.0], [0, 0, 2.0], [0, 0, 60.0], [0, 0, -15.0]])


def received(sources, receivers, *, emission_s=0.0):
    """Receivers and noise-free arrival times of a batch of sources (B, 3)."""
    sources = np.atleast_2d(sources)
    receivers = np.broadcast_to(receivers, (len(sources), *np.shape(receivers)[-2:])).copy()
    return receivers, emission_s + np.linalg.norm(sources[:, None] - receivers, axis=2) / C_RSUN_S


def solved(sources, receivers, *, sigma_s=5.0, dimensions=2, **kwargs):
    receivers, arrival_s = received(sources, receivers, **kwargs)
    return solve(receivers, arrival_s, np.full(arrival_s.shape, sigma_s), dimensions)


# --- the track of 2012-06-07 as digitised from the public notebook of Badman et al. (2022) ---

FIRST, LAST = (3.8, -8.8), (-4.0, -129.8)  # 1.43 and 0.143 MHz, HME axes, +-0.9 solar radii
DELAYS = {FIRST: (-7.5, 36.8), LAST: (419.0, 512.0)}  # STEREO-A and STEREO-B after Wind, s
LONGITUDES = {15: 24.0, 33: 13.0, 50: 10.4, 68: 10.0}  # range: longitude less that of Wind, deg


@pytest.fixture(scope="session")
def badman(reference_files):
    folder = reference_files / "tdoa"
    if not folder.is_dir():
        pytest.skip("no digitised TDOA track among the reference files")
    table = pd.read_csv(folder / "spacecraft_positions.csv", index_col="spacecraft")
    receivers = np.zeros((3, 3))
    receivers[:, :2] = table.loc[["Wind", "STEREO-A", "STEREO-B"], ["x_hme_rsun", "y_hme_rsun"]]
    return receivers, pd.read_csv(folder / "fit_curves_digitised.csv")


def published_track(receivers):
    wind = np.degrees(np.arctan2(receivers[0, 1], receivers[0, 0]))
    between = [polar(radius, wind + longitude) for radius, longitude in LONGITUDES.items()]
    return np.array([(*FIRST, 0.0), *between, (*LAST, 0.0)])


def closed_form(receivers, arrival_s) -> Roots:
    """Both roots, the first receiver being the reference."""
    dimensions = arrival_s.shape[-1] - 1
    timing = timing_of(receivers, arrival_s, np.ones_like(arrival_s), dimensions)
    return both_roots(timing, np.zeros(len(arrival_s), dtype=np.intp), dimensions)


@pytest.mark.parametrize("point", DELAYS)
def test_published_delays_give_the_published_position(badman, point) -> None:
    roots = closed_form(badman[0][None], np.array([[0.0, *DELAYS[point]]]))

    assert np.linalg.norm(roots.points[0, roots.chosen[0]] - point) < 1.5
    assert roots.reason[0] == tdoa.ONE_ROOT


def test_separately_digitised_curves_give_the_published_position(badman) -> None:
    receivers, curves = badman
    between = (curves["t_stb_unix_minus_1339090000_s"] - curves["t_sta_unix_minus_1339090000_s"])[::-1]
    stereo_b_after_a = np.interp(0.143, curves["frequency_mhz"][::-1], between)
    after_wind = DELAYS[LAST][0]
    roots = closed_form(receivers[None], np.array([[0.0, after_wind, after_wind + stereo_b_after_a]]))

    assert np.linalg.norm(roots.points[0, roots.chosen[0]] - LAST) < 1.5


def test_the_published_track_comes_back_and_its_aliases_have_negative_range(badman) -> None:
    track = published_track(badman[0])
    roots = closed_form(*received(track, badman[0]))

    np.testing.assert_allclose(roots.points[:, 0], track[:, :2], atol=0.03)
    np.testing.assert_array_equal(roots.chosen, 0)
    assert not roots.positive[:, 1].any()
    # -217 at 1.43 MHz in the reference notes; the range of the alias grows outwards
    assert roots.rho[0, 1] == pytest.approx(-217, abs=0.5)
    assert (np.diff(roots.rho[:, 1]) < 0).all()
    assert roots.rho[-1, 1] > -420


# --- exact arrival times ---


@pytest.mark.parametrize(
    ("receivers", "sources", "dimensions"),
    [
        (EVENT, SOURCES, 2),
        (RAISED[:3], SOURCES, 2),
        (FOUR, SOURCES, 2),
        (RAISED, SOURCES, 2),
        (RAISED, IN_SPACE, 3),
    ],
)
@pytest.mark.parametrize("emission_s", [0.0, -1234.5])
def test_exact_arrival_times_give_the_source(receivers, sources, dimensions, emission_s) -> None:
    solution = solved(sources, receivers, dimensions=dimensions, emission_s=emission_s)

    np.testing.assert_allclose(solution.position, sources[:, :dimensions], atol=1e-6)
    np.testing.assert_allclose(solution.emission_s, emission_s, atol=1e-6)
    np.testing.assert_allclose(solution.misfit, 0, atol=1e-9)
    assert not (solution.inconsistent | solution.singular).any()


def test_four_receivers_in_space_leave_two_roots_one_of_them_the_source() -> None:
    receivers, arrival_s = received(IN_SPACE, RAISED[:4])
    roots = closed_form(receivers, arrival_s)

    nearest = np.linalg.norm(roots.points - IN_SPACE[:, None], axis=2).min(axis=1)
    np.testing.assert_allclose(nearest, 0, atol=1e-6)
    assert (roots.valid[np.arange(5), roots.chosen]).all()


def test_two_valid_roots_are_flagged_and_both_explain_the_delays() -> None:
    receivers, arrival_s = received([186.0, -45.0, 0.0], spread(40))
    roots = closed_form(receivers, arrival_s)
    distance = np.linalg.norm(roots.points[0][:, None] - spread(40)[:, :2], axis=2) / C_RSUN_S

    assert roots.two_roots[0]
    assert roots.reason[0] == tdoa.NEARER
    np.testing.assert_allclose(np.diff(distance), np.tile(np.diff(arrival_s), (2, 1)), atol=1e-8)
    chosen = roots.points[0, roots.chosen[0]]
    assert np.linalg.norm(chosen) == np.linalg.norm(roots.points[0], axis=1).min()
    assert solve(receivers, arrival_s, np.full((1, 3), 7.0), 2).two_roots[0]


def test_more_receivers_decide_between_the_roots_but_a_mirror_image_is_flagged() -> None:
    decided = solved([186.0, -45.0, 0.0], np.vstack([spread(40), polar(150, 120)]))
    nearly_flat = solved([30.0, 20.0, 40.0], FIVE + 0.01 * HEIGHTS, sigma_s=7.0, dimensions=3)

    np.testing.assert_allclose(decided.position, [[186.0, -45.0]], atol=1e-6)
    assert not decided.two_roots[0]
    assert nearly_flat.two_roots[0]


def test_a_missing_receiver_is_as_if_it_had_never_been_listed() -> None:
    receivers, arrival_s = received(SOURCES, FIVE)
    arrival_s += np.linspace(-6, 6, arrival_s.size).reshape(arrival_s.shape)
    sigma_s = np.full(arrival_s.shape, 7.0)
    kept = [0, 1, 3, 4]
    without = solve(receivers[:, kept], arrival_s[:, kept], sigma_s[:, kept], 2)
    arrival_s[:, 2], sigma_s[:, 2], receivers[:, 2] = np.nan, np.nan, np.nan
    missing = solve(receivers, arrival_s, sigma_s, 2)

    for name in ("position", "covariance", "emission_s", "emission_sd_s", "misfit"):
        np.testing.assert_allclose(getattr(missing, name), getattr(without, name), atol=1e-5)


def test_least_squares_walks_to_the_source_from_afar() -> None:
    receivers, arrival_s = received(SOURCES, FIVE)
    timing = timing_of(receivers, arrival_s, np.ones_like(arrival_s), 2)
    found = descend(timing, np.full((5, 2), 60.0))

    np.testing.assert_allclose(found, SOURCES[:, :2], atol=1e-6)


# --- errors ---


@pytest.mark.parametrize("receivers", [EVENT, FIVE])
def test_covariance_is_the_scatter_of_the_estimate(receivers) -> None:
    rng = np.random.default_rng(20120607)
    receivers, arrival_s = received(np.tile([40.0, -60.0, 0.0], (4000, 1)), receivers)
    sigma_s = np.full(arrival_s.shape, 5.0)
    trials = solve(receivers, arrival_s + 5.0 * rng.normal(size=arrival_s.shape), sigma_s, 2)
    exact = solve(receivers[:1], arrival_s[:1], sigma_s[:1], 2)

    scale = np.sqrt(np.diag(exact.covariance[0]))
    np.testing.assert_allclose(np.cov(trials.position.T) / np.outer(scale, scale), _correlation(exact), atol=0.06)
    assert trials.emission_s.std() == pytest.approx(exact.emission_sd_s[0], rel=0.05)
    # n - 1 - D degrees of freedom are left
    assert trials.misfit.mean() == pytest.approx(receivers.shape[1] - 3, abs=0.1)


def _correlation(solution):
    scale = np.sqrt(np.diag(solution.covariance[0]))
    return solution.covariance[0] / np.outer(scale, scale)


@pytest.mark.parametrize(("source", "dimensions"), [(SOURCES[0], 2), (IN_SPACE[1], 3)])
def test_covariance_is_the_inverse_of_a_numerical_hessian(source, dimensions) -> None:
    receivers, arrival_s = received(source, RAISED)
    sigma_s = np.array([[5.0, 7.0, 9.0, 12.0, 30.0]])
    timing = timing_of(receivers, arrival_s, sigma_s, dimensions)
    pitch, axes = 0.05, np.eye(dimensions)

    def half_misfit(offset):
        return 0.5 * misfit(timing, (source[:dimensions] + pitch * offset)[None])[0]

    hessian = [
        [sum(i * j * half_misfit(i * a + j * b) for i in (1, -1) for j in (1, -1)) / (4 * pitch**2) for b in axes]
        for a in axes
    ]
    analytic = np.linalg.inv(information(timing, source[None, :dimensions])[0])
    np.testing.assert_allclose(analytic, np.linalg.inv(hessian), rtol=1e-4, atol=1e-4 * np.trace(analytic))


def test_emission_error_is_that_of_the_full_normal_matrix() -> None:
    sigma_s = np.array([[5.0, 7.0, 9.0, 12.0, 30.0]])
    receivers, arrival_s = received(SOURCES[0], RAISED)
    solution = solve(receivers, arrival_s, sigma_s, 2)
    offset = SOURCES[0] - RAISED
    unit = offset[:, :2] / np.linalg.norm(offset, axis=1)[:, None]
    jacobian = np.column_stack([unit / C_RSUN_S, np.ones(5)]) / sigma_s.T
    full = np.linalg.inv(jacobian.T @ jacobian)

    np.testing.assert_allclose(solution.covariance[0], full[:2, :2], rtol=1e-9)
    assert solution.emission_sd_s[0] == pytest.approx(np.sqrt(full[2, 2]), rel=1e-9)


@pytest.mark.parametrize("receivers", [FOUR, FIVE])
def test_covariance_agrees_with_the_exact_posterior_where_that_is_narrow(receivers) -> None:
    # the prior of position is made so wide that only the arrival times speak
    grid = grid_of([40.0, -60.0, 0.0], receivers, 7.0)
    posterior = moments(grid, Priors(tau_rsun=2000.0, v_sd_c=1e-5))
    solution = solve(grid.receiver_rsun, grid.arrival_s, grid.sigma_s, 2)

    size = np.trace(posterior.covariance[0])
    np.testing.assert_allclose(solution.covariance[0], posterior.covariance[0], rtol=0.05, atol=0.01 * size)
    assert solution.emission_sd_s[0] == pytest.approx(posterior.emission_sd_s[0], rel=0.05)
    assert np.linalg.norm(solution.position[0] - posterior.mean[0]) < 0.1 * np.sqrt(size)


# --- what must not matter ---

coordinate = st.floats(-150, 150)
noise = st.lists(st.floats(-3, 3), min_size=5, max_size=5)


def noisy(x, y, errors, receivers=FIVE):
    receivers, arrival_s = received([x, y, 0.0], receivers)
    return receivers, arrival_s + 5.0 * np.array(errors), np.full(arrival_s.shape, 5.0)


@settings(max_examples=20)
@given(coordinate, coordinate, noise, st.floats(-1e5, 1e5))
def test_a_common_delay_moves_the_emission_time_alone(x, y, errors, delay_s) -> None:
    receivers, arrival_s, sigma_s = noisy(x, y, errors)
    before, after = (solve(receivers, arrival_s + shift, sigma_s, 2) for shift in (0.0, delay_s))

    np.testing.assert_allclose(after.position, before.position, atol=1e-4)
    np.testing.assert_allclose(after.emission_s, before.emission_s + delay_s, atol=1e-4)
    np.testing.assert_allclose(after.emission_sd_s, before.emission_sd_s, rtol=1e-4)


@settings(max_examples=20)
@given(coordinate, coordinate, noise, st.floats(0, 2 * np.pi))
def test_the_solution_turns_with_the_axes(x, y, errors, angle) -> None:
    receivers, arrival_s, sigma_s = noisy(x, y, errors)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    before, after = solve(receivers, arrival_s, sigma_s, 2), solve(receivers @ turn.T, arrival_s, sigma_s, 2)

    np.testing.assert_allclose(after.position[0], turn[:2, :2] @ before.position[0], atol=1e-4)
    expected = turn[:2, :2] @ before.covariance[0] @ turn[:2, :2].T
    np.testing.assert_allclose(after.covariance[0], expected, rtol=1e-4, atol=1e-4 * np.trace(expected))


@settings(max_examples=20)
@given(coordinate, coordinate, noise, st.permutations(range(5)))
def test_the_order_of_the_receivers_does_not_matter(x, y, errors, order) -> None:
    receivers, arrival_s, sigma_s = noisy(x, y, errors)
    before = solve(receivers, arrival_s, sigma_s, 2)
    after = solve(receivers[:, order], arrival_s[:, order], sigma_s, 2)

    np.testing.assert_allclose(after.position, before.position, atol=1e-4)
    np.testing.assert_allclose(after.misfit, before.misfit, atol=1e-6)


@settings(max_examples=25)
@given(st.lists(st.floats(-1e6, 1e6), min_size=15, max_size=15), st.sampled_from([2, 3]), st.floats(-9, 9))
def test_whatever_the_arrival_times_every_number_is_finite(times, dimensions, log_sigma) -> None:
    arrival_s = np.reshape(times, (3, 5))
    receivers = np.broadcast_to(RAISED, (3, 5, 3))
    assert_finite(solve(receivers, arrival_s, np.full((3, 5), 10.0**log_sigma), dimensions))
    few = dimensions + 1
    assert_finite(solve(receivers[:, :few], arrival_s[:, :few], np.full((3, few), 10.0**log_sigma), dimensions))


def assert_finite(solution) -> None:
    for name in ("position", "covariance", "emission_s", "emission_sd_s", "misfit"):
        assert np.isfinite(getattr(solution, name)).all()
    values = np.linalg.eigvalsh(solution.covariance)
    assert (values > -1e-12 * values[:, -1:]).all()
    assert (values[:, -1] > 0).all()


# --- what cannot be, or is hard ---


@pytest.mark.parametrize("delays", [(0.0, 900.0, 900.0), (0.0, 0.0, 5000.0), (0.0, 1e6, -1e6)])
def test_delays_beyond_light_time_give_a_finite_flagged_answer(delays) -> None:
    roots = closed_form(EVENT[None], np.array([delays]))
    solution = solve(EVENT[None], np.array([delays]), np.full((1, 3), 10.0), 2)

    assert roots.chosen[0] == -1
    assert roots.reason[0] == tdoa.NO_ROOT
    assert solution.inconsistent[0]
    assert solution.misfit[0] > 10
    assert np.linalg.norm(solution.position[0]) <= SEARCH_RSUN * (1 + 1e-12)
    assert_finite(solution)
    assert np.sqrt(np.linalg.eigvalsh(solution.covariance)[0, -1]) <= SEARCH_RSUN * (1 + 1e-12)


def test_an_arrival_an_hour_late_is_inconsistent_with_four_others() -> None:
    receivers, arrival_s = received(SOURCES, FIVE)
    arrival_s[2, 4] += 3600.0
    solution = solve(receivers, arrival_s, np.full(arrival_s.shape, 10.0), 2)

    np.testing.assert_array_equal(solution.inconsistent, [False, False, True, False, False])


@pytest.mark.parametrize("sigma_s", [1e-9, 1e9])
@pytest.mark.parametrize(("receivers", "dimensions"), [(EVENT, 2), (FIVE, 2), (RAISED, 3)])
def test_extreme_errors_stay_finite(receivers, dimensions, sigma_s) -> None:
    solution = solved(IN_SPACE if dimensions == 3 else SOURCES, receivers, sigma_s=sigma_s, dimensions=dimensions)
    usual = solved(IN_SPACE if dimensions == 3 else SOURCES, receivers, sigma_s=1.0, dimensions=dimensions)

    assert_finite(solution)
    np.testing.assert_allclose(solution.position, usual.position, atol=1e-6)
    np.testing.assert_allclose(solution.covariance / sigma_s**2, usual.covariance, rtol=1e-6)


def test_one_precise_receiver_among_vague_ones_stays_finite() -> None:
    receivers, arrival_s = received(SOURCES, EVENT)
    assert_finite(solve(receivers, arrival_s, np.tile([1e-9, 1e9, 1e9], (5, 1)), 2))
    unlike = solve(receivers, arrival_s, np.tile([1e-9, 1e-9, 1e9], (5, 1)), 2)
    assert_finite(unlike)
    assert unlike.singular.all()


LINE = np.array([[100.0, 0, 0], [150.0, 50.0, 7.0], [200.0, 100.0, -3.0]])
COINCIDENT = np.tile(EVENT[:1], (3, 1))


@pytest.mark.parametrize(
    ("receivers", "dimensions"), [(LINE, 2), (COINCIDENT, 2), (EVENT[[0, 0, 1]], 2), (FIVE, 3), (FOUR, 3)]
)
def test_receivers_on_a_line_or_in_a_plane_are_refused(receivers, dimensions) -> None:
    with pytest.raises(GeometryError, match=r"row 0 .*use the method posterior") as refused:
        solved([20.0, 30.0, 0.0], receivers, dimensions=dimensions)
    assert "\n" not in str(refused.value)


def test_the_row_that_cannot_be_used_is_named() -> None:
    receivers, arrival_s = received(SOURCES, EVENT)
    sigma_s = np.full(arrival_s.shape, 5.0)
    wrong = [
        ("fewer than 3 receivers", "arrival_s", np.nan),
        ("arrival time that is not finite", "arrival_s", np.inf),
        ("sigma_s that is not above 0", "sigma_s", 0.0),
        ("sigma_s that is not above 0", "sigma_s", np.nan),
        ("receiver without a position", "receivers", np.nan),
    ]
    for reason, name, value in wrong:
        given_values = {"receivers": receivers.copy(), "arrival_s": arrival_s.copy(), "sigma_s": sigma_s.copy()}
        given_values[name][3, 1] = value
        with pytest.raises(InputError, match=f"^row 3 .*{reason}"):
            solve(**given_values, dimensions=2)
    with pytest.raises(InputError, match="do not agree"):
        solve(receivers, arrival_s, sigma_s[:, :2], 2)
    with pytest.raises(GeometryError, match="row 0 has numbers beyond"):
        solve(receivers, arrival_s, np.full(arrival_s.shape, 1e-200), 2)


def test_no_problems_are_no_trouble() -> None:
    nothing = solve(np.empty((0, 4, 3)), np.empty((0, 4)), np.empty((0, 4)), 2)
    assert nothing.position.shape == (0, 2)
    assert nothing.covariance.shape == (0, 2, 2)

"""What must hold for any receivers, any source and any timing."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bella.arrivals import NUISANCE, ArrivalGrid
from bella.exceptions import ConvergenceError
from bella.multilateration import localise
from bella.multilateration.localise import solution_dataset
from bella.multilateration.posterior import Recipe, exact_posterior
from bella.multilateration.priors import Preset, Priors
from tests.multilateration.geometry import NARROW, WIDE, grid_of, moments, polar, sd_of, table_of

LONGITUDES = st.lists(st.floats(-180, 180), min_size=3, max_size=5)
SOURCES = st.tuples(st.floats(1, 150), st.floats(-180, 180))
SIGMAS = st.floats(10, 200)
PRIORS = st.sampled_from([NARROW, WIDE])
QUICK = settings(max_examples=20, deadline=None)


@st.composite
def grids(draw) -> ArrivalGrid:
    receivers = [polar(draw(st.floats(60, 230)), longitude) for longitude in draw(LONGITUDES)]
    noise = draw(st.lists(st.floats(-2, 2), min_size=len(receivers), max_size=len(receivers)))
    lift = np.array([[0, 0, 1.0]]) * draw(st.floats(-20, 20))
    return grid_of(polar(*draw(SOURCES)), np.array(receivers) + lift, draw(SIGMAS), noise=np.array(noise))


def same(one, other, share: float = 1e-3) -> None:
    """Moments that agree within a share of their standard deviation."""
    np.testing.assert_allclose((one.mean - other.mean) / sd_of(other), 0, atol=share)
    np.testing.assert_allclose(sd_of(one), sd_of(other), rtol=share)
    np.testing.assert_allclose(one.v_over_c_sd, other.v_over_c_sd, rtol=share)


@given(grids(), PRIORS, st.floats(-40_000, 40_000))
@QUICK
def test_a_common_delay_moves_the_emission_alone(grid, priors, delay_s) -> None:
    before, after = moments(grid, priors), moments(replace(grid, arrival_s=grid.arrival_s + delay_s), priors)

    same(after, before, 1e-6)
    np.testing.assert_allclose(after.emission_s - before.emission_s, delay_s, atol=1e-6)
    np.testing.assert_allclose(after.log_evidence, before.log_evidence, atol=1e-6)


@given(st.integers(-3_000_000, 3_000_000))
@settings(max_examples=10, deadline=None)
def test_a_common_delay_in_the_table_moves_the_emission_time_alone(delay_ms) -> None:
    table = table_of(grid_of(polar(75, 20), np.stack([polar(215, a) for a in (0, 116, -116)]), 30.0))
    late = table.assign(arrival_utc=table["arrival_utc"] + pd.Timedelta(delay_ms, unit="ms"))
    before, after = (localise(some, draws=10, seed=1) for some in (table, late))

    np.testing.assert_allclose(after["x_rsun"], before["x_rsun"], atol=1e-5)
    moved = pd.Timestamp(after.attrs["reference_time"]) - pd.Timestamp(before.attrs["reference_time"])
    emission_s = float(after["emission_s"][0] - before["emission_s"][0]) + moved.total_seconds()
    assert emission_s == pytest.approx(delay_ms / 1000, abs=1e-5)


@given(grids(), PRIORS, st.floats(-180, 180))
@QUICK
def test_turning_the_receivers_turns_the_source(grid, priors, angle_deg) -> None:
    cosine, sine = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    turn = np.array([[cosine, -sine], [sine, cosine]])
    turned = grid.receiver_rsun.copy()
    turned[..., :2] = turned[..., :2] @ turn.T
    before, after = moments(grid, priors), moments(replace(grid, receiver_rsun=turned), priors)

    widest = np.sqrt(np.linalg.eigvalsh(before.covariance[0])[-1])
    np.testing.assert_allclose((after.mean[0] - turn @ before.mean[0]) / widest, 0, atol=2e-3)
    np.testing.assert_allclose((after.covariance[0] - turn @ before.covariance[0] @ turn.T) / widest**2, 0, atol=2e-3)
    np.testing.assert_allclose(after.log_evidence, before.log_evidence, atol=2e-3)  # each is good to 1e-3


@given(grids(), PRIORS, st.randoms(use_true_random=False))
@QUICK
def test_the_order_of_the_receivers_does_not_matter(grid, priors, random) -> None:
    order = list(range(len(grid.observatories)))
    random.shuffle(order)
    shuffled = replace(
        grid,
        observatories=tuple(grid.observatories[i] for i in order),
        arrival_s=grid.arrival_s[:, order],
        sigma_s=grid.sigma_s[:, order],
        receiver_rsun=grid.receiver_rsun[:, order],
    )
    before, after = moments(grid, priors), moments(shuffled, priors)

    same(after, before, 1e-6)
    np.testing.assert_allclose(after.log_evidence, before.log_evidence, atol=1e-6)


@given(grids(), st.sampled_from([0.001, 0.1]), st.floats(0.2, 5))
@QUICK
@example(grid_of(polar(50, 90), np.array([polar(137, 0), polar(137, 0), polar(137, 30)]), 200.0), 0.1, 0.5)
def test_a_larger_world_has_a_larger_answer(grid, v_sd_c, factor) -> None:
    """All lengths and times, and the widths of their priors, by one factor."""
    priors = Priors(v_sd_c=v_sd_c)
    larger = replace(
        grid,
        arrival_s=grid.arrival_s * factor,
        sigma_s=grid.sigma_s * factor,
        receiver_rsun=grid.receiver_rsun * factor,
        rise_s=grid.rise_s * factor,
    )
    before = moments(grid, priors)
    after = moments(larger, Priors(tau_rsun=factor * priors.tau_rsun, v_sd_c=v_sd_c))

    # a posterior as broad as the prior keeps some of the first cells undivided: it is good to 0.01 standard deviations
    np.testing.assert_allclose((after.mean / factor - before.mean) / sd_of(before), 0, atol=3e-2)
    np.testing.assert_allclose(sd_of(after) / factor, sd_of(before), rtol=1e-2)
    np.testing.assert_allclose(after.v_over_c, before.v_over_c, rtol=1e-3)


@given(grids(), PRIORS, st.floats(60, 230), st.floats(-180, 180), st.floats(-1000, 1000))
@QUICK
def test_a_receiver_without_precision_changes_nothing(grid, priors, range_rsun, longitude_deg, arrival_s) -> None:
    where = polar(range_rsun, longitude_deg)[None, None]
    more = replace(
        grid,
        observatories=(*grid.observatories, "DEAF"),
        arrival_s=np.c_[grid.arrival_s, [[arrival_s]]],
        sigma_s=np.c_[grid.sigma_s, [[1e8]]],
        receiver_rsun=np.concatenate([grid.receiver_rsun, where], axis=1),
        rise_s=grid.rise_s[:, :1],
        **dict.fromkeys(NUISANCE, np.zeros(())),
    )

    same(moments(more, priors), moments(grid, priors), 1e-4)


@given(grids(), PRIORS, st.floats(1.2, 10))
@QUICK
def test_worse_timing_is_never_worth_more(grid, priors, factor) -> None:
    """With noise-free times of a source at the centre of the prior, wider errors give wider posteriors."""
    distance = np.linalg.norm(grid.receiver_rsun, axis=2)
    exact = replace(grid, arrival_s=distance / 0.430922)
    worse = replace(exact, sigma_s=exact.sigma_s * factor)
    area, larger = (np.linalg.det(moments(some, priors).covariance[0]) for some in (exact, worse))

    assert larger >= area * (1 - 1e-6)
    assert (sd_of(moments(worse, priors)) <= priors.tau_rsun * 1.35).all()


@given(
    st.lists(st.tuples(st.floats(0, 300), st.floats(-180, 180)), min_size=3, max_size=5),
    st.lists(st.floats(-5000, 5000), min_size=5, max_size=5),
    st.floats(1, 1e5),
    PRIORS,
)
@settings(max_examples=40, deadline=None)
def test_no_arrival_times_give_nan(places, arrivals, sigma_s, priors) -> None:
    receivers = np.array([polar(*place) for place in places])
    grid = grid_of(np.zeros(3), receivers, sigma_s)
    grid = replace(grid, arrival_s=np.array([arrivals[: len(places)]]))
    recipe = Recipe("posterior", Preset("case", priors, "table"), 2, 50, 0)
    try:
        solution = solution_dataset(grid, exact_posterior(grid, recipe, lambda _: None), recipe)
    except ConvergenceError:
        return
    for name, variable in solution.data_vars.items():
        if variable.dtype.kind == "f" and not str(name).startswith(("region", "mode_mean", "clock_")):
            assert np.isfinite(variable).all(), name
    assert np.isfinite(solution["region68"]).any()
    assert int(solution["modes"][0]) >= 1

"""Preliminary tracks from two spacecraft: the model, its noise, the regions, and when nothing is published."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from bella.arrivals import ArrivalGrid, arrival_grid, check_arrivals, locate_receivers
from bella.exceptions import InputError, NotPlacedError
from bella.records import Interval, JointTrack
from bella.tracks import TrackRecipe, fit_preliminary, fit_table, level_of, preliminary_track, why_not_published
from bella.tracks.preliminary import CELLS, _region, _too_little, region_size_deg, separation_deg
from bella.tracks.preliminary_model import FLAT_S2, ArrivalModel, Modes, belonging, range_prior, rows_of, search
from benchmarks.preliminary import right_side, simulated

LIGHT_RSUN_S, TURN_RAD_RSUN = 0.43092, 2.0 * np.pi / (25.38 * 86400) * 695_700 / 400.0
SEPARATION_DEG = 90.0
NAMES = {"wind": "WIND", "stereo_a": "STEREO-A", "sta": "STEREO-A", "stb": "STEREO-B", "solo": "SOLO", "psp": "PSP"}


@lru_cache
def burst(seed: int, separation_deg: float = SEPARATION_DEG) -> tuple[float, ArrivalGrid]:
    truth, grid = simulated(seed, separation_deg)
    return truth.phi0_deg, grid


@lru_cache
def fitted(seed: int) -> JointTrack:
    return preliminary_track(burst(seed)[1])


def turned(grid: ArrivalGrid, angle_deg: float) -> ArrivalGrid:
    cosine, sine = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return replace(grid, receiver_rsun=grid.receiver_rsun @ turn.T)


def later(grid: ArrivalGrid, column: int, by_s: np.ndarray | float) -> ArrivalGrid:
    arrival = grid.arrival_s.copy()
    arrival[:, column] += by_s
    return replace(grid, arrival_s=arrival)


def refusal(grid: ArrivalGrid, other: ArrivalGrid | None = None) -> str:
    with pytest.raises(NotPlacedError) as refused:
        fit_preliminary(grid, other)
    return str(refused.value)


def test_prior_of_the_distance_is_that_of_the_density_models() -> None:
    laws = (
        lambda r: 3.3e5 / r**2 + 4.1e6 / r**4 + 8e7 / r**6,
        lambda r: 1.36e6 / r**2.14 + 1.68e8 / r**6.13,
        lambda r: 1.39e6 / r**2.3 + 3e8 / r**6 + 4.8e9 / r**14,
    )
    frequency = np.array([0.2, 0.5, 1.5])
    both = np.concatenate([frequency, frequency / 2])
    plasma = [
        [brentq(lambda r, f=f, law=law: 8.97866e-3 * np.sqrt(law(r)) - f, 1.01, 390.0) for f in both] for law in laws
    ]
    log_range = np.log(np.reshape(plasma, (6, 3)))
    prior = range_prior(0.15, 2.5)
    basis = prior.basis(frequency)
    np.testing.assert_allclose(basis @ prior.mean, log_range.mean(axis=0), atol=0.01)
    slope = 0.25 * np.log(frequency / 0.5)
    sd = np.sqrt(log_range.var(axis=0) + np.log(2) ** 2 + slope**2 + 0.07**2)
    np.testing.assert_allclose(np.linalg.norm(basis @ prior.root, axis=1), sd, rtol=0.02)


def model_of(seed: int) -> ArrivalModel:
    rows = rows_of(burst(seed)[1])
    return ArrivalModel(rows, range_prior(float(rows.frequency_mhz.min()), float(rows.frequency_mhz.max())))


def test_arrival_times_are_those_of_a_beam_on_a_spiral() -> None:
    model, rng = model_of(3), np.random.default_rng(8)
    z, phi0 = 0.7 * rng.standard_normal(9), 1.1
    row = 4
    r = float(np.exp(model.mean[row] + model.by_z[row] @ z[:5]))
    turn = TURN_RAD_RSUN * (1 + 0.3 * z[5])
    speed = 0.15 * LIGHT_RSUN_S * np.exp(0.5 * z[7])
    slowing = 0.15 + 0.2 * z[8]
    travel = quad(lambda s: np.sqrt(1 + (turn * s) ** 2) * s**slowing / speed, 1.0, r)[0]
    outward = np.array([np.cos(phi0 - turn * (r - 1)), np.sin(phi0 - turn * (r - 1)), 0.0])
    sight = model.rows.receiver_rsun[row] - r * outward
    length = np.linalg.norm(sight)
    delay = (0.11 + 0.1 * z[6]) * 33.0 * model.rows.frequency_mhz[row] ** -1.05 * (1 - outward @ sight / length)
    computed = model.delay_s(np.array([phi0]), z[None])[0][0, row]
    assert computed == pytest.approx(travel + length / LIGHT_RSUN_S + delay, abs=0.01)


def test_derivatives_are_those_of_the_arrival_times() -> None:
    model, rng = model_of(3), np.random.default_rng(9)
    z, phi0 = rng.standard_normal((4, 9)), rng.uniform(-3, 3, 4)
    derivative = model.delay_s(phi0, z)[1]
    for place in range(9):
        step = 1e-5 * np.eye(9)[place]
        difference = (model.delay_s(phi0, z + step)[0] - model.delay_s(phi0, z - step)[0]) / 2e-5
        np.testing.assert_allclose(derivative[place], difference, rtol=1e-5, atol=1e-4)


def test_weights_of_longitudes_are_integrals_over_the_parameters() -> None:
    model, rng = model_of(7), np.random.default_rng(3)
    modes = search(model)
    likely = np.flatnonzero(modes.log_weight > modes.log_weight.max() - 6.0)[::4]
    missed = []
    for mode in likely:
        root = np.linalg.cholesky(1.3 * modes.covariance[mode])
        drawn = multivariate_t(np.zeros(9), np.eye(9), df=8, seed=rng)
        steps = drawn.rvs(1500)
        z = modes.z[mode] + steps @ root.T
        residual = model.misfit(np.full(1500, modes.phi0_rad[mode]), z)[0]
        log_target = -0.5 * ((residual**2).sum(axis=1) + (z**2).sum(axis=1))
        log_integral = logsumexp(log_target - drawn.logpdf(steps)) + np.log(np.diag(root)).sum() - np.log(1500)
        missed.append(log_integral - modes.log_weight[mode])
    spread = modes.log_weight[likely] + 0.5 * (modes.z[likely] ** 2).sum(axis=1) + 0.5 * modes.chi2[likely]
    assert np.ptp(spread) > 4 * np.std(missed)
    assert np.std(missed) < 0.25


def small(**columns: float) -> ArrivalGrid:
    rows = {"observatory": ["A", "A", "B"], "frequency_mhz": [0.4, 0.8, 0.5], "sigma_s": [2.0, 3.0, 4.0]}
    rows |= {"arrival_utc": "2026-07-09T12:00:00", "edge": "half_rise"}
    rows |= {"x_rsun": [200.0, 200.0, 0.0], "y_rsun": [0.0, 0.0, 200.0], "z_rsun": 0.0, "rise_s": [50.0, 20.0, 40.0]}
    return arrival_grid(check_arrivals(pd.DataFrame(rows | columns), received_by=2), received_by=1)


def noise_s2(**columns: float) -> np.ndarray:
    """Rows A 0.4, A 0.8, B 0.5 MHz."""
    return rows_of(small(**columns)).covariance_s2


def test_noise_is_that_of_the_edges_and_of_the_beam() -> None:
    frequency, sigma = np.array([0.4, 0.8, 0.5]), np.array([2.0, 3.0, 4.0])
    apart = np.log(frequency[:, None] / frequency)
    beam = 0.05 * 60.0 * 0.55 / frequency
    expected = np.diag(sigma**2 + 0.1) + np.outer(beam, beam) * np.exp(-0.5 * (apart / 0.5) ** 2)
    shape = 0.2 * np.array([50.0, 20.0, 40.0])
    same = np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1]])
    expected += same * (np.outer(shape, shape) * np.exp(-0.5 * (apart / 0.5) ** 2) + 3.0**2)
    np.testing.assert_allclose(noise_s2(), expected)


def test_what_the_table_says_of_its_noise_is_taken() -> None:
    np.testing.assert_allclose(
        np.diag(noise_s2(shape_sd_s=6.0, offset_sd_s=1.0) - noise_s2(shape_sd_s=7.0)),
        [36.0 + 1.0 - 49.0 - 9.0] * 3,
    )


def test_known_delays_are_taken_off() -> None:
    plain, delayed = rows_of(small()), rows_of(small(delay_s=[0.0, 5.0, 1.0]))
    np.testing.assert_allclose(np.ptp(plain.arrival_s), 0.0)
    np.testing.assert_allclose(delayed.arrival_s - delayed.arrival_s[0], [0.0, -5.0, -1.0])


def test_regions_hold_the_truth_of_bursts_of_foreign_laws() -> None:
    level = np.array([level_of(fitted(seed), burst(seed)[0]) for seed in range(12)])
    information = [np.log(CELLS * fitted(seed).phi0_probability[int(burst(seed)[0] + 180)]) for seed in range(12)]
    assert 6 <= (level <= 0.68).sum() <= 11
    assert (level <= 0.95).sum() >= 11
    assert np.mean(information) > 0.9


def test_side_is_more_often_right_than_not() -> None:
    right = [right_side(simulated(seed, SEPARATION_DEG)[0], fitted(seed)) for seed in range(12)]
    assert np.mean(right) > 0.5


def test_nothing_else_is_said() -> None:
    track = fitted(0)
    assert track.tier == "preliminary"
    for parameter in (track.phi0_deg, track.v_sw_km_s, track.beam_speed_c):
        assert set(parameter.model_dump().values()) == {None}
    assert set(track.release_utc.model_dump().values()) == {None}
    assert all(set(one.longitude_deg.model_dump().values()) == {None} for one in track.profile)
    assert JointTrack.model_validate_json(track.model_dump_json()) == track


def test_distance_falls_with_frequency_and_is_known_better_than_before() -> None:
    for seed in range(4):
        quantiles = [(one.range_rsun.q16, one.range_rsun.q50, one.range_rsun.q84) for one in fitted(seed).profile]
        assert np.all(np.diff(quantiles, axis=0) < 0)
        assert np.all(np.diff(quantiles, axis=1) > 0)
        assert all(one.range_rsun.contraction < 0.7 for one in fitted(seed).profile if one.frequency_mhz == 0.5)


@pytest.mark.parametrize("angle_deg", [3.0, 90.0, -171.0])
def test_the_answer_turns_with_the_spacecraft(angle_deg: float) -> None:
    track = preliminary_track(turned(burst(2)[1], angle_deg))
    np.testing.assert_allclose(track.phi0_probability, np.roll(fitted(2).phi0_probability, round(angle_deg)), atol=3e-5)
    assert np.cos(np.radians(track.side.middle_deg - fitted(2).side.middle_deg - angle_deg)) == pytest.approx(1)


def test_the_order_of_the_spacecraft_does_not_matter() -> None:
    grid = burst(2)[1]
    per_craft = (
        "arrival_s",
        "sigma_s",
        "receiver_rsun",
        "shape_sd_s",
        "offset_sd_s",
        "delay_s",
        "delay_sd_s",
        "rise_s",
    )
    swapped = replace(
        grid,
        observatories=grid.observatories[::-1],
        **{name: np.asarray(getattr(grid, name))[:, ::-1] for name in per_craft},
    )
    np.testing.assert_allclose(preliminary_track(swapped).phi0_probability, fitted(2).phi0_probability, atol=3e-5)


def test_larger_errors_give_larger_regions() -> None:
    grid = burst(4)[1]
    wide = preliminary_track(
        replace(grid, shape_sd_s=0.6 * grid.rise_s, offset_sd_s=np.full_like(grid.arrival_s, 20.0))
    )
    assert region_size_deg(wide.phi0_95) > 1.2 * region_size_deg(fitted(4).phi0_95)


def test_one_bad_edge_is_left_out() -> None:
    grid = burst(5)[1]
    row = np.flatnonzero(np.isfinite(grid.arrival_s[:, 1]))[9]
    bad = np.zeros(grid.frequency_mhz.size)
    bad[row] = 60.0
    track = preliminary_track(later(grid, 1, bad))
    assert track.flags == ("arrivals_down_weighted",)
    moved = np.abs(np.subtract(track.phi0_probability, fitted(5).phi0_probability)).sum() / 2
    assert moved < 0.15
    assert track.error_scale < 1.2


def left_out(late_s: np.ndarray) -> np.ndarray:
    """Rows that do not belong to the others, of a burst whose best track fits exactly but for some late edges."""
    model, phi0, z = model_of(5), np.array([0.3]), np.zeros((1, 9))
    exact = replace(model.rows, arrival_s=model.delay_s(phi0, z)[0][0] + late_s)
    best = Modes(phi0, z, np.zeros(1), np.eye(9)[None], np.zeros(1))
    return np.flatnonzero(~belonging(ArrivalModel(exact, model.prior), best))


def test_an_edge_four_errors_away_from_all_others_is_left_out() -> None:
    model = model_of(5)
    free = model.delay_s(np.array([0.3]), np.zeros((1, 9)))[1][:, 0]
    inverse = np.linalg.inv(model.rows.covariance_s2 + FLAT_S2 + free.T @ free)
    late_s = np.zeros(len(inverse))
    late_s[9] = 1 / np.sqrt(inverse[9, 9])

    assert left_out(3.9 * late_s).size == 0
    assert left_out(4.1 * late_s).tolist() == [9]


def test_a_tenth_of_the_edges_is_left_out_at_most() -> None:
    rows = model_of(5).rows.arrival_s.size
    late_s = np.where(np.arange(rows) % 3, 0.0, 500.0 * (-1) ** np.arange(rows))

    assert left_out(late_s).size == int(np.ceil(0.1 * rows))


def test_errors_are_widened_where_nothing_fits() -> None:
    grid = burst(5)[1]
    noise = np.where(np.arange(grid.frequency_mhz.size) % 2, 12.0, -12.0)
    track = preliminary_track(later(grid, 0, noise))
    assert track.error_scale**2 == pytest.approx(track.chi2 / track.freedom, rel=0.03)
    assert track.error_scale > 1.5
    assert track.misfit_p < 1e-6
    assert region_size_deg(track.phi0_95) > region_size_deg(fitted(5).phi0_95)
    reason = why_not_published(track.model_copy(update={"phi0_95": fitted(5).phi0_95}))
    assert reason is not None
    assert "within their errors" in reason


def test_many_channels_are_averaged() -> None:
    grid = burst(6)[1]
    received = np.isfinite(grid.arrival_s)
    dense = np.sort(np.concatenate([grid.frequency_mhz * (1 + 1e-5 * step) for step in range(8)]))
    again = np.repeat(np.arange(grid.frequency_mhz.size), 8)
    copied = ArrivalGrid(
        dense,
        grid.observatories,
        grid.arrival_s[again],
        grid.sigma_s[again] * np.sqrt(8),
        grid.receiver_rsun[again],
        grid.reference_utc,
        grid.edge,
    )
    assert rows_of(copied).arrival_s.size <= 120 < 8 * received.sum()
    moved = np.abs(np.subtract(preliminary_track(copied).phi0_probability, fitted(6).phi0_probability)).sum() / 2
    assert moved < 0.1


@given(
    st.lists(st.floats(0.0, 1.0), min_size=12, max_size=12).filter(lambda one: sum(one) > 0.1),
    st.sampled_from([0.68, 0.95]),
)
@settings(max_examples=60, deadline=None)
def test_regions_are_the_smallest_that_hold_enough(parts: list[float], level: float) -> None:
    probability = np.repeat(parts, CELLS // 12) + 1e-9 * np.arange(CELLS)
    probability /= probability.sum()
    region = _region(probability, level)
    cells = [int(cell) % CELLS for part in region for cell in np.arange(part.low + 180, part.high + 180)]
    assert len(set(cells)) == len(cells)
    assert level <= probability[cells].sum() + 1e-9
    assert probability[cells].sum() - probability[cells].min() < level + 1e-9
    assert sum(part.probability for part in region) == pytest.approx(probability[cells].sum(), abs=1e-3)
    outside = np.setdiff1d(np.arange(CELLS), cells)
    assert not outside.size or probability[cells].min() >= probability[outside].max()


def test_the_level_says_how_far_out_a_longitude_is() -> None:
    probability = np.zeros(CELLS)
    probability[np.arange(-10, 10)] = 0.04  # 20 degrees across 180
    probability[170:180] = 0.02  # 10 degrees before 0
    track = fitted(0).model_copy(update={"phi0_probability": tuple(probability)})
    for longitude, level in ((179.5, 0.4), (-175.5, 0.4), (184.5, 0.4), (-5.5, 0.9), (90.0, 1.0)):
        assert level_of(track, longitude) == pytest.approx(level)


def test_a_final_track_has_no_level() -> None:
    with pytest.raises(InputError, match="preliminary"):
        level_of(fitted(0).model_copy(update={"phi0_probability": ()}), 0.0)


def test_what_says_little_is_not_published() -> None:
    assert "10 deg" in refusal(burst(0, 6.0)[1])
    grid = burst(0)[1]
    assert "too few frequencies" in refusal(grid.take(grid.frequency_mhz < 0.25))
    assert "too few frequencies" in refusal(grid.take(np.arange(grid.frequency_mhz.size) % 6 == 0))
    one = {name: getattr(grid, name)[:, :1] for name in ("arrival_s", "sigma_s", "receiver_rsun")}
    alone = ArrivalGrid(grid.frequency_mhz, grid.observatories[:1], **one, reference_utc=grid.reference_utc, edge="x")
    assert "two spacecraft" in refusal(alone)
    assert "half of the circle" in refusal(replace(grid, shape_sd_s=2.0 * grid.rise_s))


@pytest.mark.parametrize(("apart_deg", "refused"), [(9.7, True), (10.3, False)])
def test_spacecraft_ten_degrees_apart_are_far_enough(apart_deg: float, refused: bool) -> None:
    grid = burst(0)[1]
    receiver = grid.receiver_rsun.copy()
    angle = np.radians(apart_deg)
    receiver[:, 0], receiver[:, 1] = [215.0, 0.0, 0.0], [215.0 * np.cos(angle), 215.0 * np.sin(angle), 0.0]
    assert (_too_little(replace(grid, receiver_rsun=receiver)) is not None) is refused


@pytest.mark.parametrize(
    ("channels", "span", "refused"), [(8, 2.6, False), (7, 2.6, True), (8, 2.4, True), (20, 2.4, True)]
)
def test_eight_channels_over_a_factor_of_two_and_a_half_are_enough(channels: int, span: float, refused: bool) -> None:
    grid = burst(0)[1].take(np.arange(channels))
    given = replace(
        grid,
        frequency_mhz=np.geomspace(0.3, 0.3 * span, channels),
        arrival_s=np.zeros((channels, 2)),
        receiver_rsun=np.broadcast_to([[215.0, 0.0, 0.0], [0.0, 215.0, 0.0]], (channels, 2, 3)),
    )
    assert (_too_little(given) is not None) is refused


@pytest.mark.parametrize(
    ("size_deg", "widening", "refused"), [(179.0, 1.45, False), (181.0, 1.0, True), (90.0, 1.55, True)]
)
def test_half_of_the_circle_and_half_more_misfit_are_the_limits(
    size_deg: float, widening: float, refused: bool
) -> None:
    parts = (
        Interval(low=0.0, high=size_deg - 40.0, probability=0.7),
        Interval(low=-60.0, high=-20.0, probability=0.25),
    )
    track = fitted(0).model_copy(update={"phi0_95": parts, "error_scale": np.sqrt(widening)})
    assert (why_not_published(track) is not None) is refused


def test_errors_are_widened_from_a_fifth_more_misfit_on() -> None:
    grid = burst(5)[1]
    wave = np.where(np.arange(grid.frequency_mhz.size) % 2, 1.0, -1.0)
    tracks = [preliminary_track(later(grid, 0, size_s * wave)) for size_s in (2.25, 2.6)]
    for track in tracks:
        reduced = track.chi2 / track.freedom
        assert track.error_scale**2 == pytest.approx(reduced if reduced > 1.2 else 1.0, rel=0.03)
    assert [track.error_scale > 1.0 for track in tracks] == [False, True]


def published_seed() -> int:
    return next(seed for seed in range(12) if why_not_published(fitted(seed)) is None)


def test_a_narrow_band_is_not_enough() -> None:
    bursts = [burst(seed)[1] for seed in range(12)]
    narrow = [one.take((one.frequency_mhz > 0.5) & (one.frequency_mhz < 1.2)) for one in bursts]
    dense = next(one for one in narrow if np.isfinite(one.arrival_s).sum(axis=0).min() >= 10)
    assert "too few frequencies" in refusal(dense)


def test_regions_are_those_of_68_and_95_per_cent() -> None:
    for region, level in ((fitted(0).phi0_68, 0.68), (fitted(0).phi0_95, 0.95)):
        assert level <= sum(part.probability for part in region) + 1e-3 < level + 0.02


def test_two_edges_must_agree() -> None:
    grid = burst(published_seed())[1]
    assert fit_preliminary(grid).flags == ("one_edge",)
    assert fit_preliminary(grid, later(grid, 0, 1.0)).flags == ()
    assert "exclude one another" in refusal(grid, later(grid, 0, -30.0 / grid.frequency_mhz))


def as_table(grid: ArrivalGrid, edge: str = "half_rise", names: tuple[str, str] = ("A", "B")) -> pd.DataFrame:
    row, column = np.nonzero(np.isfinite(grid.arrival_s))
    seconds = np.rint(grid.arrival_s[row, column] * 1e9).astype("timedelta64[ns]")
    place = dict(zip(("x_rsun", "y_rsun", "z_rsun"), grid.receiver_rsun[row, column].T, strict=True))
    noise = {name: getattr(grid, name)[row, column] for name in ("sigma_s", "shape_sd_s", "offset_sd_s", "rise_s")}
    return pd.DataFrame(
        {
            "observatory": np.array(names)[column],
            "frequency_mhz": grid.frequency_mhz[row],
            "arrival_utc": grid.reference_utc + seconds,
            "edge": edge,
            **noise,
            **place,
        }
    )


def test_a_second_table_is_asked_of_two_spacecraft() -> None:
    grid = burst(published_seed())[1]
    first = as_table(grid)

    def joint(other: pd.DataFrame | None) -> JointTrack | None:
        return fit_table(first, TrackRecipe(other_edges=other)).joint

    alone, both = joint(None), joint(as_table(later(grid, 0, 1.0), "half_maximum"))
    assert alone is not None
    assert both is not None
    assert "one_edge" in alone.flags
    assert "one_edge" not in both.flags
    with pytest.raises(NotPlacedError, match="exclude one another"):
        joint(as_table(later(grid, 0, -30.0 / grid.frequency_mhz), "half_maximum"))
    with pytest.raises(InputError, match="both tables have the edge half_rise"):
        joint(first)
    with pytest.raises(InputError, match="other spacecraft"):
        joint(as_table(grid, "half_maximum", ("A", "C")))


def test_separation_is_the_angle_at_the_sun() -> None:
    assert separation_deg(burst(0)[1]) == pytest.approx(SEPARATION_DEG, abs=0.1)


def pairs(table: pd.DataFrame) -> list[ArrivalGrid]:
    names = sorted(set(table["observatory"]))
    both = [(one, other) for one in names for other in names if one < other]
    tables = [check_arrivals(table[table["observatory"].isin(pair)], received_by=2) for pair in both]
    return [arrival_grid(locate_receivers(one), received_by=1) for one in tables]


def test_pairs_of_the_burst_of_2012_hold_the_answer_of_three(reference_files: Path) -> None:
    rows = pd.read_csv(reference_files / "arrivals/20120607_arrivals_from_digitised.csv").dropna()
    rows = rows[rows["freq_mhz"].between(0.15, 2.0)]
    seconds = np.rint(1e9 * rows["t_rise_half_interp_s"]).astype("timedelta64[ns]")
    table = pd.DataFrame(
        {
            "observatory": rows["spacecraft"].map(NAMES),
            "frequency_mhz": rows["freq_mhz"],
            "arrival_utc": np.datetime64("2012-06-07", "ns") + seconds,
            "sigma_s": 5.0,
            "edge": "half_rise",
        }
    ).drop_duplicates(["observatory", "frequency_mhz"])
    levels = [level_of(preliminary_track(grid), 28.0) for grid in pairs(table)]
    assert max(levels) <= 0.95


def test_hand_edges_do_not_exclude_the_answer(reference_files: Path) -> None:
    rows = pd.read_csv(reference_files / "arrivals/20200721_semp_leading_edge.csv")
    table = pd.DataFrame(
        {
            "observatory": rows["spacecraft"].map(NAMES),
            "frequency_mhz": rows["freq_mhz"],
            "arrival_utc": rows["t_utc_corrected"],
            "sigma_s": 10.0,
            "edge": "leading",
        }
    ).drop_duplicates(["observatory", "frequency_mhz"])
    levels = [level_of(preliminary_track(grid), 174.0) for grid in pairs(table)]
    assert max(levels) <= 0.95

"""The noise of arrival times is found where it is put in, and states the errors of differences."""

from dataclasses import replace

import numpy as np
import pytest

from bella.bursts.noise import (
    LEAST_SIGMA_S,
    MOST_FOR_NOISE,
    OUTLIER_SD,
    STARTS,
    Timed,
    _Misfit,
    at_frequencies,
    estimate_noise,
    noise_columns,
    outliers,
    spread_channels,
    width_spread,
)

FREQUENCY_MHZ = np.geomspace(0.2, 2.5, 40)
NAMES = ("WIND", "STEREO-A", "PSP")


def truth_s(frequency_mhz: np.ndarray, number: int) -> np.ndarray:
    """Times of a beam whose density waves, and of the light from it to three spacecraft."""
    emitted = 500.0 * frequency_mhz**-0.85 * (1.0 + 0.03 * np.sin(4.0 * np.log(frequency_mhz)))
    return emitted + (100.0, 220.0, 30.0)[number] + (-0.08, 0.05, 0.02)[number] * emitted


def made(random: np.random.Generator, smooth: float = 0.0, factor: float = 1.0, sd_s: float = 0.5) -> Timed:
    """Arrival times with a smooth error in rise times of 30 s / f; channels err more than stated by a factor."""
    rise = 30.0 / FREQUENCY_MHZ
    apart = np.subtract.outer(np.log(FREQUENCY_MHZ), np.log(FREQUENCY_MHZ))
    root = np.linalg.cholesky(np.exp(-0.5 * (apart / 0.2) ** 2) + 1e-8 * np.eye(rise.size))
    times = [
        truth_s(FREQUENCY_MHZ, number)
        + smooth * rise * (root @ random.normal(size=rise.size))
        + factor * sd_s * random.normal(size=rise.size)
        for number in range(3)
    ]
    every = 3 * rise.size
    return Timed(
        np.repeat(np.array(NAMES, dtype=object), rise.size),
        np.tile(FREQUENCY_MHZ, 3),
        np.concatenate(times),
        np.tile(rise, 3),
        np.full(every, sd_s),
        np.zeros((every, 0)),
        np.full(every, 0.2),
        np.zeros(every),
    )


@pytest.mark.parametrize(("smooth", "factor"), [(0.0, 1.0), (0.15, 1.0), (0.0, 4.0), (0.15, 4.0)])
def test_noise_is_found_as_large_as_it_is(smooth: float, factor: float) -> None:
    found = [estimate_noise(made(np.random.default_rng(seed), smooth, factor)) for seed in range(4)]
    assert np.median([one.shape_share for one in found]) == pytest.approx(smooth, abs=0.025 + 0.3 * smooth)
    assert np.median([one.channel_sd_s for one in found]) == pytest.approx(0.5 * factor, rel=0.25)


@pytest.mark.parametrize("wrong", [slice(30, 34), slice(33, 37)])
def test_channels_wrong_side_by_side_are_their_own_error_and_not_of_all(wrong: slice) -> None:
    timed = made(np.random.default_rng(5), sd_s=0.5)
    right = estimate_noise(timed)
    off_s = np.array([8.0, 12.0, 9.0, 14.0])
    timed.arrival_s[wrong] += off_s
    found = estimate_noise(timed)
    assert ((found.channel_sd_s[wrong] > 0.35 * off_s) & (found.channel_sd_s[wrong] < 0.7 * off_s)).all()
    others = np.ones(timed.arrival_s.size, dtype=bool)
    others[wrong] = False
    assert np.median(found.channel_sd_s[others] / right.channel_sd_s[others]) < 2.0
    assert found.shape_share < right.shape_share + 0.02


def test_large_errors_of_all_are_not_taken_for_those_of_many_channels() -> None:
    timed = made(np.random.default_rng(2), 0.3, 9.0)
    thin = timed.take(spread_channels(timed, MOST_FOR_NOISE))
    small, large = (_Misfit.of(thin).settled(start)[0].shape for start in STARTS)
    assert small < 0.2
    assert large == pytest.approx(0.3, abs=0.05)
    assert estimate_noise(timed).shape_share > 0.22


def test_channels_that_nothing_else_tells_of_are_widened_as_students_t_has_it() -> None:
    away_s, channel_s2 = np.array([0.0, 1.0, 3.0, 10.0]), np.array([1.0, 4.0, 1.0, 1.0])
    alone = _Misfit(away_s, np.zeros((4, 4)), np.zeros((4, 4)), channel_s2)
    expected = (4.0 + away_s**2 / channel_s2) / 5.0
    np.testing.assert_allclose(alone.widening(STARTS[0]._replace(factor=1.0), np.ones(4)), expected)


def test_no_time_is_known_better_than_the_table_states() -> None:
    found = estimate_noise(made(np.random.default_rng(10), sd_s=0.0))
    assert (found.channel_sd_s >= 0.5 * LEAST_SIGMA_S).all()
    assert (noise_columns(found)["sigma_s"] >= LEAST_SIGMA_S).all()
    assert np.median(found.channel_sd_s) < 0.25


def test_a_smooth_error_of_one_that_is_known_is_none_of_the_others() -> None:
    timed = made(np.random.default_rng(8), sd_s=0.5)
    own = timed.observatory == "STEREO-A"
    apart = np.subtract.outer(np.log(FREQUENCY_MHZ), np.log(FREQUENCY_MHZ))
    root = np.linalg.cholesky(np.exp(-0.5 * (apart / 0.2) ** 2) + 1e-8 * np.eye(FREQUENCY_MHZ.size))
    timed.arrival_s[own] += 6.0 * root @ np.random.default_rng(9).normal(size=FREQUENCY_MHZ.size)
    told = replace(timed, shape_sd_s=np.where(own, 6.0, 0.0))
    assert estimate_noise(timed).shape_sd_s[~own].min() > 1.0
    assert np.median(estimate_noise(told).shape_sd_s[~own]) < 0.6


def test_errors_of_channels_that_differ_keep_their_ratio() -> None:
    timed = made(np.random.default_rng(6), sd_s=0.5)
    sure = replace(timed, channel_sd_s=np.where(timed.observatory == "WIND", 2.0, 0.5))
    sure.arrival_s[sure.observatory == "WIND"] += 1.9 * np.random.default_rng(7).normal(size=FREQUENCY_MHZ.size)
    found = estimate_noise(sure)
    sd_s = {name: np.median(found.channel_sd_s[found.observatory == name]) for name in NAMES}
    assert sd_s["WIND"] == pytest.approx(2.0, rel=0.3)
    assert sd_s["PSP"] == pytest.approx(0.5, rel=0.3)


def test_times_between_channels_are_true_within_their_errors() -> None:
    away = []
    for seed in range(6):
        timed = estimate_noise(made(np.random.default_rng(seed), 0.1, 1.5))
        along = at_frequencies(timed, np.geomspace(0.25, 2.0, 15))
        columns = noise_columns(along)
        sigma = np.sqrt(columns["sigma_s"] ** 2 + columns["shape_sd_s"] ** 2 + columns["offset_sd_s"] ** 2)
        true = np.concatenate(
            [truth_s(along.frequency_mhz[along.observatory == name], n) for n, name in enumerate(NAMES)]
        )
        away.append((along.arrival_s - true) / sigma)
    assert 0.7 < np.sqrt(np.mean(np.square(away))) < 1.3


def test_a_table_is_surer_than_its_channels_but_not_of_what_they_share() -> None:
    timed = estimate_noise(made(np.random.default_rng(3), 0.1, sd_s=4.0))
    along = noise_columns(at_frequencies(timed, FREQUENCY_MHZ[5:-5]))
    channels = noise_columns(timed.take(np.flatnonzero(np.isin(timed.frequency_mhz, FREQUENCY_MHZ[5:-5]))))
    assert (along["sigma_s"] < 0.8 * channels["sigma_s"]).all()
    # what the process leaves uncertain is smooth as well, and adds to what spacecraft do not share
    assert (along["shape_sd_s"] >= channels["shape_sd_s"] * (1 - 1e-6)).all()
    assert (along["shape_sd_s"] ** 2 - channels["shape_sd_s"] ** 2 < channels["sigma_s"] ** 2).all()


def test_errors_grow_towards_low_frequencies_but_less_than_the_rise() -> None:
    timed = estimate_noise(made(np.random.default_rng(3), 0.1))
    columns = noise_columns(timed.take(np.flatnonzero(timed.observatory == "WIND")))
    assert (np.diff(columns["shape_sd_s"]) < 0).all()
    share = columns["shape_sd_s"] / columns["rise_s"]  # the rise is 12 times as long at the lowest frequency
    assert 0.35 < share[0] / share[-1] < 0.75


@pytest.mark.parametrize(("ratio", "is_filled"), [(1.6, True), (3.0, False)])
def test_holes_that_are_too_wide_are_left_empty(ratio: float, is_filled: bool) -> None:
    every = estimate_noise(made(np.random.default_rng(4)))
    inside = np.abs(np.log(every.frequency_mhz / 0.7)) < 0.5 * np.log(ratio)
    along = at_frequencies(every.take(np.flatnonzero(~inside | (every.observatory != "PSP"))), FREQUENCY_MHZ)
    given = {name: set(along.frequency_mhz[along.observatory == name]) for name in NAMES}
    assert given["WIND"] == set(FREQUENCY_MHZ)
    assert (given["PSP"] == given["WIND"]) == is_filled
    assert given["WIND"] - given["PSP"] <= set(every.frequency_mhz[inside])


@pytest.mark.parametrize(("away_sd", "kept"), [(OUTLIER_SD - 2.0, True), (OUTLIER_SD + 3.0, False)])
def test_only_channels_far_from_the_others_are_outliers(away_sd: float, kept: bool) -> None:
    timed = made(np.random.default_rng(1), sd_s=2.0)
    timed.arrival_s[20] = truth_s(FREQUENCY_MHZ[20:21], 0)[0] + away_sd * np.sqrt(
        2.0**2 + (0.06 * timed.rise_s[20]) ** 2
    )
    wrong = outliers(timed)
    assert wrong[20] != kept
    assert wrong.sum() <= 2


def test_errors_that_all_share_cancel_in_differences_of_any_number() -> None:
    one = made(np.random.default_rng(2))
    same = np.ones((one.arrival_s.size, 1)) * 5.0
    own = 5.0 * np.array([[name == other for other in NAMES] for name in one.observatory], dtype=float)
    for number in (2, 3):
        rows = np.flatnonzero(np.isin(one.observatory, NAMES[:number]))
        shared = noise_columns(Timed(**{**vars(one), "shared_s": same}).take(rows))["shape_sd_s"]
        alone = noise_columns(Timed(**{**vars(one), "shared_s": own}).take(rows))["shape_sd_s"]
        np.testing.assert_allclose(shared, 0.0, atol=1e-9)
        np.testing.assert_allclose(alone, 5.0)


def sharing(frequencies: int, covariance_s2: np.ndarray) -> Timed:
    """Times of as many spacecraft as the covariance has, whose errors at every frequency have it."""
    names = ("A", "B", "C", "D")[: len(covariance_s2)]
    of = np.repeat(np.array(names, dtype=object), frequencies)
    every = np.zeros(of.size)
    frequency = np.tile(np.geomspace(0.3, 2.0, frequencies), len(names))
    correlated = np.kron(covariance_s2, np.eye(frequencies))
    return Timed(of, frequency, every, every + 30, every + 0.05, np.zeros((of.size, 0)), every, every, 0.0, correlated)


def total_s2(rows: Timed) -> np.ndarray:
    """Variance that the columns of an arrival table give each row."""
    columns = noise_columns(rows)
    return columns["sigma_s"] ** 2 + columns["shape_sd_s"] ** 2 - 0.05**2


def test_variances_of_three_spacecraft_add_up_to_those_of_their_differences() -> None:
    covariance = np.array([[9.0, 3.0, 1.0], [3.0, 4.0, 0.5], [1.0, 0.5, 16.0]])
    variance = total_s2(sharing(5, covariance)).reshape(3, 5)
    for one, other in ((0, 1), (0, 2), (1, 2)):
        apart = covariance[one, one] + covariance[other, other] - 2 * covariance[one, other]
        np.testing.assert_allclose(variance[one] + variance[other], apart)


@pytest.mark.parametrize("number", [2, 4])
def test_variances_of_other_numbers_are_those_without_what_all_share(number: int) -> None:
    own = np.array([1.0, 4.0, 9.0, 16.0])[:number]
    variance = total_s2(sharing(5, np.diag(own) + 100.0)).reshape(number, 5)
    expected = own if number > 2 else np.full(2, own.mean())
    np.testing.assert_allclose(variance, np.repeat(expected[:, None], 5, axis=1))


def test_a_time_that_one_spacecraft_alone_has_keeps_its_variance() -> None:
    rows = sharing(5, np.diag([1.0, 4.0]) + 100.0)
    kept = np.flatnonzero((rows.observatory == "A") | (rows.frequency_mhz < 1.0))
    few = replace(rows.take(kept), correlated_s2=rows.correlated_s2[np.ix_(kept, kept)])
    alone = (few.observatory == "A") & (few.frequency_mhz > 1.0)
    np.testing.assert_allclose(total_s2(few)[alone], 101.0)
    np.testing.assert_allclose(total_s2(few)[~alone], 2.5)


def test_errors_that_last_along_the_band_are_an_offset_and_what_grows_beyond_it_smooth() -> None:
    own, growing = np.array([1.0, 4.0, 9.0]), np.linspace(1.0, 2.0, 6)
    rows = replace(sharing(6, np.diag(own)), correlated_s2=np.kron(np.diag(own), np.outer(growing, growing)))
    columns = noise_columns(rows)
    variance = np.outer(own, growing**2)
    offset_s2 = columns["offset_sd_s"].reshape(3, 6) ** 2
    np.testing.assert_allclose(offset_s2, np.repeat(variance.mean(axis=1, keepdims=True), 6, axis=1), rtol=0.01)
    beyond = np.maximum(variance - variance.mean(axis=1, keepdims=True), 0.0)
    np.testing.assert_allclose(columns["shape_sd_s"].reshape(3, 6) ** 2, beyond, rtol=0.02, atol=0.02)


def test_errors_smoother_than_a_table_can_say_do_not_grow() -> None:
    own, rows = np.array([1.0, 4.0, 9.0]), sharing(6, np.eye(3))
    log_f = np.log(rows.frequency_mhz[:6])
    smoother = np.exp(-0.5 * (np.subtract.outer(log_f, log_f) / 0.5) ** 2)
    columns = noise_columns(replace(rows, correlated_s2=np.kron(np.diag(own), smoother)))
    variance = sum(columns[name] ** 2 for name in ("sigma_s", "shape_sd_s", "offset_sd_s"))
    np.testing.assert_allclose(variance - 0.05**2, np.repeat(own, 6), rtol=0.01)


def test_times_between_sure_channels_are_sure_as_well() -> None:
    rows = at_frequencies(estimate_noise(made(np.random.default_rng(5), sd_s=0.05)), FREQUENCY_MHZ[5:-5])
    assert np.median(noise_columns(rows)["sigma_s"]) < 0.2


def test_what_all_spacecraft_tell_makes_differences_between_channels_sharper() -> None:
    frequency = np.geomspace(0.25, 2.0, 15)
    off = []
    for seed in range(4):
        rows = at_frequencies(estimate_noise(made(np.random.default_rng(seed), sd_s=2.0)), frequency)
        wrong = rows.arrival_s.reshape(3, -1) - [truth_s(frequency, number) for number in range(3)]
        off.append(wrong[1] - wrong[0])
        np.linalg.cholesky(rows.covariance_s2())
    # a channel alone has 2.8 s; the ends of the band, where less is known, are among them
    assert np.sqrt(np.mean(np.square(off))) < 1.1


def test_a_smooth_error_is_followed_and_stated_rather_than_taken_away() -> None:
    timed = made(np.random.default_rng(3), sd_s=0.3)
    bump = 8.0 * np.exp(-0.5 * (np.log(timed.frequency_mhz / 0.7) / 0.2) ** 2) * (timed.observatory == "PSP")
    known = replace(timed, arrival_s=timed.arrival_s + bump, shape_sd_s=np.full(bump.size, 5.0))
    rows = at_frequencies(known, FREQUENCY_MHZ[5:-5])
    own = rows.observatory == "PSP"
    expected = truth_s(rows.frequency_mhz[own], 2) + 8.0 * np.exp(
        -0.5 * (np.log(rows.frequency_mhz[own] / 0.7) / 0.2) ** 2
    )
    assert np.abs(rows.arrival_s[own] - expected).max() < 1.0
    assert (noise_columns(rows)["shape_sd_s"][own] >= 5.0).all()


def test_a_time_in_a_hole_is_as_uncertain_as_densities_wave() -> None:
    inside, pull = np.array([0.5]), []
    for seed in range(8):
        timed = made(np.random.default_rng(seed), sd_s=0.3)
        beside = np.abs(np.log(timed.frequency_mhz / inside)) > 0.22
        row = at_frequencies(timed.take(np.flatnonzero((timed.observatory == "WIND") & beside)), inside)
        sigma_s = noise_columns(row)["sigma_s"]
        assert 1.0 < sigma_s < 2.2  # ten times the waves that are expected give 2.9, a tenth 0.8
        pull.append((row.arrival_s - truth_s(inside, 0)) / sigma_s)
    assert 0.6 < np.sqrt(np.mean(np.square(pull))) < 1.6


def test_thick_sets_of_channels_are_thinned() -> None:
    one = made(np.random.default_rng(2))
    assert len(spread_channels(one, 10)) == 30


def stretched(timed: Timed, factors: tuple[float, ...], tilt: float = 0.0) -> Timed:
    """The same with rises that differ between spacecraft, and whose difference changes by `tilt` per ln f."""
    ln_factor = np.array([np.log(factors[NAMES.index(name)]) for name in timed.observatory])
    sign = np.array([NAMES.index(name) - 1 for name in timed.observatory])
    away = np.log(timed.frequency_mhz) - np.log(timed.frequency_mhz).mean()
    return replace(timed, rise_s=timed.rise_s * np.exp(ln_factor + tilt * sign * away))


def test_the_spread_of_widths_is_that_between_spacecraft() -> None:
    one = made(np.random.default_rng(4))
    assert width_spread(one) == pytest.approx(0.0, abs=1e-9)
    factors = (1.28, 0.77, 1.0)
    assert width_spread(stretched(one, factors)) == pytest.approx(np.std(np.log(factors), ddof=1))
    # of slopes -1, 0 and 1 the deviation is the distance from the middle of the band
    along = np.linspace(-0.5, 0.5, 9) * np.ptp(np.log(FREQUENCY_MHZ))
    assert width_spread(stretched(one, (1, 1, 1), 0.2)) == pytest.approx(0.2 * np.sqrt(np.mean(along**2)))
    assert width_spread(one.take(np.flatnonzero(one.observatory == "PSP"))) == 0.0


def test_light_curves_of_other_widths_make_errors_that_last_along_the_band() -> None:
    timed = estimate_noise(stretched(made(np.random.default_rng(4)), (1.28, 0.77, 1.0)))
    # a fifth of the spread: measured, as the constant says
    assert timed.width_share == pytest.approx(0.2 * np.std(np.log((1.28, 0.77, 1.0)), ddof=1))
    for rows in (timed, at_frequencies(timed, FREQUENCY_MHZ[5:-5])):
        np.testing.assert_allclose(noise_columns(rows)["delay_sd_s"], timed.width_share * rows.rise_s)

"""Pulses of shapes that the fit does not have, as four receivers see them, are timed alike by all."""

from collections.abc import Callable

import numpy as np
import pytest

from bella.bursts.light_curves import LightCurves, first_guess, fitted_samples, own_rise
from bella.bursts.shared_profile import _Fit, collapsed_samples, fit_profile
from bella.exceptions import NoDataError

RECEIVERS = {"WIND": (60.0, 60.0), "STEREO-A": (38.0, 30.0), "SOLO": (17.0, 4.0), "PSP": (7.0, 7.0)}
"""Cadence and integration time, s."""

FREQUENCY_MHZ = np.geomspace(0.3, 2.0, 16)
Pulse = Callable[[np.ndarray], np.ndarray]


def norris(x: np.ndarray) -> np.ndarray:
    late = np.maximum(x + 4.0, 1e-9)
    return np.where(x > -4.0, np.exp(8.0 - 16.0 / late / 1.0 - late / 1.0), 0.0)


def logistic(x: np.ndarray) -> np.ndarray:
    return 1.0 / (np.exp(-1.5 * x) + np.exp(x / 2.5))


def gamma(x: np.ndarray) -> np.ndarray:
    late = np.maximum(x + 3.0, 0.0)
    return late**2.2 * np.exp(-0.7 * late)


def light(
    name: str,
    pulse: Pulse,
    late_s: float,
    seed: int,
    *,
    width: float = 1.0,
    bump_s: float = 0.0,
    fall: tuple[float, float] = (1.0, 0.0),
) -> tuple[LightCurves, np.ndarray]:
    """Light curves of a spacecraft with noise of 4 %, and when they rise to half of their maximum.

    Those between 0.5 and 1 MHz come later by `bump_s`. All fall faster by the first of `fall`, with its power of
    frequency.
    """
    cadence, integration = RECEIVERS[name]
    random = np.random.default_rng(seed)
    fine = np.linspace(-15.0, 60.0, 15001)
    height = pulse(fine)
    top = int(height.argmax())
    half = float(np.interp(0.5 * height[top], height[: top + 1], fine[: top + 1]))
    faster = np.maximum(fine - fine[top], 0.0)[:, None] * (fall[0] * FREQUENCY_MHZ ** fall[1] - 1.0)
    each = pulse(fine[:, None] + faster)
    running = np.cumsum(0.5 * (each[1:] + each[:-1]) * np.diff(fine)[:, None], axis=0) / height[top]
    scale = width * 15.0 * FREQUENCY_MHZ**-0.9
    arrival = 900.0 + 260.0 * FREQUENCY_MHZ**-0.9 + late_s * (1.0 + 0.2 * np.log(FREQUENCY_MHZ))
    arrival += bump_s * (np.abs(np.log(FREQUENCY_MHZ / 0.7)) < 0.35)
    middle = random.uniform(0.0, cadence) + cadence * np.arange(int(3600 / cadence))
    low, high = ((middle[:, None] + side * integration / 2 - arrival) / scale + half for side in (-1.0, 1.0))
    until = [
        [np.interp(ends[:, n], fine[1:], running[:, n]) for n in range(FREQUENCY_MHZ.size)] for ends in (low, high)
    ]
    mean = np.subtract(until[1], until[0]).T / (high - low)
    power = (1.0 + 60.0 * mean) * np.exp(0.04 * random.normal(size=mean.shape)) - 1.0
    shape = power.shape
    return (
        LightCurves(
            name,
            FREQUENCY_MHZ,
            np.broadcast_to(middle[:, None], shape),
            power,
            1.0,
            cadence,
            np.full(FREQUENCY_MHZ.size, integration),
            np.zeros(shape),
        ),
        arrival,
    )


def fleet(pulse: Pulse, seed: int = 1, bump_s: float = 0.0) -> tuple[list[LightCurves], np.ndarray]:
    pairs = [
        light(name, pulse, late, seed + n, bump_s=bump_s)
        for n, (name, late) in enumerate(zip(RECEIVERS, (0, 90, -60, 30), strict=True))
    ]
    return [one for one, _ in pairs], np.concatenate([arrival for _, arrival in pairs])


def test_times_that_no_smooth_curve_follows_are_found_in_every_channel() -> None:
    lights, arrival = fleet(norris, bump_s=-200.0)
    fit = fit_profile(lights)
    timed = fit.flag == ""
    late = np.abs(np.log(fit.frequency_mhz / 0.7)) < 0.35
    assert (timed & late).sum() >= 0.8 * late.sum()
    off = fit.arrival_s - arrival
    assert np.abs(off[timed] - np.median(off[timed])).max() < 20.0


def test_a_channel_with_a_wrong_half_maximum_starts_where_the_others_say() -> None:
    one, arrival = light("PSP", norris, 0.0, 3)
    wrong = 7
    one.power[:, wrong] = np.roll(one.power[:, wrong], -100)  # 700 s too early
    start = first_guess(one, own_rise([one]))
    assert abs(start.half_s[wrong] - arrival[wrong]) > 600.0
    assert np.abs(start.curve_s - arrival).max() < 30.0


@pytest.mark.parametrize("pulse", [norris, logistic, gamma])
def test_differences_are_those_of_the_half_rises_within_their_errors(pulse: Pulse) -> None:
    lights, arrival = fleet(pulse)
    fit = fit_profile(lights)
    off = (fit.arrival_s - arrival).reshape(4, -1)
    covariance = np.diag(fit.independent_sd_s**2) + fit.shared_s @ fit.shared_s.T
    pulls = []
    for one in range(4):
        for other in range(one):
            difference = off[one] - off[other]
            assert abs(difference.mean()) < 1.0
            assert np.abs(difference).max() < 10.0
            first, second = (np.arange(16) + 16 * which for which in (one, other))
            variance = covariance[first, first] + covariance[second, second] - 2 * covariance[first, second]
            pulls.append(difference / np.sqrt(variance))
    assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.7


def test_the_time_does_not_depend_on_the_strength_or_the_zero_of_time() -> None:
    lights, _ = fleet(gamma)
    moved = [
        LightCurves(**{**vars(one), "time_s": one.time_s + 1234.5, "power": one.power * 7.0, "background": 7.0})
        for one in lights
    ]
    np.testing.assert_allclose(fit_profile(moved).arrival_s - 1234.5, fit_profile(lights).arrival_s, atol=0.05)


def test_wider_light_curves_of_one_spacecraft_are_not_late() -> None:
    pairs = [light(name, gamma, 0.0, 5 + n, width=1.2 if name == "PSP" else 1.0) for n, name in enumerate(RECEIVERS)]
    fit = fit_profile([one for one, _ in pairs])
    off = (fit.arrival_s - np.concatenate([arrival for _, arrival in pairs])).reshape(4, -1).mean(axis=1)
    assert fit.width_factor["PSP"] / fit.width_factor["SOLO"] == pytest.approx(1.2, abs=0.06)
    assert np.ptp(off) < 1.5


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_light_curves_that_fall_faster_at_one_spacecraft_are_not_early(tilt: float) -> None:
    falls = {"WIND": (1.4, tilt), "STEREO-A": (0.7, -tilt), "SOLO": (0.7, tilt), "PSP": (1.4, -tilt)}
    pairs = [light(name, gamma, 0.0, 5 + n, fall=falls[name]) for n, name in enumerate(RECEIVERS)]
    arrival = np.concatenate([arrival for _, arrival in pairs])
    off = (fit_profile([one for one, _ in pairs]).arrival_s - arrival).reshape(4, -1)
    apart = off - off.mean(axis=0)
    assert np.abs(apart.mean(axis=1)).max() < 0.5
    assert np.sqrt(np.mean(apart**2)) < 1.1


def fit_of(lights: list[LightCurves]) -> _Fit:
    rises = own_rise(lights)
    crafts = [fitted_samples(one, first_guess(one, rises), n) for n, one in enumerate(lights)]
    return _Fit([one for one in crafts if one is not None])


def test_the_gradient_is_that_of_chi_squared() -> None:
    fit = fit_of(fleet(gamma)[0])
    fit.weigh(scaled=False)
    fit.value = fit.value + 0.1 * np.random.default_rng(3).normal(size=fit.value.size)
    for which in range(fit.value.size):
        step = 1e-4 * np.eye(fit.value.size)[which]
        slope = (fit.chi2(fit.value + step) - fit.chi2(fit.value - step)) / 2e-4
        assert fit.blocks()[1][which] == pytest.approx(-0.5 * slope, rel=0.02, abs=2.0), which


def test_how_fast_all_spacecraft_fall_is_a_matter_of_the_profile() -> None:
    fit = fit_of([light(name, gamma, 0.0, 5 + n, fall=(1.5, 0.0))[0] for n, name in enumerate(RECEIVERS)])
    fit.weigh(scaled=False)
    fit.descend(20)
    assert abs(fit.value[fit.fall_at : fit.fall_at + len(RECEIVERS)].mean()) < 0.02


def test_a_second_burst_in_the_decay_has_no_say() -> None:
    lights, arrival = fleet(gamma)
    for one in lights:
        later = np.interp(one.time_s, [0, 1], [0, 1])  # all times inside
        second = 40.0 * np.exp(-0.5 * ((later - arrival[:16] - 200.0 - 60.0 / FREQUENCY_MHZ) / 25.0) ** 2)
        one.power[...] += second
    off = (fit_profile(lights).arrival_s - arrival).reshape(4, -1)
    assert np.abs((off - off.mean(axis=0)).mean(axis=1)).max() < 2.0


def test_flat_tops_and_gaps_are_refused_by_channel() -> None:
    lights, arrival = fleet(gamma)
    lights[3].power[:, 2] = np.minimum(lights[3].power[:, 2], 20.0)
    flank = np.abs(lights[2].time_s[:, 4] - arrival[2 * 16 + 4]) < 30.0
    lights[2].power[flank, 4] = np.nan
    flag = fit_profile(lights).flag.reshape(4, -1)
    assert (flag[3, 2], flag[2, 4]) == ("saturated", "gap_in_flank")
    assert (flag == "").sum() == 62


def test_fewer_than_three_spacecraft_share_no_profile() -> None:
    lights, _ = fleet(gamma)
    with pytest.raises(NoDataError, match="three spacecraft"):
        fit_profile(lights[:2])


def test_the_rise_is_that_of_the_burst() -> None:
    lights, _ = fleet(gamma)
    fine = np.linspace(-3.0, 10.0, 10001)
    height = gamma(fine)
    width = fine[height.argmax()] - fine[(height > 0.5 * height.max()).argmax()]
    true = 15.0 * width * FREQUENCY_MHZ**-0.9
    np.testing.assert_allclose(own_rise(lights).rise_s(FREQUENCY_MHZ), true, rtol=0.4)
    np.testing.assert_allclose(fit_profile(lights).rise_s.reshape(4, -1)[3], true, rtol=0.25)


def test_collapsed_light_curves_lie_on_the_profile() -> None:
    samples = collapsed_samples(fit_profile(fleet(gamma)[0]).collapsed)
    assert set(samples["observatory"]) == set(RECEIVERS)
    assert (samples["height"] - samples["fitted"]).abs().median() < 0.03

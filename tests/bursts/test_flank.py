from typing import NamedTuple

import numpy as np
import pytest

from bella.bursts.edges import Edge, half_maximum_edge
from bella.bursts.flank import SampleAveraging, flank_edges
from bella.bursts.light_curves import RiseOfBurst, decay_s
from bella.simulation.light_curves import Pulses, pulses
from benchmarks.edges import INTEGRATION_S, Case, by_flank, simulated, timing

SHORT = RiseOfBurst(-0.4, 0.3)
"""Of bursts that rise faster than those that rises are known of."""


RECEIVERS = {"60 s": (60.0, 60.0), "38 s": (38.0, 2.0), "17 s": (17.0, 2.0), "7 s": (7.0, 7.0)}
"""Cadence and integration time, s."""


def light_curve(frequency_mhz: float, rise: float = 1.0, decay: float = 1.0) -> Pulses:
    """A Gaussian rise smeared by an exponential decay, with its half-rise at 0."""
    rise_s, decay_time_s = 21.0 * frequency_mhz**-0.77, 75.0 * frequency_mhz**-0.97
    return pulses("emg", np.array([rise * rise_s]), np.array([decay * decay_time_s]))


def flank_edge(
    time_s: np.ndarray, power: np.ndarray, cadence_s: float, frequency_mhz: float, integration_s: float
) -> Edge:
    return flank_edges(time_s, power[:, None], cadence_s, np.array([frequency_mhz]), integration_s, rises=SHORT)[0]


def observed(
    frequency_mhz: float, receiver: str, random: np.random.Generator, second_s: float = np.inf
) -> tuple[np.ndarray, np.ndarray]:
    """A burst of ten times the background whose half-rise is at 0, and perhaps another in its decay."""
    cadence, integration = RECEIVERS[receiver]
    time = np.arange(-1200.0, 1500.0, cadence) + random.uniform(0, cadence)
    low, high = time - integration / 2, time + integration / 2
    power = 10 * light_curve(frequency_mhz).mean(0, low, high)
    if np.isfinite(second_s):
        power += 7 * light_curve(frequency_mhz).mean(0, low - second_s, high - second_s)
    return time, (1 + power) * (1 + 0.05 * random.standard_normal(time.size)) - 1


@pytest.mark.parametrize("receiver", RECEIVERS)
@pytest.mark.parametrize("frequency_mhz", [0.3, 1.0])
def test_half_rise_is_timed_far_below_the_cadence(frequency_mhz: float, receiver: str) -> None:
    random, (cadence, integration) = np.random.default_rng(11), RECEIVERS[receiver]
    curves = [observed(frequency_mhz, receiver, random) for _ in range(25)]
    edges = [flank_edge(time, power, cadence, frequency_mhz, integration) for time, power in curves]

    off = np.array([edge.arrival_s for edge in edges])
    pull = off / [edge.sigma_s for edge in edges]
    assert abs(np.median(off)) < 3
    assert 0.5 * np.subtract(*np.quantile(off, [0.84, 0.16])) < 5
    assert np.abs(off).max() < 30
    assert 0.4 < np.sqrt(np.mean(pull**2)) < 2.2


def test_a_lower_second_burst_in_the_decay_has_no_say() -> None:
    random = np.random.default_rng(12)
    gaps = random.uniform(2.0, 3.0, 20) * decay_s(0.3)
    curves = [observed(0.3, "38 s", random, second_s=gap) for gap in gaps]

    off = [flank_edge(time, power, 38.0, 0.3, 2.0).arrival_s for time, power in curves]

    assert np.abs(off).max() < 15
    assert abs(np.median(off)) < 3


def test_nearer_than_the_half_maximum_where_minutes_cut_the_flank() -> None:
    random = np.random.default_rng(13)
    curves = [observed(1.0, "60 s", random) for _ in range(25)]

    flank = np.array([flank_edge(time, power, 60.0, 1.0, 60.0).arrival_s for time, power in curves])
    half = np.array([half_maximum_edge(time, power, 60.0).arrival_s for time, power in curves])

    assert np.sqrt(np.mean(flank**2)) < 0.5 * np.sqrt(np.mean(half**2))


def test_shift_and_gain_move_only_what_they_should() -> None:
    time, power = observed(0.5, "38 s", np.random.default_rng(14))
    edge = flank_edge(time, power, 38.0, 0.5, 2.0)

    later = flank_edge(time + 12_345.6, power, 38.0, 0.5, 2.0)
    louder = flank_edge(time, 10 * power, 38.0, 0.5, 2.0)

    assert later.arrival_s == pytest.approx(edge.arrival_s + 12_345.6, abs=1e-4)
    assert (louder.arrival_s, louder.sigma_s) == pytest.approx((edge.arrival_s, edge.sigma_s), abs=1e-6)


def test_more_noise_is_a_larger_error() -> None:
    random, quiet_s, noisy_s = np.random.default_rng(15), [], []
    for _ in range(12):
        time, power = observed(0.5, "17 s", random)
        noisy = power + 1.0 * random.standard_normal(time.size)
        quiet_s.append(flank_edge(time, power, 17.0, 0.5, 2.0).sigma_s)
        noisy_s.append(flank_edge(time, noisy, 17.0, 0.5, 2.0).sigma_s)

    assert np.isnan(noisy_s).sum() <= 2  # noise on the flank misleads the half-maximum, which is then noticed
    assert np.nanmedian(noisy_s) > 1.5 * np.median(quiet_s)


def test_missing_samples_far_from_the_flank_change_little_and_on_it_refuse() -> None:
    time, power = observed(0.5, "38 s", np.random.default_rng(17))
    whole = flank_edge(time, power, 38.0, 0.5, 2.0)
    after, across = power.copy(), power.copy()
    after[time > 400] = np.nan
    across[(time > -90) & (time < 60)] = np.nan

    assert flank_edge(time, after, 38.0, 0.5, 2.0) == pytest.approx(whole, abs=1e-6)
    assert flank_edge(time, across, 38.0, 0.5, 2.0).flag != ""


@pytest.mark.parametrize(
    ("power", "reason"),
    [
        (np.full(40, np.nan), "no_samples"),
        (np.r_[1.0, np.full(39, np.nan)], "no_samples"),
        (np.zeros(40), "no_signal"),
        (np.linspace(1, 0, 40), "no_flank"),
        (np.linspace(0, 1, 40), "no_decay"),
    ],
)
def test_light_curve_without_a_flank_says_why(power: np.ndarray, reason: str) -> None:
    edge = flank_edge(np.arange(40) * 60.0, power, 60.0, 0.5, 60.0)

    assert edge.flag == reason
    assert np.isnan(edge.arrival_s)


@pytest.mark.parametrize("cadence_s", INTEGRATION_S)
@pytest.mark.parametrize("second", [False, True], ids=["alone", "second"])
@pytest.mark.parametrize("contrast", [10.0, 30.0])
def test_sigma_is_that_of_bursts_unlike_the_fitted_ones(cadence_s: float, second: bool, contrast: float) -> None:
    """All families, rises and decays; a second burst may stand in the decay; 120 light curves of three frequencies.

    The stated errors are those of the samples alone, up to 2.5 times too small for families that the flank does not
    know: what light curves depart from its shapes is estimated for all channels of a burst together.
    """
    cases = [Case(frequency, cadence_s, second, contrast) for frequency in (0.3, 0.5, 1.0)]
    edges = [edge for case in cases for edge in by_flank(simulated(case, range(2000, 2040)), case)]
    found = timing(edges)

    assert abs(found.bias_s) < 3
    assert found.scatter_s < 7.5
    assert 0.75 < found.pull < 2.6
    assert found.outliers < 0.04
    assert found.refused < 0.2


class Minutes(NamedTuple):
    """Means of the visits that fall into a minute, at the mean times of these."""

    time_s: np.ndarray
    power: np.ndarray
    apart_s: np.ndarray
    """Between two visits of a minute, 0 where there is one."""


def minutes_of_visits(frequency_mhz: float, revisit_s: float, dwell_s: float, random: np.random.Generator) -> Minutes:
    """A burst whose half-rise is at 0, seen for `dwell_s` once in `revisit_s` and averaged by minute."""
    rise, decay = np.exp(random.normal(0.0, [0.3, 0.25]))
    begin = np.arange(-1800.0, 1500.0, revisit_s) + random.uniform(0.0, revisit_s)
    curve = light_curve(frequency_mhz, float(rise), float(decay))
    power = (1 + 15 * curve.mean(0, begin, begin + dwell_s)) * (1 + 0.05 * random.standard_normal(begin.size)) - 1
    middle = begin + 0.5 * dwell_s
    minute = np.floor((middle - begin[0] + random.uniform(0.0, 60.0)) / 60.0).astype(int)
    number = np.bincount(minute)
    held = np.flatnonzero(number)
    means = [np.bincount(minute, one)[held] / number[held] for one in (middle, power)]
    return Minutes(*means, np.where(number[held] > 1, revisit_s, 0.0))


def edges_of(curves: list[Minutes], frequency_mhz: float, averaging: list[SampleAveraging]) -> np.ndarray:
    """Error of every edge and in its sigmas, shape (2, N); edges that were refused left out."""
    edges = [
        flank_edges(one.time_s, one.power[:, None], 60.0, np.array([frequency_mhz]), of, rises=SHORT)[0]
        for one, of in zip(curves, averaging, strict=True)
    ]
    return np.array([(edge.arrival_s, edge.arrival_s / edge.sigma_s) for edge in edges if not edge.flag]).T


@pytest.mark.parametrize("frequency_mhz", [0.548, 0.916])
def test_minutes_with_two_visits_are_fitted_as_such(frequency_mhz: float) -> None:
    """As a third of those of Wind RAD1 from 428 kHz up."""
    random = np.random.default_rng(31)
    curves = [minutes_of_visits(frequency_mhz, 45.8, 2.86, random) for _ in range(60)]
    known = edges_of(curves, frequency_mhz, [SampleAveraging(2.86, one.apart_s[:, None]) for one in curves])
    taken_for_one = edges_of(curves, frequency_mhz, [SampleAveraging(2.86, 0.0)] * len(curves))

    assert known[0].std() < 0.85 * taken_for_one[0].std()
    assert abs(np.median(known[0])) < 2.0
    assert 0.6 < known[1].std() < 1.25
    assert known[1].std() < taken_for_one[1].std()
    assert known.shape[1] >= 0.95 * taken_for_one.shape[1]


def test_both_receivers_of_wind_time_a_burst_alike() -> None:
    """RAD1 by single visits and pairs of them, RAD2 by three or four snapshots a minute."""
    random = np.random.default_rng(32)
    rad1 = [minutes_of_visits(1.04, 45.8, 2.86, random) for _ in range(80)]
    rad2 = [minutes_of_visits(1.075, 16.192, 0.06, random) for _ in range(80)]
    early = edges_of(rad1, 1.04, [SampleAveraging(2.86, one.apart_s[:, None]) for one in rad1])
    late = edges_of(rad2, 1.075, [SampleAveraging(60.0, 0.0)] * len(rad2))

    assert abs(np.median(early[0]) - np.median(late[0])) < 2.0
    assert late[1].std() < 1.4

import math

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from bella.bursts import spectrum_edges
from bella.bursts.edges import cut_off_with_others, half_maximum_edge

TIME_S = np.arange(0.0, 1200.0, 40.0)
RISE_S, DECAY_S = 60.0, 150.0


def burst(time_s: np.ndarray, peak_s: float) -> np.ndarray:
    """Gaussian rise of half width RISE_S, exponential decay."""
    since = time_s - peak_s
    return np.where(since < 0.0, 0.5 ** ((since / RISE_S) ** 2), np.exp(-np.clip(since, 0.0, None) / DECAY_S))


def test_a_straight_flank_is_crossed_where_it_should_be() -> None:
    edge = half_maximum_edge(np.arange(6.0) * 10.0, np.array([0.0, 0.0, 2.0, 6.0, 10.0, 3.0]), 10.0)

    assert edge.arrival_s == pytest.approx(27.5)
    assert edge.flag == ""


def test_a_well_sampled_burst_is_timed_at_its_half_width() -> None:
    time_s = np.arange(0.0, 1200.0, 2.0)

    edge = half_maximum_edge(time_s, burst(time_s, 500.0), 2.0)

    assert edge.arrival_s == pytest.approx(500.0 - RISE_S, abs=0.1)


@given(peak_s=st.floats(300.0, 700.0), scale=st.floats(1e-20, 1e20))
@settings(max_examples=100, deadline=None)
def test_the_edge_moves_with_the_burst_whatever_its_strength(peak_s: float, scale: float) -> None:
    edge = half_maximum_edge(TIME_S, scale * burst(TIME_S, peak_s), 40.0)

    assert edge.arrival_s == pytest.approx(peak_s - RISE_S, abs=15.0)


def test_sigma_covers_the_scatter_of_simulated_bursts() -> None:
    random = np.random.default_rng(20120607)
    pulls = []
    for peak_s in random.uniform(400.0, 600.0, 400):
        power = burst(TIME_S, peak_s) * random.normal(1.0, 0.05, TIME_S.size) + random.normal(0.0, 0.01, TIME_S.size)
        edge = half_maximum_edge(TIME_S, power, 40.0)
        pulls.append((edge.arrival_s - peak_s + RISE_S) / edge.sigma_s)

    assert 0.3 < np.std(pulls) < 1.2


def test_noise_widens_sigma() -> None:
    random = np.random.default_rng(7)
    noise = random.normal(0.0, 1.0, TIME_S.size)

    quiet, loud = (half_maximum_edge(TIME_S, burst(TIME_S, 700.0) + level * noise, 40.0) for level in (0.001, 0.1))

    assert loud.sigma_s > quiet.sigma_s


def test_a_steep_flank_is_as_uncertain_as_the_cadence_allows() -> None:
    edge = half_maximum_edge(np.arange(5.0) * 60.0, np.array([0.0, 0.0, 1.0, 0.3, 0.1]), 60.0)

    assert edge.sigma_s == pytest.approx(60.0 / math.sqrt(12.0), rel=0.02)


def test_an_earlier_spike_is_passed_over() -> None:
    power = burst(TIME_S, 600.0)
    power[3] = 0.9

    assert half_maximum_edge(TIME_S, power, 40.0).arrival_s == pytest.approx(540.0, abs=15.0)


@pytest.mark.parametrize(
    ("power", "reason"),
    [
        ([np.nan] * 6, "no_samples"),
        ([1.0, np.nan, np.nan, np.nan, np.nan, 2.0], "no_samples"),
        ([0.0] * 6, "no_signal"),
        ([-3.0, -1.0, -2.0, -3.0, -2.0, -4.0], "no_signal"),
        ([5.0, 4.0, 3.0, 2.0, 1.0, 0.0], "no_flank"),
        ([3.0, 4.0, 5.0, 2.0, 1.0, 0.0], "no_flank"),
        ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0], "no_decay"),
        ([0.0, 0.1, np.nan, np.nan, 1.0, 0.5], "gap_in_flank"),
    ],
)
def test_no_edge_comes_with_a_reason(power: list[float], reason: str) -> None:
    edge = half_maximum_edge(np.arange(6.0) * 60.0, np.array(power), 60.0)

    assert edge.flag == reason
    assert math.isnan(edge.arrival_s)
    assert math.isnan(edge.sigma_s)


def test_a_gap_away_from_the_flank_does_no_harm() -> None:
    power = burst(TIME_S, 500.0)
    whole = half_maximum_edge(TIME_S, power, 40.0)
    power[[1, 20, 21]] = np.nan

    assert half_maximum_edge(TIME_S, power, 40.0).arrival_s == whole.arrival_s


def spectrum() -> xr.Dataset:
    power = np.stack([burst(TIME_S, 600.0), np.zeros_like(TIME_S), burst(TIME_S, 500.0)], axis=-1)
    start = np.datetime64("2012-06-07T19:20:00", "ns")
    return xr.Dataset(
        {"intensity": (("time", "frequency"), np.sqrt(power).astype(np.float32))},
        coords={"time": start + (TIME_S * 1e9).astype("timedelta64[ns]"), "frequency": [0.5, 1.0, 1.5]},
        attrs={
            "observatory": "WIND",
            "receiver": "RAD1",
            "quantity": "voltage_ratio",
            "integration_s": 40.0,
            "source_files": "",
        },
    )


def test_a_spectrum_is_timed_channel_by_channel_in_power() -> None:
    edges = spectrum_edges(spectrum(), "half_maximum")

    assert edges["frequency_mhz"].tolist() == [0.5, 1.0, 1.5]
    assert edges["flag"].tolist() == ["", "no_signal", ""]
    assert edges["arrival_utc"].isna().tolist() == [False, True, False]
    assert edges["arrival_utc"].dtype == "datetime64[ns]"
    assert abs(edges["arrival_utc"][0] - np.datetime64("2012-06-07T19:29:00")).total_seconds() < 15.0
    assert set(edges["observatory"]) == {"WIND"}


def test_the_sweep_is_taken_into_account() -> None:
    swept = spectrum_edges(spectrum().assign(sample_offset_s=("frequency", [0.0, 0.0, 12.5])), "half_maximum")
    plain = spectrum_edges(spectrum(), "half_maximum")

    delay = (swept["arrival_utc"] - plain["arrival_utc"]).dt.total_seconds()
    assert delay.tolist()[::2] == pytest.approx([0.0, 12.5], abs=1e-6)


@pytest.mark.parametrize("kind", [bool, np.int8])
def test_channels_that_were_not_measured_are_left_out(kind: type) -> None:
    marked = spectrum().assign(interpolated=("frequency", np.array([0, 1, 1], dtype=kind)))

    assert spectrum_edges(marked, "half_maximum")["frequency_mhz"].tolist() == [0.5]


def flags(cut_off: np.ndarray) -> np.ndarray:
    return np.where(cut_off, "saturated", "").astype(object)


def test_neighbours_of_cut_off_channels_are_cut_off_at_the_same_level_only() -> None:
    frequency, many = np.array([0.2, 0.9, 1.0, 1.1, 1.2, 1.3]), np.full(6, 5.0)
    highest = np.array([100.0, 101.0, 100.0, 99.0, 70.0, 98.0])
    power = highest * np.array([[0.1], [1.0], [0.3]])
    power[0, 0] = np.nan
    cut_off = np.array([False, True, True, True, False, False])
    found = cut_off_with_others(frequency, power, many, flags(cut_off))
    assert found.tolist() == [False, True, True, True, False, True]
    few = cut_off & (frequency != 1.0)
    assert (cut_off_with_others(frequency, power, many, flags(few)) == few).all()


@pytest.mark.parametrize(("pairs", "is_cut_off"), [(4, False), (5, True)])
def test_short_channels_are_cut_off_where_most_that_can_tell_are(pairs: int, is_cut_off: bool) -> None:
    frequency, samples_on_rise = np.geomspace(0.2, 2.0, 11), np.array([0.5, *np.linspace(0.85, 1.95, 9), 2.5])
    power, whole = np.tile([[0.1], [0.6], [1.0], [0.8], [0.2]], 11), flags(np.zeros(11, dtype=bool))
    power[3, 1 : 1 + pairs] = 1.0
    found = cut_off_with_others(frequency, power, samples_on_rise, whole)
    assert found.tolist() == [is_cut_off] * 10 + [False]
    power[3] *= 0.99
    assert not cut_off_with_others(frequency, power, samples_on_rise, whole).any()


def test_short_channels_are_judged_by_those_nearest_in_frequency() -> None:
    pairs = [1, 1, 1, 0, 1, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0]
    power = np.tile([[0.1], [0.6], [1.0], [0.8], [0.2]], len(pairs))
    power[3, np.array(pairs) == 1] = 1.0
    power *= 0.8 ** np.arange(len(pairs))  # none at the level of another
    samples_on_rise = np.where(np.arange(len(pairs)) == 1, 0.3, 1.0)  # too short to tell anything itself
    found = cut_off_with_others(
        np.geomspace(0.2, 2.0, len(pairs)), power, samples_on_rise, flags(np.zeros(len(pairs), dtype=bool))
    )
    assert found.tolist() == [True] * 8 + [False] * 12


@pytest.mark.parametrize(
    ("one", "last", "cut"),
    [(0.9, 1.9, [True] * 6), (0.7, 1.9, [False] * 6), (0.9, 2.1, [True] * 5 + [False])],
)
def test_who_can_tell_of_being_cut_off_and_who_cannot(one: float, last: float, cut: list[bool]) -> None:
    power = np.tile([[0.1], [0.6], [1.0], [1.0], [0.2]], 6) * 0.8 ** np.arange(6)
    power[3, 5] *= 0.8
    samples_on_rise = np.array([one, 1.0, 1.0, 1.0, 1.0, last])
    whole = flags(np.zeros(6, dtype=bool))
    assert cut_off_with_others(np.geomspace(0.2, 2.0, 6), power, samples_on_rise, whole).tolist() == cut

"""What may be done to a spectrum without moving its edges, or moving them as it should."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from bella.bursts import spectrum_edges
from bella.bursts.flank import flank_edges
from bella.exceptions import InputError
from bella.flags import EDGE_FLAGS
from bella.simulation import Receiver, SimulatedBurst, observe
from bella.simulation.burst import arrival_s
from bella.simulation.light_curves import PulseLaw
from benchmarks.edges import Case, simulated

RELEASE = np.datetime64("2012-06-07T19:20:00", "ns")
BURST = SimulatedBurst(RELEASE, pulse=PulseLaw("emg", 42.0, -0.77, decay_s=130.0))
FREQUENCY_MHZ = np.geomspace(0.25, 3.0, 24)
SECOND = np.timedelta64(1_000_000_000, "ns")


def seen(cadence_s: float, offset_s: np.ndarray | None = None, noise: float = 0.05, seed: int = 1) -> xr.Dataset:
    offset = np.zeros(FREQUENCY_MHZ.size) if offset_s is None else offset_s
    receiver = Receiver("STEREO-A", "HFR", FREQUENCY_MHZ, cadence_s, min(cadence_s, 2.0), offset, noise)
    start = RELEASE - np.timedelta64(15, "m")
    return observe(receiver, [BURST], start, start + np.timedelta64(90, "m"), np.random.default_rng(seed))


def late_s(spectrum: xr.Dataset, method: str = "half_rise") -> np.ndarray:
    edges = spectrum_edges(spectrum, method)
    found = (edges["arrival_utc"].to_numpy() - RELEASE) / SECOND
    return found - arrival_s(BURST, edges["frequency_mhz"].to_numpy(), "STEREO-A")


SWEPT = seen(38.0, np.linspace(-18.0, 18.0, 24))


def test_a_simulated_spectrum_is_timed_at_its_half_rise() -> None:
    edges = spectrum_edges(SWEPT)

    assert list(edges.columns) == ["observatory", "frequency_mhz", "arrival_utc", "sigma_s", "edge", "flag"]
    assert set(edges["edge"]) == {"half_rise"}
    assert (edges["flag"] == "").all()
    assert np.abs(late_s(SWEPT) / edges["sigma_s"]).max() < 3.5
    assert abs(np.median(late_s(SWEPT))) < 2.0


@pytest.mark.parametrize(("method", "within_s"), [("half_maximum", 25.0), ("gauss_hermite", 45.0)])
def test_other_definitions_have_their_own_name_and_times(method: str, within_s: float) -> None:
    assert set(spectrum_edges(SWEPT, method)["edge"]) == {method}
    assert np.abs(late_s(SWEPT, method)).max() < within_s


@given(whole=st.integers(-5, 5), part_s=st.floats(-0.5, 0.5))
@settings(max_examples=15, deadline=None)
def test_a_shift_of_all_times_is_a_shift_of_all_edges(whole: int, part_s: float) -> None:
    shift = np.timedelta64(round((whole * 38.0 + part_s) * 1e9), "ns")
    later = spectrum_edges(SWEPT.assign_coords(time=SWEPT["time"] + shift))
    edges = spectrum_edges(SWEPT)

    moved = (later["arrival_utc"] - edges["arrival_utc"]).to_numpy()
    assert np.abs((moved - shift) / SECOND).max() < 1e-3
    np.testing.assert_allclose(later["sigma_s"], edges["sigma_s"], rtol=1e-4)


@pytest.mark.parametrize("part", [0.25, 0.5, 0.75])
def test_where_the_samples_fall_does_not_matter(part: float) -> None:
    """The receiver starts a part of a record later: other samples of the same burst."""
    here, there = (seen(38.0, np.full(24, offset), noise=0.0) for offset in (0.0, 38.0 * part))
    sigma = np.hypot(spectrum_edges(here)["sigma_s"], spectrum_edges(there)["sigma_s"])

    assert np.abs((late_s(there) - late_s(here)) / sigma).max() < 2.5
    assert abs(np.median(late_s(there) - late_s(here))) < 1.5


@given(st.floats(1e-12, 1e12))
@settings(max_examples=15, deadline=None)
def test_gain_moves_nothing(gain: float) -> None:
    curves = simulated(Case(0.5, 38.0, second=False), range(3))
    frequency = np.full(3, 0.5)

    one, other = (flank_edges(curves.time_s, scale * curves.power, 38.0, frequency, 2.0) for scale in (1.0, gain))

    np.testing.assert_allclose([edge[:2] for edge in other], [edge[:2] for edge in one], atol=1e-6)


def test_order_of_the_sweep_does_not_matter_when_the_true_times_are_given() -> None:
    down = seen(38.0, np.linspace(18.0, -18.0, 24))

    sigma = np.hypot(spectrum_edges(SWEPT)["sigma_s"], spectrum_edges(down)["sigma_s"])
    assert np.abs((late_s(down) - late_s(SWEPT)) / sigma).max() < 3.5


def test_times_of_samples_may_be_given_one_by_one() -> None:
    offset = (SWEPT["sample_offset_s"] * 1e9).astype("timedelta64[ns]")
    one_by_one = SWEPT.drop_vars("sample_offset_s").assign(sample_time=SWEPT["time"] + offset)

    np.testing.assert_allclose(late_s(one_by_one), late_s(SWEPT), atol=1e-6)


def test_slower_records_agree_within_their_errors() -> None:
    fast, minutes = seen(7.0), seen(60.0, seed=2)
    sigma = np.hypot(spectrum_edges(fast)["sigma_s"], spectrum_edges(minutes)["sigma_s"])
    apart = late_s(minutes) - late_s(fast)

    known = np.isfinite(apart)
    assert known.mean() > 0.9
    assert np.abs(apart / sigma)[known].max() < 4
    assert abs(np.median(apart[known])) < 3


def test_channels_do_not_know_one_another() -> None:
    order = np.random.default_rng(3).permutation(24)
    curves = simulated(Case(0.5, 17.0, second=False), range(24))
    power = curves.power.copy()
    power[:, ::5] = np.nan
    edges = flank_edges(curves.time_s, power, 17.0, FREQUENCY_MHZ, 2.0)

    mixed = flank_edges(curves.time_s[:, order], power[:, order], 17.0, FREQUENCY_MHZ[order], 2.0)

    assert [edge.flag for edge in edges][::5] == ["no_samples"] * 5
    np.testing.assert_array_equal([edge[:2] for edge in mixed], [edges[i][:2] for i in order])


def test_interpolated_channels_are_never_counted() -> None:
    filled = np.zeros(24, dtype=bool)
    filled[[0, 3, 17]] = True

    assert spectrum_edges(SWEPT.assign(interpolated=("frequency", filled)))["frequency_mhz"].size == 21


def test_every_other_record_is_no_gap_but_a_missing_flank_is() -> None:
    thinned = SWEPT.copy(deep=True)
    thinned["intensity"][1::2, 10] = np.nan
    around = (SWEPT["time"].to_numpy() - RELEASE) / SECOND - arrival_s(BURST, FREQUENCY_MHZ[[12]], "STEREO-A")
    thinned["intensity"][np.abs(around) < 60, 12] = np.nan

    edges = spectrum_edges(thinned)

    assert edges["flag"][10] == ""
    assert abs(late_s(thinned)[10]) < 12
    assert edges["flag"][12] == "gap_in_flank"


def test_a_maximum_that_was_cut_off_is_refused() -> None:
    cut = SWEPT.copy(deep=True)
    cut["intensity"] = cut["intensity"].clip(max=8.0)

    low = FREQUENCY_MHZ < 0.6
    assert set(spectrum_edges(cut)["flag"][low]) == {"saturated"}


def test_a_window_keeps_another_burst_out() -> None:
    later = SWEPT.copy(deep=True)
    brighter = observe(
        Receiver("STEREO-A", "HFR", FREQUENCY_MHZ, 38.0, 2.0, np.zeros(24), 0.05),
        [SimulatedBurst(RELEASE + np.timedelta64(45, "m"), contrast=100.0)],
        RELEASE - np.timedelta64(15, "m"),
        RELEASE + np.timedelta64(75, "m"),
        np.random.default_rng(5),
    )
    power = 10 ** (later["intensity"] / 10) + 10 ** (brighter["intensity"] / 10) - 1
    later["intensity"] = (10 * np.log10(power)).astype(np.float32)

    edges = spectrum_edges(later, window_utc=(RELEASE - np.timedelta64(15, "m"), RELEASE + np.timedelta64(40, "m")))

    alone = spectrum_edges(SWEPT)
    apart = (edges["arrival_utc"] - alone["arrival_utc"]).dt.total_seconds()
    assert (apart.abs() < 2 * alone["sigma_s"]).all()


@pytest.mark.parametrize("method", ["half_rise", "half_maximum", "gauss_hermite"])
@pytest.mark.parametrize("kept", [{"time": slice(0, 1)}, {"time": slice(0, 2)}, {"frequency": [0]}])
def test_scraps_of_a_spectrum_are_no_reason_to_stop(method: str, kept: dict[str, object]) -> None:
    edges = spectrum_edges(SWEPT.isel(kept), method)

    assert set(edges["flag"]) <= {"", *EDGE_FLAGS}
    assert edges["arrival_utc"].isna().tolist() == (edges["flag"] != "").tolist()


def test_empty_channels_have_a_reason() -> None:
    empty = SWEPT.copy(deep=True)
    empty["intensity"][:] = np.nan

    assert set(spectrum_edges(empty)["flag"]) == {"no_samples"}


def test_noise_alone_is_no_burst() -> None:
    noise = np.random.default_rng(6).normal(0.0, 1.0, (120, 60))

    flags = [edge.flag for edge in flank_edges(np.arange(120) * 38.0, noise, 38.0, np.geomspace(0.1, 14, 60), 2.0)]

    assert "" not in flags


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_any_numbers_give_an_edge_or_a_known_flag(seed: int) -> None:
    random = np.random.default_rng(seed)
    power = random.choice([0.0, 1.0, -1.0, 1e-300, 1e9, np.nan], (random.integers(1, 12), 6))
    times = np.sort(random.uniform(0, 400, power.shape), axis=0)

    for edge in flank_edges(times, power, 38.0, np.geomspace(0.1, 14, 6), 2.0):
        assert (edge.flag in EDGE_FLAGS) != bool(edge.sigma_s > 0 and np.isfinite(edge.arrival_s))


def test_what_cannot_be_done_is_said() -> None:
    with pytest.raises(InputError, match="'peak' is not an edge of one light curve: choose one of half_rise"):
        spectrum_edges(SWEPT, "peak")
    with pytest.raises(InputError, match="no record between"):
        spectrum_edges(SWEPT, window_utc=(RELEASE + np.timedelta64(9, "h"), RELEASE + np.timedelta64(10, "h")))

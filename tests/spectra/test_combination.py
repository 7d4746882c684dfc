"""Receivers side by side and days in a row: every sample of the parts is there, at its time, once."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from bella.exceptions import InputError
from bella.spectra import combine_receivers, join_days, sample_times
from bella.spectra.assembly import Origin, assemble

SECOND = np.timedelta64(10**9, "ns")
START = np.datetime64("2020-07-21T00:00:00", "ns")


def spectrum(second: list[float], mhz: list[float], receiver: str = "LFR", **extra: np.ndarray) -> xr.Dataset:
    """Intensity is a number that no other sample has."""
    time = START + (np.array(second) * 1e9).astype("timedelta64[ns]")
    intensity = (np.array(second)[:, None] + np.array(mhz)[None]).astype(np.float32)
    return assemble(Origin("PSP", receiver, "psd_v2_hz", f"{receiver}.cdf"), time, np.array(mhz), intensity, extra)


def samples(*spectra: xr.Dataset) -> set[tuple[float, int, float]]:
    """Frequency, time and intensity of every sample there is."""
    found = []
    for one in spectra:
        times, frequency = sample_times(one).to_numpy(), one["frequency"].to_numpy()
        for record, channel in np.argwhere(one["intensity"].notnull().to_numpy()):
            when = int(times[record, channel].astype(np.int64))
            found.append((float(frequency[channel]), when, float(one["intensity"][record, channel])))
    assert len(found) == len(set(found))
    return set(found)


def test_receivers_with_one_time_axis_stand_side_by_side() -> None:
    low, high = spectrum([0, 60, 120], [0.1, 0.2]), spectrum([0, 60, 120], [1.0, 2.0], "HFR")

    whole = combine_receivers(high, low)

    np.testing.assert_array_equal(whole["frequency"], [0.1, 0.2, 1.0, 2.0])
    assert "sample_time" not in whole
    assert whole.attrs["receiver"] == "LFR+HFR"
    assert whole.attrs["source_files"] == ["LFR.cdf", "HFR.cdf"]
    assert samples(whole) == samples(low, high)


def test_receivers_with_different_epochs_keep_them() -> None:
    low, high = spectrum([0, 56, 112], [0.1, 0.2]), spectrum([2.24, 58.24, 114.24], [1.0, 2.0], "HFR")

    whole = combine_receivers(low, high)

    assert whole.sizes == {"time": 3, "frequency": 4}
    assert samples(whole) == samples(low, high)


def test_a_record_without_partner_stands_alone() -> None:
    low, high = spectrum([0, 10, 20, 200], [0.1]), spectrum([1, 100, 201], [1.0], "HFR")

    whole = combine_receivers(low, high)

    np.testing.assert_array_equal((whole["time"].to_numpy() - START) / SECOND, [0, 10, 20, 100, 200])
    np.testing.assert_array_equal(whole["intensity"].notnull().sum("time"), [4, 3])
    assert samples(whole) == samples(low, high)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        ([1.0, 1.3, 1.4, 1.5], [1.2, 2.0], [1.0, 1.3, 1.4, 1.5, 2.0]),
        ([1.0, 1.3, 1.7], [1.2, 1.4, 1.6, 1.8], [1.0, 1.2, 1.4, 1.6, 1.8]),
        ([1.0, 1.5], [1.2, 2.0], [1.0, 1.2, 2.0]),
        ([1.0, 1.5], [1.5, 2.0], [1.0, 1.5, 2.0]),
    ],
)
def test_the_denser_receiver_keeps_its_channels_in_an_overlap(
    low: list[float], high: list[float], expected: list[float]
) -> None:
    whole = combine_receivers(spectrum([0, 60], low), spectrum([0, 60], high, "HFR"))

    np.testing.assert_array_equal(whole["frequency"], expected)


def test_interpolated_channels_do_not_count_in_an_overlap() -> None:
    low = spectrum([0, 60], [1.0, 1.3, 1.4, 1.5], interpolated=np.array([False, True, True, True]))

    whole = combine_receivers(low, spectrum([0, 60], [1.2, 2.0], "HFR"))

    np.testing.assert_array_equal(whole["frequency"], [1.0, 1.2, 2.0])
    assert whole["interpolated"].dtype == bool
    assert not whole["interpolated"].any()


def test_offsets_of_the_sweep_survive() -> None:
    low = spectrum([0, 60], [0.1, 0.2], sample_offset_s=np.array([-3.0, 3.0]))
    high = spectrum([0, 60], [1.0], "HFR")

    assert samples(combine_receivers(low, high)) == samples(low, high)
    assert "sample_offset_s" in combine_receivers(low, high)


def test_spectra_of_two_spacecraft_are_not_combined() -> None:
    with pytest.raises(InputError, match="observatory PSP and SOLO"):
        combine_receivers(spectrum([0, 60], [0.1]), spectrum([0, 60], [1.0]).assign_attrs(observatory="SOLO"))


@settings(max_examples=30)
@given(
    st.lists(st.integers(0, 300), min_size=2, max_size=30, unique=True),
    st.lists(st.integers(0, 300), min_size=2, max_size=30, unique=True),
)
def test_no_sample_is_lost_or_invented(first: list[int], second: list[int]) -> None:
    low, high = spectrum(sorted(first), [0.1, 0.2]), spectrum([x + 0.4 for x in sorted(second)], [1.0], "HFR")

    assert samples(combine_receivers(low, high)) == samples(low, high)


def test_days_that_overlap_are_joined_once() -> None:
    first, second = spectrum([0, 60, 120], [0.1, 0.2]), spectrum([120, 180], [0.1, 0.2])

    whole = join_days([second, first])

    np.testing.assert_array_equal((whole["time"].to_numpy() - START) / SECOND, [0, 60, 120, 180])
    assert samples(whole) == samples(first) | samples(second)
    assert whole.attrs["receiver"] == "LFR"


def test_days_with_other_channels_have_none_there() -> None:
    first = spectrum([0, 60], [0.1, 0.2], interpolated=np.array([True, True]))
    second = spectrum([120, 180], [0.2, 0.3], interpolated=np.array([False, True]))

    whole = join_days([first, second])

    np.testing.assert_array_equal(whole["frequency"], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(whole["interpolated"], [True, False, True])
    assert samples(whole) == samples(first, second)


def test_days_with_different_sweeps_keep_the_times_of_samples() -> None:
    first = spectrum([0, 60], [0.1, 0.2], sample_offset_s=np.array([0.0, 3.0]))
    second = spectrum([120, 180], [0.1, 0.2], sample_offset_s=np.array([0.0, 5.0]))
    third = spectrum([240, 300], [0.1, 0.3])

    assert samples(join_days([first, second])) == samples(first, second)
    assert samples(join_days([first, third])) == samples(first, third)
    assert join_days([first, third])["sample_time"].notnull().all()
    assert "sample_offset_s" in join_days([first, first.assign_coords(time=first["time"] + 600 * SECOND)])


def test_there_must_be_something_to_join() -> None:
    with pytest.raises(InputError, match="no spectra to join"):
        join_days([])
    with pytest.raises(InputError, match="receiver LFR and HFR"):
        join_days([spectrum([0, 60], [0.1]), spectrum([0, 60], [0.1], "HFR")])

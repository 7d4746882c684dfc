"""One-minute averages of Wind RAD1: what was interpolated never counts, what was measured has its time."""

import numpy as np
import pytest
import xarray as xr

from bella.spectra import sample_times, validate_spectrum
from bella.spectra.minutes import DWELL_S, LIST_KHZ, LIST_S, measured_samples, visited_minutes, with_visits

CHANNELS_KHZ = np.arange(20, 1041, 4)
MINUTES = 480
START_S = 51.3
TICK_S = DWELL_S / 4
LISTED = np.isin(CHANNELS_KHZ, LIST_KHZ)


def archived(order_khz: np.ndarray) -> xr.Dataset:
    """A ramp of its own slope in every channel, seen where the list is, averaged by minute, filled in frequency."""
    ticks = np.arange(0.0, MINUTES * 60.0, TICK_S)
    received = order_khz[((ticks - START_S) % LIST_S / DWELL_S).astype(int)]
    minute = (ticks // 60.0).astype(int)
    day = np.full((MINUTES, CHANNELS_KHZ.size), np.nan)
    for column in np.flatnonzero(LISTED):
        here = received == CHANNELS_KHZ[column]
        count = np.bincount(minute[here], minlength=MINUTES)
        total = np.bincount(minute[here], signal_of(CHANNELS_KHZ[column], ticks[here]), MINUTES)
        day[count > 0, column] = total[count > 0] / count[count > 0]
    for row in day:
        known = np.isfinite(row)
        row[~known] = np.interp(CHANNELS_KHZ[~known], CHANNELS_KHZ[known], row[known])
    spectrum = xr.Dataset(
        {"intensity": (("time", "frequency"), day.astype(np.float32))},
        coords={
            "time": np.datetime64("2020-07-21T00:00:30", "ns") + np.arange(MINUTES) * np.timedelta64(60, "s"),
            "frequency": CHANNELS_KHZ * 1e-3,
        },
        attrs={
            "observatory": "WIND",
            "receiver": "RAD1",
            "quantity": "voltage_ratio",
            "integration_s": 60.0,
            "source_files": "none",
        },
    )
    return validate_spectrum(spectrum, "RAD1")


def signal_of(khz: float, time_s: np.ndarray) -> np.ndarray:
    """Grows by the second, faster in some channels than in their neighbours."""
    return (2.0 + np.sin(khz)) * (1.0 + time_s / 600.0)


@pytest.fixture(scope="module")
def day() -> xr.Dataset:
    return archived(LIST_KHZ)


def test_channels_that_the_receiver_does_not_have_are_flagged(day: xr.Dataset) -> None:
    found = with_visits(day)

    # at the lower end of the band neighbours of 4 kHz are all in the list
    high = CHANNELS_KHZ > 60
    np.testing.assert_array_equal(found["interpolated"].to_numpy()[high], ~LISTED[high])


@pytest.mark.parametrize("khz", [104, 136, 152, 376, 428, 1040])
def test_samples_have_the_time_of_their_visit(day: xr.Dataset, khz: int) -> None:
    found = with_visits(day)
    column = int(np.flatnonzero(khz == CHANNELS_KHZ)[0])
    values = found["intensity"].to_numpy()[:, column]
    seconds = (sample_times(found).to_numpy()[:, column] - np.datetime64("2020-07-21")) / np.timedelta64(1, "s")
    known = np.isfinite(values)
    # the ramp tells when a sample was taken
    taken_s = 600.0 * (values[known] / (2.0 + np.sin(khz)) - 1.0)

    error_s = np.abs(seconds[known] - taken_s)
    assert np.quantile(error_s, 0.85) < 1.0
    # where a visit is cut by the minute, its share is known to half a second only
    assert error_s.max() < 12.0
    assert known.mean() == pytest.approx(min(1.0, 60.0 * (khz == LIST_KHZ).sum() / LIST_S), abs=0.02)
    assert np.diff(seconds[known]).min() > 40.0, "no visit stands in two minutes"


def test_a_list_that_begins_in_the_other_half_is_found() -> None:
    """Its highest channels, which are searched first, are visited at the same times half a list later."""
    found = with_visits(archived(np.roll(LIST_KHZ, LIST_KHZ.size // 2)))
    column = int(np.flatnonzero(CHANNELS_KHZ == 104)[0])
    values = found["intensity"].to_numpy()[:, column]
    seconds = (sample_times(found).to_numpy()[:, column] - np.datetime64("2020-07-21")) / np.timedelta64(1, "s")
    known = np.isfinite(values)
    assert known.mean() == pytest.approx(60.0 / LIST_S, abs=0.02)
    assert np.median(np.abs(seconds[known] - 600.0 * (values[known] / (2.0 + np.sin(104)) - 1.0))) < 1.0


def test_what_the_list_does_not_explain_is_anywhere_in_its_minute() -> None:
    shuffled = np.random.default_rng(3).permutation(LIST_KHZ)
    found = with_visits(archived(shuffled))
    column = int(np.flatnonzero(CHANNELS_KHZ == 104)[0])

    assert "sample_time" not in found
    assert found["sample_time_sd_s"].to_numpy()[column] == pytest.approx(17.32, abs=0.01)
    assert np.isfinite(found["intensity"].to_numpy()[:, column]).mean() < 0.5


def test_a_spectrum_without_interpolated_samples_stays(day: xr.Dataset) -> None:
    noise = np.random.default_rng(1).normal(1.0, 0.1, day["intensity"].shape).astype(np.float32)
    measured = day.assign(intensity=(("time", "frequency"), noise))

    assert with_visits(measured) is measured


def test_twice_is_once(day: xr.Dataset) -> None:
    once = with_visits(day)

    xr.testing.assert_identical(with_visits(once), once)


def test_what_was_given_is_not_changed(day: xr.Dataset) -> None:
    before = day.copy(deep=True)
    with_visits(day)

    xr.testing.assert_identical(day, before)


def test_a_line_in_frequency_is_seen_whatever_the_spacing() -> None:
    frequency_mhz = np.array([0.1, 0.2, 0.5, 0.6, 1.0])
    values = np.array([[1.0, 2.0, 5.0, 9.0, 2.0], [1.0, 3.0, 5.0, 5.5, 7.5]])

    expected = [[True, False, True, True, True], [True, True, True, False, True]]
    np.testing.assert_array_equal(measured_samples(values, frequency_mhz), expected)


def test_the_minutes_of_a_list_hold_all_of_its_visits() -> None:
    duration_s, middle_s, _ = visited_minutes(376, START_S, MINUTES)
    visited = duration_s > 0.0

    assert duration_s.sum() == pytest.approx(MINUTES * 60.0 * 2 / 64, abs=2 * DWELL_S)
    assert (np.floor(middle_s[visited] / 60.0) == np.flatnonzero(visited)).all()

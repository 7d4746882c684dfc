"""Averages of a minute: what was not measured in it is filled as in the archive, and readers find out what was."""

from datetime import date

import numpy as np
import pytest
import xarray as xr

from bella.bursts.detection import search
from bella.bursts.timing import burst_spectrum, candidate_near, spectrum_edges
from bella.simulation import SimulatedBurst
from bella.simulation.archive_days import write_spectra
from bella.simulation.burst import arrival_s
from bella.simulation.day import observe_day
from bella.simulation.instruments import instruments
from bella.simulation.light_curves import PulseLaw
from bella.simulation.receiver import filled_in_frequency
from bella.simulation.sky import Conditions, Sky
from bella.spectra import open_spectra, sample_times
from bella.spectra.minutes import LIST_KHZ, LIST_S, mean_time_sd_s
from bella.spectra.stereo import SWEEP_S

DAY = date(2021, 11, 20)
HOURS = (2, 5, 8, 11, 14, 17, 20)
GAP_S = (44_000.0, 45_500.0)
BURSTS = tuple(
    SimulatedBurst(
        np.datetime64(DAY, "ns") + np.timedelta64(3600 * hour + 17 * hour, "s"),
        f_low_mhz=0.2,
        f_high_mhz=12.0,
        contrast=300.0,
        pulse=PulseLaw("emg", 40.0, -0.8),
    )
    for hour in HOURS
)


def simulated(dataset: str) -> xr.Dataset:
    """Receiver of a day with bursts and a gap that stands first in a file."""
    names = ("WIND", "STEREO-A")
    sky = Sky(DAY, BURSTS, (), dict.fromkeys(names, Conditions(gaps_s=(GAP_S,))))
    return observe_day(instruments(dataset, DAY)[0], [sky], DAY, np.random.default_rng(4))


@pytest.fixture(scope="module")
def rad1() -> xr.Dataset:
    """What was measured, and when."""
    return simulated("WI_H1_WAV")


@pytest.fixture(scope="module")
def read(rad1: xr.Dataset, tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """What is read of it from the file."""
    path = write_spectra([rad1], "WI_H1_WAV", DAY, tmp_path_factory.mktemp("archive"))
    return open_spectra(path)[0].sel(time=rad1["time"])


def seconds(spectrum: xr.Dataset) -> np.ndarray:
    return np.asarray((sample_times(spectrum).to_numpy() - np.datetime64(DAY, "ns")) / np.timedelta64(1, "s"))


def test_channels_that_the_list_has_are_found_in_the_file(rad1: xr.Dataset, read: xr.Dataset) -> None:
    # between 20 and 28 kHz, of which one is always filled, nothing can be told from a line
    high = rad1["frequency"].to_numpy() > 0.03

    np.testing.assert_array_equal(read["interpolated"][high], rad1["interpolated"][high])
    assert np.count_nonzero(rad1["interpolated"] == 0) == np.unique(LIST_KHZ).size


@pytest.mark.parametrize("khz", [104, 176, 376, 484, 1040])
def test_the_reader_finds_the_measured_samples_and_their_times(rad1: xr.Dataset, read: xr.Dataset, khz: int) -> None:
    column = int(np.abs(rad1["frequency"].to_numpy() * 1e3 - khz).argmin())
    measured, found = (np.isfinite(one["intensity"].to_numpy()[:, column]) for one in (rad1, read))
    away = np.abs(rad1["time"].to_numpy() - np.datetime64("2021-11-20T12:25", "ns")) > np.timedelta64(30, "m")

    assert not (found & ~measured)[away].any()
    # of a visit that two minutes share the shorter part is left out
    assert np.mean(measured & ~found) < 2.0 / 60.0
    assert found.mean() == pytest.approx(min(1.0, 60.0 * np.count_nonzero(khz == LIST_KHZ) / LIST_S), abs=0.03)
    values = [one["intensity"].to_numpy()[found & away, column] for one in (rad1, read)]
    np.testing.assert_array_equal(*values)
    off_s = np.abs(seconds(read) - seconds(rad1))[found & away, column]
    assert np.quantile(off_s, 0.9) < 1.0
    # the share of a cut visit is known to half a second, against a second one that is 46 s away
    assert off_s.max() < 12.0


def test_samples_are_away_from_the_middle_of_their_minute_as_the_reader_says(rad1: xr.Dataset) -> None:
    stamp_s = seconds(rad1.drop_vars("sample_time"))
    for khz, sd_s in ((104, 17.3), (376, 17.3), (548, 7.1)):
        column = int(np.abs(rad1["frequency"].to_numpy() * 1e3 - khz).argmin())
        measured = np.isfinite(rad1["intensity"].to_numpy()[:, column])

        assert np.std((seconds(rad1) - stamp_s)[measured, column]) == pytest.approx(sd_s, rel=0.1)


def test_edges_of_what_is_read_are_not_biased(read: xr.Dataset) -> None:
    searched = search(read)
    off_s = []
    for burst in BURSTS:
        one = candidate_near(searched, burst.release_utc + np.timedelta64(500, "s"))
        edges = spectrum_edges(burst_spectrum(searched, one))
        good = edges[(edges["flag"] == "") & edges["arrival_utc"].notna() & (edges["frequency_mhz"] > 0.25)]
        arrived_s = (good["arrival_utc"].to_numpy() - burst.release_utc) / np.timedelta64(1, "s")
        off_s.append(arrived_s - arrival_s(burst, good["frequency_mhz"].to_numpy(), "WIND"))
    together = np.concatenate(off_s)

    assert together.size > 6 * len(HOURS)
    assert abs(np.median(together)) < 4.0
    assert np.quantile(np.abs(together), 0.68) < 8.0


def test_a_line_is_drawn_in_frequency_and_beyond_its_ends(rad1: xr.Dataset) -> None:
    few = rad1.isel(frequency=[0, 1, 2, 3], time=slice(0, 2)).copy(deep=True)
    few["intensity"][:] = [[np.nan, 2.0, 4.0, np.nan], [1.0, np.nan, np.nan, 7.0]]

    stored = filled_in_frequency(few)

    np.testing.assert_allclose(stored["intensity"][:2], [[0.0, 2.0, 4.0, 6.0], [1.0, 3.0, 5.0, 7.0]])
    assert stored.sizes["time"] == 1440
    assert "sample_time" not in stored


def test_minutes_of_stereo_are_one_or_two_sweeps_that_lie_anywhere() -> None:
    spectrum = simulated("STEREO_LEVEL2_SWAVES")
    late_s = (seconds(spectrum) - seconds(spectrum.drop_vars("sample_time")))[:, 0]

    assert np.std(late_s) == pytest.approx(mean_time_sd_s(SWEEP_S), rel=0.05)
    # in minutes that the gap cuts it may be more
    assert np.quantile(np.abs(late_s), 0.995) < 0.5 * (60.0 - SWEEP_S) + 0.01
    assert np.abs(late_s.mean()) < 0.5


def test_nothing_is_recorded_in_a_gap(rad1: xr.Dataset) -> None:
    taken_s = seconds(rad1)[np.isfinite(rad1["intensity"].to_numpy())]

    assert not ((taken_s > GAP_S[0]) & (taken_s < GAP_S[1])).any()
    assert rad1.sizes["time"] == 1440 - 24

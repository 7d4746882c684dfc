"""One-minute averages of Wind RAD2: their noise tells when the sweeps were."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bella.spectra import combine_receivers, open_spectra, sample_times, validate_spectrum
from bella.spectra.minutes import SWEEP_CHANNELS, SWEEP_S, snapshots, sweep_start_s, with_sweeps
from tests.spectra import real_day_2020

MINUTES = 720
START_S = 11.3
MIDDLE_S = (np.arange(MINUTES) + 0.5) * 60.0


def minutes(scatter: np.ndarray) -> xr.Dataset:
    """Ratios about 1 that scatter as given, with a burst that stands out in all channels."""
    ratio = 1.0 + scatter * np.random.default_rng(7).standard_normal(scatter.shape)
    ratio[300:304] *= np.array([2.0, 5.0, 3.0, 1.5])[:, None]
    spectrum = xr.Dataset(
        {"intensity": (("time", "frequency"), ratio.astype(np.float32))},
        coords={
            "time": np.datetime64("2020-07-21T00:00:30", "ns") + np.arange(MINUTES) * np.timedelta64(60, "s"),
            "frequency": 1.075 + 0.05 * np.arange(SWEEP_CHANNELS),
        },
        attrs={
            "observatory": "WIND",
            "receiver": "RAD2",
            "quantity": "voltage_ratio",
            "integration_s": 60.0,
            "source_files": "none",
        },
    )
    return validate_spectrum(spectrum, "RAD2")


@pytest.fixture(scope="module")
def swept() -> xr.Dataset:
    """Every sample a mean of three or four snapshots that scatter by 3 %."""
    number = np.stack([snapshots(channel, START_S, MINUTES)[0] for channel in range(SWEEP_CHANNELS)], axis=1)
    return minutes(0.03 / np.sqrt(number))


@pytest.fixture(scope="module")
def unordered() -> xr.Dataset:
    return minutes(np.full((MINUTES, SWEEP_CHANNELS), 0.016))


def late_s(spectrum: xr.Dataset) -> np.ndarray:
    """How long after the middles of their minutes samples were taken."""
    return np.asarray((sample_times(spectrum) - spectrum["time"]).to_numpy() / np.timedelta64(1, "s"))


def test_the_noise_tells_when_the_sweeps_began(swept: xr.Dataset) -> None:
    assert sweep_start_s(swept) == pytest.approx(START_S, abs=0.3)


def test_samples_are_at_the_mean_time_of_their_snapshots(swept: xr.Dataset) -> None:
    expected = np.stack([snapshots(one, START_S, MINUTES)[1] - MIDDLE_S for one in range(SWEEP_CHANNELS)], axis=1)
    off_s = np.abs(late_s(with_sweeps(swept)) - expected)

    # where a snapshot is on the border of a minute, it may be put on the wrong side of it
    assert np.quantile(off_s, 0.95) < 0.4
    assert off_s.max() < 8.2


def test_snapshots_of_a_minute_are_three_or_four_and_in_it() -> None:
    number, middle_s = snapshots(200, START_S, MINUTES)

    assert set(number.tolist()) == {3, 4}
    assert number.mean() == pytest.approx(60.0 / SWEEP_S, rel=0.01)
    assert np.abs(middle_s - MIDDLE_S).max() <= 0.5 * SWEEP_S
    assert np.std(middle_s - MIDDLE_S) == pytest.approx(2.86, abs=0.1)


def test_noise_of_no_order_leaves_the_times_unknown(unordered: xr.Dataset) -> None:
    found = with_sweeps(unordered)

    assert sweep_start_s(unordered) is None
    assert "sample_time" not in found
    np.testing.assert_allclose(found["sample_time_sd_s"], 2.86, atol=0.01)


def test_what_was_measured_stays(swept: xr.Dataset) -> None:
    before = swept.copy(deep=True)
    found = with_sweeps(swept)

    xr.testing.assert_identical(swept, before)
    xr.testing.assert_identical(found["intensity"], swept["intensity"])
    xr.testing.assert_identical(with_sweeps(found), found)


@pytest.mark.parametrize("part", [{"frequency": slice(0, 128)}, {"time": slice(0, 60)}, {"time": slice(0, None, 2)}])
def test_less_than_a_day_of_all_channels_tells_nothing(swept: xr.Dataset, part: dict[str, slice]) -> None:
    assert sweep_start_s(swept.isel(part)) is None


def test_channels_without_data_are_passed_over(swept: xr.Dataset) -> None:
    holes = swept.copy(deep=True)
    holes["intensity"][:, 40:60] = np.nan
    holes["intensity"][100:130] = np.nan

    assert sweep_start_s(holes) == pytest.approx(START_S, abs=0.3)


def test_the_two_real_days_begin_alike(reference_files: Path) -> None:
    _, in_2010, _ = open_spectra(reference_files / "semp/wi_h1_wav_20100117_v01.cdf")
    in_2020 = real_day_2020.wind(reference_files).isel(frequency=slice(-SWEEP_CHANNELS, None))

    assert sweep_start_s(in_2010) == pytest.approx(7.4, abs=0.3)
    assert sweep_start_s(in_2020) == pytest.approx(7.5, abs=0.3)


def test_both_receivers_of_wind_keep_what_is_known_of_their_samples(reference_files: Path) -> None:
    rad1, rad2, _ = open_spectra(reference_files / "semp/wi_h1_wav_20100117_v01.cdf")
    both = combine_receivers(rad1, rad2)

    apart_s = both["visits_apart_s"].to_numpy()
    upper = both["frequency"].to_numpy() > 1.06
    assert not apart_s[:, upper].any()
    # of the channels that the list visits every 46 s, a third of the minutes holds two visits
    assert np.mean(apart_s[:, int(np.abs(both["frequency"].to_numpy() - 0.804).argmin())] > 0) == pytest.approx(
        60.0 / 45.8 - 1.0, abs=0.1
    )
    assert late_s(both)[:, upper].std() == pytest.approx(2.86, abs=0.1)

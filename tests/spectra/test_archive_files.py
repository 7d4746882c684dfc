"""Readers on real archive files: what is known of these days must come out."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from bella.exceptions import InputError
from bella.spectra import combine_receivers, integration_times_s, open_spectra, relative_power, sample_times

WIND_H1 = "semp/wi_h1_wav_20100117_v01.cdf"
STEREO = "semp/stereo_level2_swaves_20100117_v01.cdf"
DIRECTIONS = "l7aler/wi_wa_rad1_l3_df_20200711_v01.cdf"
DAY = np.datetime64("2010-01-17", "ns")
MINUTE = np.timedelta64(60, "s")


def test_wind_h1_has_three_receivers_and_tells_measured_channels(reference_files: Path) -> None:
    rad1, rad2, tnr = open_spectra(reference_files / WIND_H1)

    assert [one.attrs["receiver"] for one in (rad1, rad2, tnr)] == ["RAD1", "RAD2", "TNR"]
    assert [one.sizes["frequency"] for one in (rad1, rad2, tnr)] == [256, 256, 96]
    assert {one.attrs["observatory"] for one in (rad1, rad2, tnr)} == {"WIND"}
    np.testing.assert_allclose(rad1["frequency"][[0, -1]], [0.020, 1.040])
    np.testing.assert_allclose(rad2["frequency"][[0, -1]], [1.075, 13.825])
    # 32 channels have a background, but what the file has at 24 kHz lies between 20 and 28 kHz all day
    assert (~rad1["interpolated"]).sum() == 31
    assert not rad2["interpolated"].any()
    expected = DAY + np.arange(1440) * MINUTE + MINUTE / 2
    np.testing.assert_array_equal(rad1["time"], expected)
    assert np.nanmin(rad1["intensity"]) > 0.0
    assert rad2["intensity"].isnull().mean() < 0.01


def test_channels_of_rad1_have_the_times_at_which_the_list_visits_them(reference_files: Path) -> None:
    rad1, _, _ = open_spectra(reference_files / WIND_H1)

    for mhz, revisit_s in ((0.104, 183.26), (0.332, 91.63)):
        channel = rad1["intensity"].sel(frequency=mhz, method="nearest").to_numpy()
        times = sample_times(rad1).sel(frequency=mhz, method="nearest").to_numpy()[np.isfinite(channel)]
        steps_s = np.diff(times) / np.timedelta64(1, "s")
        assert np.isfinite(channel).mean() == pytest.approx(60.0 / revisit_s, rel=0.03)
        assert (np.abs(steps_s - revisit_s) < 2.0).mean() > 0.98
    assert rad1.attrs["integration_s"] == pytest.approx(2.863, abs=0.001)


def test_stereo_level_2_has_both_spacecraft_without_the_missing_minutes(reference_files: Path) -> None:
    ahead, behind = open_spectra(reference_files / STEREO)

    assert (ahead.attrs["observatory"], behind.attrs["observatory"]) == ("STEREO-A", "STEREO-B")
    assert ahead.sizes == {"time": 1440, "frequency": 366}
    assert (np.diff(ahead["frequency"]) > 0.0).all()
    silent = np.flatnonzero(ahead["intensity"].isnull().all("frequency"))
    np.testing.assert_array_equal(silent, [*range(81, 88), 1439])
    assert int(ahead["intensity"].isnull().sum()) == 8 * 366
    np.testing.assert_array_equal(np.flatnonzero(behind["intensity"].isnull().any("frequency")), [1439])
    assert np.nanmin(ahead["intensity"]) > -1.2


def test_three_spacecraft_see_the_group_of_04_ut_strongest(reference_files: Path) -> None:
    rad1, rad2, _ = open_spectra(reference_files / WIND_H1)
    spectra = [combine_receivers(rad1, rad2), *open_spectra(reference_files / STEREO)]

    strongest = {}
    for one in spectra:
        measured = one.isel(frequency=~one["interpolated"].to_numpy()) if "interpolated" in one else one
        channel = measured["intensity"].sel(frequency=0.48, method="nearest")
        at = int(np.nanargmax(channel))
        minute = (channel["time"].to_numpy()[at] - DAY) / np.timedelta64(1, "m")
        strongest[one.attrs["observatory"]] = (minute, float(channel[at]))
    assert strongest["WIND"] == pytest.approx((249.5, 5.951), abs=0.001)
    assert strongest["STEREO-A"] == pytest.approx((251.5, 9.604), abs=0.001)
    assert strongest["STEREO-B"] == pytest.approx((248.5, 24.461), abs=0.001)
    assert all(3 * 60 + 58 < minute < 4 * 60 + 20 for minute, _ in strongest.values())


def test_receivers_of_wind_combine_without_new_samples(reference_files: Path) -> None:
    rad1, rad2, _ = open_spectra(reference_files / WIND_H1)

    whole = combine_receivers(rad2, rad1)

    assert whole.sizes == {"time": 1440, "frequency": 512}
    assert whole.attrs["receiver"] == "RAD1+RAD2"
    assert int((~whole["interpolated"]).sum()) == 31 + 256
    np.testing.assert_array_equal(sample_times(whole)[:, 256:], sample_times(rad2))
    np.testing.assert_array_equal(sample_times(whole)[:, :256], sample_times(rad1))
    np.testing.assert_allclose(integration_times_s(whole)[[100, 300]], [2.863, 60.0], rtol=1e-3)
    np.testing.assert_array_equal(whole["intensity"][:, :256], rad1["intensity"])
    assert relative_power(whole).sizes == whole.sizes


def test_direction_finding_keeps_the_time_of_every_sample(reference_files: Path) -> None:
    (rad1,) = open_spectra(reference_files / DIRECTIONS)

    assert rad1.sizes == {"time": 4 * 470, "frequency": 32}
    measured = rad1["intensity"].notnull()
    assert int(measured.sum()) == 30_080 - 10
    times = sample_times(rad1).to_numpy()[measured.to_numpy()]
    assert str(times.min()).startswith("2020-07-11T00:00:13.04")
    assert str(times.max()).startswith("2020-07-11T23:58:47")
    top = sample_times(rad1).isel(frequency=-1).to_numpy()
    assert (np.diff(top) > np.timedelta64(0)).all()
    assert str(top[0]) == "2020-07-11T00:00:13.043501973"
    sweep_s = np.diff(top[::4]) / np.timedelta64(1, "s")
    assert np.median(sweep_s) == pytest.approx(183.26, abs=0.05)
    lowest = rad1["intensity"].isel(frequency=0)
    assert int(lowest.notnull().sum()) == 470
    assert {"wave_azimuth_rtn_deg", "wave_colatitude_rtn_deg", "source_size_deg"} <= set(rad1)


def test_direction_finding_has_the_values_of_the_file(reference_files: Path) -> None:
    (rad1,) = open_spectra(reference_files / DIRECTIONS)

    first = rad1.isel(time=slice(0, 4))
    np.testing.assert_allclose(
        first["intensity"].isel(frequency=-1), [1.1686122e-19, 1.1898881e-19, 1.2260439e-19, 1.2020744e-19], rtol=1e-4
    )
    assert first["intensity"].isel(frequency=0).to_numpy()[3] == pytest.approx(1.8829218e-18, rel=1e-5)
    assert str(first["sample_time"].isel(frequency=0).to_numpy()[3]) == "2020-07-11T00:03:13.407681584"
    assert rad1["intensity"].max() < 1e-12


def test_a_file_of_another_instrument_under_this_name_is_refused(reference_files: Path, tmp_path: Path) -> None:
    disguised = tmp_path / "wi_h1_wav_20100117_v01.cdf"
    disguised.symlink_to(reference_files / STEREO)

    with pytest.raises(InputError, match=r"wi_h1_wav_20100117.* is named after Wind.* but holds STEREO/WAVES level 2"):
        open_spectra(disguised)


def test_a_renamed_file_is_known_by_its_content(reference_files: Path, tmp_path: Path) -> None:
    renamed = tmp_path / "monday.cdf"
    renamed.symlink_to(reference_files / WIND_H1)

    assert len(open_spectra(renamed)) == 3


@pytest.mark.parametrize("name", [WIND_H1, STEREO, DIRECTIONS])
def test_reading_takes_no_more_than_three_times_the_file(reference_files: Path, name: str) -> None:
    path = reference_files / name
    open_spectra(path)  # what is imported and kept on the first call is none of the file's
    tracemalloc.start()
    open_spectra(path)
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()

    assert peak_bytes < 3 * path.stat().st_size

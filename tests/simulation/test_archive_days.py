"""Simulated days: what is written is what was simulated, under the archive's names, the same for the same seed."""

import hashlib
import json
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from bella.archive import fetch_days, find_datasets, open_archive
from bella.cli import app
from bella.exceptions import InputError
from bella.simulation import SimulatedBurst
from bella.simulation.archive_days import simulate_days, sky_of, write_spectra
from bella.simulation.burst import arrival_s, contrast_at
from bella.simulation.day import observe_day
from bella.simulation.instruments import WRITABLE, instruments
from bella.simulation.nuisances import CalibrationColumn, JovianArc, TypeTwoLane
from bella.simulation.sky import Conditions, Gain, Sky
from bella.spectra import open_spectra, relative_power, sample_times
from bella.spectra.background import over_background

DAY = date(2013, 6, 7)
LATE = date(2021, 11, 20)
RESOLUTION = 2e-7  # of float32
BURST = SimulatedBurst(np.datetime64("2021-11-20T05:00:00", "ns"), f_low_mhz=0.2, f_high_mhz=12.0, contrast=300.0)


def quiet_sky(*bursts: SimulatedBurst, day: date = LATE, conditions: Conditions | None = None) -> Sky:
    names = ("WIND", "STEREO-A", "STEREO-B", "PSP", "SOLO")
    return Sky(day, bursts, (), dict.fromkeys(names, conditions or Conditions()))


def states(spectrum: xr.Dataset) -> xr.DataArray:
    """Times of samples as files have them: of averages that of the minute."""
    return sample_times(spectrum.drop_vars("sample_time", errors="ignore"))


@pytest.mark.parametrize("dataset", WRITABLE)
def test_a_written_day_reads_back_as_it_was_simulated(tmp_path: Path, dataset: str) -> None:
    day = DAY if dataset.startswith(("STB", "STEREO")) else LATE
    gap = Conditions(gaps_s=((30_000.0, 31_000.0),), gain=Gain(0.3, 1.5, 50_000.0))
    sky = quiet_sky(
        replace(BURST, release_utc=np.datetime64(day, "ns") + np.timedelta64(5, "h")), day=day, conditions=gap
    )
    simulated = [observe_day(one, [sky], day, np.random.default_rng(1)) for one in instruments(dataset, day)]

    path = write_spectra(simulated, dataset, day, tmp_path)

    read = {(one.attrs["observatory"], one.attrs["receiver"]): one for one in open_spectra(path)}
    for expected in simulated:
        found = read[str(expected.attrs["observatory"]), str(expected.attrs["receiver"])].dropna(
            "time", how="all", subset=["intensity"]
        )
        assert found.attrs["quantity"] == expected.attrs["quantity"]
        np.testing.assert_allclose(found["frequency"], expected["frequency"], rtol=RESOLUTION)
        np.testing.assert_array_equal(found["time"].astype("datetime64[s]"), expected["time"].astype("datetime64[s]"))
        if "interpolated" in expected:  # tests/simulation/test_minutes.py
            continue
        np.testing.assert_allclose(found["intensity"], expected["intensity"], rtol=RESOLUTION)
        late_s = (sample_times(found).to_numpy() - states(expected).to_numpy()) / np.timedelta64(1, "s")
        assert np.abs(late_s).max() < 2e-3  # CDF_EPOCH counts milliseconds
    (known,) = find_datasets([dataset])
    assert str(path.parent.relative_to(tmp_path)) in known.folders(day)
    assert known.version(path.name, day) == (1,)
    assert [entry.name for entry in tmp_path.iterdir()] == ["pub"], "nothing but the archive is left behind"


def half_rise_s(spectrum: xr.Dataset, frequency_mhz: float) -> float:
    """When the channel nearest to a frequency has risen to half of its maximum, seconds after the release."""
    column = int(np.abs(spectrum["frequency"].to_numpy() - frequency_mhz).argmin())
    power = relative_power(over_background(spectrum)).to_numpy()[:, column] - 1.0
    time_s = (sample_times(spectrum).to_numpy()[:, column] - BURST.release_utc) / np.timedelta64(1, "s")
    top = int(np.nanargmax(power))
    last = int(np.flatnonzero(power[:top] < 0.5 * power[top])[-1])
    return float(np.interp(0.5 * power[top], power[last : last + 2], time_s[last : last + 2]))


@pytest.mark.parametrize("dataset", ["WI_L2_WAV_RAD1", "PSP_FLD_L2_RFS_LFR", "WI_H1_WAV"])
def test_a_burst_rises_when_the_truth_says(dataset: str) -> None:
    instrument = instruments(dataset, LATE)[0]
    spectrum = observe_day(instrument, [quiet_sky(BURST)], LATE, np.random.default_rng(2))
    channel = float(instrument.receiver.frequency_mhz[np.abs(instrument.receiver.frequency_mhz - 0.548).argmin()])

    expected_s = arrival_s(BURST, np.array([channel]), instrument.receiver.observatory)[0]

    assert half_rise_s(spectrum, channel) == pytest.approx(expected_s, abs=0.2 * instrument.receiver.cadence_s + 2.0)


def test_a_burst_before_midnight_is_heard_on_both_days() -> None:
    burst = replace(BURST, release_utc=np.datetime64("2021-11-20T23:50:00", "ns"))
    (instrument,) = instruments("PSP_FLD_L2_RFS_LFR", LATE)
    skies = [quiet_sky(burst), quiet_sky(day=LATE + timedelta(days=1))]

    evening, morning = (observe_day(instrument, skies, sky.day, np.random.default_rng(3)) for sky in skies)

    low = {"frequency": int(np.abs(instrument.receiver.frequency_mhz - 0.25).argmin())}
    quiet = float(evening["intensity"][low][:1000].median())
    assert float(evening["intensity"].max()) / quiet > 20
    assert float(morning["intensity"][low][:60].max()) / quiet > 20
    assert float(morning["intensity"][low][-60:].max()) / quiet < 2


@pytest.mark.parametrize(
    ("nuisance", "frequency_mhz", "second", "outside_s"),
    [
        (JovianArc(20_000.0, (2.0, 12.0), 600.0, 60.0, 9.0), 7.0, 20_000.0, 22_000.0),
        (TypeTwoLane(20_000.0, 40_000.0, (0.4, 8.0), 0.1, 9.0, 4e9), 8.0 / (1 + 0.25 * 19), 25_000.0, 19_000.0),
        (CalibrationColumn(20_000.0, 20_100.0, 9.0), 5.0, 20_050.0, 20_300.0),
    ],
)
def test_a_nuisance_is_where_it_says(
    nuisance: JovianArc | TypeTwoLane | CalibrationColumn, frequency_mhz: float, second: float, outside_s: float
) -> None:
    time_s = np.array([[outside_s], [second]])

    outside, inside = nuisance.excess(time_s, np.array([frequency_mhz]))[:, 0]

    assert inside > 4.0
    assert nuisance.start_s <= second <= nuisance.stop_s
    assert not nuisance.start_s <= outside_s <= nuisance.stop_s or outside < 0.1
    assert nuisance.band_mhz[0] <= frequency_mhz <= nuisance.band_mhz[1]


def test_a_tapered_burst_fades_to_the_ends_of_its_band_and_away_from_its_beam() -> None:
    burst = replace(BURST, taper=0.3, directivity=0.7, phi0_deg=0.0)
    frequency_mhz = np.array([0.19, 0.21, 1.0, 11.9, 13.0])

    wind, solo = contrast_at(burst, frequency_mhz, "WIND"), contrast_at(burst, frequency_mhz, "STEREO-A")

    assert wind[0] == wind[-1] == 0.0
    assert 0 < wind[1] < wind[2]
    assert 0 < wind[3] < wind[2]
    assert (solo[1:-1] != wind[1:-1]).all()
    plain = contrast_at(replace(BURST, taper=0.0), frequency_mhz, "WIND")
    np.testing.assert_array_equal(plain, [0.0, 300.0, 300.0, 300.0, 0.0])


def checksums(root: Path) -> dict[str, str]:
    """Of the values: the compressed files hold the second they were written in."""
    return {
        str(path.relative_to(root)): hashlib.sha256(one["intensity"].to_numpy().tobytes()).hexdigest()
        for path in root.rglob("*.cdf")
        for one in open_spectra(path)
    }


def test_a_day_depends_on_seed_and_date_alone(tmp_path: Path) -> None:
    datasets = ["STEREO_LEVEL2_SWAVES", "SOLO_L3_RPW-HFR-SURV-FLUX"]
    days = [LATE, LATE + timedelta(days=1)]
    truth = simulate_days(tmp_path / "two", days, 5, datasets)
    again = simulate_days(tmp_path / "one", days[1:], 5, datasets[:1])

    two, one = checksums(tmp_path / "two"), checksums(tmp_path / "one")

    assert len(two) == 4
    assert set(one.items()) <= set(two.items())
    assert truth["days"][1]["bursts"][0]["release_utc"] == again["days"][0]["bursts"][0]["release_utc"]
    other = simulate_days(tmp_path / "other", days[1:], 6, datasets[:1])
    assert other["days"][0]["bursts"] != again["days"][0]["bursts"]


def test_the_mirror_takes_a_simulated_archive_for_an_archive(tmp_path: Path) -> None:
    simulate_days(tmp_path / "archive", [LATE], 5, ["STEREO_LEVEL2_SWAVES"])
    opened = open_archive(str(tmp_path / "archive"), timeout_s=5, interval_s=0)

    (outcome,) = fetch_days(opened, find_datasets(["STEREO_LEVEL2_SWAVES"]), [LATE], tmp_path / "mirror", lambda: None)

    assert [one.attrs["observatory"] for one in open_spectra(outcome.files[0].path)] == ["STEREO-A"]


def test_a_folder_with_anything_else_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "precious.cdf").write_bytes(b"real")

    with pytest.raises(InputError, match="not empty and was not simulated"):
        simulate_days(tmp_path, [LATE], 1)

    assert [entry.name for entry in tmp_path.iterdir()] == ["precious.cdf"]


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match=r"file/archive cannot be written \(Not a directory\); name another folder"):
        simulate_days(tmp_path / "file" / "archive", [LATE], 1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--days", "0"], "--days 0 is not between 1 and 366"),
        (["--seed", "-1"], "--seed -1 is below 0"),
        (["--from", "yesterday"], "'yesterday' is not a day"),
        (["--dataset", "WI_WA_RAD1_L3_DF"], "cannot be simulated"),
        (["--dataset", "NONE"], "is not known"),
        (["--from", "1990-01-01"], "the ephemeris has WIND from 2006"),
        (
            ["--from", "2015-01-01", "--dataset", "SOLO_L3_RPW-HFR-SURV-FLUX"],
            "no data set asked for has files of 2015-01-01",
        ),
        (["--truth", "/nowhere/truth.json"], "folder /nowhere does not exist"),
    ],
)
def test_bad_options_end_in_one_line(tmp_path: Path, arguments: list[str], message: str) -> None:
    result = CliRunner().invoke(app, ["simulate", str(tmp_path / "archive"), *arguments])

    assert result.exception is not None
    assert message in str(result.exception)
    assert not list((tmp_path / "archive").rglob("*.cdf"))


def test_the_command_writes_the_truth_beside_the_files(tmp_path: Path) -> None:
    arguments = ["simulate", str(tmp_path), "--days", "1", "--seed", "5", "--dataset", "STEREO_LEVEL2_SWAVES"]

    result = CliRunner().invoke(app, arguments)

    assert result.exit_code == 0, result.output
    truth = json.loads((tmp_path / "truth.json").read_text())
    (day,) = truth["days"]
    expected = sky_of(date(2021, 11, 20), 5).bursts
    assert [burst["phi0_deg"] for burst in day["bursts"]] == [burst.phi0_deg for burst in expected]
    assert (tmp_path / day["files"][0]).is_file()
    received = day["bursts"][0]["received"]["STEREO-A"]
    arrived_s = arrival_s(expected[0], np.array(day["bursts"][0]["frequency_mhz"]), "STEREO-A")
    first = np.datetime64(received["half_rise_utc"][0].rstrip("Z"))
    assert (first - expected[0].release_utc) / np.timedelta64(1, "s") == pytest.approx(arrived_s[0], abs=2e-3)

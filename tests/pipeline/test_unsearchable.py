"""What of a day cannot be searched, or read, is named; it is never "no burst", and never costs the rest of the day."""

from contextlib import closing
from datetime import date
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bella.catalogue import Catalogue
from bella.pipeline.outcome import DayOutcome, UnfinishedError, check_finished
from bella.pipeline.run import Run, process_day
from bella.pipeline.workers import Workers
from bella.records import DayAnswer, Origin
from bella.settings import Settings
from bella.simulation import archive_files
from tests.pipeline.examples import files_of

DAY = date(2021, 2, 10)


def noise(path: Path, observatory: str, step_s: int, **changed: object) -> Path:
    """A quiet day in steps, as a user would write it."""
    time = np.datetime64(DAY, "ns") + np.arange(86_400 // step_s) * np.timedelta64(step_s, "s")
    values = np.random.default_rng(3).gamma(50, 1e-17, (time.size, 40)).astype(np.float32)
    xr.Dataset(
        {"intensity": (("time", "frequency"), values)},
        coords={"time": time, "frequency": np.geomspace(0.1, 14.0, 40)},
        attrs={"observatory": observatory, "receiver": "X", "quantity": "psd_v2_hz", **changed},
    ).to_netcdf(path, engine="h5netcdf")
    return path


def processed(tmp_path: Path, *paths: Path, origin: Origin = Origin.USER) -> DayOutcome:
    settings = Settings(home=tmp_path / "home", in_situ=None, regions=None)
    outcome = process_day(files_of(DAY, paths), (), Run(settings, "test", Workers(1, settings)))
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        kept = catalogue.searched_day(DAY, (origin,))
    assert kept is not None
    assert (kept.answer, kept.reason) == (outcome.answer, outcome.message)
    return outcome


def test_a_day_of_coarse_receivers_is_not_searchable_and_says_why(tmp_path: Path) -> None:
    done = processed(tmp_path, *(noise(tmp_path / f"{name}.nc", name, 900) for name in ("WIND", "SOLO")))

    assert (done.state, done.answer) == ("not searchable", DayAnswer.NOT_SEARCHABLE)
    for name in ("WIND", "SOLO"):
        assert f"{name}: its records are 900 s apart" in done.message
    with pytest.raises(UnfinishedError, match="900 s apart"):
        check_finished([done])


def test_one_coarse_receiver_is_named_and_the_others_are_searched(tmp_path: Path) -> None:
    done = processed(tmp_path, noise(tmp_path / "a.nc", "WIND", 900), noise(tmp_path / "b.nc", "SOLO", 60))

    assert (done.state, done.answer) == ("searched", DayAnswer.NO_BURST)
    assert done.message == "not searchable: WIND: its records are 900 s apart, too coarse"
    check_finished([done])


def test_one_bad_file_is_named_and_the_rest_of_the_day_is_searched(tmp_path: Path) -> None:
    bad = tmp_path / "bad.nc"
    bad.write_bytes(b"\x89HDF\r\n\x1a\n" + b"\0" * 2000)

    done = processed(tmp_path, bad, noise(tmp_path / "good.nc", "SOLO", 60))

    assert (done.state, done.answer) == ("searched", DayAnswer.NO_BURST)
    assert done.message.startswith("left out: ")
    assert done.message.count("bad.nc") == 1
    with pytest.raises(UnfinishedError, match=r"1 of 1 day was searched without some files: .*bad\.nc"):
        check_finished([done])
    check_finished([done], is_asked_for=False)


def test_a_day_of_key_parameters_without_a_value_is_not_searchable(tmp_path: Path) -> None:
    utc = np.datetime64(DAY, "ns") + np.arange(480) * np.timedelta64(180, "s")
    empty = archive_files.write_wind_k0(tmp_path / "wi_k0_wav_20210210_v01.cdf", utc, np.full((480, 76), np.nan))

    done = processed(tmp_path, empty, origin=Origin.SIMULATED)

    assert (done.state, done.answer) == ("not searchable", DayAnswer.NOT_SEARCHABLE)
    assert "WIND: it holds no data, every value is missing" in done.message

"""Spectra that users bring in a folder go the way of archive days, as data of their own."""

import hashlib
from contextlib import closing
from datetime import UTC, date, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from typer.testing import CliRunner

from bella.arrivals import POSITION
from bella.bursts.detection import search
from bella.catalogue import BurstQuery, Catalogue, DetectionQuery
from bella.cli import app
from bella.exceptions import InputError, StoreError
from bella.pipeline.day import with_stated_positions
from bella.pipeline.day_files import BroughtFolder
from bella.pipeline.outcome import UnfinishedError
from bella.records import DayAnswer, Origin
from bella.settings import Settings
from bella.spacecraft import position, position_hee
from bella.units import R_SUN_KM
from tests.bursts.recorded import burst_at, recorded, sky

DAY = date(2021, 2, 10)


def brought(spectrum: xr.Dataset, path: Path, **changed: str) -> Path:
    """Some hours of a spectrum as a user would write it: nothing in it says that it was simulated."""
    hours = slice(np.datetime64(f"{DAY}T02:00"), np.datetime64(f"{DAY}T09:00"))
    part = spectrum.sel(time=hours).assign_attrs(changed)
    del part.attrs["origin"]
    part.to_netcdf(path, engine="h5netcdf")
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Wind, a spacecraft that only its own file knows, and what is no spectrum."""
    made = tmp_path / "mine"
    made.mkdir()
    what = sky([burst_at(5.0)])
    brought(recorded("WIND", what), made / "wind.nc")
    theirs = recorded("STEREO-A", what)
    there_km = position("STEREO-A", theirs["time"].to_numpy(), "hee") * R_SUN_KM
    placed = theirs.assign(position_km=(("time", "axis"), there_km, {"frame": "hee", "units": "km"}))
    brought(placed, made / "theirs.nc", observatory="MARSIS")
    (made / "notes.nc").write_bytes(b"no spectrum")
    return made


def test_spectra_of_a_folder_are_searched_timed_and_kept_as_those_of_a_user(folder: Path, tmp_path: Path) -> None:
    home = tmp_path / "home"
    command = ["run", "--spectra", str(folder), "--direct", "--home", str(home)]
    environment = {"BELLA_DRAWS": "200", "BELLA_IN_SITU": "", "BELLA_REGIONS": "", "COLUMNS": "160"}

    done = CliRunner().invoke(app, command, env=environment)

    assert isinstance(done.exception, UnfinishedError), (done.exception, done.output)
    assert str(done.exception).startswith("a file was left out: ")
    assert "notes.nc" in str(done.exception)
    settings = Settings(home=home)
    start, stop = datetime(2021, 2, 10, tzinfo=UTC), datetime(2021, 2, 11, tzinfo=UTC)
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        day = catalogue.searched_day(DAY, (Origin.USER,))
        assert day is not None
        assert (day.answer, day.observatories) == (DayAnswer.NOT_LOCALISABLE, ("MARSIS", "WIND"))
        assert catalogue.searched_day(DAY, (Origin.ARCHIVE,)) is None
        found = catalogue.detections(DetectionQuery(start, stop, origins=frozenset({Origin.USER}))).detections
        assert {one.observatory for one in found if one.burst_id.startswith("USER-20210210-05")} == {"WIND", "MARSIS"}
        (burst,) = catalogue.bursts(BurstQuery(origins=frozenset({Origin.USER}))).bursts
        (solution, *_) = burst.solutions
        kept = {one.uri: one.sha256 for one in catalogue.sources(solution.solution_id)}
    sums = {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in ("wind.nc", "theirs.nc")}
    assert kept == sums
    assert settings.day_figure(DAY, Origin.USER).is_file()

    again = CliRunner().invoke(app, [*command, "--json"], env=environment)
    assert "nothing new" in again.stdout


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--archive", "x"), "two sources"),
        (("--from", "2020-01-01"), "no record of these days"),
        (("--to", "2021-02-10"), "--from"),
    ],
)
def test_days_that_a_folder_does_not_have_are_refused(
    folder: Path, tmp_path: Path, more: tuple[str, ...], said: str
) -> None:
    done = CliRunner().invoke(app, ["run", "--spectra", str(folder), "--home", str(tmp_path / "home"), *more])
    assert isinstance(done.exception, InputError)
    assert said in str(done.exception)


def test_a_file_that_has_gone_is_the_disk_and_what_was_read_is_not_read_again(folder: Path, tmp_path: Path) -> None:
    settings = Settings(home=tmp_path / "home", in_situ=None, regions=None)
    first, later = BroughtFolder(folder, settings), BroughtFolder(folder, settings)
    known = first.day(DAY)
    (folder / "wind.nc").unlink()
    assert first.day(DAY).inputs_hash == known.inputs_hash
    with pytest.raises(StoreError, match=r"wind\.nc cannot be read \(No such file or directory\): check the disk"):
        later.day(DAY)


@pytest.mark.parametrize(("name", "moves"), [("STEREO-A", True), ("MARSIS", False)])
def test_a_position_in_a_file_moves_the_receiver(name: str, moves: bool) -> None:
    theirs = recorded("STEREO-A", sky([burst_at(5.0)]))
    shift_km = np.array([9_000.0, -6_000.0, 3_000.0])
    there_km = position("STEREO-A", theirs["time"].to_numpy(), "hee") * R_SUN_KM + shift_km
    stated = theirs.assign(position_km=(("time", "axis"), there_km, {"frame": "hee", "units": "km"}))
    times = np.datetime64(f"{DAY}T05:00", "ns") + np.array([0, 3000]) * np.timedelta64(1, "s")
    empty = dict.fromkeys(POSITION, np.nan)
    table = pd.DataFrame({"observatory": name, "arrival_utc": times, **empty})

    rows = with_stated_positions(table.copy(), [search(stated.assign_attrs(observatory=name))])

    expected = position_hee("STEREO-A", times if moves else times[:1], times[0]) * R_SUN_KM + shift_km
    found_km = rows[list(POSITION)].to_numpy() * R_SUN_KM
    np.testing.assert_allclose(found_km, np.broadcast_to(expected, (2, 3)), atol=20.0)
    far = stated.assign(position_km=stated["position_km"] + 1e6)
    assert (
        with_stated_positions(table.copy(), [search(far.assign_attrs(observatory="STEREO-A"))])["x_rsun"].isna().all()
    )

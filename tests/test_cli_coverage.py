"""``bella coverage`` as a user meets it."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import Result
from typer.testing import CliRunner

from bella.cli import app
from bella.exceptions import BellaError, InputError

EVENT = ("--at", "2012-06-07T19:30")
TABLE = """# an imagined fleet
observatory,x_rsun,y_rsun,z_rsun,sigma_s
ONE,215,0,0,20
TWO,-100,180,3,
THREE,-100,-180,0,30
FOUR,80,10,0,8
"""


def coverage(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["coverage", *map(str, arguments)], env={"COLUMNS": "200"})


def refused(*arguments: str | Path) -> str:
    """The one line that a user reads."""
    result = coverage(*arguments)
    assert isinstance(result.exception, BellaError), (result.exception, result.output)
    assert isinstance(result.exception, InputError)
    message = str(result.exception)
    assert "\n" not in message
    return message


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "fleet.csv"
    path.write_text(TABLE)
    return path


def read(path: Path) -> xr.Dataset:
    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        return dataset.load()


def test_map_and_figure_of_the_fleet_at_a_time(tmp_path: Path) -> None:
    result = coverage(*EVENT, "--output", tmp_path / "map.nc", "--size", 21)
    assert result.exit_code == 0, result.output
    assert "Left out, not in the ephemeris at this time: PSP, SOLO" in result.output
    assert {path.name for path in tmp_path.iterdir()} == {"map.nc", "map.svg"}
    sky = read(tmp_path / "map.nc")
    assert list(sky["observatory"].to_numpy()) == ["WIND", "STEREO-A", "STEREO-B"]
    assert list(sky["sigma_s"].to_numpy()) == [60.0, 38.05, 38.05]
    assert (sky.attrs["epoch"], sky.attrs["frame"], sky.attrs["preset"]) == ("2012-06-07T19:30:00Z", "HEE", "default")
    assert sky.sizes["x"] == sky.sizes["y"] == 21
    assert sky["sd_x_rsun"].sel(x=0, y=0).item() == pytest.approx(19.0, abs=1.0)
    assert sky["closed_form_off"].dtype == bool


def test_exact_map_from_a_table_of_positions(table: Path, tmp_path: Path) -> None:
    picture = tmp_path / "other.png"
    options = ("--output", tmp_path / "map.nc", "--figure", picture, "--size", 9, "--exact", "--sigma", "TWO=50,FOUR=9")
    result = coverage("--positions", table, *options)
    assert result.exit_code == 0, result.output
    sky = read(tmp_path / "map.nc")
    assert dict(zip(sky["observatory"].to_numpy(), sky["sigma_s"].to_numpy(), strict=True)) == {
        "ONE": 20.0,
        "TWO": 50.0,
        "THREE": 30.0,
        "FOUR": 9.0,
    }
    assert sky["receiver_rsun"].sel(observatory="TWO", xyz="z").item() == 3.0
    assert np.isfinite(sky["exact_sd_x_rsun"]).all()
    assert sky.attrs["epoch"] == "not stated"
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert not (tmp_path / "map.svg").exists()


@pytest.mark.parametrize(
    ("options", "sigma_s", "v_sd"),
    [
        (("--preset", "bella-2024"), [30.0, 30.0, 30.0], 0.001),
        (("--preset", "paper"), [60.0, 38.05, 38.05], 0.1),
        (("--preset", "bella-2024", "--sigma", "WIND=45"), [45.0, 30.0, 30.0], 0.001),
        (("--sigma", "16"), [16.0, 16.0, 16.0], 0.001),
    ],
)
def test_preset_and_option_decide_the_timing_errors(tmp_path: Path, options, sigma_s, v_sd) -> None:
    assert coverage(*EVENT, "--output", tmp_path / "map.nc", "--size", 2, *options).exit_code == 0
    sky = read(tmp_path / "map.nc")
    assert list(sky["sigma_s"].to_numpy()) == sigma_s
    assert sky.attrs["v_prior_sd_over_c"] == v_sd


def test_part_of_the_fleet(table: Path, tmp_path: Path) -> None:
    fleet = ("--fleet", "FOUR, ONE,THREE")
    assert coverage("--positions", table, *fleet, "--output", tmp_path / "map.nc", "--size", 3).exit_code == 0
    assert set(read(tmp_path / "map.nc")["observatory"].to_numpy()) == {"ONE", "THREE", "FOUR"}


def test_spacecraft_asked_for_but_not_flying_are_named(tmp_path: Path) -> None:
    fleet = ("--fleet", "WIND,STEREO-A,STEREO-B,SOLO")
    result = coverage(*EVENT, *fleet, "--output", tmp_path / "map.nc", "--size", 3)
    assert result.exit_code == 0
    assert "Left out, not in the ephemeris at this time: SOLO\n" in result.output


def test_an_old_map_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "map.nc").write_text("old")
    assert coverage(*EVENT, "--output", tmp_path / "map.nc", "--size", 3).exit_code == 0
    assert read(tmp_path / "map.nc").sizes["x"] == 3


def test_a_map_that_cannot_be_written_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: xr.Dataset, path: Path, **_: object) -> None:
        Path(path).write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(xr.Dataset, "to_netcdf", full)
    assert "No space left" in refused(*EVENT, "--output", tmp_path / "map.nc", "--size", 3)
    assert list(tmp_path.iterdir()) == []


BAD_OPTIONS = {
    "bad arrivals": ((*EVENT, "--preset", "robust"), "Gaussian errors only"),
    "largest speed": ((*EVENT, "--preset", "subluminal"), "Gaussian errors only"),
    "neither": ((), "give a time with --at"),
    "both": ((*EVENT, "--positions", "x.csv"), "keep one of them"),
    "no time": (("--at", "yesterday"), "is not a time"),
    "empty time": (("--at", ""), "is not a time"),
    "unknown spacecraft": ((*EVENT, "--fleet", "WIND,STEREO-A,VOYAGER"), "'VOYAGER' is not known"),
    "two spacecraft": ((*EVENT, "--fleet", "WIND,STEREO-A"), "3 or more"),
    "two fly": ((*EVENT, "--fleet", "WIND,STEREO-A,SOLO"), "3 or more"),
    "sigma 0": ((*EVENT, "--sigma", "0"), "not above 0"),
    "sigma negative": ((*EVENT, "--sigma", "WIND=-3"), "not above 0"),
    "sigma no number": ((*EVENT, "--sigma", "fast"), "is not a number"),
    "sigma empty": ((*EVENT, "--sigma", "WIND="), "is not a number"),
    "sigma infinite": ((*EVENT, "--sigma", "inf"), "not between"),
    "sigma twice": ((*EVENT, "--sigma", "WIND=3,WIND=4"), "named twice"),
    "sigma of a stranger": ((*EVENT, "--sigma", "SOLO=3"), "SOLO, which is not in the map"),
    "sigma not known": (("--at", "2021-12-04T13:00"), "--sigma PSP="),
    "size 1": ((*EVENT, "--size", "1"), "2 to 2000"),
    "size 2001": ((*EVENT, "--size", "2001"), "2 to 2000"),
    "preset": ((*EVENT, "--preset", "best"), "'best' is not known"),
    "figure of another kind": ((*EVENT, "--figure", "map.jpg"), "ends with none of .svg, .png and .pdf"),
    "figure without folder": ((*EVENT, "--figure", "nowhere/map.png"), "folder nowhere does not exist"),
}


@pytest.mark.parametrize("name", BAD_OPTIONS)
def test_bad_options_are_refused_in_one_line(name: str, tmp_path: Path) -> None:
    options, reason = BAD_OPTIONS[name]
    assert reason in refused(*options, "--output", tmp_path / "map.nc")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("output", "reason"),
    [("nowhere/map.nc", "make it or name another --output"), ("map.svg", "would both be"), (".", "is a folder")],
)
def test_bad_outputs_are_refused_before_any_work(output: str, reason: str, tmp_path: Path) -> None:
    assert reason in refused(*EVENT, "--output", tmp_path / output)


ROWS = ["A,215,0,0", "B,-100,180,0", "C,-100,-180,0"]
BAD_TABLES = {
    "missing column": ("observatory,x_rsun,y_rsun", ["A,1,2"], "column z_rsun is missing"),
    "NaN": (None, [*ROWS, "D,nan,0,0"], "row 4, column x_rsun: 'nan' is not a number"),
    "empty": (None, [*ROWS, "D,1,,0"], "row 4, column y_rsun: '' is not a number"),
    "nameless": (None, [*ROWS, ",1,0,0"], "row 4, column observatory: '' is empty; every row needs a name"),
    "word": (None, [*ROWS, "D,1,0,up"], "row 4, column z_rsun: 'up' is not a number"),
    "twice": (None, [*ROWS, "B,1,0,0"], "row 4, column observatory: 'B' occurs twice"),
    "no name": (None, [*ROWS, " ,1,0,0"], "row 4, column observatory: '' is empty"),
    "semicolons": ("observatory;x_rsun;y_rsun;z_rsun", [row.replace(",", ";") for row in ROWS[:2]], "3 or more"),
    "two rows": (None, ROWS[:2], "3 or more"),
    "no rows": (None, [], "3 or more"),
    "one place": (None, ["A,1,2,3", "B,1,2,3", "C,1,2,3"], "one place"),
    "kilometres": (None, [*ROWS, "D,150000000,0,0"], "within 100 au"),
    "sigma 0": ("observatory,x_rsun,y_rsun,z_rsun,sigma_s", [f"{row},0" for row in ROWS], "row 1, column sigma_s: '0'"),
    "sigma word": ("observatory,x_rsun,y_rsun,z_rsun,sigma_s", [f"{row},s" for row in ROWS], "column sigma_s: 's'"),
    "no sigma": (None, ROWS, "no timing error is known for A"),
    "too many fields": (None, [*ROWS, "D,1,0,0,5,6"], "is not a CSV table"),
    "more fields than names": (None, [f"{row},5" for row in ROWS], "more columns"),
}


@pytest.mark.parametrize("name", BAD_TABLES)
def test_bad_tables_are_refused_naming_row_and_column(name: str, tmp_path: Path) -> None:
    heading, rows, reason = BAD_TABLES[name]
    path = tmp_path / "fleet.csv"
    path.write_text("\n".join([heading or "observatory,x_rsun,y_rsun,z_rsun", *rows]) + "\n")
    assert reason in refused("--positions", path, "--output", tmp_path / "map.nc")


@pytest.mark.parametrize("content", [None, b"", b"\xff\xfe\x00\x01"], ids=["absent", "nothing in it", "not text"])
def test_files_that_are_no_table(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "fleet.csv"
    if content is not None:
        path.write_bytes(content)
    assert "fleet.csv" in refused("--positions", path, "--output", tmp_path / "map.nc")


def test_two_spacecraft_at_one_place_still_make_a_map(tmp_path: Path) -> None:
    path = tmp_path / "fleet.csv"
    path.write_text("observatory,x_rsun,y_rsun,z_rsun\n" + "\n".join([*ROWS, "D,215,0,0"]))
    assert coverage("--positions", path, "--sigma", "30", "--size", 3, "--output", tmp_path / "map.nc").exit_code == 0

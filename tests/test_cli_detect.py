"""``bella detect`` as a user meets it."""

import json
from pathlib import Path

import pandas as pd
import pytest
import xarray as xr
from click.testing import Result
from typer.testing import CliRunner

from bella.bursts.detection import DETECTION_COLUMNS
from bella.cli import app
from bella.exceptions import BellaError, InputError
from bella.spectra import validate_spectrum
from tests.bursts.recorded import burst_at, recorded, sky
from tests.commands import Sandbox
from tests.spectra.real_day import STEREO, WIND


def detect(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["detect", *map(str, arguments)], env={"COLUMNS": "120"})


def refused(*arguments: str | Path) -> str:
    """The one line that a user reads."""
    result = detect(*arguments)
    assert isinstance(result.exception, BellaError), (result.exception, result.output)
    assert isinstance(result.exception, InputError)
    message = str(result.exception)
    assert "\n" not in message
    return message


def written(folder: Path, spectrum: xr.Dataset, name: str) -> Path:
    path = folder / f"{name}.nc"
    validate_spectrum(spectrum, name).to_netcdf(path, engine="h5netcdf")
    return path


@pytest.fixture(scope="module")
def spectra(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A day with one burst at three spacecraft, and the same of one that nobody knows."""
    folder = tmp_path_factory.mktemp("spectra")
    what = sky([burst_at(5.0)])
    days = {name: recorded(name, what) for name in ("WIND", "STEREO-A", "SOLO")}
    days["STRANGER"] = days["STEREO-A"].assign_attrs(observatory="STRANGER")
    return {name: written(folder, day, name) for name, day in days.items()}


def test_burst_of_three_spacecraft(tmp_path: Path, spectra: dict[str, Path]) -> None:
    result = detect(*(spectra[name] for name in ("WIND", "STEREO-A", "SOLO")), "--output", tmp_path / "found.csv")
    assert result.exit_code == 0, result.output
    table = pd.read_csv(tmp_path / "found.csv")

    assert list(table.columns) == list(DETECTION_COLUMNS)
    assert list(table["tier"]) == ["localisable"] * 3
    assert len(set(table["burst_id"])) == 1
    assert table["start_utc"].str.fullmatch(r"2021-02-10T05:\d\d:\d\d\.\d+Z").all()
    assert [path.name for path in tmp_path.iterdir()] == ["found.csv"]
    assert "3 localisable" in result.output
    assert max(map(len, result.output.splitlines())) <= 120


def test_json_says_what_the_table_says(tmp_path: Path, spectra: dict[str, Path]) -> None:
    result = CliRunner().invoke(
        app, ["detect", str(spectra["WIND"]), "--output", str(tmp_path / "found.csv"), "--json"]
    )
    (row,) = json.loads(result.stdout)
    (written_row,) = pd.read_csv(tmp_path / "found.csv").to_dict("records")

    assert set(row) == set(DETECTION_COLUMNS)
    assert (row["observatory"], row["reason"]) == (written_row["observatory"], written_row["reason"])
    assert row["score"] == pytest.approx(written_row["score"], rel=1e-6)


def test_a_spacecraft_that_nobody_knows_is_searched_and_not_compared(tmp_path: Path, spectra: dict[str, Path]) -> None:
    result = detect(*spectra.values(), "--output", tmp_path / "found.csv")
    assert result.exit_code == 0, result.output
    table = pd.read_csv(tmp_path / "found.csv", keep_default_na=False).set_index("observatory")

    assert "Not compared, not in the ephemeris at this time: STRANGER" in result.output
    assert (table.loc["STRANGER", "tier"], table.loc["STRANGER", "burst_id"]) == ("catalogued", "")
    assert set(table.drop("STRANGER")["tier"]) == {"localisable"}


def test_a_quiet_day_gives_a_table_without_rows(tmp_path: Path) -> None:
    quiet = written(tmp_path, recorded("STEREO-A", sky()), "quiet")
    result = detect(quiet, "--output", tmp_path / "found.csv")

    assert result.exit_code == 0, result.output
    assert "no burst found" in result.output
    assert pd.read_csv(tmp_path / "found.csv").empty


def test_figures_of_the_days(tmp_path: Path, spectra: dict[str, Path]) -> None:
    result = detect(spectra["WIND"], "--output", tmp_path / "found.csv", "--figures", tmp_path / "days")

    assert result.exit_code == 0, result.output
    (path,) = (tmp_path / "days").iterdir()
    drawn = path.read_text()
    assert path.stem in drawn
    assert drawn.count('class="box') >= len(pd.read_csv(tmp_path / "found.csv")) > 0
    assert drawn.endswith("</svg>")


@pytest.mark.parametrize("keep", [0, 100, 0.5])
def test_a_damaged_file_is_left_out_and_told(tmp_path: Path, spectra: dict[str, Path], keep: float) -> None:
    content = spectra["WIND"].read_bytes()
    damaged = tmp_path / "damaged.nc"
    damaged.write_bytes(content[: int(keep if keep > 1 else keep * len(content))])

    alone = refused(damaged, "--output", tmp_path / "found.csv")
    beside = detect(spectra["STEREO-A"], damaged, "--output", tmp_path / "found.csv")

    assert "damaged.nc" in alone
    assert beside.exit_code == 1
    assert "Left out:" in beside.output
    assert set(pd.read_csv(tmp_path / "found.csv")["observatory"]) == {"STEREO-A"}


def test_a_missing_file_and_a_missing_folder_are_told(tmp_path: Path, spectra: dict[str, Path]) -> None:
    assert "nowhere.cdf" in refused(tmp_path / "nowhere.cdf", "--output", tmp_path / "found.csv")
    assert "does not exist" in refused(spectra["WIND"], "--output", tmp_path / "none" / "found.csv")
    assert list(tmp_path.iterdir()) == []


def test_an_earlier_table_is_kept_where_a_new_one_cannot_be_made(tmp_path: Path, spectra: dict[str, Path]) -> None:
    output = tmp_path / "found.csv"
    output.write_text("earlier")
    (tmp_path / "damaged.nc").write_bytes(b"damaged")

    refused(tmp_path / "damaged.nc", "--output", output)
    assert output.read_text() == "earlier"


def test_the_day_of_2010_as_a_command(tmp_path: Path, reference_files: Path) -> None:
    sandbox = Sandbox.within(tmp_path)
    files = [str(reference_files / WIND), str(reference_files / STEREO)]
    done = sandbox.bella("detect", *files, "--output", str(sandbox.elsewhere[0] / "found.csv"))
    table = pd.read_csv(sandbox.elsewhere[0] / "found.csv")

    assert done.stderr.strip() == ""
    assert "2010-01-17 03:58" in done.stdout
    assert set(table["observatory"]) == {"WIND", "STEREO-A", "STEREO-B"}
    assert set(table["tier"]) == {"catalogued", "rejected"}


def test_a_damaged_file_as_a_command(tmp_path: Path) -> None:
    sandbox = Sandbox.within(tmp_path)
    damaged = sandbox.elsewhere[0] / "wi_h1_wav_20100117_v01.cdf"
    damaged.write_bytes(b"\xcd\xf3\x00\x01" + bytes(3000))
    (other := sandbox.elsewhere[0] / "other.npz").write_bytes(b"PK")
    done = sandbox.bella("detect", other.name, damaged.name, "--output", "found.csv", code=2)

    first, second = done.stderr.strip().splitlines()
    assert (other.name in first, damaged.name in second) == (True, True)
    assert "Traceback" not in done.stderr
    assert not (sandbox.elsewhere[0] / "found.csv").exists()

"""``bella arrivals``: from files to a table that ``bella localise`` reads."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from bella.arrivals import read_arrivals, read_covariance
from bella.cli import app
from bella.spectra import event_spectra
from tests.plotting.reading import of_class, parsed, points

AROUND = "2012-06-07T19:30"


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The spectra of the built-in event as netCDF, as of any other instrument."""
    folder = tmp_path_factory.mktemp("event")
    for name, node in event_spectra().items():
        node.to_dataset().to_netcdf(folder / f"{name}.nc", engine="h5netcdf")
    return [str(path) for path in sorted(folder.glob("*.nc"))]


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["arrivals", *arguments], env={"COLUMNS": "100"})


def test_the_table_is_read_by_localise_and_gives_the_track(files: list[str], tmp_path: Path) -> None:
    table, places = tmp_path / "arrivals.csv", tmp_path / "places.csv"
    result = run(*files, "--around", AROUND, "--edge", "half_maximum", "--output", str(table))

    assert result.exit_code == 0, result.output
    done = CliRunner().invoke(app, ["localise", str(table), "--output", str(places), "--kappa", "none"])
    assert done.exit_code == 0, done.output
    assert "# remark: apparent source: not corrected for scattering" in places.read_text()
    found = pd.read_csv(places, comment="#").set_index("frequency_mhz")
    distance = pd.Series(np.hypot(found["x_rsun"], found["y_rsun"]), index=found.index)
    for frequency_mhz, expected in ((1.0, 25.3), (0.6, 40.0), (0.4, 55.6)):
        nearest = float(np.interp(frequency_mhz, distance.index, distance))
        assert nearest == pytest.approx(expected, rel=0.12), "half-maximum edges of the built-in event, resolved apart"


def test_channels_come_with_their_flags_and_curves_with_their_covariance(files: list[str], tmp_path: Path) -> None:
    channels, curve, matrix = tmp_path / "channels.csv", tmp_path / "curve.csv", tmp_path / "covariance.nc"
    assert run(*files, "--around", AROUND, "--per-channel", "--output", str(channels)).exit_code == 0
    result = run(*files, "--around", AROUND, "--frequencies", "7", "--output", str(curve), "--covariance", str(matrix))

    assert result.exit_code == 0, result.output
    assert "STEREO-B" in result.output
    rows = pd.read_csv(channels, keep_default_na=False)
    assert "" in set(rows["flag"])
    assert {"shape_sd_s", "offset_sd_s", "rise_s"} <= set(rows.columns)
    table = read_arrivals(curve)
    assert set(table["edge"]) == {"shared_profile"}
    assert table.attrs["shape_length_ln_f"] == 0.2
    covariance = read_covariance(matrix, len(table))
    assert (np.diag(covariance) >= 0.9 * table["sigma_s"] ** 2).all()


def test_one_spacecraft_is_timed_by_its_flanks(files: list[str], tmp_path: Path) -> None:
    result = run(files[0], "--around", AROUND, "--output", str(tmp_path / "one.csv"))

    assert result.exit_code == 0, result.output
    assert "Edge half_rise" in result.output
    assert (pd.read_csv(tmp_path / "one.csv", comment="#")["edge"] == "half_rise").all()


def test_figures_are_drawn(files: list[str], tmp_path: Path) -> None:
    result = run(
        *files, "--around", AROUND, "--output", str(tmp_path / "a.csv"), "--figures", str(tmp_path / "figures")
    )

    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {
        "aligned.svg",
        "light_curves.svg",
        "shared_profile.svg",
    }
    root = parsed((tmp_path / "figures" / "aligned.svg").read_text())
    (drawn,) = of_class(root, "spectra")
    first, last = map(float, drawn.get("data-time").split(","))
    left, right = map(float, drawn.get("data-across").split(","))
    lines = of_class(root, "edge-line edge-shared_profile")
    begins = [first + (points(one)[:, 0].min() - left) / (right - left) * (last - first) for one in lines]
    table = pd.read_csv(tmp_path / "a.csv", comment="#", parse_dates=["arrival_utc"])
    received = table["arrival_utc"].min().timestamp()
    assert all(300.0 < received - begin < 700.0 for begin in begins), "earlier by the light time from the Sun"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--around", "noon"], "noon"),
        (
            ["--around", AROUND, "--edge", "first_photon"],
            "--edge first_photon: choose one of shared_profile",
        ),
        (["--around", AROUND, "--frequencies", "0"], "--frequencies 0 is not between 1 and 1000"),
        (
            ["--around", "2012-06-09T00:00"],
            "no spacecraft shows a burst around 2012-06-09T00:00:00: the spectra are of 2012-06-07T",
        ),
        (["--around", AROUND, "--covariance", "/nowhere/c.nc"], "folder /nowhere does not exist"),
    ],
)
def test_bad_options_end_in_one_line(files: list[str], tmp_path: Path, arguments: list[str], message: str) -> None:
    table = tmp_path / "arrivals.csv"
    result = run(*files, *arguments, "--output", str(table))

    assert result.exception is not None
    assert message in str(result.exception)
    assert not table.exists()


@pytest.mark.parametrize("name", ["WIND", "STEREO-A"])
def test_one_spacecraft_is_timed_too(files: list[str], tmp_path: Path, name: str) -> None:
    alone, together = tmp_path / "one.csv", tmp_path / "all.csv"
    (file,) = [one for one in files if Path(one).stem == name]

    result = run(file, "--around", AROUND, "--edge", "half_maximum", "--output", str(alone))
    run(*files, "--around", AROUND, "--edge", "half_maximum", "--output", str(together))

    assert result.exit_code == 0, result.output
    one, every = (pd.read_csv(path, comment="#") for path in (alone, together))
    assert set(one["observatory"]) == {name}
    every = every[every["observatory"] == name].sort_values("frequency_mhz")
    seconds = [pd.to_datetime(table["arrival_utc"]).astype("int64").to_numpy() / 1e9 for table in (one, every)]
    order = one["frequency_mhz"].argsort()
    same = np.interp(every["frequency_mhz"], one["frequency_mhz"].iloc[order], seconds[0][order])
    assert np.median(np.abs(same - seconds[1])) < 10.0


def test_a_file_that_cannot_be_read_is_left_out(files: list[str], tmp_path: Path) -> None:
    broken = tmp_path / "broken.nc"
    broken.write_bytes(b"broken")

    result = run(*files, str(broken), "--around", AROUND, "--edge", "half_maximum", "--output", str(tmp_path / "a.csv"))

    assert result.exit_code == 1
    assert "Left out:" in result.output
    assert pd.read_csv(tmp_path / "a.csv", comment="#")["observatory"].nunique() == 3

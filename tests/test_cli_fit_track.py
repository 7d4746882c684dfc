"""``bella fit-track`` as a user meets it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from typer.testing import CliRunner

from bella.arrivals import arrivals_csv, check_arrivals, read_arrivals, write_covariance
from bella.bursts import published_arrivals
from bella.cli import app
from bella.exceptions import BellaError, InputError

COLUMNS = ["q2_5", "q16", "q50", "q84", "q97_5", "mean", "sd", "contraction"]


def fit_track(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["fit-track", *map(str, arguments)], env={"COLUMNS": "200"})


def refused(*arguments: str | Path) -> str:
    """The one line that a user reads."""
    result = fit_track(*arguments)
    assert isinstance(result.exception, BellaError), (result.exception, result.output)
    assert isinstance(result.exception, InputError)
    assert "\n" not in str(result.exception)
    return str(result.exception)


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """Every fourth frequency of the burst of 2012-06-07."""
    path = tmp_path / "arrivals.csv"
    frame = check_arrivals(published_arrivals())
    some = sorted(frame["frequency_mhz"].unique())[::4]
    path.write_text(arrivals_csv(frame[frame["frequency_mhz"].isin(some)]))
    return path


def read(path: Path) -> dict[str, Any]:
    track: dict[str, Any] = json.loads(path.read_text())
    return track


def test_fit_of_the_published_burst(table: Path, tmp_path: Path) -> None:
    """The paper draws a spiral from 30 degrees at 400 km/s, with 24.47 d."""
    output = tmp_path / "track.json"
    result = fit_track(table, "--output", output, "--preset", "bella-2024", "--rotation", "24.47")
    assert result.exit_code == 0, result.output
    track = read(output)
    assert (track["frame"], track["rotation_period_d"]) == ("HEE", 24.47)
    assert track["remark"] == "apparent source: not corrected for scattering"
    joint, line = track["joint"], track["two_step"]
    assert abs(joint["phi0_deg"]["mean"] - 30.0) < 2 * joint["phi0_deg"]["sd"]
    assert abs(joint["v_sw_km_s"]["mean"] - 400.0) < 2 * joint["v_sw_km_s"]["sd"]
    # a line through positions on a smooth t(f) claims far smaller errors than the arrival times allow
    assert joint["v_sw_km_s"]["sd"] > 5 * line["v_sw_km_s"]["sd"]
    for name in ("phi0_deg", "v_sw_km_s", "beam_speed_c"):
        assert list(joint[name]) == COLUMNS
    assert list(joint["release_utc"]) == COLUMNS[:-1]
    assert joint["release_utc"]["q50"].startswith("2012-06-07T19:2")
    assert {"model", "ess", "flags"} <= set(joint)
    assert {path.name for path in tmp_path.iterdir()} == {"arrivals.csv", "track.json"}
    assert "solar wind" in result.output


def test_json_is_what_the_file_holds(table: Path, tmp_path: Path) -> None:
    result = fit_track(table, "--output", tmp_path / "track.json", "--json")
    assert json.loads(result.stdout) == read(tmp_path / "track.json")


def test_the_delay_aside_is_an_option(table: Path, tmp_path: Path) -> None:
    for name, kappa in (("none", "none"), ("large", "0.3,0.05")):
        assert fit_track(table, "--output", tmp_path / name, "--kappa", kappa).exit_code == 0
    none, large = (read(tmp_path / name)["joint"]["noise"]["kappa"]["mean"] for name in ("none", "large"))
    assert none == 0.0
    assert large == pytest.approx(0.3, abs=0.1)


def test_models_with_laws_are_weighed(table: Path, tmp_path: Path) -> None:
    result = fit_track(table, "--output", tmp_path / "track.json", "--compare")
    rows = read(tmp_path / "track.json")["companions"]["models"]["rows"]
    assert len({row["name"] for row in rows}) == len(rows) == 6
    assert {len(row["winds"]) for row in rows} == {0, 2}
    assert sum(row["probability"] for row in rows) == pytest.approx(1.0)
    assert [row["log_bayes_factor"] for row in rows] == sorted((row["log_bayes_factor"] for row in rows), reverse=True)
    assert result.output.count("probability") == 6


def test_directions_and_a_measured_wind_are_fitted_as_well(table: Path, tmp_path: Path) -> None:
    """The published track, 30 degrees and 400 km/s, seen from STEREO-A at two frequencies, 20 degrees beside it."""
    angles = tmp_path / "directions.csv"
    angles.write_text(
        "# HEE\nobservatory,frequency_mhz,azimuth_deg,colatitude_deg,sigma_deg\n"
        "STEREO-A,0.3,-63,90,3\nSTEREO-A,0.5,-63,90,3\n"
    )
    options = ("--directions", angles, "--wind", "390,25", "--directions-floor", "4")
    result = fit_track(table, "--output", tmp_path / "track.json", "--preset", "bella-2024", *options)
    assert result.exit_code == 0, result.output
    track = read(tmp_path / "track.json")
    ingredients = track["companions"]["fused"]["ingredients"]
    assert [one["name"] for one in ingredients] == ["wave_directions", "wind_prior"]
    assert ingredients[1]["sd_ratio"]["v_sw_km_s"] < 0.9
    assert result.output.count("tension") == 2
    # a wind that acts on the true spiral leaves the apparent one faster by the ratio of the distances
    scaled = fit_track(
        table, "--output", tmp_path / "scaled.json", "--preset", "bella-2024", "--wind", "390,25,1.6,0.1"
    )
    assert scaled.exit_code == 0, scaled.output
    apparent = read(tmp_path / "scaled.json")["companions"]["fused"]["v_sw_km_s"]
    assert apparent["q50"] > track["companions"]["fused"]["v_sw_km_s"]["q50"] + 50


def test_a_full_covariance_of_the_rows_is_taken(table: Path, tmp_path: Path) -> None:
    """The same noise written out gives the same track; with other errors it gives another."""
    frame = read_arrivals(table)
    variance = np.diag(frame["sigma_s"].to_numpy() ** 2)
    for name, covariance in (("same", variance), ("wide", 16 * variance)):
        write_covariance(covariance, tmp_path / f"{name}.nc")
        options = ("--covariance", tmp_path / f"{name}.nc")
        assert fit_track(table, "--output", tmp_path / f"{name}.json", *options).exit_code == 0
    same, wide = (read(tmp_path / f"{name}.json")["joint"] for name in ("same", "wide"))
    assert wide["chi2"] < 0.5 * same["chi2"]
    write_covariance(np.eye(3), tmp_path / "few.nc")
    assert "give those of one run" in refused(table, "--output", tmp_path / "x", "--covariance", tmp_path / "few.nc")


def test_a_table_of_three_frequencies_has_no_joint_fit(table: Path, tmp_path: Path) -> None:
    frame = check_arrivals(published_arrivals())
    few = sorted(frame["frequency_mhz"].unique())[:3]
    table.write_text(arrivals_csv(frame[frame["frequency_mhz"].isin(few)]))
    result = fit_track(table, "--output", tmp_path / "track.json")
    assert result.exit_code == 0
    joint = read(tmp_path / "track.json")["joint"]
    assert joint["flags"] == ["too_few_frequencies"]
    assert joint["v_sw_km_s"] == dict.fromkeys(COLUMNS)
    assert "too_few_frequencies" in result.output


def test_frequencies_that_no_three_share_have_a_joint_fit_only(table: Path, tmp_path: Path) -> None:
    frame = check_arrivals(published_arrivals())
    frequencies = sorted(frame["frequency_mhz"].unique())
    names = list(frame["observatory"].unique())
    silent = {frequency: names[i % 3] for i, frequency in enumerate(frequencies)}
    gaps = frame[frame["observatory"] != frame["frequency_mhz"].map(silent)]
    table.write_text(arrivals_csv(gaps))
    assert fit_track(table, "--output", tmp_path / "track.json").exit_code == 0
    track = read(tmp_path / "track.json")
    assert track["two_step"]["flags"] == ["too_few_positions"]
    assert abs(track["joint"]["phi0_deg"]["q50"] - 30.0) < 10.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--kappa", "wide"), "write 0.1,0.12"),
        (("--kappa", "0.1"), "give 2 numbers"),
        (("--kappa", "0.1,-1"), "a deviation between 0 and 2"),
        (("--rotation", "0"), "25.38"),
        (("--wind", "400"), "give 2 or 4 numbers"),
        (("--wind", "40,5"), "between 100 and 3000"),
        (("--covariance", "none.nc"), "none.nc does not exist"),
        (("--directions", "none.csv"), "none.csv does not exist"),
        (("--directions-floor", "-1"), "give degrees"),
        (("--preset", "none-such"), "choose one of"),
    ],
)
def test_bad_options_are_one_line(table: Path, tmp_path: Path, options: tuple[str, str], words: str) -> None:
    assert words in refused(table, "--output", tmp_path / "track.json", *options)
    assert not (tmp_path / "track.json").exists()


def test_files_that_cannot_be_read_or_written_are_one_line(table: Path, tmp_path: Path) -> None:
    assert "does not exist" in refused(tmp_path / "none.csv", "--output", tmp_path / "track.json")
    assert "does not exist" in refused(table, "--output", tmp_path / "none" / "track.json")
    assert "is a folder" in refused(table, "--output", tmp_path)

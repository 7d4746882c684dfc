"""``bella fit-track`` as a user meets it."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from typer.testing import CliRunner

from bella.arrivals import arrivals_csv, check_arrivals
from bella.bursts import published_arrivals
from bella.cli import app
from bella.exceptions import BellaError, InputError

COLUMNS = ["mean", "sd", "q2_5", "q16", "q50", "q84", "q97_5", "contraction"]


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
    for name in ("phi0_deg", "v_sw_km_s", "beam_speed_c", "release_utc"):
        assert list(joint[name]) == COLUMNS
    assert joint["release_utc"]["mean"].startswith("2012-06-07T19:2")
    assert {"model", "ess", "flags"} <= set(joint)
    assert {path.name for path in tmp_path.iterdir()} == {"arrivals.csv", "track.json"}
    assert "solar wind, km/s" in result.output


def test_json_is_what_the_file_holds(table: Path, tmp_path: Path) -> None:
    result = fit_track(table, "--output", tmp_path / "track.json", "--json")
    assert json.loads(result.stdout) == read(tmp_path / "track.json")


def test_prior_of_the_longitude_and_offsets_are_options(table: Path, tmp_path: Path) -> None:
    none = ("--common-sigma", "0")
    cases = {"plain": none, "far": (*none, "--phi0-prior", "-60,30"), "offset": ("--common-sigma", "60")}
    for name, options in cases.items():
        assert fit_track(table, "--output", tmp_path / name, *options).exit_code == 0
    plain, far, offset = (read(tmp_path / name)["joint"]["phi0_deg"] for name in ("plain", "far", "offset"))
    assert far["contraction"] > 1.5 * plain["contraction"]
    assert offset["sd"] > 2 * plain["sd"]


def test_variants_are_weighed(table: Path, tmp_path: Path) -> None:
    result = fit_track(table, "--output", tmp_path / "track.json", "--compare", "--two-slope")
    track = read(tmp_path / "track.json")
    assert track["joint"]["model"] == "joint spiral, two slopes"
    assert "b2" in track["joint"]
    assert len({one["model"] for one in track["models"]}) == 12
    assert {len(one.get("segments", [0])) for one in track["models"]} == {1, 2, 3}
    assert sum(one["probability"] for one in track["models"]) == pytest.approx(1.0)
    assert result.output.count("probability") == 12


def test_directions_and_a_known_wind_are_fitted_as_well(table: Path, tmp_path: Path) -> None:
    """The published track, 30 degrees and 400 km/s, seen from STEREO-A at two frequencies, 20 degrees beside it."""
    angles = tmp_path / "directions.csv"
    angles.write_text(
        "# HEE\nobservatory,frequency_mhz,azimuth_deg,colatitude_deg,sigma_deg\n"
        "STEREO-A,0.3,-63,90,3\nSTEREO-A,0.5,-63,90,3\n"
    )
    options = ("--directions", angles, "--wind-prior", "390,25", "--directions-floor", "4", "--no-fallback")
    result = fit_track(table, "--output", tmp_path / "track.json", "--preset", "bella-2024", *options)
    assert result.exit_code == 0, result.output
    joint = read(tmp_path / "track.json")["joint"]
    assert [one["name"] for one in joint["ingredients"]] == ["arrival_times", "wave_directions", "wind_prior"]
    assert joint["ingredients"][2]["sd_ratio"]["v_sw_km_s"] < 0.9
    assert result.output.count("tension") == 3
    assert joint["sampler"] == "importance"


def test_offsets_that_no_table_declares_are_assumed_and_said(table: Path, tmp_path: Path) -> None:
    result = fit_track(table, "--output", tmp_path / "track.json")
    joint = read(tmp_path / "track.json")["joint"]
    assert sorted(joint["common_sd_assumed"]) == sorted(joint["common_sd_s"]) == ["STEREO-A", "STEREO-B", "WIND"]
    assert min(joint["common_sd_s"].values()) >= 2.0
    assert "Assume an offset" in result.output
    fit_track(table, "--output", tmp_path / "track.json", "--common-sigma", "0")
    assert read(tmp_path / "track.json")["joint"]["common_sd_assumed"] == []


def test_a_table_of_three_frequencies_has_no_joint_fit(table: Path, tmp_path: Path) -> None:
    frame = check_arrivals(published_arrivals())
    few = sorted(frame["frequency_mhz"].unique())[:3]
    table.write_text(arrivals_csv(frame[frame["frequency_mhz"].isin(few)]))
    result = fit_track(table, "--output", tmp_path / "track.json")
    assert result.exit_code == 0
    joint = read(tmp_path / "track.json")["joint"]
    assert joint["flags"] == ["too_few_frequencies"]
    assert joint["v_sw_km_s"] == dict.fromkeys(COLUMNS)


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
    assert abs(track["joint"]["phi0_deg"]["mean"] - 30.0) < 10.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--phi0-prior", "30"), "write 0,60"),
        (("--phi0-prior", "0,0"), "a deviation between 1 and 180"),
        (("--phi0-prior", "nan,60"), "a centre within 360"),
        (("--common-sigma", "-1"), "give seconds"),
        (("--rotation", "0"), "25.38"),
        (("--wind-prior", "400"), "write 390,25"),
        (("--wind-prior", "40,5"), "between 100 and 3000"),
        (("--directions", "none.csv"), "cannot be read"),
        (("--directions-floor", "-1"), "give degrees"),
        (("--preset", "none-such"), "choose one of"),
    ],
)
def test_bad_options_are_one_line(table: Path, tmp_path: Path, options: tuple[str, str], words: str) -> None:
    assert words in refused(table, "--output", tmp_path / "track.json", *options)
    assert not (tmp_path / "track.json").exists()


def test_files_that_cannot_be_read_or_written_are_one_line(table: Path, tmp_path: Path) -> None:
    assert "cannot be read" in refused(tmp_path / "none.csv", "--output", tmp_path / "track.json")
    assert "does not exist" in refused(table, "--output", tmp_path / "none" / "track.json")
    assert "is a folder" in refused(table, "--output", tmp_path)

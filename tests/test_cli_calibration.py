"""``bella calibrate`` as a user meets it."""

import os
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bella.calibration import parse_verdicts, study
from bella.calibration.found_table import parse_found
from bella.cli import app
from bella.exceptions import BellaError, InputError


def calibrate(folder: Path, *arguments: str) -> tuple[int, str, BaseException | None]:
    result = CliRunner().invoke(app, ["calibrate", "--output", str(folder), *arguments])
    return result.exit_code, result.output, result.exception


def test_table_page_and_figure(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    code, text, _ = calibrate(folder, "--sources", "40", "--strata", "wide, outlier")
    assert code == 0, text
    assert "1 of 1 strata are calibrated" in text
    assert sorted(path.name for path in folder.iterdir()) == ["calibration.csv", "calibration.md", "calibration.png"]
    assert (folder / "calibration.png").read_bytes().startswith(b"\x89PNG")
    assert "bella calibrate --sources 40 --seed 1" in (folder / "calibration.md").read_text()
    verdicts = parse_verdicts((folder / "calibration.csv").read_text())
    assert [(one.stratum, one.passed, one.sources) for one in verdicts] == [("wide", True, 40), ("outlier", False, 40)]


def test_failing_strata_are_named_after_everything_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ranks = study.fractional_ranks
    monkeypatch.setattr(study, "fractional_ranks", lambda *given: ranks(*given) ** 3)
    _, _, error = calibrate(tmp_path, "--sources", "100", "--strata", "wide,four")
    assert isinstance(error, BellaError)
    assert error.exit_code == 1
    assert str(error) == f"not calibrated: wide, four; see {tmp_path / 'calibration.md'}"
    assert not np.any([one.passed for one in parse_verdicts((tmp_path / "calibration.csv").read_text())])
    assert (tmp_path / "calibration.png").exists()


def test_found_bursts_have_a_table_and_a_page(tmp_path: Path) -> None:
    code, text, _ = calibrate(tmp_path, "--found", "--bursts", "1", "--strata", "far side", "--seed", "2")
    assert code == 0, text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["calibration-found.csv", "calibration-found.md"]
    rows = parse_found((tmp_path / "calibration-found.csv").read_text())
    assert {one.fleet for one in rows} == {"2012", "2021", "pair"}
    assert {one.simulated for one in rows} == {1}
    answers = sum(one.answers for one in rows if (one.stratum, one.quantity) == ("far side", "phi0"))
    assert f"{answers} of 3 bursts have an answer" in text
    assert "--found --bursts 1 --seed 2" in (tmp_path / "calibration-found.md").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--found", "--bursts", "0"], "0 bursts per stratum is not between 1 and 1000"),
        (["--found", "--strata", "wide"], "stratum 'wide' is not known; choose among clean,"),
        (["--found", "--workers", "0"], "0 workers can do nothing; give 1 or more"),
        (["--sources", "19"], "19 sources say nothing about calibration; give --sources 20 or more"),
        (["--strata", "far"], "stratum 'far' is not known"),
        (["--strata", ""], "stratum '' is not known"),
        (["--seed", "-1"], "--seed -1 is below 0"),
    ],
)
def test_bad_options_are_one_line(tmp_path: Path, arguments: list[str], message: str) -> None:
    folder = tmp_path / "none"
    _, _, error = calibrate(folder, *arguments)
    assert isinstance(error, InputError)
    assert str(error).startswith(message)
    assert "\n" not in str(error)
    assert not folder.exists()


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.write_text("")
    _, _, error = calibrate(taken, "--sources", "20", "--strata", "wide")
    assert isinstance(error, InputError)
    assert "cannot be written" in str(error)


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes everywhere")
def test_a_folder_that_may_not_be_written_to(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    _, _, error = calibrate(tmp_path, "--sources", "20", "--strata", "wide")
    tmp_path.chmod(0o700)
    assert isinstance(error, InputError)

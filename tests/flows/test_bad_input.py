"""Bad input ends in one line that says what to do, with the right exit status and nothing touched."""

import json
from pathlib import Path

import pytest

from tests.commands import Sandbox

HEADING = "observatory,frequency_mhz,arrival_utc,sigma_s,edge\n"
GOOD = HEADING + "".join(
    f"{name},{frequency},2012-06-07T19:{minute}:00Z,10,peak\n"
    for frequency in (0.5, 1.0)
    for name, minute in (("WIND", 31), ("STEREO-A", 32), ("STEREO-B", 33))
)


def one_line(text: str) -> str:
    assert text.startswith("bella: "), text
    assert text.count("\n") == 1, text
    return text


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (GOOD.replace("sigma_s", "sigma"), ("column sigma_s is missing",)),
        (GOOD.replace(",10,", ",nan,", 1), ("row 1", "sigma_s", "not a number")),
        (GOOD.replace(",10,", ",0,", 1), ("row 1", "sigma_s", "not above 0")),
        (GOOD + "WIND,0.5,2012-06-07T19:31:00Z,10,peak\n", ("row 7", "frequency_mhz", "twice")),
        (GOOD.replace("WIND", "VOYAGER"), ("row 1", "observatory", "VOYAGER", "x_rsun")),
        (GOOD.replace("STEREO-B", "STEREO-A").replace("0.5", "0.4", 1), ("row",)),
        (GOOD.replace("2012-06-07T19:31", "2012-06-08T19:31", 1), ("row 1", "arrival_utc", "one burst")),
    ],
)
def test_bad_table_is_refused_in_one_line(sandbox: Sandbox, table: str, words: tuple[str, ...]) -> None:
    path = sandbox.elsewhere[1] / "arrivals.csv"
    path.write_text(table)
    output = sandbox.elsewhere[1] / "localisations.csv"
    done = sandbox.here("localise", str(path), "--output", str(output), code=2)
    line = one_line(done.stderr.splitlines(keepends=True)[-1])
    for word in words:
        assert word in line
    assert "Traceback" not in done.stderr
    assert not output.exists()
    assert not sandbox.home.exists()


def test_localise_writes_table_and_draws(sandbox: Sandbox) -> None:
    folder = sandbox.elsewhere[1]
    (folder / "arrivals.csv").write_text(GOOD)
    arguments = [
        str(folder / "arrivals.csv"),
        "--output",
        str(folder / "out.csv"),
        "--draws",
        str(folder / "draws.zarr"),
    ]
    sandbox.here("localise", *arguments)
    lines = (folder / "out.csv").read_text().splitlines()
    heading = next(line for line in lines if not line.startswith("#"))
    assert heading.startswith("frequency_mhz,x_rsun,y_rsun,z_rsun,cov_xx_rsun2")
    assert len([line for line in lines if not line.startswith("#")]) == 3
    assert {path.name for path in folder.iterdir()} == {"arrivals.csv", "out.csv", "draws.zarr"}
    again = sandbox.here("localise", *arguments, code=2)
    assert "never overwritten" in one_line(again.stderr)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("--event", "2013-01-01"), "2012-06-07"),
        (("--preset", "nonsense"), "bella-2024"),
        (("--method", "magic"), "posterior"),
    ],
)
def test_unknown_choice_is_refused_before_anything_starts(
    sandbox: Sandbox, arguments: tuple[str, ...], word: str
) -> None:
    done = sandbox.here("run", *arguments, code=2)
    assert word in one_line(done.stderr)
    assert not sandbox.home.exists()


def test_foreign_file_in_place_of_the_catalogue_is_left_alone(sandbox: Sandbox) -> None:
    sandbox.home.mkdir()
    path = sandbox.home / "catalogue.sqlite"
    path.write_bytes(b"this is a letter to my aunt\n" * 200)
    before = path.read_bytes()
    done = sandbox.here("run", code=1)
    assert "bella: " in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert path.read_bytes() == before
    assert not (sandbox.home / "prefect" / "prefect.db").exists(), "refused before Prefect is started"


def test_missing_catalogue_says_how_to_make_one(sandbox: Sandbox) -> None:
    done = sandbox.here("status", code=1)
    assert "bella run" in one_line(done.stderr)


def test_read_only_home_is_one_line(sandbox: Sandbox, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    done = sandbox.here("run", "--home", str(blocked / "home"), code=2)
    assert "home" in one_line(done.stderr)


def test_a_log_that_cannot_be_written_is_one_line(sandbox: Sandbox) -> None:
    (sandbox.home / "logs" / "bella.log").mkdir(parents=True)  # as on a disk that became read-only, for root too
    done = sandbox.here("run", code=1)
    assert "bella.log cannot be written" in one_line(done.stderr)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--to", "2021-02-01"), "need a first one"),
        (("--from", "2021-02-02", "--to", "2021-02-01"), "exchange them"),
        (("--from", "2021-02-01", "--archive", "nowhere"), "neither an http(s) URL nor a folder"),
        (("--from", "2021-02-01", "--preset", "best"), "preset"),
        (("--workers", "0"), "--workers"),
    ],
)
def test_bad_options_of_a_run_are_refused_in_one_line(
    sandbox: Sandbox, arguments: tuple[str, ...], message: str
) -> None:
    done = sandbox.here("run", *arguments, code=2)
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_days_that_the_archive_did_not_answer_for_fail_the_run(sandbox: Sandbox) -> None:
    """With Prefect: `tests.flows.test_flows`."""
    moved = sandbox.elsewhere[1] / "archive"  # none of the folders of the data sets is there any more
    moved.mkdir()
    done = sandbox.here("run", "--direct", "--from", "2021-02-01", "--archive", str(moved), "--json", code=1)
    (day,) = json.loads(done.stdout)
    assert (day["state"], day["answer"]) == ("archive silent", "archive silent")
    assert "WI_H1_WAV" in day["message"]
    assert done.stderr.splitlines()[-1].startswith("bella: 1 of 1 day is not done: 2021-02-01")
    assert "Traceback" not in done.stderr

"""``bella fetch`` as a user meets it."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from typer.testing import CliRunner

from bella.cli import app
from bella.exceptions import InputError, UnreachableError
from tests.archive.server import H1, STEREO, Server, cdf, path_of, status
from tests.commands import Sandbox

DAY = ("--from", "2012-06-07", "--to", "2012-06-07")
TWO_DAYS = ("--from", "2012-06-07", "--to", "2012-06-08")
CHOSEN = ("--dataset", "WI_H1_WAV", "--dataset", "stereo_level2_swaves")


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """A folder with both days of STEREO and the first of Wind."""
    root = tmp_path / "archive"
    for path in (path_of(H1), path_of(STEREO), path_of(STEREO).replace("0607", "0608")):
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_bytes(cdf())
    return root


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    monkeypatch.setenv("BELLA_ARCHIVE_INTERVAL_S", "0.001")
    with Server() as running:
        yield running


def fetch(tmp_path: Path, *arguments: str | Path) -> Result:
    home = ("--home", str(tmp_path / "home"))
    return CliRunner().invoke(app, ["fetch", *map(str, arguments), *home], env={"COLUMNS": "200"})


def rows(result: Result) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(result.stdout)
    return found


def test_table_of_states(tmp_path: Path, archive: Path) -> None:
    result = fetch(tmp_path, *TWO_DAYS, *CHOSEN, "--archive", archive)
    assert result.exit_code == 0, result.output
    text = " ".join(result.stdout.split())  # the width of the console is that of whoever runs the tests
    assert f"WI_H1_WAV 2012-06-07 fetched wi_h1_wav_20120607_v01.cdf, {len(cdf()) / 1e6:.2f} MB" in text
    assert "WI_H1_WAV 2012-06-08 no file yet usually there on 2012-06-24" in text
    assert "3 fetched, 1 no file yet" in text
    assert (tmp_path / "home" / "mirror" / path_of(H1)).read_bytes() == cdf()


def test_json_again_and_again(tmp_path: Path, archive: Path) -> None:
    first, second = (rows(fetch(tmp_path, *TWO_DAYS, *CHOSEN, "--archive", archive, "--json")) for _ in range(2))
    assert [row["state"] for row in first] == ["fetched", "no_file_yet", "fetched", "fetched"]
    assert [row["state"] for row in second] == ["unchanged", "no_file_yet", "unchanged", "unchanged"]
    assert first[0]["files"][0]["sha256"] == second[0]["files"][0]["sha256"]
    assert (second[1]["due"], second[1]["files"]) == ("2012-06-24", [])
    assert second[2]["observatories"] == ["STEREO-A", "STEREO-B"]


def test_all_data_sets_of_the_day_by_default(tmp_path: Path, archive: Path) -> None:
    result = fetch(tmp_path, *DAY, "--archive", archive, "--json")
    states = {row["dataset"]: row["state"] for row in json.loads(result.stdout)}
    assert states["STEREO_LEVEL2_SWAVES"] == "fetched"
    assert states["STB_L3_WAV_HFR"] == "no_folder"
    assert not any(key.startswith(("PSP", "SOLO")) for key in states)
    assert result.exit_code == 1
    assert isinstance(result.exception, UnreachableError)


def test_archive_down_is_exit_1_and_the_table_says_so(tmp_path: Path, server: Server) -> None:
    server.put(path_of(STEREO), cdf())
    server.faults[server.put(path_of(H1), cdf())] = [status(403)] * 9
    result = fetch(tmp_path, *DAY, *CHOSEN, "--archive", server.url)
    assert "1 unreachable, 1 fetched" in result.stdout
    assert isinstance(result.exception, UnreachableError)
    message = str(result.exception)
    assert message.startswith("1 of 2 not fetched, run it again later: ")
    assert "\n" not in message


def test_the_setting_names_the_archive(tmp_path: Path, server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    server.put(path_of(H1), cdf())
    monkeypatch.setenv("BELLA_ARCHIVE", server.url)
    assert rows(fetch(tmp_path, *DAY, "--dataset", "WI_H1_WAV", "--json"))[0]["state"] == "fetched"


BAD_OPTIONS = {
    "no day": (("--from", "yesterday", "--to", "2012-06-07"), "--from: 'yesterday' is not a day"),
    "time": (("--from", "2012-06-07", "--to", "2012-06-07T10:00"), "--to: '2012-06-07T10:00' is not a day"),
    "backwards": (("--from", "2012-06-08", "--to", "2012-06-07"), "exchange them"),
    "too many": (("--from", "1995-01-01", "--to", "2012-06-07"), "take them in parts"),
    "data set": ((*DAY, "--dataset", "WI_H9"), "'WI_H9' is not known; choose from"),
    "archive": ((*DAY, "--archive", "nowhere"), "neither an http(s) URL nor a folder"),
}


@pytest.mark.parametrize("name", BAD_OPTIONS)
def test_bad_options_are_refused_in_one_line(name: str, tmp_path: Path) -> None:
    options, reason = BAD_OPTIONS[name]
    result = fetch(tmp_path, *options)
    assert isinstance(result.exception, InputError), result.output
    assert reason in str(result.exception)
    assert "\n" not in str(result.exception)
    assert not (tmp_path / "home").exists()


def test_as_a_process(tmp_path: Path, archive: Path) -> None:
    sandbox = Sandbox.within(tmp_path / "sandbox")

    def run(*arguments: str, code: int = 0) -> "subprocess.CompletedProcess[str]":
        command = (sys.executable, "-m", "bella.cli", "fetch", *DAY, *arguments)
        return sandbox.run(*command, code=code, PYTHONPATH=str(Path(__file__).parents[1]))

    done = run(*CHOSEN, "--archive", str(archive), "--json")
    assert {row["state"] for row in json.loads(done.stdout)} == {"fetched"}
    assert sandbox.files_elsewhere() == []
    down = run("--archive", str(tmp_path / "sandbox"), "--json", code=1)
    assert down.stderr.splitlines()[-1].startswith("bella: ")
    assert json.loads(down.stdout)
    assert run("--archive", "nowhere", code=2).stderr.startswith("bella: archive 'nowhere'")

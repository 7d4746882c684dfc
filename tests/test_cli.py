"""The command line as a newcomer meets it: help, examples, and errors of one line."""

import json
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from bella.cli import app
from bella.cli.output import new_table, show, talk
from tests.commands import Sandbox

README = Path(__file__).parents[1] / "README.md"
MAKEFILE = Path(__file__).parents[1] / "Makefile"
COMMANDS = [
    ["run"],
    ["localise"],
    ["fit-track"],
    ["coverage"],
    ["calibrate"],
    ["ephemeris"],
    ["update-ephemeris"],
    ["formats"],
    ["fetch"],
    ["simulate"],
    ["detect"],
    ["arrivals"],
    ["serve"],
    ["status"],
    ["catalogue", "list"],
    ["catalogue", "show"],
    ["catalogue", "prefer"],
    ["catalogue", "retract"],
    ["prune"],
    ["store", "verify"],
    ["token", "create"],
    ["token", "list"],
    ["token", "revoke"],
    ["webhook", "add"],
    ["webhook", "list"],
    ["webhook", "deliver"],
    ["webhook", "remove"],
]


def printed(*arguments: str) -> str:
    result = CliRunner().invoke(app, list(arguments), env={"COLUMNS": "120"})
    assert result.exit_code == 0, result.output
    return result.output


def test_help_names_every_command_and_where_to_start() -> None:
    text = printed("--help")
    for command in {first for first, *_ in COMMANDS}:
        assert command in text
    assert "Start with: bella run" in text


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_every_command_has_help_with_an_example(command: list[str]) -> None:
    text = printed(*command, "--help")
    assert "Example: bella " + " ".join(command) in re.sub(r"\s+", " ", text)


def test_every_option_says_what_it_is() -> None:
    group = typer.main.get_command(app)
    commands = dict(group.commands)  # type: ignore[attr-defined]
    for name in ("catalogue", "token", "webhook", "store"):
        commands |= commands.pop(name).commands
    for name, command in commands.items():
        for option in command.params:
            if option.name not in {"help", "limit", "burst_id"}:
                assert getattr(option, "help", None), f"{name}: {option.name} has no help"


def test_ephemeris_as_json() -> None:
    rows = {row["observatory"]: row for row in json.loads(printed("ephemeris", "2012-06-07T19:30", "--json"))}
    assert rows["STEREO-A"]["longitude_deg"] == pytest.approx(116.81, abs=0.01)
    assert math.hypot(rows["STEREO-B"]["x_rsun"], rows["STEREO-B"]["y_rsun"]) == pytest.approx(215.3, abs=0.5)
    assert "PSP" not in rows


@pytest.mark.parametrize("utc", ["yesterday", "2012-13-01", ""])
def test_bad_time_is_one_line(utc: str, tmp_path: Path) -> None:
    done = Sandbox.within(tmp_path).here("ephemeris", utc, code=2)
    assert done.stderr.startswith("bella: ")
    assert done.stderr.count("\n") == 1


def test_importing_the_command_line_starts_nothing_heavy() -> None:
    heavy = {"prefect", "pymc", "fastapi", "xarray", "matplotlib"}
    code = f"import sys, bella.cli; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_readme_names_words_that_make_knows() -> None:
    targets = set(re.findall(r"^([a-z]+):", MAKEFILE.read_text(), re.MULTILINE))
    used = set(re.findall(r"make ([a-z]+)", README.read_text()))
    assert {"demo", "test", "serve", "docs"} <= used <= targets


def test_readme_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", README.read_text()):
        assert (README.parent / target).is_file(), target


def test_a_narrow_terminal_cuts_no_word(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    table = new_table("", "burst", "flags", left=("burst", "flags"), whole=("burst",))
    table.add_row("T3-20120607-1929", "v_sw_not_constrained")
    monkeypatch.setattr(talk, "_width", 20)
    show(table)
    printed_rows = capsys.readouterr().out
    assert "T3-20120607-1929" in printed_rows
    assert re.sub(r"\s", "", printed_rows).endswith("v_sw_not_constrained")

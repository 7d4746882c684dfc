"""The history of figures of speed: well formed, added to, and a slower release is seen."""

import shutil
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest

from bella.exceptions import InputError
from benchmarks import history
from benchmarks.history import FILE, Figure, append, figures_of, read, slower

DAY = date(2026, 11, 29)
TIME = Figure("a track", 0.5, "s", "0.2.0", "a" * 10, DAY)


def test_the_history_is_well_formed_and_by_time() -> None:
    known = read()
    assert len(known) > 10
    days = [one.day for one in known]
    assert days == sorted(days)
    assert len({(one.figure, one.commit) for one in known}) == len(known)


def test_rows_of_the_table_become_figures() -> None:
    rows = [("a track", "0.50 s", "1 s"), ("moments", "1.5 ms", ""), ("ratio", "64", ""), ("said", "two to three", "")]
    found = figures_of(rows, TIME.commit, DAY)
    assert [(one.figure, one.value, one.unit) for one in found] == [
        ("a track", 0.5, "s"),
        ("moments", pytest.approx(0.0015), "s"),
        ("ratio", 64.0, ""),
    ]


def test_what_is_added_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "history.csv"
    append([TIME], file)
    append([replace(TIME, figure="with a comma, in it", value=1.23456)], file)
    assert read(file) == [TIME, replace(TIME, figure="with a comma, in it", value=1.235)]


def test_a_slower_release_is_seen_and_nothing_else() -> None:
    known = [replace(TIME, value=0.1), replace(TIME, commit="b" * 10, version="0.2.1")]
    now = replace(TIME, commit="c" * 10, version="0.3.0")
    assert slower(known, [replace(now, value=1.0)]) == ["a track: 2.0 times slower than 0.2.1 (bbbbbbbbbb, 2026-11-29)"]
    assert slower(known, [replace(now, value=0.6), replace(now, figure="new", value=9.0)]) == []
    assert slower([replace(TIME, unit="")], [replace(now, unit="", value=9.0)]) == []
    assert slower([replace(now, value=0.1)], [now]) == [], "the same commit, measured again"
    again = replace(known[0], value=0.6)
    assert slower([*known, again], [replace(now, value=0.7)]) == [], "an earlier commit that was measured last"


@pytest.mark.parametrize(
    "row",
    [
        "a,fast,s,0.2.0,aaaaaaaaaa,2026-11-29",
        "a,1,days,0.2.0,aaaaaaaaaa,2026-11-29",
        "a,0,s,0.2.0,aaaaaaaaaa,2026-11-29",
        "a,1,s,0.2.0,main,2026-11-29",
        "a,1,s,0.2.0,aaaaaaaaaa,yesterday",
        "a,1,s",
    ],
)
def test_a_bad_row_is_named(tmp_path: Path, row: str) -> None:
    file = tmp_path / "history.csv"
    append([TIME], file)
    with file.open("a") as text:
        text.write(f"{row}\n")
    with pytest.raises(InputError, match="line 3"):
        read(file)
    file.write_text("x,y\n")
    with pytest.raises(InputError, match="columns"):
        read(file)


def test_the_table_is_noted_and_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "history.csv"
    shutil.copy(FILE, file)
    known = read(file)
    one = next(figure for figure in reversed(known) if figure.unit == "s")
    monkeypatch.setattr(history, "commit_here", lambda: "c" * 10)
    (line,) = history.note([(one.figure, f"{10 * one.value} s", "")], file, tmp_path / "plot.svg")
    assert line.startswith(f"{one.figure}: 10.0 times slower than {one.version}")
    assert len(read(file)) == len(known) + 1
    assert one.figure in (tmp_path / "plot.svg").read_text()

"""Every figure of speed by version: ``history.csv``, to which `make bench` adds, and its plot."""

import csv
import re
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from datetime import UTC, date, datetime
from pathlib import Path

import matplotlib.pyplot as plt

from bella import __version__
from bella.exceptions import InputError
from benchmarks.localisation import Row

FILE = Path(__file__).with_name("history.csv")
PLOT = Path(__file__).parents[1] / "docs" / "speed-history.svg"

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
RATIO = ""
UNITS = ("s", RATIO)
SLOWER = 1.3
"""Figures of CPU time differ by less from run to run, also where others use the machine."""

_VALUE = re.compile(r"(?P<number>\d+(\.\d+)?)(?: (?P<unit>s|ms|us))?")


@dataclass(frozen=True)
class Figure:
    """One figure of one version.

    Attributes
    ----------
    figure : str
        What was measured.
    value : float
    unit : {"s", ""}
        Time, or a ratio.
    version, commit : str
    day : datetime.date
    """

    figure: str
    value: float
    unit: str
    version: str
    commit: str
    day: date


def figures_of(rows: Iterable[Row], commit: str, day: date | None = None) -> list[Figure]:
    """Figures of rows of the table; rows without one number are left out."""
    found = []
    for name, measured, _ in rows:
        match = _VALUE.fullmatch(measured)
        if match:
            unit = match["unit"]
            value = float(match["number"]) * (SECONDS[unit] if unit else 1.0)
            day = day or datetime.now(UTC).date()
            found.append(Figure(name, value, "s" if unit else RATIO, __version__, commit, day))
    return found


def read(file: Path = FILE) -> list[Figure]:
    """Figures of the file, in the order in which they were measured.

    Raises
    ------
    InputError
        Where a row is not one of ours; its number is named.
    """
    with file.open(newline="", encoding="utf-8") as text:
        header, *rows = csv.reader(text)
    if header != [one.name for one in fields(Figure)]:
        raise InputError(f"{file.name} is not a history of figures: its columns are {', '.join(header)}")
    return [_figure(number, row) for number, row in enumerate(rows, 2)]


def _figure(number: int, row: Sequence[str]) -> Figure:
    try:
        name, value, unit, version, commit, day = row
        figure = Figure(name, float(value), unit, version, commit, date.fromisoformat(day))
    except ValueError as error:
        raise InputError(f"line {number} of the history of figures: {error}; correct it") from error
    if not (name and figure.value > 0 and unit in UNITS and version and re.fullmatch(r"[0-9a-f]{7,40}", commit)):
        raise InputError(f"line {number} of the history of figures: no figure, time, version or commit; correct it")
    return figure


def append(found: Iterable[Figure], file: Path = FILE) -> None:
    """Add figures to the file."""
    is_new = not file.exists()
    with file.open("a", newline="", encoding="utf-8") as text:
        writer = csv.writer(text, lineterminator="\n")
        if is_new:
            writer.writerow([one.name for one in fields(Figure)])
        writer.writerows((asdict(one) | {"value": f"{one.value:.4g}"}).values() for one in found)


def slower(known: Iterable[Figure], new: Sequence[Figure]) -> list[str]:
    """Lines about times that are longer than when they were measured last, at another commit."""
    own = {one.commit for one in new}
    last = {one.figure: one for one in known if one.commit not in own}
    lines = []
    for one in new:
        old = last.get(one.figure)
        if one.unit == "s" and old and one.value > SLOWER * old.value:
            times = one.value / old.value
            lines.append(f"{one.figure}: {times:.1f} times slower than {old.version} ({old.commit}, {old.day})")
    return lines


def draw(found: Sequence[Figure], file: Path = PLOT) -> None:
    """Plot every time against the commits, as a multiple of its first value."""
    commits = list(dict.fromkeys(one.commit for one in found))
    versions = {one.commit: f"{one.version}\n{one.commit}" for one in found}
    figure, axes = plt.subplots(figsize=(10, 6), layout="constrained")
    for name in dict.fromkeys(one.figure for one in found if one.unit == "s"):
        own = {one.commit: one.value for one in found if one.figure == name}
        first = next(iter(own.values()))
        places = [commits.index(one) for one in own]
        axes.plot(places, [value / first for value in own.values()], ".-", label=name)
    axes.set(yscale="log", ylabel="time, as a multiple of the first", xlabel="version and commit")
    axes.set_xticks(range(len(commits)), [versions[one] for one in commits])
    axes.legend(fontsize=6, loc="center left", bbox_to_anchor=(1.0, 0.5))
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": "bella"}):
        figure.savefig(file, metadata={"Date": None})
    plt.close(figure)


def commit_here() -> str:
    """Commit of the working copy."""
    command = ["git", "-C", str(FILE.parent), "rev-parse", "--short=10", "HEAD"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def note(rows: Iterable[Row], file: Path = FILE, plot: Path = PLOT) -> list[str]:
    """Add the rows of a table to the history, draw it, and say what became slower."""
    new, known = figures_of(rows, commit_here()), read(file)
    append(new, file)
    draw([*known, *new], plot)
    return slower(known, new)

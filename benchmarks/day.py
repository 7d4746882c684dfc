"""One simulated day from file to catalogue: the CPU time of each stage, beside what is necessary.

``python -m benchmarks.day`` prints it; `make bench` has the sums.
"""

import contextlib
import importlib
import io
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import cdflib
import numpy as np
from rich.console import Console
from rich.table import Table

from bella.cli.app import main as command
from bella.simulation.archive_days import simulate_days
from benchmarks.localisation import DRAWS, Row

FIRST = date(2021, 11, 20)
SEED = 3

STAGES = (
    ("find files, check their sums", "bella.pipeline.day_files", "Mirror.day"),
    ("read spectra", "bella.pipeline.day", "day_spectra"),
    ("search, associate", "bella.pipeline.run", "search_day"),
    ("time edges", "bella.pipeline.run", "timed_burst"),
    ("positions, 4000 draws", "bella.pipeline.burst", "_posterior"),
    ("joint track, 4000 draws", "bella.pipeline.burst", "fitted_track"),
    ("other methods beside it", "bella.pipeline.burst", "companions"),
    ("store spectra", "bella.pipeline.burst", "store_spectra"),
    ("store and publish solutions", "bella.pipeline.burst", "publish"),
    ("figures of bursts", "bella.pipeline.burst", "draw_burst"),
    ("figure of the day", "bella.pipeline.run", "draw_day"),
)
"""Words of a stage, and the function that does it where that is called."""

REST = "all else"


@dataclass
class Spent:
    """CPU time of a stage, s, without the stages inside of it, and how often it was called."""

    cpu_s: float = 0.0
    calls: int = 0


@contextmanager
def timed() -> Iterator[dict[str, Spent]]:
    """Measure the functions of `STAGES` while the block runs."""
    spent = {name: Spent() for name, _, _ in STAGES}
    inner: list[float] = []

    def _measured(function: Callable[..., Any], stage: Spent) -> Callable[..., Any]:
        def _call(*arguments: Any, **named: Any) -> Any:
            begin = time.process_time()
            inner.append(0.0)
            try:
                return function(*arguments, **named)
            finally:
                whole = time.process_time() - begin
                stage.cpu_s += whole - inner.pop()
                stage.calls += 1
                if inner:
                    inner[-1] += whole

        return _call

    replaced = []
    for name, module, path in STAGES:
        *owners, attribute = path.split(".")
        owner: Any = importlib.import_module(module)
        for one in owners:
            owner = getattr(owner, one)
        replaced.append((owner, attribute, getattr(owner, attribute)))
        setattr(owner, attribute, _measured(getattr(owner, attribute), spent[name]))
    try:
        yield spent
    finally:
        for owner, attribute, function in replaced:
            setattr(owner, attribute, function)


def profile(folder: Path, first: date = FIRST) -> dict[str, Spent]:
    """CPU time of every stage of one day of a simulated archive, run without Prefect in this process."""
    arguments = ["run", "--direct", "--from", f"{first}", "--to", f"{first}", "--archive", f"{folder}"]
    sys.argv = ["bella", *arguments, "--home", f"{folder.parent / 'home'}"]
    begin = time.process_time()
    with timed() as spent, contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        command()
    whole = time.process_time() - begin
    spent[REST] = Spent(whole - sum(one.cpu_s for one in spent.values()), 1)
    return spent


def necessary(folder: Path, first: date, spent: dict[str, Spent]) -> dict[str, float]:
    """What some stages cannot do without, measured alone, s: unpacking the files, and making the random numbers."""
    begin = time.process_time()
    for path in folder.rglob(f"*{first:%Y%m%d}*.cdf"):
        file = cdflib.CDF(path)
        for name in file.cdf_info().zVariables:
            with contextlib.suppress(ValueError):
                file.varget(name)
    read_s = time.process_time() - begin
    begin = time.process_time()
    for _ in range(40):
        np.random.default_rng(1).standard_normal((4, DRAWS))
    drawn_s = time.process_time() - begin
    return {"read spectra": read_s, "positions, 4000 draws": drawn_s * spent["positions, 4000 draws"].calls}


def measured() -> tuple[dict[str, Spent], dict[str, float]]:
    """The profile of a simulated day, and what is necessary."""
    with tempfile.TemporaryDirectory() as folder:
        archive = Path(folder) / "archive"
        simulate_days(archive, [FIRST], SEED, (), lambda *_: None)
        spent = profile(archive)
        return spent, necessary(archive, FIRST, spent)


def rows() -> list[Row]:
    """Sums of the profile, for the table of all figures."""
    spent, _ = measured()
    whole = sum(one.cpu_s for one in spent.values())
    solutions = max(1, spent["store and publish solutions"].calls)
    return [
        ("one simulated day of four spacecraft, file to catalogue, CPU", f"{whole:.1f} s", ""),
        ("of it, a solution: positions and joint track", f"{_of(spent, 'posit', 'joint') / solutions:.2f} s", ""),
        ("of it, reading and searching", f"{_of(spent, 'read', 'search'):.2f} s", ""),
    ]


def _of(spent: dict[str, Spent], *begins: str) -> float:
    return sum(one.cpu_s for name, one in spent.items() if name.startswith(begins))


def main() -> None:
    """Print the profile."""
    spent, floor = measured()
    whole = sum(one.cpu_s for one in spent.values())
    table = Table(title=f"One simulated day, {whole:.1f} s of CPU")
    for name in ("stage", "calls", "CPU, s", "each, s", "share, %", "necessary, s"):
        table.add_column(name, justify="left" if name == "stage" else "right")
    for name, one in sorted(spent.items(), key=lambda item: -item[1].cpu_s):
        need = f"{floor[name]:.2f}" if name in floor else ""
        each = one.cpu_s / max(1, one.calls)
        table.add_row(name, f"{one.calls}", f"{one.cpu_s:.2f}", f"{each:.2f}", f"{100 * one.cpu_s / whole:.0f}", need)
    Console(width=110).print(table)


if __name__ == "__main__":
    main()

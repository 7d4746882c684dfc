"""The command ``bella calibrate``: whether a posterior means what it says."""

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from bella.exceptions import BellaError, InputError

if TYPE_CHECKING:
    from bella.calibration import Comparison
    from bella.calibration.found import FoundBurst
    from bella.plotting.calibration import Panel

out, err = Console(), Console(stderr=True)

EPILOG = (
    "Example: bella calibrate --sources 200 --strata wide,four-robust; bella calibrate --found --bursts 4 --workers 2"
)
TABLE, PAGE, FIGURE = "calibration.csv", "calibration.md", "calibration.png"
FOUND_TABLE, FOUND_PAGE = "calibration-found.csv", "calibration-found.md"


def calibrate(  # noqa: PLR0913, PLR0917 - one argument per option
    output: Annotated[Path, typer.Option(help="Folder for table, page and figure; made if need be.")] = Path(
        "calibration"
    ),
    sources: Annotated[int, typer.Option(help="Simulated sources per stratum, 20 or more.")] = 1000,
    seed: Annotated[int, typer.Option(help="Seed of the random numbers, 0 or more.")] = 1,
    strata: Annotated[
        str | None, typer.Option(help="Strata to run, such as wide,four-robust.", show_default="all")
    ] = None,
    found: Annotated[
        bool, typer.Option("--found", help="Simulated bursts through detection, timing, localisation and track.")
    ] = False,
    bursts: Annotated[int, typer.Option(help="With --found: bursts per stratum and fleet.")] = 24,
    workers: Annotated[int, typer.Option(help="With --found: processes, 1 or more.")] = 1,
) -> None:
    """Check what is published against simulated sources: coverage, and ranks of the truth."""
    names = [name.strip() for name in strata.split(",")] if strata is not None else []
    if seed < 0:
        raise InputError(f"--seed {seed} is below 0; give 0 or more")
    if found:
        _calibrate_found(output, names, bursts, seed, workers)
    else:
        _calibrate_posterior(output, names, sources, seed)


def _calibrate_found(output: Path, names: list[str], bursts: int, seed: int, workers: int) -> None:
    from bella.calibration.found import FOUND_STRATA, check_workers, find_all, tasks_of
    from bella.calibration.found_page import found_page
    from bella.calibration.found_table import found_csv, found_rows

    tasks = tasks_of(names or FOUND_STRATA, bursts, seed)
    check_workers(workers)
    _check_writable(output)
    measured: list[FoundBurst] = []
    with _progress(len(tasks)) as (advance, describe):
        for one in find_all(tasks, workers):
            describe(f"{one.task.stratum}, {one.task.fleet}")
            advance(1)
            measured.append(one)
    rows = found_rows(measured, seed)
    with _reporting(output):
        _write_texts(output, {FOUND_TABLE: found_csv(rows), FOUND_PAGE: found_page(rows, table=FOUND_TABLE)})
    answers = sum(not one.reason for one in measured)
    out.print(
        f"{answers} of {len(measured)} bursts have an answer; whether it holds: {output / FOUND_PAGE}",
        soft_wrap=True,
        highlight=False,
    )


def _calibrate_posterior(output: Path, names: list[str], sources: int, seed: int) -> None:
    from bella.calibration import (
        calibration_page,
        check_sources,
        failing,
        find_strata,
        judge,
        run_stratum,
        verdict_table,
    )
    from bella.plotting import write_calibration_png

    chosen = find_strata(names)
    check_sources(sources)
    _check_writable(output)
    comparisons = []
    with _progress(len(chosen) * sources) as (advance, describe):
        for stratum in chosen:
            describe(stratum.name)
            comparisons.append(run_stratum(stratum, sources, seed, advance))
    verdicts = judge(comparisons, seed)
    with _reporting(output):
        page = calibration_page(verdicts, table=TABLE, figure=FIGURE)
        _write_texts(output, {TABLE: verdict_table(verdicts), PAGE: page})
        write_calibration_png(output / FIGURE, _panels(comparisons))
    failed = failing(verdicts)
    if failed:
        raise BellaError(f"not calibrated: {', '.join(failed)}; see {output / PAGE}")
    declared = sum(not one.misfit for one in verdicts)
    out.print(f"{declared} of {declared} strata are calibrated: {output / PAGE}", soft_wrap=True, highlight=False)


def _check_writable(folder: Path) -> None:
    """Find out before the work whether its result can be kept."""
    with _reporting(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass


@contextmanager
def _reporting(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{folder} cannot be written ({error.strerror or error}); name another --output") from error


def _write_texts(folder: Path, texts: dict[str, str]) -> None:
    for name, text in texts.items():
        partial = folder / f".{name}.{os.getpid()}"
        try:
            partial.write_text(text, encoding="utf-8")
            partial.replace(folder / name)
        finally:
            partial.unlink(missing_ok=True)


def _panels(comparisons: "list[Comparison]") -> "list[Panel]":
    from bella.calibration.ranks import pp_curve, simultaneous_band
    from bella.plotting.calibration import POINTS, Panel

    return [
        Panel(
            title=one.stratum.name,
            curves={name: pp_curve(ranks, POINTS) for name, ranks in one.ranks.items()},
            band=simultaneous_band(one.sources, POINTS),
            declared=one.stratum.misfit is None,
        )
        for one in comparisons
    ]


@contextmanager
def _progress(total: int) -> Iterator[tuple[Callable[[int], None], Callable[[str], None]]]:
    """A bar on standard error: how to move it on, and how to say what is being worked on."""
    columns = (TextColumn("{task.description:<28}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err) as bar:
        task = bar.add_task("calibrate", total=total)
        yield lambda steps: bar.advance(task, steps), lambda what: bar.update(task, description=what)

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
    from bella.calibration import Comparison, Verdict
    from bella.plotting.calibration import Panel

out, err = Console(), Console(stderr=True)

EPILOG = "Example: bella calibrate --sources 200 --strata wide,four-robust"
TABLE, PAGE, FIGURE = "calibration.csv", "calibration.md", "calibration.png"


def calibrate(
    output: Annotated[Path, typer.Option(help="Folder for table, page and figure; made if need be.")] = Path(
        "calibration"
    ),
    sources: Annotated[int, typer.Option(help="Simulated sources per stratum, 20 or more.")] = 1000,
    seed: Annotated[int, typer.Option(help="Seed of the random numbers, 0 or more.")] = 1,
    strata: Annotated[
        str | None, typer.Option(help="Strata to run, such as wide,four-robust.", show_default="all")
    ] = None,
) -> None:
    """Check the posterior against simulated sources: coverage, and ranks of the truth."""
    from bella.calibration import check_sources, failing, find_strata, judge, run_stratum
    from bella.plotting import write_calibration_png

    chosen = find_strata([name.strip() for name in strata.split(",")] if strata is not None else [])
    check_sources(sources)
    if seed < 0:
        raise InputError(f"--seed {seed} is below 0; give 0 or more")
    _check_writable(output)
    comparisons = []
    with _progress(len(chosen) * sources) as (advance, describe):
        for stratum in chosen:
            describe(stratum.name)
            comparisons.append(run_stratum(stratum, sources, seed, advance))
    verdicts = judge(comparisons, seed)
    with _reporting(output):
        _write_texts(output, verdicts)
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


def _write_texts(folder: Path, verdicts: "list[Verdict]") -> None:
    from bella.calibration import calibration_page, verdict_table

    texts = {TABLE: verdict_table(verdicts), PAGE: calibration_page(verdicts, table=TABLE, figure=FIGURE)}
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

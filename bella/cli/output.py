"""What all commands print and write: answers, tables, JSON, progress on standard error, and whole files."""

import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Column, Table

from bella.exceptions import InputError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

LEAST_WIDTH = 12
"""Of a column that may be broken into lines; a narrower terminal breaks the lines of the table instead."""


class Screen(Console):
    """A console whose reader may leave: ``bella ... | head`` ends quietly and is no failure."""

    def on_broken_pipe(self) -> None:
        """Write nothing more, and end."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(0)


out, err = Screen(), Console(stderr=True)
talk, bars = Screen(), Console(stderr=True)
"""Standard output and error for what ``--quiet`` leaves out: tables and remarks, and progress."""


def be_quiet(quiet: bool) -> None:
    """Print the answer and errors only, or everything."""
    talk.quiet = bars.quiet = quiet


def answer(line: str) -> None:
    """Print the answer of a command, as one line so that a path in it can be copied."""
    out.print(line, soft_wrap=True, highlight=False, markup=False)


def say(line: str) -> None:
    """Print a line that belongs to the answer, unless only the answer is wanted."""
    talk.print(line, soft_wrap=True, highlight=False, markup=False)


def warn(line: str) -> None:
    """Print a line about what was left out on standard error."""
    err.print(line, soft_wrap=True, highlight=False, markup=False)


def print_json(value: Any) -> None:
    """Print a value as JSON, with null for what is not a number.

    Parameters
    ----------
    value : object
        Of lists, dicts, texts, numbers, True, False and None.
    """
    out.print_json(json.dumps(_finite(value), allow_nan=False, default=str))


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if abs(value) < float("inf") else None
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    return [_finite(one) for one in value] if isinstance(value, list | tuple) else value


def frame_rows(frame: "pd.DataFrame") -> list[dict[str, Any]]:
    """Rows of a data frame for JSON: times as ISO with Z, null for what is not there."""
    rows: list[dict[str, Any]] = json.loads(frame.to_json(orient="records", date_format="iso", date_unit="us"))
    moments = [str(name) for name in frame.columns if frame[name].dtype.kind == "M"]
    return [row | {name: f"{row[name].removesuffix('Z')}Z" for name in moments if row[name]} for row in rows]


def new_table(title: str, *columns: str, left: Sequence[str] = (), whole: Sequence[str] = ()) -> Table:
    """Empty table.

    Parameters
    ----------
    title : str
        Empty for none.
    left : sequence of str
        Columns of words, which stand to the left; numbers stand to the right.
    whole : sequence of str
        Columns that are neither broken nor cut, such as ids.
    """
    table = Table(
        title=title or None,
        title_justify="left",
        title_style="bold",
        caption_justify="left",
        box=SIMPLE_HEAD,
        pad_edge=False,
    )
    for name in columns:
        # a long word is folded: a cut one says nothing
        table.add_column(name, justify="left" if name in left else "right", no_wrap=name in whole, overflow="fold")
    return table


def show(table: Table) -> None:
    """Print a table, unless only the answer is wanted; wider than the terminal if ids would be cut otherwise."""
    least = sum(_least_width(column) + 3 for column in table.columns)
    if not talk.quiet:
        Screen(width=max(talk.width, least)).print(table)


def _least_width(column: Column) -> int:
    """Width that a column keeps: all of what is neither broken nor cut, and a word of the others."""
    cells = [cell_len(str(cell)) for cell in (column.header, *column.cells)]
    if column.no_wrap:
        column.min_width = max(cells)
    return max(cells) if column.no_wrap else min(LEAST_WIDTH, max(cells))


def write_whole(path: Path, text: str) -> None:
    """Write beside the target, then rename: the file is there whole or not at all.

    Parameters
    ----------
    path : Path
        In a folder that exists.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


def write_csv(table: "pd.DataFrame", path: Path) -> None:
    """Write a table as CSV, whole or not at all; times as ISO with Z.

    Parameters
    ----------
    path : Path
        In a folder that exists.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    stamped = table.copy()
    for column in stamped.select_dtypes("datetime64[ns]"):
        stamped[column] = stamped[column].dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    write_whole(path, stamped.to_csv(index=False))


def write_netcdf(dataset: "xr.Dataset", path: Path) -> None:
    """Write a dataset as compressed netCDF, maps in single precision, whole or not at all.

    Parameters
    ----------
    path : Path
        In a folder that exists.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    maps = [str(name) for name, variable in dataset.data_vars.items() if variable.ndim == 2 and "x" in variable.dims]
    encoding: dict[str, dict[str, object]] = {name: {"zlib": True, "complevel": 4} for name in maps}
    for name in maps:
        if dataset[name].dtype == "float64":
            encoding[name]["dtype"] = "float32"
    with replacing(path) as partial:
        dataset.to_netcdf(partial, engine="h5netcdf", encoding=encoding)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name beside the target to write to, which is renamed to the target in the end.

    Parameters
    ----------
    path : Path
        In a folder that exists.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    partial = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield partial
        partial.replace(path)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror or error}); name another file") from error
    finally:
        partial.unlink(missing_ok=True)


def new_bars(*, transient: bool = False) -> Progress:
    """Progress bars on standard error."""
    columns = (TextColumn("{task.description:<28}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return Progress(*columns, console=bars, transient=transient, disable=bars.quiet)


@contextmanager
def steps(stage: str, total: int, *, transient: bool = False) -> Iterator[Callable[[int], None]]:
    """A bar on standard error that is drawn with the first step: bad input is answered by one line alone.

    Parameters
    ----------
    total : int
        Steps there are.
    transient : bool
        Take the bar away in the end.

    Yields
    ------
    callable
        Takes how many steps were done since its last call.
    """
    with naming_steps(stage, total, transient=transient) as (advance, _):
        yield advance


@contextmanager
def naming_steps(
    stage: str, total: int, *, transient: bool = False
) -> Iterator[tuple[Callable[[int], None], Callable[[str], None]]]:
    """A bar like that of :func:`steps`, and how to say what is being worked on.

    Parameters
    ----------
    total : int
        Steps there are.
    transient : bool
        Take the bar away in the end.
    """
    bar = new_bars(transient=transient)
    task = bar.add_task(stage, total=total)

    def _advance(done: int = 1) -> None:
        bar.start()
        bar.advance(task, done)

    try:
        yield _advance, lambda what: bar.update(task, description=what)
    finally:
        if bar.live.is_started:
            bar.stop()


@contextmanager
def stage_bars() -> Iterator[Progress]:
    """Progress bars on standard error, one for each stage that the pipeline counts."""
    from bella.pipeline.progress import listen

    with new_bars() as bar:
        tasks: dict[str, Any] = {}

        def _reported(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=total)
            bar.update(tasks[stage], completed=done, total=total)

        listen(_reported)
        yield bar

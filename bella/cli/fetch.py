"""The command ``bella fetch``: files of the archive into the mirror."""

import json
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from bella.exceptions import InputError, UnreachableError

if TYPE_CHECKING:
    from bella.archive import Dataset, DayInMirror
    from bella.settings import Settings

out, err = Console(), Console(stderr=True)

EPILOG = "Example: bella fetch --from 2012-06-07 --to 2012-06-07 --dataset WI_H1_WAV --dataset STEREO_LEVEL2_SWAVES"
MOST_DAYS = 3660


def fetch(  # noqa: PLR0913, PLR0917 - one argument per option
    first: Annotated[str | None, typer.Option("--from", help="First day, UTC, such as 2012-06-07.")] = None,
    last: Annotated[str | None, typer.Option("--to", help="Last day, UTC.", show_default="the first")] = None,
    follow: Annotated[
        bool,
        typer.Option(
            "--follow", help="Fetch the BELLA_RECENT_DAYS before today, and what is new from now on, until stopped."
        ),
    ] = False,
    archive: Annotated[
        str | None,
        typer.Option(help="URL, or folder, below which pub/data is.", show_default="the setting BELLA_ARCHIVE"),
    ] = None,
    dataset: Annotated[
        list[str] | None,
        typer.Option(help="Data set such as WI_L2_WAV_RAD1; may be given again.", show_default="all of these days"),
    ] = None,
    home: Annotated[Path | None, typer.Option(help="Folder that holds the mirror.", show_default="bella-home")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Fetch spectra from the archive; tells what is there, what is not yet, and what could not be asked.

    With --follow also positions of the spacecraft, hourly speeds of the wind and summaries of active regions, each as
    soon as it can be expected.
    """
    from bella.archive import fetch_days, open_archive

    settings = _settings(home)
    if follow:
        if first or last or dataset:
            raise InputError("--follow takes no days and no data sets: set BELLA_RECENT_DAYS")
        _follow(settings if archive is None else settings.model_copy(update={"archive": archive}))
        return
    if first is None:
        raise InputError("name the days to fetch, as in --from 2012-06-07 --to 2012-06-08, or give --follow")
    begin, end = day_range(first, last or first)
    days = [begin + timedelta(days=number) for number in range((end - begin).days + 1)]
    wanted = _wanted(dataset or [], days)
    root = settings.archive if archive is None else archive
    opened = open_archive(root, timeout_s=settings.archive_timeout_s, interval_s=settings.archive_interval_s)
    with _progress(len(wanted) * len(days)) as advance:
        outcomes = list(fetch_days(opened, wanted, days, settings.mirror_root, advance))
    if as_json:
        out.print_json(json.dumps([_row(outcome) for outcome in outcomes]))
    else:
        out.print(_table(outcomes))
        out.print(f"Mirror {settings.mirror_root.resolve()}", soft_wrap=True, highlight=False)
    _fail_if_unreachable(outcomes)


def _settings(home: Path | None) -> "Settings":
    from bella.settings import Settings

    return Settings() if home is None else Settings(home=home)


def _follow(settings: "Settings") -> None:
    """Fetch until stopped; the age of a file says that this goes on, to whoever watches over the process."""
    from bella.archive import open_archive
    from bella.logs import log_to
    from bella.pipeline.alerts import delivering
    from bella.pipeline.ingest import feeds, follow

    if not feeds(settings, datetime.now(UTC).date()):
        raise InputError("there is nothing to follow: set BELLA_RECENT_DAYS, BELLA_IN_SITU or BELLA_REGIONS")
    open_archive(settings.archive)  # a wrong address ends it now, and does not fail every minute
    log_to(None)
    alive = settings.mirror_root / ".alive"
    try:
        alive.parent.mkdir(parents=True, exist_ok=True)
        alive.touch()
    except OSError as error:
        raise InputError(f"mirror {alive.parent} cannot be written ({error.strerror}); correct BELLA_HOME") from error
    with delivering(settings):  # of the services this one alone has a way out
        follow(settings, _beat(alive))


def _beat(alive: Path) -> "Callable[[], None]":
    def _touch() -> None:
        with suppress(OSError):  # a full disk ends the round, which reports it
            alive.touch()

    return _touch


def day_range(first: str, last: str) -> tuple[date, date]:
    """First and last day as options give them.

    Parameters
    ----------
    first, last : str

    Returns
    -------
    first, last : datetime.date

    Raises
    ------
    InputError
        If one is no day, the last is before the first, or there are too many.
    """
    begin, end = day_option(first, "--from"), day_option(last, "--to")
    if end < begin:
        raise InputError(f"--to {last} is before --from {first}; exchange them")
    if (end - begin).days >= MOST_DAYS:
        raise InputError(f"--from {first} --to {last} is more than {MOST_DAYS} days; take them in parts")
    return begin, end


def day_option(text: str, option: str) -> date:
    """A day as an option gives it.

    Parameters
    ----------
    text, option : str

    Returns
    -------
    datetime.date

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        return date.fromisoformat(text)
    except ValueError as error:
        raise InputError(f"{option}: {text!r} is not a day; write it as 2012-06-07") from error


def _wanted(keys: list[str], days: list[date]) -> "list[Dataset]":
    """Data sets that were asked for, or all that have one of these days."""
    from bella.archive import find_datasets

    found = find_datasets(keys)
    return [one for one in found if keys or any(one.covers(day) for day in (days[0], days[-1]))]


def _fail_if_unreachable(outcomes: "list[DayInMirror]") -> None:
    from bella.archive import UNANSWERED

    down = [outcome for outcome in outcomes if outcome.state in UNANSWERED]
    if down:
        raise UnreachableError(f"{len(down)} of {len(outcomes)} not fetched, run it again later: {down[0].message}")


def _row(outcome: "DayInMirror") -> dict[str, Any]:
    return {
        "dataset": outcome.dataset.key,
        "observatories": list(outcome.dataset.observatories),
        "day": f"{outcome.day}",
        "state": outcome.state,
        "due": f"{outcome.due}" if outcome.due else None,
        "complete": outcome.complete,
        "message": outcome.message,
        "files": [
            {
                "path": str(file.path),
                "sha256": file.sha256,
                "bytes": file.size_bytes,
                "state": file.state,
                "supersedes": file.supersedes,
            }
            for file in outcome.files
        ],
    }


def _table(outcomes: "list[DayInMirror]") -> Table:
    table = Table("data set", "day", "state", "file", box=SIMPLE_HEAD, pad_edge=False, caption_justify="left")
    for outcome in outcomes:
        state = outcome.state.replace("_", " ")
        table.add_row(outcome.dataset.key, f"{outcome.day}", state, _remark(outcome))
    counts = Counter(outcome.state.replace("_", " ") for outcome in outcomes)
    table.caption = ", ".join(f"{number} {state}" for state, number in counts.items())
    return table


def _remark(outcome: "DayInMirror") -> str:
    if outcome.files:
        part = "" if outcome.complete else " (the file of a neighbouring day is not there yet)"
        return f"{outcome.files[0].path.name}, {outcome.files[0].size_bytes / 1e6:.2f} MB{part}"
    if outcome.state == "no_file_yet":
        return f"usually there on {outcome.due}"
    return outcome.message


@contextmanager
def _progress(total: int) -> Iterator[Callable[[], None]]:
    columns = (TextColumn("{task.description:<28}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err) as bar:
        task = bar.add_task("days of data sets", total=total)
        yield lambda: bar.advance(task)

"""The command ``bella fetch``: files of the archive into the mirror."""

from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bella.cli.options import AsJson, Home, day_range, settings_of
from bella.cli.output import answer, new_table, print_json, say, show, steps
from bella.exceptions import InputError, StoreError, UnreachableError

if TYPE_CHECKING:
    from rich.table import Table

    from bella.archive import Dataset, DayInMirror
    from bella.settings import Settings

EPILOG = "Example: bella fetch --from 2012-06-07 --to 2012-06-07 --dataset WI_H1_WAV --dataset STEREO_LEVEL2_SWAVES"


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
    home: Home = None,
    as_json: AsJson = False,
) -> None:
    """Fetch spectra from the archive; lists what is there, what is not there yet, and where the archive did not answer.

    With --follow also positions of the spacecraft, hourly speeds of the wind and summaries of active regions, each as
    soon as it can be expected.
    """
    from bella.archive import fetch_days, open_archive

    settings = settings_of(home)
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
    with steps("days of data sets", len(wanted) * len(days)) as advance:
        outcomes = list(fetch_days(opened, wanted, days, settings.mirror_root, lambda: advance(1)))
    if as_json:
        print_json([_row(outcome) for outcome in outcomes])
    else:
        show(_table(outcomes))
        say(f"Mirror {settings.mirror_root.resolve()}")
        counts = Counter(outcome.state.replace("_", " ") for outcome in outcomes)
        answer("Days of data sets: " + ", ".join(f"{number} {state}" for state, number in counts.items()))
    _fail_if_unreachable(outcomes)


def _follow(settings: "Settings") -> None:
    """Fetch until stopped; the age of a file says that this goes on, to whoever watches over the process."""
    from bella.archive import open_archive
    from bella.logs import log_to
    from bella.pipeline.alerts import delivering
    from bella.pipeline.ingest import feeds, follow

    if not (feeds(settings, datetime.now(UTC).date()) or _has_webhooks(settings)):
        raise InputError(
            "there is nothing to follow: set BELLA_RECENT_DAYS, BELLA_IN_SITU, BELLA_REGIONS or BELLA_EVENTS, "
            "or add a webhook"
        )
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


def _has_webhooks(settings: "Settings") -> bool:
    from bella.catalogue import Catalogue

    try:
        with Catalogue.open(settings.catalogue_url) as catalogue:
            return bool(catalogue.webhooks())
    except StoreError:  # there is no catalogue yet, so nobody has added one
        return False


def _beat(alive: Path) -> "Callable[[], None]":
    def _touch() -> None:
        with suppress(OSError):  # a full disk ends the round, which reports it
            alive.touch()

    return _touch


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


def _table(outcomes: "list[DayInMirror]") -> "Table":
    columns = ("data set", "day", "state", "file")
    table = new_table("", *columns, left=columns, whole=columns[:2])
    for outcome in outcomes:
        state = outcome.state.replace("_", " ")
        table.add_row(outcome.dataset.key, f"{outcome.day}", state, _remark(outcome))
    return table


def _remark(outcome: "DayInMirror") -> str:
    if outcome.files:
        part = "" if outcome.complete else " (the file of a neighbouring day is not there yet)"
        return f"{outcome.files[0].path.name}, {outcome.files[0].size_bytes / 1e6:.2f} MB{part}"
    if outcome.state == "no_file_yet":
        return f"usually there on {outcome.due}"
    return outcome.message

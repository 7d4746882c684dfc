"""The commands ``bella events read`` and ``bella events list``: lists that others published, beside the bursts."""

from contextlib import closing
from dataclasses import asdict
from datetime import UTC, datetime, time, timedelta
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bella.cli.options import AsJson, Home, open_catalogue, settings_of
from bella.cli.output import answer, new_table, print_json, say, show
from bella.exceptions import InputError, StoreError
from bella.times import parse_day

if TYPE_CHECKING:
    from bella.catalogue import KnownEvent, ListRead

events_app = typer.Typer(help="Flares, CMEs, particle events and radio bursts of others.", no_args_is_help=True)


@events_app.command("read", epilog="Example: BELLA_EVENTS=lists bella events read")
def read(home: Home = None, as_json: AsJson = False) -> None:
    """Read the lists in the folder BELLA_EVENTS and link bursts to them; exit 1 names lists that are not usable."""
    from bella.logs import log_to
    from bella.pipeline.linked_events import refresh_events

    settings = settings_of(home)
    if settings.events is not None and settings.events.is_dir():
        log_to(settings.home / "logs" / "bella.log")
    done = refresh_events(settings)
    if as_json:
        print_json([_list_row(one) for one in done.lists])
    else:
        columns = ("list", "state", "events", "first", "last", "remark")
        table = new_table("", *columns, left=("list", "state", "remark"), whole=("list", "first", "last"))
        for one in done.lists:
            span = (f"{day:%Y-%m-%d}" if day else "-" for day in (one.first_utc, one.newest_utc))
            table.add_row(one.name, one.state, str(one.events), *span, one.message)
        show(table)
    refused = [one for one in done.lists if one.state == "refused"]
    if refused:
        raise StoreError(f"{len(refused)} of {len(done.lists)} lists are not usable: {refused[0].message}")
    if not as_json:
        say(f"{done.changed_events} events are new or changed, {done.bursts} bursts were compared with them")
        answer(f"{sum(one.events for one in done.lists)} events of {len(done.lists)} lists are known")


def _list_row(one: "ListRead") -> dict[str, Any]:
    stamps = ("first_utc", "newest_utc", "changed_utc", "read_utc", "linked_utc")
    return {name: _stamp(value) if name in stamps else value for name, value in asdict(one).items()}


def _stamp(value: datetime | None) -> str | None:
    return f"{value:%Y-%m-%dT%H:%M:%SZ}" if value else None


@events_app.command("list", epilog="Example: bella events list --from 2012-06-07 --to 2012-06-07 --linked")
def list_events(  # noqa: PLR0913, PLR0917 - one argument per option
    home: Home = None,
    first: Annotated[str | None, typer.Option("--from", help="First day, UTC.")] = None,
    last: Annotated[str | None, typer.Option("--to", help="Last day, UTC.")] = None,
    kind: Annotated[list[str] | None, typer.Option(help="flare, cme, particles or radio; may be given again.")] = None,
    linked: Annotated[bool, typer.Option("--linked", help="Only those that are near a burst.")] = False,
    limit: Annotated[int, typer.Option(help="Largest number of events, 1 to 1000.")] = 100,
    as_json: AsJson = False,
) -> None:
    """List published events with the bursts that they are near to."""
    from bella.catalogue import EventQuery
    from bella.linked_events import KINDS

    kinds = frozenset(known for known in KINDS if known in (kind or ()))
    if unknown := set(kind or ()) - kinds:
        raise InputError(f"--kind {min(unknown)}: give some of {', '.join(KINDS)}")
    days = tuple(text and datetime.combine(parse_day(text, "--from or --to"), time(), UTC) for text in (first, last))
    start, stop = days[0] or None, days[1] + timedelta(days=1) if days[1] else None
    with closing(open_catalogue(settings_of(home))) as catalogue:
        page = catalogue.events.events(EventQuery(start, stop, kinds, linked=linked, limit=limit))
    if as_json:
        print_json([_event_row(one) for one in page.events])
        return
    columns = ("start (UTC)", "kind", "size", "observer", "event", "near")
    table = new_table("Published events", *columns, left=columns, whole=("start (UTC)", "event"))
    for one in page.events:
        event = one.event
        near = ", ".join(f"{burst} ({delay / 60:+.0f} min)" for burst, delay in one.bursts.items())
        when = f"{event.start_utc:%Y-%m-%d %H:%M}"
        table.add_row(when, event.kind, event.size, event.observer, event.event_id, near)
    show(table)
    answer(f"{len(page.events)} of {page.total} events")


def _event_row(one: "KnownEvent") -> dict[str, Any]:
    row = asdict(one.event) | {"list": one.list_name, "bursts": dict(one.bursts)}
    return {name: _stamp(value) if isinstance(value, datetime) else value for name, value in row.items()}

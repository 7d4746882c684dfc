"""Published events: the lists they come from, the events themselves, and which of them belong to a burst."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from datetime import datetime
from typing import Any, Literal, get_args

from sqlalchemy import (
    ColumnElement,
    Double,
    Engine,
    ForeignKey,
    Index,
    RowMapping,
    delete,
    func,
    insert,
    select,
    update,
)
from sqlalchemy.orm import Mapped, mapped_column

from bella.catalogue.engine import dialect_insert, reading, writing
from bella.catalogue.models import Base, UtcTime, table_of
from bella.catalogue.paging import Key, check_limit, read_page
from bella.linked_events import Event, EventKind, Link

ListState = Literal["read", "refused", "gone"]
"""Of a list: all that it has is held; it could not be used, and what it had before is held; its file is gone."""


class EventListRow(Base):
    """Lists of published events, one row for each file, and what came of reading it last."""

    __tablename__ = "event_list"

    name: Mapped[str] = mapped_column(primary_key=True)
    state: Mapped[str]
    sha256: Mapped[str]
    events: Mapped[int]
    left_out: Mapped[int]
    message: Mapped[str]
    first_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    newest_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    changed_utc: Mapped[datetime] = mapped_column(UtcTime)
    read_utc: Mapped[datetime] = mapped_column(UtcTime)
    linked_utc: Mapped[datetime | None] = mapped_column(UtcTime)


class EventRow(Base):
    """Published events."""

    __tablename__ = "event"
    __table_args__ = (
        Index("ix_event_start_utc_event_id", "start_utc", "event_id"),
        Index("ix_event_list_name", "list_name"),
    )

    event_id: Mapped[str] = mapped_column(primary_key=True)
    list_name: Mapped[str] = mapped_column(ForeignKey("event_list.name", ondelete="CASCADE"))
    kind: Mapped[str]
    source: Mapped[str]
    published_id: Mapped[str]
    observer: Mapped[str]
    start_utc: Mapped[datetime] = mapped_column(UtcTime)
    at_sun_utc: Mapped[datetime] = mapped_column(UtcTime)
    peak_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    end_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    size: Mapped[str]
    latitude_deg: Mapped[float | None] = mapped_column(Double)
    longitude_deg: Mapped[float | None] = mapped_column(Double)
    region: Mapped[int | None]
    f_low_mhz: Mapped[float | None] = mapped_column(Double)
    f_high_mhz: Mapped[float | None] = mapped_column(Double)
    link: Mapped[str]


class LinkedEventRow(Base):
    """Which published events belong to a burst."""

    __tablename__ = "linked_event"
    __table_args__ = (Index("ix_linked_event_event_id", "event_id"),)

    burst_id: Mapped[str] = mapped_column(ForeignKey("burst.burst_id", ondelete="CASCADE"), primary_key=True)
    event_id: Mapped[str] = mapped_column(ForeignKey("event.event_id", ondelete="CASCADE"), primary_key=True)
    delay_s: Mapped[float] = mapped_column(Double)


@dataclass(frozen=True)
class ListRead:
    """What is known of a list of events.

    Attributes
    ----------
    name : str
        Path of its file in the folder of lists.
    state : str
        See `ListState`.
    sha256 : str
        Of the file that was read last.
    events, left_out : int
        Events that are held of it; rows of the file that were not usable.
    message : str
        What was not usable; empty otherwise.
    first_utc, newest_utc : datetime or None
        First and last event of the file: nothing is known beyond them.
    changed_utc : datetime
        When the file was changed.
    read_utc : datetime
        When it was looked at.
    linked_utc : datetime or None
        Until when changes of bursts were taken into account.
    """

    name: str
    state: ListState
    sha256: str
    events: int
    left_out: int
    message: str
    first_utc: datetime | None
    newest_utc: datetime | None
    changed_utc: datetime
    read_utc: datetime
    linked_utc: datetime | None = None


@dataclass(frozen=True)
class KnownEvent:
    """An event, the list that it is from, and its delay in seconds to each burst that it belongs to."""

    event: Event
    list_name: str
    bursts: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class EventQuery:
    """Which events, by their start at the observer: of these kinds (of all where empty), seen from there, linked."""

    start: datetime | None = None
    stop: datetime | None = None
    kinds: frozenset[EventKind] = frozenset()
    observer: str | None = None
    linked: bool = False
    cursor: str | None = None
    limit: int = 100


@dataclass(frozen=True)
class EventPage:
    """One page of events by ascending start; `next_cursor` is None on the last, `total` counts all pages."""

    events: tuple[KnownEvent, ...]
    next_cursor: str | None
    total: int


_LISTS, _EVENTS, _LINKS = (table_of(one) for one in (EventListRow, EventRow, LinkedEventRow))
_ORDER = (Key("start_utc", _EVENTS.c.start_utc, datetime), Key("event_id", _EVENTS.c.event_id, str))
_FIELDS = tuple(one.name for one in fields(Event))


class PublishedEvents:
    """Tables about published events; see `Catalogue.events`."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def lists(self) -> tuple[ListRead, ...]:
        """Every list that was ever read, by name."""
        with reading(self._engine) as connection:
            rows = connection.execute(select(_LISTS).order_by(_LISTS.c.name)).mappings().all()
        return tuple(ListRead(**row) for row in rows)

    def replace(self, one: ListRead, events: Sequence[Event]) -> tuple[Event, ...]:
        """Keep the events of a list, in one commit; returns those that are new, changed (before and after) or gone.

        An event of before the first one of the list stays: lists of the last days are cut at their beginning. One that
        is missing among the others was withdrawn, and goes.

        Parameters
        ----------
        one : ListRead
            Its number of events is counted here.
        """
        given = {event.event_id: event for event in events}
        with writing(self._engine) as connection:
            _put_list(connection, one)
            own = connection.execute(select(_EVENTS).where(_EVENTS.c.list_name == one.name)).mappings()
            known = {row["event_id"]: _event(row) for row in own}
            first = min((event.start_utc for event in events), default=None)
            withdrawn = [
                event for name, event in known.items() if name not in given and first and event.start_utc >= first
            ]
            new = [event for name, event in given.items() if known.get(name) != event]
            for event in withdrawn:
                connection.execute(delete(_EVENTS).where(_EVENTS.c.event_id == event.event_id))
            for event in new:
                values = asdict(event) | {"list_name": one.name}
                put = dialect_insert(connection, _EVENTS).values(values)
                changed = {name: value for name, value in values.items() if name != "event_id"}
                connection.execute(put.on_conflict_do_update(index_elements=["event_id"], set_=changed))
            counted = select(func.count()).select_from(_EVENTS).where(_EVENTS.c.list_name == one.name)
            number = connection.execute(counted).scalar_one()
            connection.execute(update(_LISTS).where(_LISTS.c.name == one.name).values(events=number))
        return (*new, *withdrawn, *(known[event.event_id] for event in new if event.event_id in known))

    def note(self, one: ListRead) -> None:
        """Note what came of a list whose events stay as they are."""
        with writing(self._engine) as connection:
            _put_list(connection, one)

    def note_linked(self, moment: datetime) -> None:
        """Note that all bursts as they were at a moment are linked to the events of all lists."""
        with writing(self._engine) as connection:
            connection.execute(update(_LISTS).values(linked_utc=moment))

    def between(self, start: datetime, stop: datetime) -> tuple[Event, ...]:
        """All events that begin in [start, stop], by start."""
        wanted = select(_EVENTS).where(_EVENTS.c.start_utc >= start, _EVENTS.c.start_utc <= stop)
        with reading(self._engine) as connection:
            found = connection.execute(wanted.order_by(_EVENTS.c.start_utc, _EVENTS.c.event_id))
            return tuple(map(_event, found.mappings()))

    def link(self, burst_id: str, links: Iterable[Link]) -> None:
        """Replace the events that belong to a burst."""
        rows = [{"burst_id": burst_id, "event_id": one.event.event_id, "delay_s": one.delay_s} for one in links]
        with writing(self._engine) as connection:
            connection.execute(delete(_LINKS).where(_LINKS.c.burst_id == burst_id))
            if rows:
                connection.execute(insert(_LINKS), rows)

    def of_burst(self, burst_id: str) -> tuple[Link, ...]:
        """Events that belong to a burst, the nearest first."""
        wanted = (
            select(_EVENTS, _LINKS.c.delay_s)
            .join(_LINKS, _LINKS.c.event_id == _EVENTS.c.event_id)
            .where(_LINKS.c.burst_id == burst_id)
            .order_by(func.abs(_LINKS.c.delay_s), _EVENTS.c.event_id)
        )
        with reading(self._engine) as connection:
            return tuple(Link(_event(row), row["delay_s"]) for row in connection.execute(wanted).mappings())

    def events(self, query: EventQuery) -> EventPage:
        """One page of events with the bursts that they belong to, by start.

        Raises
        ------
        InputError
            Where the cursor or the limit is not valid.
        """
        check_limit(query.limit)
        with reading(self._engine) as connection:
            page = read_page(connection, query, select(_EVENTS).where(*_filters(query)), _ORDER)
            bursts: dict[str, dict[str, float]] = {row["event_id"]: {} for row in page.rows}
            linked = select(_LINKS).where(_LINKS.c.event_id.in_(bursts)).order_by(func.abs(_LINKS.c.delay_s))
            for one in connection.execute(linked):
                bursts[one.event_id][one.burst_id] = one.delay_s
        found = tuple(KnownEvent(_event(row), row["list_name"], bursts[row["event_id"]]) for row in page.rows)
        return EventPage(found, page.next_cursor, page.total)


def _filters(query: EventQuery) -> list[ColumnElement[bool]]:
    conditions: list[ColumnElement[bool]] = []
    if query.start is not None:
        conditions.append(_EVENTS.c.start_utc >= query.start)
    if query.stop is not None:
        conditions.append(_EVENTS.c.start_utc < query.stop)
    if query.kinds:
        conditions.append(_EVENTS.c.kind.in_(sorted(query.kinds)))
    if query.observer is not None:
        conditions.append(_EVENTS.c.observer == query.observer)
    if query.linked:
        conditions.append(select(_LINKS.c.burst_id).where(_LINKS.c.event_id == _EVENTS.c.event_id).exists())
    return conditions


def _put_list(connection: Any, one: ListRead) -> None:
    assert one.state in get_args(ListState)  # noqa: S101 - a typing error of ours
    values = asdict(one)
    put = dialect_insert(connection, _LISTS).values(values)
    kept = {"name", "linked_utc"}
    changed = {name: value for name, value in values.items() if name not in kept}
    connection.execute(put.on_conflict_do_update(index_elements=["name"], set_=changed))


def _event(row: RowMapping) -> Event:
    return Event(**{name: row[name] for name in _FIELDS})

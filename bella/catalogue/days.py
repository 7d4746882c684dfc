"""Searched days, what was detected on each, and by whom: a stretch of days or a page of detections at a time."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import asdict
from datetime import UTC, date, datetime, time, timedelta
from typing import Any

from sqlalchemy import ColumnElement, Connection, Engine, Row, RowMapping, case, delete, func, insert, select, update

from bella.catalogue.engine import insert_ignoring, reading, writing
from bella.catalogue.leases import Lease, check_held
from bella.catalogue.models import DetectionRow, SearchedDayRow, as_utc, table_of
from bella.catalogue.paging import Key, after, check_limit, cursor_after, mark_of, parse_cursor, read_page
from bella.catalogue.records import DayPage, DaySummary, Detection, DetectionPage, DetectionQuery, SearchedDay
from bella.flags import LOCALISABLE, REJECTED
from bella.records import REAL_ORIGINS, DayAnswer, Origin

MAX_DAYS = 366
_DAYS, _DETECTIONS = table_of(SearchedDayRow), table_of(DetectionRow)
_REACH = timedelta(days=1)
"""No onset is farther from the day of its burst; onsets have an index, days of detections have none."""

MAX_DETECTIONS = 10_000
UNSEARCHED = (DayAnswer.NO_DATA, DayAnswer.ARCHIVE_SILENT)
_COLUMNS = tuple(Detection.__dataclass_fields__)


def days(  # noqa: PLR0913, PLR0917 - one argument per filter
    engine: Engine,
    first: date | None,
    last: date | None,
    limit: int,
    origins: Collection[Origin] = REAL_ORIGINS,
    cursor: str | None = None,
) -> DayPage:
    """Searched days of [first, last], the newest first, with what was detected on each in data of each origin.

    Parameters
    ----------
    first, last : datetime.date or None
        None for no bound.
    limit : int
        Most days that are returned, 1 to `MAX_DAYS`.
    cursor : str, optional
        Of the page before.

    Raises
    ------
    InputError
        If the limit or the cursor is not valid.
    """
    check_limit(limit, MAX_DAYS)
    order, mark = (Key("day", _DAYS.c.day, date, descending=True),), mark_of(None, "days", first, last, sorted(origins))
    wanted: list[ColumnElement[bool]] = [_DAYS.c.origin.in_(sorted(origins))]
    wanted += [_DAYS.c.day >= first] if first is not None else []
    wanted += [_DAYS.c.day <= last] if last is not None else []
    beyond = [] if cursor is None else [after(order, parse_cursor(order, cursor, mark))]
    page = select(_DAYS.c.day).distinct().where(*wanted, *beyond).order_by(_DAYS.c.day.desc()).limit(limit + 1)
    with reading(engine) as connection:
        total = connection.execute(select(func.count(_DAYS.c.day.distinct())).where(*wanted)).scalar_one()
        found = connection.execute(page).scalars().all()
        shown = found[:limit]
        own = select(_DAYS).where(*wanted, _DAYS.c.day.in_(shown)).order_by(_DAYS.c.day.desc(), _DAYS.c.origin)
        rows = connection.execute(own).all()
        counts = dict(_counts(connection, shown[-1], shown[0])) if shown else {}
    summaries = tuple(DaySummary(searched_day_of(row), *counts.get((row.day, row.origin), (0,) * 5)) for row in rows)
    if len(found) <= limit:
        return DayPage(summaries, None, None, total)
    return DayPage(summaries, shown[-1] - timedelta(days=1), cursor_after(order, {"day": shown[-1]}, mark), total)


def _counts(connection: Connection, first: date, last: date) -> Iterator[tuple[tuple[date, str], tuple[int, ...]]]:
    """Of each day and origin: accepted and rejected detections, bursts, those shared, those localised."""
    columns = _DETECTIONS.c
    by_burst = (
        select(
            columns.day,
            columns.origin,
            columns.burst_id,
            func.sum(case((columns.tier == REJECTED, 0), else_=1)).label("accepted"),
            func.sum(case((columns.tier == REJECTED, 1), else_=0)).label("rejected"),
            func.count(columns.observatory.distinct()).label("observatories"),
            func.max(case((columns.tier == LOCALISABLE, 1), else_=0)).label("localised"),
        )
        .where(columns.day.between(first, last), *_onsets_near(first, last))
        .group_by(columns.day, columns.origin, columns.burst_id)
        .subquery()
    )
    received = by_burst.c
    is_burst, is_shared = received.burst_id != "", received.observatories > 1
    counted = select(
        received.day,
        received.origin,
        func.sum(received.accepted),
        func.sum(received.rejected),
        func.sum(case((is_burst, 1), else_=0)),
        func.sum(case((is_burst & is_shared, 1), else_=0)),
        func.sum(case((is_burst, received.localised), else_=0)),
    ).group_by(received.day, received.origin)
    for day, origin, *numbers in connection.execute(counted):
        yield (day, origin), tuple(map(int, numbers))  # PostgreSQL sums to a Decimal


def _onsets_near(first: date, last: date) -> tuple[ColumnElement[bool], ...]:
    start, stop = (datetime.combine(day, time(), UTC) for day in (first - _REACH, last + 2 * _REACH))
    return _DETECTIONS.c.start_utc >= start, _DETECTIONS.c.start_utc < stop


def detections_of(engine: Engine, day: date, origins: Collection[Origin] = REAL_ORIGINS) -> tuple[Detection, ...]:
    """Detections recorded with a day, by onset: with those of its bursts that another one received past midnight."""
    columns = _DETECTIONS.c
    order = (columns.start_utc, columns.observatory, columns.detection_id)
    own = (columns.day == day, columns.origin.in_(sorted(origins)))
    wanted = select(_DETECTIONS).where(*own, *_onsets_near(day, day)).order_by(*order)
    with reading(engine) as connection:
        return tuple(detection_of(row) for row in connection.execute(wanted).mappings())


def neighbours(
    engine: Engine, day: date, origins: Collection[Origin] = REAL_ORIGINS
) -> tuple[date | None, date | None]:
    """Searched days before and after a day, whether or not it was searched itself.

    Returns
    -------
    before, after : datetime.date or None
        None where there is none.
    """
    own = _DAYS.c.origin.in_(sorted(origins))
    before = select(func.max(_DAYS.c.day)).where(own, _DAYS.c.day < day)
    after = select(func.min(_DAYS.c.day)).where(own, _DAYS.c.day > day)
    with reading(engine) as connection:
        return connection.execute(before).scalar_one(), connection.execute(after).scalar_one()


def record_day(engine: Engine, day: SearchedDay, found: Sequence[Detection], lease: Lease | None = None) -> None:
    """Replace what is known of a day in files of its origin, in one commit.

    Parameters
    ----------
    found : sequence of Detection
        May be empty: the day was searched, and there was no burst. Their origin is that of the day.
    lease : Lease, optional
        Right to work on the day.

    Raises
    ------
    BusyError
        Where the lease was taken over by another run: nothing is changed.
    """
    values = _day_row(day)
    rows = [asdict(one) | {"day": day.day, "origin": day.origin} for one in found]
    with writing(engine) as connection:
        for table in (_DETECTIONS, _DAYS):
            connection.execute(delete(table).where(table.c.day == day.day, table.c.origin == day.origin))
        connection.execute(insert(_DAYS).values(values))
        if rows:
            connection.execute(insert(_DETECTIONS), rows)
        if lease is not None:
            check_held(connection, lease)


def record_unsearched(engine: Engine, day: SearchedDay) -> None:
    """Keep why a day has not been searched, unless it was searched before: an outage takes no answer away.

    Parameters
    ----------
    day : SearchedDay
        With the answer "no data" or "archive silent".
    """
    values = _day_row(day)
    with writing(engine) as connection:
        if not insert_ignoring(connection, _DAYS, values):
            own = (_DAYS.c.day == day.day) & (_DAYS.c.origin == day.origin) & _DAYS.c.answer.in_(UNSEARCHED)
            connection.execute(update(_DAYS).where(own).values(values))


def _day_row(day: SearchedDay) -> dict[str, Any]:
    words = {"observatories": " ".join(day.observatories), "answer": day.answer.value}
    return asdict(day) | words | {"searched_utc": datetime.now(UTC)}


def searched_day(engine: Engine, day: date, origins: Sequence[Origin] = REAL_ORIGINS) -> SearchedDay | None:
    """What a day was searched in; None where it was not.

    Parameters
    ----------
    origins : sequence of Origin
        Of its files: the first of these that there is.
    """
    with reading(engine) as connection:
        rows = connection.execute(select(_DAYS).where(_DAYS.c.day == day, _DAYS.c.origin.in_(origins))).all()
    known = {row.origin: row for row in rows}
    return next((searched_day_of(known[origin]) for origin in origins if origin in known), None)


def searched_day_of(row: Row[Any]) -> SearchedDay:
    """Record of a row of the searched days."""
    received, answer = tuple(row.observatories.split()), DayAnswer(row.answer)
    return SearchedDay(row.day, row.inputs_hash, row.code_version, received, answer, row.reason, Origin(row.origin))


def detections(engine: Engine, query: DetectionQuery) -> DetectionPage:
    """One page of detections by onset.

    Parameters
    ----------
    query : DetectionQuery
        Filters, the order, the cursor of the page before, and the size of a page (1 to `MAX_DETECTIONS`).

    Raises
    ------
    InputError
        If the cursor or the limit is not valid.
    """
    check_limit(query.limit, MAX_DETECTIONS)
    columns = _DETECTIONS.c
    wanted: list[ColumnElement[bool]] = [columns.origin.in_(sorted(query.origins))]
    wanted += [] if query.start is None else [columns.start_utc >= as_utc(query.start)]
    wanted += [] if query.stop is None else [columns.start_utc < as_utc(query.stop)]
    for column, value in (
        (columns.observatory, query.observatory),
        (columns.tier, query.tier),
        (columns.burst_id, query.burst_id),
    ):
        wanted += [] if value is None else [column == value]
    descending = query.sort == "-start"
    order = (
        Key("start_utc", columns.start_utc, datetime, descending),
        Key("observatory", columns.observatory, str, descending),
        Key("detection_id", columns.detection_id, int, descending),
    )
    with reading(engine) as connection:
        page = read_page(connection, query, select(_DETECTIONS).where(*wanted), order)
    return DetectionPage(tuple(map(detection_of, page.rows)), page.next_cursor, page.total)


def detection_of(row: RowMapping) -> Detection:
    """Record of a row of the detections."""
    return Detection(**{name: row[name] for name in _COLUMNS} | {"origin": Origin(row["origin"])})

"""Searched days with what was received on them: the newest first, a stretch at a time."""

from collections.abc import Collection, Iterator
from datetime import UTC, date, datetime, time, timedelta

from sqlalchemy import ColumnElement, Connection, Engine, case, func, select

from bella.catalogue.detections import detection_of, searched_day_of
from bella.catalogue.engine import reading
from bella.catalogue.models import DetectionRow, SearchedDayRow, table_of
from bella.catalogue.paging import Key, after, check_limit, cursor_after, mark_of, parse_cursor
from bella.catalogue.records import DayPage, DaySummary, Detection
from bella.flags import LOCALISABLE, REJECTED
from bella.records import REAL_ORIGINS, Origin

MAX_DAYS = 366
_DAYS, _DETECTIONS = table_of(SearchedDayRow), table_of(DetectionRow)
_REACH = timedelta(days=1)
"""No onset is farther from the day of its burst; onsets have an index, days of detections have none."""


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
    engine : sqlalchemy.Engine
        Engine of the catalogue.
    first, last : datetime.date or None
        None for no bound.
    limit : int
        Most days that are returned, 1 to `MAX_DAYS`.
    origins : collection of Origin
    cursor : str, optional
        Of the page before.

    Returns
    -------
    DayPage

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
    """Detections recorded with a day, by onset: with those of its bursts that another one received past midnight.

    Parameters
    ----------
    engine : sqlalchemy.Engine
        Engine of the catalogue.
    day : datetime.date
    origins : collection of Origin

    Returns
    -------
    tuple of Detection
    """
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

    Parameters
    ----------
    engine : sqlalchemy.Engine
        Engine of the catalogue.
    day : datetime.date
    origins : collection of Origin

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

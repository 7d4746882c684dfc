"""Detections by day: what was received, by whom, and whether it could be localised."""

from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, date, datetime
from typing import Any

from sqlalchemy import ColumnElement, Engine, Row, RowMapping, delete, insert, select, update

from bella.catalogue.engine import reading, writing
from bella.catalogue.leases import Lease, check_held
from bella.catalogue.models import DetectionRow, SearchedDayRow, as_utc, table_of
from bella.catalogue.paging import Key, check_limit, read_page
from bella.catalogue.records import Detection, DetectionPage, DetectionQuery, SearchedDay
from bella.catalogue.upserts import insert_ignoring
from bella.records import REAL_ORIGINS, DayAnswer, Origin

MAX_DETECTIONS = 10_000
_DAYS, _DETECTIONS = table_of(SearchedDayRow), table_of(DetectionRow)
UNSEARCHED = (DayAnswer.NO_DATA, DayAnswer.ARCHIVE_SILENT)
_COLUMNS = tuple(Detection.__dataclass_fields__)


def record_day(engine: Engine, day: SearchedDay, found: Sequence[Detection], lease: Lease | None = None) -> None:
    """Replace what is known of a day in files of its origin, in one commit.

    Parameters
    ----------
    engine : sqlalchemy.Engine
        Engine of the catalogue.
    day : SearchedDay
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
    engine : sqlalchemy.Engine
        Engine of the catalogue.
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
    engine : sqlalchemy.Engine
        Engine of the catalogue.
    day : datetime.date
    origins : sequence of Origin
        Of its files: the first of these that there is.

    Returns
    -------
    SearchedDay or None
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
    engine : sqlalchemy.Engine
        Engine of the catalogue.
    query : DetectionQuery
        Filters, the order, the cursor of the page before, and the size of a page (1 to `MAX_DETECTIONS`).

    Returns
    -------
    DetectionPage

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

"""Detections by day: what was heard, by whom, and whether it could be placed."""

from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, date, datetime
from typing import Any

from sqlalchemy import Engine, Row, delete, insert, select, update

from bella.catalogue.engine import reading, writing
from bella.catalogue.leases import Lease, check_held
from bella.catalogue.models import DetectionRow, SearchedDayRow, as_utc, table_of
from bella.catalogue.records import Detection, SearchedDay
from bella.catalogue.upserts import insert_ignoring
from bella.exceptions import InputError
from bella.records import DayAnswer

MAX_DETECTIONS = 10_000
_DAYS, _DETECTIONS = table_of(SearchedDayRow), table_of(DetectionRow)
UNSEARCHED = (DayAnswer.NO_DATA, DayAnswer.ARCHIVE_SILENT)
_COLUMNS = tuple(Detection.__dataclass_fields__)


def record_day(engine: Engine, day: SearchedDay, found: Sequence[Detection], lease: Lease | None = None) -> None:
    """Replace what is known of a day, in one commit.

    Parameters
    ----------
    engine : sqlalchemy.Engine
        Engine of the catalogue.
    day : SearchedDay
    found : sequence of Detection
        May be empty: the day was searched, and there was no burst.
    lease : Lease, optional
        Right to work on the day.

    Raises
    ------
    BusyError
        Where the lease was taken over by another run: nothing is changed.
    """
    values = _day_row(day)
    rows = [asdict(one) | {"day": day.day} for one in found]
    with writing(engine) as connection:
        connection.execute(delete(_DETECTIONS).where(_DETECTIONS.c.day == day.day))
        connection.execute(delete(_DAYS).where(_DAYS.c.day == day.day))
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
            own = (_DAYS.c.day == day.day) & _DAYS.c.answer.in_(UNSEARCHED)
            connection.execute(update(_DAYS).where(own).values(values))


def _day_row(day: SearchedDay) -> dict[str, Any]:
    words = {"observatories": " ".join(day.observatories), "answer": day.answer.value}
    return asdict(day) | words | {"searched_utc": datetime.now(UTC)}


def searched_day(engine: Engine, day: date) -> SearchedDay | None:
    """What a day was searched in; None where it was not.

    Parameters
    ----------
    engine : sqlalchemy.Engine
        Engine of the catalogue.
    day : datetime.date

    Returns
    -------
    SearchedDay or None
    """
    with reading(engine) as connection:
        row = connection.execute(select(_DAYS).where(_DAYS.c.day == day)).one_or_none()
    if row is None:
        return None
    return searched_day_of(row)


def searched_day_of(row: Row[Any]) -> SearchedDay:
    """Record of a row of the searched days."""
    heard, answer = tuple(row.observatories.split()), DayAnswer(row.answer)
    return SearchedDay(row.day, row.inputs_hash, row.code_version, heard, answer, row.reason or "")


def detections(
    engine: Engine, start: datetime, stop: datetime, observatory: str | None, limit: int
) -> tuple[Detection, ...]:
    """Detections with their onset in [start, stop), by onset.

    Parameters
    ----------
    engine : sqlalchemy.Engine
        Engine of the catalogue.
    start, stop : datetime.datetime
    observatory : str or None
        None for all.
    limit : int
        Most that are returned, 1 to `MAX_DETECTIONS`.

    Returns
    -------
    tuple of Detection

    Raises
    ------
    InputError
        If the limit is not valid.
    """
    if not 1 <= limit <= MAX_DETECTIONS:
        raise InputError(f"limit is {limit}: give 1 to {MAX_DETECTIONS}")
    wanted = [_DETECTIONS.c.start_utc >= as_utc(start), _DETECTIONS.c.start_utc < as_utc(stop)]
    if observatory is not None:
        wanted.append(_DETECTIONS.c.observatory == observatory)
    order = (_DETECTIONS.c.start_utc, _DETECTIONS.c.observatory, _DETECTIONS.c.detection_id)
    with reading(engine) as connection:
        return tuple(
            detection_of(row)
            for row in connection.execute(select(_DETECTIONS).where(*wanted).order_by(*order).limit(limit))
        )


def detection_of(row: Row[Any]) -> Detection:
    """Record of a row of the detections."""
    return Detection(**{name: getattr(row, name) for name in _COLUMNS})

"""Detections by day: what was heard, by whom, and whether it could be placed."""

from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, date, datetime
from typing import Any

from sqlalchemy import Engine, Row, delete, insert, select

from bella.catalogue.engine import reading, writing
from bella.catalogue.models import DetectionRow, SearchedDayRow, as_utc, table_of
from bella.catalogue.records import Detection, SearchedDay
from bella.exceptions import InputError

MAX_DETECTIONS = 10_000
_DAYS, _DETECTIONS = table_of(SearchedDayRow), table_of(DetectionRow)
_COLUMNS = tuple(Detection.__dataclass_fields__)


def record_day(engine: Engine, day: SearchedDay, found: Sequence[Detection]) -> None:
    """Replace what is known of a day, in one commit.

    Parameters
    ----------
    engine : sqlalchemy.Engine
        Engine of the catalogue.
    day : SearchedDay
    found : sequence of Detection
        May be empty: the day was searched, and there was no burst.
    """
    values = asdict(day) | {"observatories": " ".join(day.observatories), "searched_utc": datetime.now(UTC)}
    rows = [asdict(one) | {"day": day.day} for one in found]
    with writing(engine) as connection:
        connection.execute(delete(_DETECTIONS).where(_DETECTIONS.c.day == day.day))
        connection.execute(delete(_DAYS).where(_DAYS.c.day == day.day))
        connection.execute(insert(_DAYS).values(values))
        if rows:
            connection.execute(insert(_DETECTIONS), rows)


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
    return SearchedDay(row.day, row.inputs_hash, row.code_version, tuple(row.observatories.split()))


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

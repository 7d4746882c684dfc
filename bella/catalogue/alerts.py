"""The outbox of alerts: written in the transaction that changes an answer, read in the order of the commits.

An alert is written exactly when the preferred solution of a burst is not the one that was announced last.
"""

import math
from collections.abc import Collection, Iterable
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Connection, Engine, Row, Select, func, insert, select, text

from bella.answer import read_track
from bella.catalogue.engine import reading
from bella.catalogue.models import (
    AlertRow,
    BurstObservatoryRow,
    BurstRow,
    DeliveryRow,
    LocalisationRow,
    TrackFitRow,
    WebhookRow,
    table_of,
)
from bella.catalogue.records import Solution
from bella.catalogue.solutions import settle_answer
from bella.exceptions import InputError
from bella.flags import UNUSABLE_POSITION_FLAGS
from bella.records import ANNOUNCED_ORIGINS, REAL_ORIGINS, Alert, AlertSource, AlertType, Origin

MAX_ALERTS = 1000
MOST_SOURCES = 9
"""Frequencies in an alert: enough to draw a track; all of them are at the address that it gives."""
_ADVISORY_LOCK = 0x42454C4C42
_TABLE, _BURSTS = table_of(AlertRow), table_of(BurstRow)


def note_answer(connection: Connection, burst_id: str) -> None:
    """Settle the answer about a burst, and write an alert where it is not the one that was announced last.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        In the transaction that may have changed it; it holds the row of the burst.
    """
    last = _last(connection, burst_id)
    answer = settle_answer(connection, burst_id)
    standing = last if last is not None and last.retracted_reason is None else None
    if (answer and answer.solution_id) == (standing and standing.solution_id):
        return
    if connection.dialect.name == "postgresql":
        # until this transaction ends nobody else takes a number: a reader never sees 8 before 7
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _ADVISORY_LOCK})
    sequence = int(connection.execute(select(func.coalesce(func.max(_TABLE.c.sequence), 0))).scalar_one()) + 1
    _write(connection, _alert(connection, burst_id, answer, last, sequence))


def alerts(
    engine: Engine, after: int, limit: int, origins: Collection[Origin], burst_id: str | None = None
) -> tuple[Alert, ...]:
    """Alerts in the order of their commits.

    Parameters
    ----------
    after : int
        Sequence number of the last one that is known already; 0 for none.
    limit : int
        Most that are returned, 1 to `MAX_ALERTS`.
    origins : collection of Origin
        Of the data that they are about.
    burst_id : str, optional
        Burst they are about; without it, all.

    Raises
    ------
    InputError
        If the limit is not valid.
    """
    if not 1 <= limit <= MAX_ALERTS:
        raise InputError(f"limit is {limit}: give 1 to {MAX_ALERTS}")
    query = _of_origins(origins, burst_id).where(_TABLE.c.sequence > after).order_by(_TABLE.c.sequence).limit(limit)
    with reading(engine) as connection:
        return tuple(alert_of(row) for row in connection.execute(query))


def newest(engine: Engine, limit: int, origins: Collection[Origin]) -> tuple[Alert, ...]:
    """The last alerts, the newest first."""
    query = _of_origins(origins, None).order_by(_TABLE.c.sequence.desc()).limit(limit)
    with reading(engine) as connection:
        return tuple(alert_of(row) for row in connection.execute(query))


def last_sequence(engine: Engine) -> int:
    """Sequence number of the newest alert of any origin; 0 where there is none."""
    with reading(engine) as connection:
        return int(connection.execute(select(func.coalesce(func.max(_TABLE.c.sequence), 0))).scalar_one())


def alert_of(row: Row[Any]) -> Alert:
    """Record of a row of the alerts."""
    return Alert.model_validate(row.body)


def _of_origins(origins: Collection[Origin], burst_id: str | None) -> Select[Any]:
    query = select(_TABLE).where(_TABLE.c.origin.in_(sorted(origins)))
    return query if burst_id is None else query.where(_TABLE.c.burst_id == burst_id)


def _last(connection: Connection, burst_id: str) -> Alert | None:
    query = select(_TABLE).where(_TABLE.c.burst_id == burst_id).order_by(_TABLE.c.sequence.desc()).limit(1)
    row = connection.execute(query).one_or_none()
    return None if row is None else alert_of(row)


def _type(origin: Origin, last: Alert | None, answer: Solution | None) -> AlertType:
    if origin not in REAL_ORIGINS:
        return AlertType.TEST
    if answer is None:
        return AlertType.RETRACTION
    return AlertType.PRELIMINARY if last is None else AlertType.UPDATE


def _alert(connection: Connection, burst_id: str, answer: Solution | None, last: Alert | None, sequence: int) -> Alert:
    burst = connection.execute(select(_BURSTS).where(_BURSTS.c.burst_id == burst_id)).one()
    received = table_of(BurstObservatoryRow)
    names = select(received.c.observatory).where(received.c.burst_id == burst_id).order_by(received.c.position)
    origin = Origin(burst.origin)
    return Alert(
        sequence=sequence,
        record_number=last.record_number + 1 if last else 1,
        alert_type=_type(origin, last, answer),
        created_utc=_written(datetime.now(UTC)),
        origin=origin,
        burst_id=burst_id,
        start_utc=_written(burst.start_utc),
        end_utc=_written(burst.end_utc),
        f_low_mhz=burst.f_low_mhz,
        f_high_mhz=burst.f_high_mhz,
        observatories=tuple(connection.execute(names).scalars()),
        **(_retracted(burst, last) if answer is None else _said(connection, answer)),
    )


def _retracted(burst: Row[Any], last: Alert | None) -> dict[str, Any]:
    """What an alert says of a burst whose last answer was announced and is none any more."""
    why = burst.retracted_reason or "its only solution was retracted"
    return {"solution_id": last and last.solution_id, "retracted_reason": why, "sentence": f"retracted: {why}"}


def _said(connection: Connection, answer: Solution) -> dict[str, Any]:
    """What an alert says of a solution."""
    fits, rows = table_of(TrackFitRow), table_of(LocalisationRow)
    own = answer.solution_id
    track = read_track(connection.execute(select(fits.c.fit).where(fits.c.solution_id == own)).scalar_one())
    found = connection.execute(select(rows).where(rows.c.solution_id == own).order_by(rows.c.frequency_mhz)).all()
    numbers = answer.answer
    return {
        "solution_id": own,
        "tier": numbers.tier,
        "grade": numbers.grade,
        "sentence": numbers.sentence,
        "reference_utc": _written(answer.reference_utc),
        "phi0_deg": numbers.phi0_deg,
        "phi0_low_deg": numbers.phi0_low_deg,
        "phi0_high_deg": numbers.phi0_high_deg,
        "phi0_68": track.joint.phi0_68 if track else (),
        "sources": _sources(found),
        "flags": answer.flags,
    }


def _sources(rows: Iterable[Row[Any]]) -> tuple[AlertSource, ...]:
    """Sources at most at `MOST_SOURCES` frequencies, evenly chosen among those that can be used."""
    usable = [row for row in rows if math.isfinite(row.x_rsun) and not _is_unusable(row.flags)]
    count = min(len(usable), MOST_SOURCES)
    chosen = [usable[round(at * (len(usable) - 1) / max(count - 1, 1))] for at in range(count)]
    return tuple(_source(row) for row in chosen)


def _is_unusable(flags: str) -> bool:
    return not UNUSABLE_POSITION_FLAGS.isdisjoint(flags.split(";"))


def _source(row: Row[Any]) -> AlertSource:
    numbers = {name: getattr(row, name) for name in AlertSource.model_fields if name != "emission_utc"}
    known = {name: value if value is not None and math.isfinite(value) else None for name, value in numbers.items()}
    return AlertSource.model_validate({**known, "emission_utc": _written(row.emission_utc)})


def _write(connection: Connection, alert: Alert) -> None:
    values = {name: getattr(alert, name) for name in ("sequence", "alert_type", "origin", "burst_id", "solution_id")}
    body = alert.model_dump(mode="json")
    connection.execute(
        insert(_TABLE).values(**values, created_utc=datetime.fromisoformat(alert.created_utc), body=body)
    )
    hooks = table_of(WebhookRow).c
    wanted = select(hooks.webhook_id, hooks.created_utc).where(hooks.removed_utc.is_(None))
    if alert.origin not in REAL_ORIGINS:
        wanted = wanted.where(hooks.with_tests)
    elif alert.origin not in ANNOUNCED_ORIGINS:
        return
    new = [
        {"webhook_id": row.webhook_id, "sequence": alert.sequence, "attempts": 0, "next_attempt_utc": row.created_utc}
        for row in connection.execute(wanted)
    ]
    if new:
        connection.execute(insert(table_of(DeliveryRow)), new)


def _written(moment: datetime) -> str:
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{moment.microsecond // 1000:03d}Z"

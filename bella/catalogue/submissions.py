"""Arrival tables that were handed in and wait for a run; kept as source files of the dataset `arrival_table`."""

from datetime import UTC, datetime

from sqlalchemy import ColumnElement, Connection, Engine, select, update

from bella.catalogue.engine import reading, writing
from bella.catalogue.models import ARRIVAL_TABLE, BurstRow, SourceFileRow, table_of
from bella.catalogue.records import Submission
from bella.catalogue.upserts import insert_ignoring
from bella.exceptions import InputError, NoDataError

RECEIVED, DONE, FAILED = "received", "done", "failed"
_TABLE = table_of(SourceFileRow)


def submit(engine: Engine, sha256: str, file_name: str) -> Submission:
    """Note that an arrival table was handed in.

    Parameters
    ----------
    engine : sqlalchemy.Engine
        Engine of the catalogue.
    sha256 : str
        Checksum of the table, which is its identity.
    file_name : str
        Name it was kept under.

    Returns
    -------
    Submission
        State "received"; or as it is where the same table was handed in before, except that one that failed is
        received anew.
    """
    now = datetime.now(UTC)
    new = {
        "dataset": ARRIVAL_TABLE,
        "day": now.date(),
        "version": "1",
        "sha256": sha256,
        "state": RECEIVED,
        "uri": file_name,
        "message": "",
        "burst_id": None,
        "received_utc": now,
        "changed_utc": now,
    }
    again = {"state": RECEIVED, "uri": file_name, "message": "", "received_utc": now, "changed_utc": now}
    with writing(engine) as connection:
        if not insert_ignoring(connection, _TABLE, new):
            connection.execute(update(_TABLE).where(_is(sha256), _TABLE.c.state == FAILED).values(again))
        return _one(connection, sha256)


def submission(engine: Engine, sha256: str) -> Submission:
    """One submission.

    Raises
    ------
    NoDataError
        Where no table of that checksum was handed in.
    """
    with reading(engine) as connection:
        return _one(connection, sha256)


def pending(engine: Engine) -> tuple[Submission, ...]:
    """Submissions that wait for a run, in the order they came.

    Parameters
    ----------
    engine : sqlalchemy.Engine
        Engine of the catalogue.

    Returns
    -------
    tuple of Submission
        All in state "received".
    """
    waiting = (_TABLE.c.dataset == ARRIVAL_TABLE) & (_TABLE.c.state == RECEIVED)
    query = select(_TABLE).where(waiting).order_by(_TABLE.c.received_utc, _TABLE.c.source_id)
    with reading(engine) as connection:
        return tuple(_submission(row) for row in connection.execute(query))


def mark(engine: Engine, sha256: str, state: str, message: str, burst_id: str | None) -> Submission:
    """Note how a submission ended.

    Parameters
    ----------
    engine : sqlalchemy.Engine
        Engine of the catalogue.
    sha256 : str
        Checksum of the table.
    state : str
        "received", "done" or "failed".
    message : str
        Why it failed; one line.
    burst_id : str or None
        Burst it became.

    Returns
    -------
    Submission
        As it is now.

    Raises
    ------
    InputError
        Where there is no such state.
    NoDataError
        Where no table of that checksum was handed in, or there is no such burst.
    """
    if state not in {RECEIVED, DONE, FAILED}:
        raise InputError(f"a submission cannot be {state!r}: give received, done or failed")
    values = {"state": state, "message": message, "burst_id": burst_id, "changed_utc": datetime.now(UTC)}
    bursts = table_of(BurstRow).c
    with writing(engine) as connection:
        if (
            burst_id is not None
            and not connection.execute(select(bursts.burst_id).where(bursts.burst_id == burst_id)).first()
        ):
            raise NoDataError(f"there is no burst {burst_id}: publish it first")
        connection.execute(update(_TABLE).where(_is(sha256)).values(values))
        return _one(connection, sha256)


def _is(sha256: str) -> ColumnElement[bool]:
    return (_TABLE.c.dataset == ARRIVAL_TABLE) & (_TABLE.c.sha256 == sha256)


def _one(connection: Connection, sha256: str) -> Submission:
    row = connection.execute(select(_TABLE).where(_is(sha256))).one_or_none()
    if row is None:
        raise NoDataError(f"no arrival table with checksum {sha256} was handed in: hand it in first")
    return _submission(row)


def _submission(row: object) -> Submission:
    names = ("sha256", "state", "message", "burst_id", "received_utc", "changed_utc")
    return Submission(file_name=row.uri, **{name: getattr(row, name) for name in names})  # type: ignore[attr-defined]

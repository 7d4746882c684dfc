"""Retractions: what is retracted stays where it is, marked with a reason and a time, and is no answer any more."""

from datetime import UTC, datetime

import structlog
from sqlalchemy import Connection, Engine, select, update

from bella.catalogue.alerts import note_answer
from bella.catalogue.engine import writing
from bella.catalogue.models import BurstRow, SolutionRow, table_of
from bella.catalogue.preference import choose_again, lock
from bella.exceptions import InputError, NoDataError

LONGEST_REASON = 500
_BURSTS, _SOLUTIONS = table_of(BurstRow), table_of(SolutionRow)

log = structlog.get_logger(__name__)


def retract(engine: Engine, name: str, reason: str) -> str:
    """Retract a burst with all its solutions, or one solution.

    Parameters
    ----------
    engine : sqlalchemy.Engine
    name : str
        Id of either.
    reason : str
        One line; it is published.

    Returns
    -------
    str
        Id of the burst.

    Raises
    ------
    InputError
        Where the reason is not one line, or it was retracted before.
    NoDataError
        Where there is no burst and no solution of that id.
    """
    if not reason.strip() or len(reason) > LONGEST_REASON or not reason.isprintable():
        raise InputError(f"--reason must be one line of 1 to {LONGEST_REASON} characters: it is published")
    with writing(engine) as connection:
        if retract_burst(connection, name, reason.strip()):
            return name
        owner = select(_SOLUTIONS.c.burst_id).where(_SOLUTIONS.c.solution_id == name)
        burst_id = connection.execute(owner).scalar_one_or_none()
        if burst_id is None:
            raise NoDataError(f"there is no burst or solution {name}: bella catalogue list and show name them")
        _retract_solution(connection, burst_id, name, reason.strip())
        return str(burst_id)


def retract_burst(connection: Connection, burst_id: str, reason: str) -> bool:
    """Retract a burst in a transaction; False where there is none of that id.

    Raises
    ------
    InputError
        Where it was retracted before.
    """
    own = _BURSTS.c.burst_id == burst_id
    row = connection.execute(select(_BURSTS.c.retracted_utc, _BURSTS.c.retracted_reason).where(own).with_for_update())
    found = row.one_or_none()
    if found is None:
        return False
    _refuse_twice(burst_id, found.retracted_utc, found.retracted_reason)
    connection.execute(update(_BURSTS).where(own).values(retracted_utc=datetime.now(UTC), retracted_reason=reason))
    note_answer(connection, burst_id)
    log.info("burst retracted", burst_id=burst_id, reason=reason)
    return True


def is_retracted(connection: Connection, burst_id: str) -> bool:
    """Whether a burst is there and retracted."""
    retracted = (_BURSTS.c.burst_id == burst_id) & _BURSTS.c.retracted_utc.is_not(None)
    return connection.execute(select(_BURSTS.c.burst_id).where(retracted)).first() is not None


def _retract_solution(connection: Connection, burst_id: str, solution_id: str, reason: str) -> None:
    lock(connection, burst_id)
    own = _SOLUTIONS.c.solution_id == solution_id
    found = connection.execute(select(_SOLUTIONS.c.retracted_utc, _SOLUTIONS.c.retracted_reason).where(own)).one()
    _refuse_twice(solution_id, found.retracted_utc, found.retracted_reason)
    connection.execute(update(_SOLUTIONS).where(own).values(retracted_utc=datetime.now(UTC), retracted_reason=reason))
    choose_again(connection, burst_id)
    note_answer(connection, burst_id)
    log.info("solution retracted", burst_id=burst_id, solution_id=solution_id, reason=reason)


def _refuse_twice(name: str, retracted_utc: datetime | None, reason: str | None) -> None:
    if retracted_utc is not None:
        raise InputError(f"{name} was retracted on {retracted_utc:%Y-%m-%d}: {reason}")

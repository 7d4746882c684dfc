"""What is taken back: retractions, which mark with a reason and a time, and draws of superseded solutions."""

from datetime import UTC, datetime

import structlog
from sqlalchemy import Connection, Engine, or_, select, update

from bella.catalogue.alerts import note_answer
from bella.catalogue.engine import reading, writing
from bella.catalogue.models import BurstRow, SolutionRow, table_of
from bella.catalogue.preference import choose_again, lock
from bella.catalogue.records import Solution
from bella.catalogue.solutions import solution_rows
from bella.exceptions import InputError, NoDataError

LONGEST_REASON = 500
_BURSTS, _SOLUTIONS = table_of(BurstRow), table_of(SolutionRow)

log = structlog.get_logger(__name__)


def retract(engine: Engine, name: str, reason: str) -> str:
    """Retract a burst with all its solutions, or one solution.

    Parameters
    ----------
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


def prunable(engine: Engine, before_utc: datetime) -> tuple[Solution, ...]:
    """Solutions that were superseded before a time and have not been pruned.

    Returns
    -------
    tuple of Solution
        The newest version of a series is never among them.
    """
    later = _SOLUTIONS.alias("later")
    superseded = (
        select(later.c.solution_id)
        .where(later.c.supersedes == _SOLUTIONS.c.solution_id, later.c.created_utc < before_utc)
        .exists()
    )
    with reading(engine) as connection:
        return solution_rows(connection, superseded, _SOLUTIONS.c.pruned_utc.is_(None))


def note_pruned(engine: Engine, solution_id: str, store_path: str, store_sha256: str) -> None:
    """Let a superseded solution point to its group without draws; the group with them is swept afterwards.

    Parameters
    ----------
    store_path, store_sha256 : str
        Of the group without draws.
    """
    values = {"store_path": store_path, "store_sha256": store_sha256, "pruned_utc": datetime.now(UTC)}
    with writing(engine) as connection:
        connection.execute(update(_SOLUTIONS).where(_SOLUTIONS.c.solution_id == solution_id).values(values))


def note_packed(engine: Engine, folder: str, store_path: str) -> None:
    """Let all that refers to the folder of a group refer to its file, in one commit; the folder is swept afterwards.

    Bursts of it count as changed, so that a server that keeps what it has read reads their paths again.

    Parameters
    ----------
    folder, store_path : str
        Paths of the group before and after.
    """
    packed = or_(_SOLUTIONS.c.store_path == store_path, _SOLUTIONS.c.spectra_path == store_path)
    changed = or_(
        _BURSTS.c.spectra_path == store_path, _BURSTS.c.burst_id.in_(select(_SOLUTIONS.c.burst_id).where(packed))
    )
    with writing(engine) as connection:
        for column in (_SOLUTIONS.c.store_path, _SOLUTIONS.c.spectra_path, _BURSTS.c.spectra_path):
            connection.execute(update(column.table).where(column == folder).values({column.name: store_path}))
        connection.execute(update(_BURSTS).where(changed).values(updated_utc=datetime.now(UTC)))

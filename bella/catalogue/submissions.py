"""Arrival tables that were submitted: each has an id of its own, which its burst has too, and changes nothing else."""

import secrets
from datetime import UTC, date, datetime

from sqlalchemy import Connection, Engine, Row, select, update

from bella.catalogue.engine import insert_ignoring, reading, writing
from bella.catalogue.models import BurstRow, SubmissionRow, table_of
from bella.catalogue.records import Submission
from bella.catalogue.retraction import is_retracted, retract_burst
from bella.exceptions import InputError, NoDataError

RECEIVED, DONE, FAILED, WITHDRAWN = "received", "done", "failed", "withdrawn"
ANONYMOUS = "anonymous"
"""Stands for the token where submissions are open and none was sent."""
WITHDRAWN_REASON = "withdrawn by its submitter"
_LETTERS = "abcdefghjkmnpqrstuvwxyz23456789"
"""Without those that are taken for one another."""
_RANDOM_LETTERS = 10
"""31^10 ids a day: two in a million submissions of one day are alike with a probability of 6e-4."""
_TABLE = table_of(SubmissionRow)


def submission_name(day: date) -> str:
    """New id of a submission about a burst of a day, such as S-20120607-k3vd9m2xqa."""
    return f"S-{day:%Y%m%d}-{''.join(secrets.choice(_LETTERS) for _ in range(_RANDOM_LETTERS))}"


def submit(engine: Engine, token_id: str, sha256: str, submission_id: str) -> Submission:
    """Note that an arrival table was submitted.

    Parameters
    ----------
    token_id : str
        Whose submission it is; the same table of another token is another submission.
    sha256 : str
        Checksum of the table.
    submission_id : str
        New one, of :func:`submission_name`; it is not used where this token submitted the same table before.

    Returns
    -------
    Submission
        State "received"; or as it is where this token submitted the same table before, except that one that failed is
        received again.
    """
    now = datetime.now(UTC)
    new = {
        "submission_id": submission_id,
        "token_id": token_id,
        "sha256": sha256,
        "state": RECEIVED,
        "message": "",
        "burst_id": None,
        "received_utc": now,
        "changed_utc": now,
    }
    own = (_TABLE.c.token_id == token_id) & (_TABLE.c.sha256 == sha256)
    again = {"state": RECEIVED, "message": "", "received_utc": now, "changed_utc": now}
    with writing(engine) as connection:
        if not insert_ignoring(connection, _TABLE, new):
            connection.execute(update(_TABLE).where(own, _TABLE.c.state == FAILED).values(again))
        return _submission(connection.execute(select(_TABLE).where(own)).one())


def submission(engine: Engine, submission_id: str) -> Submission:
    """One submission.

    Raises
    ------
    NoDataError
        Where there is none of that id.
    """
    with reading(engine) as connection:
        return _one(connection, submission_id)


def pending(engine: Engine) -> tuple[Submission, ...]:
    """Submissions that wait for a run, in the order they came."""
    query = select(_TABLE).where(_TABLE.c.state == RECEIVED).order_by(_TABLE.c.received_utc, _TABLE.c.submission_id)
    with reading(engine) as connection:
        return tuple(_submission(row) for row in connection.execute(query))


def mark(engine: Engine, submission_id: str, state: str, message: str, burst_id: str | None) -> Submission:
    """Note how a submission ended; one that was withdrawn meanwhile stays so.

    Parameters
    ----------
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
        Where there is no such submission or burst.
    """
    if state not in {RECEIVED, DONE, FAILED}:
        raise InputError(f"a submission cannot be {state!r}: give received, done or failed")
    values = {"state": state, "message": message, "burst_id": burst_id, "changed_utc": datetime.now(UTC)}
    bursts = table_of(BurstRow).c
    with writing(engine) as connection:
        found = select(bursts.burst_id).where(bursts.burst_id == burst_id)
        if burst_id is not None and not connection.execute(found).first():
            raise NoDataError(f"there is no burst {burst_id}: publish it first")
        own = (_TABLE.c.submission_id == submission_id) & (_TABLE.c.state != WITHDRAWN)
        connection.execute(update(_TABLE).where(own).values(values))
        return _one(connection, submission_id)


def withdraw(engine: Engine, submission_id: str, reason: str = WITHDRAWN_REASON) -> Submission:
    """Withdraw a submission and retract its burst; both stay as a tombstone.

    Parameters
    ----------
    reason : str
        One line.

    Returns
    -------
    Submission
        State "withdrawn"; as it is where it was withdrawn before.

    Raises
    ------
    NoDataError
        Where there is no such submission.
    """
    values = {"state": WITHDRAWN, "message": reason, "changed_utc": datetime.now(UTC)}
    own = _TABLE.c.submission_id == submission_id
    with writing(engine) as connection:
        # in this order a run either sees that it was withdrawn, or has published what is retracted here
        changed = connection.execute(update(_TABLE).where(own, _TABLE.c.state != WITHDRAWN).values(values)).rowcount
        if changed and not is_retracted(connection, submission_id):
            retract_burst(connection, submission_id, reason)
        return _one(connection, submission_id)


def refuse_withdrawn(connection: Connection, burst_id: str) -> None:
    """Refuse to publish the burst of a submission that was withdrawn; in the transaction that publishes.

    Raises
    ------
    NoDataError
        Where it was withdrawn.
    """
    own = (_TABLE.c.submission_id == burst_id) & (_TABLE.c.state == WITHDRAWN)
    if connection.execute(select(_TABLE.c.submission_id).where(own)).first():
        raise NoDataError(f"{burst_id} was withdrawn: nothing of it is published")


def _one(connection: Connection, submission_id: str) -> Submission:
    row = connection.execute(select(_TABLE).where(_TABLE.c.submission_id == submission_id)).one_or_none()
    if row is None:
        raise NoDataError(f"there is no submission {submission_id}: ids are like S-20120607-k3vd9m2xqa")
    return _submission(row)


def _submission(row: Row[tuple[object, ...]]) -> Submission:
    return Submission(**{name: getattr(row, name) for name in Submission.__dataclass_fields__})

"""Leases: at most one live run works on a stage of a subject, and a dead one never blocks the next.

The row of `stage_run` is the lease. Whoever replaces its token owns it: one conditional update, of which two rivals
cannot both succeed on any database. An orchestrator's own idea of what runs is not asked.

A lease is renewed by a thread while the work goes on, however long that takes. A run that has lost its lease cannot
publish: :func:`check_held` is asked inside the transaction that would.
"""

import os
import socket
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import structlog
from sqlalchemy import Connection, Engine, Row, select, update

from bella.catalogue.engine import insert_ignoring, reading, writing
from bella.catalogue.models import StageRunRow, table_of
from bella.catalogue.records import StageRun
from bella.exceptions import BellaError, BusyError

RUNNING, DONE, FAILED = "running", "done", "failed"
_TABLE = table_of(StageRunRow)
_MESSAGE_LENGTH = 2000
BEATS = 3
"""Renewals in the time of a lease: one that fails, because the database is away, leaves time for another."""

_ENDED_HERE: set[str] = set()
"""Tokens of leases that this process has ended but could not write so: they do not keep it from going on."""

log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Owner:
    """A process: `process_start` is its boot, its process namespace and its start in ticks; None where unknown."""

    host: str
    pid: int
    process_start: str | None


@dataclass(frozen=True)
class Lease:
    """The right to work on a stage of a subject until `expires_utc`."""

    engine: Engine
    stage: str
    subject: str
    run_id: str
    token: str
    attempt: int
    expires_utc: datetime
    lost: threading.Event = field(default_factory=threading.Event, compare=False)

    def renew(self, duration_s: float) -> datetime:
        """Hold on for longer.

        Parameters
        ----------
        duration_s : float
            From now on, s.

        Returns
        -------
        datetime
            New expiry.

        Raises
        ------
        BusyError
            Where the lease had expired and another run took it over: stop, and publish nothing.
        """
        expires = _now() + timedelta(seconds=duration_s)
        if not self._change(expires_utc=expires):
            self.lost.set()
            raise self.taken_over()
        return expires

    def taken_over(self) -> BusyError:
        """The error of a run whose lease belongs to another one."""
        return BusyError(f"{self.stage} of {self.subject} was taken over by another run: stop and start anew")

    def end(self, state: str, message: str = "") -> bool:
        """Give the lease back.

        Parameters
        ----------
        state : str
            "done" or "failed".
        message : str
            Why it failed, one line.

        Returns
        -------
        bool
            False where another run had taken it over; its row is left alone.
        """
        line = message.partition("\n")[0][:_MESSAGE_LENGTH]
        _ENDED_HERE.add(self.token)
        is_mine = self._change(state=state, message=line, ended_utc=_now())
        _ENDED_HERE.discard(self.token)
        return is_mine

    def _change(self, **values: object) -> bool:
        mine = (_TABLE.c.token == self.token) & (_TABLE.c.state == RUNNING)
        with writing(self.engine) as connection:
            return connection.execute(update(_TABLE).where(mine).values(values)).rowcount == 1


class _Heartbeat(threading.Thread):
    """Renews a lease beside the work until it is stopped, or the lease is lost."""

    def __init__(self, lease: Lease, duration_s: float) -> None:
        super().__init__(name=f"lease {lease.stage} {lease.subject}", daemon=True)
        self._lease, self._duration_s, self._ended = lease, duration_s, threading.Event()

    def run(self) -> None:
        while not self._ended.wait(self._duration_s / BEATS):
            try:
                self._lease.renew(self._duration_s)
            except BellaError as error:
                log.warning("lease not renewed", subject=self._lease.subject, reason=str(error))
                if self._lease.lost.is_set():
                    return

    def stop(self) -> None:
        """End the thread; a renewal under way is waited for."""
        self._ended.set()
        self.join()


@contextmanager
def held(engine: Engine, stage: str, subject: str, run_id: str, duration_s: float) -> Iterator[Lease]:
    """Hold a lease during a block; a thread renews it as long as the block takes.

    Parameters
    ----------
    stage, subject : str
        What is worked on, such as "localise" and a burst id.
    run_id : str
        Run that works on it.
    duration_s : float
        Time after which a run that does not renew it counts as dead, s.

    Yields
    ------
    Lease
        Ends as done, or as failed where the block raises.

    Raises
    ------
    BusyError
        Where a live run holds it.
    """
    lease = acquire(engine, stage, subject, run_id, duration_s)
    bound = log.bind(stage=stage, subject=subject, run_id=run_id, attempt=lease.attempt)
    heartbeat = _Heartbeat(lease, duration_s)
    heartbeat.start()
    try:
        try:
            yield lease
        finally:
            heartbeat.stop()
    except BaseException as error:
        # what went wrong in the block is worth more than a catalogue that cannot be told of it
        with suppress(BellaError):
            lease.end(FAILED, f"{type(error).__name__}: {error}")
        bound.warning("stage failed", error=str(error))
        raise
    if not lease.end(DONE):
        bound.warning("lease had expired and was taken over before the stage ended")


def acquire(engine: Engine, stage: str, subject: str, run_id: str, duration_s: float) -> Lease:
    """Take a lease that is new, ended, expired, or whose owner is gone.

    Parameters
    ----------
    stage, subject : str
        What is worked on.
    run_id : str
        Run that works on it.
    duration_s : float
        Time after which the run counts as dead, s.

    Returns
    -------
    Lease
        Owned by this process.

    Raises
    ------
    BusyError
        Where a live run holds it, or another one was faster.
    """
    now = _now()
    expires = now + timedelta(seconds=duration_s)
    values = _row(stage, subject, run_id, now, expires)
    with writing(engine) as connection:
        if insert_ignoring(connection, _TABLE, values | {"attempts": 1}):
            return Lease(engine, stage, subject, run_id, values["token"], 1, expires)
        own = (_TABLE.c.stage == stage) & (_TABLE.c.subject == subject)
        seen = connection.execute(select(_TABLE).where(own)).one()
        if is_held(seen, now):
            raise BusyError(
                f"{stage} of {subject} is being done by run {seen.run_id} (process {seen.pid} on {seen.host}): "
                f"wait for it, at the latest until {seen.expires_utc:%Y-%m-%dT%H:%M:%SZ}"
            )
        unchanged = (_TABLE.c.stage_run_id == seen.stage_run_id) & (_TABLE.c.token == seen.token)
        attempt = seen.attempts + 1
        if not connection.execute(update(_TABLE).where(unchanged).values(values | {"attempts": attempt})).rowcount:
            raise BusyError(f"another run took {stage} of {subject} a moment ago: wait for it")
    if seen.state == RUNNING:
        log.warning("lease taken over", stage=stage, subject=subject, run_id=run_id, dead_run_id=seen.run_id)
    return Lease(engine, stage, subject, run_id, values["token"], attempt, expires)


def check_held(connection: Connection, lease: Lease) -> None:
    """Refuse to go on where a lease is lost; until the transaction ends nobody can take it.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        In the transaction that writes what the lease is for.

    Raises
    ------
    BusyError
        Where another run took it over.
    """
    mine = (_TABLE.c.token == lease.token) & (_TABLE.c.state == RUNNING)
    if connection.execute(select(_TABLE.c.stage_run_id).where(mine).with_for_update()).first() is None:
        raise lease.taken_over()


def held_subjects(engine: Engine) -> frozenset[str]:
    """What live runs work on.

    Returns
    -------
    frozenset of str
        Subjects of all leases that are held, such as burst ids and days.
    """
    now = _now()
    with reading(engine) as connection:
        rows = connection.execute(select(_TABLE).where(_TABLE.c.state == RUNNING)).all()
    return frozenset(row.subject for row in rows if is_held(row, now))


def is_held(row: Row[tuple[object, ...]], now: datetime) -> bool:
    """Tell whether a live run holds a lease.

    Parameters
    ----------
    row : sqlalchemy.Row
        Row of `stage_run`.
    now : datetime
        Time to judge the expiry by.

    Returns
    -------
    bool
        False where it ended, expired, or its process on this host is gone.
    """
    if row.state != RUNNING or row.expires_utc <= now or row.token in _ENDED_HERE:
        return False
    return not is_gone(Owner(row.host, row.pid, row.process_start))


def is_gone(owner: Owner) -> bool:
    """Tell whether a process has certainly ended; False wherever that cannot be seen from here.

    Parameters
    ----------
    owner : Owner
        A process, on this or another host.

    Returns
    -------
    bool
        True where the host is this one and has been started anew since, or the process is not among the living, or
        its number belongs to a later process.
    """
    here = this_process()
    if owner.host != here.host:
        return False
    if owner.process_start is None or here.process_start is None:
        return not _answers(owner.pid)
    boot, namespace, _ = owner.process_start.split("/")
    own_boot, own_namespace, _ = here.process_start.split("/")
    if boot != own_boot:
        return True
    # a container's process numbers mean nothing outside of it, so there only the expiry counts
    return namespace == own_namespace and process_start(owner.pid) != owner.process_start


def this_process() -> Owner:
    """The process that asks.

    Returns
    -------
    Owner
        Host name, process number and start.
    """
    return Owner(socket.gethostname(), os.getpid(), process_start(os.getpid()))


def process_start(pid: int) -> str | None:
    """When a process of this host began, which its number alone does not say because numbers are used again.

    Parameters
    ----------
    pid : int
        Process number.

    Returns
    -------
    str or None
        "boot/namespace/ticks"; None where there is no such process, it is a zombie, or the system does not tell.
    """
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        namespace = Path("/proc/self/ns/pid").readlink()
    except OSError:
        return None
    state, ticks = fields[0], fields[19]
    return None if state in "ZX" else f"{boot}/{namespace}/{ticks}"


def stage_runs(engine: Engine, limit: int) -> tuple[StageRun, ...]:
    """Last runs of all stages, the latest first.

    Parameters
    ----------
    limit : int
        At most that many.

    Returns
    -------
    tuple of StageRun
        One per stage and subject.
    """
    query = select(_TABLE).order_by(_TABLE.c.started_utc.desc(), _TABLE.c.stage_run_id.desc()).limit(limit)
    hidden = {"stage_run_id", "token", "process_start"}
    with reading(engine) as connection:
        rows = connection.execute(query).mappings().all()
    return tuple(StageRun(**{name: row[name] for name in row if name not in hidden}) for row in rows)


def _answers(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _row(stage: str, subject: str, run_id: str, now: datetime, expires: datetime) -> dict[str, Any]:
    owner = this_process()
    return {
        "stage": stage,
        "subject": subject,
        "run_id": run_id,
        "token": uuid.uuid4().hex,
        "state": RUNNING,
        "host": owner.host,
        "pid": owner.pid,
        "process_start": owner.process_start,
        "started_utc": now,
        "expires_utc": expires,
        "ended_utc": None,
        "message": "",
    }


def _now() -> datetime:
    return datetime.now(UTC)

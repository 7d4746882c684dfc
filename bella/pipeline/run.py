"""Runs of the pipeline: days from the mirror to published bursts, one burst, and the tables that were submitted.

A day is done again exactly when a file it is read from is new or has changed, or the code has. Of a burst that was
localised before, what comes of it is the next version.
"""

import contextvars
import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any, Protocol, TypeVar

import structlog

import bella
from bella.bursts.event import EVENT
from bella.catalogue import Catalogue, SearchedDay, Submission
from bella.exceptions import BellaError, InputError, NoDataError, NotPlacedError, StoreError
from bella.pipeline.burst import Begun, BurstOutcome, Choice, begin_burst, continue_burst, process_burst
from bella.pipeline.day import (
    DAY,
    NO_PRELIMINARY,
    NOT_LOCALISABLE,
    FoundBurst,
    FoundDay,
    KnownBurst,
    detection_records,
    known_bursts,
    search_day,
    timed_burst,
)
from bella.pipeline.day_files import BroughtFolder, DayFiles, Mirror, fetch_range
from bella.pipeline.draw import draw_day, redraw_day
from bella.pipeline.housekeeping import has_event, sweep_store
from bella.pipeline.inputs import load_burst
from bella.pipeline.linked_events import refresh_events
from bella.pipeline.observability import observed_day
from bella.pipeline.outcome import FAILED, NOTHING_NEW, OVERTAKEN, SEARCHED, DayOutcome, remarks
from bella.pipeline.progress import counter
from bella.pipeline.workers import LATER_S, Workers
from bella.records import DayAnswer, Origin
from bella.settings import Settings

log = structlog.get_logger(__name__)

SEARCH = "search"
NOT_SEARCHABLE = DayAnswer.NOT_SEARCHABLE
CHUNK_DAYS = 8
"""Most days that are fetched before the first of them is processed; of a range the first comes alone, then two, then
four, so that workers soon have something to do."""

RETRY_DELAYS_S = (5.0, 30.0)
"""Waits before an error that may pass is tried again."""

T = TypeVar("T")


@dataclass(frozen=True)
class Run:
    """What a run of the pipeline works with.

    Attributes
    ----------
    run_id : str
        Name under which it holds leases and logs.
    is_overtaken : callable
        Whether newer files of a day have come while it is processed: it then ends after the step that it is at, and
        whoever started it starts it again.
    """

    settings: Settings
    run_id: str
    workers: Workers
    choice: Choice = field(default_factory=Choice)
    is_overtaken: Callable[[DayFiles], bool] = lambda _: False


class Pending(Protocol):
    """A day that is being processed."""

    def result(self) -> DayOutcome:
        """Wait for it; what went wrong is raised."""

    def add_done_callback(self, fn: Callable[[Any], None], /) -> None:
        """Call a function with it when it is done."""


class Executor(Protocol):
    """How the steps of a run are done: one after the other, side by side, or as tasks of an orchestrator."""

    def fetch(self, days: Sequence[date], archive: str, settings: Settings) -> tuple[str, ...]:
        """:func:`bella.pipeline.day_files.fetch_range`, tried again where that may help."""

    def submit(self, files: DayFiles, known: Sequence[KnownBurst], run: Run) -> Pending:
        """Begin :func:`process_day`, tried again where that may help."""


class Direct:
    """Executor without an orchestrator: threads that wait for the workers of the run.

    Parameters
    ----------
    sleep : callable
        Waits so many seconds before an error that may pass is tried again.
    """

    def __init__(self, threads: int, sleep: Callable[[float], None] = time.sleep) -> None:
        self._pool = ThreadPoolExecutor(threads)
        self._sleep = sleep

    def __enter__(self) -> "Direct":
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)

    def fetch(self, days: Sequence[date], archive: str, settings: Settings) -> tuple[str, ...]:
        """See :class:`Executor`."""
        return self.tried(fetch_range, days, archive, settings)

    def submit(self, files: DayFiles, known: Sequence[KnownBurst], run: Run) -> Pending:
        """See :class:`Executor`."""
        return self._pool.submit(contextvars.copy_context().run, self.tried, process_day, files, known, run)

    def tried(self, function: Callable[..., T], *arguments: Any) -> T:
        """Result of a function; an error that may pass is tried again after a while."""
        for delay_s in RETRY_DELAYS_S:
            try:
                return function(*arguments)
            except BellaError as error:
                if not error.retriable:
                    raise
                log.warning("tried again", delay_s=delay_s, reason=str(error))
                self._sleep(delay_s)
        return function(*arguments)


@dataclass(frozen=True)
class DaysDone:
    """Days of a run, in order, the data sets that the archive did not answer for, and files that belong to no day."""

    outcomes: tuple[DayOutcome, ...]
    unreachable: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()


def process_days(
    days: Sequence[date], archive: str | None, run: Run, executor: Executor, brought: BroughtFolder | None = None
) -> DaysDone:
    """Process days: fetch them, search what is new, localise its bursts.

    Parameters
    ----------
    days : sequence of datetime.date
        In order, without a gap.
    archive : str or None
        URL or folder that is asked for new files first; None for the mirror as it is.
    brought : BroughtFolder or None
        Folder of spectra that the days are read from; None for the mirror.

    Returns
    -------
    DaysDone
        One that failed does not stop the others.

    Raises
    ------
    BellaError
        If mirror or catalogue cannot be opened.
    """
    settings, unreachable = run.settings, dict[str, None]()
    outcomes: dict[date, DayOutcome] = {}
    pending: list[tuple[date, Pending]] = []
    advance = counter("days", len(days))
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        sweep_store(catalogue, settings, run.run_id)
        known = known_bursts(catalogue, days[0], days[-1])
        for chunk in _chunks(days):
            if archive is not None:
                unreachable |= dict.fromkeys(executor.fetch(chunk, archive, settings))
            inputs = Mirror(settings) if brought is None else brought
            for files in map(inputs.day, chunk):
                done = finished_before(files, catalogue, settings)
                if done is None:
                    pending.append((files.day, executor.submit(files, known, run)))
                else:
                    outcomes[files.day] = done
                    advance(1)
    for day, one in pending:
        outcomes[day] = awaited(day, one)
        advance(1)
    left_out = () if brought is None else brought.left_out
    return DaysDone(tuple(outcomes[day] for day in days), tuple(unreachable), left_out)


def _chunks(days: Sequence[date]) -> Iterator[Sequence[date]]:
    start, number = 0, 1
    while start < len(days):
        yield days[start : start + number]
        start, number = start + number, min(2 * number, CHUNK_DAYS)


def awaited(day: date, pending: Pending) -> DayOutcome:
    """Outcome of a day; whatever ended it makes it one that failed, and stops no other."""
    try:
        return pending.result()
    except Exception as error:
        message = str(error) if isinstance(error, BellaError) else f"{type(error).__name__}: {error}"
        log.warning("day failed", day=f"{day}", reason=message, exc_info=not isinstance(error, BellaError))
        return DayOutcome(day, FAILED, message=message.partition("\n")[0])


def finished_before(files: DayFiles, catalogue: Catalogue, settings: Settings) -> DayOutcome | None:
    """Outcome of a day that needs no search, recorded where it is new; None where there is something to search."""
    if not files.paths:
        answer = DayAnswer.ARCHIVE_SILENT if files.silent else DayAnswer.NO_DATA
        reason = f"the archive did not answer for {', '.join(files.silent)}" if files.silent else ""
        record = SearchedDay(files.day, files.inputs_hash, bella.__version__, (), answer, reason)
        catalogue.record_unsearched(record)
        kept = catalogue.searched_day(files.day) or record
        state = answer.value if kept.answer == answer else NOTHING_NEW
        return DayOutcome(files.day, state, kept.answer, kept.observatories, message=kept.reason)
    same = (files.inputs_hash, bella.__version__)
    kept_days = [catalogue.searched_day(files.day, (origin,)) for origin in Origin]
    known = next((one for one in kept_days if one and (one.inputs_hash, one.code_version) == same), None)
    if known is None:
        return None
    origin = known.origin
    if known.answer is not DayAnswer.NOT_SEARCHABLE and not settings.day_figure(files.day, origin).is_file():
        redraw_day(files, catalogue.detections_of(files.day, (origin,)), settings)
    return DayOutcome(files.day, NOTHING_NEW, known.answer, known.observatories, message=known.reason)


def process_day(files: DayFiles, known: Sequence[KnownBurst], run: Run) -> DayOutcome:
    """Search a day, localise its bursts, record it: a day that is cut short anywhere is done again.

    First solutions of all days are more urgent than what follows them, and of each the days whose files came last.

    Parameters
    ----------
    known : sequence of (str, datetime)
        Bursts of the catalogue before the run.

    Raises
    ------
    BusyError, StoreError, UnreachableError, WorkerLostError, OSError
        Nothing is recorded of the day.
    """
    settings, day, workers = run.settings, files.day, run.workers
    now = files.came_s
    later = now - LATER_S
    with (
        structlog.contextvars.bound_contextvars(run_id=run.run_id, day=f"{day}"),
        closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue,
        catalogue.lease(SEARCH, f"{day}", run.run_id, settings.lease_s) as lease,
    ):
        try:
            found = workers.call(search_day, files, known, urgency=now)
        except NoDataError as error:
            log.warning("day not searchable", reason=str(error))
            outcome = DayOutcome(day, NOT_SEARCHABLE.value, NOT_SEARCHABLE, message=str(error).partition("\n")[0])
            catalogue.record_day(_record_of(files, outcome, files.origin), (), lease)
            return outcome
        if run.is_overtaken(files):
            return DayOutcome(day, OVERTAKEN)
        work = [(files, one, run.choice, settings, run.run_id) for one in found.bursts if one.edges]
        done = workers.map(begin_found, work, now)
        while left := [one for one in done if isinstance(one, Begun)]:
            if run.is_overtaken(files):
                return DayOutcome(day, OVERTAKEN)
            further = iter(workers.map(continue_burst, [(one, settings, run.run_id) for one in left], later))
            done = [next(further) if isinstance(one, Begun) else one for one in done]
        bursts = {one.burst_id: one for one in done if isinstance(one, BurstOutcome)}
        outcome = _outcome_of(found, bursts)
        verdicts = {one.found.burst_id: (one.burst_id, _reason(one, bursts.get(one.burst_id))) for one in found.bursts}
        records = detection_records(found.table, verdicts)
        workers.call(draw_day, day, found.spectra, records, settings, urgency=later)
        observed = workers.call(observed_day, day, found.spectra, urgency=later)
        catalogue.operation.record_observed(observed, files.inputs_hash, found.origin)
        catalogue.record_day(_record_of(files, outcome, found.origin), records, lease)
        return outcome


def begin_found(
    files: DayFiles, found: FoundBurst, choice: Choice, settings: Settings, run_id: str
) -> Begun | BurstOutcome:
    """Time a burst of a day and publish its first solution; see :func:`bella.pipeline.burst.begin_burst`."""
    with structlog.contextvars.bound_contextvars(run_id=run_id, burst_id=found.burst_id):
        try:
            given = timed_burst(files, found)
        except NotPlacedError as error:
            log.warning("burst not timed", reason=str(error))
            return BurstOutcome(found.burst_id, reason=str(error))
    return begin_burst(given, choice, settings, run_id)


def _record_of(files: DayFiles, outcome: DayOutcome, origin: Origin) -> SearchedDay:
    return SearchedDay(
        files.day,
        files.inputs_hash,
        bella.__version__,
        outcome.observatories,
        outcome.answer or DayAnswer.NO_BURST,
        outcome.message,
        origin,
    )


def _reason(burst: FoundBurst, done: BurstOutcome | None) -> str:
    """Why a burst of a day has no position; empty where it has."""
    if done is None:
        return burst.reason
    if done.is_final:
        return ""
    if done.outcomes:
        return f"{burst.reason}; a preliminary track is published"
    return f"{burst.reason}; {NO_PRELIMINARY}{done.reason}" if burst.reason else f"{NOT_LOCALISABLE}{done.reason}"


def _outcome_of(found: FoundDay, bursts: dict[str, BurstOutcome]) -> DayOutcome:
    reasons = {one.burst_id: _reason(one, bursts.get(one.burst_id)) for one in found.bursts}
    final = tuple(each for one in bursts.values() if one.is_final for each in one.outcomes)
    preliminary = tuple(each for one in bursts.values() if not one.is_final for each in one.outcomes)
    message = remarks(found.left_out, found.not_searchable)
    if not found.searched:
        day = found.files.day
        return DayOutcome(day, NOT_SEARCHABLE.value, NOT_SEARCHABLE, found.observatories, message=message)
    nothing = DayAnswer.NOT_LOCALISABLE if found.bursts else DayAnswer.NO_BURST
    return DayOutcome(
        found.files.day,
        SEARCHED,
        DayAnswer.LOCALISED if final else nothing,
        found.observatories,
        int((found.table["burst_id"] != "").sum()),
        len(found.bursts),
        final,
        preliminary,
        tuple((name, reason) for name, reason in reasons.items() if reason),
        message,
    )


def process_subject(subject: str, run: Run) -> BurstOutcome:
    """Localise the built-in event by its date, or a table that was submitted by its checksum.

    Returns
    -------
    BurstOutcome
        With a reason where it cannot be localised.

    Raises
    ------
    InputError
        If there is no such event or table.
    """
    settings = run.settings
    with structlog.contextvars.bound_contextvars(run_id=run.run_id, subject=subject):
        given = load_burst(subject, settings.incoming_root)
        with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
            sweep_store(catalogue, settings, run.run_id)
        return process_burst(given, run.choice, settings, run.run_id)


def keep_house(run: Run) -> list[str]:
    """Sweep the store, publish the built-in event where it is not there, and link bursts to events of others.

    Returns
    -------
    list of str
        What was removed from the store.
    """
    settings = run.settings
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        removed = sweep_store(catalogue, settings, run.run_id)
        is_there = has_event(catalogue)
    if not is_there:
        process_subject(EVENT.name, run).published()
    if settings.events is not None and settings.events.is_dir():  # the fetcher makes it with the first file
        refresh_events(settings)
    return removed


def process_submissions(run: Run) -> int:
    """Localise what waits; one that fails does not stop the others.

    Returns
    -------
    int
        Number of tables that became a burst.

    Raises
    ------
    BellaError
        If the catalogue cannot be opened.
    """
    with closing(Catalogue.open(run.settings.catalogue_url, create=True)) as catalogue:
        return sum(_process_submission(catalogue, waiting, run) for waiting in catalogue.pending_submissions())


def _process_submission(catalogue: Catalogue, waiting: Submission, run: Run) -> bool:
    try:
        check_unchanged(waiting, run.settings.incoming_root)
        done = process_subject(waiting.submission_id, run)
    except Exception as error:  # noqa: BLE001 - whatever ended one must not end the others; it is noted with it
        _note_failure(catalogue, waiting, error)
        return False
    if done.reason:
        catalogue.mark_submission(waiting.submission_id, state="failed", message=done.reason, burst_id=None)
        return False
    catalogue.mark_submission(waiting.submission_id, state="done", message="", burst_id=done.burst_id)
    return True


def check_unchanged(waiting: Submission, incoming: Path) -> None:
    """Refuse a table that is not the one that was submitted.

    Parameters
    ----------
    incoming : Path
        Folder of the submitted tables.

    Raises
    ------
    InputError
        If its checksum is another one.
    """
    table = incoming / f"{waiting.submission_id}.csv"
    if table.is_file() and hashlib.sha256(table.read_bytes()).hexdigest() != waiting.sha256:
        raise InputError(f"{table.name} was changed after it was submitted: submit it again")


def _note_failure(catalogue: Catalogue, waiting: Submission, error: Exception) -> None:
    """Record why a table failed, unless the next run may do better: then it goes on waiting."""
    unforeseen = f"the service did not foresee this: {type(error).__name__}: {error}"
    foreseen = error if isinstance(error, BellaError) else BellaError(unforeseen)
    waits = foreseen.retriable or isinstance(error, OSError | StoreError)
    log.warning("submission failed", submission_id=waiting.submission_id, reason=str(foreseen), waits=waits)
    if not waits:
        catalogue.mark_submission(waiting.submission_id, state="failed", message=str(foreseen), burst_id=None)


def days_between(first: date, last: date) -> tuple[date, ...]:
    """Days of [first, last], in order."""
    return tuple(first + number * DAY for number in range((last - first).days + 1))

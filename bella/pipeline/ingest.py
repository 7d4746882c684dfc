"""Ingest: bring mirror, ephemeris, winds and regions up to date, each data set when a new file can be expected.

One thing is asked for at a time, and each archive is given its pauses. What came of it is kept in the catalogue, data
set by data set: that an archive is silent, or has no file yet, takes nothing away that is held.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from types import FrameType

import numpy as np
import structlog

from bella.archive import COMPANIONS, DATASETS, UNANSWERED, Archive, Dataset, DayInMirror, open_archive, unanswered
from bella.catalogue import Catalogue, Freshness
from bella.exceptions import BellaError, NoDataError, UnreachableError
from bella.pipeline.day_files import remember_answers
from bella.settings import Settings
from bella.spacecraft.horizons import HORIZONS_IDS, fetch_orbit
from bella.spacecraft.update import Extended, extend_table

log = structlog.get_logger(__name__)

DAY = timedelta(days=1)
EPHEMERIS = "JPL_HORIZONS"
EPHEMERIS_AHEAD = np.timedelta64(365, "D")
"""How far ahead positions are asked for; trajectories change with manoeuvres, so they are asked for again."""
EPHEMERIS_EVERY = timedelta(days=7)

SHORTEST_PAUSE, LONGEST_PAUSE = timedelta(hours=1), timedelta(days=1)
"""A data set is asked for 24 times within its latency, but neither more nor less often than this."""

FIRST_RETRY = timedelta(minutes=5)
"""Pause after an archive was silent; doubled each time, up to the usual pause of the data set."""

IN_SITU_BEFORE = timedelta(days=45)
"""Winds around a burst are those of half a rotation before it and after it, and come in files of a month."""

IDLE_S, RETRY_S = 60.0, 60.0
"""Longest time that the loop sleeps between two looks at what is due, and after a failure, s."""

Beat = Callable[[], None]


@dataclass(frozen=True)
class Round:
    """What a round brought.

    Attributes
    ----------
    asked : tuple of Freshness
        Data sets that were asked for, as they are now.
    days : tuple of DayInMirror
        What the archives answered about each data set and day.
    next_utc : datetime
        When the next data set is due.
    """

    asked: tuple[Freshness, ...]
    days: tuple[DayInMirror, ...]
    next_utc: datetime

    @property
    def new_days(self) -> tuple[date, ...]:
        """Days of which a file is new or was replaced, in order."""
        return tuple(sorted({one.day for one in self.days if one.state in {"fetched", "replaced"}}))


@dataclass(frozen=True)
class Feed:
    """An archive, the data sets that are taken from it, and where their files go."""

    root: str
    datasets: tuple[Dataset, ...]
    target: Path
    first: date


def feeds(settings: Settings, today: date) -> tuple[Feed, ...]:
    """What is fetched on a schedule: spectra of recent days, winds and regions where the settings name a folder."""
    first = today - settings.recent_days * DAY
    winds = tuple(one for one in COMPANIONS if one.kind == "in_situ")
    regions = tuple(one for one in COMPANIONS if one.kind == "regions")
    events = {
        "NOAA": settings.regions_archive,
        "SWPC": settings.swpc_archive,
        "GOES": settings.swpc_archive,
        "DONKI": settings.donki_archive,
    }
    current = tuple(one for one in DATASETS if one.last is None or one.last >= first)
    found = [Feed(settings.archive, current, settings.mirror_root, first)] if settings.recent_days else []
    if settings.in_situ is not None:
        found.append(Feed(settings.archive, winds, settings.in_situ, first - IN_SITU_BEFORE))
    if settings.regions is not None:
        found.append(Feed(settings.regions_archive, regions, settings.regions, first - 2 * DAY))
    if settings.events is not None:
        lists = tuple(one for one in COMPANIONS if one.kind == "events")
        roots = {one: events[one.key.partition("_")[0]] for one in lists}
        found += [Feed(root, (one,), settings.events, first - 2 * DAY) for one, root in roots.items() if root]
    return tuple(found)


def pause(latency_d: float) -> timedelta:
    """Usual time between two requests for a data set, from its latency."""
    return min(max(latency_d * DAY / 24, SHORTEST_PAUSE), LONGEST_PAUSE)


def bring_up_to_date(
    settings: Settings, now: datetime | None = None, beat: Beat = lambda: None, *, all_due: bool = False
) -> Round:
    """Ask for every data set that is due, and note what came of it.

    Parameters
    ----------
    now : datetime.datetime, optional
        Time of this round; the time of day when not given.
    beat : callable
        Called after every day of a data set, as a sign of life.
    all_due : bool
        Ask for all data sets, whenever they were asked last.

    Raises
    ------
    InputError
        If an archive is neither a URL nor a folder, or the mirror cannot be written.
    UnreachableError, StoreError, BusyError
        If the catalogue cannot be used. That an archive is silent raises nothing.
    """
    now = now or datetime.now(UTC)
    asked, days = [], []
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        known = {} if all_due else {one.dataset: one for one in catalogue.operation.freshness()}

        def _is_due(name: str) -> bool:
            return name not in known or known[name].next_utc <= now

        opened: dict[str, Archive] = {}
        for feed in feeds(settings, now.date()):
            for dataset in filter(lambda one: _is_due(one.key), feed.datasets):
                if feed.root not in opened:
                    opened[feed.root] = _opened(feed.root, settings, now)
                answers = list(_renewed(opened[feed.root], dataset, feed, now.date(), beat))
                days += answers
                if dataset.kind == "spectra":
                    remember_answers(answers, settings.mirror_root)
                asked.append(_freshness(dataset, feed, answers, known.get(dataset.key), now))
                catalogue.operation.record_freshness(asked[-1])
        if _is_due(EPHEMERIS):
            asked.append(_ephemeris(settings, known.get(EPHEMERIS), now))
            catalogue.operation.record_freshness(asked[-1])
            beat()
        next_utc = min((one.next_utc for one in catalogue.operation.freshness()), default=now + LONGEST_PAUSE)
    return Round(tuple(asked), tuple(days), next_utc)


def _opened(root: str, settings: Settings, now: datetime) -> Archive:
    return open_archive(root, timeout_s=settings.archive_timeout_s, interval_s=settings.archive_interval_s, now=now)


def _renewed(archive: Archive, dataset: Dataset, feed: Feed, today: date, beat: Beat) -> Iterator[DayInMirror]:
    """Answers about the days of a data set, the newest first; those after a silence were not asked for."""
    silent: UnreachableError | None = None
    for day in _days(dataset, feed.first, today):
        if silent is not None:
            yield unanswered(dataset, day, silent)
            continue
        try:
            yield archive.renew(dataset, day, feed.target)
        except UnreachableError as error:
            silent = error
            log.warning("not fetched", dataset=dataset.key, reason=str(error))
            yield unanswered(dataset, day, error)
        beat()


def _days(dataset: Dataset, first: date, today: date) -> list[date]:
    """Days to ask for, the newest first: one for each file."""
    days = [today - number * DAY for number in range((today - first).days + 1)]
    stamp = {"day": "%Y%m%d", "month": "%Y%m", "year": "%Y"}[dataset.period]
    return [day for day in {f"{day:{stamp}}": day for day in reversed(days)}.values() if dataset.covers(day)][::-1]


def _freshness(
    dataset: Dataset, feed: Feed, answers: list[DayInMirror], before: Freshness | None, now: datetime
) -> Freshness:
    """State of a data set after it was asked for."""
    held = [one.day for one in answers if one.state in {"fetched", "replaced", "unchanged"}]
    newest = max([*held, *([before.newest_day] if before and before.newest_day else [])], default=None)
    expected = now.date() - (dataset.latency_d + 1) * DAY
    silence = next((one.message for one in answers if one.state in UNANSWERED), "")
    one = Freshness(
        dataset.key,
        dataset.kind,
        dataset.observatories,
        dataset.latency_d,
        "ok" if newest is not None and (newest >= expected or expected < feed.first) else "no file yet",
        now,
        now,
        None,
        newest,
        now + pause(dataset.latency_d),
    )
    return _silent(one, before, silence) if silence else one


def _silent(one: Freshness, before: Freshness | None, reason: str) -> Freshness:
    """The same data set where the archive did not answer: asked for again soon, then ever more seldom."""
    failures = 1 + (before.failures if before else 0)
    usual = one.next_utc - one.asked_utc
    return replace(
        one,
        state="silent",
        answered_utc=before.answered_utc if before else None,
        silent_since_utc=(before.silent_since_utc if before else None) or one.asked_utc,
        next_utc=one.asked_utc + min(FIRST_RETRY * 2 ** min(failures - 1, 10), usual),
        failures=failures,
        message=reason,
    )


def _ephemeris(settings: Settings, before: Freshness | None, now: datetime) -> Freshness:
    """Positions of all bodies after the end of the packaged table."""
    until = np.datetime64(now.astimezone(UTC).replace(tzinfo=None), "ns") + EPHEMERIS_AHEAD
    newest = before.newest_day if before else None
    one = Freshness(
        EPHEMERIS, "ephemeris", tuple(HORIZONS_IDS), 0.0, "ok", now, now, None, newest, now + EPHEMERIS_EVERY
    )
    outcomes: list[Extended] = []
    silence = ""
    for body in HORIZONS_IDS:  # one by one: where one of them fails the others are kept
        try:
            outcomes += extend_table(
                settings.ephemeris_extension,
                [body],
                until,
                lambda name, start, stop: fetch_orbit(settings.horizons_url, name, start, stop),
            )
        except NoDataError as error:
            log.warning("no positions", body=body, reason=str(error))
        except UnreachableError as error:
            silence = str(error)
            log.warning("no positions", body=body, reason=silence)
    ends = [outcome.stop.astype("datetime64[D]").astype(date) for outcome in outcomes]
    newest = min(ends) if len(ends) == len(HORIZONS_IDS) else newest
    one = replace(one, newest_day=newest, state="ok" if newest and newest >= now.date() else "no file yet")
    return _silent(one, before, silence) if silence else one


class Stopped(BaseException):
    """The loop was asked to end; whatever it is doing can be broken off at any time."""


def follow(settings: Settings, beat: Beat = lambda: None) -> None:
    """Fetch for ever: a round whenever a data set is due. Ends with SIGTERM or SIGINT; outlives every failure.

    Parameters
    ----------
    beat : callable
        Called at least once a minute, and after every day of a data set.
    """
    # an own event: what waits for a lock in the standard library may swallow the exception of a signal
    ending = threading.Event()

    def _end(_signal: int, _frame: FrameType | None) -> None:
        if not ending.is_set():
            ending.set()
            raise Stopped

    before = {number: signal.signal(number, _end) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        while not ending.is_set():
            beat()
            ending.wait(_round(settings, beat))
    except Stopped:
        log.info("stopped")
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _round(settings: Settings, beat: Beat) -> float:
    """One round; the time until the next look at what is due, s."""
    try:
        done = bring_up_to_date(settings, beat=beat)
    except (BellaError, OSError) as error:
        log.warning("round failed", reason=str(error), error=type(error).__name__)
        return RETRY_S
    if done.asked:
        states = {one.dataset: one.state for one in done.asked}
        new = sum(one.state in {"fetched", "replaced"} for one in done.days)
        log.info("round", new_files=new, asked=states, next_utc=f"{done.next_utc:%Y-%m-%dT%H:%M:%SZ}")
    return min(IDLE_S, max((done.next_utc - datetime.now(UTC)).total_seconds(), 1.0))

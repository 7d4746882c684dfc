"""Whether the chain from archive to page is alive, link by link."""

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Literal

from bella.catalogue import Freshness, MockRun, Operation
from bella.settings import Settings

LinkState = Literal["ok", "stale", "not in use"]

FETCHER_STALE = timedelta(hours=3)
"""The most quickly released data set is asked for every hour, see `bella.pipeline.ingest.SHORTEST_PAUSE`."""

ARCHIVE_STALE = timedelta(days=1)
"""Silence of a data set after which somebody should look: archives are away for hours, for maintenance."""

MOCKS_MISSED = 3
"""Mock bursts in a row that may be missing, because the worker is busy or was restarted."""

LEAST_FREE_BYTES = 1_000_000_000
"""A day takes some 100 MB in mirror, store and figures: with this the operator has a few days."""


@dataclass(frozen=True)
class Link:
    """A link of the chain.

    Attributes
    ----------
    state : str
        ``ok``, ``stale``, or ``not in use`` where the settings do not ask for it.
    message : str
        What is wrong, or when the link was last seen at work.
    """

    name: str
    state: LinkState
    message: str


@dataclass(frozen=True)
class Disk:
    """Room where the service writes, bytes."""

    total_bytes: int
    free_bytes: int


def disk_of(settings: Settings) -> Disk | None:
    """Room in the home folder; None where there is no such folder."""
    try:
        usage = shutil.disk_usage(settings.home)
    except OSError:
        return None
    return Disk(usage.total, usage.free)


def chain(operation: Operation, settings: Settings, now: datetime, watched_since: datetime) -> tuple[Link, ...]:
    """State of every link between archive and page.

    Parameters
    ----------
    operation : Operation
        Of the catalogue.
    watched_since : datetime.datetime
        When the process that asks was started: what has not happened since long before is not missed yet.
    """
    freshness, mock = operation.freshness(), operation.last_mock()
    return (
        _fetcher(freshness, settings, now, watched_since),
        _archives(freshness, now),
        _ephemeris(freshness, now),
        *_worker(mock, settings, now, watched_since),
        _disk(disk_of(settings)),
    )


def _said(moment: datetime) -> str:
    return f"{moment:%Y-%m-%dT%H:%MZ}"


def _fetcher(rows: Sequence[Freshness], settings: Settings, now: datetime, watched_since: datetime) -> Link:
    if not rows and not settings.recent_days:
        return Link("fetcher", "not in use", "BELLA_RECENT_DAYS is 0")
    last = max((one.asked_utc for one in rows), default=None)
    if now - max(filter(None, (last, None if rows else watched_since))) <= FETCHER_STALE:
        return Link("fetcher", "ok", f"asked {_said(last)}" if last else "has not asked yet")
    said = f"since {_said(last)}" if last else "yet"
    return Link("fetcher", "stale", f"no archive was asked {said}: is `bella fetch --follow` running?")


def _archives(rows: Sequence[Freshness], now: datetime) -> Link:
    spectra = [one for one in rows if one.kind == "spectra"]
    if not spectra:
        return Link("archive", "not in use", "no data set was asked for")
    silent = [one for one in spectra if one.silent_since_utc and now - one.silent_since_utc > ARCHIVE_STALE]
    if not silent:
        return Link("archive", "ok", f"{len(spectra)} data sets answer, or have been silent for less than a day")
    first = silent[0]
    since = _said(first.silent_since_utc) if first.silent_since_utc else ""
    others = f" and {len(silent) - 1} others" if len(silent) > 1 else ""
    return Link("archive", "stale", f"{first.dataset}{others} silent since {since}: {first.message}")


def _ephemeris(rows: Sequence[Freshness], now: datetime) -> Link:
    found = [one for one in rows if one.kind == "ephemeris"]
    if not found or found[0].newest_day is None:
        return Link("ephemeris", "not in use", "JPL Horizons was not asked, or has not answered yet")
    end = found[0].newest_day
    if end >= now.date():
        return Link("ephemeris", "ok", f"positions of all spacecraft are known to {end}")
    return Link("ephemeris", "stale", f"positions of a spacecraft end on {end}: {found[0].message or 'ask Horizons'}")


def _worker(mock: MockRun | None, settings: Settings, now: datetime, watched_since: datetime) -> Iterator[Link]:
    """The worker shows by mock bursts that it is at work; the last of them shows whether the path is open."""
    patience = MOCKS_MISSED * timedelta(seconds=settings.mock_schedule_s)
    if mock is None:
        if not settings.recent_days:
            yield Link("worker", "not in use", "no mock burst was sent")
        elif now - watched_since <= patience:
            yield Link("worker", "ok", "has not sent a mock burst yet")
        else:
            yield Link("worker", "stale", "no mock burst was ever sent: is the worker running?")
        return
    late = now - mock.started_utc > patience
    said = f"no mock burst since {_said(mock.started_utc)}: is the worker running?"
    yield Link("worker", *(("stale", said) if late else ("ok", f"sent a mock burst {_said(mock.started_utc)}")))
    if mock.state == "ok":
        yield Link("pipeline", "ok", f"the last mock burst was published as {mock.solution_id}")
    else:
        yield Link("pipeline", "stale", f"the last mock burst failed: {mock.message}")


def _disk(disk: Disk | None) -> Link:
    if disk is None:
        return Link("disk", "stale", "the home folder is missing")
    free = f"{disk.free_bytes / 1e9:.1f} GB free"
    if disk.free_bytes < LEAST_FREE_BYTES:
        return Link("disk", "stale", f"{free}: make room, or nothing more can be written")
    return Link("disk", "ok", free)

"""Published events of the folder `BELLA_EVENTS`: lists that are new or changed are read, and bursts linked to them."""

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import structlog

from bella.answer import read_track
from bella.catalogue import BurstQuery, BurstSummary, Catalogue, ListRead
from bella.exceptions import InputError
from bella.linked_events import REACH, Event, links_of, read_event_list
from bella.linked_events.events import at_sun
from bella.pipeline.rows import all_bursts
from bella.settings import Settings

SHARPEST_RELEASE_S = 300.0
"""A release that is known worse than this says less than the emission at the highest frequency."""

log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Refreshed:
    """What a refresh found: all lists as they are now, and how many events changed and bursts were looked at."""

    lists: tuple[ListRead, ...]
    changed_events: int
    bursts: int


def refresh_events(settings: Settings, now: datetime | None = None) -> Refreshed:
    """Read the lists that are new or changed, and link bursts to events where one of the two has changed.

    A list that cannot be used, or whose file is gone, takes nothing away: its state says so.

    Parameters
    ----------
    settings : Settings
        With the folder of lists.
    now : datetime.datetime, optional
        Time of this refresh.

    Raises
    ------
    InputError
        If no folder is set, or there is none.
    """
    folder, moment = settings.events, now or datetime.now(UTC)
    if folder is None:
        raise InputError("no lists of events are named: set BELLA_EVENTS to the folder that holds them")
    if not folder.is_dir():
        raise InputError(f"BELLA_EVENTS is {folder}, which is no folder: make it or correct the setting")
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        known = {one.name: one for one in catalogue.events.lists()}
        since = min((one.linked_utc or datetime.min.replace(tzinfo=UTC) for one in known.values()), default=moment)
        changed = list(_read_lists(catalogue, folder, known, moment))
        bursts = list({one.burst.burst_id: one for one in _touched(catalogue, changed, since)}.values())
        begun = {one.burst.burst_id: released(catalogue, one) for one in bursts}
        for burst_id, released_utc in begun.items():
            _link(catalogue, burst_id, released_utc)
        catalogue.events.note_linked(moment)
        lists = catalogue.events.lists()
    log.info("events linked", lists=len(lists), changed_events=len(changed), bursts=len(bursts))
    return Refreshed(lists, len({one.event_id for one in changed}), len(bursts))


def _read_lists(catalogue: Catalogue, folder: Path, known: dict[str, ListRead], now: datetime) -> Iterator[Event]:
    """Bring the lists of the folder into the catalogue; events that changed."""
    paths = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if _is_list(path, folder)}
    for name, path in paths.items():
        yield from _read_list(catalogue, name, path, known.get(name), now)
    for name in known.keys() - paths.keys():
        catalogue.events.note(replace(known[name], state="gone", message="its file is gone", read_utc=now))


def _is_list(path: Path, folder: Path) -> bool:
    """Whether a file may be a list: hidden files and what was fetched in part are not."""
    hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
    return path.is_file() and not hidden and path.suffix.lower() in {".json", ".txt", ".tfcat"}


def _read_list(
    catalogue: Catalogue, name: str, path: Path, before: ListRead | None, now: datetime
) -> tuple[Event, ...]:
    try:
        changed = datetime.fromtimestamp(path.stat().st_mtime, UTC)
        sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        changed, sha256 = now, ""
        log.warning("list not read", name=name, reason=error.strerror)
    if before is not None and before.state == "read" and before.sha256 == sha256:
        catalogue.events.note(replace(before, changed_utc=changed, read_utc=now))
        return ()
    held = before or ListRead(name, "refused", sha256, 0, 0, "", None, None, changed, now)
    try:
        found = read_event_list(path, now)
    except InputError as error:
        log.warning("list refused", name=name, reason=str(error))
        refused = replace(held, state="refused", sha256=sha256, message=str(error), changed_utc=changed, read_utc=now)
        catalogue.events.note(refused)
        return ()
    starts = [one.start_utc for one in found.events]
    said = f"{found.left_out} rows were left out: {found.reason}" if found.left_out else ""
    read = replace(
        held,
        state="read",
        sha256=sha256,
        left_out=found.left_out,
        message=said,
        first_utc=min(starts, default=None),
        newest_utc=max(starts, default=None),
        changed_utc=changed,
        read_utc=now,
    )
    return catalogue.events.replace(read, found.events)


def _touched(catalogue: Catalogue, changed: Iterable[Event], since: datetime) -> Iterator[BurstSummary]:
    """Bursts of real data near an event that changed, and those of which something else changed."""
    yield from all_bursts(catalogue, BurstQuery(updated_since=since, limit=200))
    for first, last in _stretches(sorted(one.start_utc for one in changed)):
        yield from all_bursts(catalogue, BurstQuery(start=first - REACH, stop=last + REACH, limit=200))


def _stretches(times: list[datetime]) -> Iterator[tuple[datetime, datetime]]:
    """Stretches of time that hold all times, apart where nothing is for long."""
    begin = 0
    for end in range(1, len(times) + 1):
        if end == len(times) or times[end] - times[end - 1] > 3 * REACH:
            yield times[begin], times[end - 1]
            begin = end


def _link(catalogue: Catalogue, burst_id: str, released_utc: datetime) -> None:
    events = catalogue.events.between(released_utc - REACH, released_utc + REACH)
    near = BurstQuery(start=released_utc - timedelta(hours=1), stop=released_utc + timedelta(hours=1), limit=200)
    has_radio = any(one.kind == "radio" for one in events)
    others = (
        [released(catalogue, one) for one in all_bursts(catalogue, near) if one.burst.burst_id != burst_id]
        if has_radio
        else []
    )
    catalogue.events.link(burst_id, links_of(released_utc, events, others))


def released(catalogue: Catalogue, summary: BurstSummary) -> datetime:
    """When a burst began at the Sun.

    The release of its track where that is known to 5 minutes, otherwise the emission at its highest frequency,
    otherwise its onset less the light travel to the nearest spacecraft that received it.
    """
    solution = summary.preferred
    if solution is not None:
        track = read_track(catalogue.track_fit(solution.solution_id))
        release = track.joint.release_utc if track else None
        if release and release.q50 and release.sd is not None and release.sd <= SHARPEST_RELEASE_S:
            return datetime.fromisoformat(release.q50)
        rows = catalogue.localisations(solution.solution_id)
        if rows:
            return rows[-1].emission_utc
    burst = summary.burst
    return max(at_sun(burst.start_utc, name) for name in burst.observatories or ("EARTH",))

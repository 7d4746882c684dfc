"""Days of the archive: fetch, search, tell which spacecraft heard the same, time, localise, publish.

A day is done again exactly when a file it is read from is new or has changed, or the code has. Of a burst that was
localised before, what comes of it is the next version.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from typing import Any

import structlog
from prefect import flow

import bella
from bella.archive import DayInMirror, fetch_days, find_datasets, open_archive
from bella.bursts.association import AssociatedBurst
from bella.catalogue import Catalogue, Detection
from bella.exceptions import BellaError
from bella.flags import LOCALISABLE
from bella.logs import log_to
from bella.settings import Settings
from flows.day_figure import draw_day, redraw_day
from flows.days import (
    DAY,
    DayFiles,
    HeardDay,
    day_files,
    detection_records,
    hear,
    known_burst_ids,
    place_burst,
    searched_record,
    with_surroundings,
)
from flows.inputs import BurstInput
from flows.localise_burst import STAGE, Choice, Outcome, coarse, localise_given, run_name
from flows.progress import counter

log = structlog.get_logger(__name__)

SEARCH = "search"
PRESET = "default"
NO_DATA, NOTHING_NEW, SEARCHED, FAILED = "no data", "nothing new", "searched", "failed"


@dataclass(frozen=True)
class DayOutcome:
    """What became of a day.

    Attributes
    ----------
    day : datetime.date
    state : str
        "no data" (the archive has no file of it), "nothing new", "searched" or "failed".
    observatories : tuple of str
        That had data.
    detections, bursts : int
        Accepted detections, and bursts that two or more spacecraft or one heard.
    localised : tuple of Outcome
    refused : tuple of (str, str)
        Bursts that were not placed, and why.
    message : str
        Why it failed; empty otherwise.
    """

    day: date
    state: str
    observatories: tuple[str, ...] = ()
    detections: int = 0
    bursts: int = 0
    localised: tuple[Outcome, ...] = ()
    refused: tuple[tuple[str, str], ...] = ()
    message: str = ""


@coarse("fetch")
def fetch(days: Sequence[date], archive: str, settings: Settings) -> list[DayInMirror]:
    """Bring the files of days, and of those next to them, into the mirror."""
    wanted = [days[0] - DAY, *days, days[-1] + DAY]
    opened = open_archive(archive, timeout_s=settings.archive_timeout_s, interval_s=settings.archive_interval_s)
    datasets = [one for one in find_datasets(()) if any(one.covers(day) for day in wanted)]
    advance = counter("fetch", len(datasets) * len(wanted))
    outcomes = list(fetch_days(opened, datasets, wanted, settings.mirror_root, lambda: advance(1)))
    for silent in {one.dataset.key: one for one in outcomes if one.state == "unreachable"}.values():
        log.warning("not fetched", dataset=silent.dataset.key, reason=silent.message)
    return outcomes


@coarse("hear")
def listen(files: DayFiles) -> HeardDay:
    """Search the spectra of a day and compare spacecraft."""
    return hear(files)


@coarse("time")
def time_burst(day: HeardDay, burst: AssociatedBurst, burst_id: str) -> BurstInput | str:
    """Time the edges of a burst; or say why they do not place it."""
    return place_burst(day, burst, burst_id)


@coarse("day-figure")
def draw(heard: HeardDay, found: Sequence[Detection], settings: Settings) -> bool:
    """Draw the spectra of a day with what was found in them."""
    return draw_day(heard.files.day, heard.spectra, found, settings)


@coarse("day-figure")
def redraw(files: DayFiles, found: Sequence[Detection], settings: Settings) -> bool:
    """Draw a day that a run before this one has searched and not drawn."""
    return redraw_day(files, found, settings)


@flow(name="process-days", validate_parameters=False)
def process_days(first: date, last: date, archive: str | None = None, preset: str = PRESET) -> list[DayOutcome]:
    """Process days of the archive.

    Parameters
    ----------
    first, last : datetime.date
        UTC.
    archive : str, optional
        URL or folder; that of the settings when not given.
    preset : str
        A name of `bella.multilateration.PRESETS`.

    Returns
    -------
    list of DayOutcome
        In order; one that failed does not stop the others.

    Raises
    ------
    BellaError
        If the archive or the catalogue cannot be opened.
    """
    settings = Settings()
    days = [first + number * DAY for number in range((last - first).days + 1)]
    mirrored = fetch(days, archive or settings.archive, settings)
    advance = counter("days", len(days))
    outcomes = []
    with (
        structlog.contextvars.bound_contextvars(run_id=run_name()),
        closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue,
    ):
        for day in days:
            with structlog.contextvars.bound_contextvars(day=f"{day}"):
                files = with_surroundings(day_files(day, mirrored), settings)
                outcomes.append(_outcome(files, catalogue, settings, Choice("posterior", preset, 2)))
            advance(1)
    return outcomes


def _outcome(files: DayFiles, catalogue: Catalogue, settings: Settings, choice: Choice) -> DayOutcome:
    """One day; what a BellaError ends is told, and the next run tries again."""
    if not files.paths:
        return DayOutcome(files.day, NO_DATA)
    known = catalogue.searched_day(files.day)
    if known is not None and (known.inputs_hash, known.code_version) == (files.inputs_hash, bella.__version__):
        if not settings.day_figure(files.day).is_file():
            redraw(files, catalogue.detections_of(files.day), settings)
        return DayOutcome(files.day, NOTHING_NEW, known.observatories)
    try:
        with catalogue.lease(SEARCH, f"{files.day}", run_name(), settings.lease_s) as lease:
            heard = listen(files)
            lease.renew(settings.lease_s)
            return _recorded(heard, catalogue, settings, choice)
    except BellaError as error:
        log.warning("day failed", reason=str(error))
        return DayOutcome(files.day, FAILED, message=str(error))


def _recorded(heard: HeardDay, catalogue: Catalogue, settings: Settings, choice: Choice) -> DayOutcome:
    """Localise the bursts of a day, then record what was heard: a day that was cut short is done again."""
    verdicts: dict[str, tuple[str, str]] = {}
    localised: list[Outcome] = []
    names = known_burst_ids(catalogue, heard.bursts)
    for burst in heard.bursts:
        known = names[burst.burst_id]
        reason = burst.reason
        if burst.tier == LOCALISABLE:
            placed = _placed(heard, burst, known, catalogue, settings, choice)
            reason = placed if isinstance(placed, str) else ""
            localised += [] if isinstance(placed, str) else placed
        verdicts[burst.burst_id] = (known, reason)
    records = detection_records(heard.table, verdicts)
    draw(heard, records, settings)
    catalogue.record_day(searched_record(heard.files, heard.observatories), records)
    accepted = sum(1 for one in records if one.burst_id)
    refused = tuple((name, reason) for name, reason in verdicts.values() if reason)
    return DayOutcome(
        heard.files.day, SEARCHED, heard.observatories, accepted, len(heard.bursts), tuple(localised), refused
    )


def _placed(  # noqa: PLR0913, PLR0917 - a step of the flow with all that it needs
    heard: HeardDay, burst: AssociatedBurst, burst_id: str, catalogue: Catalogue, settings: Settings, choice: Choice
) -> list[Outcome] | str:
    """Solutions of a burst, or why it cannot be placed."""
    with structlog.contextvars.bound_contextvars(burst_id=burst_id):
        try:
            given = time_burst(heard, burst, burst_id)
            if isinstance(given, str):
                return given
            with catalogue.lease(STAGE, burst_id, run_name(), settings.lease_s) as lease:
                return localise_given(given, choice, catalogue, settings, lease)
        except BellaError as error:
            if error.retriable:
                raise
            log.warning("burst not placed", reason=str(error))
            return f"not localisable: {error}"


@flow(name="process-recent")
def process_recent() -> int:
    """Process the days before today that the settings ask for; later data refine earlier bursts.

    Returns
    -------
    int
        Solutions that are new.
    """
    log_to(None)  # a worker starts each run as a process of its own
    settings = Settings()
    today = datetime.now(UTC).date()
    outcomes = process_days(today - timedelta(days=settings.recent_days), today)
    return sum(one.new for outcome in outcomes for one in outcome.localised)


def summary_rows(outcomes: Iterable[DayOutcome]) -> Iterator[dict[str, Any]]:
    """One line for every day of a run.

    Parameters
    ----------
    outcomes : iterable of DayOutcome

    Yields
    ------
    dict
    """
    for one in outcomes:
        yield {
            "day": f"{one.day}",
            "state": one.state,
            "observatories": list(one.observatories),
            "detections": one.detections,
            "bursts": one.bursts,
            "localised": sorted({outcome.solution.burst_id for outcome in one.localised}),
            "answers": {
                solution.burst_id: solution.answer.sentence
                for solution in (outcome.solution for outcome in one.localised)
                if solution.preferred
            },
            "refused": [{"burst_id": name, "reason": reason} for name, reason in one.refused],
            "message": one.message,
        }

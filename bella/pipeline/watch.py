"""Watch over the mirror: recent days are processed as their files come, those first whose files came last.

So a new file waits for no more than the days that are being processed, however many older ones are still to be done.
"""

import os
import time
from collections.abc import Sequence
from contextlib import closing
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import structlog

from bella.archive import find_datasets
from bella.catalogue import Catalogue
from bella.exceptions import BellaError
from bella.pipeline.day import DAY
from bella.pipeline.day_files import ANSWERS, DayFiles, Mirror
from bella.pipeline.outcome import FAILED, DayOutcome
from bella.pipeline.run import Executor, Run, days_between, finished_before, process_days
from bella.settings import Settings

log = structlog.get_logger(__name__)

LOOK_S, RETRY_S = 2.0, 60.0
"""Between two looks at the mirror, and before a day that failed is tried again, s."""

LATEST = timedelta(seconds=5)
"""So long after its time a watch may end; where work took longer, it goes on in place of the next one."""


def watch_days(run: Run, executor: Executor, until: datetime, every: timedelta) -> tuple[DayOutcome, ...]:
    """Process the recent days of the mirror as their files come, for a while.

    Parameters
    ----------
    run : Run
    executor : Executor
    until : datetime.datetime
        When it ends; it looks at the mirror once at least.
    every : datetime.timedelta
        If it is at work then, it ends after one or more of these.

    Returns
    -------
    tuple of DayOutcome
        The last one of each day, in order.

    Raises
    ------
    BellaError
        If mirror or catalogue cannot be used at the end; before it, that is tried again.
    """
    watch = Watch(run, executor)
    while True:
        failure, is_busy = None, False
        try:
            is_busy = watch.step(datetime.now(UTC).date())
        except BellaError as error:
            if not error.retriable:
                raise
            failure = error
            log.warning("looks again", reason=str(error))
        while datetime.now(UTC) >= until + LATEST:
            until += every
        if datetime.now(UTC) >= until:
            if failure is not None:
                raise failure
            return watch.outcomes
        if not is_busy:
            time.sleep(LOOK_S)


class Watch:
    """Recent days of the mirror, and what became of them.

    Parameters
    ----------
    run : Run
    executor : Executor
    """

    def __init__(self, run: Run, executor: Executor) -> None:
        self._run, self._executor = run, executor
        self._folders: dict[Path, int] = {}
        self._taken: dict[date, tuple[str, tuple[str, ...]]] = {}
        self._waiting: dict[date, DayFiles] = {}
        self._again: dict[date, float] = {}
        self._outcomes: dict[date, DayOutcome] = {}

    @property
    def outcomes(self) -> tuple[DayOutcome, ...]:
        """Last outcome of each day, in order."""
        return tuple(self._outcomes[day] for day in sorted(self._outcomes))

    def step(self, today: date) -> bool:
        """Look for new files, and process as many days as there are workers; false where none waits.

        Parameters
        ----------
        today : datetime.date

        Returns
        -------
        bool

        Raises
        ------
        BellaError
            If mirror or catalogue cannot be used.
        """
        self._look(today)
        days = sorted(self._waiting, key=lambda day: (_came(self._waiting[day]), day))[-self._run.workers.number :]
        if days:
            done = process_days(sorted(days), None, self._run, self._executor)
            for outcome in done.outcomes:
                self._outcomes[outcome.day] = outcome
                del self._waiting[outcome.day]
                if outcome.state == FAILED:
                    self._again[outcome.day] = time.monotonic() + RETRY_S
        return bool(self._waiting)

    def _look(self, today: date) -> None:
        """Take note of the days whose files are new, and of those that failed a while ago."""
        settings = self._run.settings
        days = days_between(today - settings.recent_days * DAY, today)
        folders = folder_times(days, settings)
        for day in [day for day, when in self._again.items() if when <= time.monotonic()]:
            del self._again[day]
            self._taken.pop(day, None)
        if folders == self._folders and all(day in self._taken for day in days):
            return
        mirror = Mirror(settings)
        with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
            for files in map(mirror.day, days):
                found = (files.inputs_hash, files.silent)
                if self._taken.get(files.day) == found:
                    continue
                done = finished_before(files, catalogue, settings)
                if done is None:
                    self._waiting[files.day] = files
                else:
                    self._outcomes[files.day] = done
                self._taken[files.day] = found
        self._folders = folders


def folder_times(days: Sequence[date], settings: Settings) -> dict[Path, int]:
    """When something was put into, or taken out of, each folder that days are read from, ns.

    Parameters
    ----------
    days : sequence of datetime.date
    settings : Settings

    Returns
    -------
    dict of Path to int
        Of the folders that are there.
    """
    mirror = settings.mirror_root
    around = (days[0] - DAY, *days, days[-1] + DAY)
    folders = {mirror / folder for one in find_datasets(()) for day in around for folder in one.folders(day)}
    folders.add(mirror / ANSWERS)
    for root in (settings.in_situ, settings.regions):
        if root is not None:
            folders |= {Path(path) for path, _, _ in os.walk(root)}
    return {folder: folder.stat().st_mtime_ns for folder in folders if folder.is_dir()}


def _came(files: DayFiles) -> float:
    """When the newest file of a day came."""
    return max((path.stat().st_ctime for path in files.paths), default=0.0)

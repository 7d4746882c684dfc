"""Watch over the mirror: recent days are processed as their files come, those first whose files came last.

A day whose files are newer than those of all days that are being processed is begun at once, and the workers prefer it:
a new file waits for no more than the step that a worker is at, however many older days are still to be done. A day of
which newer files come while it is processed ends after that step, and is begun again with them.
"""

import os
import queue
import time
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import structlog

from bella.archive import find_datasets
from bella.catalogue import Catalogue
from bella.exceptions import BellaError
from bella.pipeline.day import DAY, known_bursts
from bella.pipeline.day_files import ANSWERS, DayFiles, Mirror
from bella.pipeline.outcome import FAILED, DayOutcome
from bella.pipeline.run import Executor, Pending, Run, awaited, days_between, finished_before
from bella.settings import Settings

log = structlog.get_logger(__name__)

LOOK_S, RETRY_S = 1.0, 60.0
"""Between two looks at the mirror, and before a day that failed is tried again, s."""

OVERTAKING = 2
"""Days that are processed at a time for each worker, where newer files have come than those of others."""

LATEST = timedelta(seconds=5)
"""So long after its time a watch may end; where work took longer, it goes on in place of the next one."""


def watch_days(run: Run, executor: Executor, until: datetime, every: timedelta) -> tuple[DayOutcome, ...]:
    """Process the recent days of the mirror as their files come, for a while.

    Parameters
    ----------
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
        failure = None
        try:
            watch.step(datetime.now(UTC).date())
        except BellaError as error:
            if not error.retriable:
                while watch.is_busy:
                    watch.wait(LOOK_S)
                raise
            failure = error
            log.warning("looks again", reason=str(error))
        while datetime.now(UTC) >= until + LATEST:
            until += every
        if datetime.now(UTC) >= until and not watch.is_busy:
            if failure is not None:
                raise failure
            return watch.outcomes
        watch.wait(LOOK_S)


class Watch:
    """Recent days of the mirror, and what became of them."""

    def __init__(self, run: Run, executor: Executor) -> None:
        self._run, self._executor = replace(run, is_overtaken=self._is_overtaken), executor
        self._folders: dict[Path, int] = {}
        self._taken: dict[date, tuple[str, tuple[str, ...]]] = {}
        self._waiting: dict[date, DayFiles] = {}
        self._again: dict[date, float] = {}
        self._outcomes: dict[date, DayOutcome] = {}
        self._running: dict[date, DayFiles] = {}
        self._done: queue.SimpleQueue[tuple[date, Pending]] = queue.SimpleQueue()

    @property
    def outcomes(self) -> tuple[DayOutcome, ...]:
        """Last outcome of each day, in order."""
        return tuple(self._outcomes[day] for day in sorted(self._outcomes))

    @property
    def is_busy(self) -> bool:
        """Whether days are being processed."""
        return bool(self._running)

    def step(self, today: date) -> None:
        """Look for new files, and begin to process what may be begun.

        Raises
        ------
        BellaError
            If mirror or catalogue cannot be used.
        """
        self._look(today)
        waiting = sorted(self._waiting.values(), key=lambda files: (files.came_s, files.day), reverse=True)
        for files in waiting:
            if files.day not in self._running and self._may_begin(files):
                self._begin(files)

    def wait(self, time_s: float) -> None:
        """Wait until a day is done, but no longer than this, and take note of its outcome."""
        with suppress(queue.Empty):
            day, pending = self._done.get(timeout=time_s)
            del self._running[day]
            self._outcomes[day] = awaited(day, pending)
            if self._outcomes[day].state == FAILED:
                self._again[day] = time.monotonic() + RETRY_S

    def _may_begin(self, files: DayFiles) -> bool:
        number, running = self._run.workers.number, self._running.values()
        newer = sum(one.came_s >= files.came_s for one in running)
        return newer < number and len(running) < OVERTAKING * number

    def _is_overtaken(self, files: DayFiles) -> bool:
        newest = self._waiting.get(files.day, files)  # neighbours that are newer change little, and come after it
        return newest.came_s > files.came_s

    def _begin(self, files: DayFiles) -> None:
        with closing(Catalogue.open(self._run.settings.catalogue_url, create=True)) as catalogue:
            known = known_bursts(catalogue, files.day, files.day)
        self._running[files.day] = self._waiting.pop(files.day)
        pending = self._executor.submit(files, known, self._run)
        pending.add_done_callback(lambda _: self._done.put((files.day, pending)))

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

"""Flows over days: a range that was asked for, the newest days, and the days before them that later data refine."""

from collections.abc import Sequence
from datetime import UTC, date, datetime, timedelta
from typing import Any, cast

from prefect import flow
from prefect.artifacts import create_table_artifact
from prefect.futures import PrefectFuture
from prefect.task_runners import TaskRunner, ThreadPoolTaskRunner

from bella.logs import log_to
from bella.pipeline.burst import Choice
from bella.pipeline.day_files import BroughtFolder
from bella.pipeline.outcome import DayOutcome, check_finished, summary_rows
from bella.pipeline.run import Run, days_between, process_days
from bella.pipeline.workers import Workers
from bella.records import DayAnswer
from bella.settings import Settings, read_settings
from flows.tasks import Tasks, run_name


def side_by_side() -> TaskRunner[PrefectFuture[Any]]:
    """As many days at a time as there are workers, each a task of its own."""
    return cast("TaskRunner[PrefectFuture[Any]]", ThreadPoolTaskRunner(max_workers=read_settings().workers))


def _processed(
    days: Sequence[date],
    archive: str | None,
    choice: Choice,
    settings: Settings,
    brought: BroughtFolder | None = None,
) -> list[DayOutcome]:
    """Outcomes of days; a run with a day that is not done ends as failed."""
    is_asked_for = archive is not None or brought is not None
    log = settings.home / "logs" / "bella.log" if is_asked_for else None
    with Workers(settings.workers, settings, log) as workers:
        done = process_days(days, archive, Run(settings, run_name(), workers, choice), Tasks(), brought)
    rows = [row | {"answers": ""} for row in summary_rows(done.outcomes)]
    create_table_artifact(key="days", table=rows)
    silent = [one for one in done.outcomes if one.answer is DayAnswer.ARCHIVE_SILENT]
    # of a mirror that somebody else fills, it is the filling that fails
    asked = done.outcomes if is_asked_for else [one for one in done.outcomes if one not in silent]
    check_finished(asked, done.unreachable, done.left_out, is_asked_for=is_asked_for)
    return list(done.outcomes)


@flow(name="process-days", validate_parameters=False, task_runner=side_by_side())
def process_range(first: date, last: date, archive: str, choice: Choice) -> list[DayOutcome]:
    """Fetch and process days of an archive.

    Parameters
    ----------
    first, last : datetime.date
        UTC.
    archive : str
        URL or folder.
    choice : Choice

    Returns
    -------
    list of DayOutcome
        In order.

    Raises
    ------
    UnfinishedError
        If a day failed, could not be searched, or the archive did not answer; it holds the outcomes too.
    """
    return _processed(days_between(first, last), archive, choice, Settings())


@flow(name="process-folder", validate_parameters=False, task_runner=side_by_side())
def process_folder(days: Sequence[date], brought: BroughtFolder, choice: Choice) -> list[DayOutcome]:
    """Process days of spectra that a user has brought.

    Parameters
    ----------
    days : sequence of datetime.date
        With records, in order.
    brought : BroughtFolder
    choice : Choice

    Returns
    -------
    list of DayOutcome
        In order.

    Raises
    ------
    UnfinishedError
        If a day failed, could not be searched, or a file was left out; it holds the outcomes too.
    """
    return _processed(days, None, choice, Settings(), brought)


@flow(name="days", task_runner=side_by_side())
def newest_days() -> int:
    """Process the newest days of the mirror; returns how many solutions are new."""
    settings, today = _scheduled(), datetime.now(UTC).date()
    first = today - timedelta(days=min(settings.newest_days, settings.recent_days))
    return _new(first, today, settings) if settings.recent_days else 0


@flow(name="refinement", task_runner=side_by_side())
def earlier_days() -> int:
    """Process the days before the newest where later data came in; returns how many solutions are new."""
    settings, today = _scheduled(), datetime.now(UTC).date()
    last = today - timedelta(days=settings.newest_days + 1)
    first = today - timedelta(days=settings.recent_days)
    return _new(first, last, settings) if first <= last else 0


def _scheduled() -> Settings:
    log_to(None)  # a worker starts each run as a process of its own
    return Settings()


def _new(first: date, last: date, settings: Settings) -> int:
    outcomes = _processed(days_between(first, last), None, Choice(), settings)
    return sum(one.new for day in outcomes for one in (*day.localised, *day.preliminary))

"""Flows over days: a range or a folder that was asked for, and the recent days of the mirror as their files come."""

from collections.abc import Sequence
from datetime import date, timedelta
from typing import Any, cast

from prefect import flow
from prefect.artifacts import create_table_artifact
from prefect.futures import PrefectFuture
from prefect.runtime import flow_run
from prefect.task_runners import TaskRunner, ThreadPoolTaskRunner

from bella.logs import log_to
from bella.pipeline.burst import Choice
from bella.pipeline.day_files import BroughtFolder
from bella.pipeline.outcome import DayOutcome, check_finished, summary_rows
from bella.pipeline.run import Run, days_between, process_days
from bella.pipeline.watch import watch_days
from bella.pipeline.workers import Workers
from bella.records import DayAnswer
from bella.settings import Settings, read_settings
from flows.tasks import Tasks, run_name

ENDS_BEFORE = timedelta(seconds=20)
"""So long before the next run is due this one ends: Prefect asks for its place ten seconds early."""


def side_by_side() -> TaskRunner[PrefectFuture[Any]]:
    """As many days at a time as there are workers, each a task of its own."""
    return cast("TaskRunner[PrefectFuture[Any]]", ThreadPoolTaskRunner(max_workers=read_settings().workers))


def _asked_for(
    days: Sequence[date], archive: str | None, choice: Choice, brought: BroughtFolder | None = None
) -> list[DayOutcome]:
    """Outcomes of days that somebody waits for; a run with a day that is not done ends as failed."""
    settings = Settings()
    with Workers(settings.workers, settings, settings.home / "logs" / "bella.log") as workers:
        done = process_days(days, archive, Run(settings, run_name(), workers, choice), Tasks(), brought)
    _show(done.outcomes)
    check_finished(done.outcomes, done.unreachable, done.left_out)
    return list(done.outcomes)


def _show(outcomes: Sequence[DayOutcome]) -> None:
    create_table_artifact(key="days", table=[row | {"answers": ""} for row in summary_rows(outcomes)])


@flow(name="process-days", validate_parameters=False, task_runner=side_by_side())
def process_range(first: date, last: date, archive: str, choice: Choice) -> list[DayOutcome]:
    """Fetch and process days of an archive.

    Raises
    ------
    UnfinishedError
        If a day failed, could not be searched, or the archive did not answer; it holds the outcomes too.
    """
    return _asked_for(days_between(first, last), archive, choice)


@flow(name="process-folder", validate_parameters=False, task_runner=side_by_side())
def process_folder(days: Sequence[date], brought: BroughtFolder, choice: Choice) -> list[DayOutcome]:
    """Process days of spectra that a user has brought.

    Raises
    ------
    UnfinishedError
        If a day failed, could not be searched, or a file was left out; it holds the outcomes too.
    """
    return _asked_for(days, None, choice, brought)


@flow(name="days", task_runner=side_by_side())
def recent_days() -> int:
    """Process the recent days of the mirror as their files come, until the next run is due; returns new solutions."""
    log_to(None)  # a worker starts each run as a process of its own
    settings = Settings()
    if not settings.recent_days:
        return 0
    due, every = flow_run.get_scheduled_start_time(), timedelta(seconds=settings.days_schedule_s)
    with Workers(settings.workers, settings) as workers:
        outcomes = watch_days(Run(settings, run_name(), workers), Tasks(), due + every - ENDS_BEFORE, every)
    _show(outcomes)
    # that the archive is silent is the fetcher's failure
    check_finished([one for one in outcomes if one.answer is not DayAnswer.ARCHIVE_SILENT], is_asked_for=False)
    return sum(one.new for day in outcomes for one in (*day.localised, *day.preliminary))

"""Flows over days: those that were asked for, and the recent days of the mirror as their files come."""

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
from bella.pipeline.run import process_days
from bella.pipeline.watch import OVERTAKING, watch_days
from bella.settings import Settings, read_settings
from flows.tasks import Tasks, this_run

ENDS_BEFORE = timedelta(seconds=20)
"""So long before the next run is due this one ends: Prefect asks for its place ten seconds early."""


def side_by_side(each: int = 1) -> TaskRunner[PrefectFuture[Any]]:
    """So many days at a time for each worker, every one a task of its own."""
    return cast("TaskRunner[PrefectFuture[Any]]", ThreadPoolTaskRunner(max_workers=each * read_settings().workers))


def _show(outcomes: Sequence[DayOutcome]) -> None:
    create_table_artifact(key="days", table=[row | {"answers": ""} for row in summary_rows(outcomes)])


@flow(name="process-days", validate_parameters=False, task_runner=side_by_side())
def process_range(
    days: Sequence[date], archive: str | None, choice: Choice, brought: BroughtFolder | None = None
) -> list[DayOutcome]:
    """Fetch and process days of an archive, or process those of spectra that a user has brought.

    Raises
    ------
    UnfinishedError
        See :func:`bella.pipeline.outcome.check_finished`; it holds the outcomes too.
    """
    settings = Settings()
    with this_run(settings, settings.workers, choice, settings.home / "logs" / "bella.log") as run:
        done = process_days(days, archive, run, Tasks(), brought)
    _show(done.outcomes)
    check_finished(done.outcomes, done.unreachable, done.left_out)
    return list(done.outcomes)


@flow(name="days", task_runner=side_by_side(OVERTAKING))
def recent_days() -> int:
    """Process the recent days of the mirror as their files come, until the next run is due; returns new solutions."""
    log_to(None)  # a worker starts each run as a process of its own
    settings = Settings()
    if not settings.recent_days:
        return 0
    due, every = flow_run.get_scheduled_start_time(), timedelta(seconds=settings.days_schedule_s)
    with this_run(settings, settings.workers) as run:
        run.workers.start()
        outcomes = watch_days(run, Tasks(), due + every - ENDS_BEFORE, every)
    _show(outcomes)
    check_finished(outcomes, is_asked_for=False)
    return sum(one.new for one in outcomes)

"""What all flows share: tasks that are tried again where that may help, and one line for a Prefect that is away."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import httpx
from prefect import task
from prefect.cache_policies import NO_CACHE
from prefect.client.schemas.objects import State, TaskRun
from prefect.exceptions import PrefectException
from prefect.runtime import flow_run
from prefect.tasks import Task

from bella.exceptions import BellaError, UnreachableError
from bella.pipeline.burst import Choice
from bella.pipeline.day import KnownBurst
from bella.pipeline.day_files import DayFiles, fetch_range
from bella.pipeline.run import RETRY_DELAYS_S, Pending, Run, process_day, process_subject
from bella.pipeline.workers import Workers
from bella.settings import Settings

P = ParamSpec("P")
R = TypeVar("R")


def is_retriable(_task: Task[..., Any], _run: TaskRun, state: State[Any]) -> bool:
    """Try again only where the class of the error says that trying again can help."""
    error = state.result(raise_on_failure=False, _sync=True)  # type: ignore[call-overload]
    return isinstance(error, BellaError) and error.retriable


def batch(name: str) -> Callable[[Callable[P, R]], Task[P, R]]:
    """Declare a task that retries what is retriable, and whose arguments and results stay in memory."""
    return task(
        name=name,
        retries=len(RETRY_DELAYS_S),
        retry_delay_seconds=list(RETRY_DELAYS_S),
        retry_condition_fn=is_retriable,
        cache_policy=NO_CACHE,
    )


fetch, day, burst = batch("fetch")(fetch_range), batch("day")(process_day), batch("burst")(process_subject)


class Tasks:
    """Executor whose steps are tasks of the flow that is running; its task runner says how many run at a time."""

    def fetch(self, days: Sequence[date], archive: str, settings: Settings) -> tuple[str, ...]:
        """See :class:`bella.pipeline.run.Executor`."""
        return fetch(days, archive, settings)

    def submit(self, files: DayFiles, known: Sequence[KnownBurst], run: Run) -> Pending:
        """See :class:`bella.pipeline.run.Executor`."""
        return day.submit(files, list(known), run)


@contextmanager
def this_run(
    settings: Settings, workers: int = 1, choice: Choice | None = None, log: Path | None = None
) -> Iterator[Run]:
    """What the flow that is running works with: it holds leases, and logs, under the id of its run."""
    with Workers(workers, settings, log) as pool:
        yield Run(settings, str(flow_run.get_id()), pool, choice or Choice())


@contextmanager
def answering() -> Iterator[None]:
    """One line for a Prefect server that does not answer.

    Raises
    ------
    UnreachableError
        In place of the errors of Prefect's client.
    """
    try:
        yield
    except (httpx.HTTPError, PrefectException) as error:
        raise UnreachableError(
            f"Prefect does not answer ({type(error).__name__}): see that it runs, and run again"
        ) from error

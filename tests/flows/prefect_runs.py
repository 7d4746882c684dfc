"""What only a Prefect server can show: runs of workers that were killed, tasks that are tried again, what is served."""

import json
import os
import sys
from datetime import date, datetime, timedelta
from typing import Any

from bella.exceptions import StoreError, UnreachableError
from bella.pipeline.workers import prepare
from bella.settings import Settings

prepare(Settings())

import prefect  # noqa: E402
from prefect import flow  # noqa: E402
from prefect.client.orchestration import get_client  # noqa: E402
from prefect.client.schemas.sorting import FlowRunSort  # noqa: E402
from prefect.states import Cancelled, Pending, Running, State  # noqa: E402

from bella.pipeline.burst import Choice  # noqa: E402
from flows import days, serve, tasks  # noqa: E402
from flows.embedded import prefect_server  # noqa: E402

AWAY, FULL = UnreachableError("the archive is away"), StoreError("the disk is full")
STATES = {"running": Running(), "pending": Pending(), "cancelled": Cancelled()}


def ended() -> dict[str, str]:
    """State of runs of two deployments after the worker of the first was started."""
    with get_client(sync_client=True) as client:
        names = ["submissions", "ingest"]
        numbers = {one.flow_name: one.apply() for one in serve._deployments(names, Settings())}
        runs = {
            f"{name} {word}": client.create_flow_run_from_deployment(numbers[name], state=state).id
            for name, word, state in [("submissions", *one) for one in STATES.items()]
            + [("ingest", "running", Running())]
        }
        serve._end_dead_runs(["submissions"])
        return {name: _said(client.read_flow_run(number).state) for name, number in runs.items()}


def _said(state: State[object] | None) -> str:
    return f"{state.type.value} {state.message}" if state else ""


def tried() -> dict[str, object]:
    """How often a task was tried, and its result, by what it meets one after the other."""
    asked: list[str] = []

    def _step(name: str, meets: list[Exception]) -> int:
        asked.append(name)
        if meets:
            raise meets.pop(0)
        return asked.count(name)

    tasks.RETRY_DELAYS_S = (0.0, 0.0)
    step = tasks.batch("step")(_step)

    @flow(validate_parameters=False)
    def _all() -> dict[str, object]:
        return {
            "away twice": step("away twice", [AWAY, AWAY]),
            "away": str(step("away", [AWAY] * 3, return_state=True).result(raise_on_failure=False)),
            "full": str(step("full", [FULL], return_state=True).result(raise_on_failure=False)),
            "again": [step("again", []) for _ in range(2)],
        }

    return {"results": _all(), "tried": {name: asked.count(name) for name in dict.fromkeys(asked)}}


def silent() -> list[str]:
    """Type and message of the state of a run over a day whose archive does not answer."""
    folder = Settings().home / "moved"
    folder.mkdir()
    state = days.process_range([date(2021, 2, 1)], str(folder), Choice(), return_state=True)
    with get_client(sync_client=True) as client:
        (kept,) = client.read_flow_runs(sort=FlowRunSort.START_TIME_DESC, limit=1)
    assert kept.state is not None
    return [state.type.value, kept.state.type.value, str(kept.state.message)]


def served() -> list[str]:
    """Deployments of a worker that was given no names."""
    found: list[str] = []
    prefect.serve = lambda *deployments, **_: found.extend(one.flow_name for one in deployments)
    serve.main()
    return sorted(found)


def watched() -> list[tuple[float, float, int]]:
    """How long a run watches, the time between two, and workers: with recent days only."""
    found = []

    def _watch(run: Any, _executor: Any, until: datetime, every: timedelta) -> tuple[()]:
        due = days.flow_run.get_scheduled_start_time()
        found.append(((until - due).total_seconds(), every.total_seconds(), run.workers.number))
        return ()

    days.watch_days = _watch
    for number in ("0", "3"):
        os.environ |= {"BELLA_RECENT_DAYS": number, "BELLA_DAYS_SCHEDULE_S": "600", "BELLA_WORKERS": "1"}
        assert days.recent_days() == 0
    return found


if __name__ == "__main__":
    with prefect_server():
        found = {"ended": ended(), **tried(), "silent": silent(), "served": served(), "watched": watched()}
        sys.stdout.write(json.dumps(found) + "\n")

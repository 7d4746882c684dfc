"""Prefect's part: which deployments there are, one run of each at a time, and errors in one line."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import pytest
from prefect.exceptions import PrefectException

from bella.exceptions import BellaError, InputError, UnreachableError
from bella.settings import Settings
from flows import serve
from flows.tasks import answering

NAMES = {"submissions", "days", "mock-burst", "housekeeping", "ingest"}


def deployments(settings: Settings) -> list[Any]:
    """From a thread of its own: where a browser of another test has left a loop, Prefect gives coroutines."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(serve._deployments, sorted(NAMES), settings).result()


def test_every_deployment_runs_once_at_a_time_and_missed_runs_are_one() -> None:
    settings = Settings(schedule_s=7.0, days_schedule_s=11.0)
    assert set(serve.intervals_s(settings)) == NAMES
    found = {one.flow_name: one for one in deployments(settings)}
    assert set(found) == NAMES
    for name, one in found.items():
        assert one.name == "scheduled"
        assert one.description
        assert one.concurrency_limit == 1
        assert one.concurrency_options.collision_strategy.value == "CANCEL_NEW"
        (schedule,) = one.schedules
        assert schedule.schedule.interval.total_seconds() == serve.intervals_s(settings)[name]
    assert serve.intervals_s(settings)["submissions"] == 7.0
    assert serve.intervals_s(settings)["days"] == 11.0


def test_runs_of_a_worker_that_was_killed_are_ended_and_no_others(tmp_path: Path) -> None:
    environment = {"PATH": os.environ["PATH"], "HOME": str(tmp_path), "BELLA_HOME": str(tmp_path / "home")}
    code = [sys.executable, "-m", "tests.flows.dead_runs"]
    done = subprocess.run(code, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-2:] == ["submissions: CRASHED its worker was killed", "ingest: RUNNING None"]


def test_a_deployment_that_is_not_there_is_refused() -> None:
    with pytest.raises(InputError, match="no deployment 'backup': choose from submissions, days"):
        serve.main(["backup"])


@pytest.mark.parametrize("error", [httpx.ConnectError("refused"), PrefectException("gone")])
def test_a_prefect_that_is_away_is_one_line(error: Exception) -> None:
    with pytest.raises(UnreachableError, match="Prefect does not answer"), answering():
        raise error


def test_other_errors_stay_what_they_are() -> None:
    with pytest.raises(BellaError, match="as it was"), answering():
        raise BellaError("as it was")

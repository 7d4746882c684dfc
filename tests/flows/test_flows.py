"""Prefect's part: which deployments there are, one run of each at a time, and errors in one line."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import pytest
from prefect.exceptions import PrefectException

from bella.exceptions import BellaError, InputError, UnreachableError
from bella.settings import Settings
from flows import serve
from flows.tasks import answering
from tests.commands import Sandbox

NAMES = {"submissions", "days", "mock-burst", "housekeeping", "ingest"}


def deployments(settings: Settings) -> list[Any]:
    """From a thread of its own: where a browser of another test has left a loop, Prefect gives coroutines."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(serve._deployments, sorted(NAMES), settings).result()


def test_every_deployment_runs_once_at_a_time_and_missed_runs_are_one() -> None:
    settings = Settings(schedule_s=7.0, days_schedule_s=11.0)
    assert set(serve.intervals_s(settings)) == NAMES
    now = datetime.now(UTC)
    found = {one.flow_name: one for one in deployments(settings)}
    assert set(found) == NAMES
    for name, one in found.items():
        assert one.name == "scheduled"
        assert one.description
        assert one.concurrency_limit == 1
        assert one.concurrency_options.collision_strategy.value == "CANCEL_NEW"
        (schedule,) = one.schedules
        assert schedule.schedule.interval.total_seconds() == serve.intervals_s(settings)[name]
        assert timedelta() < schedule.schedule.anchor_date - now < timedelta(minutes=1), "at once"
    assert serve.intervals_s(settings)["submissions"] == 7.0
    assert serve.intervals_s(settings)["days"] == 11.0


@pytest.fixture(scope="module")
def with_prefect(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    home = tmp_path_factory.mktemp("prefect")
    environment = {"PATH": os.environ["PATH"], "HOME": str(home), "BELLA_HOME": str(home / "home")}
    code = [sys.executable, "-m", "tests.flows.prefect_runs"]
    done = subprocess.run(code, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout.splitlines()[-1]))


def test_runs_of_a_worker_that_was_killed_are_ended_and_no_others(with_prefect: dict[str, Any]) -> None:
    assert with_prefect["ended"] == {
        "submissions running": "CRASHED its worker was killed",
        "submissions pending": "CRASHED its worker was killed",
        "submissions cancelled": "CANCELLED None",
        "ingest running": "RUNNING None",
    }


def test_a_task_is_tried_three_times_where_that_may_help_and_nothing_is_remembered(
    with_prefect: dict[str, Any],
) -> None:
    assert with_prefect["tried"] == {"away twice": 3, "away": 3, "full": 1, "again": 2}
    assert with_prefect["results"] == {
        "away twice": 3,
        "away": "the archive is away",
        "full": "the disk is full",
        "again": [1, 2],
    }


def test_a_run_over_days_that_the_archive_did_not_answer_for_has_failed(with_prefect: dict[str, Any]) -> None:
    given, kept, message = with_prefect["silent"]
    assert (given, kept) == ("FAILED", "FAILED")
    assert "1 of 1 day is not done: 2021-02-01" in message


def test_a_worker_serves_all_but_what_needs_a_way_to_the_archives(with_prefect: dict[str, Any]) -> None:
    assert set(with_prefect["served"]) == NAMES - {"ingest"}


def test_a_watch_ends_before_the_next_one_asks_for_its_place(with_prefect: dict[str, Any]) -> None:
    """Prefect asks ten seconds early; without recent days there is nothing to watch."""
    ((lasts_s, every_s, workers),) = with_prefect["watched"]
    assert (every_s, workers) == (600.0, 1)
    assert 500.0 < lasts_s < every_s - 10.0


def test_a_deployment_that_is_not_there_is_refused() -> None:
    with pytest.raises(InputError, match="no deployment 'backup': choose from submissions, days"):
        serve.main(["backup"])


def test_a_worker_without_a_prefect_server_is_refused(sandbox: Sandbox) -> None:
    """The server that a run starts for itself schedules nothing: the worker would wait for ever, and say nothing."""
    ended = sandbox.run(sys.executable, "-m", "flows.serve", code=1)
    assert ended.stderr.startswith("flows.serve: PREFECT_API_URL is not set")
    assert ended.stderr.count("\n") == 1


@pytest.mark.parametrize("error", [httpx.ConnectError("refused"), PrefectException("gone")])
def test_a_prefect_that_is_away_is_one_line(error: Exception) -> None:
    with pytest.raises(UnreachableError, match="Prefect does not answer"), answering():
        raise error


def test_other_errors_stay_what_they_are() -> None:
    with pytest.raises(BellaError, match="as it was"), answering():
        raise BellaError("as it was")

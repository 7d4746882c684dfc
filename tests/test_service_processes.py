"""The commands of docker-compose.yml as processes: a table that is submitted becomes a burst, also without Prefect.

What else may die, and the built-in burst with all its edges: `tests/acceptance/test_service_processes.py`.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.service_processes.running import SUBMITTED_MHZ, Running, running_services

pytestmark = pytest.mark.service


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with running_services(tmp_path_factory.mktemp("services"), {"submissions"}) as up:
        yield up


@pytest.fixture(scope="module")
def submitted(running: Running) -> str:
    """Id of a burst that was submitted and localised."""
    expected = running.submit(days_later=2)
    running.wait_for(expected)
    return expected


def test_a_submitted_table_becomes_a_burst_of_the_api(running: Running, submitted: str) -> None:
    (solution,) = running.bursts()[submitted]["solutions"]
    assert solution["version"] == 1
    track = running.get(f"/api/v1/bursts/{submitted}/track").json()
    assert len(track["localisations"]) == SUBMITTED_MHZ.size
    assert track["track_fit"]["joint"]["times"] == 3 * SUBMITTED_MHZ.size


def test_api_answers_while_prefect_is_away_and_the_worker_catches_up(running: Running, submitted: str) -> None:
    running.processes.kill("prefect")
    assert submitted in running.bursts()
    assert running.get("/health/api").status_code == 200
    expected = running.submit(days_later=5)
    running.start("prefect")
    running.wait_for(expected)


def test_nothing_is_written_outside_home_and_temporary_folder(running: Running) -> None:
    assert list(running.processes.work.rglob("*")) == []
    assert not Path("/nonexistent").exists()

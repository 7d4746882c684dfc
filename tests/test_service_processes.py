"""The commands of docker-compose.yml as processes: a table that is submitted becomes a burst.

What may die, and the built-in burst with all its edges: `tests/acceptance/test_service_processes.py`.
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


def test_a_submitted_table_becomes_a_burst_of_the_api(running: Running) -> None:
    submitted = running.submit(days_later=2)
    running.wait_for(submitted)
    (solution,) = running.bursts()[submitted]["solutions"]
    assert solution["version"] == 1
    track = running.get(f"/api/v1/bursts/{submitted}/track").json()
    assert len(track["localisations"]) == SUBMITTED_MHZ.size
    assert track["track_fit"]["joint"]["times"] == 3 * SUBMITTED_MHZ.size


def test_nothing_is_written_outside_home_and_temporary_folder(running: Running) -> None:
    assert list(running.processes.work.rglob("*")) == []
    assert not Path("/nonexistent").exists()

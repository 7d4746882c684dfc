"""The whole service as processes: the built-in burst with all its edges, a worker that is killed, a backup.

Every run is a process that starts Prefect anew, and the burst has four fits with everything that is compared to them.
"""

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import psycopg
import pytest
from sqlalchemy import make_url

from bella.bursts.event import EVENT
from bella.catalogue import Catalogue
from bella.store import open_group
from tests.service_processes.postgres import complete_postgres
from tests.service_processes.running import Running, running_services
from tests.waiting import until

pytestmark = [pytest.mark.service, pytest.mark.acceptance]


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with running_services(tmp_path_factory.mktemp("services"), {"submissions", "housekeeping"}) as up:
        up.wait_for(EVENT.burst_id)
        yield up


def test_built_in_burst_arrives_through_the_api(running: Running) -> None:
    solutions = running.bursts()[EVENT.burst_id]["solutions"]
    assert {solution["edge"] for solution in solutions} <= {
        "gauss_hermite",
        "half_maximum",
        "half_rise",
        "shared_profile",
    }
    track = running.get(f"/api/v1/bursts/{EVENT.burst_id}/track").json()
    assert track["track_fit"]["two_step"]["v_sw_km_s"]["mean"] > 0


def test_killed_worker_loses_nothing_and_doubles_nothing(running: Running) -> None:
    with closing(Catalogue.open(running.catalogue_url)) as catalogue:
        until(lambda: len(catalogue.versions(EVENT.burst_id)) == 4, "the built-in burst is done by all its edges")
        expected = [running.submit(days_later) for days_later in (2, 3)]
        until(
            lambda: any(run.state == "running" and run.subject in expected for run in catalogue.stage_runs(5)),
            lambda: f"the worker is at work on a table\n{running.processes.told()}",
        )
        running.processes.kill("worker")
        assert catalogue.pending_submissions() != ()
        running.start("worker", "submissions")
        running.wait_for(*expected)
        until(lambda: catalogue.pending_submissions() == (), "every table is done")
        for burst in running.bursts():
            versions = catalogue.versions(burst)
            assert {solution.version for solution in versions} == {1}
            assert len(versions) == (4 if burst == EVENT.burst_id else 1)
        assert [path for path in catalogue.referenced_paths() if not (running.home / "store" / path).is_file()] == []


def test_api_answers_while_prefect_is_away_and_the_worker_catches_up(running: Running) -> None:
    running.processes.kill("prefect")
    assert EVENT.burst_id in running.bursts()
    assert running.get("/health/api").status_code == 200
    expected = running.submit(days_later=5)
    running.start("prefect")
    running.wait_for(expected)


def test_backup_that_is_taken_while_the_service_runs_can_be_restored(running: Running, tmp_path: Path) -> None:
    programs = complete_postgres()
    if programs is None:
        pytest.skip("no PostgreSQL of the system, and so no pg_dump")
    source = make_url(running.catalogue_url).set(drivername="postgresql")
    target = source.set(database="restored")
    with psycopg.connect(source.render_as_string(hide_password=False), autocommit=True) as connection:
        connection.execute("CREATE DATABASE restored")
    for program, url, *options in (
        ("pg_dump", source, "--format=custom", f"--file={tmp_path / 'bella.dump'}"),
        ("pg_restore", target, "--clean", "--if-exists", str(tmp_path / "bella.dump")),
    ):
        place = f"--dbname={url.render_as_string(hide_password=False)}"
        subprocess.run([programs / program, place, *options], check=True)
    store = shutil.copytree(running.home / "store", tmp_path / "store")
    restored = target.set(drivername="postgresql+psycopg").render_as_string(hide_password=False)
    with closing(Catalogue.open(restored)) as catalogue:
        assert EVENT.burst_id in {one.burst.burst_id for one in catalogue.bursts().bursts}
        for solution in catalogue.versions(EVENT.burst_id):
            assert open_group(store, solution.store_path).attrs["burst_id"] == EVENT.burst_id

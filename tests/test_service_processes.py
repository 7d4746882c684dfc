"""The commands of docker-compose.yml as processes: a burst arrives through the API, and stays when things die."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import UUID

import httpx
import numpy as np
import psycopg
import pytest
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.sorting import DeploymentSort
from sqlalchemy import make_url

from bella.arrivals import arrivals_csv
from bella.bursts.event import EVENT, half_maximum_arrivals
from bella.catalogue import Catalogue
from bella.store import open_group
from tests.service_processes.compose import Places
from tests.service_processes.postgres import PASSWORD, Databases, complete_postgres, databases
from tests.service_processes.processes import Processes, free_port
from tests.waiting import PATIENCE_S, until

pytestmark = pytest.mark.service

SERVED = ("prefect", "worker", "api")
SCHEDULES = {"BELLA_SCHEDULE_S": "30", "BELLA_LEASE_S": "30", "BELLA_DRAWS": "200"}
"""A run that finds nothing starts Python and Prefect: with no pause between them a busy machine does nothing else."""

NEEDED, IDLE = {"submissions", "housekeeping"}, {"days", "mock-burst"}
ASKED_AFTER_S = 1.0
CLIENT = httpx.Client(trust_env=False, timeout=PATIENCE_S)
SUBMITTED_MHZ = np.geomspace(0.15, 2.0, 8)


@dataclass(frozen=True)
class Running:
    """Prefect's server, worker and API, all up."""

    processes: Processes
    places: Places
    ports: dict[str, int]
    home: Path
    catalogue_url: str

    def start(self, service: str, *deployments: str) -> None:
        """Start a service and wait until its own health check is content."""
        port = self.ports.get(service)
        environment = {"HOME": "/nonexistent", "TMPDIR": self.places.moved["/tmp/prefect"]}
        environment |= self.places.environment(service)
        self.processes.start(service, [*self.places.command(service, port), *deployments], environment)
        check = self.places.health_check(service, port)

        def healthy() -> bool:
            assert self.processes.is_up(service), f"{service} ended\n{self.processes.told()}"
            asked = subprocess.run(check, env={**os.environ, **environment}, capture_output=True, check=False)
            return asked.returncode == 0

        until(healthy, lambda: f"{service} healthy\n{self.processes.told()}", ASKED_AFTER_S)

    def prefect(self) -> SyncPrefectClient:
        return SyncPrefectClient(f"http://127.0.0.1:{self.ports['prefect']}/api")

    def leave_out(self, names: set[str]) -> None:
        """Pause deployments that no test needs, before their first run."""
        with self.prefect() as client:

            def declared() -> dict[str, UUID]:
                found = client.read_deployments(limit=20, sort=DeploymentSort.NAME_ASC)
                return {client.read_flow(one.flow_id).name: one.id for one in found}

            until(lambda: set(declared()) == NEEDED | IDLE, "every deployment is declared", ASKED_AFTER_S)
            for name, key in declared().items():
                if name in names:
                    client.pause_deployment(key)

    def get(self, path: str) -> httpx.Response:
        return CLIENT.get(f"http://127.0.0.1:{self.ports['api']}{path}")

    def bursts(self) -> dict[str, Any]:
        """Bursts of the API by their id."""
        reply = self.get("/api/v1/bursts?limit=1000")
        assert reply.status_code == 200, reply.text
        return {burst["burst_id"]: burst for burst in reply.json()["bursts"]}

    def submit(self, days_later: int) -> str:
        """Submit the arrival times of the built-in burst, as if on a later day; returns the id it gets."""
        table = half_maximum_arrivals(SUBMITTED_MHZ)
        table["arrival_utc"] += np.timedelta64(days_later, "D")
        url = f"http://127.0.0.1:{self.ports['api']}/api/v1/arrivals"
        with closing(Catalogue.open(self.catalogue_url)) as catalogue:
            _, secret = catalogue.create_token(f"Ann, {days_later}")
        headers = {"Content-Type": "text/csv", "Authorization": f"Bearer {secret}"}
        reply = CLIENT.post(url, content=arrivals_csv(table).encode(), headers=headers)
        assert reply.status_code == 202, reply.text
        return str(reply.json()["submission_id"])

    def wait_for(self, *burst_ids: str) -> None:
        until(
            lambda: set(burst_ids) <= set(self.bursts()),
            lambda: f"{burst_ids}\n{self.processes.told()}",
            ASKED_AFTER_S,
        )


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """Everything docker-compose.yml runs, each service once its dependencies are healthy."""
    folders = {name: tmp_path_factory.mktemp(name) for name in ("home", "logs", "work", "temporary", "database")}
    processes = Processes(work=folders["work"], logs=folders["logs"])
    with databases(folders["database"]) as kept:
        try:
            up = _arranged(processes, kept, folders["home"], folders["temporary"])
            for service in SERVED:
                up.start(service)
                if service == "worker":
                    up.leave_out(IDLE)
            up.wait_for(EVENT.burst_id)
            yield up
        finally:
            escaped = processes.end()
    assert escaped == [], "processes outlived the service that started them"


def _arranged(processes: Processes, kept: Databases, home: Path, temporary: Path) -> Running:
    ports = {"prefect": free_port(), "api": free_port()}
    variables = {"BELLA_DB_PASSWORD": PASSWORD, **SCHEDULES}
    moved = {
        f"postgresql+psycopg://bella:{PASSWORD}@database:5432/bella": kept.catalogue,
        f"postgresql+asyncpg://bella:{PASSWORD}@database:5432/prefect": kept.prefect,
        "http://prefect:4200": f"http://127.0.0.1:{ports['prefect']}",
        "/var/lib/bella": str(home),
        "/tmp/prefect": str(temporary),
    }
    return Running(processes, Places(moved, variables), ports, home, kept.catalogue)


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


def test_nothing_is_written_outside_home_and_temporary_folder(running: Running) -> None:
    assert list(running.processes.work.rglob("*")) == []
    assert not Path("/nonexistent").exists()

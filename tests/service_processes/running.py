"""Prefect's server, worker and API of docker-compose.yml as processes, on real databases."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import UUID

import httpx
import numpy as np
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.sorting import DeploymentSort

from bella.arrivals import arrivals_csv
from bella.bursts.event import half_maximum_arrivals
from bella.catalogue import Catalogue
from tests.service_processes.compose import Places
from tests.service_processes.postgres import PASSWORD, Databases, databases
from tests.service_processes.processes import Processes, free_port
from tests.waiting import PATIENCE_S, until

SERVED = ("prefect", "worker", "api")
SCHEDULES = {"BELLA_SCHEDULE_S": "30", "BELLA_LEASE_S": "30", "BELLA_DRAWS": "200"}
"""A run that finds nothing starts Python and Prefect: with no pause between them a busy machine does nothing else."""

DEPLOYMENTS = {"submissions", "housekeeping", "days", "mock-burst"}
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

            until(lambda: set(declared()) == DEPLOYMENTS, "every deployment is declared", ASKED_AFTER_S)
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


@contextmanager
def running_services(folder: Path, needed: set[str]) -> Iterator[Running]:
    """Everything docker-compose.yml runs, each service once its dependencies are healthy; of the deployments a few."""
    folders = {name: folder / name for name in ("home", "logs", "work", "temporary", "database")}
    for one in folders.values():
        one.mkdir()
    processes = Processes(work=folders["work"], logs=folders["logs"])
    with databases(folders["database"]) as kept:
        try:
            up = _arranged(processes, kept, folders["home"], folders["temporary"])
            for service in SERVED:
                up.start(service)
                if service == "worker":
                    up.leave_out(DEPLOYMENTS - needed)
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

"""How the service is, for people (`/status`), programs (`/api/v1/status`, `/health`) and Prometheus (`/metrics`)."""

import os
from collections.abc import Callable
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

import structlog
from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, Gauge, generate_latest
from pydantic import Field

from api.links import API
from api.rendering import render
from api.replies import Reply
from api.schemas import HealthReply
from api.service import CatalogueHere, Service, ServiceHere
from bella import __version__
from bella.catalogue import Catalogue, Freshness, Latency, MockRun
from bella.exceptions import BellaError, StoreError
from bella.pipeline.alive import Disk, Link, chain, disk_of

router = APIRouter(tags=["service"])

WATCHED_SINCE = datetime.now(UTC)
"""When this process was started."""

log = structlog.get_logger(__name__)


class QueueReply(Reply):
    """What waits and what is being done."""

    waiting_submissions: int
    running: int = Field(description="Runs under way: searches of days, localisations of bursts.")
    failed_today: int = Field(description="Runs that failed since midnight UTC; each is tried again.")
    last_started_utc: datetime | None


class StatusReply(Reply):
    """How the service is."""

    utc: datetime
    version: str
    chain: list[Link] = Field(description="Links from archive to page, each ok, stale or not in use.")
    freshness: list[Freshness] = Field(description="Data sets that are asked for on a schedule.")
    latency: dict[str, Latency] = Field(
        description="Of the newest 1000 solutions of archive data, s: from when the archive listed the last of their "
        "files, when it was fetched, when the search of the day had ended, and when the burst ended."
    )
    queue: QueueReply
    last_mock_burst: MockRun | None
    disk: Disk | None
    solutions: int = Field(description="In the catalogue, superseded ones too.")


def status_of(service: Service, catalogue: Catalogue) -> StatusReply:
    """How the service is now."""
    now, operation = datetime.now(UTC), catalogue.operation
    work = operation.work(now.replace(hour=0, minute=0, second=0, microsecond=0))
    waiting = len(catalogue.pending_submissions())
    return StatusReply(
        utc=now,
        version=__version__,
        chain=list(chain(operation, service.settings, now, WATCHED_SINCE)),
        freshness=list(operation.freshness()),
        latency=operation.latencies(),
        queue=QueueReply(
            waiting_submissions=waiting,
            running=work.running,
            failed_today=work.failed,
            last_started_utc=work.last_started_utc,
        ),
        last_mock_burst=operation.last_mock(),
        disk=disk_of(service.settings),
        solutions=operation.solutions(),
    )


@router.get(f"{API}/status")
def status(service: ServiceHere, catalogue: CatalogueHere, response: Response) -> StatusReply:
    """How fresh each data set is, how long solutions take, what waits, the last mock burst, and room on the disk."""
    response.headers["Cache-Control"] = "no-store"
    return status_of(service, catalogue)


@router.get("/status", include_in_schema=False)
def status_page(request: Request, service: ServiceHere, catalogue: CatalogueHere) -> HTMLResponse:
    """The same for people."""
    return render(request, "status.html", status_now=status_of(service, catalogue))


@router.get("/metrics", include_in_schema=False)
def metrics(service: ServiceHere, catalogue: CatalogueHere) -> Response:
    """The same for Prometheus, in its text format."""
    content = generate_latest(_registry(status_of(service, catalogue)))
    return Response(content, media_type=CONTENT_TYPE_LATEST, headers={"Cache-Control": "no-store"})


def _registry(now: StatusReply) -> CollectorRegistry:
    registry = CollectorRegistry()

    def _gauge(name: str, words: str, value: float | None, **labels: str) -> None:
        known = registry._names_to_collectors.get(f"bella_{name}")
        gauge: Any = known or Gauge(f"bella_{name}", words, list(labels), registry=registry)
        (gauge.labels(**labels) if labels else gauge).set(float("nan") if value is None else value)

    for link in now.chain:
        _gauge("link_up", "Whether a link of the chain is alive or not in use.", link.state != "stale", link=link.name)
    for one in now.freshness:
        _gauge("dataset_silent", "Whether an archive is silent about it.", one.state == "silent", dataset=one.dataset)
        asked = one.asked_utc.timestamp()
        _gauge("dataset_asked_timestamp_seconds", "When a data set was asked for.", asked, dataset=one.dataset)
        age = None if one.newest_day is None else (now.utc.date() - one.newest_day).days
        _gauge("dataset_age_days", "Age of the newest day that is held.", age, dataset=one.dataset)
    for name, latency in now.latency.items():
        for level, value in asdict(latency).items():
            if level != "solutions":
                words = "Latency of the newest solutions."
                _gauge("latency_seconds", words, value, step=name, quantile=level.removesuffix("_s"))
    queue = now.queue
    _gauge("submissions_waiting", "Arrival tables that wait.", queue.waiting_submissions)
    _gauge("runs_running", "Runs under way.", queue.running)
    _gauge("runs_failed_today", "Runs that failed since midnight UTC.", queue.failed_today)
    mock = now.last_mock_burst
    _gauge("mock_burst_ok", "Whether the last mock burst was published.", None if mock is None else mock.state == "ok")
    took = None if mock is None else (mock.ended_utc - mock.started_utc).total_seconds()
    _gauge("mock_burst_duration_seconds", "Time that the last mock burst took.", took)
    at = None if mock is None else mock.started_utc.timestamp()
    _gauge("mock_burst_timestamp_seconds", "When the last mock burst was sent.", at)
    _gauge("disk_free_bytes", "Room in the home folder.", now.disk.free_bytes if now.disk else None)
    _gauge("disk_total_bytes", "Size of the disk of the home folder.", now.disk.total_bytes if now.disk else None)
    _gauge("solutions", "Solutions in the catalogue, superseded ones too.", now.solutions)
    return registry


@router.get("/health", responses={503: {"model": HealthReply, "description": "Something the service needs is away."}})
def health(service: ServiceHere, response: Response) -> HealthReply:
    """Check database, schema and store, and every link from archive to page; 503 when one of them is not well."""
    return _reply(_own(service) | _links(service), response)


@router.get(
    "/health/api", responses={503: {"model": HealthReply, "description": "Something the API itself needs is away."}}
)
def health_of_api(service: ServiceHere, response: Response) -> HealthReply:
    """Check database, schema and store alone: the API answers while fetcher and worker are down."""
    return _reply(_own(service), response)


def _own(service: Service) -> dict[str, tuple[bool, str]]:
    checks: dict[str, Callable[[Service], str]] = {"database": _database, "schema": _schema, "store": _store}
    return {name: _outcome(check, service) for name, check in checks.items()}


def _links(service: Service) -> dict[str, tuple[bool, str]]:
    """Links of the chain; none where the catalogue cannot be asked, which is another check."""
    try:
        links = chain(service.catalogue().operation, service.settings, datetime.now(UTC), WATCHED_SINCE)
    except BellaError:
        return {}
    return {one.name: (one.state != "stale", f"{one.state}: {one.message}") for one in links}


def _reply(results: dict[str, tuple[bool, str]], response: Response) -> HealthReply:
    well = all(good for good, _ in results.values())
    response.status_code = 200 if well else 503
    response.headers["Cache-Control"] = "no-store"
    return HealthReply(
        status="ok" if well else "failing",
        version=__version__,
        checks={name: words for name, (_, words) in results.items()},
    )


def _outcome(check: Callable[[Service], str], service: Service) -> tuple[bool, str]:
    try:
        return True, check(service)
    except BellaError as error:
        log.warning("health check failed", check=check.__name__.strip("_"), detail=str(error))
        return False, str(error)


def _database(service: Service) -> str:
    service.catalogue().ping()
    return "ok"


def _schema(service: Service) -> str:
    return f"revision {service.catalogue().revision()}"


def _store(service: Service) -> str:
    root = service.settings.store_root
    if not root.is_dir() or not os.access(root, os.R_OK | os.X_OK):
        raise StoreError("the store folder is missing or cannot be read: run `bella run`, or set BELLA_HOME")
    return "ok"

"""Whether the service can answer, and whether the chain behind it is alive."""

import os
from collections.abc import Callable
from datetime import UTC, datetime

import structlog
from fastapi import APIRouter, Response

from api.routers.status import WATCHED_SINCE
from api.schemas import HealthReply
from api.service import Service, ServiceHere
from bella import __version__
from bella.exceptions import BellaError, StoreError
from bella.pipeline.alive import chain

router = APIRouter(tags=["service"])

log = structlog.get_logger(__name__)


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

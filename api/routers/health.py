"""Whether the service can answer."""

import os
from collections.abc import Callable

import structlog
from fastapi import APIRouter, Response

from api.schemas import HealthReply
from api.service import Service, ServiceHere
from bella import __version__
from bella.exceptions import BellaError, StoreError

router = APIRouter(tags=["service"])

log = structlog.get_logger(__name__)


@router.get("/health", responses={503: {"model": HealthReply, "description": "Something the service needs is away."}})
def health(service: ServiceHere, response: Response) -> HealthReply:
    """Check database, schema and store; 503 when one of them is not well."""
    checks: dict[str, Callable[[Service], str]] = {"database": _database, "schema": _schema, "store": _store}
    results = {name: _outcome(check, service) for name, check in checks.items()}
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

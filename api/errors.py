"""One shape for every error (RFC 9457 problem details) from one table: exception class to status and title.

Routers never raise HTTP errors themselves. A reader with a browser gets the same words as a page.
"""

from collections.abc import Sequence
from http import HTTPStatus
from typing import Any

import structlog
from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException

from api.rendering import is_page, render
from bella.exceptions import (
    BellaError,
    BusyError,
    ConvergenceError,
    GeometryError,
    InputError,
    NoDataError,
    StoreError,
    UnreachableError,
)

PROBLEM = "application/problem+json"
DESCRIBED: dict[int | str, dict[str, Any]] = {
    status: {"description": words, "content": {PROBLEM: {"schema": {"$ref": "#/components/schemas/Problem"}}}}
    for status, words in {
        "4XX": "The request is wrong (422), what it asks for does not exist (404), or not in this format (406): "
        "`detail` says what to do.",
        "5XX": "It cannot be answered now (503, with `Retry-After` where trying again helps), or something failed.",
    }.items()
}
"""What every route may answer instead, for the description of the API."""

RETRY_AFTER_S = 60
CHALLENGE = 'Bearer realm="bella"'
"""How a request proves who sends it (RFC 6750)."""

log = structlog.get_logger(__name__)


class Problem(BaseModel):
    """What is wrong, and what to do about it (RFC 9457)."""

    type: str = Field(examples=["about:blank"])
    title: str = Field(examples=["The request is wrong"])
    status: int = Field(examples=[422])
    detail: str = Field(examples=["start: 'noon' is not a time; write a UTC time as 2012-06-07"])
    instance: str = Field(description="Path of the request.", examples=["/api/v1/bursts"])


class TooLargeError(InputError):
    """What was sent is larger than the service takes."""


class MediaTypeError(InputError):
    """What was sent, or asked for, is of a type the service does not know."""


class UnauthorisedError(InputError):
    """The request has no token, or none that is known."""


class ForbiddenError(InputError):
    """The token is known, and does not allow this."""


class NotAcceptableError(InputError):
    """The Accept header of a request allows none of the formats there are."""


STATUS: dict[type[BellaError], tuple[HTTPStatus, str]] = {
    UnauthorisedError: (HTTPStatus.UNAUTHORIZED, "A token is needed"),
    ForbiddenError: (HTTPStatus.FORBIDDEN, "The token does not allow this"),
    TooLargeError: (HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "The table is too large"),
    MediaTypeError: (HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "The media type is not known"),
    NotAcceptableError: (HTTPStatus.NOT_ACCEPTABLE, "No such format"),
    GeometryError: (HTTPStatus.UNPROCESSABLE_ENTITY, "The geometry does not allow this"),
    InputError: (HTTPStatus.UNPROCESSABLE_ENTITY, "The request is wrong"),
    NoDataError: (HTTPStatus.NOT_FOUND, "Not found"),
    BusyError: (HTTPStatus.SERVICE_UNAVAILABLE, "Busy"),
    UnreachableError: (HTTPStatus.SERVICE_UNAVAILABLE, "Not reachable"),
    StoreError: (HTTPStatus.SERVICE_UNAVAILABLE, "The catalogue or the posterior store cannot be used"),
    ConvergenceError: (HTTPStatus.INTERNAL_SERVER_ERROR, "No trustworthy answer"),
    BellaError: (HTTPStatus.INTERNAL_SERVER_ERROR, "Failed"),
}


def status_of(error: BellaError) -> tuple[HTTPStatus, str]:
    """Status and title of an error: those of the nearest class in the table."""
    return next(STATUS[kind] for kind in type(error).__mro__ if kind in STATUS)


def problem(request: Request, status: int, title: str, detail: str, **headers: str) -> Response:
    """Reply that says what is wrong: a page to a browser on a page, problem+json to everything else.

    Parameters
    ----------
    **headers : str
        Further headers, underscores for hyphens.
    """
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    if is_page(request):
        return render(request, "problem.html", status=status, title=title, detail=detail, headers=named)
    body = {"type": "about:blank", "title": title, "status": status, "detail": detail, "instance": request.url.path}
    return JSONResponse(body, status, named, media_type=PROBLEM)


def install_error_handlers(app: FastAPI) -> None:
    """Let every error leave the application in the one shape."""
    app.add_exception_handler(BellaError, _raised_on_purpose)
    app.add_exception_handler(RequestValidationError, _refused_by_schema)
    app.add_exception_handler(HTTPException, _refused_by_routing)
    app.add_exception_handler(Exception, _unexpected)


def _raised_on_purpose(request: Request, error: Exception) -> Response:
    assert isinstance(error, BellaError)  # noqa: S101 - the handler is registered for this class only
    status, title = status_of(error)
    headers = {"Retry_After": str(RETRY_AFTER_S)} if error.retriable else {}
    if status == HTTPStatus.UNAUTHORIZED:
        headers["WWW_Authenticate"] = CHALLENGE
    if status >= HTTPStatus.INTERNAL_SERVER_ERROR:
        log.error("request failed", path=request.url.path, error=type(error).__name__, detail=str(error))
    return problem(request, status, title, str(error), **headers)


def _refused_by_schema(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)  # noqa: S101 - the handler is registered for this class only
    detail = "; ".join(worded(one, _known(request)) for one in error.errors())
    return problem(request, 422, STATUS[InputError][1], detail)


def _known(request: Request) -> list[str]:
    """Query parameters of the address that is asked, as the description of the API has them."""
    operations = request.app.openapi()["paths"].get(getattr(request.scope.get("route"), "path", ""), {})
    return [one["name"] for one in operations.get("get", {}).get("parameters", []) if one["in"] == "query"]


def worded(fault: Any, known: Sequence[str] = ()) -> str:
    """One line about one fault that a schema found in a request."""
    place, *names = fault["loc"]  # where in the request, the name, and then which of several types was tried
    name = names[0] if names and isinstance(names[0], str) else place
    if fault["type"] == "extra_forbidden":
        choice = f"it takes {', '.join(known)}" if known else "see /api/v1/openapi.json"
        return f"{name}: is not a parameter of this address; {choice}"
    return f"{name}: {fault['msg'][0].lower()}{fault['msg'][1:]}"


def _refused_by_routing(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)  # noqa: S101 - the handler is registered for this class only
    detail = {
        404: "there is nothing at this address; begin at / or, for the API, at /api/v1/openapi.json",
        405: f"{request.method} is not possible here; see /api/v1/openapi.json",
    }.get(error.status_code, error.detail)
    headers = {name.replace("-", "_"): value for name, value in (error.headers or {}).items()}
    return problem(request, error.status_code, HTTPStatus(error.status_code).phrase, detail, **headers)


def _unexpected(request: Request, error: Exception) -> Response:
    log.error("request failed unexpectedly", path=request.url.path, error=type(error).__name__)
    detail = "the service met an error it did not foresee; the operator finds it in the log"
    # uvicorn closes the connection after an unhandled error: a client that is not told would use it again
    return problem(request, 500, "Unexpected error", detail, Connection="close")

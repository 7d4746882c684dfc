"""The front door of the API: what is there, how much of it, and a page that describes every route."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any
from urllib.parse import quote

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse
from pydantic import Field

from api.links import API, linked
from api.rendering import render
from api.replies import Reply
from api.service import CatalogueHere
from bella import __version__
from bella.answer import GRADES
from bella.flags import COMPANION_FLAGS, FLAGS
from bella.records import DayAnswer

router = APIRouter(tags=["service"])

OPENAPI = f"{API}/openapi.json"
LINKS = {
    "self": API,
    "description": OPENAPI,
    "documentation": f"{API}/docs",
    "bursts": f"{API}/bursts",
    "latest": f"{API}/bursts/latest",
    "tracks": f"{API}/tracks",
    "localisations": f"{API}/localisations",
    "detections": f"{API}/detections",
    "days": f"{API}/days",
    "solutions": f"{API}/solutions",
    "files": f"{API}/files",
    "alerts": f"{API}/alerts",
    "quirks": f"{API}/quirks",
    "status": f"{API}/status",
    "feed": "/feed.atom",
    "hapi": "/hapi",
    "health": "/health",
    "pages": "/",
}


class CountsReply(Reply):
    """How much of real data there is; what was retracted does not count."""

    bursts: int
    answers: int = Field(description="Of these, with a preferred solution.")
    solutions: int = Field(description="All versions.")
    detections: int = Field(description="That were not rejected.")
    days: int = Field(description="That were looked at.")
    files: int = Field(description="That solutions were made from.")
    alerts: int


class RootReply(Reply):
    """What the API has."""

    name: str = "BELLA service"
    version: str
    counts: CountsReply
    newest_burst_utc: datetime | None = Field(description="Start of the newest burst.")
    updated_utc: datetime | None = Field(description="When something of a burst was changed last.")
    links: dict[str, str]


@router.get(API, response_model=RootReply, responses={200: {"content": {"text/html": {"schema": {"type": "string"}}}}})
def root(request: Request, response: Response, catalogue: CatalogueHere) -> RootReply | Response:
    """What is there, how much of it, and where; for a browser the page that describes every route."""
    if "text/html" in request.headers.get("accept", ""):
        return docs(request)
    response.headers["Vary"] = "Accept"
    held = catalogue.held()
    return RootReply(
        version=__version__,
        counts=CountsReply(**{name: getattr(held, name) for name in CountsReply.model_fields}),
        newest_burst_utc=held.newest_burst_utc,
        updated_utc=held.updated_utc,
        links={name: linked(path) for name, path in LINKS.items()},
    )


@dataclass(frozen=True)
class Parameter:
    """A parameter of a route, in words."""

    name: str
    place: str
    kind: str
    required: bool
    description: str
    example: str


@dataclass(frozen=True)
class Operation:
    """A route, in words; `example` is an address that can be tried, empty for what changes something."""

    name: str
    method: str
    path: str
    description: str
    parameters: tuple[Parameter, ...]
    answers: tuple[tuple[str, str], ...]
    example: str


@router.get(f"{API}/docs", include_in_schema=False)
def docs(request: Request) -> HTMLResponse:
    """Every route with its parameters and an example to try, from the description of the API itself."""
    described = request.app.openapi()
    groups: dict[str, list[Operation]] = {}
    for tag, operation in operations(described):
        groups.setdefault(tag, []).append(operation)
    base_url = str(request.base_url).rstrip("/")
    schemas = _schemas(described)
    page = render(request, "api_reference.html", groups=groups, openapi=OPENAPI, schemas=schemas, base_url=base_url)
    page.headers["Vary"] = "Accept"
    return page


def operations(described: Mapping[str, Any]) -> Iterator[tuple[str, Operation]]:
    """Routes of an OpenAPI description with their tags."""
    for path, methods in described["paths"].items():
        for method, one in methods.items():
            parameters = tuple(_parameter(described, parameter) for parameter in one.get("parameters", ()))
            answers = tuple(
                (status, ", ".join(answer.get("content", {})) or answer["description"])
                for status, answer in one["responses"].items()
            )
            example = _address(path, parameters) if method == "get" else ""
            words = one.get("description") or one["summary"]
            yield (
                one["tags"][0],
                Operation(one["operationId"], method.upper(), path, words, parameters, answers, example),
            )


def _parameter(described: Mapping[str, Any], one: Mapping[str, Any]) -> Parameter:
    schema = one["schema"]
    known = schema.get("enum", ()) if one["in"] == "path" else ()
    example = next(iter(one.get("examples") or schema.get("examples") or known), "")
    if isinstance(example, list):
        example = example[0]
    return Parameter(
        one["name"], one["in"], _kind(described, schema), one["required"], one.get("description", ""), str(example)
    )


def _kind(described: Mapping[str, Any], schema: Mapping[str, Any]) -> str:
    """Type of a parameter in a few words."""
    if "$ref" in schema:
        return _kind(described, described["components"]["schemas"][schema["$ref"].rpartition("/")[2]])
    if "anyOf" in schema:
        return " or ".join(_kind(described, part) for part in schema["anyOf"] if part.get("type") != "null")
    if "enum" in schema:
        return ", ".join(map(str, schema["enum"]))
    if schema.get("type") == "array":
        return f"{_kind(described, schema['items'])} (repeatable)"
    bounds = " ".join(
        f"{sign} {schema[name]:g}" for name, sign in (("minimum", "from"), ("maximum", "to")) if name in schema
    )
    return f"{schema.get('const', schema.get('type', ''))} {bounds}".strip()


def _address(path: str, parameters: tuple[Parameter, ...]) -> str:
    """Address that can be tried: with the examples of what it cannot do without."""
    for one in parameters:
        path = path.replace(f"{{{one.name}}}", quote(one.example)) if one.place == "path" else path
    asked = "&".join(f"{one.name}={quote(one.example)}" for one in parameters if one.required and one.place == "query")
    return f"{path}?{asked}" if asked else path


def _schemas(described: Mapping[str, Any]) -> dict[str, tuple[str, str]]:
    """Name, meaning and JSON of every schema of a reply."""
    known = described["components"]["schemas"]
    return {name: (one.get("description", ""), json.dumps(one, indent=1)) for name, one in sorted(known.items())}


@router.get("/guide", include_in_schema=False)
def guide_page(request: Request) -> HTMLResponse:
    """How to read a burst, what the words and flags mean, and how to cite."""
    return render(request, "guide.html", grades=GRADES, flags=FLAGS | COMPANION_FLAGS, answers=list(DayAnswer))

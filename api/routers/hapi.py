"""HAPI 3.3 under /hapi: about, capabilities, catalog, info, data, and a page that says so."""

import gzip
import html
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from email.utils import format_datetime

import numpy as np
import structlog
from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse, JSONResponse

from api.hapi_datasets import DATASETS, MOST_RECORDS, START, HapiDataset, last_instant
from api.serve import STATUS_HEADER
from api.service import ServiceHere
from bella.exceptions import BellaError, UnreachableError
from bella.flags import APPARENT_SOURCE
from bella.formats.hapi import (
    OUTPUT_FORMATS,
    STATUS,
    HapiError,
    Json,
    chosen_parameters,
    encode,
    parse_time,
    status_object,
)
from bella.formats.record_table import iso_stamps

router = APIRouter(prefix="/hapi", include_in_schema=False)  # HAPI describes itself
METHODS = ["GET", "HEAD"]

OLD_NAMES = {"id": "dataset", "time.min": "start", "time.max": "stop"}
"""Names of HAPI 2 and what they are called now; both are taken."""

log = structlog.get_logger(__name__)


@router.api_route("", methods=METHODS)
@router.api_route("/", methods=METHODS)
def landing(request: Request) -> HTMLResponse:
    """What is served here, for a reader with a browser."""
    here = f"{request.scope.get('root_path', '')}{router.prefix}"
    rows = "".join(
        f'<li><a href="{here}/info?dataset={name}">{name}</a>: {html.escape(one.title)}</li>'
        for name, one in DATASETS.items()
    )
    ends = ", ".join(f'<a href="{here}/{name}">{name}</a>' for name in ("about", "capabilities", "catalog"))
    return HTMLResponse(
        f"<!doctype html><html lang=en><title>HAPI: BELLA service</title><h1>HAPI 3.3</h1><p>{ends}; "
        f"info and data of a data set.</p><ul>{rows}</ul>"
    )


@router.api_route("/about", methods=METHODS)
def about(request: Request) -> Response:
    """Who serves the data."""
    said = {
        "id": "BELLA",
        "title": "BELLA: where solar radio bursts were",
        "contact": "the operator of this service",
        "description": f"Localised Type III radio bursts. {APPARENT_SOURCE}",
        "serverCitation": "https://doi.org/10.1051/0004-6361/202347747",
    }
    return _answered(request, (), lambda _: _metadata(said))


@router.api_route("/capabilities", methods=METHODS)
def capabilities(request: Request) -> Response:
    """Which formats there are."""
    return _answered(request, (), lambda _: _metadata({"outputFormats": list(OUTPUT_FORMATS)}))


@router.api_route("/catalog", methods=METHODS)
def catalog(request: Request, service: ServiceHere) -> Response:
    """Which data sets there are; one without a record is not listed yet, for clients begin with its sample."""
    listed = [{"id": one.name, "title": one.title} for one in DATASETS.values() if one.sample(service)]

    def _reply(asked: Mapping[str, str]) -> Response:
        if asked.get("depth", "dataset") != "dataset":
            raise HapiError(1413, "only depth=dataset is served")
        return _metadata({"catalog": listed})

    return _answered(request, ("depth",), _reply)


@router.api_route("/info", methods=METHODS)
def info(request: Request, service: ServiceHere) -> Response:
    """Parameters and times of one data set."""

    def _reply(asked: Mapping[str, str]) -> Response:
        dataset = _dataset(asked)
        if asked.get("resolve_references", "true") not in {"true", "false"}:
            raise HapiError(1412, "write true or false")
        return _metadata(_header(service, dataset, asked.get("parameters")))

    return _answered(request, ("dataset", "parameters", "resolve_references"), _reply)


@router.api_route("/data", methods=METHODS)
def data(request: Request, service: ServiceHere) -> Response:
    """Records of one data set in [start, stop)."""
    allowed = ("dataset", "start", "stop", "parameters", "include", "format")
    return _answered(request, allowed, lambda asked: _data(request, service, asked))


@router.api_route("/{rest:path}", methods=METHODS)
def unknown(rest: str) -> Response:  # noqa: ARG001 - what was asked is not repeated to the client
    """Refuse an endpoint that does not exist."""
    return _refused(HapiError(1400, "the endpoints are about, capabilities, catalog, info and data"))


def _data(request: Request, service: ServiceHere, asked: Mapping[str, str]) -> Response:
    dataset = _dataset(asked)
    names = chosen_parameters(dataset.parameters, asked.get("parameters"))
    output = asked.get("format", "csv")
    if output not in OUTPUT_FORMATS:
        raise HapiError(1409, f"served are {', '.join(OUTPUT_FORMATS)}")
    if asked.get("include", "header") != "header":
        raise HapiError(1410, "only include=header is known")
    start, stop = _interval(asked)
    found = dataset.read(service, *(_moment(one) for one in (start, stop))).between(start, stop).subset(names)
    if len(found) > MOST_RECORDS:
        raise HapiError(1408, f"{len(found)} records of at most {MOST_RECORDS}; ask for a shorter time")
    code = 1200 if len(found) else 1201
    header = None
    if "include" in asked or output == "json":
        header = {**_header(service, dataset, asked.get("parameters")), **status_object(code)}
    body = encode(found, output, header)
    headers = {STATUS_HEADER: f"HAPI {code} {STATUS[code][1]}", "Vary": "Accept-Encoding"}
    if "gzip" in request.headers.get("accept-encoding", "") and body:
        body, headers["Content-Encoding"] = gzip.compress(body, 6, mtime=0), "gzip"
    return Response(body, media_type=OUTPUT_FORMATS[output], headers=headers)


def _dataset(asked: Mapping[str, str]) -> HapiDataset:
    if "dataset" not in asked:
        raise HapiError(1400, "dataset is missing")
    if asked["dataset"] not in DATASETS:
        raise HapiError(1406, f"known are {', '.join(DATASETS)}")
    return DATASETS[asked["dataset"]]


def _interval(asked: Mapping[str, str]) -> tuple[np.datetime64, np.datetime64]:
    for name, code in (("start", 1402), ("stop", 1403)):
        if name not in asked:
            raise HapiError(code, f"{name} is missing")
    start, stop = parse_time(asked["start"], 1402), parse_time(asked["stop"], 1403)
    if start >= stop:
        raise HapiError(1404)
    if start < START or stop > last_instant():
        raise HapiError(1405, f"from {_stamp(START)} to {_stamp(last_instant())}")
    return start, stop


def _header(service: ServiceHere, dataset: HapiDataset, parameters: str | None) -> Json:
    names = chosen_parameters(dataset.parameters, parameters)
    sample = dataset.sample(service)
    shown = {} if sample is None else dict(zip(("sampleStartDate", "sampleStopDate"), map(_stamp, sample), strict=True))
    return {
        **status_object(1200),
        "startDate": _stamp(START),
        "stopDate": _stamp(last_instant()),
        **shown,
        "cadence": dataset.cadence,
        "timeStampLocation": "begin",
        "description": dataset.description,
        "unitsSchema": "vounits1.1",
        "datasetCitation": "https://doi.org/10.1051/0004-6361/202347747",
        "parameters": [one.described() for i, one in enumerate(dataset.parameters) if i == 0 or one.name in names],
    }


def _answered(request: Request, allowed: tuple[str, ...], reply: Callable[[Mapping[str, str]], Response]) -> Response:
    """Reply to a request, or why HAPI refuses it; unknown names and values are not repeated to the client."""
    try:
        return reply(_asked(request, allowed))
    except HapiError as error:
        return _refused(error)
    except BellaError as error:  # its message is for the log: HAPI says no more than the code
        log.warning("request failed", path=request.url.path, error=type(error).__name__, detail=str(error))
        return _refused(HapiError(1501 if isinstance(error, UnreachableError) else 1500, "try again later"))


def _asked(request: Request, allowed: tuple[str, ...]) -> dict[str, str]:
    found: dict[str, str] = {}
    for given, value in request.query_params.multi_items():
        name = OLD_NAMES.get(given, given)
        if name not in allowed:
            raise HapiError(1401, f"known are {', '.join(allowed) or 'none'}")
        if name in found:
            raise HapiError(1400, f"{name} is given twice")
        found[name] = value
    return found


def _metadata(said: Json) -> Response:
    headers = {"Last-Modified": format_datetime(datetime.now(UTC), usegmt=True)}
    return JSONResponse({**status_object(1200), **said}, headers=headers)


def _refused(error: HapiError) -> Response:
    http, words = STATUS[error.code]
    return JSONResponse(
        status_object(error.code, str(error)), http, {STATUS_HEADER: f"HAPI error {error.code}: {words}"}
    )


def _stamp(instant: np.datetime64) -> str:
    return iso_stamps(np.array([instant], dtype="datetime64[us]"))[0]


def _moment(instant: np.datetime64) -> datetime:
    moment: datetime = instant.astype("datetime64[us]").item()
    return moment.replace(tzinfo=UTC)

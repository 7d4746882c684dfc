"""Arrival tables handed in over HTTP: checked at once, localised by the next scheduled run."""

import hashlib
import os
import tempfile
from pathlib import Path
from typing import Annotated

import structlog
from fastapi import APIRouter, Depends, Request

from api.errors import MediaTypeError, TooLargeError
from api.schemas import SubmissionReply
from api.service import CatalogueHere, ServiceHere
from bella.arrivals import arrival_grid, locate_receivers, parse_arrivals
from bella.exceptions import BusyError, InputError, StoreError

router = APIRouter(prefix="/api/v1/arrivals", tags=["arrivals"])

TABLE_TYPES = {"text/csv", "application/csv", "text/plain", "application/octet-stream", ""}
HOW = "send it with curl --data-binary @arrivals.csv -H 'Content-Type: text/csv'"

log = structlog.get_logger(__name__)


async def _received(request: Request) -> bytes:
    """Body of the request, read no further than the largest table the service takes."""
    largest = request.app.state.service.settings.max_submission_bytes
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind not in TABLE_TYPES:
        raise MediaTypeError(f"an arrival table is CSV, not {kind[:60]}; {HOW}")
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > largest:
            raise TooLargeError(f"an arrival table may have {largest} bytes at most; hand in one burst per table")
    return bytes(body)


@router.post(
    "",
    status_code=202,
    openapi_extra={"requestBody": {"content": {"text/csv": {"schema": {"type": "string"}}}, "required": True}},
)
def submit(
    service: ServiceHere, catalogue: CatalogueHere, body: Annotated[bytes, Depends(_received)]
) -> SubmissionReply:
    """Hand in an arrival table (CSV); the next scheduled run localises it. The same table twice is one submission."""
    table = locate_receivers(parse_arrivals(_text(body)))
    arrival_grid(table)
    sha256 = hashlib.sha256(body).hexdigest()
    pending = {submission.sha256 for submission in catalogue.pending_submissions()}
    if sha256 not in pending and len(pending) >= service.settings.max_pending_submissions:
        raise BusyError(f"{len(pending)} arrival tables wait already: hand this one in again after the next run")
    name = f"{sha256}.csv"
    _keep(service.settings.incoming_root / name, body)
    submission = catalogue.submit(sha256, name)
    log.info("arrival table received", sha256=sha256, rows=len(table), state=submission.state)
    return SubmissionReply.of(submission)


@router.get("/{sha256}")
def submission(sha256: str, catalogue: CatalogueHere) -> SubmissionReply:
    """What became of an arrival table that was handed in."""
    return SubmissionReply.of(catalogue.submission(sha256))


def _text(body: bytes) -> str:
    try:
        return body.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"arrival table: byte {error.start + 1} is not UTF-8 text; save the table as UTF-8") from error


def _keep(path: Path, body: bytes) -> None:
    """Write a file so that it is there whole or not at all, and still there after a power cut."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=".incoming-", dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(body)
            file.flush()
            os.fsync(file.fileno())
        Path(name).replace(path)
    except OSError as error:
        raise StoreError(
            f"the table could not be kept ({error.strerror}): free disk space and send it again"
        ) from error

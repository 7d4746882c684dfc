"""Arrival tables submitted over HTTP: checked at once, localised by the next run, withdrawn by their token."""

import hashlib
import os
import re
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import structlog
from fastapi import APIRouter, Depends, Request

from api.errors import ForbiddenError, MediaTypeError, TooLargeError, UnauthorisedError
from api.queries import SubmissionId
from api.schemas import SubmissionReply
from api.service import CatalogueHere, ServiceHere
from bella.arrivals import arrival_grid, locate_receivers, parse_arrivals
from bella.catalogue import ANONYMOUS, submission_name
from bella.exceptions import BusyError, InputError, NoDataError, StoreError

AUTHORISED_SO = "send it as the header 'Authorization: Bearer TOKEN'; the operator makes one with bella token create"
TABLE_TYPES = {"text/csv", "application/csv", "text/plain", "application/octet-stream", ""}
SENT_SO = "send it with curl --data-binary @arrivals.csv -H 'Content-Type: text/csv'"
FORMULA = ("=", "+", "-", "@")
"""With these a spreadsheet begins a formula (OWASP, CSV injection)."""

EDGE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
"""An edge becomes part of the id of its solution."""

log = structlog.get_logger(__name__)


def _submitter(request: Request, service: ServiceHere, catalogue: CatalogueHere) -> str:
    """Id of the token of a request; `ANONYMOUS` where submissions are open and it has none.

    Raises
    ------
    UnauthorisedError
        Where a token is needed and there is none, or none that is known.
    ForbiddenError
        Where it was revoked.
    """
    header = request.headers.get("authorization")
    if header is None:
        if service.settings.open_submissions:
            return ANONYMOUS
        raise UnauthorisedError(f"this needs a token: {AUTHORISED_SO}")
    scheme, _, secret = header.partition(" ")
    token = catalogue.token_of(secret.strip()) if scheme.lower() == "bearer" else None
    if token is None:
        raise UnauthorisedError(f"the token is not known: {AUTHORISED_SO}")
    if token.revoked_utc is not None:
        raise ForbiddenError(f"token {token.token_id} was revoked: ask the operator for another one")
    return token.token_id


Submitter = Annotated[str, Depends(_submitter)]

router = APIRouter(prefix="/api/v1/arrivals", tags=["arrivals"])


async def _received(request: Request) -> bytes:
    """Body of the request, read no further than the largest table the service takes."""
    largest = request.app.state.service.settings.max_submission_bytes
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind not in TABLE_TYPES:
        raise MediaTypeError(f"an arrival table is CSV, not {kind[:60]}; {SENT_SO}")
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > largest:
            raise TooLargeError(f"an arrival table may have {largest} bytes at most; submit one burst per table")
    return bytes(body)


@router.post(
    "",
    status_code=202,
    openapi_extra={"requestBody": {"content": {"text/csv": {"schema": {"type": "string"}}}, "required": True}},
)
def submit(
    service: ServiceHere,
    catalogue: CatalogueHere,
    submitter: Submitter,  # before the body, which nobody without a token gets to send
    body: Annotated[bytes, Depends(_received)],
) -> SubmissionReply:
    """Submit an arrival table (CSV) with a token; the next scheduled run localises it under an id of its own.

    The same table of the same token is one submission, however often it is sent.
    """
    table = check_table(_text(body))
    sha256 = hashlib.sha256(body).hexdigest()
    pending = {(one.token_id, one.sha256) for one in catalogue.pending_submissions()}
    if (submitter, sha256) not in pending and len(pending) >= service.settings.max_pending_submissions:
        raise BusyError(f"{len(pending)} arrival tables wait already: submit this one again after the next run")
    new = submission_name(table["arrival_utc"].min().date())
    path = service.settings.incoming_root / f"{new}.csv"
    _keep(path, body)
    submission = catalogue.submit(submitter, sha256, new)
    if submission.submission_id != new:  # it was submitted before
        path.replace(path.with_name(f"{submission.submission_id}.csv"))
    log.info("arrival table received", submission_id=submission.submission_id, rows=len(table), state=submission.state)
    return SubmissionReply.of(submission)


@router.get("/{submission_id}")
def submission(submission_id: SubmissionId, catalogue: CatalogueHere) -> SubmissionReply:
    """What became of an arrival table that was submitted."""
    return SubmissionReply.of(catalogue.submission(submission_id))


@router.delete("/{submission_id}")
def withdraw(submission_id: SubmissionId, catalogue: CatalogueHere, submitter: Submitter) -> SubmissionReply:
    """Withdraw a submission with the token that sent it: its burst is retracted, and both stay as a tombstone."""
    if submitter == ANONYMOUS or catalogue.submission(submission_id).token_id != submitter:
        raise ForbiddenError(f"{submission_id} was not submitted with this token: send the one that submitted it")
    return SubmissionReply.of(catalogue.withdraw(submission_id))


def check_table(text: str) -> pd.DataFrame:
    """Arrival table of the text of a submission.

    Raises
    ------
    InputError
        Names the row and column that is wrong.
    """
    table = parse_arrivals(text)
    _check_names(table)
    _check_past(table)
    _check_receivers(table)
    return table


def _check_names(table: pd.DataFrame) -> None:
    """Refuse names that a spreadsheet would run as a formula, or that hold characters nobody sees."""
    for column in ("observatory", "edge", "flag"):
        for row, name in enumerate(map(str, table[column]), start=1):
            if name.lstrip().startswith(FORMULA) or not name.isprintable():
                raise InputError(
                    f"arrival table: row {row}, column {column}: {name[:40]!r} begins with one of = + - @ or holds a "
                    "control character; rename it"
                )
            if column == "edge" and not EDGE_NAME.fullmatch(name):
                raise InputError(
                    f"arrival table: row {row}, column edge: {name[:40]!r} is not a name; use letters, digits, - and _"
                )


def _check_receivers(table: pd.DataFrame) -> None:
    try:
        arrival_grid(locate_receivers(table))
    except NoDataError as error:  # of the ephemeris: it is the table that is wrong here
        raise InputError(str(error)) from error


def _check_past(table: pd.DataFrame) -> None:
    future = table["arrival_utc"].to_numpy() > np.datetime64(datetime.now(UTC).replace(tzinfo=None), "ns")
    if future.any():
        row = int(future.argmax()) + 1
        raise InputError(
            f"arrival table: row {row}, column arrival_utc: {table['arrival_utc'].iloc[row - 1]} is in the future; "
            "write times in UTC"
        )


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

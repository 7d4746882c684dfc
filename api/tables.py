"""What the catalogue holds as published tables, and replies in the format that is asked for.

Long ones are written while they are read: from one moment of the catalogue, with one page of it in memory.
"""

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing
from contextvars import copy_context
from dataclasses import asdict, dataclass
from datetime import datetime
from functools import partial
from itertools import chain, islice
from threading import BoundedSemaphore
from typing import Annotated, Any, Literal

from anyio import CancelScope
from fastapi import Request, Response
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field, WithJsonSchema
from starlette.concurrency import run_in_threadpool
from starlette.types import Receive, Scope, Send

from api.errors import NotAcceptableError
from api.freshness import WITHOUT_BODY, is_known, last_modified, not_modified, tag_of
from api.links import linked
from api.queries import BurstFilter, DetectionFilter, EventFilter, SolutionChoice
from bella.catalogue import BurstPage, BurstQuery, BurstSummary, Catalogue, Detection
from bella.exceptions import BusyError, InputError
from bella.flags import APPARENT_SOURCE
from bella.formats import (
    BURSTS,
    DETECTIONS,
    FORMATS,
    LOCALISATIONS,
    TRACKS,
    Format,
    RecordTable,
    Schema,
    find_format,
    record_table,
)
from bella.pipeline.rows import Row, all_bursts, batches, burst_row, localisation_rows, track_rows

AT_ONCE = 8
"""Replies that are streamed at a time: each holds a connection to the database until its reader has it all."""

_FREE = BoundedSemaphore(AT_ONCE)
FORMAT = Field(None, description="Without it, as the Accept header says.")
JSON = FORMATS["json"]
FRAME = {"frame": "HEE, solar radii; times UTC", "remark": APPARENT_SOURCE}
PAGE = 1000
MOST_BURSTS = 20_000
"""In one reply that is made in memory, as CDF and TFCat have to be."""


def streamed(request: Request, pieces: Generator[bytes], media_type: str, headers: dict[str, str]) -> Response:
    """Reply of these pieces; what fails before the first one is an error like any other.

    Parameters
    ----------
    pieces : generator of bytes
        Its steps run in several threads, one after the other, and see one context (so that a snapshot holds).

    Raises
    ------
    BusyError
        Where `AT_ONCE` replies are streamed already.
    """
    if request.scope.get(WITHOUT_BODY):
        return StreamingResponse(iter(()), media_type=media_type, headers=headers)
    running = _in_one_context(pieces)
    return _Streamed(next(running), running, media_type, headers)


def _in_one_context(pieces: Generator[bytes]) -> Generator[bytes]:
    if not _FREE.acquire(blocking=False):
        raise BusyError(f"{AT_ONCE} large replies are being sent already: try again, or ask page by page")
    context = copy_context()
    try:
        while (piece := context.run(next, pieces, None)) is not None:
            yield piece
    finally:
        context.run(pieces.close)
        _FREE.release()


class _Streamed(StreamingResponse):
    """A reply whose pieces end with it, also where its reader goes away."""

    def __init__(self, first: bytes, rest: Generator[bytes], media_type: str, headers: dict[str, str]) -> None:
        self._rest = rest
        pieces: Iterator[bytes] = chain([first], rest)
        super().__init__(pieces, media_type=media_type, headers=headers)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            with CancelScope(shield=True):
                await run_in_threadpool(self._rest.close)


FormatName = Annotated[str | None, WithJsonSchema({"type": "string", "enum": [*FORMATS]})]
"""What is none of these is answered as the Accept header would be: with 406."""


class BurstTableFilter(BurstFilter):
    """Which bursts are asked for, in which format; a page of them, or all in one file."""

    limit: Annotated[int, Field(ge=1, le=1000)] | Literal["all"] = Field(  # type: ignore[assignment]
        50,
        description="Bursts per reply; `all` for all that the query finds, in one reply (CDF: up to 20 000 bursts).",
        union_mode="left_to_right",
    )
    format: FormatName = FORMAT

    def query(self) -> BurstQuery:
        """Question to the catalogue, of the first page where all are asked for."""
        paged = self.model_copy(update={"limit": PAGE}) if self.limit == "all" else self
        return BurstFilter.query(paged)

    def found(self, catalogue: Catalogue) -> BurstPage:
        """Bursts of the page, or all.

        Raises
        ------
        InputError
            If these are too many for one reply.
        """
        if self.limit != "all":
            return catalogue.bursts(self.query())
        bursts = tuple(islice(all_bursts(catalogue, self.query()), MOST_BURSTS + 1))
        if len(bursts) > MOST_BURSTS:
            others = ", ".join(one.name for one in FORMATS.values() if one.pieces)
            raise InputError(
                f"limit: a file of this format is made in memory and holds up to {MOST_BURSTS} bursts, and the query "
                f"finds more; ask for a shorter time, or for a format that is sent row by row: {others}"
            )
        return BurstPage(bursts, None, len(bursts))

    def is_streamed(self, chosen: Format) -> bool:
        """Whether all that is found is asked for, in a format that needs no end to begin."""
        return self.limit == "all" and bool(chosen.pieces)


@dataclass(frozen=True)
class BurstTable:
    """A published table about bursts: its columns, and its rows about some of them."""

    schema: Schema
    rows: Callable[[Catalogue, Iterable[BurstSummary]], Iterable[Row]]

    def of(self, catalogue: Catalogue, summaries: Iterable[BurstSummary]) -> RecordTable:
        """Table about these bursts."""
        return table_of_rows(self.schema, self.rows(catalogue, summaries))

    def pieces(self, chosen: Format, catalogue: Catalogue, summaries: Iterable[BurstSummary]) -> Iterator[bytes]:
        """The same in a format that is written piece by piece."""
        some = batches(self.rows(catalogue, summaries))
        return chosen.write_pieces(self.schema, FRAME, (record_table(self.schema, rows) for rows in some))


BURST_TABLE = BurstTable(BURSTS, lambda _, summaries: map(burst_row, summaries))
TRACK_TABLE = BurstTable(TRACKS, track_rows)
LOCALISATION_TABLE = BurstTable(
    LOCALISATIONS,
    lambda catalogue, summaries: localisation_rows(catalogue, (one.preferred for one in summaries if one.preferred)),
)
"""Of bursts without a track, or without an answer, the tables of these hold nothing."""


class DetectionTableFilter(DetectionFilter):
    """Which detections are asked for, and in which format."""

    format: FormatName = FORMAT


class EventTableFilter(EventFilter):
    """Which published events are asked for, and in which format."""

    format: FormatName = FORMAT


class TableChoice(SolutionChoice):
    """Which solution, in which format."""

    format: FormatName = FORMAT


class ArrivalChoice(TableChoice):
    """Which solution, of which spacecraft, in which format."""

    observatory: str | None = Field(None, description="Spacecraft; without it, all.")


def in_all_formats(description: str, in_json: type[BaseModel]) -> dict[int | str, dict[str, Any]]:
    """What a route answers that has every format, for the description of the API."""
    binary = {"type": "string", "contentMediaType": "application/octet-stream"}
    others = {one.media_type: {"schema": binary} for one in FORMATS.values() if one is not JSON}
    return {200: {"description": description, "model": in_json, "content": others}}


def asked_format(request: Request, asked: str | None) -> Format:
    """Format of a reply: by name where one is given, otherwise the best of the Accept header.

    Raises
    ------
    NotAcceptableError
        If the name is not known, or the header allows none of the formats.
    """
    if asked:
        try:
            return find_format(asked.strip().lower())
        except InputError as error:
            raise NotAcceptableError(str(error)) from error
    accept = request.headers.get("accept", "")
    by_type = {one.media_type: one for one in FORMATS.values()}
    wanted = sorted(_accepted(accept), key=lambda part: -part[1])
    for media_type, quality in wanted:
        if quality > 0 and media_type in {"*/*", "application/*", "text/html"}:
            return JSON
        if quality > 0 and media_type in by_type:
            return by_type[media_type]
    if not wanted:
        return JSON
    raise NotAcceptableError(f"this address has {', '.join(by_type)}: accept one of them, or add format=csv or another")


def _accepted(header: str) -> Iterator[tuple[str, float]]:
    """Media types of an Accept header with their quality."""
    for part in filter(None, (part.strip() for part in header.lower().split(","))):
        media_type, *parameters = (one.strip() for one in part.split(";"))
        given = [one.removeprefix("q=") for one in parameters if one.startswith("q=")]
        try:
            yield media_type, float(given[0]) if given else 1.0
        except ValueError:
            yield media_type, 0.0


Pieces = Callable[[Catalogue, Iterable[BurstSummary]], Iterator[bytes]]


def burst_table_reply(
    request: Request, catalogue: Catalogue, wanted: BurstTableFilter, chosen: Format, table: BurstTable
) -> Response:
    """A page of a table about bursts, or all of it."""
    name = table.schema.name
    if wanted.is_streamed(chosen):
        headers = {"Content-Disposition": f'attachment; filename="{name}{chosen.suffix}"'}
        return whole_list(
            request,
            catalogue,
            wanted.query(),
            chosen,
            partial(table.pieces, chosen),
            headers,
        )
    changed = catalogue.changed_utc("bursts")
    with catalogue.snapshot():
        page = wanted.found(catalogue)
        whole = table.of(catalogue, page.bursts)
    return table_reply(chosen, whole, name, next_address(request, page.next_cursor), changed)


def whole_list(  # noqa: PLR0913, PLR0917 - what is asked for, of what, and how it is written
    request: Request,
    catalogue: Catalogue,
    query: BurstQuery,
    chosen: Format,
    pieces: Pieces,
    headers: dict[str, str],
) -> Response:
    """All bursts that a query finds in one reply, from one moment and never all of them in memory.

    The tag is made of which bursts these are and when each was changed last, and not of the body.
    """
    tag = tag_of((), catalogue.state_of(query), chosen.name, linked("/"))
    modified = last_modified(catalogue.changed_utc("bursts"))
    if is_known(request, tag, modified.get("Last-Modified")):
        return not_modified(tag, Vary="Accept")
    return streamed(
        request,
        _snapped(catalogue, query, pieces),
        chosen.media_type,
        {"ETag": tag, "Vary": "Accept", **modified, **headers},
    )


def _snapped(catalogue: Catalogue, query: BurstQuery, pieces: Pieces) -> Generator[bytes]:
    with catalogue.snapshot(), closing(all_bursts(catalogue, query)) as found:
        first = list(islice(found, 1))  # before the reply begins, which no error can follow
        yield from pieces(catalogue, chain(first, found))


def table_reply(
    chosen: Format, table: RecordTable, name: str, following: str | None = None, changed: datetime | None = None
) -> Response:
    """Reply that holds a table as a file.

    Parameters
    ----------
    name : str
        Of the file, without its ending.
    following : str, optional
        Address of the next page; the header of the table and a Link header say it.
    changed : datetime, optional
        When any of this was changed last.
    """
    headers = {"Content-Disposition": f'attachment; filename="{name}{chosen.suffix}"', "Vary": "Accept"}
    headers |= last_modified(changed)
    if following:
        headers["Link"] = f'<{following}>; rel="next"'
        table = RecordTable(table.schema, table.data, {**table.header, "truncated": "yes", "next": following})
    return Response(chosen.write(table), media_type=chosen.media_type, headers=headers)


def next_address(request: Request, cursor: str | None) -> str | None:
    """Address of the page after this one; None on the last."""
    return str(request.url.include_query_params(cursor=cursor)) if cursor else None


def table_of_rows(schema: Schema, rows: Iterable[Mapping[str, object]], **header: str) -> RecordTable:
    """Table with the frame and the remark about apparent sources in its header."""
    return record_table(schema, rows, {**FRAME, **header})


def detection_table(found: Iterable[Detection]) -> RecordTable:
    """Table of detections."""
    return table_of_rows(DETECTIONS, map(asdict, found))

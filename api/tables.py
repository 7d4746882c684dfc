"""What the catalogue holds as published tables, and replies in the format that is asked for."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from itertools import islice
from typing import Annotated, Any, Literal

from fastapi import Request, Response
from pydantic import BaseModel, Field, WithJsonSchema

from api.errors import NotAcceptableError
from api.queries import BurstFilter, DetectionFilter, EventFilter, SolutionChoice
from api.wording import APPARENT_SOURCE
from bella.catalogue import BurstPage, BurstQuery, BurstSummary, Catalogue, Detection, Solution
from bella.exceptions import InputError
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
from bella.pipeline.rows import all_bursts, burst_row, localisation_rows, track_rows

FORMAT = Field(None, description="Without it, as the Accept header says.")
FormatName = Annotated[str | None, WithJsonSchema({"type": "string", "enum": [*FORMATS]})]
"""What is none of these is answered as the Accept header would be: with 406."""

JSON = FORMATS["json"]
FRAME = {"frame": "HEE, solar radii; times UTC", "remark": APPARENT_SOURCE}
PAGE = 1000
MOST_BURSTS = 20_000
"""In one reply."""


class BurstTableFilter(BurstFilter):
    """Which bursts are asked for, in which format; a page of them, or all in one file."""

    limit: Annotated[int, Field(ge=1, le=1000)] | Literal["all"] = Field(  # type: ignore[assignment]
        50,
        description="Bursts per reply; `all` for everything that the query finds, in one reply.",
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
            raise InputError(f"limit: more than {MOST_BURSTS} bursts in one reply; ask for a shorter time")
        return BurstPage(bursts, None, len(bursts))


class DetectionTableFilter(DetectionFilter):
    """Which detections are asked for, and in which format."""

    format: FormatName = FORMAT


class EventTableFilter(EventFilter):
    """Which published events are asked for, and in which format."""

    format: str | None = FORMAT


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

    Parameters
    ----------
    request : Request
    asked : str or None

    Returns
    -------
    Format

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


def table_reply(chosen: Format, table: RecordTable, name: str, following: str | None = None) -> Response:
    """Reply that holds a table as a file.

    Parameters
    ----------
    chosen : Format
    table : RecordTable
    name : str
        Of the file, without its ending.
    following : str, optional
        Address of the next page; the header of the table and a Link header say it.
    """
    headers = {"Content-Disposition": f'attachment; filename="{name}{chosen.suffix}"', "Vary": "Accept"}
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


def burst_table(summaries: Iterable[BurstSummary]) -> RecordTable:
    """Table of bursts, each with what its preferred solution says."""
    return table_of_rows(BURSTS, map(burst_row, summaries))


def detection_table(found: Iterable[Detection]) -> RecordTable:
    """Table of detections."""
    return table_of_rows(DETECTIONS, map(asdict, found))


def track_table(catalogue: Catalogue, summaries: Iterable[BurstSummary]) -> RecordTable:
    """Table of the joint tracks of the preferred solutions of bursts; bursts without a track are left out."""
    return table_of_rows(TRACKS, track_rows(catalogue, summaries))


def localisation_table(catalogue: Catalogue, solutions: Iterable[Solution]) -> RecordTable:
    """Table of the sources of solutions at each frequency."""
    return table_of_rows(LOCALISATIONS, localisation_rows(catalogue, solutions))

"""What the catalogue holds as published tables, and replies in the format that is asked for."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import Request, Response
from pydantic import BaseModel, Field, WithJsonSchema

from api.errors import NotAcceptableError
from api.queries import BurstFilter, DetectionFilter, SolutionChoice
from api.wording import APPARENT_SOURCE
from bella.catalogue import BurstSummary, Catalogue, Detection, Solution
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
from bella.pipeline.rows import burst_row, localisation_rows, track_rows

FORMAT = Field(None, description="Without it, as the Accept header says.")
FormatName = Annotated[str | None, WithJsonSchema({"type": "string", "enum": [*FORMATS]})]
"""What is none of these is answered as the Accept header would be: with 406."""

JSON = FORMATS["json"]
FRAME = {"frame": "HEE, solar radii; times UTC", "remark": APPARENT_SOURCE}
PAGE = 1000


class BurstTableFilter(BurstFilter):
    """Which bursts are asked for, and in which format."""

    format: FormatName = FORMAT


class DetectionTableFilter(DetectionFilter):
    """Which detections are asked for, and in which format."""

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
    return table_of_rows(TRACKS, (row for one in summaries for row in track_rows(catalogue, one)))


def localisation_table(catalogue: Catalogue, solutions: Iterable[Solution]) -> RecordTable:
    """Table of the sources of solutions at each frequency."""
    return table_of_rows(LOCALISATIONS, (row for one in solutions for row in localisation_rows(catalogue, one)))

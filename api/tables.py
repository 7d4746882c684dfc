"""What the catalogue holds as published tables, and replies in the format that is asked for."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict

from fastapi import Request, Response
from pydantic import Field

from api.errors import NotAcceptableError
from api.queries import BurstFilter, DetectionFilter, EventFilter, SolutionChoice
from api.wording import APPARENT_SOURCE
from bella.catalogue import BurstSummary, Catalogue, Detection, Solution
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

FORMAT = Field(None, description=f"{', '.join(FORMATS)}; without it, as the Accept header says.")
JSON = FORMATS["json"]
FRAME = {"frame": "HEE, solar radii; times UTC", "remark": APPARENT_SOURCE}
PAGE = 1000


class BurstTableFilter(BurstFilter):
    """Which bursts are asked for, and in which format."""

    format: str | None = FORMAT


class DetectionTableFilter(DetectionFilter):
    """Which detections are asked for, and in which format."""

    format: str | None = FORMAT


class EventTableFilter(EventFilter):
    """Which published events are asked for, and in which format."""

    format: str | None = FORMAT


class TableChoice(SolutionChoice):
    """Which solution, in which format."""

    format: str | None = FORMAT


class ArrivalChoice(TableChoice):
    """Which solution, of which spacecraft, in which format."""

    observatory: str | None = Field(None, description="Spacecraft; without it, all.")


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
    InputError
        If the name is not known.
    NotAcceptableError
        If the header allows none of the formats.
    """
    if asked:
        return find_format(asked.strip().lower())
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

"""Bursts, their versions, tracks, posteriors and arrival times, and the tables over many of them."""

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import PlainTextResponse

from api.freshness import last_modified
from api.links import zarr_path
from api.queries import BurstId, BurstSelection, FrequencyChoice, SolutionChoice, one_per_edge
from api.queries import chosen as chosen_solution
from api.schemas import (
    BurstReply,
    BurstsReply,
    LocalisationReply,
    PosteriorReply,
    RegionsReply,
    SolutionReply,
    TableReply,
    TrackFitReply,
    TrackReply,
    VersionReply,
    VersionsReply,
    said_of,
)
from api.service import CatalogueHere, Service, ServiceHere
from api.tables import (
    BURST_TABLE,
    JSON,
    LOCALISATION_TABLE,
    TRACK_TABLE,
    ArrivalChoice,
    BurstTableFilter,
    TableChoice,
    asked_format,
    burst_table_reply,
    in_all_formats,
    next_address,
    table_of_rows,
    table_reply,
    whole_list,
)
from bella.catalogue import BurstSummary, Catalogue, Localisation, Solution
from bella.exceptions import NoDataError
from bella.flags import APPARENT_SOURCE
from bella.formats import ARRIVALS, LOCALISATIONS, localisation_csv, record_table
from bella.formats.text import json_list
from bella.pipeline.page_figures import summary_of
from bella.pipeline.rows import arrival_rows, localisation_rows
from bella.plotting import edge_name, selected_regions

router = APIRouter(prefix="/api/v1", tags=["bursts"])


@router.get("/bursts", response_model=BurstsReply, responses=in_all_formats("One page of bursts.", BurstsReply))
def bursts(request: Request, service: ServiceHere, wanted: Annotated[BurstTableFilter, Query()]) -> Response:
    """Bursts by what is said of them, the newest first unless `sort` says otherwise; as JSON or as a table."""
    chosen, catalogue = asked_format(request, wanted.format), service.catalogue()
    if chosen is not JSON:
        return burst_table_reply(request, catalogue, wanted, chosen, BURST_TABLE)
    if wanted.is_streamed(chosen):
        return whole_list(request, catalogue, wanted.query(), chosen, partial(_list_of, service), {})
    with catalogue.snapshot():
        page, changed = catalogue.bursts(wanted.query()), catalogue.changed_utc("bursts")
    following = next_address(request, page.next_cursor)
    text = b"".join(_list_of(service, catalogue, page.bursts, page.total, following))
    return Response(text, media_type=JSON.media_type, headers={"Vary": "Accept"} | last_modified(changed))


def _list_of(
    service: Service,
    _: Catalogue,
    found: Iterable[BurstSummary],
    total: int | None = None,
    following: str | None = None,
) -> Iterator[bytes]:
    """A `BurstsReply` piece by piece; without a total, of all bursts."""
    returned = 0

    def _items() -> Iterator[str]:
        nonlocal returned
        for summary in found:
            returned += 1
            yield service.burst_text(summary)

    yield from json_list('{"bursts":[', _items(), "]")
    end = {"total": returned if total is None else total, "returned": returned}
    yield b"," + json.dumps(end | {"truncated": following is not None, "next": following})[1:].encode()


@router.get("/bursts/latest")
def latest_burst(catalogue: CatalogueHere, wanted: Annotated[BurstSelection, Query()]) -> BurstReply:
    """The newest burst that a query finds, by its start: one address that always has the last answer."""
    found = catalogue.bursts(replace(wanted.query(), sort="-start", limit=1)).bursts
    if not found:
        raise NoDataError("no burst is like that: ask for less, or see /api/v1/days for days without any")
    return BurstReply.of(found[0], catalogue.events.of_burst(found[0].burst.burst_id))


@router.get("/bursts/{burst_id}")
def burst(response: Response, burst_id: BurstId, catalogue: CatalogueHere) -> BurstReply:
    """One burst with the newest solution of each series."""
    with catalogue.snapshot():
        summary, near = catalogue.burst(burst_id), catalogue.events.of_burst(burst_id)
        events_utc = catalogue.changed_utc("events")
    response.headers.update(last_modified(summary.burst.updated_utc, events_utc))
    return BurstReply.of(summary, near)


@router.get("/bursts/{burst_id}/versions")
def versions(burst_id: BurstId, catalogue: CatalogueHere) -> VersionsReply:
    """All solutions that were ever published for a burst, superseded ones too."""
    return VersionsReply(burst_id=burst_id, versions=versions_of(catalogue.versions(burst_id)))


@router.get(
    "/bursts/{burst_id}/track",
    response_model=TrackReply,
    responses=in_all_formats("Localisation table and track fit; in other formats the first alone.", TrackReply),
)
def track(
    request: Request,
    response: Response,
    burst_id: BurstId,
    catalogue: CatalogueHere,
    choice: Annotated[TableChoice, Query()],
) -> TrackReply | Response:
    """Localisation table and track fit of one solution as JSON, or the localisation table alone in another format."""
    chosen = asked_format(request, choice.format)
    with catalogue.snapshot():
        summary = catalogue.burst(burst_id)
        solution = picked(catalogue, summary, choice)
        found = catalogue.localisations(solution.solution_id)
        fit = catalogue.track_fit(solution.solution_id)
    updated_utc = summary.burst.updated_utc
    modified = last_modified(updated_utc, solution.pruned_utc)
    name = f"{burst_id}_{solution.series.edge}_{solution.series.preset}_v{solution.version}"
    if chosen.name == "csv":
        return PlainTextResponse(
            localisation_csv([_record(row) for row in found], table_header(solution)),
            media_type="text/csv",
            headers={"Content-Disposition": f'attachment; filename="{name}.csv"', "Vary": "Accept", **modified},
        )
    if chosen is not JSON:
        rows = localisation_rows(catalogue, [solution])
        whole = record_table(LOCALISATIONS, rows, table_header(solution))
        return table_reply(chosen, whole, name, None, updated_utc)
    response.headers.update({"Vary": "Accept"} | modified)
    return TrackReply(
        burst_id=burst_id,
        **said_of(solution),
        solution=SolutionReply.of(solution),
        track_fit=TrackFitReply.model_validate(fit),
        localisations=[LocalisationReply(**_record(row)) for row in found],
    )


@router.get("/bursts/{burst_id}/posterior")
def posterior(
    request: Request,
    response: Response,
    burst_id: BurstId,
    service: ServiceHere,
    choice: Annotated[SolutionChoice, Query()],
) -> PosteriorReply:
    """Summary of the posterior at each frequency, and the address of the Zarr group with all its draws."""
    catalogue = service.catalogue()
    summary = catalogue.burst(burst_id)
    solution = picked(catalogue, summary, choice)
    look = service.first_look(summary.burst, solution)
    held = look.posterior if look else summary_of(service.posterior(solution))
    response.headers.update(last_modified(summary.burst.updated_utc, solution.pruned_utc))
    return PosteriorReply(
        burst_id=burst_id,
        **said_of(solution),
        solution=SolutionReply.of(solution),
        zarr_url=str(request.base_url).rstrip("/") + zarr_path(solution),
        **vars(held),
    )


@router.get("/bursts/{burst_id}/regions")
def regions(burst_id: BurstId, service: ServiceHere, choice: Annotated[FrequencyChoice, Query()]) -> RegionsReply:
    """68 and 95 % regions of each track at the channel nearest to a frequency."""
    solutions = one_per_edge(service.catalogue().burst(burst_id).solutions, choice, burst_id)
    return RegionsReply(
        burst_id=burst_id,
        regions=[
            {
                "edge": solution.series.edge,
                "label": edge_name(solution.series.edge),
                "solution_id": solution.solution_id,
                "preferred": solution.preferred,
                **selected_regions(service.posterior(solution), choice.frequency_mhz),
            }
            for solution in solutions
        ],
    )


def pick(catalogue: Catalogue, burst_id: str, choice: SolutionChoice) -> Solution:
    """The solution of a burst that a choice means; older versions only when the version is named."""
    return picked(catalogue, catalogue.burst(burst_id), choice)


def picked(catalogue: Catalogue, summary: BurstSummary, choice: SolutionChoice) -> Solution:
    """The same, of a burst that has been read."""
    burst_id = summary.burst.burst_id
    known = summary.solutions if choice.version is None else catalogue.versions(burst_id)
    return chosen_solution(tuple(known), choice, burst_id)


def versions_of(solutions: tuple[Solution, ...]) -> list[VersionReply]:
    """Solutions with the one that replaced each, in the order of the catalogue."""
    successor = {solution.supersedes: solution.solution_id for solution in solutions if solution.supersedes}
    return [
        VersionReply(**SolutionReply.of(s).model_dump(), superseded_by=successor.get(s.solution_id)) for s in solutions
    ]


def table_header(solution: Solution) -> dict[str, str]:
    """Lines above a table that say where its numbers come from."""
    series = solution.series
    return {
        "burst": solution.burst_id,
        "frame": "HEE, solar radii",
        "edge": series.edge,
        "method": series.method,
        "preset": series.preset,
        "version": str(solution.version),
        "solution": solution.solution_id,
        "origin": str(solution.origin),
        "preferred": "yes" if solution.preferred else "no",
        **({"retracted": solution.retracted.reason} if solution.retracted else {}),
        "grade": solution.answer.grade,
        "answer": solution.answer.sentence,
        "code_version": solution.code_version,
        "remark": APPARENT_SOURCE,
    }


def _record(row: Localisation) -> dict[str, Any]:
    """Columns of one row; None where there is no number, which JSON has no other word for."""
    columns = vars(row)
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in columns.items()
    }


tables = APIRouter(prefix="/api/v1", tags=["tables"])

IN_ALL_FORMATS = in_all_formats("The table.", TableReply)


@tables.get("/tracks", response_class=Response, responses=IN_ALL_FORMATS)
def tracks(request: Request, catalogue: CatalogueHere, wanted: Annotated[BurstTableFilter, Query()]) -> Response:
    """Parker spiral of each burst that a query finds, one row per burst: joint fit of its preferred solution."""
    return burst_table_reply(request, catalogue, wanted, asked_format(request, wanted.format), TRACK_TABLE)


@tables.get("/localisations", response_class=Response, responses=IN_ALL_FORMATS)
def localisations(request: Request, catalogue: CatalogueHere, wanted: Annotated[BurstTableFilter, Query()]) -> Response:
    """Sources of the bursts that a query finds, one row per frequency: preferred solutions; the limit counts bursts."""
    return burst_table_reply(request, catalogue, wanted, asked_format(request, wanted.format), LOCALISATION_TABLE)


@tables.get("/bursts/{burst_id}/arrivals", response_class=Response, responses=IN_ALL_FORMATS)
def arrivals(
    request: Request, burst_id: BurstId, service: ServiceHere, choice: Annotated[ArrivalChoice, Query()]
) -> Response:
    """Arrival times that one solution of a burst was made from, with errors and positions of receivers."""
    chosen = asked_format(request, choice.format)
    solution = pick(service.catalogue(), burst_id, choice)
    rows = arrival_rows(solution, service.posterior(solution), choice.observatory)
    return table_reply(chosen, table_of_rows(ARRIVALS, rows, burst=burst_id), f"{burst_id}_arrivals")

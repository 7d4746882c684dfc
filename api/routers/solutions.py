"""Single solutions, and their Zarr groups as files: what is under these addresses never changes."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from api.freshness import IMMUTABLE, last_modified
from api.queries import SolutionFilter, SolutionId, SourceFilter
from api.ranges import ranged
from api.replies import CalibrationReply, calibration_of
from api.schemas import (
    FileReply,
    FilesReply,
    SolutionReply,
    SolutionsReply,
    SolutionWithSourcesReply,
    SourceReply,
)
from api.service import CatalogueHere, ServiceHere
from api.tables import next_address
from bella.catalogue import Catalogue
from bella.store import file_of_group

router = APIRouter(prefix="/api/v1", tags=["solutions"])


@router.get("/solutions")
def solutions(request: Request, catalogue: CatalogueHere, wanted: Annotated[SolutionFilter, Query()]) -> SolutionsReply:
    """Solutions, all versions of all bursts, the newest first."""
    page = catalogue.solutions(wanted.query())
    return SolutionsReply(
        solutions=[SolutionReply.of(one) for one in page.solutions],
        total=page.total,
        returned=len(page.solutions),
        truncated=page.next_cursor is not None,
        next=next_address(request, page.next_cursor),
    )


@router.get("/files")
def files(
    request: Request, response: Response, catalogue: CatalogueHere, wanted: Annotated[SourceFilter, Query()]
) -> FilesReply:
    """Files that solutions were made from, with their versions and checksums, the newest day first."""
    response.headers.update(last_modified(catalogue.changed_utc("files")))
    page = catalogue.all_sources(wanted.query())
    names = SourceReply.model_fields
    return FilesReply(
        files=[
            FileReply(
                **{name: getattr(one.file, name) for name in (*names, "state")},
                received_utc=one.received_utc,
                changed_utc=one.changed_utc,
            )
            for one in page.sources
        ],
        total=page.total,
        returned=len(page.sources),
        truncated=page.next_cursor is not None,
        next=next_address(request, page.next_cursor),
    )


@router.get("/solutions/{solution_id}")
def solution(solution_id: SolutionId, catalogue: CatalogueHere) -> SolutionWithSourcesReply:
    """One solution, with its source files and their checksums, and how often answers like it held the truth."""
    known = catalogue.solution(solution_id)
    return SolutionWithSourcesReply(
        **SolutionReply.of(known).model_dump(),
        sources=sources_of(catalogue, solution_id),
        calibration=calibration_of(known, catalogue.burst(known.burst_id).burst.observatories),
    )


@router.get("/solutions/{solution_id}/calibration")
def calibration(solution_id: SolutionId, catalogue: CatalogueHere) -> CalibrationReply:
    """How often the intervals of simulated bursts like this one held the truth: rows of docs/calibration-found.csv."""
    known = catalogue.solution(solution_id)
    return calibration_of(known, catalogue.burst(known.burst_id).burst.observatories)


def sources_of(catalogue: Catalogue, solution_id: str) -> list[SourceReply]:
    """Files that a solution was made from."""
    names = SourceReply.model_fields
    return [SourceReply(**{name: getattr(one, name) for name in names}) for one in catalogue.sources(solution_id)]


@router.head("/solutions/{solution_id}/posterior.zarr/{key:path}", include_in_schema=False)
@router.get("/solutions/{solution_id}/posterior.zarr/{key:path}", response_class=Response)
def posterior_file(solution_id: SolutionId, key: str, service: ServiceHere, request: Request) -> Response:
    """One file of the Zarr group of a solution; ``xarray.open_zarr`` takes this address without the key."""
    group = service.catalogue().solution(solution_id).store_path
    content = file_of_group(service.settings.store_root, group, key)
    kind = "application/json" if key.endswith(".json") else "application/octet-stream"
    return ranged(request, content, kind, {"Cache-Control": IMMUTABLE})

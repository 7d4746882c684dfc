"""Published tables over many bursts, and the arrival times behind one: every format of `bella.formats`."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from api.queries import BurstId
from api.routers.bursts import pick
from api.schemas import TableReply
from api.service import CatalogueHere, ServiceHere
from api.tables import (
    LOCALISATION_TABLE,
    TRACK_TABLE,
    ArrivalChoice,
    BurstTableFilter,
    asked_format,
    burst_table_reply,
    in_all_formats,
    table_of_rows,
    table_reply,
)
from bella.formats import ARRIVALS
from bella.pipeline.rows import arrival_rows

router = APIRouter(prefix="/api/v1", tags=["tables"])

IN_ALL_FORMATS = in_all_formats("The table.", TableReply)


@router.get("/tracks", response_class=Response, responses=IN_ALL_FORMATS)
def tracks(request: Request, catalogue: CatalogueHere, wanted: Annotated[BurstTableFilter, Query()]) -> Response:
    """Parker spiral of each burst that a query finds, one row per burst: joint fit of its preferred solution."""
    return burst_table_reply(request, catalogue, wanted, asked_format(request, wanted.format), TRACK_TABLE)


@router.get("/localisations", response_class=Response, responses=IN_ALL_FORMATS)
def localisations(request: Request, catalogue: CatalogueHere, wanted: Annotated[BurstTableFilter, Query()]) -> Response:
    """Sources of the bursts that a query finds, one row per frequency: preferred solutions; the limit counts bursts."""
    return burst_table_reply(request, catalogue, wanted, asked_format(request, wanted.format), LOCALISATION_TABLE)


@router.get("/bursts/{burst_id}/arrivals", response_class=Response, responses=IN_ALL_FORMATS)
def arrivals(
    request: Request, burst_id: BurstId, service: ServiceHere, choice: Annotated[ArrivalChoice, Query()]
) -> Response:
    """Arrival times that one solution of a burst was made from, with errors and positions of receivers."""
    chosen = asked_format(request, choice.format)
    solution = pick(service.catalogue(), burst_id, choice)
    rows = arrival_rows(solution, service.posterior(solution), choice.observatory)
    return table_reply(chosen, table_of_rows(ARRIVALS, rows, burst=burst_id), f"{burst_id}_arrivals")

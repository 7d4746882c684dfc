"""Figures of a burst in plotly's JSON form, as the burst page draws them."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from api.freshness import fresh_json, is_known, not_modified, tag_of
from api.queries import BurstId, SeriesChoice, one_per_edge
from api.schemas import FigureReply
from api.service import CatalogueHere, ServiceHere
from bella.plotting import TrackView, constellation_figure, edge_name, spectra_figure

router = APIRouter(
    prefix="/api/v1/bursts/{burst_id}/figures",
    tags=["figures"],
    default_response_class=Response,
    responses={200: {"model": FigureReply, "description": "The figure."}},
)


@router.get("/constellation")
def constellation(
    request: Request,
    burst_id: BurstId,
    service: ServiceHere,
    catalogue: CatalogueHere,
    choice: Annotated[SeriesChoice, Query()],
) -> Response:
    """Sun, spacecraft, tracks with their credible regions, and the fitted spirals."""
    solutions = one_per_edge(catalogue.burst(burst_id).solutions, choice, burst_id)
    tag = tag_of(solutions, "constellation")
    if is_known(request, tag):
        return not_modified(tag)
    tracks = [
        TrackView(edge_name(s.series.edge), service.posterior(s), catalogue.track_fit(s.solution_id)) for s in solutions
    ]
    return fresh_json(constellation_figure(tracks), tag)


@router.get("/spectra")
def spectra(
    request: Request,
    burst_id: BurstId,
    service: ServiceHere,
    catalogue: CatalogueHere,
    choice: Annotated[SeriesChoice, Query()],
) -> Response:
    """Dynamic spectra of all spacecraft with the timed edges."""
    summary = catalogue.burst(burst_id)
    solutions = one_per_edge(summary.solutions, choice, burst_id)
    tag = tag_of(solutions, "spectra", summary.burst.spectra_path)
    if is_known(request, tag):
        return not_modified(tag)
    edges = {solution.series.edge: service.posterior(solution) for solution in solutions}
    return fresh_json(spectra_figure(service.spectra(burst_id, summary.burst.spectra_path), edges), tag)

"""Figures of a burst, SVG, as the burst page draws them and as files to keep."""

from collections.abc import Mapping
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Query, Request, Response

from api.drawing import BurstView, Looked
from api.freshness import REVALIDATE, is_known, not_modified, tag_of
from api.queries import BurstId
from api.service import CatalogueHere, ServiceHere
from bella.exceptions import NoDataError
from bella.plotting import as_file, constellation_caption, spectra_caption

router = APIRouter(prefix="/api/v1/bursts/{burst_id}/figures", tags=["figures"], default_response_class=Response)

FILE_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""A figure that is opened by itself has its style and its pictures inside."""

FigureName = Literal["constellation", "spectra", "evolution", "residuals"]


def _looked(
    burst_id: BurstId, service: ServiceHere, catalogue: CatalogueHere, view: Annotated[BurstView, Query()]
) -> Looked:
    return Looked(service, catalogue, catalogue.burst(burst_id), view)


@router.get("/{name}", responses={200: {"content": {"image/svg+xml": {}}, "description": "The figure."}})
def burst_figure(request: Request, name: FigureName, looked: Annotated[Looked, Depends(_looked)]) -> Response:
    """Map of the track, spectra with the timed edges, distance and speed against frequency, or residuals; SVG."""
    burst_id, view = looked.summary.burst.burst_id, looked.view
    solutions, more = looked.tags()
    tag = tag_of(solutions, name, *more)
    if is_known(request, tag):
        return not_modified(tag)
    drawn = getattr(looked, name)()
    if drawn is None:
        raise NoDataError(f"{burst_id} has no positions: there is no such figure")
    headers = {
        "ETag": tag,
        "Cache-Control": REVALIDATE,
        "Content-Disposition": f'inline; filename="{burst_id}_{name}.svg"',
    }
    return svg_reply(as_file(drawn, f"{_caption(name, view)} {_source(looked)}"), headers)


def svg_reply(drawn: str, headers: Mapping[str, str]) -> Response:
    """Figure as a file of its own."""
    return Response(drawn, media_type="image/svg+xml", headers={**headers, "Content-Security-Policy": FILE_POLICY})


def _caption(name: FigureName, view: BurstView) -> str:
    return {
        "constellation": constellation_caption(view.frame),
        "spectra": spectra_caption(view.clock),
        "evolution": "Distance of the source, and speed of the beam, against frequency, with 68 % intervals. Lines: "
        "where the density of Leblanc et al. (1998) emits, fundamental drawn out, harmonic dashed.",
        "residuals": "Arrival times less those of the mean of the posterior.",
    }[name]


def _source(looked: Looked) -> str:
    """Where the figure comes from, as it is cited."""
    solution = looked.shown
    version = f", solution {solution.solution_id}: {solution.answer.sentence}" if solution else ""
    return f"Burst {looked.summary.burst.burst_id}{version}. BELLA service, doi:10.1051/0004-6361/202347747."

"""Figures as the pages draw them, as files to keep: SVG, PNG or PDF with caption and how to cite them."""

import hashlib
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from pydantic import Field

from api.drawing import BurstView, Looked, selection_of, selection_query
from api.freshness import file_tag, is_known, not_modified, tag_of
from api.links import linked, site_url
from api.queries import BurstId, BurstSelection, DayText, OriginChoice, SolutionId
from api.service import CatalogueHere, ServiceHere
from bella.catalogue import Burst
from bella.exceptions import NoDataError
from bella.plotting import (
    MEDIA_TYPES,
    Caption,
    Kind,
    Theme,
    constellation_caption,
    day_caption,
    evolution_caption,
    exported,
    origin_warning,
    residual_caption,
    selection_caption,
    shared_profile_caption,
    spectra_caption,
    wind_map_caption,
)
from bella.settings import WIND_FIGURE
from bella.times import parse_day

router = APIRouter(prefix="/api/v1", tags=["figures"], default_response_class=Response)

FILE_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""A figure that is opened by itself has its style and its pictures inside."""

METHOD = "method: Cañizares et al. (2024), doi:10.1051/0004-6361/202347747."

FigureName = Literal["constellation", "spectra", "evolution", "residuals"]
SelectionFigure = Literal["longitude", "footpoints", "wind"]
SolutionFigure = Literal["wind", "shared-profile"]
KindHere = Annotated[Kind, Path(description="Kind of the file.", examples=["svg"])]
THEME: Theme = "light"
A_FIGURE: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The figure.",
        "content": {one: {"schema": {"type": "string"}} for one in MEDIA_TYPES.values()},
    }
}


class SelectionView(BurstSelection):
    """A figure of bursts, and for which ground."""

    theme: Theme = Field(THEME, description="Colours for a light or for a dark ground.")


class FigureView(BurstView):
    """A figure of a burst, and for which ground."""

    theme: Theme = Field(THEME, description="Colours for a light or for a dark ground.")


def _looked(
    burst_id: BurstId, service: ServiceHere, catalogue: CatalogueHere, view: Annotated[FigureView, Query()]
) -> Looked:
    return Looked(service, catalogue, catalogue.burst(burst_id), view)


@router.get("/bursts/{burst_id}/figures/{name}.{kind}", responses=A_FIGURE)
def burst_figure(
    request: Request, name: FigureName, kind: KindHere, looked: Annotated[Looked, Depends(_looked)]
) -> Response:
    """Map of the track, spectra with the timed edges, distance and speed against frequency, or residuals."""
    burst, view = looked.summary.burst, looked.view
    tag = tag_of((), name, kind, *looked.tags())
    if is_known(request, tag):
        return not_modified(tag)
    drawn = getattr(looked, name)()
    if drawn is None:
        raise NoDataError(f"this answer for {burst.burst_id} has no {name}: its posterior does not hold them")
    text = {
        "constellation": constellation_caption(view.frame),
        "spectra": spectra_caption(view.clock),
        "evolution": evolution_caption(),
        "residuals": residual_caption(),
    }[name]
    caption = Caption(text, _source(request, looked), _warning(burst))
    theme = view.theme if isinstance(view, FigureView) else THEME
    return file_reply(exported(drawn, caption, kind, theme), kind, f"{burst.burst_id}_{name}", tag)


@router.get("/figures/{name}.{kind}", responses=A_FIGURE)
def selection_figure(
    request: Request,
    name: SelectionFigure,
    kind: KindHere,
    catalogue: CatalogueHere,
    wanted: Annotated[SelectionView, Query()],
) -> Response:
    """Longitudes of bursts against time, their footpoints around the Sun, or the solar wind against time."""
    found = selection_of(catalogue, wanted)
    figures = found.figures()
    if not figures:
        raise NoDataError("fewer than two bursts are like that: ask for more of them")
    asked = wanted.model_dump(exclude_defaults=True, exclude={"theme"}, mode="json")
    query = selection_query(asked)
    source = f"Cite: BELLA service, {_address(request, '/')}{'?' if query else ''}{query}; {METHOD}"
    warning = "Simulated data or data of tests are among the bursts." if found.has_unreal else ""
    caption = Caption(selection_caption(name, len(found.bursts), found.total), source, warning)
    made = exported(figures[name], caption, kind, wanted.theme)
    return file_reply(made, kind, f"bella_{name}", tag_of((), hashlib.sha256(made).hexdigest()))


@router.get("/solutions/{solution_id}/figures/{name}.{kind}", responses=A_FIGURE)
def solution_figure(
    request: Request, solution_id: SolutionId, name: SolutionFigure, kind: KindHere, service: ServiceHere
) -> Response:
    """The measured wind with the track in it, or the light curves on the profile that they share."""
    catalogue = service.catalogue()
    burst = catalogue.burst(catalogue.solution(solution_id).burst_id).burst
    path = service.settings.solution_figure(burst.burst_id, solution_id, name)
    if not path.is_file():
        raise NoDataError(f"{name} of {solution_id} is not drawn: run the burst again")
    warning = _warning(burst)
    tag = tag_of((), file_tag(path), kind, warning)
    if is_known(request, tag):
        return not_modified(tag)
    text = wind_map_caption() if name == WIND_FIGURE else shared_profile_caption()
    address = _address(request, f"/api/v1/solutions/{solution_id}")
    caption = Caption(text, f"Burst {burst.burst_id}. Cite: BELLA service, {address}; {METHOD}", warning)
    made = exported(path.read_text(encoding="utf-8"), caption, kind)
    return file_reply(made, kind, f"{burst.burst_id}_{name}", tag)


@router.get("/days/{day}/figure.{kind}", responses=A_FIGURE)
def day_figure(
    request: Request,
    day: DayText,
    kind: KindHere,
    service: ServiceHere,
    choice: Annotated[OriginChoice, Query()],
) -> Response:
    """Spectra of all spacecraft on a searched day with what was found outlined; redrawn with the day."""
    wanted = parse_day(day, "day")
    drawn = {origin: service.settings.day_figure(wanted, origin) for origin in choice.origins}
    origin, path = next(((one, path) for one, path in drawn.items() if path.is_file()), (None, None))
    if origin is None or path is None:
        raise NoDataError(f"{wanted} is not drawn: run bella run --from {wanted}")
    tag = tag_of((), file_tag(path), kind)
    if is_known(request, tag):
        return not_modified(tag)
    source = f"BELLA service, {_address(request, f'/days/{wanted}')}."
    caption = Caption(day_caption(wanted), source, origin_warning(origin))
    return file_reply(exported(path.read_text(encoding="utf-8"), caption, kind), kind, f"bella_{wanted}", tag)


def file_reply(made: bytes, kind: Kind, name: str, tag: str) -> Response:
    """Figure as a file of its own."""
    headers = {
        "ETag": tag,
        "Content-Disposition": f'inline; filename="{name}.{kind}"',
        "Content-Security-Policy": FILE_POLICY,
    }
    return Response(made, media_type=MEDIA_TYPES[kind], headers=headers)


def _warning(burst: Burst) -> str:
    if burst.retracted:
        return f"Retracted burst: {burst.retracted.reason}."
    return origin_warning(burst.origin)


def _source(request: Request, looked: Looked) -> str:
    """Where the figure comes from, as it is cited."""
    burst, solution = looked.summary.burst, looked.shown
    if solution is None:
        return f"Burst {burst.burst_id}. BELLA service, {_address(request, f'/bursts/{burst.burst_id}')}; {METHOD}"
    said = solution.answer.sentence.replace("R_sun", "R\N{SUN}")
    address = _address(request, f"/api/v1/solutions/{solution.solution_id}")
    return f"Burst {burst.burst_id}: {said}. Cite: BELLA service, {address}; {METHOD}"


def _address(request: Request, path: str) -> str:
    return site_url(request) + linked(path)

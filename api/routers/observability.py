"""Observability: which receivers had data at a time, and how well they would have located a source."""

from datetime import UTC, date, datetime
from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response
from pydantic import Field

from api.addresses import API
from api.freshness import is_known, not_modified, tag_of
from api.links import linked, site_url
from api.planning import PlanningQuery, planning_map
from api.replies import Reply
from api.routers.figures import A_FIGURE, METHOD, THEME, KindHere, file_reply
from api.service import CatalogueHere
from bella.catalogue import FleetMap, ObservedDay
from bella.plotting import Caption, Theme, exported, planning_caption
from bella.records import Prediction

router = APIRouter(tags=["observability"])


class PlanningView(PlanningQuery):
    """A map of a prediction, and for which ground."""

    theme: Theme = Field(THEME, description="Colours for a light or for a dark ground.")


class ObservabilityReply(Reply):
    """Receivers with data in the hour of a time, and how well they locate."""

    utc: datetime
    observatories: list[str] = Field(description="With data in at least half of the hour.")
    localisable: bool = Field(description="Three or more: a source could have been located.")
    distances_rsun: list[float]
    longitudes_deg: list[float] = Field(description="HEE, west positive.")
    map: FleetMap | None = Field(description="Null where fewer than three receivers had data.")


@router.get(f"{API}/observability")
def observability(
    catalogue: CatalogueHere, time: Annotated[datetime, Query(description="UTC.", examples=["2021-11-20T14:30"])]
) -> ObservabilityReply:
    """Which receivers had data at a time, and the 68 % region of a source at 20, 50 and 100 solar radii."""
    utc = time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
    observed = catalogue.operation.observed(utc.date())
    here, found = observed.at(utc)
    return ObservabilityReply(
        utc=utc,
        observatories=list(here),
        localisable=found is not None,
        distances_rsun=list(observed.distances_rsun),
        longitudes_deg=list(observed.longitudes_deg),
        map=found,
    )


@router.get(f"{API}/days/{{day}}/observability")
def observability_of_day(
    day: Annotated[date, Path(description="Day, UTC.", examples=["2021-11-20"])], catalogue: CatalogueHere
) -> ObservedDay:
    """The same for every hour of a day."""
    return catalogue.operation.observed(day)


@router.get(f"{API}/planning")
def planning(wanted: Annotated[PlanningQuery, Query()]) -> Prediction:
    """How well a fleet would locate a source on any day, by distance and direction, before there are data."""
    return wanted.prediction()


@router.get(f"{API}/planning/figure.{{kind}}", responses=A_FIGURE, response_class=Response)
def planning_figure(request: Request, kind: KindHere, wanted: Annotated[PlanningView, Query()]) -> Response:
    """The same as a map."""
    tag = tag_of((), kind, wanted.theme, wanted.query())
    if is_known(request, tag):
        return not_modified(tag)
    found = wanted.prediction()
    source = f"Cite: BELLA service, {site_url(request)}{linked('/planning')}?{wanted.query()}; {METHOD}"
    caption = Caption(planning_caption(found.day, [*found.receivers_rsun], found.sigma_s), source)
    made = exported(planning_map(found), caption, kind, wanted.theme)
    return file_reply(made, kind, f"bella_planning_{found.day}", tag)

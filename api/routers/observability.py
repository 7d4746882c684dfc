"""Which receivers had data, and how well they would have located a source, or would on any other day.

The only place where a request computes a posterior: of made-up arrival times, bounded in size; nothing is fitted.
"""

from datetime import UTC, date, datetime
from functools import lru_cache
from threading import Lock
from typing import Annotated
from urllib.parse import urlencode

import numpy as np
from fastapi import APIRouter, Path, Query, Request, Response
from pydantic import Field

from api.freshness import is_known, not_modified, tag_of
from api.links import API, linked, site_url
from api.queries import DayAsked, Names, OriginChoice, Parameters, read_observatory
from api.replies import Reply
from api.routers.figures import A_FIGURE, METHOD, THEME, KindHere, file_reply
from api.service import CatalogueHere
from bella.catalogue import FleetMap, ObservedDay
from bella.exceptions import BusyError
from bella.plotting import Caption, Theme, exported, planning_caption
from bella.plotting import planning_figure as fleet_drawing
from bella.records import Prediction
from bella.spacecraft import OBSERVATORIES
from bella.times import parse_day

PREDICTIONS_KEPT = 256
PATIENCE_S = 5.0
"""How long a request waits for those before it: each takes less than a second."""

DISTANCES_RSUN = (20.0, 50.0, 100.0)
"""That are told in words; about where the plasma frequency is 1, 0.4 and 0.2 MHz."""

GOOD_SHARE, ROUGH_SHARE = 0.25, 0.5
"""Of its distance, as radius of the 68 % region: seen from the Sun 14 and 27 degrees. Farther apart, footpoints of
neighbouring active regions are not told from one another."""

_alone = Lock()


class PlanningQuery(Parameters):
    """Which fleet, when, and how well timed."""

    day: DayAsked = Field(None, description="Day, UTC; today without it.", examples=["2013-05-13"])
    observatory: Names = Field(
        [], max_length=8, description="Spacecraft; repeatable. Without it, all whose position is known on the day."
    )
    sigma_s: float = Field(15.0, ge=1.0, le=600.0, description="Error of each arrival time, s.")
    frequency_mhz: float = Field(0.5, ge=0.03, le=15.0, description="Frequency whose distance is marked, MHz.")

    @property
    def on(self) -> date:
        """The day.

        Raises
        ------
        InputError
            If it cannot be read.
        """
        return parse_day(self.day, "day") if self.day else datetime.now(UTC).date()

    def query(self) -> str:
        """Query of the address of this prediction alone, which does not change with the day on which it is asked."""
        asked = self.model_dump(include=set(PlanningQuery.model_fields), exclude_defaults=True)
        asked["day"] = self.on.isoformat()
        return urlencode(asked, doseq=True)

    def prediction(self) -> Prediction:
        """What the fleet would tell.

        Raises
        ------
        InputError
            If the day or a spacecraft cannot be read.
        BusyError
            If too many ask at once.
        """
        names = {read_observatory(name) for name in self.observatory}
        return _prediction(self.on, tuple(sorted(names)), self.sigma_s, self.frequency_mhz)


def _prediction(day: date, names: tuple[str, ...], sigma_s: float, frequency_mhz: float) -> Prediction:
    if not _alone.acquire(timeout=PATIENCE_S):
        raise BusyError("others are asking for predictions: try again in a few seconds")
    try:
        return _kept(day, names, sigma_s, frequency_mhz)
    finally:
        _alone.release()


@lru_cache(PREDICTIONS_KEPT)
def _kept(day: date, names: tuple[str, ...], sigma_s: float, frequency_mhz: float) -> Prediction:
    from bella.pipeline.observability import predicted  # noqa: PLC0415 - a room that no other request needs

    found = predicted(day, names or OBSERVATORIES, sigma_s, frequency_mhz)
    return found if names else found.model_copy(update={"missing": {}})


def planning_map(found: Prediction) -> str:
    """Figure of a prediction, SVG."""
    noon = np.datetime64(found.day, "ns") + np.timedelta64(12, "h")
    return fleet_drawing(
        noon,
        {name: np.array(place) for name, place in found.receivers_rsun.items()},
        found.longitudes_deg,
        dict(zip(found.distances_rsun, found.radius68_rsun, strict=True)),
        (f"{found.frequency_mhz:g} MHz", found.frequency_rsun),
    )


def verdict(radius_rsun: float | None, distance_rsun: float) -> str:
    """Whether a source would be located, in a word."""
    if radius_rsun is None or radius_rsun > ROUGH_SHARE * distance_rsun:
        return "no"
    return "yes" if radius_rsun <= GOOD_SHARE * distance_rsun else "roughly"


router = APIRouter(tags=["observability"])


class PlanningView(PlanningQuery):
    """A map of a prediction, and for which ground."""

    theme: Theme = Field(THEME, description="Colours for a light or for a dark ground.")


class ObservabilityQuery(OriginChoice):
    """When, and in data of which origin."""

    time: datetime = Field(description="UTC.", examples=["2021-11-20T14:30"])


class ObservabilityReply(Reply):
    """Receivers with data in the hour of a time, and how well they locate."""

    utc: datetime
    observatories: list[str] = Field(description="With data in at least half of the hour.")
    localisable: bool = Field(description="Three or more: a source could have been located.")
    distances_rsun: list[float]
    longitudes_deg: list[float] = Field(description="HEE, west positive.")
    map: FleetMap | None = Field(description="Null where fewer than three receivers had data.")


@router.get(f"{API}/observability")
def observability(catalogue: CatalogueHere, wanted: Annotated[ObservabilityQuery, Query()]) -> ObservabilityReply:
    """Which receivers had data at a time, and the 68 % region of a source at 20, 50 and 100 solar radii."""
    time = wanted.time
    utc = time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
    observed = catalogue.operation.observed(utc.date(), wanted.origins)
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
    day: Annotated[date, Path(description="Day, UTC.", examples=["2021-11-20"])],
    catalogue: CatalogueHere,
    choice: Annotated[OriginChoice, Query()],
) -> ObservedDay:
    """The same for every hour of a day."""
    return catalogue.operation.observed(day, choice.origins)


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

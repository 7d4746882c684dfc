"""The list of bursts: each with its answer and a small picture of its track, and a form that writes the query."""

from collections.abc import Iterable, Sequence
from datetime import UTC, date, datetime, timedelta
from typing import Any
from urllib.parse import urlencode

import numpy as np
from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse
from markupsafe import Markup
from pydantic import ValidationError

from api.drawing import sector_address, selection_of, selection_query
from api.links import burst_links
from api.queries import NEWEST_FIRST, BurstFilter, asked_of, fault_words
from api.rendering import render
from api.service import CatalogueHere
from bella.answer import GRADES
from bella.catalogue import BurstPage, BurstQuery, BurstSummary, Catalogue
from bella.exceptions import InputError, NoDataError
from bella.flags import FLAGS, HARMLESS_FLAGS
from bella.pipeline.page_figures import places_of
from bella.plotting import thumbnail
from bella.records import ALL_ORIGINS, REAL_ORIGINS, UNREAL_ORIGINS, Origin
from bella.spacecraft import OBSERVATORIES

router = APIRouter(include_in_schema=False)

FILTER_NAMES = frozenset(BurstFilter.model_fields)
LISTS = frozenset({"observatory", "grade", "flag", "without_flag", "edge", "method", "preset"})

SORTS = {
    "-start": "newest first",
    "start": "oldest first",
    "-updated": "last changed first",
    "grade": "best grade first",
    "longitude": "by longitude",
    "distance": "nearest first",
    "-wind": "fastest wind first",
    "area": "smallest region first",
}
NUMBERS = {
    "longitude": "Longitude (°, west positive)",
    "distance": "Distance (R☉)",
    "wind": "Wind (km/s)",
    "frequency": "Frequency (MHz)",
    "area": "68 % area (R☉²)",
}
FURTHER = ("observatory", "without_flag", "origin", *(f"{name}_{end}" for name in NUMBERS for end in ("min", "max")))
"""Names of the query that are below the first line of the form."""

FARTHEST = 1.3
"""Of the answer: positions farther out are of channels that say nothing."""

RECENT_DAYS = (7, 30, 365)

MOST_PICTURES = 200
"""Beyond so many rows a list has no pictures of tracks."""


@router.get("/")
def list_page(request: Request, catalogue: CatalogueHere) -> HTMLResponse:
    """Bursts that match the query of the address, with a form that writes that query."""
    asked = asked_of(request, LISTS)
    page, fault = _answer(catalogue, asked)
    following = page.next_cursor if page else None
    bursts = page.bursts if page else ()
    is_empty = page is not None and page.total == 0 and _total(catalogue, REAL_ORIGINS) == 0
    return render(
        request,
        "bursts.html",
        status=422 if fault else 200,
        real=REAL_ORIGINS,
        origins=[*Origin, ALL_ORIGINS],
        rows=[(summary, burst_links(summary.burst), picture) for summary, picture in _pictured(catalogue, bursts)],
        plots=_plots(catalogue, asked) if page else {},
        page=page,
        fault=fault,
        arc=_arc(asked) if page else None,
        asked={name: asked.get(name, [] if name in LISTS else "") for name in FILTER_NAMES},
        filtered=any(asked.get(name) for name in FILTER_NAMES - {"limit", "cursor", "sort"}),
        onward=urlencode({**asked, "cursor": following}, doseq=True) if following else None,
        first=urlencode({name: value for name, value in asked.items() if name != "cursor"}, doseq=True),
        selection=selection_query(asked),
        is_empty=is_empty,
        unreal=_total(catalogue, UNREAL_ORIGINS) if is_empty else 0,
        observatories=list(dict.fromkeys([*OBSERVATORIES, *asked.get("observatory", [])])),
        flags=FLAGS,
        recent=_recent(),
        sorts=SORTS,
        numbers=NUMBERS,
        more=any(asked.get(name) for name in FURTHER),
        harmless=HARMLESS_FLAGS,
        grades=GRADES,
        base_url=str(request.base_url).rstrip("/"),
    )


def _total(catalogue: Catalogue, origins: Iterable[Origin]) -> int:
    return catalogue.bursts(BurstQuery(limit=1, origins=frozenset(origins))).total


@router.get("/latest")
def latest(catalogue: CatalogueHere) -> RedirectResponse:
    """The newest burst with an answer.

    Raises
    ------
    NoDataError
        If there is none.
    """
    newest = catalogue.bursts(BurstQuery(limit=1, sort=NEWEST_FIRST)).bursts
    if not newest:
        raise NoDataError("the catalogue holds no burst yet: run bella run")
    return RedirectResponse(burst_links(newest[0].burst)["page"], 302)


def _answer(catalogue: Catalogue, asked: dict[str, Any]) -> tuple[BurstPage | None, str | None]:
    """Page of bursts, or what is wrong with the question."""
    try:
        return catalogue.bursts(BurstFilter.model_validate(asked).query()), None
    except (InputError, ValidationError) as error:
        return None, fault_words(error)


def _arc(asked: dict[str, Any]) -> tuple[float, float] | None:
    """Ends of the longitudes that are asked for, where the way westward from the first to the second crosses 180."""
    wanted = BurstFilter.model_validate(asked)
    first, last = wanted.longitude_min, wanted.longitude_max
    return (first, last) if first is not None and last is not None and first > last else None


def _recent() -> list[tuple[int, date]]:
    """Lengths of time until today, each with its first day."""
    today = datetime.now(UTC).date()
    return [(days, today - timedelta(days=days)) for days in RECENT_DAYS]


def _plots(catalogue: Catalogue, asked: dict[str, Any]) -> dict[str, Any]:
    """Figures of all bursts that the query finds, and how many of them they show."""
    found = selection_of(catalogue, BurstFilter.model_validate(asked))
    drawn = found.figures(sector_address(asked))
    return {
        "shown": len(found.bursts),
        "total": found.total,
        "figures": {name: Markup(one) for name, one in drawn.items()},  # noqa: S704 - drawn here
    }


def _pictured(catalogue: Catalogue, bursts: Sequence[BurstSummary]) -> list[tuple[BurstSummary, Markup | None]]:
    """Bursts, each beside the picture of the track of its preferred solution; none of any where they are many."""
    answers = [one.preferred for one in bursts if one.preferred] if len(bursts) <= MOST_PICTURES else []
    places = catalogue.places_of([one.solution_id for one in answers])
    drawn = {one.burst_id: places[one.solution_id] for one in answers}
    return [(one, _picture(one, drawn[one.burst.burst_id]) if one.burst.burst_id in drawn else None) for one in bursts]


def _picture(summary: BurstSummary, found: Sequence[tuple[float, float]]) -> Markup:
    """Small picture of the track of the preferred solution."""
    burst, best = summary.burst, summary.preferred
    assert best is not None  # noqa: S101 - the caller has looked
    answer = best.answer
    reach = FARTHEST * (answer.range_high_rsun or np.inf)
    places = np.array(found).reshape(-1, 2)
    places = places[np.hypot(*places.T) <= reach]
    ends = None
    if answer.phi0_low_deg is not None and answer.phi0_high_deg is not None:
        ends = (answer.phi0_low_deg, answer.phi0_high_deg)
    utc = np.datetime64(burst.start_utc.replace(tzinfo=None), "ns")
    said = f"Track of {burst.burst_id}: {answer.sentence}"
    return Markup(thumbnail(places, ends, places_of(burst.observatories, utc), said))  # noqa: S704 - drawn here

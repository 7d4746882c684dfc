"""The pages of searched days: all of them with how much was heard, and one with what was heard."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, time, timedelta
from itertools import groupby
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse
from pydantic import ValidationError

from api.asking import asked_of, fault_words
from api.queries import DayFilter, parse_day
from api.rendering import render
from api.schemas import day_links
from api.service import CatalogueHere, ServiceHere
from api.wording import NOT_COMPARED
from bella.catalogue import BurstQuery, Catalogue, DayPage, DaySummary, Detection, ObservedDay
from bella.exceptions import InputError, NoDataError
from bella.flags import REJECTED
from bella.records import ALL_ORIGINS, REAL_ORIGINS, Origin, origins_asked

router = APIRouter(include_in_schema=False)

FIELDS = ("from", "to", "limit", "origin")
AROUND = timedelta(hours=1)
"""A burst keeps the onset under which it was first published; later data may move it past midnight."""


@dataclass(frozen=True)
class ShownBurst:
    """A burst as the spacecraft heard it, by onset; `has_page` where the catalogue has its localisation."""

    burst_id: str
    reason: str
    has_page: bool
    heard: tuple[Detection, ...]


@router.get("/days")
def days_page(request: Request, catalogue: CatalogueHere) -> HTMLResponse:
    """Searched days of the query of the address, the newest first, by month."""
    asked = asked_of(request)
    page, onward, fault = _answer(catalogue, asked)
    return render(
        request,
        "days.html",
        status=422 if fault else 200,
        months=_months(page.days) if page else [],
        page=page,
        fault=fault,
        asked={name: asked.get(name, "") for name in FIELDS},
        filtered=any(asked.get(name) for name in ("from", "to", "origin")),
        onward=onward,
        is_empty=page is not None and page.total == 0 and catalogue.days(limit=1).total == 0,
    )


def _answer(catalogue: Catalogue, asked: dict[str, Any]) -> tuple[DayPage | None, str | None, str | None]:
    """Page of days with the query of the next one, or what is wrong with the question."""
    try:
        wanted = DayFilter.model_validate(asked)
        page = catalogue.days(*wanted.span(), wanted.limit, wanted.origins)
    except (InputError, ValidationError) as error:
        return None, None, fault_words(error)
    return page, wanted.onward(page.next_last) if page.next_last else None, None


def _months(days: Sequence[DaySummary]) -> list[tuple[str, list[DaySummary]]]:
    return [(month, list(some)) for month, some in groupby(days, key=lambda one: f"{one.searched.day:%B %Y}")]


@router.get("/days/{day}")
def day_page(request: Request, day: str, service: ServiceHere, catalogue: CatalogueHere) -> HTMLResponse:
    """What was heard on a searched day, drawn and in tables."""
    wanted = parse_day(day)
    asked = _origins(request)
    known = catalogue.days(wanted, wanted, 1, asked).days
    summary = min(known, key=lambda one: asked.index(one.searched.origin), default=None)
    if summary is None:
        raise NoDataError(f"{wanted} was not searched: run bella run --from {wanted}")
    origins = (summary.searched.origin,)
    found = catalogue.detections_of(wanted, origins)
    beside = [one and day_links(one, origins[0])["page"] for one in catalogue.days_beside(wanted, origins)]
    before, after = catalogue.days_beside(wanted, origins)
    return render(
        request,
        "day.html",
        summary=summary,
        links=day_links(wanted, origins[0]),
        origin=origins[0],
        is_real=origins[0] in REAL_ORIGINS,
        beside=beside,
        is_drawn=service.settings.day_figure(wanted, origins[0]).is_file(),
        bursts=_shown_bursts(found, _with_page(catalogue, wanted)),
        rejected=[one for one in found if one.tier == REJECTED],
        before=before,
        after=after,
        observed=_observed(catalogue, wanted) if origins[0] in REAL_ORIGINS else None,
    )


def _origins(request: Request) -> tuple[Origin, ...]:
    """Origins that the query of an address asks for.

    Raises
    ------
    InputError
        Where there is no such origin.
    """
    try:
        return origins_asked(request.query_params.get("origin") or None)
    except ValueError as error:
        raise InputError(f"origin: give one of {', '.join([*Origin, ALL_ORIGINS])}") from error


def _observed(catalogue: Catalogue, day: date) -> ObservedDay | None:
    """Observability of a day; None where it was searched before there was one."""
    try:
        return catalogue.operation.observed(day)
    except NoDataError:
        return None


def _with_page(catalogue: Catalogue, day: date) -> frozenset[str]:
    """Bursts around a day that the catalogue has."""
    midnight = datetime.combine(day, time(), UTC)
    query = BurstQuery(
        start=midnight - AROUND, stop=midnight + timedelta(days=1) + AROUND, limit=1000, origins=frozenset(Origin)
    )
    return frozenset(one.burst.burst_id for one in catalogue.bursts(query).bursts)


def _shown_bursts(found: Sequence[Detection], with_page: frozenset[str]) -> list[ShownBurst]:
    """Bursts of the detections of a day, by their first onset; what was not compared stands alone."""
    heard: dict[str, list[Detection]] = {}
    for number, one in enumerate(found):
        if one.tier != REJECTED:
            heard.setdefault(one.burst_id or f"{number}", []).append(one)
    return [
        ShownBurst(
            some[0].burst_id,
            some[0].reason if some[0].burst_id else NOT_COMPARED,
            some[0].burst_id in with_page,
            tuple(some),
        )
        for some in heard.values()
    ]

"""Time: searched days from years to hours on one calendar, and the page of a day with all that was found on it."""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, time, timedelta
from html import escape
from itertools import groupby
from pathlib import Path
from typing import Any
from urllib.parse import quote

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse
from markupsafe import Markup
from pydantic import ValidationError

from api.freshness import tag_of
from api.links import day_links, linked, site_url
from api.queries import DayFilter, asked_of, fault_words
from api.rendering import NOT_COMPARED, answer_words, render
from api.routers.figures import file_reply
from api.service import CatalogueHere, Service, ServiceHere
from bella.catalogue import BurstQuery, Catalogue, DayPage, DaySummary, Detection, DetectionQuery, ObservedDay
from bella.exceptions import InputError, NoDataError
from bella.flags import LOCALISABLE, REJECTED
from bella.plotting import (
    Caption,
    DayMark,
    Kind,
    OnsetMark,
    calendar_caption,
    calendar_figure,
    exported,
    origin_warning,
    strips_figure,
    zoomed_day,
)
from bella.records import ALL_ORIGINS, REAL_ORIGINS, UNREAL_ORIGINS, DayAnswer, Origin, origins_asked
from bella.times import parse_day
from bella.units import DAY_S

router = APIRouter(include_in_schema=False)

FIELDS = ("from", "to", "limit", "origin")
AROUND = timedelta(hours=1)
"""A burst keeps the onset under which it was first published; later data may move it past midnight."""

HOURS_SHOWN = ("00:00,06:00", "06:00,12:00", "12:00,18:00", "18:00,24:00")
TIMES_OF_DAY = re.compile(r"([01]\d|2[0-4]):([0-5]\d),([01]\d|2[0-4]):([0-5]\d)")
LEAST_SHOWN_S = 600.0
"""Of the spectra of a day, whose picture is two minutes fine."""

MOST_STRIPS = 31
"""So many days or fewer are shown by the hour, more by the day."""

MOST_ONSETS = 5000

BURSTS_PER_PART = 200
"""So many bursts of a day, with what each spacecraft received, are shown together; so many rejected ones at most."""


@dataclass(frozen=True)
class ShownBurst:
    """A burst as the spacecraft detected it, by onset; `has_page` where the catalogue has its localisation."""

    burst_id: str
    reason: str
    has_page: bool
    received: tuple[Detection, ...]


@router.get("/days")
def days_page(request: Request, catalogue: CatalogueHere) -> HTMLResponse:
    """Searched days of the query of the address, the newest first, by month."""
    asked = asked_of(request)
    page, onward, fault = _answer(catalogue, asked)
    is_empty = page is not None and page.total == 0 and catalogue.days(limit=1).total == 0
    return render(
        request,
        "days.html",
        status=422 if fault else 200,
        months=_months(page.days) if page else [],
        figure=_figure(catalogue, page, asked) if page and page.days else None,
        calendar_query=f"?{request.url.query}" if request.url.query else "",
        answers=list(DayAnswer),
        page=page,
        fault=fault,
        asked={name: asked.get(name, "") for name in FIELDS},
        filtered=any(asked.get(name) for name in ("from", "to", "origin")),
        onward=onward,
        is_empty=is_empty,
        unreal=catalogue.days(limit=1, origins=UNREAL_ORIGINS).total if is_empty else 0,
    )


def _answer(catalogue: Catalogue, asked: dict[str, Any]) -> tuple[DayPage | None, str | None, str | None]:
    """Page of days with the query of the next one, or what is wrong with the question."""
    try:
        wanted = DayFilter.model_validate({"limit": 366} | {name: value for name, value in asked.items() if value})
        page = catalogue.days(*wanted.span(), wanted.limit, wanted.origins)
    except (InputError, ValidationError) as error:
        return None, None, fault_words(error)
    return page, wanted.onward(page.next_last) if page.next_last else None, None


def _months(days: Sequence[DaySummary]) -> list[tuple[str, list[DaySummary]]]:
    return [(month, list(some)) for month, some in groupby(days, key=lambda one: f"{one.searched.day:%B %Y}")]


def _figure(catalogue: Catalogue, page: DayPage, asked: dict[str, Any]) -> Markup:
    """Calendar of the days, or their hours with every burst where they are few."""
    by_day = {one.searched.day: one for one in reversed(page.days)}
    marks = [_mark(one) for one in by_day.values()]
    if len(marks) > MOST_STRIPS or not (asked.get("from") or len(marks) <= MOST_STRIPS // 2):
        return Markup(calendar_figure(marks))  # noqa: S704 - drawn here, and its texts are escaped
    first, last = min(by_day), max(by_day)
    origins = tuple({one.searched.origin for one in by_day.values()})
    return Markup(strips_figure(marks, _onsets(catalogue, first, last, origins)))  # noqa: S704


def _mark(one: DaySummary) -> DayMark:
    searched = one.searched
    said = f"{searched.day}: {searched.answer}, {one.bursts} bursts, {one.localised} localised"
    address = day_links(searched.day, searched.origin)["page"]
    return DayMark(searched.day, searched.answer.value, one.localised, said, address)


def _onsets(catalogue: Catalogue, first: date, last: date, origins: tuple[Origin, ...]) -> list[OnsetMark]:
    """Each burst once, by its first onset."""
    start, stop = (datetime.combine(day, time(), UTC) for day in (first, last + timedelta(days=1)))
    found = catalogue.detections(DetectionQuery(start, stop, limit=MOST_ONSETS, origins=frozenset(origins))).detections
    marks: dict[str, OnsetMark] = {}
    for number, one in enumerate(found):
        if one.tier == REJECTED:
            continue
        is_localised = one.tier == LOCALISABLE
        links = day_links(one.start_utc.date(), one.origin)
        address = linked(f"/bursts/{one.burst_id}") if is_localised else place_of(links["page"], one.burst_id)
        verdict = "localised" if is_localised else one.reason.replace("_", " ")
        said = f"{one.burst_id or one.observatory}, {one.start_utc:%H:%M}, {verdict}"
        marks.setdefault(one.burst_id or str(number), OnsetMark(one.start_utc, is_localised, said, address))
    return list(marks.values())


@router.get("/days/calendar.{kind}")
def calendar_file(request: Request, kind: Kind, catalogue: CatalogueHere) -> Response:
    """Calendar of the days of the query of the address as a file with its caption.

    Raises
    ------
    InputError
        If the query cannot be read.
    NoDataError
        If no day of it was searched.
    """
    asked = asked_of(request)
    page, _, fault = _answer(catalogue, asked)
    if page is None:
        raise InputError(fault or "the query cannot be read")
    if not page.days:
        raise NoDataError("no day of this range was searched: ask for another one")
    days = [one.searched.day for one in page.days]
    unreal = next((one.searched.origin for one in page.days if one.searched.origin not in REAL_ORIGINS), None)
    query = f"?{request.url.query}" if request.url.query else ""
    caption = Caption(
        calendar_caption(min(days), max(days)),
        f"BELLA service, {site_url(request)}{linked('/days')}{query}.",
        origin_warning(unreal) if unreal else "",
    )
    made = exported(_figure(catalogue, page, asked), caption, kind)
    return file_reply(made, kind, f"bella_days_{min(days)}_{max(days)}", tag_of((), hashlib.sha256(made).hexdigest()))


@router.get("/days/{day}")
def day_page(request: Request, day: str, service: ServiceHere, catalogue: CatalogueHere) -> HTMLResponse:
    """What was found on a searched day, drawn and in tables."""
    with catalogue.snapshot():
        return _page(request, day, service, catalogue)


def _what_to_do(catalogue: Catalogue, day: date) -> str:
    """How to see a day that is not among those asked for: by its origin where it is known, else by a search."""
    known = catalogue.days(day, day, 1, tuple(Origin)).days
    if not known:
        return f"run bella run --from {day}"
    origin = known[0].searched.origin
    return f"{day_links(day, origin)['page']} shows it in {origin} data"


def _page(request: Request, day: str, service: Service, catalogue: Catalogue) -> HTMLResponse:
    wanted = parse_day(day, "day")
    asked = _origins(request)
    known = catalogue.days(wanted, wanted, 1, asked).days
    summary = min(known, key=lambda one: asked.index(one.searched.origin), default=None)
    if summary is None:
        raise NoDataError(f"{wanted} was not searched: {_what_to_do(catalogue, wanted)}")
    origins = (summary.searched.origin,)
    found = catalogue.detections_of(wanted, origins)
    before, after = catalogue.days_beside(wanted, origins)
    drawn = service.settings.day_figure(wanted, origins[0])
    month = wanted.replace(day=1)
    links = day_links(wanted, origins[0])
    figure, _, tail = links["figure"].partition("?")
    bursts = _shown_bursts(found, _with_page(catalogue, wanted))
    rejected = [one for one in found if one.tier == REJECTED]
    part, parts = _part(request, bursts)
    span = _span(request.query_params.get("t") or "")
    return render(
        request,
        "day.html",
        summary=summary,
        said=answer_words(summary.searched.answer),
        links=links,
        figure=figure.removesuffix(".svg"),
        tail=f"?{tail}" if tail else "",
        month=f"/days?from={month}&to={(month + timedelta(days=32)).replace(day=1) - timedelta(days=1)}",
        origin=origins[0],
        is_real=origins[0] in REAL_ORIGINS,
        beside=[one and day_links(one, origins[0])["page"] for one in (before, after)],
        drawn=_drawn(drawn, bursts, part, links["page"], span) if drawn.is_file() else None,
        span=request.query_params.get("t") if span else "",
        hours=HOURS_SHOWN,
        bursts=bursts[part * BURSTS_PER_PART : (part + 1) * BURSTS_PER_PART],
        total=len(bursts),
        part=part,
        parts_of_day=[bursts[BURSTS_PER_PART * one].received[0].start_utc for one in range(parts)],
        rejected=rejected[:BURSTS_PER_PART],
        rejected_total=len(rejected),
        before=before,
        after=after,
        observed=_observed(catalogue, wanted, origins),
    )


def place_of(page: str, burst_id: str) -> str:
    """Address of a burst on the page of its day, whose address is given, in whatever part of the day it is."""
    joint = "&" if "?" in page else "?"
    return f"{page}{joint}burst={quote(burst_id)}#{burst_id}"


def _part(request: Request, bursts: Sequence[ShownBurst]) -> tuple[int, int]:
    """Which part of the bursts of a day is asked for, or holds a burst, counted from 0, and how many there are.

    Raises
    ------
    InputError
        Where there is no such part.
    """
    parts, asked = -(-len(bursts) // BURSTS_PER_PART), request.query_params.get("part")
    if not asked:
        wanted = request.query_params.get("burst") or None
        place = next((index for index, one in enumerate(bursts) if one.burst_id == wanted), 0)
        return place // BURSTS_PER_PART, parts
    if not (asked.isascii() and asked.isdigit() and 1 <= int(asked[:6]) <= max(parts, 1)):
        raise InputError(f"part: give a number from 1 to {max(parts, 1)}")
    return int(asked) - 1, parts


def _span(text: str) -> tuple[float, float] | None:
    """Seconds after midnight of two times of day; None where they cannot be read: a cut link still shows the day."""
    found = TIMES_OF_DAY.fullmatch(text)
    if not found:
        return None
    first, last = (3600.0 * int(found[one]) + 60.0 * int(found[one + 1]) for one in (1, 3))
    return (first, min(last, DAY_S)) if first + LEAST_SHOWN_S <= min(last, DAY_S) else None


def _drawn(path: Path, bursts: Sequence[ShownBurst], part: int, page: str, span: tuple[float, float] | None) -> Markup:
    """Figure of a day or a part of it, whose boxes lead to the part that tells of their burst."""
    places = {one.burst_id: index // BURSTS_PER_PART for index, one in enumerate(bursts)}

    def _led(found: re.Match[str]) -> str:
        is_here = places.get(found[1], part) == part
        return found[0] if is_here else f'href="{escape(place_of(page, found[1]))}"'

    text = path.read_text(encoding="utf-8")
    text = zoomed_day(text, *span) if span else text
    return Markup(re.sub(r'href="#([^"]+)"', _led, text) if len(bursts) > BURSTS_PER_PART else text)  # noqa: S704


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


def _observed(catalogue: Catalogue, day: date, origins: tuple[Origin, ...]) -> ObservedDay | None:
    """Observability of a day; None where it was searched before there was one."""
    try:
        return catalogue.operation.observed(day, origins)
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
    received: dict[str, list[Detection]] = {}
    for number, one in enumerate(found):
        if one.tier != REJECTED:
            received.setdefault(one.burst_id or f"{number}", []).append(one)
    return [
        ShownBurst(
            some[0].burst_id,
            some[0].reason if some[0].burst_id else NOT_COMPARED,
            some[0].burst_id in with_page,
            tuple(some),
        )
        for some in received.values()
    ]

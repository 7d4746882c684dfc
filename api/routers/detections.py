"""What each spacecraft received on the days that were searched, and events that others published."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from api.freshness import last_modified
from api.queries import BurstId, DayFilter, DayText, OriginChoice
from api.replies import (
    NEAR,
    NO_LISTS,
    BurstEventsReply,
    DayReply,
    DaysReply,
    DaySummaryReply,
    DetectionReply,
    DetectionsReply,
    EventsReply,
    LinkedEventReply,
    ListedEventReply,
    lists_of,
)
from api.service import CatalogueHere
from api.tables import (
    JSON,
    DetectionTableFilter,
    EventTableFilter,
    asked_format,
    detection_table,
    in_all_formats,
    next_address,
    table_of_rows,
    table_reply,
)
from bella.formats import EVENTS
from bella.pipeline.rows import event_rows
from bella.times import parse_day

router = APIRouter(prefix="/api/v1", tags=["detections"])


@router.get(
    "/detections",
    response_model=DetectionsReply,
    responses=in_all_formats("One page of detections.", DetectionsReply),
)
def detections(
    request: Request, response: Response, catalogue: CatalogueHere, wanted: Annotated[DetectionTableFilter, Query()]
) -> DetectionsReply | Response:
    """Detections, the newest onset first; a tier other than "localisable" comes with its reason."""
    chosen, changed = asked_format(request, wanted.format), catalogue.changed_utc("days")
    page = catalogue.detections(wanted.query())
    following = next_address(request, page.next_cursor)
    if chosen is not JSON:
        return table_reply(chosen, detection_table(page.detections), "detections", following, changed)
    response.headers.update({"Vary": "Accept"} | last_modified(changed))
    return DetectionsReply(
        detections=[DetectionReply.of(one) for one in page.detections],
        total=page.total,
        returned=len(page.detections),
        truncated=following is not None,
        next=following,
    )


@router.get("/days")
def days(request: Request, catalogue: CatalogueHere, wanted: Annotated[DayFilter, Query()]) -> DaysReply:
    """Searched days, the newest first, with how much was received on each; both ends of the range belong to it."""
    page = catalogue.days(*wanted.span(), wanted.limit, wanted.origins, wanted.cursor)
    return DaysReply(
        days=[DaySummaryReply.of(one) for one in page.days],
        total=page.total,
        returned=len(page.days),
        truncated=page.next_last is not None,
        next=next_address(request, page.next_cursor),
    )


@router.get("/days/{day}")
def day(day: DayText, catalogue: CatalogueHere, choice: Annotated[OriginChoice, Query()]) -> DayReply:
    """Whether a day was searched, which spacecraft had data, and the answer: no data, no burst, not localised, ..."""
    wanted = parse_day(day, "day")
    return DayReply.of(wanted, catalogue.searched_day(wanted, choice.origins))


event_router = APIRouter(prefix="/api/v1", tags=["events"])


@event_router.get("/events", response_model=EventsReply)
def events(
    request: Request, response: Response, catalogue: CatalogueHere, wanted: Annotated[EventTableFilter, Query()]
) -> EventsReply | Response:
    """Published events with the bursts that they are near to; as a table also with where these bursts were.

    `kind=radio&format=tfcat` (or `csv`) gives the ids of radio catalogues back with positions.
    """
    chosen, page = asked_format(request, wanted.format), catalogue.events.events(wanted.query())
    following = next_address(request, page.next_cursor)
    if chosen is not JSON:
        rows = (row for one in page.events for row in event_rows(catalogue, one))
        return table_reply(chosen, table_of_rows(EVENTS, rows, near=NEAR), "events", following)
    response.headers["Vary"] = "Accept"
    return EventsReply(
        events=[ListedEventReply.listed(one) for one in page.events],
        total=page.total,
        returned=len(page.events),
        truncated=following is not None,
        next=following,
        lists=lists_of(catalogue),
    )


@event_router.get("/bursts/{burst_id}/events")
def burst_events(burst_id: BurstId, catalogue: CatalogueHere) -> BurstEventsReply:
    """Published events near a burst in time."""
    catalogue.burst(burst_id)
    lists = lists_of(catalogue)
    return BurstEventsReply(
        burst_id=burst_id,
        events=[LinkedEventReply.near(one) for one in catalogue.events.of_burst(burst_id)],
        lists=lists,
        remark=NEAR if lists else NO_LISTS,
    )

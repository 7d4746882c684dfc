"""Events that others published, such as flares and shocks, and the bursts that they are near to."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from api.queries import BurstId
from api.replies import (
    NEAR,
    NO_LISTS,
    BurstEventsReply,
    EventsReply,
    LinkedEventReply,
    ListedEventReply,
    lists_of,
)
from api.service import CatalogueHere
from api.tables import (
    JSON,
    EventTableFilter,
    asked_format,
    in_all_formats,
    next_address,
    table_of_rows,
    table_reply,
)
from bella.formats import EVENTS
from bella.pipeline.rows import event_rows

router = APIRouter(prefix="/api/v1", tags=["events"])


@router.get("/events", response_model=EventsReply, responses=in_all_formats("One page of events.", EventsReply))
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


@router.get("/bursts/{burst_id}/events")
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

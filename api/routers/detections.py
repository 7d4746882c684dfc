"""What each spacecraft received on the days that were searched, and events that others published."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from api.freshness import last_modified
from api.queries import DayFilter, DayText, OriginChoice
from api.replies import (
    DayReply,
    DaysReply,
    DaySummaryReply,
    DetectionReply,
    DetectionsReply,
)
from api.service import CatalogueHere
from api.tables import (
    JSON,
    DetectionTableFilter,
    asked_format,
    detection_table,
    in_all_formats,
    next_address,
    table_reply,
)
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

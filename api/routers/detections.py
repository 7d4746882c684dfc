"""Detections: what each spacecraft heard on the days that were searched, placed or not, and why not."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from api.day_replies import DayReply, DaysReply, DaySummaryReply, DetectionReply, DetectionsReply
from api.freshness import REVALIDATE, file_tag, is_known, last_modified, not_modified
from api.queries import DayFilter, DayText, OriginChoice
from api.routers.figures import svg_reply
from api.service import CatalogueHere, ServiceHere
from api.tables import (
    JSON,
    DetectionTableFilter,
    asked_format,
    detection_table,
    in_all_formats,
    next_address,
    table_reply,
)
from bella.exceptions import NoDataError
from bella.plotting import as_file
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
    """Searched days, the newest first, with how much was heard on each; both ends of the range belong to it."""
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
    """Whether a day was searched, and which spacecraft had data: no data, no burst and not placed are told apart."""
    wanted = parse_day(day, "day")
    return DayReply.of(wanted, catalogue.searched_day(wanted, choice.origins))


@router.get("/days/{day}/figure", responses={200: {"content": {"image/svg+xml": {}}}}, response_class=Response)
def day_figure(
    request: Request, day: DayText, service: ServiceHere, choice: Annotated[OriginChoice, Query()]
) -> Response:
    """Spectra of all spacecraft on a searched day with what was found outlined, SVG; redrawn with the day."""
    wanted = parse_day(day, "day")
    paths = [service.settings.day_figure(wanted, origin) for origin in choice.origins]
    path = next((one for one in paths if one.is_file()), paths[0])
    if not path.is_file():
        raise NoDataError(f"{wanted} is not drawn: run bella run --from {wanted}")
    tag = file_tag(path)
    if is_known(request, tag):
        return not_modified(tag)
    caption = f"Spectra of {wanted} in dB over the background; grey is no data. Boxes: what was found. BELLA service."
    return svg_reply(as_file(path.read_text(encoding="utf-8"), caption), {"ETag": tag, "Cache-Control": REVALIDATE})

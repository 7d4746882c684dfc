"""Detections: what each spacecraft heard on the days that were searched, placed or not, and why not."""

from typing import Annotated

from fastapi import APIRouter, Query

from api.queries import DetectionFilter, parse_day
from api.schemas import DayReply, DetectionReply, DetectionsReply
from api.service import CatalogueHere

router = APIRouter(prefix="/api/v1", tags=["detections"])


@router.get("/detections")
def detections(catalogue: CatalogueHere, wanted: Annotated[DetectionFilter, Query()]) -> DetectionsReply:
    """Detections of a time range by onset; a tier other than "localisable" comes with its reason."""
    start, stop = wanted.interval()
    found = catalogue.detections(start, stop, wanted.observatory, wanted.limit + 1)
    shown = found[: wanted.limit]
    return DetectionsReply(
        detections=[DetectionReply.of(one) for one in shown],
        returned=len(shown),
        truncated=len(found) > wanted.limit,
    )


@router.get("/days/{day}")
def day(day: str, catalogue: CatalogueHere) -> DayReply:
    """Whether a day was searched, and which spacecraft had data: no data, no burst and not placed are told apart."""
    wanted = parse_day(day)
    return DayReply.of(wanted, catalogue.searched_day(wanted))

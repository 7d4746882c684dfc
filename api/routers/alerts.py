"""Alerts: a list, a stream of server-sent events, and an Atom feed."""

import asyncio
import time
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from api.freshness import is_known, not_modified, tag_of
from api.queries import AlertFilter, AlertStreamFilter
from api.replies import Reply
from api.schemas import Json
from api.service import CatalogueHere, Service, ServiceHere
from bella.exceptions import BusyError
from bella.formats.alerts import alert_document, alert_schema, atom_feed, server_sent_event
from bella.records import Origin

router = APIRouter(tags=["alerts"])

LOOK_S = 1.0
"""Seconds between two looks for new alerts; one look serves all streams."""
AT_ONCE = 100
FEED_LENGTH = 50
NO_NEWS = "1970-01-01T00:00:00Z"


class AlertsReply(Reply):
    """Alerts in the order of their commits; each is a document of `/api/v1/alerts/schema`."""

    alerts: list[dict[str, Json]]
    returned: int
    last: int = Field(description="Sequence number to go on after.")
    truncated: bool = Field(description="True when there are more: go on at `next`.")
    next: str | None


@router.get("/api/v1/alerts")
def alerts(request: Request, catalogue: CatalogueHere, wanted: Annotated[AlertFilter, Query()]) -> AlertsReply:
    """Alerts after a sequence number; those of submissions, simulated and test data only where asked for."""
    found = catalogue.alerts(wanted.after, wanted.limit, wanted.announced, wanted.burst)
    more = len(found) == wanted.limit and bool(catalogue.alerts(found[-1].sequence, 1, wanted.announced, wanted.burst))
    return AlertsReply(
        alerts=[alert_document(one, _base(request)) for one in found],
        returned=len(found),
        last=found[-1].sequence if found else wanted.after,
        truncated=more,
        next=str(request.url.include_query_params(after=found[-1].sequence)) if more else None,
    )


@router.get("/api/v1/alerts/schema")
def alerts_schema() -> dict[str, Json]:
    """JSON Schema of an alert."""
    return alert_schema()


@router.get(
    "/api/v1/alerts/stream",
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {}}, "description": "Server-sent events without an end."}},
)
async def alerts_stream(
    request: Request,
    service: ServiceHere,
    wanted: Annotated[AlertStreamFilter, Query()],
    last_event_id: Annotated[str, Header(description="Sequence number of the last alert that arrived.")] = "",
) -> StreamingResponse:
    """Alerts as they are published, as server-sent events with a heartbeat in between.

    It begins after the alert of `Last-Event-ID` (or `after`), and without either with what comes from now on.
    """
    begin = int(last_event_id) if last_event_id.isascii() and last_event_id.isdigit() else wanted.after
    if begin is None:
        begin = await run_in_threadpool(lambda: service.catalogue().last_alert())
    if service.streams >= service.settings.max_streams:
        raise BusyError(f"{service.streams} streams of alerts are open already: try again, or ask /api/v1/alerts")
    return StreamingResponse(
        _events(request, service, begin, wanted.announced),
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


async def _events(request: Request, service: Service, after: int, origins: tuple[Origin, ...]) -> AsyncIterator[str]:
    base, told = _base(request), time.monotonic()
    service.streams += 1
    try:
        yield f"retry: 5000\n\n{_heartbeat()}"
        while not await request.is_disconnected():
            newest = await run_in_threadpool(service.newest_alert, LOOK_S)
            while after < newest:
                found = await run_in_threadpool(service.catalogue().alerts, after, AT_ONCE, origins)
                for alert in found:
                    yield server_sent_event(alert, base)
                after = found[-1].sequence if len(found) == AT_ONCE else newest
                told = time.monotonic()
            if time.monotonic() - told >= service.settings.heartbeat_s:
                yield _heartbeat()
                told = time.monotonic()
            await asyncio.sleep(min(LOOK_S, service.settings.heartbeat_s))
    finally:
        service.streams -= 1


def _heartbeat() -> str:
    return f'event: heartbeat\ndata: {{"time":"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"}}\n\n'


@router.get("/feed.atom", response_class=Response, responses={200: {"content": {"application/atom+xml": {}}}})
def alerts_feed(request: Request, catalogue: CatalogueHere) -> Response:
    """The newest alerts about real bursts as an Atom feed."""
    found = catalogue.newest_alerts(FEED_LENGTH)
    tag = tag_of((), "feed", _base(request), found[0].sequence if found else 0)
    if is_known(request, tag):
        return not_modified(tag)
    text = atom_feed(found, _base(request), NO_NEWS)
    return Response(text, media_type="application/atom+xml; charset=utf-8", headers={"ETag": tag})


def _base(request: Request) -> str:
    return str(request.base_url).rstrip("/")

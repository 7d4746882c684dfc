"""Replies about events that others published, and which of them are near to a burst."""

from dataclasses import asdict
from datetime import datetime
from typing import Literal

from pydantic import Field

from api.replies import PageReply, Reply
from bella.catalogue import Catalogue, KnownEvent, ListRead
from bella.linked_events import Event, EventKind, Link

NEAR = "Events near a burst in time, both at the Sun: a link is no proof that one caused the other."
NO_LISTS = "No list of events is known here: a burst without events is one that was not compared with any."


class EventReply(Reply):
    """An event as others published it; times are those at the observer."""

    event_id: str = Field(description="Source and the id that the event has there.")
    kind: EventKind = Field(description="flare, cme (first seen), particles (onset) or radio (detected by others).")
    source: str = Field(description="Who published it.")
    published_id: str = Field(description="Its id there.")
    observer: str = Field(description="Where it was seen from: EARTH, or a spacecraft.")
    start_utc: datetime
    at_sun_utc: datetime = Field(description="Start less the light travel from the Sun to the observer.")
    peak_utc: datetime | None
    end_utc: datetime | None
    size: str = Field(description="Class of a flare, speed of a CME; empty where it was not published.")
    latitude_deg: float | None = Field(description="Stonyhurst, north positive.")
    longitude_deg: float | None = Field(description="Stonyhurst, west positive.")
    region: int | None = Field(description="NOAA number of the active region.")
    f_low_mhz: float | None
    f_high_mhz: float | None
    link: str = Field(description="Page about it; empty where there is none.")

    @classmethod
    def of(cls, event: Event) -> "EventReply":
        """Reply for an event."""
        return cls(**asdict(event))


class LinkedEventReply(EventReply):
    """An event near a burst."""

    delay_s: float = Field(description="Start of the event less that of the burst, both at the Sun, s.")

    @classmethod
    def near(cls, link: Link) -> "LinkedEventReply":
        """Reply for an event that is near a burst."""
        return cls(**asdict(link.event), delay_s=link.delay_s)


class ListedEventReply(EventReply):
    """An event with the list that it is from, and its delay to each burst that it is near to, s."""

    list_name: str
    bursts: dict[str, float]

    @classmethod
    def listed(cls, known: KnownEvent) -> "ListedEventReply":
        """Reply for an event of a list."""
        return cls(**asdict(known.event), list_name=known.list_name, bursts=dict(known.bursts))


class EventListReply(Reply):
    """A list of events: how far it reaches, and how fresh it is."""

    name: str
    state: Literal["read", "refused", "gone"] = Field(
        description="read; refused (not usable: what it had before is kept); gone (its file is, its events are kept)."
    )
    events: int = Field(description="Events that are held of it.")
    left_out: int = Field(description="Rows that were not usable.")
    message: str
    first_utc: datetime | None = Field(description="Start of its first event.")
    newest_utc: datetime | None = Field(description="Start of its last event: nothing is known of later times.")
    changed_utc: datetime = Field(description="When its file was changed.")
    read_utc: datetime = Field(description="When it was looked at.")

    @classmethod
    def of(cls, one: ListRead) -> "EventListReply":
        """Reply for a list."""
        return cls.model_validate(one, from_attributes=True)


class EventsReply(PageReply):
    """One page of events by their start, and the lists that they are from."""

    events: list[ListedEventReply]
    lists: list[EventListReply]
    remark: str = NEAR


class BurstEventsReply(Reply):
    """Events near a burst, the nearest first, and the lists that it was compared with."""

    burst_id: str
    events: list[LinkedEventReply]
    lists: list[EventListReply]
    remark: str


def lists_of(catalogue: Catalogue) -> list[EventListReply]:
    """Lists of events, by name."""
    return [EventListReply.of(one) for one in catalogue.events.lists()]

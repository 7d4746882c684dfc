"""Which published events belong to a burst: all times are compared at the Sun.

The windows are choices, not measurements: a link says that two times are near, not that one thing caused the other.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime, timedelta

from bella.linked_events.events import Event, EventKind

BEFORE: dict[EventKind, timedelta] = {
    "flare": timedelta(minutes=5),  # begins are minutes, and X-rays may begin after the first electrons
    "cme": timedelta(minutes=10),
    "particles": timedelta(0),
    "radio": timedelta(minutes=5),
}
"""Longest time that an event may begin before a burst; of a flare, that a burst may begin before it."""

AFTER: dict[EventKind, timedelta] = {
    "flare": timedelta(minutes=10),
    "cme": timedelta(minutes=90),
    "particles": timedelta(hours=3),
    "radio": timedelta(minutes=5),
}
"""Longest time that an event may begin after a burst; of a flare, that a burst may begin after its peak."""

UNTIMED_FLARE = timedelta(minutes=15)
"""Rise of a flare whose peak was not published."""

REACH = timedelta(days=1)
"""No event that begins farther from a burst than this belongs to it, whatever its kind."""


@dataclass(frozen=True)
class Link:
    """An event that belongs to a burst; `delay_s` is its start less that of the burst, both at the Sun, s."""

    event: Event
    delay_s: float


def links_of(released_utc: datetime, events: Iterable[Event], others_utc: Iterable[datetime] = ()) -> tuple[Link, ...]:
    """Events that belong to a burst.

    A burst belongs to a flare from 5 minutes before its begin to 10 minutes after its peak; to a CME that is first
    seen 10 minutes before it to 90 minutes after it (1000 km/s takes 23 minutes for 2 solar radii, 300 km/s 77); to
    particles whose onset is up to 3 hours after it (protons of 10 MeV take 70 minutes along 1.2 au, 61 more than
    light takes straight); to a radio burst that begins within 5 minutes, if no other burst is nearer to that.

    Parameters
    ----------
    released_utc : datetime.datetime
        Start of the burst at the Sun.
    others_utc : iterable of datetime.datetime
        Begins of other bursts at the Sun.

    Returns
    -------
    tuple of Link
        The nearest first.
    """
    others = list(others_utc)
    found = [
        Link(one, (one.at_sun_utc - released_utc).total_seconds()) for one in events if _is_near(released_utc, one)
    ]
    kept = [link for link in found if link.event.kind != "radio" or _is_nearest(link, others)]
    return tuple(sorted(kept, key=lambda link: (abs(link.delay_s), link.event.event_id)))


def _is_near(released_utc: datetime, event: Event) -> bool:
    delay = event.at_sun_utc - released_utc
    if event.kind != "flare":
        return -BEFORE[event.kind] <= delay <= AFTER[event.kind]
    rise = event.peak_utc - event.start_utc if event.peak_utc else UNTIMED_FLARE
    return -(rise + AFTER["flare"]) <= delay <= BEFORE["flare"]


def _is_nearest(link: Link, others: list[datetime]) -> bool:
    return all(abs((link.event.at_sun_utc - one).total_seconds()) >= abs(link.delay_s) for one in others)

"""Events that others published (flares, CMEs, particle events, radio bursts), and which of them belong to a burst."""

from bella.linked_events.events import KINDS, Event, EventKind
from bella.linked_events.lists import EventList, read_event_list
from bella.linked_events.matching import REACH, Link, links_of

__all__ = ["KINDS", "REACH", "Event", "EventKind", "EventList", "Link", "links_of", "read_event_list"]

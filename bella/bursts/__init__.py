"""Bursts: edges of light curves, arrival times with their noise, and the built-in event."""

from bella.bursts.association import burst_id, onset
from bella.bursts.event import (
    EVENT,
    TimeEvolution,
    event_arrivals,
    fit_time_evolution,
    half_maximum_arrivals,
    half_maximum_edges,
    published_arrivals,
    published_rise_times,
    timed_event,
)
from bella.bursts.timing import spectrum_edges

__all__ = [
    "EVENT",
    "TimeEvolution",
    "burst_id",
    "event_arrivals",
    "fit_time_evolution",
    "half_maximum_arrivals",
    "half_maximum_edges",
    "onset",
    "published_arrivals",
    "published_rise_times",
    "spectrum_edges",
    "timed_event",
]

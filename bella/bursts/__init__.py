"""Bursts: edges of light curves, arrival times, their evolution with frequency, and the built-in event."""

from bella.bursts.edges import spectrum_edges
from bella.bursts.event import (
    EVENT,
    half_maximum_arrivals,
    half_maximum_edges,
    half_rise_arrivals,
    half_rise_edges,
    published_arrivals,
    published_rise_times,
)
from bella.bursts.half_maximum import half_maximum_edge
from bella.bursts.identity import burst_id, onset
from bella.bursts.time_evolution import (
    TimeEvolution,
    best_time_evolution,
    common_offset_s,
    fit_time_evolution,
    robust_time_evolution,
)

__all__ = [
    "EVENT",
    "TimeEvolution",
    "best_time_evolution",
    "burst_id",
    "common_offset_s",
    "fit_time_evolution",
    "half_maximum_arrivals",
    "half_maximum_edge",
    "half_maximum_edges",
    "half_rise_arrivals",
    "half_rise_edges",
    "onset",
    "published_arrivals",
    "published_rise_times",
    "robust_time_evolution",
    "spectrum_edges",
]

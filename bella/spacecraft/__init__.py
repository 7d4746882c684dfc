"""Where the receivers were: a compact ephemeris table, its interpolation and extension, frames, light time."""

from bella.spacecraft.agreement import Placed, largest_difference_km, prefer_given, require_agreement
from bella.spacecraft.ephemeris import (
    BODIES,
    FRAME,
    OBSERVATORIES,
    coverage,
    extend_with,
    fleet,
    light_time_s,
    position,
    position_hee,
)
from bella.spacecraft.frames import FRAMES, cartesian, polar
from bella.spacecraft.turning import hee_from, hee_to

__all__ = [
    "BODIES",
    "FRAME",
    "FRAMES",
    "OBSERVATORIES",
    "Placed",
    "cartesian",
    "coverage",
    "extend_with",
    "fleet",
    "hee_from",
    "hee_to",
    "largest_difference_km",
    "light_time_s",
    "polar",
    "position",
    "position_hee",
    "prefer_given",
    "require_agreement",
]

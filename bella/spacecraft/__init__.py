"""Where the receivers were: a compact ephemeris table, its interpolation and extension, frames, light time."""

from bella.spacecraft.ephemeris import (
    BODIES,
    FRAME,
    OBSERVATORIES,
    coverage,
    extend_with,
    fleet,
    light_time_s,
    missing_from_fleet,
    position,
    position_hee,
)
from bella.spacecraft.frames import FRAMES, cartesian, polar
from bella.spacecraft.names import ALIASES, observatory_name
from bella.spacecraft.turning import hee_from, hee_to

__all__ = [
    "ALIASES",
    "BODIES",
    "FRAME",
    "FRAMES",
    "OBSERVATORIES",
    "cartesian",
    "coverage",
    "extend_with",
    "fleet",
    "hee_from",
    "hee_to",
    "light_time_s",
    "missing_from_fleet",
    "observatory_name",
    "polar",
    "position",
    "position_hee",
]

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
from bella.spacecraft.frames import FRAMES

__all__ = [
    "BODIES",
    "FRAME",
    "FRAMES",
    "OBSERVATORIES",
    "Placed",
    "coverage",
    "extend_with",
    "fleet",
    "largest_difference_km",
    "light_time_s",
    "position",
    "position_hee",
    "prefer_given",
    "require_agreement",
]

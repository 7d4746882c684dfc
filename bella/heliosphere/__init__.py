"""Physics of the heliosphere without data: the geometry of the Parker spiral and the rotation of the Sun."""

from bella.heliosphere.parker import (
    PAPER_FIGURES_ROTATION_D,
    SIDEREAL_ROTATION_D,
    SYNODIC_ROTATION_D,
    angular_speed_rad_s,
    spiral_longitude_deg,
)

__all__ = [
    "PAPER_FIGURES_ROTATION_D",
    "SIDEREAL_ROTATION_D",
    "SYNODIC_ROTATION_D",
    "angular_speed_rad_s",
    "spiral_longitude_deg",
]

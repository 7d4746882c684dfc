"""Physics of the heliosphere without data: Parker spiral, rotation of the Sun, travel of a beam, electron density."""

from bella.heliosphere.beam import beam_travel_s, slowing_travel_s, spiral_path_rsun, spiral_position_rsun
from bella.heliosphere.density import (
    DENSITY_MODELS,
    DensityModel,
    emission_frequency_mhz,
    emission_range_rsun,
    plasma_frequency_mhz,
    projected_range_rsun,
)
from bella.heliosphere.parker import (
    PAPER_FIGURES_ROTATION_D,
    SIDEREAL_ROTATION_D,
    SYNODIC_ROTATION_D,
    angular_speed_rad_s,
    spiral_longitude_deg,
)

__all__ = [
    "DENSITY_MODELS",
    "PAPER_FIGURES_ROTATION_D",
    "SIDEREAL_ROTATION_D",
    "SYNODIC_ROTATION_D",
    "DensityModel",
    "angular_speed_rad_s",
    "beam_travel_s",
    "emission_frequency_mhz",
    "emission_range_rsun",
    "plasma_frequency_mhz",
    "projected_range_rsun",
    "slowing_travel_s",
    "spiral_longitude_deg",
    "spiral_path_rsun",
    "spiral_position_rsun",
]

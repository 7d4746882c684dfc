"""Dynamic spectra: their form, their background, and those of the built-in event."""

from bella.spectra.background import Background, decibels, over_background, quiet_level
from bella.spectra.digitised import event_spectra
from bella.spectra.dynamic_spectrum import QUANTITIES, light_curve, relative_power, sample_times, validate_spectrum

__all__ = [
    "QUANTITIES",
    "Background",
    "decibels",
    "event_spectra",
    "light_curve",
    "over_background",
    "quiet_level",
    "relative_power",
    "sample_times",
    "validate_spectrum",
]

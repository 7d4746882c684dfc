"""Dynamic spectra: their form, and those of the built-in event."""

from bella.spectra.digitised import event_spectra
from bella.spectra.dynamic_spectrum import QUANTITIES, light_curve, relative_power, sample_times, validate_spectrum

__all__ = ["QUANTITIES", "event_spectra", "light_curve", "relative_power", "sample_times", "validate_spectrum"]

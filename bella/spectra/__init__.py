"""Dynamic spectra: their form, reading them from archive files, their background, and those of the built-in event."""

from bella.spectra.background import Background, decibels, over_background, quiet_level
from bella.spectra.by_observatory import by_observatory
from bella.spectra.combination import combine_receivers, join_days
from bella.spectra.digitised import event_spectra
from bella.spectra.dynamic_spectrum import (
    QUANTITIES,
    integration_times_s,
    light_curve,
    power_above_background,
    relative_power,
    sample_times,
    validate_spectrum,
)
from bella.spectra.given_positions import given_position_hee
from bella.spectra.products import PRODUCTS, Product, find_product
from bella.spectra.reading import open_spectra

__all__ = [
    "PRODUCTS",
    "QUANTITIES",
    "Background",
    "Product",
    "by_observatory",
    "combine_receivers",
    "decibels",
    "event_spectra",
    "find_product",
    "given_position_hee",
    "integration_times_s",
    "join_days",
    "light_curve",
    "open_spectra",
    "over_background",
    "power_above_background",
    "quiet_level",
    "relative_power",
    "sample_times",
    "validate_spectrum",
]

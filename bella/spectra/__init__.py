"""Dynamic spectra: their form, reading them from files, their background, quirks of instruments, the built-in event."""

from bella.spectra.background import Background, decibels, over_background, quiet_level
from bella.spectra.cf_files import as_spectrum, event_spectra
from bella.spectra.combination import (
    FleetPiece,
    by_observatory,
    by_observatory_of_what_fits,
    combine_receivers,
    fleet_pieces,
    join_days,
)
from bella.spectra.dynamic_spectrum import (
    QUANTITIES,
    integration_times_s,
    light_curve,
    power_above_background,
    relative_power,
    sample_times,
    validate_spectrum,
)
from bella.spectra.positions import ReceiverPosition, fill_in_positions, receiver_position
from bella.spectra.products import PRODUCTS, Product, Quirk, find_product, open_spectra, quirks
from bella.spectra.user import UserDay, UserFolder, from_radiospectra, to_radiospectra, user_days

__all__ = [
    "PRODUCTS",
    "QUANTITIES",
    "Background",
    "FleetPiece",
    "Product",
    "Quirk",
    "ReceiverPosition",
    "UserDay",
    "UserFolder",
    "as_spectrum",
    "by_observatory",
    "by_observatory_of_what_fits",
    "combine_receivers",
    "decibels",
    "event_spectra",
    "fill_in_positions",
    "find_product",
    "fleet_pieces",
    "from_radiospectra",
    "integration_times_s",
    "join_days",
    "light_curve",
    "open_spectra",
    "over_background",
    "power_above_background",
    "quiet_level",
    "quirks",
    "receiver_position",
    "relative_power",
    "sample_times",
    "to_radiospectra",
    "user_days",
    "validate_spectrum",
]

"""Observability of a day: which receivers had data, and how well a source would have been located in each direction."""

from datetime import date, datetime

from pydantic import Field

from bella.exceptions import NoDataError
from bella.records import Record

MINUTES_PER_BIN = 60
BINS = 24 * 60 // MINUTES_PER_BIN
HAS_DATA = 0.5
"""Part of a bin with data from which on a receiver counts as there."""


class ReceiverDay(Record):
    """Part of each hour of a day in which a receiver had data."""

    observatory: str
    fraction: tuple[float, ...] = Field(description="Of each hour, from 0 to 1.", min_length=BINS, max_length=BINS)


class FleetMap(Record):
    """Size of the 68 % region of a source in the ecliptic plane, for receivers that have data together."""

    observatories: tuple[str, ...]
    sigma_s: dict[str, float] = Field(description="Timing error that is taken for each receiver, s.")
    radius68_rsun: tuple[tuple[float | None, ...], ...] = Field(
        description="Radius of the circle that has the area of the 68 % region, solar radii; a row for each distance, "
        "in it each longitude; null where it is not known."
    )


class ObservedDay(Record):
    """Observability of a day."""

    day: date
    distances_rsun: tuple[float, ...]
    longitudes_deg: tuple[float, ...] = Field(description="HEE, west positive.")
    receivers: tuple[ReceiverDay, ...]
    maps: tuple[FleetMap, ...]

    def at(self, utc: datetime) -> "tuple[tuple[str, ...], FleetMap | None]":
        """Receivers with data in the hour of a time, and how well they locate; None where there are fewer than three.

        Raises
        ------
        NoDataError
            If the time is not on this day.
        """
        if utc.date() != self.day:
            raise NoDataError(f"{utc:%Y-%m-%dT%H:%M} is not on {self.day}")
        here = fleet_of(self.receivers, (utc.hour * 60 + utc.minute) // MINUTES_PER_BIN)
        return here, next((one for one in self.maps if one.observatories == here), None)


def fleet_of(receivers: tuple[ReceiverDay, ...], hour: int) -> tuple[str, ...]:
    """Receivers with data in an hour of a day, by name."""
    return tuple(sorted(one.observatory for one in receivers if one.fraction[hour] >= HAS_DATA))

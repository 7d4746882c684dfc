"""One published event, whatever list it comes from, and its time at the Sun."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from typing import Literal, get_args

import numpy as np

from bella.exceptions import InputError, NoDataError
from bella.spacecraft import light_time_s, position

EventKind = Literal["flare", "cme", "particles", "radio"]
KINDS: tuple[EventKind, ...] = get_args(EventKind)

AU_LIGHT_S = 499.005
"""Light travel over 1 au (IAU 2012), for an observer whose ephemeris does not cover the time."""


@dataclass(frozen=True)
class Event:
    """An event as it was published.

    Attributes
    ----------
    event_id : str
        Stable: the source and the id that it has there.
    kind : str
        ``flare``, ``cme`` (first seen in a coronagraph), ``particles`` (onset of energetic particles), ``radio`` (a
        radio burst that somebody else detected).
    source, published_id : str
        Who published it, and its id there.
    observer : str
        Where it was seen from: EARTH, or a spacecraft. Times are those at the observer.
    at_sun_utc : datetime
        Start less the light travel from the Sun to the observer.
    size : str
        Class of a flare, speed of a CME, particles and energies, in the words of the list.
    latitude_deg, longitude_deg : float or None
        Stonyhurst, west and north positive.
    region : int or None
        Active region, NOAA number.
    f_low_mhz, f_high_mhz : float or None
        Of a radio burst.
    link : str
        Page about it; empty where none was published.
    """

    event_id: str
    kind: EventKind
    source: str
    published_id: str
    observer: str
    start_utc: datetime
    at_sun_utc: datetime
    peak_utc: datetime | None = None
    end_utc: datetime | None = None
    size: str = ""
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    region: int | None = None
    f_low_mhz: float | None = None
    f_high_mhz: float | None = None
    link: str = ""


def at_sun(utc: datetime, observer: str) -> datetime:
    """When light that an observer received left the Sun."""
    day = datetime(utc.year, utc.month, utc.day, 12, tzinfo=UTC)
    return utc - timedelta(seconds=_sun_light_s(observer, day))


@lru_cache(maxsize=10_000)
def _sun_light_s(observer: str, day: datetime) -> float:
    """Light travel from the Sun on a day: it changes by 1 s a day at most where spacecraft are not near the Sun."""
    moment = np.datetime64(day.replace(tzinfo=None), "ns")
    try:
        position(observer, moment)
        return float(light_time_s(observer, moment, np.zeros(3))[0])
    except (InputError, NoDataError):
        return AU_LIGHT_S

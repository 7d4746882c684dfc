"""Reading lists of events as they are published: SWPC's edited events, GOES flares, DONKI, and TFCat.

- SWPC edited events: the daily text files (``20120607events.txt``) and ``edited_events.json``
- GOES X-ray flares: ``xray-flares-7-day.json`` of SWPC
- DONKI: JSON of its web service, of flares (FLR), CMEs and solar energetic particles (SEP)
- TFCat 1.0: radio bursts in time and frequency, such as the Type III catalogue of Solar Orbiter/RPW

A list is recognised by its content. Rows that say nothing usable are left out and counted; a file that is no such list,
or most of whose rows are unusable, is refused in one line.
"""

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

from bella.exceptions import InputError
from bella.linked_events.events import Event, EventKind, at_sun

LARGEST_LIST_BYTES = 256 << 20
EARLIEST = datetime(1990, 1, 1, tzinfo=UTC)
"""No radio burst of this service is older; an earlier event is a mistake in its year."""

AHEAD = timedelta(days=1)
"""An event that begins later than this after now is a mistake in its date or its zone."""

LONGEST = timedelta(days=3)
KNOWN = "SWPC edited events, GOES flares, DONKI (FLR, CME, SEP) and TFCat"

_PLACE = re.compile(r"([NS])(\d{1,2})([EW])(\d{1,3})", re.IGNORECASE)
_CLASS = re.compile(r"[ABCMX]\d{1,2}(\.\d{1,2})?", re.IGNORECASE)
_ROW = re.compile(r"(\d{1,5})\s+(\+?)\s+(\S{4,5})\s+(\S{4,5})\s+(\S{4,5})\s+(\S{3})\s+(\S)\s+(\S{3})\s+(.*)")
_TO_MHZ = {"hz": 1e-6, "khz": 1e-3, "mhz": 1.0, "ghz": 1e3}

Json = Mapping[str, Any]


class _UnusableError(ValueError):
    """A row says nothing usable."""


@dataclass(frozen=True)
class EventList:
    """What a file holds.

    Attributes
    ----------
    events : tuple of Event
        By start; each id once.
    left_out : int
        Rows that were not usable.
    reason : str
        Why the first of them was not; empty where all were.
    """

    events: tuple[Event, ...]
    left_out: int = 0
    reason: str = ""


def read_event_list(path: Path, now: datetime | None = None) -> EventList:
    """Events of a published list.

    Parameters
    ----------
    now : datetime.datetime, optional
        Time of reading; later events are left out.

    Raises
    ------
    InputError
        If the file cannot be read, is none of the known lists, or most of its rows are unusable.
    """
    text = _text_of(path)
    latest = (now or datetime.now(UTC)) + AHEAD
    found: dict[str, Event] = {}
    rows, left_out, reason = 0, 0, ""
    try:
        for rows, read in enumerate(_rows(text, path.name), start=1):
            try:
                event = read()
                if event is not None:
                    found[event.event_id] = _checked(event, latest)
            except (_UnusableError, KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
                left_out += 1
                reason = reason or f"row {rows}: {_said(error)}"
    except RecursionError as error:
        raise InputError(f"{path.name} is nested too deeply to be a list of events: fetch it again") from error
    if left_out and left_out * 2 > rows:
        raise InputError(f"{path.name}: {left_out} of {rows} rows are not usable ({reason}); fetch it again")
    return EventList(tuple(sorted(found.values(), key=lambda one: (one.start_utc, one.event_id))), left_out, reason)


def _said(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f"it has no {error.args[0]}"
    return str(error).partition("\n")[0][:120]


def _text_of(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > LARGEST_LIST_BYTES:
            raise InputError(f"{path.name} has {size >> 20} MB, which no list of events has: remove it")
        text = path.read_bytes().decode("utf-8-sig", "replace")
    except OSError as error:
        raise InputError(f"{path.name} cannot be read ({error.strerror}): correct its permissions") from error
    if not text.strip():
        raise InputError(f"{path.name} is empty: fetch it again")
    return text


Reader = Callable[[], Event | None]


def _rows(text: str, name: str) -> Iterator[Reader]:
    """How to read each row of a list."""
    if text.lstrip()[0] not in "[{":
        yield from _swpc_rows(text, name)
        return
    try:
        content = json.loads(text)
    except ValueError as error:
        raise InputError(f"{name} is damaged ({_said(error)}): fetch it again") from error
    if isinstance(content, dict) and content.get("type") == "FeatureCollection":
        yield from _tfcat_rows(content, name)
        return
    if not isinstance(content, list):
        said = content.get("error") or content.get("error_message") or content.get("detail")
        raise InputError(f"{name} is none of the known lists ({said or 'it is one object'}): give {KNOWN}")
    reader = _json_reader(content, name)
    for row in content:
        yield partial(reader, row)


def _json_reader(content: list[Any], name: str) -> Callable[[Json], Event | None]:
    """How rows of a JSON list are read, by the fields of the first that has any; an empty list has no rows."""
    fields = next((one.keys() for one in content if isinstance(one, dict)), None)
    if fields is None:
        if content:
            raise InputError(f"{name} is none of the known lists (its rows are no objects): give {KNOWN}")
        return lambda _: None
    for needed, reader in (
        ({"flrID"}, _donki_flare),
        ({"sepID"}, _donki_particles),
        ({"activityID", "startTime"}, _donki_cme),
        ({"begin_datetime", "type"}, _swpc_json),
        ({"begin_time", "max_class"}, _goes_flare),
    ):
        if needed <= fields:
            return reader
    raise InputError(f"{name} is none of the known lists (fields {', '.join(sorted(fields)[:4])}): give {KNOWN}")


def _checked(event: Event, latest: datetime) -> Event:
    if event.start_utc < EARLIEST:
        raise _UnusableError(f"{event.start_utc:%Y-%m-%d} is before {EARLIEST:%Y}")
    if event.start_utc > latest:
        raise _UnusableError(f"{event.start_utc:%Y-%m-%dT%H:%MZ} is in the future")
    for name in ("peak_utc", "end_utc"):
        value = getattr(event, name)
        if value is not None and not timedelta(0) <= value - event.start_utc <= LONGEST:
            raise _UnusableError(
                f"{name} is {value:%Y-%m-%dT%H:%MZ}, and the event begins {event.start_utc:%Y-%m-%dT%H:%MZ}"
            )
    return event


def _instant(value: Any) -> datetime:
    """A time; without a zone it is UTC."""
    if not isinstance(value, str):
        raise _UnusableError(f"{value!r} is not a time")
    try:
        moment = datetime.fromisoformat(value.strip())
    except ValueError as error:
        raise _UnusableError(f"{value[:40]!r} is not a time") from error
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)


def _optional(value: Any) -> datetime | None:
    return _instant(value) if value not in {None, ""} else None


def _place(value: Any) -> tuple[float | None, float | None]:
    """Latitude and longitude of a place such as N18W45; unknown where it says nothing."""
    found = _PLACE.fullmatch(str(value or "").strip())
    if found is None:
        return None, None
    latitude, longitude = float(found[2]), float(found[4])
    if latitude > 90 or longitude > 180:
        return None, None
    return (latitude if found[1] in "Nn" else -latitude), (longitude if found[3] in "Ww" else -longitude)


def _region(value: Any, year: int) -> int | None:
    """NOAA number of an active region; lists of after June 2002 leave its first digit out."""
    text = str(value or "").strip()
    if not text.isdecimal() or not 0 < int(text) < 100_000:
        return None
    number = int(text)
    return number + 10_000 if number < 10_000 and year > 2002 else number


def _class(value: Any) -> str:
    text = str(value or "").strip().upper()
    if _CLASS.fullmatch(text) is None:
        raise _UnusableError(f"{text[:20]!r} is not a class of a flare")
    return text


def _made(kind: EventKind, source: str, published_id: str, start: datetime, **more: Any) -> Event:
    observer = more.pop("observer", "EARTH")
    return Event(
        f"{source}:{published_id}", kind, source, published_id, observer, start, at_sun(start, observer), **more
    )


def _published_id(value: Any) -> str:
    text = str(value).strip()
    if not text or len(text) > 100 or not text.isprintable():
        raise _UnusableError("it has no id")
    return text


def _donki_flare(row: Json) -> Event:
    start = _instant(row["beginTime"])
    latitude, longitude = _place(row.get("sourceLocation"))
    return _made(
        "flare",
        "DONKI",
        _published_id(row["flrID"]),
        start,
        peak_utc=_optional(row.get("peakTime")),
        end_utc=_optional(row.get("endTime")),
        size=_class(row["classType"]),
        latitude_deg=latitude,
        longitude_deg=longitude,
        region=_region(row.get("activeRegionNum"), start.year),
        link=_link(row.get("link")),
    )


def _donki_cme(row: Json) -> Event:
    start = _instant(row["startTime"])
    latitude, longitude = _place(row.get("sourceLocation"))
    analyses = [one for one in row.get("cmeAnalyses") or [] if isinstance(one, dict)]
    best = next((one for one in analyses if one.get("isMostAccurate")), analyses[0] if analyses else {})
    speed = best.get("speed")
    has_speed = isinstance(speed, int | float) and not isinstance(speed, bool) and 0 < speed < 10_000
    return _made(
        "cme",
        "DONKI",
        _published_id(row["activityID"]),
        start,
        size=f"{speed:g} km/s" if has_speed else "",
        latitude_deg=latitude,
        longitude_deg=longitude,
        region=_region(row.get("activeRegionNum"), start.year),
        link=_link(row.get("link")),
    )


def _donki_particles(row: Json) -> Event:
    instruments = [str(one.get("displayName", "")) for one in row.get("instruments") or [] if isinstance(one, dict)]
    return _made(
        "particles",
        "DONKI",
        _published_id(row["sepID"]),
        _instant(row["eventTime"]),
        size=", ".join(filter(None, instruments))[:200],
        link=_link(row.get("link")),
    )


def _link(value: Any) -> str:
    text = str(value or "").strip()
    return text if text.startswith("https://") and len(text) < 300 and text.isprintable() else ""


def _goes_flare(row: Json) -> Event:
    start = _instant(row["begin_time"])
    return _made(
        "flare",
        "GOES",
        f"{start:%Y%m%dT%H%M}",
        start,
        peak_utc=_optional(row.get("max_time")),
        end_utc=_optional(row.get("end_time")),
        size=_class(row["max_class"]),
    )


def _swpc_json(row: Json) -> Event | None:
    if row["type"] != "XRA":
        return None
    start = _instant(row["begin_datetime"])
    latitude, longitude = _place(row.get("location"))
    return _made(
        "flare",
        "SWPC",
        f"{start:%Y%m%dT%H%M}",
        start,
        peak_utc=_optional(row.get("max_datetime")),
        end_utc=_optional(row.get("end_datetime")),
        size=_class(row.get("particulars1")),
        latitude_deg=latitude,
        longitude_deg=longitude,
        region=_region(row.get("region"), start.year),
    )


def _swpc_rows(text: str, name: str) -> Iterator[Reader]:
    """X-ray events of a daily list, each with the place of its flare in H alpha where there is one."""
    lines = text.splitlines()
    day = next((found[1] for line in lines if (found := re.match(r":Date:\s*(\d{4} \d{2} \d{2})", line))), None)
    if day is None or not any("Begin" in line and "Particulars" in line for line in lines):
        raise InputError(f"{name} is none of the known lists: give {KNOWN}")
    try:
        midnight = datetime.strptime(day, "%Y %m %d").replace(tzinfo=UTC)
    except ValueError as error:
        raise InputError(f"{name}: {day} is not a day; fetch it again") from error
    rows = [match for match in map(_ROW.match, lines) if match]
    places = {row[1]: row[9].split()[0] for row in rows if row[8] == "FLA" and row[9].split()}
    for row in rows:
        if row[8] == "XRA":
            yield partial(_swpc_flare, row, places.get(row[1], ""), midnight)


def _swpc_flare(row: re.Match[str], place: str, midnight: datetime) -> Event:
    band, size, *rest = row[9].split()
    if not band.startswith("1-8"):
        raise _UnusableError(f"{band!r} is not the band of X-rays")
    start = _clock(row[3], midnight)
    if start is None:
        raise _UnusableError("its begin is not known")
    latitude, longitude = _place(place)
    peak, end = _clock(row[4], start), _clock(row[5], start)
    return _made(
        "flare",
        "SWPC",
        f"{start:%Y%m%dT%H%M}",
        start,
        peak_utc=peak,
        end_utc=end,
        size=_class(size),
        latitude_deg=latitude,
        longitude_deg=longitude,
        region=_region(rest[-1], start.year) if len(rest) > 1 else None,
    )


def _clock(text: str, after: datetime) -> datetime | None:
    """Hours and minutes at or after another time; letters before them say that they are not exact."""
    digits = text.lstrip("ABDEU")
    if not re.fullmatch(r"\d{4}", digits):
        return None
    hours, minutes = int(digits[:2]), int(digits[2:])
    if hours > 23 or minutes > 59:
        raise _UnusableError(f"{text!r} is not a time of day")
    moment = after.replace(hour=hours, minute=minutes)
    return moment if moment >= after else moment + timedelta(days=1)


def _tfcat_rows(content: Json, name: str) -> Iterator[Reader]:
    """Features of a TFCat collection, by their boxes in time and frequency."""
    try:
        properties = content["crs"]["properties"]
        clock, spectral = str(properties["time_coords_id"]).lower(), properties["spectral_coords"]
        observer = str(properties["ref_position_id"])
        unit = _TO_MHZ[str(spectral["unit"]).lower()]
        features = list(content["features"])
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{name} is not TFCat 1.0 ({_said(error)}): its crs must name time, unit and spacecraft"
        ) from error
    if clock != "unix" or spectral.get("type") != "frequency":
        raise InputError(f"{name}: times must be unix and spectra frequencies; convert it with the TFCat library")
    for number, feature in enumerate(features):
        yield partial(_tfcat_burst, feature, number, unit, observer)


_OBSERVERS = {
    "solar-orbiter": "SOLO",
    "parker-solar-probe": "PSP",
    "stereo-a": "STEREO-A",
    "stereo-b": "STEREO-B",
    "wind": "WIND",
    "earth": "EARTH",
}


def _tfcat_burst(feature: Json, number: int, unit_mhz: float, observer: str) -> Event:
    points = list(_points(feature["geometry"]["coordinates"]))
    if not points:
        raise _UnusableError("its geometry has no point")
    times, frequencies = zip(*points, strict=True)
    start, end = (datetime.fromtimestamp(one, UTC) for one in (min(times), max(times)))
    published_id = _published_id(feature.get("id", number))
    named = _OBSERVERS.get(observer.lower().replace("_", "-"), observer.upper())
    return _made(
        "radio",
        f"TFCat {observer}"[:60],
        published_id,
        start,
        end_utc=end,
        observer=named,
        f_low_mhz=min(frequencies) * unit_mhz,
        f_high_mhz=max(frequencies) * unit_mhz,
    )


def _points(coordinates: Any) -> Iterator[tuple[float, float]]:
    """Points of any geometry."""
    if len(coordinates) == 2 and all(isinstance(one, int | float) for one in coordinates):
        second, frequency = map(float, coordinates)
        if not (math.isfinite(second) and math.isfinite(frequency) and frequency > 0):
            raise _UnusableError(f"{coordinates} is not a time and a frequency")
        yield second, frequency
        return
    for part in coordinates:
        if not isinstance(part, list):
            raise _UnusableError(f"{part!r} is not a point")
        yield from _points(part)

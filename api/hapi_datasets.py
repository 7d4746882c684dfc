"""The data sets that are served by HAPI: where their records come from, and over which times."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import islice

import numpy as np

from api.service import Service
from api.tables import (
    BURST_TABLE,
    LOCALISATION_TABLE,
    TRACK_TABLE,
    detection_table,
    table_of_rows,
)
from bella.catalogue import BurstQuery, BurstSummary, DetectionQuery, EventQuery, ObservedDay
from bella.formats import ARRIVALS, BURSTS, DAYS, DETECTIONS, EVENTS, LATENCIES, LOCALISATIONS, TRACKS, Schema
from bella.formats.hapi import (
    FLOAT_FILL,
    TIME_PARAMETER,
    HapiError,
    HapiParameter,
    HapiRecords,
    table_parameters,
    table_records,
)
from bella.pipeline.rows import all_bursts, all_days, all_events, arrival_rows, day_row, event_rows, latency_row
from bella.spacecraft import OBSERVATORIES, coverage, position

START = np.datetime64("1994-11-01", "us")
"""Launch of Wind, the oldest receiver: no data set begins earlier."""

AHEAD = timedelta(days=2)
"""Data sets are said to end so long after today, so that they may grow."""

LONGEST_BURST = timedelta(hours=6)
"""Sources emit, and edges arrive, at most so long away from the onset of a burst."""

SAME_TIME = timedelta(seconds=1)
"""Records so long before a request are looked at too: they may put later records of the same time on."""

MOST_RECORDS = 100_000
MOST_BURSTS_READ = 300
MOST_DETECTIONS = 10_000
MOST_DAYS = 36_600
"""Largest answers; of more, a request is refused with the code 1408."""

SAMPLE_BURSTS = 5

Instants = tuple[np.datetime64, np.datetime64]
POSITION_STEP = timedelta(hours=1)
POSITION_PARAMETERS = (
    TIME_PARAMETER,
    *(
        HapiParameter(
            name.lower().replace("-", "_"),
            "double",
            "solRad",
            f"Position of {name}, HEE of that time; unknown outside the ephemeris.",
            fill=FLOAT_FILL,
            vector=("x", "y", "z"),
        )
        for name in OBSERVATORIES
    ),
)
AVAILABILITY_PARAMETERS = (
    *table_parameters(DAYS),
    *(
        HapiParameter(
            f"{name.lower().replace('-', '_')}_hours",
            "double",
            "h",
            f"Hours of the day of which {name} had data; unknown where nobody looked.",
            fill=FLOAT_FILL,
        )
        for name in OBSERVATORIES
    ),
)
_INTERVAL = (
    " A record belongs to the time of its onset, start_utc, alone: a request gives what begins in it; what began before"
    " it and goes on (see end_utc) is not repeated."
)


@dataclass(frozen=True)
class HapiDataset:
    """One data set.

    Attributes
    ----------
    name, title, description : str
        The title has at most 40 characters.
    cadence : str
        ISO 8601 duration; of events, the precision of their times.
    read : callable
        Records of [start, stop), possibly with a few around.
    sample : callable
        First and last time of a sample with a few records; None where there is none.
    """

    name: str
    title: str
    description: str
    cadence: str
    parameters: tuple[HapiParameter, ...]
    read: Callable[[Service, datetime, datetime], HapiRecords]
    sample: Callable[[Service], Instants | None]


def last_instant(now: datetime | None = None) -> np.datetime64:
    """Where data sets are said to end: midnight, two days from now."""
    day = (now or datetime.now(UTC)).date() + AHEAD
    return np.datetime64(day, "us")


def _query(start: datetime, stop: datetime) -> BurstQuery:
    return BurstQuery(start=start - SAME_TIME, stop=stop, limit=1000)


def _some_bursts(service: Service, start: datetime, stop: datetime, most: int) -> list[BurstSummary]:
    """Bursts that may have records in [start, stop)."""
    query = _query(start - LONGEST_BURST, stop + LONGEST_BURST)
    found = list(islice(all_bursts(service.catalogue(), query), most + 1))
    if len(found) > most:
        raise HapiError(1408, f"more than {most} bursts; ask for a shorter time")
    return found


def _bursts(service: Service, start: datetime, stop: datetime) -> HapiRecords:
    catalogue = service.catalogue()
    with catalogue.snapshot():
        return table_records(BURST_TABLE.of(catalogue, all_bursts(catalogue, _query(start, stop))))


def _tracks(service: Service, start: datetime, stop: datetime) -> HapiRecords:
    catalogue = service.catalogue()
    with catalogue.snapshot():
        return table_records(TRACK_TABLE.of(catalogue, all_bursts(catalogue, _query(start, stop))))


def _localisations(service: Service, start: datetime, stop: datetime) -> HapiRecords:
    catalogue = service.catalogue()
    with catalogue.snapshot():
        bursts = _some_bursts(service, start, stop, MOST_RECORDS // 20)
        return table_records(LOCALISATION_TABLE.of(catalogue, bursts))


def _arrivals(service: Service, start: datetime, stop: datetime) -> HapiRecords:
    bursts = _some_bursts(service, start, stop, MOST_BURSTS_READ)
    preferred = [one.preferred for one in bursts if one.preferred]
    rows = [row for solution in preferred for row in arrival_rows(solution, service.posterior(solution))]
    return table_records(table_of_rows(ARRIVALS, rows))


def _detections(service: Service, start: datetime, stop: datetime) -> HapiRecords:
    page = service.catalogue().detections(DetectionQuery(start - SAME_TIME, stop, limit=MOST_DETECTIONS))
    if page.next_cursor:
        raise HapiError(1408, f"more than {MOST_DETECTIONS} detections; ask for a shorter time")
    return table_records(detection_table(page.detections))


def _events(service: Service, start: datetime, stop: datetime) -> HapiRecords:
    catalogue = service.catalogue()
    with catalogue.snapshot():
        events = all_events(catalogue, EventQuery(start - SAME_TIME, stop, limit=1000))
        rows = list(islice((row for one in events for row in event_rows(catalogue, one)), MOST_DETECTIONS + 1))
    if len(rows) > MOST_DETECTIONS:
        raise HapiError(1408, f"more than {MOST_DETECTIONS} events; ask for a shorter time")
    return table_records(table_of_rows(EVENTS, rows))


def _positions(_: Service, start: datetime, stop: datetime) -> HapiRecords:
    if (stop - start) / POSITION_STEP > MOST_RECORDS:
        raise HapiError(1408, f"more than {MOST_RECORDS} hours; ask for a shorter time")
    first, last = (np.datetime64(one.replace(tzinfo=None), "us") for one in (start, stop))
    step = np.timedelta64(POSITION_STEP)
    begin = START + np.ceil((first - START) / step).astype(int) * step
    times = np.arange(begin, max(begin, last), step)
    return HapiRecords(POSITION_PARAMETERS, (times, *(_position(name, times) for name in OBSERVATORIES)))


def _position(observatory: str, times: np.ndarray) -> np.ndarray:
    """Position at each time, NaN outside the ephemeris, shape (times, 3)."""
    found = np.full((times.size, 3), np.nan)
    covered = [coverage(name) for name in (observatory, "EARTH")]
    inside = (times >= max(one.start for one in covered)) & (times <= min(one.stop for one in covered))
    if inside.any():
        found[inside] = position(observatory, times[inside])
    return found


def _availability(service: Service, start: datetime, stop: datetime) -> HapiRecords:
    catalogue, last = service.catalogue(), (stop - timedelta(microseconds=1)).date()
    if (stop - start).days > MOST_DAYS:
        raise HapiError(1408, f"more than {MOST_DAYS} days; ask for a shorter time")
    with catalogue.snapshot():
        days = sorted(all_days(catalogue, start.date(), last), key=lambda one: (one.searched.day, one.searched.origin))
        observed = {one.day: one for one in catalogue.operation.observed_between(start.date(), last)}
    records = table_records(table_of_rows(DAYS, map(day_row, days)))
    hours = (np.array([_hours(observed.get(one.searched.day), name) for one in days], float) for name in OBSERVATORIES)
    return HapiRecords(AVAILABILITY_PARAMETERS, (*records.columns, *hours))


def _hours(observed: ObservedDay | None, observatory: str) -> float:
    """Hours of a day with data of a spacecraft; NaN where that is not known."""
    if observed is None:
        return np.nan
    return sum((sum(one.fraction) for one in observed.receivers if one.observatory == observatory), 0.0)


def _latency(service: Service, start: datetime, stop: datetime) -> HapiRecords:
    found = service.catalogue().operation.times_between(start - SAME_TIME, stop, MOST_DETECTIONS + 1)
    if len(found) > MOST_DETECTIONS:
        raise HapiError(1408, f"more than {MOST_DETECTIONS} solutions; ask for a shorter time")
    return table_records(table_of_rows(LATENCIES, (latency_row(*one) for one in found)))


def _sample_of_days(service: Service) -> Instants | None:
    days = [one.searched.day for one in service.catalogue().days(limit=SAMPLE_BURSTS).days]
    return (np.datetime64(min(days), "us"), np.datetime64(max(days) + timedelta(days=1), "us")) if days else None


def _sample_of_latencies(service: Service) -> Instants | None:
    early, late = datetime(1994, 11, 1, tzinfo=UTC), datetime(2200, 1, 1, tzinfo=UTC)
    times = [one.published_utc for _, one in service.catalogue().operation.times_between(early, late, SAMPLE_BURSTS)]
    return _around(min(times), max(times) + timedelta(minutes=1)) if times else None


def _sample_of_bursts(before: timedelta, after: timedelta) -> Callable[[Service], Instants | None]:
    def _sample(service: Service) -> Instants | None:
        found = service.catalogue().bursts(BurstQuery(limit=SAMPLE_BURSTS)).bursts
        starts = [one.burst.start_utc for one in found]
        return _around(min(starts) - before, max(starts) + after) if starts else None

    return _sample


def _sample_of_detections(service: Service) -> Instants | None:
    starts = [one.start_utc for one in service.catalogue().detections(DetectionQuery(limit=SAMPLE_BURSTS)).detections]
    return _around(min(starts) - timedelta(minutes=1), max(starts) + timedelta(minutes=30)) if starts else None


def _sample_of_events(service: Service) -> Instants | None:
    starts = [one.event.start_utc for one in service.catalogue().events.events(EventQuery(limit=SAMPLE_BURSTS)).events]
    return _around(min(starts) - timedelta(minutes=1), max(starts) + timedelta(minutes=30)) if starts else None


def _sample_of_positions(_: Service) -> Instants | None:
    return np.datetime64("2012-06-07", "us"), np.datetime64("2012-06-08", "us")


def _around(start: datetime, stop: datetime) -> Instants:
    return tuple(np.datetime64(one.replace(tzinfo=None, second=0, microsecond=0), "us") for one in (start, stop))  # type: ignore[return-value]


_ONSETS = _sample_of_bursts(timedelta(minutes=1), timedelta(minutes=30))
_TIMES_OF_BURSTS = _sample_of_bursts(timedelta(hours=1), LONGEST_BURST)


def _of_table(
    schema: Schema,
    read: Callable[[Service, datetime, datetime], HapiRecords],
    sample: Callable[[Service], Instants | None],
    cadence: str,
    more: str,
) -> HapiDataset:
    return HapiDataset(
        schema.name, schema.title, f"{schema.title}.{more}", cadence, table_parameters(schema), read, sample
    )


DATASETS = {
    one.name: one
    for one in (
        _of_table(BURSTS, _bursts, _ONSETS, "PT1M", _INTERVAL),
        _of_table(TRACKS, _tracks, _ONSETS, "PT1M", _INTERVAL),
        _of_table(LOCALISATIONS, _localisations, _TIMES_OF_BURSTS, "PT1S", " Time is that of emission."),
        _of_table(ARRIVALS, _arrivals, _TIMES_OF_BURSTS, "PT1S", " Of preferred solutions."),
        _of_table(DETECTIONS, _detections, _sample_of_detections, "PT1M", _INTERVAL),
        HapiDataset(
            EVENTS.name,
            "Published events, and bursts near them",
            f"{EVENTS.title}: a record for each event and burst. Time is the start of the event at its observer. That "
            "two times are near is no proof that one event caused the other.",
            "PT1M",
            table_parameters(EVENTS),
            _events,
            _sample_of_events,
        ),
        HapiDataset(
            "availability",
            "Days: what was searched, what was found",
            "What was searched on each day, the answer, how much was found, and how long each receiver had data. Time "
            "is the beginning of the day; a day is there once for data of each origin.",
            "P1D",
            AVAILABILITY_PARAMETERS,
            _availability,
            _sample_of_days,
        ),
        _of_table(LATENCIES, _latency, _sample_of_latencies, "PT1S", " Time is that of the publication."),
        HapiDataset(
            "spacecraft_positions",
            "Positions of the spacecraft, HEE",
            "Where the receivers were, each hour: Heliocentric Earth Ecliptic axes of that time.",
            "PT1H",
            POSITION_PARAMETERS,
            _positions,
            _sample_of_positions,
        ),
    )
}
"""Data sets by id."""

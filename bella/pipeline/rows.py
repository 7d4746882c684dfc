"""Rows of the published tables, from the catalogue and the posteriors: the same for the API, HAPI and a release."""

from collections.abc import Collection, Generator, Iterable, Iterator
from dataclasses import asdict, replace
from datetime import date
from itertools import islice
from typing import TypeVar

import numpy as np
import xarray as xr

from bella.catalogue import (
    BurstQuery,
    BurstSummary,
    Catalogue,
    DaySummary,
    EventQuery,
    KnownEvent,
    Solution,
    SolutionTimes,
)
from bella.exceptions import InputError
from bella.formats import track_numbers
from bella.linked_events import Link
from bella.records import REAL_ORIGINS, Origin

Row = dict[str, object]
Item = TypeVar("Item")

AT_ONCE = 500
"""Solutions that are read with one statement, and rows that are in memory at a time."""

_NOISE = ("sigma_s", "shape_sd_s", "offset_sd_s", "delay_s", "delay_sd_s", "rise_s")
_POSITION = ("x_rsun", "y_rsun", "z_rsun")


def all_bursts(catalogue: Catalogue, query: BurstQuery) -> Generator[BurstSummary]:
    """Bursts of all pages of a query."""
    while True:
        page = catalogue.bursts(query)
        yield from page.bursts
        if page.next_cursor is None:
            return
        query = replace(query, cursor=page.next_cursor)


def burst_row(summary: BurstSummary) -> Row:
    """Row of a burst in the table of bursts, with what its preferred solution says."""
    burst, preferred = summary.burst, summary.preferred
    retracted = burst.retracted.reason if burst.retracted else ""
    lists = {"observatories": " ".join(burst.observatories), "retracted": retracted}
    row: Row = {**vars(burst), **lists, "version": 0}
    if preferred is None:
        return row
    said = preferred.answer.model_dump()
    more = {"version": preferred.version, "created_utc": preferred.created_utc, "code_version": preferred.code_version}
    return {**row, **said, **_series(preferred), **more, "flags": ";".join(preferred.flags)}


def track_rows(catalogue: Catalogue, summaries: Iterable[BurstSummary]) -> Iterator[Row]:
    """Rows of bursts in the table of tracks; none of a burst whose preferred solution has no track."""
    for some in batches(one for one in summaries if one.preferred):
        joints = catalogue.joints_of(one.preferred for one in some if one.preferred)
        for summary in some:
            preferred = summary.preferred
            if preferred is None or preferred.solution_id not in joints:
                continue
            yield {
                "burst_id": summary.burst.burst_id,
                "start_utc": summary.burst.start_utc,
                "grade": preferred.answer.grade,
                "tier": preferred.answer.tier,
                **track_numbers(joints[preferred.solution_id]),
                **_series(preferred),
            }


def localisation_rows(catalogue: Catalogue, solutions: Iterable[Solution]) -> Iterator[Row]:
    """Rows of solutions in the table of localisations, one per frequency."""
    for some in batches(solutions):
        positions = catalogue.localisations_of([one.solution_id for one in some])
        for solution in some:
            same = {**_series(solution), "burst_id": solution.burst_id}
            for row in positions[solution.solution_id]:
                yield {**vars(row), **same}


def batches(items: Iterable[Item]) -> Iterator[list[Item]]:
    """Lists of `AT_ONCE` items; the last one may be shorter."""
    rest = iter(items)
    while some := list(islice(rest, AT_ONCE)):
        yield some


def arrival_rows(solution: Solution, posterior: xr.Dataset, observatory: str | None = None) -> list[Row]:
    """Arrival times that a solution was made from, by spacecraft and ascending frequency.

    Raises
    ------
    InputError
        If the spacecraft has none; the message lists those that have.
    """
    names = [str(name) for name in posterior["observatory"].to_numpy()]
    if observatory is not None and observatory not in names:
        raise InputError(
            f"observatory: {observatory[:40]!r} has no arrival time here; those that have: {', '.join(names)}"
        )
    reference = np.datetime64(str(posterior.attrs["reference_time"]).removesuffix("Z"), "us")
    times = reference + np.rint(posterior["arrival_s"].to_numpy() * 1e6).astype("timedelta64[us]")
    numbers = {name: posterior[name].to_numpy() for name in _NOISE if name in posterior}
    receiver = posterior["receiver_rsun"].to_numpy()
    rows: list[Row] = []
    for column, name in enumerate(names):
        received = np.flatnonzero(np.isfinite(posterior["arrival_s"].to_numpy()[:, column]))
        rows += [
            {
                **{key: float(values[row, column]) for key, values in numbers.items()},
                **dict(zip(_POSITION, receiver[row, column].tolist(), strict=True)),
                "burst_id": solution.burst_id,
                "solution_id": solution.solution_id,
                "edge": solution.series.edge,
                "observatory": name,
                "frequency_mhz": float(posterior["frequency"][row]),
                "arrival_utc": times[row, column],
            }
            for row in received
            if observatory in {None, name}
        ]
    return rows


def day_row(day: DaySummary) -> Row:
    """Row of a searched day in the table of days."""
    searched, counts = asdict(day.searched), asdict(day)
    del counts["searched"]
    words = {"day_utc": day.searched.day.isoformat(), "observatories": " ".join(day.searched.observatories)}
    return {**searched, **counts, **words}


def all_days(
    catalogue: Catalogue, first: date | None, last: date | None, origins: Collection[Origin] = REAL_ORIGINS
) -> Iterator[DaySummary]:
    """Searched days of [first, last] in data of these origins, the newest first."""
    cursor: str | None = None
    while True:
        page = catalogue.days(first, last, limit=366, origins=origins, cursor=cursor)
        yield from page.days
        if page.next_cursor is None:
            return
        cursor = page.next_cursor


def all_events(catalogue: Catalogue, query: EventQuery) -> Iterator[KnownEvent]:
    """Published events of all pages of a query."""
    while True:
        page = catalogue.events.events(query)
        yield from page.events
        if page.next_cursor is None:
            return
        query = replace(query, cursor=page.next_cursor)


def latency_row(solution_id: str, times: SolutionTimes) -> Row:
    """Row of a solution in the table of latencies."""
    row: Row = {**asdict(times), "solution_id": solution_id, "burst_id": solution_id.partition(".")[0]}
    for step in ("data", "seen", "fetched", "detected"):
        since = getattr(times, f"{step}_utc")
        row[f"{step}_to_published_s"] = None if since is None else (times.published_utc - since).total_seconds()
    return row


def event_rows(catalogue: Catalogue, known: KnownEvent) -> Iterator[Row]:
    """Rows of a published event, one for each burst that it is near to; one row without a burst where there is none."""
    if not known.bursts:
        yield asdict(known.event) | {"observatory": known.event.observer}
    for burst_id, delay_s in known.bursts.items():
        yield link_row(Link(known.event, delay_s), catalogue.burst(burst_id))


def link_row(link: Link, near: BurstSummary) -> Row:
    """Row of a published event and a burst that it is near to."""
    preferred = near.preferred
    said = {**preferred.answer.model_dump(), "solution_id": preferred.solution_id} if preferred else {}
    own = asdict(link.event) | {"observatory": link.event.observer}
    return {**said, **own, "burst_id": near.burst.burst_id, "delay_s": link.delay_s}


def _series(solution: Solution) -> Row:
    return {**vars(solution.series), "solution_id": solution.solution_id}

"""Rows of the published tables, from the catalogue and the posteriors: the same for the API, HAPI and a release."""

from collections.abc import Iterator
from dataclasses import asdict, replace

import numpy as np
import xarray as xr

from bella.answer import read_track
from bella.catalogue import BurstQuery, BurstSummary, Catalogue, DaySummary, KnownEvent, Solution
from bella.exceptions import InputError
from bella.formats import track_numbers

Row = dict[str, object]

_NOISE = ("sigma_s", "shape_sd_s", "offset_sd_s", "delay_s", "delay_sd_s", "rise_s")
_POSITION = ("x_rsun", "y_rsun", "z_rsun")


def all_bursts(catalogue: Catalogue, query: BurstQuery) -> Iterator[BurstSummary]:
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
    row: Row = {**asdict(burst), **lists, "version": 0}
    if preferred is None:
        return row
    said = preferred.answer.model_dump()
    more = {"version": preferred.version, "created_utc": preferred.created_utc, "code_version": preferred.code_version}
    return {**row, **said, **_series(preferred), **more, "flags": ";".join(preferred.flags)}


def track_rows(catalogue: Catalogue, summary: BurstSummary) -> Iterator[Row]:
    """Row of a burst in the table of tracks; none where its preferred solution has no track."""
    preferred = summary.preferred
    track = read_track(catalogue.track_fit(preferred.solution_id)) if preferred else None
    if preferred is None or track is None:
        return
    answer = preferred.answer
    yield {
        "burst_id": summary.burst.burst_id,
        "start_utc": summary.burst.start_utc,
        "grade": answer.grade,
        "tier": answer.tier,
        **track_numbers(track.joint),
        **_series(preferred),
    }


def localisation_rows(catalogue: Catalogue, solution: Solution) -> Iterator[Row]:
    """Rows of a solution in the table of localisations, one per frequency."""
    same = {**_series(solution), "burst_id": solution.burst_id}
    for row in catalogue.localisations(solution.solution_id):
        yield {**asdict(row), **same}


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
        heard = np.flatnonzero(np.isfinite(posterior["arrival_s"].to_numpy()[:, column]))
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
            for row in heard
            if observatory in {None, name}
        ]
    return rows


def day_row(day: DaySummary) -> Row:
    """Row of a searched day in the table of days."""
    searched, counts = asdict(day.searched), asdict(day)
    del counts["searched"]
    words = {"day_utc": day.searched.day.isoformat(), "observatories": " ".join(day.searched.observatories)}
    return {**searched, **counts, **words}


def event_rows(catalogue: Catalogue, known: KnownEvent) -> Iterator[Row]:
    """Rows of a published event, one for each burst that it is near to; one row without a burst where there is none."""
    own = asdict(known.event) | {"observatory": known.event.observer}
    if not known.bursts:
        yield own
    for burst_id, delay_s in known.bursts.items():
        preferred = catalogue.burst(burst_id).preferred
        said = {**preferred.answer.model_dump(), "solution_id": preferred.solution_id} if preferred else {}
        yield {**said, **own, "burst_id": burst_id, "delay_s": delay_s}


def _series(solution: Solution) -> Row:
    return {**asdict(solution.series), "solution_id": solution.solution_id}

"""What a run starts from: the built-in burst, or a submitted arrival table."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from bella.archive import Received
from bella.arrivals import read_arrivals
from bella.bursts.association import onset
from bella.bursts.event import (
    EVENT,
    PUBLISHED_TRACK,
    event_arrivals,
    half_maximum_arrivals,
    half_maximum_edges,
    published_arrivals,
    timed_event,
)
from bella.bursts.shared_profile import collapsed_samples
from bella.bursts.timing import HALF_RISE, SHARED, TimedBurst, channel_arrivals
from bella.catalogue import Burst, SourceFile
from bella.exceptions import InputError
from bella.records import Origin
from bella.spectra import event_spectra

SUBMISSIONS = "arrival_table"
"""Name of the dataset of submitted arrival tables."""


@dataclass(frozen=True)
class BurstInput:
    """One burst with everything a run needs.

    Attributes
    ----------
    arrivals : mapping of str to DataFrame
        Arrival table of each definition of the edge.
    channel_edges : mapping of str to DataFrame
        What is drawn on the spectra, by definition of the edge.
    spectra : DataTree or None
        One DynamicSpectrum per observatory; None where only arrival times were submitted.
    published_track : mapping
        What a paper says of the track; empty where there is none.
    channel_arrivals : mapping of str to DataFrame
        Arrival table of the channels themselves, by definition of the edge, from which the track is fitted jointly;
        where there is none, that is done from `arrivals`.
    directions : DataFrame or None
        Wave directions, where the spectra carry them.
    origin : Origin
        Where its data come from.
    received : Received
        When the files of its day came.
    collapsed : DataFrame or None
        Light curves on the time axis of the shared profile, as :func:`bella.plotting.write_collapsed_png` takes them;
        None where the burst has no such edge.
    is_timed : bool
        Whether the arrival times were measured in the sources; otherwise they were given.
    """

    burst: Burst
    arrivals: Mapping[str, pd.DataFrame]
    channel_edges: Mapping[str, pd.DataFrame]
    spectra: xr.DataTree | None
    sources: tuple[SourceFile, ...]
    published_track: Mapping[str, Any] = field(default_factory=dict)
    channel_arrivals: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    directions: pd.DataFrame | None = None
    origin: Origin = Origin.ARCHIVE
    received: Received = field(default_factory=Received)
    collapsed: pd.DataFrame | None = None
    is_timed: bool = False


def origin_of(spectra: Iterable[xr.Dataset]) -> Origin:
    """Where the spectra of a burst come from; of several origins the one that is furthest from the archive.

    Parameters
    ----------
    spectra : iterable of xarray.Dataset
        Those that do not say so are of the archive.
    """
    found = [Origin(str(one.attrs.get("origin", Origin.ARCHIVE.value))) for one in spectra]
    return max(found, key=list(Origin).index, default=Origin.ARCHIVE)


def load_burst(subject: str, incoming: Path) -> BurstInput:
    """Load the built-in event by its date, or a submitted table by the id of its submission.

    Parameters
    ----------
    incoming : Path
        Folder of the submitted tables.

    Raises
    ------
    InputError
        If there is neither.
    """
    check_subject(subject, incoming)
    if subject == EVENT.name:
        return _built_in_event()
    return _submission(subject, incoming / f"{subject}.csv")


def check_subject(subject: str, incoming: Path) -> None:
    """Refuse what :func:`load_burst` does not know, before anything is started.

    Parameters
    ----------
    incoming : Path
        Folder of the submitted tables.

    Raises
    ------
    InputError
        Names the event that is there.
    """
    if subject != EVENT.name and not (incoming / f"{subject}.csv").is_file():
        raise InputError(f"event {subject!r} is not known; the built-in one is {EVENT.name}")


def _built_in_event() -> BurstInput:
    arrivals = {
        "gauss_hermite": published_arrivals(),
        "half_maximum": half_maximum_arrivals(),
        **{edge: event_arrivals(edge) for edge in (HALF_RISE, SHARED)},
    }
    burst = Burst(
        EVENT.burst_id,
        aware(EVENT.start_utc),
        aware(EVENT.stop_utc),
        EVENT.low_mhz,
        EVENT.high_mhz,
        EVENT.observatories,
        origin=Origin.EVENT,
    )
    edges = {
        "gauss_hermite": arrivals["gauss_hermite"],
        "half_maximum": half_maximum_edges(),
        **{edge: timed_event(edge).edges for edge in (HALF_RISE, SHARED)},
    }
    channels = {edge: channel_arrivals(timed_event(edge)) for edge in (HALF_RISE, SHARED)}
    spectra, sources = event_spectra(), _event_sources()
    return BurstInput(
        burst,
        arrivals,
        edges,
        spectra,
        sources,
        PUBLISHED_TRACK,
        channels,
        origin=Origin.EVENT,
        collapsed=collapsed_of(timed_event(SHARED)),
        is_timed=True,
    )


def collapsed_of(timed: TimedBurst | None) -> pd.DataFrame | None:
    """Light curves of a burst on the time axis of its shared profile, to be drawn; None where it has none."""
    return collapsed_samples(timed.collapsed) if timed and timed.collapsed else None


def _event_sources() -> tuple[SourceFile, ...]:
    """Resource files of the package that the built-in event is read from."""
    day = aware(EVENT.start_utc).date()
    rooms = ("bella.bursts", "bella.spectra")
    files = [file for room in rooms for file in resources.files(room).iterdir() if file.name.endswith((".csv", ".nc"))]
    return tuple(
        SourceFile(
            dataset="built_in_event",
            day=day,
            version="1",
            sha256=hashlib.sha256(file.read_bytes()).hexdigest(),
            state="done",
            uri=f"package:{file.name}",
        )
        for file in sorted(files, key=lambda file: file.name)
    )


def _submission(submission_id: str, table: Path) -> BurstInput:
    arrivals = read_arrivals(table)
    start, stop = onset(arrivals), arrivals["arrival_utc"].to_numpy("datetime64[ns]").max()
    frequency = arrivals["frequency_mhz"]
    burst = Burst(
        submission_id,
        aware(start),
        aware(stop),
        float(frequency.min()),
        float(frequency.max()),
        tuple(dict.fromkeys(arrivals["observatory"])),
        origin=Origin.SUBMISSION,
    )
    sha256 = hashlib.sha256(table.read_bytes()).hexdigest()
    source = SourceFile(SUBMISSIONS, _day(start), "1", sha256, "done", table.name)
    edge = str(arrivals["edge"].iloc[0])
    return BurstInput(burst, {edge: arrivals}, {edge: arrivals}, None, (source,), origin=Origin.SUBMISSION)


def aware(time: np.datetime64) -> datetime:
    """A time with the zone UTC, to the millisecond.

    Parameters
    ----------
    time : numpy.datetime64
        UTC.
    """
    stamp: datetime = pd.Timestamp(time).floor("ms").to_pydatetime()
    return stamp.replace(tzinfo=UTC)


def _day(time: np.datetime64) -> date:
    return aware(time).date()

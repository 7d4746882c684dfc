"""From the files of a day to its bursts: what was found, by which spacecraft, and when it arrived."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, time, timedelta

import numpy as np
import pandas as pd
import structlog
import xarray as xr

from bella.archive import received
from bella.arrivals import POSITION, reference_utc
from bella.bursts.association import (
    SLOWEST,
    AssociatedBurst,
    Member,
    associate,
    association_table,
    in_ephemeris,
)
from bella.bursts.detection import GROUP, Searched, search
from bella.bursts.matched_filter import FREQUENCY_MHZ, THRESHOLDS
from bella.bursts.timing import (
    HALF_RISE,
    SHARED,
    TimedBurst,
    arrival_table,
    burst_spectrum,
    channel_arrivals,
    shared_frequencies_mhz,
    time_burst,
    why_not_timed,
)
from bella.catalogue import Burst, BurstQuery, Catalogue, Detection, SourceFile
from bella.exceptions import BellaError, InputError, NoDataError, NotPlacedError
from bella.flags import CATALOGUED, LOCALISABLE
from bella.pipeline.day_files import DayFiles, check_content
from bella.pipeline.inputs import BurstInput, aware, collapsed_of, origin_of
from bella.pipeline.rows import all_bursts
from bella.pipeline.tracks import burst_directions
from bella.records import Origin, burst_name, is_named_for
from bella.spacecraft import position_hee
from bella.spectra import UserFolder, by_observatory_of_what_fits, open_spectra, receiver_position

log = structlog.get_logger(__name__)

DAY = timedelta(days=1)
BEFORE, AFTER = np.timedelta64(30, "m"), np.timedelta64(3, "h")
"""How much of the days around it belongs to a day: bursts are alone or not, and go on past midnight."""

SAME_BURST = timedelta(minutes=10)
"""A burst that begins this near to one of the catalogue on the same day is that one: later data move its onset."""

SAME_ACROSS_MIDNIGHT = timedelta(minutes=2)
"""The same for one of the day before or after: days are searched apart, so only the same minute or so counts."""

SHOWN_BEFORE, SHOWN_AFTER = np.timedelta64(20, "m"), np.timedelta64(40, "m")
SHOWN_OF_DAY = ("intensity", "noise_db", "interpolated")
"""Variables of a spectrum that the figure of its day needs: processes pass on no others."""

EDGES = (SHARED, HALF_RISE, "half_maximum")
"""Definitions of the edge with which a burst is timed."""

PRELIMINARY_EDGES = (HALF_RISE, "half_maximum")
"""Those of a burst that two spacecraft received: the first is fitted, the second has to agree."""

NOT_LOCALISABLE, NO_PRELIMINARY = "not localisable: ", "no preliminary track: "

KnownBurst = tuple[str, datetime]
"""Id and onset of a burst of the catalogue."""


@dataclass(frozen=True)
class FoundBurst:
    """A burst of a day.

    Attributes
    ----------
    burst_id : str
        In the catalogue.
    found : AssociatedBurst
        Under the name that it has in the detection table of the day; of its spectra what :func:`timed_burst` needs.
    """

    burst_id: str
    found: AssociatedBurst

    @property
    def is_localisable(self) -> bool:
        """Whether three spacecraft or more received it well; if not, `reason` says why it has no position."""
        return self.found.tier == LOCALISABLE

    @property
    def reason(self) -> str:
        """Why it has no position; empty where it may have one."""
        return "" if self.is_localisable else self.found.reason

    @property
    def edges(self) -> tuple[str, ...]:
        """Definitions of the edge with which it is timed; none where nothing can be said of its track."""
        if self.is_localisable:
            return EDGES
        return PRELIMINARY_EDGES if received_by_two(self.found) else ()


@dataclass(frozen=True)
class FoundDay:
    """A day after the search, with its bursts timed.

    Attributes
    ----------
    spectra : tuple of Dataset
        Over their background, of each spacecraft that had data; of their variables those of `SHOWN_OF_DAY`.
    bursts : tuple of FoundBurst
        That begin on the day.
    table : DataFrame
        Detection table of the day.
    left_out : tuple of str
        Files that could not be read, and why.
    not_searchable : tuple of str
        Spacecraft whose spectra cannot be searched, and why.
    searched : int
        How many spectra could be searched.
    """

    files: DayFiles
    spectra: tuple[xr.Dataset, ...]
    bursts: tuple[FoundBurst, ...]
    table: pd.DataFrame
    left_out: tuple[str, ...] = ()
    not_searchable: tuple[str, ...] = ()
    searched: int = 0

    @property
    def observatories(self) -> tuple[str, ...]:
        """Spacecraft that had data."""
        return tuple(str(one.attrs["observatory"]) for one in self.spectra)

    @property
    def origin(self) -> Origin:
        """Where its spectra come from."""
        return origin_of(self.spectra)


def search_day(files: DayFiles, known: Sequence[KnownBurst]) -> FoundDay:
    """Read the spectra of a day, search them, and compare spacecraft.

    Parameters
    ----------
    known : sequence of (str, datetime)
        Bursts of the catalogue around the day.

    Raises
    ------
    NoDataError
        If the files cannot be searched: none can be read, or none has a record of the day.
    StoreError
        If the mirror cannot be read.
    """
    spectra, left_out = day_spectra(files)
    searched, not_searchable = _searched(spectra)
    midnight = pd.Timestamp(files.day)
    bursts = [one for one in associate(searched) if midnight <= one.start_utc < midnight + DAY]
    table = association_table(bursts, searched)
    inside = (table["start_utc"] >= midnight) & (table["start_utc"] < midnight + DAY)
    kept = table[inside | (table["burst_id"] != "")].reset_index(drop=True)
    origin = origin_of(spectra.values())
    names = known_burst_ids([one for one in known if is_named_for(one[0], origin)], bursts, origin)
    found = tuple(_cut(FoundBurst(names[one.burst_id], one)) for one in bursts)
    number = sum(not one.not_searchable for one in searched)
    shown = tuple(one.over[[name for name in SHOWN_OF_DAY if name in one.over]] for one in searched)
    return FoundDay(files, shown, found, kept, left_out, not_searchable, number)


def _cut(one: FoundBurst) -> FoundBurst:
    """The burst, of its spectra no more than it is timed and shown by: a process passes on 4 MB in place of 60."""
    start = one.found.start_utc.to_datetime64()
    members = []
    for member in one.found.members:
        over, grid, match = member.searched.over, member.searched.grid, member.searched.match
        times = [start - SHOWN_BEFORE, start + SHOWN_AFTER]
        if one.edges and member.fits:
            with suppress(NoDataError):  # it is raised again where the burst is timed
                times += [*burst_spectrum(member.searched, member.candidate)["time"].to_numpy()[[0, -1]]]
        # positions are interpolated between records
        over = over.sel(time=slice(min(times) - BEFORE, max(times) + BEFORE)) if one.edges else over.isel(time=[])
        grid = grid._replace(excess_db=grid.excess_db[:0])
        match = match._replace(score=match.score[:, :0], hit=match.hit[:, :0])
        members.append(replace(member, searched=member.searched._replace(over=over, grid=grid, match=match)))
    return replace(one, found=replace(one.found, members=tuple(members)))


def _searched(spectra: Mapping[str, xr.Dataset]) -> tuple[list[Searched], tuple[str, ...]]:
    """Spectra after the search, and the spacecraft whose spectra cannot be searched, each with its reason."""
    found, reasons = [], {}
    for name, spectrum in spectra.items():
        try:
            found.append(search(spectrum))
        except InputError as error:  # one spectrum of a kind that is not known does not cost the day the others
            reasons[name] = str(error)
        else:
            reasons[name] = found[-1].not_searchable
    return found, tuple(f"{name}: {reason}" for name, reason in reasons.items() if reason)


def received_by_two(burst: AssociatedBurst) -> bool:
    """Whether a burst may have a preliminary track: two spacecraft received it well, below 2 MHz, drifting like a beam.

    Parameters
    ----------
    burst : AssociatedBurst
        That cannot be localised.
    """
    alone = [member.candidate for member in burst.members if member.fits]
    if len(alone) != THRESHOLDS.spacecraft - 1 or GROUP in {member.unfit for member in burst.members}:
        return False
    both = alone[0].hit & alone[1].hit & (THRESHOLDS.low_mhz > FREQUENCY_MHZ)
    return bool(np.count_nonzero(both) >= THRESHOLDS.low_channels and min(one.drift for one in alone) > SLOWEST)


def day_spectra(files: DayFiles) -> tuple[dict[str, xr.Dataset], tuple[str, ...]]:
    """Spectra of a day with what of its neighbours belongs to it, one of each spacecraft that had data.

    Returns
    -------
    spectra : dict of str to xarray.Dataset
        By observatory.
    left_out : tuple of str
        Files that are left out, each with its reason: one bad file does not cost the day the others.

    Raises
    ------
    NoDataError
        If no file could be read, or none has a record of the day.
    StoreError
        If the mirror cannot be read.
    WorkerLostError
        If the process that reads files was killed.
    """
    if files.folder is not None:
        return _brought_spectra(files.day, files.folder)
    found: list[xr.Dataset] = []
    left_out = []
    for path, source in zip(files.paths, files.sources, strict=True):
        wrong = check_content(path, source)
        try:
            found += [] if wrong else open_spectra(path)
        except BellaError as error:
            if error.retriable:
                raise
            wrong = str(error)
        if wrong:
            log.warning("file left out", file=path.name, reason=wrong)
            left_out.append(wrong if path.name in wrong else f"{path.name}: {wrong}")
    if not found:
        raise NoDataError(f"no file of {files.day} can be read ({'; '.join(left_out[:1])}): fetch them again")
    midnight = np.datetime64(files.day, "ns")
    start, stop = midnight - BEFORE, midnight + np.timedelta64(1, "D") + AFTER
    parts = [part for one in found if (part := one.sel(time=slice(start, stop))).sizes["time"] > 1]
    whole, unfit = by_observatory_of_what_fits(parts)
    reaching = {name: one for name, one in whole.items() if _reaches(one, midnight)}
    if not reaching:
        said = f" ({'; '.join((*left_out, *unfit))})" if left_out or unfit else ""
        raise NoDataError(f"no file has a record of {files.day} that can be searched{said}: fetch the day again")
    return reaching, (*left_out, *unfit)


def _brought_spectra(day: date, folder: UserFolder) -> tuple[dict[str, xr.Dataset], tuple[str, ...]]:
    read = folder.read(day)
    left_out = [one.removeprefix("left out: ").removeprefix("left out of positions: ") for one in read.left_out]
    if not read.spectra:
        raise NoDataError("; ".join(left_out) or f"the folder has no record of {day}")
    return read.spectra, tuple(left_out)


def _reaches(spectrum: xr.Dataset, midnight: np.datetime64) -> bool:
    return bool(spectrum.sel(time=slice(midnight, midnight + np.timedelta64(1, "D"))).sizes["time"])


def timed_burst(files: DayFiles, one: FoundBurst) -> BurstInput:
    """Time a burst by the spacecraft that received it well.

    Returns
    -------
    BurstInput
        What localising starts from.

    Raises
    ------
    NotPlacedError
        If its edges do not place it.
    """
    burst = one.found
    members = [member for member in burst.members if member.fits]
    names = [member.searched.observatory for member in members]
    try:
        parts = [burst_spectrum(member.searched, member.candidate) for member in members]
        flanks = time_burst(parts, HALF_RISE)
        reason = why_not_timed(flanks, names)
        if reason:
            raise NotPlacedError(reason.removeprefix(NOT_LOCALISABLE))
        timed = {edge: flanks if edge == HALF_RISE else time_burst(parts, edge) for edge in one.edges}
        kept = {edge: each for edge, each in timed.items() if not why_not_timed(each, names)}
        arrivals = {
            edge: with_stated_positions(
                arrival_table(each, shared_frequencies_mhz(each)), [member.searched for member in members]
            )
            for edge, each in kept.items()
        }
    except (NoDataError, InputError) as error:
        raise NotPlacedError(str(error)) from error
    table = arrivals[HALF_RISE]
    record = Burst(
        one.burst_id,
        aware(burst.start_utc.to_datetime64()),
        aware(table["arrival_utc"].max().to_datetime64()),
        float(table["frequency_mhz"].min()),
        float(table["frequency_mhz"].max()),
        tuple(dict.fromkeys(table["observatory"])),
    )
    return BurstInput(
        record,
        arrivals,
        {edge: each.edges for edge, each in kept.items()},
        _shown(members, burst),
        sources_of(files, parts),
        channel_arrivals=_channel_tables(kept, members),
        directions=_directions(members, burst, record),
        origin=origin_of(member.searched.over for member in members),
        received=received(files.paths),
        collapsed=collapsed_of(kept.get(SHARED)),
        is_timed=True,
    )


def sources_of(files: DayFiles, parts: Sequence[xr.Dataset]) -> tuple[SourceFile, ...]:
    """Files that a burst is read from: of its spacecraft, and of the days that its records reach into.

    Parameters
    ----------
    parts : sequence of Dataset
        What :func:`bella.bursts.timing.burst_spectrum` returns for each spacecraft.

    Returns
    -------
    tuple of SourceFile
        Of a folder that a user has brought, all files of the day.
    """
    if files.folder is not None:
        return files.sources
    days = {aware(time).date() for part in parts for time in part["time"].to_numpy()[[0, -1]]}
    names = {str(name) for part in parts for name in np.atleast_1d(part.attrs["source_files"])}
    return tuple(one for one in files.sources if one.day in days and one.uri in names)


def _directions(members: Sequence[Member], burst: AssociatedBurst, record: Burst) -> pd.DataFrame:
    start, band = burst.start_utc.to_datetime64(), (record.f_low_mhz, record.f_high_mhz)
    return burst_directions([one.searched.over for one in members], (start - SHOWN_BEFORE, start + SHOWN_AFTER), band)


def with_stated_positions(table: pd.DataFrame, searched: Sequence[Searched]) -> pd.DataFrame:
    """Fill in where spacecraft were as their files say, where these have positions that the ephemeris does not deny.

    Parameters
    ----------
    table : pandas.DataFrame
        Arrival table; is changed.
    searched : sequence of Searched
        Of its spacecraft.

    Returns
    -------
    pandas.DataFrame
        The same table. Between its times a spacecraft moves as in the ephemeris; one that is not there stands still.

    Raises
    ------
    NoDataError
        If neither file nor ephemeris knows where a spacecraft was.
    """
    utc = reference_utc(table)
    for one in searched:
        own = table["observatory"] == one.observatory
        there = receiver_position(one.over, utc)
        if not own.any() or there.source != "file":
            continue
        moved = np.zeros(3)
        if in_ephemeris(one):
            times = table.loc[own, "arrival_utc"].to_numpy("datetime64[ns]")
            moved = position_hee(one.observatory, times, utc) - position_hee(one.observatory, [utc], utc)
        table.loc[own, list(POSITION)] = there.position_rsun + moved
    return table


def _channel_tables(timed: Mapping[str, TimedBurst], members: Sequence[Member]) -> dict[str, pd.DataFrame]:
    tables = {}
    for edge, one in timed.items():
        try:
            tables[edge] = with_stated_positions(channel_arrivals(one), [member.searched for member in members])
        except (InputError, NoDataError) as error:  # the track is then fitted to t(f)
            log.warning("no channel edges for the track", edge=edge, reason=str(error))
    return tables


def _shown(members: Sequence[Member], burst: AssociatedBurst) -> xr.DataTree:
    """Spectra of a burst, for its page."""
    start = burst.start_utc.to_datetime64()
    parts = {}
    for searched in (member.searched for member in members):
        part = searched.over.drop_vars("noise_db").sel(time=slice(start - SHOWN_BEFORE, start + SHOWN_AFTER))
        parts[searched.observatory] = part.assign_attrs(
            source_files=", ".join(np.atleast_1d(part.attrs["source_files"]))
        )
    return xr.DataTree.from_dict(parts)


def known_bursts(catalogue: Catalogue, first: date, last: date) -> tuple[KnownBurst, ...]:
    """Bursts of the catalogue on days and near their midnights.

    Read once before days are processed, so that their names do not depend on which day is done first.

    Returns
    -------
    tuple of (str, datetime)
        By onset.
    """
    start = datetime.combine(first, time(), UTC) - SAME_ACROSS_MIDNIGHT
    stop = datetime.combine(last + DAY, time(), UTC) + SAME_ACROSS_MIDNIGHT
    # those of submissions are never refined; what was retracted keeps its id
    origins = frozenset(Origin) - {Origin.SUBMISSION}
    query = BurstQuery(start=start, stop=stop, limit=1000, origins=origins, with_retracted=True)
    return tuple((one.burst.burst_id, one.burst.start_utc) for one in all_bursts(catalogue, query))


def known_burst_ids(
    known: Iterable[KnownBurst], bursts: Sequence[AssociatedBurst], origin: Origin = Origin.ARCHIVE
) -> dict[str, str]:
    """Ids of bursts in the catalogue: of the one there which each is, or its own.

    Parameters
    ----------
    known : iterable of (str, datetime)
        Bursts of the catalogue that are of the same origin.
    bursts : sequence of AssociatedBurst
        Of one day.
    origin : Origin
        Of their data.

    Returns
    -------
    dict of str to str
        By the name of the burst; no id of the catalogue is given twice, but to the nearest.
    """
    apart = []
    for burst in bursts:
        start = aware(burst.start_utc.to_datetime64())
        for burst_id, onset in known:
            reach = SAME_BURST if onset.date() == start.date() else SAME_ACROSS_MIDNIGHT
            if abs(onset - start) < reach:
                apart.append((abs(onset - start), burst.burst_id, burst_id))
    names: dict[str, str] = {}
    for _, own, burst_id in sorted(apart):
        if own not in names and burst_id not in names.values():
            names[own] = burst_id
    return {burst.burst_id: burst_name(burst.burst_id, origin) for burst in bursts} | names


def detection_records(table: pd.DataFrame, verdicts: dict[str, tuple[str, str]]) -> list[Detection]:
    """Records of a detection table.

    Parameters
    ----------
    verdicts : dict of str to (str, str)
        By the name in the table: the id in the catalogue, and why the burst was not localised, empty if it was.
    """
    records = []
    for row in table.to_dict("records"):
        times = {name: _utc(row[name]) for name in ("start_utc", "peak_utc", "end_utc")}
        one = Detection(**{str(name): value for name, value in row.items()} | times)
        if one.burst_id in verdicts:
            known, reason = verdicts[one.burst_id]
            one = replace(one, burst_id=known, reason=reason, tier=CATALOGUED if reason else LOCALISABLE)
        records.append(one)
    return records


def _utc(time: pd.Timestamp) -> datetime:
    stamp: datetime = time.to_pydatetime()
    return stamp.replace(tzinfo=UTC)

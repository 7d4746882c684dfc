"""From the files of a day to its bursts: which files, what was heard, and the bursts that can be placed."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import structlog
import xarray as xr

import bella
from bella.bursts.association import AssociatedBurst, Member, associate, association_table
from bella.bursts.detection import search
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
from bella.catalogue import Burst, BurstQuery, Catalogue, Detection, SearchedDay, SourceFile
from bella.exceptions import BellaError, InputError, NoDataError
from bella.flags import CATALOGUED, LOCALISABLE
from bella.settings import Settings
from bella.spectra import by_observatory, open_spectra
from bella.spectra.archive import DayInMirror
from flows.directions import burst_directions
from flows.inputs import BurstInput, aware
from flows.solar_wind import day_digest

log = structlog.get_logger(__name__)

DAY = timedelta(days=1)
BEFORE, AFTER = np.timedelta64(30, "m"), np.timedelta64(3, "h")
"""How much of the days around it belongs to a day: bursts are alone or not, and go on past midnight."""

SAME_BURST = timedelta(minutes=10)
"""A burst that begins this near to one of the catalogue is that one, whatever later data say of its onset."""

SHOWN_BEFORE, SHOWN_AFTER = np.timedelta64(20, "m"), np.timedelta64(40, "m")
DETECTION_FIELDS = frozenset(one.name for one in fields(Detection))
EDGES = (SHARED, HALF_RISE, "half_maximum")
"""Definitions of the edge with which a burst is timed."""


@dataclass(frozen=True)
class DayFiles:
    """Files that hold a day and what of its neighbours belongs to it.

    Attributes
    ----------
    day : datetime.date
    paths : tuple of Path
    sources : tuple of SourceFile
    inputs_hash : str
        Of the contents of the files, and of what is known of the wind and the Sun around the day.
    """

    day: date
    paths: tuple[Path, ...]
    sources: tuple[SourceFile, ...]
    inputs_hash: str


@dataclass(frozen=True)
class HeardDay:
    """A day after the search.

    Attributes
    ----------
    files : DayFiles
    spectra : tuple of Dataset
        Over their background, of each spacecraft that had data.
    bursts : tuple of AssociatedBurst
        That begin on the day.
    table : DataFrame
        Detection table of the day.
    """

    files: DayFiles
    spectra: tuple[xr.Dataset, ...]
    bursts: tuple[AssociatedBurst, ...]
    table: pd.DataFrame

    @property
    def observatories(self) -> tuple[str, ...]:
        """Spacecraft that had data."""
        return tuple(str(one.attrs["observatory"]) for one in self.spectra)


def day_files(day: date, mirrored: Iterable[DayInMirror]) -> DayFiles:
    """Which files of a mirror a day is read from.

    Parameters
    ----------
    day : datetime.date
    mirrored : iterable of DayInMirror
        Of this day and those next to it.

    Returns
    -------
    DayFiles
        Without a path where the archive has nothing of the day itself.
    """
    found = {}
    is_there = False
    for outcome in mirrored:
        if abs(outcome.day - day) > DAY:
            continue
        is_there |= outcome.day == day and bool(outcome.files)
        for file in outcome.files:
            found[file.path] = SourceFile(
                outcome.dataset.key, outcome.day, _version(outcome, file.path), file.sha256, "done", file.path.name
            )
    paths = tuple(sorted(found)) if is_there else ()
    sources = tuple(found[path] for path in paths)
    text = "\n".join(sorted(source.sha256 for source in sources))
    return DayFiles(day, paths, sources, hashlib.sha256(text.encode()).hexdigest())


def with_surroundings(files: DayFiles, settings: Settings) -> DayFiles:
    """Files of a day whose checksum changes with the wind and the regions that its bursts are held against.

    Parameters
    ----------
    files : DayFiles
    settings : Settings

    Returns
    -------
    DayFiles
        The same one where nothing is known of them.
    """
    known = day_digest(files.day, settings)
    if not known:
        return files
    return replace(files, inputs_hash=hashlib.sha256(f"{files.inputs_hash}{known}".encode()).hexdigest())


def _version(outcome: DayInMirror, path: Path) -> str:
    days = (outcome.day, outcome.day - DAY, outcome.day + DAY)
    known = next(filter(None, (outcome.dataset.version(path.name, day) for day in days)), (1,))
    return ".".join(map(str, known))


def hear(files: DayFiles) -> HeardDay:
    """Read the spectra of a day, search them, and tell which spacecraft heard the same.

    Parameters
    ----------
    files : DayFiles

    Returns
    -------
    HeardDay

    Raises
    ------
    NoDataError
        If no file could be read, or none has a record of the day.
    """
    searched = [search(spectrum) for spectrum in day_spectra(files).values()]
    midnight = pd.Timestamp(files.day)
    bursts = [one for one in associate(searched) if midnight <= one.start_utc < midnight + DAY]
    table = association_table(bursts, searched)
    inside = (table["start_utc"] >= midnight) & (table["start_utc"] < midnight + DAY)
    kept = table[inside | (table["burst_id"] != "")].reset_index(drop=True)
    return HeardDay(files, tuple(one.over for one in searched), tuple(bursts), kept)


def day_spectra(files: DayFiles) -> dict[str, xr.Dataset]:
    """Spectra of a day with what of its neighbours belongs to it, one of each spacecraft that had data.

    Parameters
    ----------
    files : DayFiles

    Returns
    -------
    dict of str to xarray.Dataset
        By observatory. A file that cannot be read is left out.

    Raises
    ------
    NoDataError
        If no file could be read, or none has a record of the day.
    """
    found: list[xr.Dataset] = []
    for path in files.paths:
        try:
            found += open_spectra(path)
        except BellaError as error:  # one damaged file does not cost the day the others
            log.warning("file left out", file=path.name, reason=str(error))
    if not found:
        raise NoDataError(f"no file of {files.day} can be read: see the log, and fetch them again")
    midnight = np.datetime64(files.day, "ns")
    start, stop = midnight - BEFORE, midnight + np.timedelta64(1, "D") + AFTER
    parts = [part for one in found if (part := one.sel(time=slice(start, stop))).sizes["time"] > 1]
    whole = by_observatory(parts) if parts else {}
    heard = {name: one for name, one in whole.items() if _reaches(one, midnight)}
    if not heard:
        raise NoDataError(f"no file has a record of {files.day}: fetch the day again")
    return heard


def _reaches(spectrum: xr.Dataset, midnight: np.datetime64) -> bool:
    return bool(spectrum.sel(time=slice(midnight, midnight + np.timedelta64(1, "D"))).sizes["time"])


def place_burst(day: HeardDay, burst: AssociatedBurst, burst_id: str) -> BurstInput | str:
    """Time a burst that can be placed by what was heard of it.

    Parameters
    ----------
    day : HeardDay
    burst : AssociatedBurst
        Of tier "localisable".
    burst_id : str
        Name under which it goes into the catalogue.

    Returns
    -------
    BurstInput or str
        What localising starts from; or the reason why its edges do not place it.
    """
    members = [member for member in burst.members if member.fits]
    names = [member.searched.observatory for member in members]
    try:
        parts = [burst_spectrum(member.searched, member.candidate) for member in members]
        timed = {one.edge: one for edge in EDGES if (one := time_burst(parts, edge))}
    except NoDataError as error:
        return f"not localisable: {error}"
    reason = why_not_timed(timed[HALF_RISE], names)
    if reason:
        return reason
    arrivals, edges = {}, {}
    for edge, one in timed.items():
        if not why_not_timed(one, names):
            arrivals[edge] = arrival_table(one, shared_frequencies_mhz(one))
            edges[edge] = one.edges
    known = arrivals[HALF_RISE]
    record = Burst(
        burst_id,
        aware(burst.start_utc.to_datetime64()),
        aware(known["arrival_utc"].max().to_datetime64()),
        float(known["frequency_mhz"].min()),
        float(known["frequency_mhz"].max()),
        tuple(dict.fromkeys(known["observatory"])),
    )
    tables = _channel_tables({edge: timed[edge] for edge in arrivals})
    shown, directions = _shown(members, burst), _directions(members, burst, record)
    return BurstInput(record, arrivals, edges, shown, day.files.sources, channel_arrivals=tables, directions=directions)


def _directions(members: Sequence[Member], burst: AssociatedBurst, record: Burst) -> pd.DataFrame:
    start, band = burst.start_utc.to_datetime64(), (record.f_low_mhz, record.f_high_mhz)
    return burst_directions([one.searched.over for one in members], (start - SHOWN_BEFORE, start + SHOWN_AFTER), band)


def _channel_tables(timed: Mapping[str, TimedBurst]) -> dict[str, pd.DataFrame]:
    tables = {}
    for edge, one in timed.items():
        try:
            tables[edge] = channel_arrivals(one)
        except InputError as error:  # the track is then fitted to t(f)
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


def known_burst_ids(catalogue: Catalogue, bursts: Sequence[AssociatedBurst]) -> dict[str, str]:
    """Names of bursts in the catalogue: of the one there which each is, or its own.

    Parameters
    ----------
    catalogue : Catalogue
    bursts : sequence of AssociatedBurst
        Of one day.

    Returns
    -------
    dict of str to str
        By the name of the burst; no name of the catalogue is given twice, but to the nearest.
    """
    apart = []
    for burst in bursts:
        start = aware(burst.start_utc.to_datetime64())
        page = catalogue.bursts(BurstQuery(start=start - SAME_BURST, stop=start + SAME_BURST))
        apart += [(abs(one.burst.start_utc - start), burst.burst_id, one.burst.burst_id) for one in page.bursts]
    names: dict[str, str] = {}
    for _, own, known in sorted(apart):
        if own not in names and known not in names.values():
            names[own] = known
    return {burst.burst_id: burst.burst_id for burst in bursts} | names


def searched_record(files: DayFiles, spectra: Iterable[str]) -> SearchedDay:
    """What the catalogue keeps of a day that was searched.

    Parameters
    ----------
    files : DayFiles
    spectra : iterable of str
        Spacecraft that had data.

    Returns
    -------
    SearchedDay
    """
    return SearchedDay(files.day, files.inputs_hash, bella.__version__, tuple(spectra))


def detection_records(table: pd.DataFrame, verdicts: dict[str, tuple[str, str]]) -> list[Detection]:
    """Records of a detection table.

    Parameters
    ----------
    table : pandas.DataFrame
    verdicts : dict of str to (str, str)
        By the id in the table: the id in the catalogue, and why the burst was not placed, empty if it was.

    Returns
    -------
    list of Detection
    """
    records = []
    for row in table.to_dict("records"):
        times = {name: _utc(row[name]) for name in ("start_utc", "peak_utc", "end_utc")}
        one = Detection(**{str(name): value for name, value in row.items() if name in DETECTION_FIELDS} | times)
        if one.burst_id in verdicts:
            known, reason = verdicts[one.burst_id]
            one = replace(one, burst_id=known, reason=reason, tier=CATALOGUED if reason else LOCALISABLE)
        records.append(one)
    return records


def _utc(time: pd.Timestamp) -> datetime:
    stamp: datetime = time.to_pydatetime()
    return stamp.replace(tzinfo=UTC)

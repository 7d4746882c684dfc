"""Data releases: a catalogue frozen into a folder that can be cited, read without this package, and checked.

Everything comes from one moment of the catalogue and is written in one pass by ascending onset, under a hidden name
beside the final one. What was written is read back and compared; the checksums come last; then the folder is renamed.
"""

import fcntl
import hashlib
import json
import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, date, datetime, time, timedelta
from importlib.resources import files
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow.parquet as pq
import structlog
from jinja2 import Environment, StrictUndefined

from bella import __version__
from bella.catalogue import BurstQuery, BurstSummary, Catalogue
from bella.exceptions import BusyError, InputError, NoDataError, StoreError
from bella.flags import APPARENT_SOURCE
from bella.formats import (
    ARRIVALS,
    BURSTS,
    DAYS,
    DETECTIONS,
    EVENTS,
    LOCALISATIONS,
    TRACKS,
    RecordTable,
    Schema,
    find_format,
    record_table,
)
from bella.formats.binary import PARQUET_CODEC, arrow_schema, arrow_table, from_arrow
from bella.formats.release import DOI, SOFTWARE, Release, croissant, datacite, json_schema
from bella.pipeline.progress import counter
from bella.pipeline.rows import (
    Row,
    all_bursts,
    all_days,
    arrival_rows,
    burst_row,
    day_row,
    link_row,
    localisation_rows,
    track_rows,
)
from bella.records import REAL_ORIGINS, Origin
from bella.settings import Settings
from bella.store import SUFFIX, copy_group, flush_tree, open_group

TABLES = (BURSTS, TRACKS, LOCALISATIONS, ARRIVALS, EVENTS, DETECTIONS, DAYS)
WHOLE = (BURSTS, TRACKS, EVENTS)
"""Tables of a few rows per burst, which stand in one VOTable each beside the Parquet files of months."""

SUMS, RECORD, POSTERIORS, CALIBRATION = "SHA256SUMS", "release.json", "posteriors", "calibration.csv"
PIECE_ROWS = 5000
"""Rows that are in memory at a time, and in a row group of a file."""

_LABEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,39}")

log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Wanted:
    """What a release is to hold, and whose it is.

    Attributes
    ----------
    label : str
        Of the release, such as 2026.1.
    first, last : datetime.date or None
        Days of the onset; None for no bound.
    posteriors : bool
        Whether the posteriors themselves go with it: most of its size.
    creators : tuple of str
        Who made it: ``Family, Given`` for a person.
    licence : str
        Of the data, as SPDX names it.
    """

    label: str
    first: date | None = None
    last: date | None = None
    origins: tuple[Origin, ...] = REAL_ORIGINS
    posteriors: bool = True
    creators: tuple[str, ...] = (SOFTWARE,)
    publisher: str = SOFTWARE
    licence: str = "CC-BY-4.0"
    doi: str | None = None

    def __post_init__(self) -> None:
        for value, what, known in (
            (self.label, "2026.1: letters, digits, dots and hyphens, 40 at most", _LABEL),
            (self.licence, "CC-BY-4.0, as https://spdx.org/licenses names it", _LABEL),
            (self.doi or "10.5281/zenodo.1", "10.5281/zenodo.1234567", DOI),
        ):
            if known.fullmatch(value) is None:
                raise InputError(f"{value!r}: write it like {what}")
        if self.first and self.last and self.last < self.first:
            raise InputError(f"the last day, {self.last}, is before the first, {self.first}; exchange them")

    @property
    def query(self) -> BurstQuery:
        """Bursts that it is about."""
        start, stop = (
            datetime.combine(day, time(), UTC) if day else None
            for day in (self.first, self.last and self.last + timedelta(days=1))
        )
        return BurstQuery(start=start, stop=stop, origins=frozenset(self.origins), limit=200)


def make_release(settings: Settings, wanted: Wanted, parent: Path) -> Release:
    """Freeze the catalogue into a new folder.

    Parameters
    ----------
    parent : Path
        Folder that exists, and in which the release gets one of its own.

    Returns
    -------
    Release
        What was frozen; its folder, named after it, is whole and was read back.

    Raises
    ------
    InputError
        If the folder is there already, or its parent is not.
    NoDataError
        If there is no such burst.
    BusyError
        If another process makes the same release.
    StoreError
        If a posterior is damaged, or the disk refuses; nothing is left under the name of the release.
    """
    target = parent / f"bella-{wanted.label}"
    if not parent.is_dir():
        raise InputError(f"folder {parent} does not exist; make it or name another")
    if target.exists():
        raise InputError(f"{target} exists, and a release is never changed; give another label or folder")
    try:
        with _staging(target) as folder:
            release = _freeze(settings, wanted, folder)
            _describe(folder, release)
            _check_tables(folder, release)
            _write_sums(folder)
            flush_tree(folder)
            folder.rename(target)
    except OSError as error:
        if target.exists():
            raise InputError(
                f"{target} exists, and a release is never changed; give another label or folder"
            ) from error
        reason = os.strerror(error.errno) if error.errno else str(error).partition("\n")[0]
        raise StoreError(f"{target} cannot be written ({reason}); free the disk or name another folder") from error
    log.info("release made", folder=str(target), rows=release.rows, posteriors=release.posteriors)
    return release


@contextmanager
def _staging(target: Path) -> Iterator[Path]:
    """Hidden folder beside the final one: emptied of what a killed process left, and gone in the end."""
    folder = target.with_name(f".{target.name}.staging")
    folder.mkdir(exist_ok=True)
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # the system takes it from a process that is killed
        except BlockingIOError as error:
            raise BusyError(f"another process is making {target}: wait for it") from error
        for left in folder.iterdir():
            shutil.rmtree(left) if left.is_dir() else left.unlink()
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    finally:
        os.close(handle)


def _freeze(settings: Settings, wanted: Wanted, folder: Path) -> Release:
    """Write all tables and posteriors of one moment of the catalogue."""
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue, catalogue.snapshot():
        made = datetime.now(UTC)
        total = catalogue.bursts(wanted.query).total
        if total == 0:
            days = f"from {wanted.first or 'the first day'} to {wanted.last or 'the last'}"
            raise NoDataError(f"no burst {days} of origin {', '.join(wanted.origins)}: there is nothing to release")
        header = {"release": wanted.label, "frame": "HEE, solar radii; times UTC", "remark": APPARENT_SOURCE}
        with _Tables(folder, header) as tables:
            _freeze_days(catalogue, wanted, tables)
            frozen = _Bursts(catalogue, settings, folder, tables, with_posteriors=wanted.posteriors)
            advance = counter("release", total)
            for summary in all_bursts(catalogue, wanted.query):
                frozen.add(summary)
                advance(1)
        revision = catalogue.revision()
    first, last = (f"{one:%Y-%m-%dT%H:%M:%SZ}" for one in (frozen.onsets[0], frozen.onsets[-1]))
    return Release(
        release=wanted.label,
        made_utc=f"{made:%Y-%m-%dT%H:%M:%SZ}",
        code_version=__version__,
        catalogue_revision=revision,
        first_day=wanted.first and wanted.first.isoformat(),
        last_day=wanted.last and wanted.last.isoformat(),
        origins=wanted.origins,
        first_onset_utc=first,
        last_onset_utc=last,
        rows=tables.rows,
        posteriors=frozen.posteriors,
        creators=wanted.creators,
        publisher=wanted.publisher,
        licence=wanted.licence,
        doi=wanted.doi,
    )


def _freeze_days(catalogue: Catalogue, wanted: Wanted, tables: "_Tables") -> None:
    days = all_days(catalogue, wanted.first, wanted.last, wanted.origins)
    for day in sorted(days, key=lambda one: one.searched.day):
        month = f"{day.searched.day:%Y-%m}"
        tables.add(DAYS, month, [day_row(day)])
        found = catalogue.detections_of(day.searched.day, (day.searched.origin,))
        tables.add(DETECTIONS, month, map(asdict, found))


@dataclass
class _Bursts:
    """Bursts of a release by ascending onset, with what belongs to the preferred solution of each."""

    catalogue: Catalogue
    settings: Settings
    folder: Path
    tables: "_Tables"
    with_posteriors: bool
    posteriors: int = 0
    onsets: list[datetime] = field(default_factory=list)

    def add(self, summary: BurstSummary) -> None:
        """Write a burst, the events near it, its track, positions, arrival times and posterior."""
        self.onsets[1:] = [summary.burst.start_utc]
        month = f"{summary.burst.start_utc:%Y-%m}"
        self.tables.add(BURSTS, month, [burst_row(summary)])
        links = self.catalogue.events.of_burst(summary.burst.burst_id)
        self.tables.add(EVENTS, month, (link_row(one, summary) for one in links))
        solution = summary.preferred
        if solution is None:
            return
        self.tables.add(TRACKS, month, track_rows(self.catalogue, [summary]))
        self.tables.add(LOCALISATIONS, month, localisation_rows(self.catalogue, [solution]))
        root = self.settings.store_root
        if self.with_posteriors:
            copy_group(root, solution.store_path, solution.store_sha256, self.folder / POSTERIORS)
            self.posteriors += 1
        self.tables.add(ARRIVALS, month, arrival_rows(solution, open_group(root, solution.store_path)))


class _Tables:
    """The tables of a release as Parquet files, one for each month, written in pieces and read back.

    Attributes
    ----------
    rows : dict of str to int
        Rows of each table.
    """

    def __init__(self, folder: Path, header: dict[str, str]) -> None:
        self._files: dict[str, _MonthFile] = {}
        self._folder, self._header = folder, header
        self.rows = {one.name: 0 for one in TABLES}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        for file in self._files.values():
            file.close(check=kind is None)

    def add(self, schema: Schema, month: str, rows: Iterable[Row]) -> None:
        """Add rows of a month; months come one after the other."""
        file = self._files.get(schema.name)
        for row in rows:
            if file is None or file.month != month:
                if file is not None:
                    file.close(check=True)
                file = self._files[schema.name] = _MonthFile(self._folder, schema, month, self._header)
            file.add(row)
            self.rows[schema.name] += 1


class _MonthFile:
    """One Parquet file; what it was given is compared with what is in it when it is closed."""

    def __init__(self, folder: Path, schema: Schema, month: str, header: dict[str, str]) -> None:
        self.month = month
        self._schema, self._header = schema, header
        self._path = folder / schema.name / f"{month}.parquet"
        self._path.parent.mkdir(exist_ok=True)
        self._writer = pq.ParquetWriter(self._path, arrow_schema(schema, header), compression=PARQUET_CODEC)
        self._waiting: list[Row] = []
        self._digests: list[str] = []

    def add(self, row: Row) -> None:
        """Add a row; it is written with its piece."""
        self._waiting.append(row)
        if len(self._waiting) == PIECE_ROWS:
            self._write()

    def close(self, *, check: bool) -> None:
        """Write what waits, and read all of it back unless something failed before."""
        if check:
            self._write()
        self._writer.close()
        if check and [_digest(piece) for piece in _pieces(self._path, self._schema)] != self._digests:
            raise StoreError(f"{self._path} differs from the catalogue after it was written; check the disk")

    def _write(self) -> None:
        if self._waiting:
            piece = record_table(self._schema, self._waiting, self._header)
            self._writer.write_table(arrow_table(piece), row_group_size=PIECE_ROWS)
            self._digests.append(_digest(piece))
            self._waiting.clear()


def _pieces(path: Path, schema: Schema) -> Iterator[RecordTable]:
    with pq.ParquetFile(path) as file:
        for group in range(file.num_row_groups):
            yield from_arrow(schema, file.read_row_group(group))


def _digest(table: RecordTable) -> str:
    """Checksum of every value of a table."""
    found = hashlib.sha256()
    for name, values in table.data.items():
        found.update(f"{name} {len(values)}".encode())
        found.update("\0".join(values.tolist()).encode() if values.dtype.kind == "U" else values.tobytes())
    return found.hexdigest()


def _whole(folder: Path, schema: Schema) -> RecordTable:
    """All months of a table of one row per burst."""
    pieces = [piece for path in sorted((folder / schema.name).glob("*.parquet")) for piece in _pieces(path, schema)]
    if not pieces:
        return record_table(schema, [])
    columns = {name: np.concatenate([piece.data[name] for piece in pieces]) for name in schema.names}
    return RecordTable(schema, columns, {})


def _describe(folder: Path, release: Release) -> None:
    """Write VOTables, the record, metadata, calibration, licence and the page for people."""
    header = {"release": release.release, "frame": "HEE, solar radii; times UTC", "remark": APPARENT_SOURCE}
    for schema in WHOLE:
        table = _whole(folder, schema)
        whole = RecordTable(schema, table.data, header)
        (folder / f"{schema.name}.vot").write_bytes(find_format("votable").write(whole))
    calibration = files("bella.calibration").joinpath("found.csv").read_text(encoding="utf-8")
    (folder / CALIBRATION).write_text(calibration, encoding="utf-8")
    licence = f"{release.title}\n\nThe data are licensed under {release.licence}: {release.licence_url}\n"
    (folder / "LICENCE.txt").write_text(licence, encoding="utf-8")
    beside = [f"{one.name}.vot" for one in WHOLE] + [CALIBRATION]
    described = croissant(release, {name: _sha256(folder / name) for name in beside})
    _write_json(folder / RECORD, release.model_dump(mode="json"))
    _write_json(folder / "columns.schema.json", json_schema(TABLES))
    _write_json(folder / "datacite.json", datacite(release))
    _write_json(folder / "croissant.json", described)
    (folder / "index.html").write_text(_page(release), encoding="utf-8")


def _write_json(path: Path, value: dict[str, Any]) -> None:
    path.write_text(json.dumps(value, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _page(release: Release) -> str:
    template = files("bella.pipeline").joinpath("release.html").read_text(encoding="utf-8")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(template).render(release=release, tables=TABLES, whole=WHOLE)


def _write_sums(folder: Path) -> None:
    lines = [f"{_sha256(folder / name)}  {name}\n" for name in _names(folder)]
    (folder / SUMS).write_text("".join(lines), encoding="utf-8")


def _names(folder: Path) -> list[str]:
    """Files of a release without its checksums, by path."""
    found = (path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir())
    return sorted(name for name in found if name != SUMS)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def verify_release(folder: Path, advance: Callable[[int], None] = lambda _: None) -> Release:
    """Check a release: every file against its checksum, the tables against the record and against one another.

    Parameters
    ----------
    advance : callable
        Told 1 after each file.

    Returns
    -------
    Release
        What it says of itself.

    Raises
    ------
    InputError
        If the folder holds no release.
    StoreError
        If a file is changed, missing or not listed, or a table is not what the record says.
    """
    sums, record = folder / SUMS, folder / RECORD
    if not (sums.is_file() and record.is_file()):
        raise InputError(f"{folder} is not a release: it has no {SUMS} or no {RECORD}")
    try:
        listed = dict(line.split("  ", 1)[::-1] for line in sums.read_text(encoding="utf-8").splitlines())
        found = set(_names(folder))
        wrong = [f"{name} is missing" for name in listed.keys() - found]
        wrong += [f"{name} is not listed" for name in found - listed.keys()]
        for name in sorted(found & listed.keys()):
            wrong += [] if _sha256(folder / name) == listed[name] else [f"{name} is changed"]
            advance(1)
        if wrong:
            more = f", and {len(wrong) - 3} more" if len(wrong) > 3 else ""
            raise StoreError(f"{folder} is damaged: {', '.join(sorted(wrong)[:3])}{more}; get it again")
        release = Release.model_validate_json(record.read_text(encoding="utf-8"))
        _check_tables(folder, release)
    except (OSError, ValueError) as error:
        raise StoreError(f"{folder} is damaged ({str(error).partition(chr(10))[0]}); get it again") from error
    return release


def _check_tables(folder: Path, release: Release) -> None:
    """Compare the tables with the record, the VOTables with the Parquet files, and count the posteriors."""
    known = [schema for schema in TABLES if schema.name in release.rows]  # older releases have fewer tables
    for schema in known:
        paths = sorted((folder / schema.name).glob("*.parquet"))
        rows = sum(len(piece) for path in paths for piece in _pieces(path, schema))
        if rows != release.rows[schema.name]:
            raise StoreError(f"{schema.name} has {rows} rows, and not {release.rows[schema.name]} as {RECORD} says")
    for schema in (one for one in WHOLE if one in known):
        _compare_votable(folder / f"{schema.name}.vot", _whole(folder, schema))
    groups = sum(1 for _ in (folder / POSTERIORS).glob(f"*/*{SUFFIX}"))
    if groups != release.posteriors:
        raise StoreError(f"there are {groups} posteriors, and not {release.posteriors} as {RECORD} says")


def _compare_votable(path: Path, table: RecordTable) -> None:
    from astropy.io.votable import parse_single_table  # noqa: PLC0415 - heavy

    read = parse_single_table(path).to_table()
    for column in table.schema.columns:
        values = np.ma.filled(read[column.name], np.nan) if column.kind == "float" else list(read[column.name])
        given = [str(one).removesuffix("Z") for one in values] if column.kind == "time" else values
        expected = table.data[column.name]
        kind = "datetime64[us]" if column.kind == "time" else expected.dtype
        if not np.array_equal(np.array(given, dtype=kind), expected, equal_nan=column.kind != "text"):
            raise StoreError(f"{path.name}: column {column.name} is not that of the Parquet files")

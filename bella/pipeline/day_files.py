"""The inputs of a day: the newest whole files in the mirror, or the spectra that a user has brought in a folder.

What an archive answers today adds files to the mirror, or none; a listing, an outage or a 404 never takes one away.
What it answered is remembered beside the files, so that "no data" and "archive silent" can be told apart later and
without a network.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import date, timedelta
from pathlib import Path

import structlog

from bella.archive import Dataset, DayInMirror, fetch_days, find_datasets, open_archive, versions
from bella.archive.download import complaint
from bella.catalogue import SourceFile
from bella.exceptions import InputError, StoreError
from bella.pipeline.progress import counter
from bella.pipeline.surroundings import day_digest
from bella.records import Origin
from bella.settings import Settings
from bella.spectra import UserFolder, user_days

log = structlog.get_logger(__name__)

DAY = timedelta(days=1)
ANSWERS = ".answers"
"""Folder in the mirror with one file a day: what the archive answered last about each data set."""

USER_DATASET = Origin.USER.value
"""Name of the dataset of files that users bring."""

UNREACHABLE, NO_FOLDER = "unreachable", "no_folder"
"""Answers of an archive: it did not answer; it answered, and does not have the data set at all."""


@dataclass(frozen=True)
class DayFiles:
    """Files that hold a day and what of its neighbours belongs to it.

    Attributes
    ----------
    paths : tuple of Path
        Empty where the mirror has no file of the day itself.
    sources : tuple of SourceFile
        One for each path.
    inputs_hash : str
        Of the contents of the files, and of what is known of the wind and the Sun around the day.
    silent : tuple of str
        Data sets that could not be asked for, where the mirror has no file of the day.
    folder : UserFolder or None
        That the files are in, where a user has brought them; None for the mirror.
    came_s : float
        When the newest file of the mirror of the day itself came, s since 1970; 0 where there is none.
    """

    day: date
    paths: tuple[Path, ...]
    sources: tuple[SourceFile, ...]
    inputs_hash: str
    silent: tuple[str, ...] = ()
    folder: UserFolder | None = None
    came_s: float = 0.0

    @property
    def origin(self) -> Origin:
        """Where the files come from; what was simulated says so itself when it is read."""
        return Origin.ARCHIVE if self.folder is None else Origin.USER


def fetch_range(days: Sequence[date], archive: str, settings: Settings) -> tuple[str, ...]:
    """Bring the files of days, and of those next to them, into the mirror, and remember what the archive answered.

    Parameters
    ----------
    days : sequence of datetime.date
        In order, without a gap.
    archive : str
        URL or folder.

    Returns
    -------
    tuple of str
        Data sets that could not be asked for, each with the reason.

    Raises
    ------
    InputError
        If the archive is neither a URL nor a folder.
    StoreError
        If the mirror cannot be written.
    """
    opened = open_archive(archive, timeout_s=settings.archive_timeout_s, interval_s=settings.archive_interval_s)
    wanted = (days[0] - DAY, *days, days[-1] + DAY)
    datasets = [one for one in find_datasets(()) if any(one.covers(day) for day in wanted)]
    advance = counter("fetch", len(datasets) * len(wanted))
    try:
        outcomes = list(fetch_days(opened, datasets, wanted, settings.mirror_root, lambda: advance(1)))
    except InputError as error:
        raise StoreError(str(error)) from error
    silent = {one.dataset.key: one.message for one in outcomes if one.state == UNREACHABLE}
    for key, reason in silent.items():
        log.warning("not fetched", dataset=key, reason=reason)
    remember_answers(outcomes, settings.mirror_root)
    return tuple(f"{key}: {reason}" for key, reason in silent.items())


def remember_answers(outcomes: Iterable[DayInMirror], mirror: Path) -> None:
    """Keep what the archive answered about each data set and day, beside what it answered about others.

    Raises
    ------
    StoreError
        If it cannot be written.
    """
    by_day: dict[date, dict[str, str]] = {}
    for one in outcomes:
        by_day.setdefault(one.day, {})[one.dataset.key] = one.state
    try:
        (mirror / ANSWERS).mkdir(parents=True, exist_ok=True)
        for day, states in by_day.items():
            path = mirror / ANSWERS / f"{day}.json"
            staged = path.with_suffix(f".{os.getpid()}")
            staged.write_text(json.dumps(answers_of(day, mirror) | states, sort_keys=True), encoding="utf-8")
            staged.replace(path)
    except OSError as error:
        raise StoreError(f"mirror {mirror} cannot be written ({error.strerror}): make room and run again") from error


def answers_of(day: date, mirror: Path) -> dict[str, str]:
    """What the archive answered last about a day, by data set; empty where it was never asked."""
    try:
        found = json.loads((mirror / ANSWERS / f"{day}.json").read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):  # a damaged note costs another request, no more
        return {}
    return {str(name): str(state) for name, state in found.items()}


class Mirror:
    """The mirror as one run sees it: each folder is listed once."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._root = settings.mirror_root
        self._names: dict[Path, tuple[str, ...]] = {}
        self._datasets = find_datasets(())

    def day(self, day: date) -> DayFiles:
        """Which files of the mirror a day is read from.

        Raises
        ------
        StoreError
            If the mirror, or a file in it, cannot be read.
        """
        try:
            found = {
                (dataset.key, other): self.newest(dataset, other)
                for dataset in self._datasets
                for other in (day - DAY, day, day + DAY)
            }
            came_s = [one[0].stat().st_ctime for (_, other), one in found.items() if one and other == day]
            asked = answers_of(day, self._root)
        except OSError as error:
            raise StoreError(f"mirror {self._root} cannot be read ({error}): repair it and run again") from error
        own = {key for (key, other), source in found.items() if source and other == day}
        known = sorted(source for source in found.values() if source) if own else []
        text = "\n".join(sorted({source.sha256 for _, source in known}))
        asked = {one.key: asked.get(one.key, UNREACHABLE) for one in self._datasets if one.covers(day)}
        files = DayFiles(
            day,
            tuple(path for path, _ in known),
            tuple(source for _, source in known),
            hashlib.sha256(text.encode()).hexdigest(),
            () if own else _silent(asked),
            came_s=max(came_s, default=0.0),
        )
        return with_surroundings(files, self._settings)

    def newest(self, dataset: Dataset, day: date) -> "tuple[Path, SourceFile] | None":
        """Newest whole file of a data set and day; None where there is none.

        Raises
        ------
        OSError
            If the folder or the file cannot be read.
        """
        stamp = f"{day:%Y%m%d}"
        found = [
            (version, self._root / folder / name)
            for folder in dataset.folders(day)
            for name in self._listed(self._root / folder)
            if stamp in name and (version := dataset.version(name, day)) is not None
        ]
        for version, path in sorted(found, reverse=True):
            sha256 = _sha256_if_whole(path)
            if sha256 is not None:
                said = ".".join(map(str, version))
                return path, SourceFile(dataset.key, day, said, sha256, "done", path.name)
            log.warning("file of the mirror left out", file=path.name, reason="it is not whole")
        return None

    def _listed(self, folder: Path) -> tuple[str, ...]:
        if folder not in self._names:
            try:
                self._names[folder] = tuple(sorted(entry.name for entry in folder.iterdir()))
            except FileNotFoundError:
                self._names[folder] = ()
        return self._names[folder]


def _silent(asked: dict[str, str]) -> tuple[str, ...]:
    """Data sets that may have files of a day although the mirror has none; all, where the archive has no folder."""
    silent = tuple(key for key, state in asked.items() if state == UNREACHABLE)
    return silent or (tuple(asked) if set(asked.values()) == {NO_FOLDER} else ())


def _sha256_if_whole(path: Path) -> str | None:
    """Checksum of a file: that which was recorded when it came, else its own; None where it is cut or damaged."""
    recorded = versions(path)
    if recorded and recorded[-1].size_bytes == path.stat().st_size:
        return recorded[-1].sha256
    return None if complaint(path, path.name) else _sha256(path)


def _sha256(path: Path) -> str:
    """Checksum of a file; of a folder, such as a Zarr store, that of the names and checksums of its files."""
    if path.is_dir():
        files = sorted(one for one in path.rglob("*") if one.is_file())
        text = "\n".join(f"{one.relative_to(path)} {_sha256(one)}" for one in files)
        return hashlib.sha256(text.encode()).hexdigest()
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def check_content(path: Path, source: SourceFile) -> str:
    """Read a file through, and say what is wrong with its content.

    Returns
    -------
    str
        Empty where it is what its checksum says.

    Raises
    ------
    StoreError
        If it cannot be read: that is the disk, not the file.
    """
    try:
        sha256 = _sha256(path)
    except OSError as error:
        raise StoreError(f"{path} cannot be read ({error.strerror}): check the disk and run again") from error
    return "" if sha256 == source.sha256 else f"{path.name} is not what its checksum says: fetch it again"


def with_surroundings(files: DayFiles, settings: Settings) -> DayFiles:
    """Files of a day whose checksum changes with the wind and the regions that its bursts are compared with.

    Returns
    -------
    DayFiles
        The same one where nothing is known of them.
    """
    known = day_digest(files.day, settings)
    if not known:
        return files
    return replace(files, inputs_hash=hashlib.sha256(f"{files.inputs_hash}{known}".encode()).hexdigest())


class BroughtFolder:
    """A folder of spectra as one run sees it: each file is looked through once.

    Raises
    ------
    InputError
        If there is no such folder, or nothing in it can be read.
    """

    def __init__(self, folder: Path, settings: Settings) -> None:
        self._settings = settings
        self._folder: UserFolder = user_days(folder)
        self._name = folder
        self._sums: dict[Path, str] = {}

    @property
    def left_out(self) -> tuple[str, ...]:
        """Files that cannot be read, each with its reason."""
        return tuple(one.removeprefix("left out: ") for one in self._folder.left_out)

    @property
    def others(self) -> tuple[str, ...]:
        """Names of files that are not looked at and do not look like data."""
        return self._folder.others

    def days(self, first: date | None, last: date | None) -> Sequence[date]:
        """Days of [first, last] with records, in order.

        Raises
        ------
        InputError
            If there are none.
        """
        held = self._folder.days
        wanted = [day for day in held if (first is None or first <= day) and (last is None or day <= last)]
        if not wanted:
            raise InputError(f"{self._name} has no record of these days: it has those from {held[0]} to {held[-1]}")
        return wanted

    def day(self, day: date) -> DayFiles:
        """Which files of the folder a day is read from.

        Raises
        ------
        StoreError
            If a file cannot be read.
        """
        paths = tuple(one.path for one in self._folder.of(day))
        sums = [self._sha256(path) for path in paths]
        sources = [
            SourceFile(USER_DATASET, day, "1", one, "done", path.name) for path, one in zip(paths, sums, strict=True)
        ]
        text = "\n".join([USER_DATASET, *sorted(sums)])
        inputs_hash = hashlib.sha256(text.encode()).hexdigest()
        files = DayFiles(day, paths, tuple(sources), inputs_hash, folder=self._folder)
        return with_surroundings(files, self._settings)

    def _sha256(self, path: Path) -> str:
        if path not in self._sums:
            try:
                self._sums[path] = _sha256(path)
            except OSError as error:
                raise StoreError(f"{path} cannot be read ({error.strerror}): check the disk and run again") from error
        return self._sums[path]

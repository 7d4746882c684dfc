"""The archive: which files it has of a day, and a mirror of them.

There are three answers, and they are never mixed up: the file is there; the archive was asked and has no such file yet;
the archive did not answer (:class:`~bella.exceptions.UnreachableError`). The last is not "no data" and is not kept: the
next run asks again.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Literal

from bella.archive.datasets import Dataset
from bella.archive.download import MirrorFile, Times, download, is_due_again
from bella.archive.manners import Manners
from bella.archive.sources import FolderSource, Source, open_source
from bella.exceptions import UnreachableError

DayState = Literal["fetched", "unchanged", "replaced", "no_file_yet", "not_covered", "unreachable", "no_folder"]
UNANSWERED: frozenset[DayState] = frozenset({"unreachable", "no_folder"})
"""States that say nothing of a day, so that it has to be asked for again."""


class NoFolderError(UnreachableError):
    """The archive answers, and has none of the folders of a data set."""


@dataclass(frozen=True)
class DayFiles:
    """What the archive has of a day.

    Attributes
    ----------
    paths : tuple of str
        Newest version of each file that holds a part of the day, that of the day first, relative to the root of the
        archive. Empty: the archive lists its folder and has no file of this day.
    due : datetime.date or None
        Day when the file usually is, or was, there; None where the data set does not reach to this day.
    complete : bool
        Whether the files of neighbouring days that are needed are there too.
    """

    paths: tuple[str, ...]
    due: date | None
    complete: bool


@dataclass(frozen=True)
class DayInMirror:
    """What became of a day of a data set.

    Attributes
    ----------
    day : datetime.date
        The day.
    state : str
        ``fetched``, ``unchanged`` or ``replaced``: the files are in the mirror. ``no_file_yet``: the archive has none.
        ``not_covered``: the data set has ended, or begins later. ``unreachable``: not known, ask again. ``no_folder``:
        the archive answers, and has none of the folders of the data set; not known either.
    files : tuple of MirrorFile
        Files in the mirror, that of the day first; none from :meth:`Archive.renew` where nothing had to be asked.
    due : datetime.date or None
        Day when the file usually is there.
    complete : bool
        Whether the files of neighbouring days that are needed are there too.
    message : str
        Why the archive could not be asked; empty otherwise.
    """

    dataset: Dataset
    day: date
    state: DayState
    files: tuple[MirrorFile, ...] = ()
    due: date | None = None
    complete: bool = False
    message: str = ""


class Archive:
    """An archive as one run sees it: a folder is listed once, a file asked for once.

    Parameters
    ----------
    manners : Manners
        Pace and patience.
    now : datetime.datetime, optional
        What records give as the time of this run; the time of day of this machine when not given.
    """

    def __init__(self, source: Source, manners: Manners, now: datetime | None = None) -> None:
        self._source = source
        self._manners = manners
        self._now = now
        self._listed_at: dict[str, datetime] = {}
        self._listed: dict[str, frozenset[str] | UnreachableError | None] = {}
        self._fetched: dict[str, MirrorFile] = {}

    def find(self, dataset: Dataset, day: date) -> DayFiles:
        """Which files hold a day.

        Parameters
        ----------
        day : datetime.date
            The day, UTC.

        Returns
        -------
        DayFiles
            A positive answer of the archive, also where there is no file; what no folder lists is taken to be there.

        Raises
        ------
        UnreachableError
            If the archive did not answer, or does not have the folder of the data set at all.
        """
        if not dataset.covers(day):
            return DayFiles((), None, complete=False)
        if dataset.question:
            return DayFiles((dataset.file_name(day),), dataset.due(day), complete=True)
        own = self._newest(dataset, day)
        if own is None:
            return DayFiles((), dataset.due(day), complete=False)
        others = [self._newest(dataset, other) for other in dataset.neighbours(day)]
        paths = (own, *(path for path in others if path is not None))
        return DayFiles(paths, dataset.due(day), complete=None not in others)

    def fetch(self, dataset: Dataset, day: date, mirror: Path) -> DayInMirror:
        """Bring the files of a day into a mirror.

        Parameters
        ----------
        day : datetime.date
            The day, UTC.
        mirror : pathlib.Path
            Folder of the mirror; it keeps the folders of the archive.

        Returns
        -------
        DayInMirror
            Never in a state of `UNANSWERED`.

        Raises
        ------
        UnreachableError
            If the archive did not answer, or gave something else than the files.
        InputError
            If the mirror cannot be written.
        """
        found = self.find(dataset, day)
        if not found.paths:
            return DayInMirror(dataset, day, "no_file_yet" if found.due else "not_covered", due=found.due)
        files = tuple(self._download(path, mirror, dataset.asked(day)) for path in found.paths)
        states = {file.state for file in files}
        state: DayState = "replaced" if "replaced" in states else "fetched" if "fetched" in states else "unchanged"
        return DayInMirror(dataset, day, state, files, found.due, found.complete)

    def renew(self, dataset: Dataset, day: date, mirror: Path) -> DayInMirror:
        """Bring the file of a day into a mirror where it is new, has another version, or is due to be asked for again.

        Only the listing of its folder is asked for where the file is there already. Files of neighbouring days are
        those of other calls.

        Parameters
        ----------
        day : datetime.date
            The day, UTC.

        Returns
        -------
        DayInMirror
            Never in a state of `UNANSWERED`.

        Raises
        ------
        UnreachableError, InputError
            As :meth:`fetch`.
        """
        if not dataset.covers(day):
            return DayInMirror(dataset, day, "not_covered")
        now, due = self._now or datetime.now(UTC), dataset.due(day)
        path = dataset.file_name(day) if dataset.question else self._newest(dataset, day)
        if path is None:
            return DayInMirror(dataset, day, "no_file_yet", due=due)
        # what grows is asked for in every round; a service has all of a period when that is over, an archive does not
        grows = dataset.period != "day" and not (dataset.question and dataset.due(dataset.span(day)[1]) < now.date())
        if not grows and not is_due_again(mirror / path, now):
            return DayInMirror(dataset, day, "unchanged", due=due)
        file = self._download(path, mirror, dataset.asked(day))
        return DayInMirror(dataset, day, file.state, (file,), due)

    def _download(self, path: str, mirror: Path, question: str) -> MirrorFile:
        if path not in self._fetched:
            now = self._now or datetime.now(UTC)
            times = Times(now, self._listed_at.get(path.rpartition("/")[0], now))
            self._fetched[path] = download(self._source, self._manners, path, mirror, times, question)
        return self._fetched[path]

    def _newest(self, dataset: Dataset, day: date) -> str | None:
        """Path of the newest version, or None if the archive says that there is none."""
        found: list[tuple[tuple[int, ...], str]] = []
        folders = dataset.folders(day)
        listings = {folder: self._names(folder) for folder in folders}
        for folder, names in listings.items():
            for name in sorted(names or ()):
                version = dataset.version(name, day)
                if version is not None:
                    found.append((version, f"{folder}/{name}"))
        if all(names is None for names in listings.values()) and not any(map(self._lacks_year, folders)):
            raise NoFolderError(f"the archive has no folder {folders[0]}: it was moved, or --archive is wrong")
        return max(found, key=lambda one: one[0])[1] if found else None

    def _lacks_year(self, folder: str) -> bool:
        """Whether a folder above is there and does not have this one: year or month have not begun in the archive."""
        above, _, own = folder.rpartition("/")
        names = self._names(above)
        if names is None:
            return above.rpartition("/")[2].isdecimal() and self._lacks_year(above)
        return own not in names

    def _names(self, folder: str) -> frozenset[str] | None:
        """Names in a folder; a failure is raised again for the rest of this run, not taken for an empty folder."""
        if folder not in self._listed:
            try:
                self._listed[folder] = self._manners.persist(lambda: self._source.names(folder))
                self._listed_at[folder] = self._now or datetime.now(UTC)
            except UnreachableError as error:
                self._listed[folder] = error
        known = self._listed[folder]
        if isinstance(known, UnreachableError):
            raise known
        return known


def unanswered(dataset: Dataset, day: date, error: UnreachableError) -> DayInMirror:
    """What became of a day of a data set where asking for it raised an error.

    Returns
    -------
    DayInMirror
        In state ``unreachable``, or ``no_folder`` where the archive did answer.
    """
    state: DayState = "no_folder" if isinstance(error, NoFolderError) else "unreachable"
    return DayInMirror(dataset, day, state, due=dataset.due(day), message=str(error))


def open_archive(
    root: str, *, timeout_s: float = 30.0, interval_s: float = 1.0, now: datetime | None = None
) -> Archive:
    """Open an archive; nothing is asked yet.

    Parameters
    ----------
    root : str
        URL or folder below which ``pub/data/...`` is.
    timeout_s : float, optional
        Longest silence of the archive, s.
    interval_s : float, optional
        Least time between two requests to an archive behind HTTP, s.
    now : datetime.datetime, optional
        What records give as the time of this run.

    Returns
    -------
    Archive
        The archive, for one run.

    Raises
    ------
    InputError
        If the root is neither a URL nor a folder.
    """
    source = open_source(root, timeout_s)
    return Archive(source, Manners(0.0 if isinstance(source, FolderSource) else interval_s), now)


def fetch_days(
    archive: Archive,
    datasets: Iterable[Dataset],
    days: Iterable[date],
    mirror: Path,
    advance: Callable[[], None] = lambda: None,
) -> Iterator[DayInMirror]:
    """Bring days of several data sets into a mirror; an archive that does not answer for one does not stop the others.

    Parameters
    ----------
    datasets : iterable of Dataset
        Data sets.
    days : iterable of datetime.date
        Days, UTC.
    advance : callable, optional
        Called after each day of each data set.

    Yields
    ------
    DayInMirror
        By data set, then day.

    Raises
    ------
    InputError
        If the mirror cannot be written.
    """
    wanted = tuple(days)
    for dataset in datasets:
        for day in wanted:
            try:
                outcome = archive.fetch(dataset, day, mirror)
            except UnreachableError as error:
                outcome = unanswered(dataset, day, error)
            advance()
            yield outcome

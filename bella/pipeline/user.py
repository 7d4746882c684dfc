"""The inputs of a day where users bring the spectra themselves: files of a folder, of any instrument."""

import hashlib
from collections.abc import Sequence
from datetime import date
from pathlib import Path

from bella.catalogue import SourceFile
from bella.exceptions import InputError, StoreError
from bella.pipeline.mirror import DayFiles, with_surroundings
from bella.records import Origin
from bella.settings import Settings
from bella.spectra import UserFolder, user_days

DATASET = Origin.USER.value
"""Name of the dataset of files that users bring."""


class BroughtFolder:
    """A folder of spectra as one run sees it: each file is looked through once.

    Parameters
    ----------
    folder : Path
    settings : Settings

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

        Parameters
        ----------
        day : datetime.date

        Returns
        -------
        DayFiles

        Raises
        ------
        StoreError
            If a file cannot be read.
        """
        paths = tuple(one.path for one in self._folder.of(day))
        sums = [self._sha256(path) for path in paths]
        sources = [SourceFile(DATASET, day, "1", one, "done", path.name) for path, one in zip(paths, sums, strict=True)]
        text = "\n".join([DATASET, *sorted(sums)])
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


def _sha256(path: Path) -> str:
    """Checksum of a file; of a folder, such as a Zarr store, that of the names and checksums of its files."""
    if path.is_dir():
        files = sorted(one for one in path.rglob("*") if one.is_file())
        text = "\n".join(f"{one.relative_to(path)} {_sha256(one)}" for one in files)
        return hashlib.sha256(text.encode()).hexdigest()
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()

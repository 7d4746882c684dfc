"""Spectra that users bring in a folder: which days it holds, and each day with its receivers and their positions."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np
import xarray as xr

from bella.exceptions import BellaError, InputError, NoDataError
from bella.records import Origin
from bella.spectra.cf_files import ZARR_MARKS
from bella.spectra.combination import by_observatory_of_what_fits
from bella.spectra.positions import ReceiverPosition, receiver_position
from bella.spectra.products import find_product, open_spectra

ENDINGS = (".nc", ".nc4", ".netcdf", ".cdf", ".cdf.gz")
BEFORE, AFTER = np.timedelta64(30, "m"), np.timedelta64(3, "h")
"""How much of the days around it belongs to a day: bursts are alone or not, and go on past midnight."""


@dataclass(frozen=True)
class UserFile:
    """A file of a folder: what it holds, without its values."""

    path: Path
    observatories: tuple[str, ...]
    first: np.datetime64
    last: np.datetime64


@dataclass(frozen=True)
class UserDay:
    """A day of a folder."""

    day: date
    spectra: dict[str, xr.Dataset]
    """By observatory, all its receivers together, of origin ``user``; with the ends of the days around it."""
    positions: dict[str, ReceiverPosition]
    """At noon, or the record next to it; :func:`bella.spectra.receiver_position` gives those of other times."""
    files: tuple[Path, ...]
    left_out: tuple[str, ...]
    """One line for each file that cannot be read or joined, and each spacecraft without a position."""


@dataclass(frozen=True)
class UserFolder:
    """What a folder of spectra holds."""

    files: tuple[UserFile, ...]
    left_out: tuple[str, ...]
    """One line for each file that cannot be read; those of other endings are not looked at."""

    @property
    def days(self) -> tuple[date, ...]:
        """Days with records, ascending."""
        held: set[date] = set()
        for file in self.files:
            # a record at midnight alone is the end of a day
            end = max(file.first, file.last - np.timedelta64(1, "ns"))
            span = np.arange(file.first.astype("M8[D]"), end.astype("M8[D]") + 1)
            held.update(one.item() for one in span)
        return tuple(sorted(held))

    def of(self, day: date) -> tuple[UserFile, ...]:
        """Files that hold a day and what of its neighbours belongs to it."""
        first, last = _span(day)
        return tuple(file for file in self.files if file.first < last and file.last >= first)

    def read(self, day: date) -> UserDay:
        """The spectra of a day.

        Parameters
        ----------
        day : datetime.date

        Returns
        -------
        UserDay

        Raises
        ------
        NoDataError
            If the folder has no record of it.
        """
        begin = np.datetime64(day, "ns")
        first, last = _span(day)
        parts, used, left_out = [], [], []
        for file in self.of(day):
            try:
                found = open_spectra(file.path)
            except BellaError as error:  # it could be read when the folder was looked through
                left_out.append(f"left out: {error}")
                continue
            for spectrum in found:
                time = spectrum["time"].to_numpy()
                part = spectrum.isel(time=np.flatnonzero((time >= first) & (time < last)))
                if part.sizes["time"] > 1:
                    parts.append(part.assign_attrs(origin=_origin(part)))
                    used.append(file.path)
        if not parts:
            raise NoDataError(f"the folder has no record of {day}")
        end = begin + np.timedelta64(1, "D")
        whole, unfit = by_observatory_of_what_fits(parts)
        left_out += [f"left out: {one}" for one in unfit]
        spectra = {name: one for name, one in whole.items() if _has_records(one, begin, end)}
        positions = {}
        for name, spectrum in spectra.items():
            try:
                positions[name] = receiver_position(spectrum, _near_noon(spectrum, begin))
            except NoDataError as error:
                left_out.append(f"left out of positions: {error}")
        return UserDay(day, spectra, positions, tuple(dict.fromkeys(used)), tuple(left_out))


def _span(day: date) -> tuple[np.datetime64, np.datetime64]:
    """The day with what of its neighbours belongs to it."""
    begin = np.datetime64(day, "ns")
    return begin - BEFORE, begin + np.timedelta64(1, "D") + AFTER


def user_days(folder: Path) -> UserFolder:
    """Look through a folder of spectra of any instrument: netCDF, Zarr, and files of the archives.

    Parameters
    ----------
    folder : pathlib.Path
        One file for each spacecraft and day, or longer; subfolders count.

    Returns
    -------
    UserFolder

    Raises
    ------
    InputError
        If there is no such folder, or nothing in it can be read.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder: name one with netCDF or Zarr files of dynamic spectra")
    files, left_out = [], []
    for path in _candidates(folder):
        try:
            spectra = open_spectra(path)
        except (BellaError, OSError) as error:
            left_out.append(f"left out: {error}")
            continue
        times = [one["time"].to_numpy() for one in spectra]
        names = tuple(dict.fromkeys(str(one.attrs["observatory"]) for one in spectra))
        files.append(UserFile(path, names, min(one[0] for one in times), max(one[-1] for one in times)))
    if not files:
        reason = left_out[0] if left_out else f"its files do not end in {', '.join(ENDINGS)} or .zarr"
        raise InputError(f"{folder} holds no spectrum that can be read ({reason}): see 'bella formats'")
    return UserFolder(tuple(files), tuple(left_out))


def _candidates(folder: Path) -> Iterator[Path]:
    """Zarr stores and files that may hold spectra, in order of their names."""
    for path in sorted(folder.iterdir()):
        if path.name.startswith("."):
            continue
        if path.is_dir():
            is_store = any((path / mark).is_file() for mark in ZARR_MARKS)
            yield from (path,) if is_store else _candidates(path)
        elif path.name.lower().endswith(ENDINGS) or find_product(path.name) is not None:
            yield path


def _near_noon(spectrum: xr.Dataset, begin: np.datetime64) -> np.datetime64:
    time = spectrum["time"].to_numpy()
    return np.datetime64(min(max(begin + np.timedelta64(12, "h"), time[0]), time[-1]))


def _has_records(spectrum: xr.Dataset, begin: np.datetime64, end: np.datetime64) -> bool:
    time = spectrum["time"].to_numpy()
    return bool(((time >= begin) & (time < end)).any())


def _origin(spectrum: xr.Dataset) -> str:
    """What users bring is theirs, whichever archive it came from; only what was simulated stays so."""
    kept = {Origin.SIMULATED.value, Origin.TEST.value}
    stated = str(spectrum.attrs.get("origin", ""))
    return stated if stated in kept else Origin.USER.value

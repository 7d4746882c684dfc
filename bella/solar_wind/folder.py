"""What folders of published files say of the wind and the Sun at a time: hourly speeds, active regions, coronal holes.

The name of a file says what it holds. Hourly speeds: the beginning is that of a spacecraft (``omni``, ``wind``, ``sta``
or ``stereoa``, ``stb`` or ``stereob``, ``psp``, ``solo``; dashes and underscores do not count), the ending ``.lst``,
``.dat`` or ``.txt``. Active regions: ``YYYYMMDDSRS.txt``, as NOAA names them. Coronal holes:
``coronal-holes-YYYYMMDDTHHMM.csv``. Folders below are looked into; whatever else is there is not looked at.
"""

import hashlib
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd

from bella.exceptions import InputError, NoDataError
from bella.solar_wind.assimilation import HALF_ROTATION
from bella.solar_wind.observations import hourly_speeds
from bella.solar_wind.source_regions import SourceRegion, read_active_regions, read_coronal_holes
from bella.spacecraft import coverage

BEGINNINGS = {
    "omni": "WIND",
    "wind": "WIND",
    "stereoa": "STEREO-A",
    "sta": "STEREO-A",
    "stereob": "STEREO-B",
    "stb": "STEREO-B",
    "psp": "PSP",
    "solo": "SOLO",
}
"""Observatory by the beginning of a name; hourly OMNI is taken as measured where Wind is, at L1."""

ENDINGS = (".lst", ".dat", ".txt")
SUMMARY_NAME = re.compile(r"(\d{8})SRS\.txt", re.IGNORECASE)
HOLES_NAME = re.compile(r"coronal-holes-(\d{8}T\d{4})\.csv", re.IGNORECASE)
OLDEST_REGIONS = np.timedelta64(48, "h")
"""Regions of a time further away than this are not turned to that of a burst: they may be gone."""

HALF_HOUR, NEAREST_HOUR = np.timedelta64(30, "m"), np.timedelta64(6, "h")
FILES_KEPT = 256
LARGEST_LIST, LARGEST_REGIONS = 256 << 20, 1 << 20
"""Bytes: OMNI 2 of all years has 180 MB, and a summary of regions a few kB."""


@dataclass(frozen=True)
class UsedFile:
    """A file, or several of one spacecraft, that something was taken from.

    Attributes
    ----------
    kind : str
        ``in_situ_speed``, ``solar_region_summary`` or ``coronal_holes``.
    name : str
        Names of the files.
    sha256 : str
        Of what was taken: of speeds, the hours of the rotation alone; of regions, the whole file.
    """

    kind: str
    name: str
    sha256: str


@dataclass(frozen=True)
class InSitu:
    """Hourly speeds of one rotation.

    Attributes
    ----------
    speeds : dict of str to pandas.Series
        By observatory, km/s by UTC.
    used : tuple of UsedFile
    left_out : tuple of str
        What could not be read, and why.
    reason : str
        Why there is no speed; empty where there is one.
    """

    speeds: dict[str, pd.Series]
    used: tuple[UsedFile, ...]
    left_out: tuple[str, ...]
    reason: str = ""

    def at(self, utc: np.datetime64) -> dict[str, float]:
        """Speeds measured at a time.

        Parameters
        ----------
        utc : numpy.datetime64

        Returns
        -------
        dict of str to float
            By observatory, km/s, of the hour that holds it, or the nearest one with a measurement within six hours.
        """
        found = {}
        for name, series in self.speeds.items():
            apart = np.abs(series.index.to_numpy() - (utc - HALF_HOUR))
            if apart.min() <= NEAREST_HOUR:
                found[name] = float(series.iloc[int(apart.argmin())])
        return found


@dataclass(frozen=True)
class Regions:
    """Active regions and coronal holes about a time.

    Attributes
    ----------
    regions : tuple of SourceRegion
        At the time for which their file states them.
    used : tuple of UsedFile
    left_out : tuple of str
    reason : str
        Why there is no file; empty where there is one.
    """

    regions: tuple[SourceRegion, ...]
    used: tuple[UsedFile, ...]
    left_out: tuple[str, ...]
    reason: str = ""


def speeds_around(folder: Path | None, utc: np.datetime64, half: np.timedelta64 = HALF_ROTATION) -> InSitu:
    """Hourly speeds of every spacecraft that a folder has for one rotation.

    Parameters
    ----------
    folder : Path or None
    utc : numpy.datetime64
        Middle of the rotation.
    half : numpy.timedelta64
        How much before it, and after it.

    Returns
    -------
    InSitu
        One that is empty says why; a file that cannot be read is left out.
    """
    if folder is None:
        return InSitu({}, (), (), "no folder of hourly speeds in situ is named: set BELLA_IN_SITU")
    parts: dict[str, list[tuple[Path, pd.Series]]] = {}
    left_out = []
    for path, observatory in _speed_files(folder):
        try:
            seen = _sized(path, LARGEST_LIST)
            series = _within(_hourly(path, seen.st_mtime_ns, seen.st_size), utc, half)
            series = _placed(series, observatory)
        except (InputError, NoDataError, OSError) as error:
            left_out.append(_why(path, error))
            continue
        if len(series):
            parts.setdefault(observatory, []).append((path, series))
    speeds = {name: _joined([series for _, series in parts[name]]) for name in sorted(parts)}
    used = tuple(_used_speeds(name, [path for path, _ in parts[name]], speeds[name]) for name in speeds)
    return InSitu(speeds, used, tuple(left_out), "" if speeds else _no_speeds(folder, utc, left_out))


def _why(path: Path, error: Exception) -> str:
    """Why a file is left out, in one line that begins with its name."""
    said = (error.strerror or "cannot be read") if isinstance(error, OSError) else str(error)
    return f"left out: {said if said.startswith(path.name) else f'{path.name}, {said}'}"


def _speed_files(folder: Path) -> list[tuple[Path, str]]:
    found = []
    for path in _files_below(folder):
        plain = re.sub(r"[-_]", "", path.name.lower())
        names = [name for beginning, name in BEGINNINGS.items() if plain.startswith(beginning)]
        if names:
            found.append((path, names[0]))
    return sorted(found)


def _files_below(folder: Path) -> Iterator[Path]:
    """Files, in any order, whose name may be one of those that are read: of folders of many others little is made."""
    for below, _, names in os.walk(folder):
        yield from (Path(below, name) for name in names if name.lower().endswith((*ENDINGS, ".csv")))


def _sized(path: Path, largest: int) -> os.stat_result:
    """What is known of a file that can be read at once.

    Raises
    ------
    InputError
        If it is no plain file, which may never end, or larger than any of its kind.
    OSError
        If it cannot be looked at.
    """
    seen = path.stat()
    if not stat.S_ISREG(seen.st_mode):
        raise InputError(f"{path.name} is not a file: give one in its place")
    if seen.st_size > largest:
        raise InputError(f"{path.name} has {seen.st_size} bytes, too many for what its name says it holds")
    return seen


@lru_cache(FILES_KEPT)
def _hourly(path: Path, _changed_ns: int, _size: int) -> pd.Series:
    """Speeds of a file that has not changed since; a burst after another asks for the same years."""
    return hourly_speeds(path)


def _within(series: pd.Series, utc: np.datetime64, half: np.timedelta64) -> pd.Series:
    hours = series.index.to_numpy()
    return series[(hours >= utc - half) & (hours < utc + half)]


def _placed(series: pd.Series, observatory: str) -> pd.Series:
    """Speeds at hours at which the ephemeris knows where the spacecraft was."""
    known, hours = coverage(observatory), series.index.to_numpy()
    placed = series[(hours >= known.start) & (hours <= known.stop)]
    if len(series) and not len(placed):
        raise NoDataError(f"no position of {observatory} is known then; bella update-ephemeris may bring it")
    return placed


def _joined(parts: list[pd.Series]) -> pd.Series:
    """Of an hour that several files have, the value of the last."""
    whole: pd.Series = pd.concat(parts)
    return whole[~whole.index.duplicated(keep="last")].sort_index()


def _used_speeds(observatory: str, paths: list[Path], series: pd.Series) -> UsedFile:
    text = observatory + "".join(f"\n{hour:%Y-%m-%dT%H} {speed:.2f}" for hour, speed in series.items())
    names = ", ".join(dict.fromkeys(path.name for path in paths))
    return UsedFile("in_situ_speed", names, hashlib.sha256(text.encode()).hexdigest())


def _no_speeds(folder: Path, utc: np.datetime64, left_out: list[str]) -> str:
    if not folder.is_dir():
        return "the folder of hourly speeds is not there: name it in BELLA_IN_SITU"
    if left_out:
        return left_out[0]
    return (
        f"no file of BELLA_IN_SITU has a speed of the rotation around {utc.astype('datetime64[D]')}: "
        f"add hourly lists whose names begin with {', '.join(BEGINNINGS)}"
    )


def regions_around(folder: Path | None, utc: np.datetime64, within: np.timedelta64 = OLDEST_REGIONS) -> Regions:
    """Active regions and coronal holes that a folder has for a time.

    Parameters
    ----------
    folder : Path or None
    utc : numpy.datetime64
    within : numpy.timedelta64
        How far the time of a file may be from it.

    Returns
    -------
    Regions
        Of the nearest file of each kind; one that is empty says why; a file that cannot be read is left out, and the
        next one taken.
    """
    if folder is None:
        return Regions((), (), (), "no folder of active regions and coronal holes is named: set BELLA_REGIONS")
    regions: list[SourceRegion] = []
    used, left_out = [], []
    for kind, files in region_files(folder, utc, within).items():
        for path, time in files:
            try:
                sha256 = region_sha256(path)
                found = read_active_regions(path) if kind == "solar_region_summary" else read_coronal_holes(path, time)
                used.append(UsedFile(kind, path.name, sha256))
            except (InputError, OSError) as error:
                left_out.append(_why(path, error))
                continue
            regions += found
            break
    return Regions(tuple(regions), tuple(used), tuple(left_out), "" if used else _no_regions(folder, utc, left_out))


def region_files(
    folder: Path, utc: np.datetime64, within: np.timedelta64 = OLDEST_REGIONS
) -> dict[str, list[tuple[Path, np.datetime64]]]:
    """Files of regions of a folder whose time, by their name, is near another.

    Parameters
    ----------
    folder : Path
    utc : numpy.datetime64
    within : numpy.timedelta64

    Returns
    -------
    dict of str to list of (Path, numpy.datetime64)
        By kind, nearest first.
    """
    kinds = {"solar_region_summary": SUMMARY_NAME, "coronal_holes": HOLES_NAME}
    found: dict[str, list[tuple[Path, np.datetime64]]] = {kind: [] for kind in kinds}
    for path in _files_below(folder):
        for kind, name in kinds.items():
            time = _named_time(name.fullmatch(path.name))
            if time is not None and abs(time - utc) <= within:
                found[kind].append((path, time))
    return {kind: sorted(files, key=lambda file: (abs(file[1] - utc), file[0])) for kind, files in found.items()}


def region_sha256(path: Path) -> str:
    """Checksum of a file of regions.

    Parameters
    ----------
    path : Path

    Returns
    -------
    str
        Hexadecimal SHA-256.

    Raises
    ------
    InputError
        If it is no plain file, or too large to be one of regions.
    OSError
        If it cannot be read.
    """
    _sized(path, LARGEST_REGIONS)
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _named_time(match: "re.Match[str] | None") -> np.datetime64 | None:
    time = pd.to_datetime(match[1], errors="coerce") if match else pd.NaT
    return None if pd.isna(time) else time.to_datetime64()


def _no_regions(folder: Path, utc: np.datetime64, left_out: list[str]) -> str:
    if not folder.is_dir():
        return "the folder of region summaries is not there: name it in BELLA_REGIONS"
    if left_out:
        return left_out[0]
    day = str((utc + np.timedelta64(12, "h")).astype("datetime64[D]")).replace("-", "")
    return f"BELLA_REGIONS has no region summary within two days of the burst: add NOAA's {day}SRS.txt"

"""Solar wind speeds measured in situ: hourly lists as archives export them, and the folder in which they are found.

The name of a file states what it holds: it begins with the name of a spacecraft (``omni``, ``wind``, ``sta`` or
``stereoa``, ``stb`` or ``stereob``, ``psp``, ``solo``; dashes and underscores are ignored) and ends in ``.lst``,
``.dat`` or ``.txt``, or, as the hourly data of OMNI and COHO come from SPDF, in ``.cdf``. Subfolders count; other files
are ignored.
"""

import hashlib
import io
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from bella.containers import ANOTHER, open_cdf
from bella.exceptions import InputError, NoDataError
from bella.solar_wind.assimilation import HALF_ROTATION
from bella.spacecraft import coverage
from bella.spectra.assembly import dates_in
from bella.spectra.beside import epoch_of

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
"""Observatory by the beginning of a name; hourly OMNI counts as measured at Wind, at L1."""

CDF_ENDINGS = (".cdf", ".cdf.gz")
ENDINGS = (".lst", ".dat", ".txt", *CDF_ENDINGS)

CDF_SPEEDS = ("V", "plasmaSpeed", "ProtonSpeed", "flow_speed", "Flow_Speed", "V_proton", "SW_Speed", "bulkSpeed")
"""Names of the speed in the hourly CDFs of OMNI, COHO and HelioWeb (SPDF), the first with data is taken."""

KM_S = {"": 1.0, "km/s": 1.0, "kms": 1.0, "km/sec": 1.0, "m/s": 1e-3, "ms": 1e-3}
"""Units of speed, letters and strokes only, in km/s."""

LONGEST_CDF = np.timedelta64(366, "D")
"""Files are named after their first day; the longest have a year."""

HALF_HOUR, NEAREST_HOUR = np.timedelta64(30, "m"), np.timedelta64(6, "h")
"""A speed is that of the middle of its hour; one within six hours of a burst is used for it."""

PROMPT, PART = np.timedelta64(12, "h"), np.timedelta64(5, "D")
"""Speeds up to half a day after a burst are used as they come, later ones by five days, all after the rotation.

A list that grows by a day then changes the wind of a burst three times in place of thirteen. In 2012-05 to 2012-07 the
days that are missing at most change the speed along a track by 0.3 of its error, 0.7 in one case of ten.
"""

FILES_KEPT = 256
LARGEST_LIST = 256 << 20
"""Bytes: OMNI 2 of all years has 180 MB."""

FILL_KM_S = 9999.0
SHORT_FILL_KM_S, LOW_FILL_KM_S, MOST_FILLS = 999.9, -999.0, 3
"""Fill value of lists with narrow columns, what all below it are, and most different ones that a list has."""

SPACE_AGE = 1960, 2060
OF_A_YEAR = re.compile(r"omni2?_(\d{4})\.")
BLANKS = str.maketrans(",;", "  ")
FASTEST_KM_S = 3000.0
COLUMNS = ("year", "day_of_year", "hour", "speed_km_s")
OMNI2_COLUMNS = range(55, 60)
OMNI2_PLACES = (0, 1, 2, 24)
"""Places of these four in a record of the yearly OMNI 2 files, to which words were added at the end over the years."""


def hourly_speeds(path: Path) -> pd.Series:
    """Read hourly speeds: lines of year, day of year, hour and speed in km/s, as OMNIWeb and COHOWeb export lists.

    Parameters
    ----------
    path : Path
        Blanks between the columns; 9999 or more where there is no measurement. The yearly files of OMNI 2
        (``omni2_YYYY.dat``, 55 words and more) are read as they are, as are the CDFs of OMNI and COHO.

    Returns
    -------
    pandas.Series
        km/s by the UTC start of each hour, ascending; hours without a measurement are left out.

    Raises
    ------
    InputError
        If the file does not hold four columns of numbers, or an hour or speed is impossible.
    NoDataError
        If no hour has a measurement.
    """
    if path.name.lower().endswith(CDF_ENDINGS):
        return _speeds_of_cdf(path)
    frame = _numbers(path)
    speed = frame["speed_km_s"]
    valid = frame[(speed > LOW_FILL_KM_S) & (speed < FILL_KM_S) & (speed != SHORT_FILL_KM_S)]
    if valid.empty and speed.nunique() <= MOST_FILLS:
        raise NoDataError(f"{path.name} holds no hour with a speed: choose another interval")
    if valid.empty or not valid["speed_km_s"].between(1.0, FASTEST_KM_S).all():
        raise InputError(f"{path.name} holds speeds that no solar wind has: give km/s, and 9999 for no measurement")
    speeds = pd.Series(valid["speed_km_s"].to_numpy(), index=_utc(valid, path), name=path.stem).sort_index()
    return speeds[~speeds.index.duplicated()]


def _speeds_of_cdf(path: Path) -> pd.Series:
    """Speeds of a CDF, as the mean of what was measured in each hour."""
    with open_cdf(path) as cdf:
        name = cdf.first_with_data(*CDF_SPEEDS)
        if not name:
            held = [one for one in CDF_SPEEDS if one in cdf.variables]
            if held:
                raise NoDataError(f"{path.name} holds no hour with a speed: choose another interval")
            raise InputError(f"{path.name} has no speed of the solar wind: give hourly data of OMNI or COHO")
        unit = re.sub(r"[^a-z/]", "", cdf.attribute("UNITS", name).lower())
        if unit not in KM_S:
            raise InputError(f"{path.name}: {name} is in {unit!r}: give km/s")
        speed, utc = cdf.numbers(name, 1).astype(np.float64) * KM_S[unit], cdf.utc(epoch_of(cdf, name))
    if speed.shape != utc.shape:
        raise InputError(f"{path.name}: {speed.size} speeds for {utc.size} times; {ANOTHER}")
    known = np.isfinite(speed) & ~np.isnat(utc) & (speed < FILL_KM_S)
    if not known.any():
        raise NoDataError(f"{path.name} holds no hour with a speed: choose another interval")
    _check_days(path, utc[known])
    if not ((speed[known] >= 1.0) & (speed[known] <= FASTEST_KM_S)).all():
        raise InputError(f"{path.name} holds speeds that no solar wind has: give km/s, and 9999 for no measurement")
    hours = pd.DatetimeIndex(utc[known].astype("datetime64[h]").astype("datetime64[ns]"))
    return pd.Series(speed[known], index=hours, name=path.stem).groupby(level=0).mean().rename(path.stem)


def _check_days(path: Path, utc: npt.NDArray[np.datetime64]) -> None:
    """Hold times against the day in the name of the file, of which it is the first."""
    first, last = utc.min(), utc.max()
    for day in dates_in(path.name):
        if not first - LONGEST_CDF <= day <= last + LONGEST_CDF:
            raise InputError(
                f"{path.name} is named after {str(day)[:10]}, but has speeds from {str(first)[:10]} to "
                f"{str(last)[:10]}: its clock or its name is wrong; {ANOTHER}"
            )


def _numbers(path: Path) -> pd.DataFrame:
    try:
        try:
            frame = _table(path)
        except ValueError:  # a heading, or other separators, which a list of many years does not have
            lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
            rows = [line.translate(BLANKS) for line in lines if line.strip()[:1].isdecimal()]
            frame = _table(io.StringIO("\n".join(rows)))
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path.name} cannot be read ({reason}): give year, day of year, hour, speed") from error
    if frame.shape[1] in OMNI2_COLUMNS:
        frame = frame.iloc[:, list(OMNI2_PLACES)]
    if frame.shape[1] != len(COLUMNS):
        raise InputError(f"{path.name} has {frame.shape[1]} columns: give year, day of year, hour, speed")
    return frame.set_axis(list(COLUMNS), axis=1)


def _table(source: Path | io.StringIO) -> pd.DataFrame:
    return pd.read_csv(source, sep=r"\s+", header=None, comment="#", dtype=np.float64)


def _utc(frame: pd.DataFrame, path: Path) -> pd.DatetimeIndex:
    year = frame["year"]
    days = 365 + ((year % 4 == 0) & ((year % 100 != 0) | (year % 400 == 0)))
    possible = frame["day_of_year"].between(1, days) & frame["hour"].between(0, 23) & year.between(*SPACE_AGE)
    stated = OF_A_YEAR.match(path.name.lower())
    if stated and not (year == int(stated[1])).any():
        raise InputError(
            f"{path.name} is named after {stated[1]}, but begins in {year.iloc[0]:.0f}: its name or its content is "
            "wrong; download it again"
        )
    if not possible.all():
        raise InputError(
            f"{path.name}, line {int(np.argmin(possible)) + 1}: no such hour; give year, day of year, hour"
        )
    start = pd.to_datetime(frame["year"].astype(int).astype(str), format="%Y")
    elapsed = (frame["day_of_year"] - 1) * 24 + frame["hour"]
    return pd.DatetimeIndex(start + pd.to_timedelta(elapsed, unit="h"))


@dataclass(frozen=True)
class UsedFile:
    """An input file, or several of one spacecraft.

    Attributes
    ----------
    kind : str
        ``in_situ_speed``, ``solar_region_summary`` or ``coronal_holes``.
    name : str
        Names of the files.
    sha256 : str
        Checksum of the speeds of the rotation, or of the whole file of regions.
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
    left_out : tuple of str
        Files that could not be read, with the reason.
    reason : str
        Why there is no speed; empty where there is one.
    """

    speeds: dict[str, pd.Series]
    used: tuple[UsedFile, ...]
    left_out: tuple[str, ...]
    reason: str = ""

    def at(self, utc: np.datetime64) -> dict[str, float]:
        """Speeds measured at a time.

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


def speeds_around(folder: Path | None, utc: np.datetime64, half: np.timedelta64 = HALF_ROTATION) -> InSitu:
    """Hourly speeds of every spacecraft that a folder has for one rotation.

    Parameters
    ----------
    utc : numpy.datetime64
        Middle of the rotation: time of a burst.
    half : numpy.timedelta64
        How much before it, and after it; what is more than half a rotation is what the time of the burst may be off.

    Returns
    -------
    InSitu
        Empty with a reason where there is none; a file that cannot be read is left out.
    """
    if folder is None:
        return InSitu({}, (), (), "no folder of hourly speeds in situ is named: set BELLA_IN_SITU")
    parts: dict[str, list[tuple[Path, pd.Series]]] = {}
    left_out = []
    for path, observatory in _speed_files(folder):
        try:
            seen = check_readable(path, LARGEST_LIST)
            series = _within(_hourly(path, seen.st_mtime_ns, seen.st_size), utc, half)
            series = _placed(series, observatory)
        except (InputError, NoDataError, OSError) as error:
            left_out.append(why_left_out(path, error))
            continue
        if len(series):
            parts.setdefault(observatory, []).append((path, series))
    speeds = {name: _whole_parts(_joined([one for _, one in parts[name]]), utc, half) for name in sorted(parts)}
    used = tuple(_used_speeds(name, [path for path, _ in parts[name]], speeds[name]) for name in speeds)
    return InSitu(speeds, used, tuple(left_out), "" if speeds else _no_speeds(folder, utc, left_out))


def why_left_out(path: Path, error: Exception) -> str:
    """Why a file is left out, in one line that begins with its name."""
    said = (error.strerror or "cannot be read") if isinstance(error, OSError) else str(error)
    return f"left out: {said if said.startswith(path.name) else f'{path.name}, {said}'}"


def _speed_files(folder: Path) -> list[tuple[Path, str]]:
    found = []
    for path in files_below(folder):
        plain = re.sub(r"[-_]", "", path.name.lower())
        names = [name for beginning, name in BEGINNINGS.items() if plain.startswith(beginning)]
        if names:
            found.append((path, names[0]))
    return sorted(found)


def files_below(folder: Path) -> Iterator[Path]:
    """Files below a folder whose names end like those that are read, in any order."""
    for below, _, names in os.walk(folder):
        yield from (Path(below, name) for name in names if name.lower().endswith((*ENDINGS, ".csv")))


def check_readable(path: Path, largest: int) -> os.stat_result:
    """Status of a file that can be read without risk.

    Raises
    ------
    InputError
        If it is no regular file, such as a pipe, or too large.
    OSError
        If its status cannot be read.
    """
    seen = path.stat()
    if not stat.S_ISREG(seen.st_mode):
        raise InputError(f"{path.name} is not a file: give one in its place")
    if seen.st_size > largest:
        raise InputError(f"{path.name} has {seen.st_size} bytes, too many for what its name says it holds")
    return seen


@lru_cache(FILES_KEPT)
def _hourly(path: Path, _changed_ns: int, _size: int) -> pd.Series:
    """Speeds of a file, kept until it changes: many bursts need the same years."""
    return hourly_speeds(path)


def _within(series: pd.Series, utc: np.datetime64, half: np.timedelta64) -> pd.Series:
    hours = series.index.to_numpy()
    return series[(hours >= utc - half) & (hours < utc + half)]


def _placed(series: pd.Series, observatory: str) -> pd.Series:
    """Speeds of the hours that the ephemeris covers."""
    known, hours = coverage(observatory), series.index.to_numpy()
    placed = series[(hours >= known.start) & (hours <= known.stop)]
    if len(series) and not len(placed):
        raise NoDataError(f"no position of {observatory} is known then; bella update-ephemeris may bring it")
    return placed


def _joined(parts: list[pd.Series]) -> pd.Series:
    """All hours; where several files have the same hour, the value of the last."""
    whole: pd.Series = pd.concat(parts)
    return whole[~whole.index.duplicated(keep="last")].sort_index()


def _whole_parts(series: pd.Series, utc: np.datetime64, half: np.timedelta64) -> pd.Series:
    """Hours up to the last part after a burst that has come whole."""
    hours, begin = series.index.to_numpy(), utc + half - HALF_ROTATION + PROMPT
    if hours[-1] < begin or hours[-1] >= utc + half - NEAREST_HOUR:
        return series
    whole: pd.Series = series[hours < begin + (hours[-1] - begin) // PART * PART]
    return whole


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

"""Active regions and coronal holes near which a burst may have started, as longitude extents at a time.

Active regions come from the Solar Region Summary of NOAA, coronal holes from a table with the columns
``hole_id, lon_min_deg, lon_max_deg, lat_min_deg, lat_max_deg, polarity, source``: Stonyhurst degrees, west and north
positive, lines that begin with ``#`` are comments. Where ``lon_min_deg`` is larger than ``lon_max_deg`` a hole lies
across the far side.
"""

import hashlib
import re
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import astropy.units as u
import numpy as np
import pandas as pd

from bella.csv_tables import parse_table, read_table_text
from bella.exceptions import InputError
from bella.solar_wind.in_situ import UsedFile, check_readable, files_below, why_left_out
from bella.spectra.assembly import dates_in
from bella.units import within_half_turn_deg

HOLE_NUMBERS = ("lon_min_deg", "lon_max_deg", "lat_min_deg", "lat_max_deg")
HOLE_COLUMNS = ("hole_id", *HOLE_NUMBERS, "polarity", "source")
LEAST_EXTENT_DEG = 2.0
"""A region without an extent, such as a plage, is given this: positions are whole degrees."""

SUMMARY_NAME = re.compile(r"(\d{8})SRS\.txt", re.IGNORECASE)
HOLES_NAME = re.compile(r"coronal-holes-(\d{8}T\d{4})\.csv", re.IGNORECASE)
OLDEST_REGIONS = np.timedelta64(48, "h")
"""Regions of a time further away are not used: an active region may have appeared or decayed."""

SECTION = re.compile(r"\s*#?\s*(I{1,3}|IA)\.\s", re.IGNORECASE)
REGION = re.compile(r"\s*(\d{1,5})\s+([NS])(\d{2})\s*([EW])(\d{2})\b(.*)", re.IGNORECASE)
ISSUED = re.compile(r":\s*Issued\s*:\s*(\d{4} [A-Z][a-z]{2} \d{1,2})\b", re.IGNORECASE)

NO_REGION = "99999"
WRAP = 10_000
"""Summaries print four digits: the number after 9999 was 0000."""

NUMBER_BY_YEAR = ((1972.0, 1), (1996.0, 7_940), (2002.45, 10_000), (2014.2, 12_000), (2022.3, 13_000), (2025.1, 14_000))
"""Numbers of regions through the years: 10000 was given on 2002-06-14."""

REGIONS_PER_YEAR = 300.0

LARGEST_REGIONS = 1 << 20
"""Bytes: a summary of regions has a few kB."""


@dataclass(frozen=True)
class SourceRegion:
    """An active region or coronal hole.

    Attributes
    ----------
    name : str
        Such as ``11493``, or the identifier of a hole.
    kind : str
        ``active region`` or ``coronal hole``.
    longitude_deg, latitude_deg : float
        Stonyhurst coordinates of the middle, degrees, west and north positive.
    width_deg, height_deg : float
        Extents in longitude and latitude; the summary of NOAA has no extent in latitude, there it is NaN.
    utc : numpy.datetime64
        Time of this position.
    remark : str
        Magnetic class, or polarity and source of a hole.
    """

    name: str
    kind: str
    longitude_deg: float
    latitude_deg: float
    width_deg: float
    height_deg: float
    utc: np.datetime64
    remark: str

    def at(self, utc: np.datetime64) -> "SourceRegion":
        """Region at another time, rotated with the differential rotation of the Sun.

        Returns
        -------
        SourceRegion
            With its Stonyhurst longitude in (-180, 180].

        Notes
        -----
        Rotation of magnetic features at their latitude: Howard, Harvey & Forgach 1990, Sol. Phys. 130, 295,
        doi:10.1007/BF00156795, less the motion of Earth.
        """
        # sunpy takes half a second to import, and its rotation is a longitude that wraps: ask for a day of it
        from sunpy.sun.models import differential_rotation  # noqa: PLC0415

        per_day = differential_rotation(1 * u.day, self.latitude_deg * u.deg, frame_time="synodic")
        turned = self.longitude_deg + float(per_day.to_value(u.deg)) * float((utc - self.utc) / np.timedelta64(1, "D"))
        return replace(self, longitude_deg=within_half_turn_deg(turned), utc=utc)


def read_active_regions(path: Path) -> list[SourceRegion]:
    """Active regions of a Solar Region Summary of NOAA.

    Parameters
    ----------
    path : Path
        The text file; regions that are due to return have no position and are left out.

    Returns
    -------
    list of SourceRegion
        Where they were at the end of the day before the issue, as the summary states.

    Raises
    ------
    InputError
        If the file is not a Solar Region Summary.
    """
    try:
        lines = path.read_text(encoding="latin-1").splitlines()
    except OSError as error:
        raise InputError(f"{path.name} cannot be read ({error.strerror}): give the text file of NOAA") from error
    issued = next(filter(None, (_issued(line) for line in lines)), None)
    headings = {found[1].upper() for found in map(SECTION.match, lines) if found}
    if issued is None or not {"I", "IA"} <= headings:
        raise InputError(f"{path.name} is not a Solar Region Summary: give the text file of NOAA")
    days = dates_in(path.name)
    if days and all(abs(np.datetime64(issued, "ns") - day) > np.timedelta64(1, "D") for day in days):
        raise InputError(
            f"{path.name} is named after {str(days[0])[:10]}, but was issued on {issued:%Y-%m-%d}: rename it, or "
            "download it again"
        )
    regions, section = [], ""
    for line in lines:
        heading = SECTION.match(line)
        section = heading[1].upper() if heading else section
        row = REGION.match(line) if section in {"I", "IA"} else None
        # rows that are no region (remarks, five nines) are left out; there was a region 9999
        if row and row[1] != NO_REGION and int(row[3]) <= 90:
            regions.append(_active_region(row, issued, spotless=section == "IA"))
    return regions


def _issued(line: str) -> datetime | None:
    """Day that a line states as that of issue; None where it states none."""
    found = ISSUED.match(line)
    try:
        return datetime.strptime(found[1], "%Y %b %d") if found else None  # noqa: DTZ007 - UTC, as all times here
    except ValueError:
        return None


def _active_region(row: "re.Match[str]", issued: datetime, *, spotless: bool) -> SourceRegion:
    words = [] if spotless else row[6].split()
    numbers = [word for word in words[2:] if word.isdecimal()]  # after Carrington longitude and area: extent, spots
    width = float(numbers[0]) if numbers else 0.0
    names = [word for word in words if not word.isdecimal()]
    sign = {"N": 1.0, "S": -1.0, "W": 1.0, "E": -1.0}
    return SourceRegion(
        name=str(_region_number(int(row[1]), issued)),
        kind="active region",
        longitude_deg=sign[row[4].upper()] * float(row[5]),
        latitude_deg=sign[row[2].upper()] * float(row[3]),
        width_deg=max(width, LEAST_EXTENT_DEG),
        height_deg=float("nan"),
        utc=np.datetime64(issued, "ns"),
        remark="plage" if spotless else (names[-1] if names else "no magnetic class"),
    )


def _region_number(number: int, issued: datetime) -> int:
    """Number of a region from its last four digits, as near as possible to that of its time."""
    if number >= WRAP:
        return number
    years = [float(year) for year, _ in NUMBER_BY_YEAR]
    now = issued.year + issued.timetuple().tm_yday / 366.0
    expected = float(np.interp(now, years, [known for _, known in NUMBER_BY_YEAR]))
    expected += REGIONS_PER_YEAR * max(0.0, now - years[-1])
    return number + WRAP * max(0, round((expected - number) / WRAP))


def read_coronal_holes(path: Path, utc: np.datetime64) -> list[SourceRegion]:
    """Coronal holes from a table of their extents.

    Parameters
    ----------
    path : Path
        CSV with the columns that the module describes.
    utc : numpy.datetime64
        Time of the image in which they were measured.

    Raises
    ------
    InputError
        If the file cannot be read, a column is missing, or a row has no possible extent.
    """
    frame = parse_table(read_table_text(path), path.name)
    missing = [name for name in HOLE_COLUMNS if name not in frame.columns]
    if missing:
        raise InputError(f"{path.name}: column {missing[0]} is missing; needed are {', '.join(HOLE_COLUMNS)}")
    for name in HOLE_NUMBERS:
        frame[name] = pd.to_numeric(frame[name], errors="coerce")
    limits = {"lon": 180.0, "lat": 90.0}
    possible = np.all([frame[name].abs() <= limits[name[:3]] for name in HOLE_NUMBERS], axis=0)
    bad = np.flatnonzero(~possible | (frame["lat_min_deg"] > frame["lat_max_deg"]))
    if bad.size:
        raise InputError(f"{path.name}: row {bad[0] + 1} has no possible extent; give Stonyhurst degrees, least first")
    return [_hole(row, utc) for _, row in frame.iterrows()]


def _hole(row: "pd.Series[float]", utc: np.datetime64) -> SourceRegion:
    width = float(row["lon_max_deg"] - row["lon_min_deg"])
    width = width if width == 360.0 else width % 360.0  # a hole at a pole goes all the way round
    middle = float(row["lon_min_deg"]) + 0.5 * width
    return SourceRegion(
        name=str(row["hole_id"]),
        kind="coronal hole",
        longitude_deg=within_half_turn_deg(middle),
        latitude_deg=0.5 * float(row["lat_min_deg"] + row["lat_max_deg"]),
        width_deg=width,
        height_deg=float(row["lat_max_deg"] - row["lat_min_deg"]),
        utc=utc.astype("datetime64[ns]"),
        remark=f"polarity {row['polarity']}, {row['source']}",
    )


@dataclass(frozen=True)
class Regions:
    """Active regions and coronal holes about a time.

    Attributes
    ----------
    regions : tuple of SourceRegion
        At the time of their file.
    reason : str
        Why there is no file; empty where there is one.
    """

    regions: tuple[SourceRegion, ...]
    used: tuple[UsedFile, ...]
    left_out: tuple[str, ...]
    reason: str = ""


def regions_around(folder: Path | None, utc: np.datetime64, within: np.timedelta64 = OLDEST_REGIONS) -> Regions:
    """Active regions and coronal holes that a folder has for a time.

    Parameters
    ----------
    within : numpy.timedelta64
        How far the time of a file may be from it.

    Returns
    -------
    Regions
        Of the nearest readable file of each kind; empty with a reason where there is none.
    """
    if folder is None:
        return Regions((), (), (), "no folder of active regions and coronal holes is named: set BELLA_REGIONS")
    regions: list[SourceRegion] = []
    used, left_out = [], []
    for kind, files in region_files(folder, utc, within).items():
        for path, utc_of_file in files:
            try:
                sha256 = region_sha256(path)
                is_summary = kind == "solar_region_summary"
                found = read_active_regions(path) if is_summary else read_coronal_holes(path, utc_of_file)
                used.append(UsedFile(kind, path.name, sha256))
            except (InputError, OSError) as error:
                left_out.append(why_left_out(path, error))
                continue
            regions += found
            break
    return Regions(tuple(regions), tuple(used), tuple(left_out), "" if used else _no_regions(folder, utc, left_out))


def region_files(
    folder: Path, utc: np.datetime64, within: np.timedelta64 = OLDEST_REGIONS
) -> dict[str, list[tuple[Path, np.datetime64]]]:
    """Files of regions of a folder whose time, by their name, is near another.

    Returns
    -------
    dict of str to list of (Path, numpy.datetime64)
        By kind, nearest first.
    """
    kinds = {"solar_region_summary": SUMMARY_NAME, "coronal_holes": HOLES_NAME}
    found: dict[str, list[tuple[Path, np.datetime64]]] = {kind: [] for kind in kinds}
    for path in files_below(folder):
        for kind, name in kinds.items():
            time = _named_time(name.fullmatch(path.name))
            if time is not None and abs(time - utc) <= within:
                found[kind].append((path, time))
    return {kind: sorted(files, key=lambda file: (abs(file[1] - utc), file[0])) for kind, files in found.items()}


def region_sha256(path: Path) -> str:
    """Checksum of a file of regions.

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
    check_readable(path, LARGEST_REGIONS)
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

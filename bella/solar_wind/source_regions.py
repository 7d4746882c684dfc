"""Active regions and coronal holes near which a burst may have started, as longitude extents at a time.

Active regions come from the Solar Region Summary of NOAA, coronal holes from a table with the columns
``hole_id, lon_min_deg, lon_max_deg, lat_min_deg, lat_max_deg, polarity, source``: Stonyhurst degrees, west and north
positive, lines that begin with ``#`` are comments. Where ``lon_min_deg`` is larger than ``lon_max_deg`` a hole lies
across the far side.
"""

import hashlib
import re
from dataclasses import dataclass, replace
from datetime import datetime, time
from pathlib import Path
from typing import Any

import astropy.units as u
import numpy as np
import pandas as pd

from bella.exceptions import InputError
from bella.solar_wind.in_situ import UsedFile, check_readable, files_below, why_left_out
from bella.units import within_half_turn_deg

HOLE_NUMBERS = ("lon_min_deg", "lon_max_deg", "lat_min_deg", "lat_max_deg")
HOLE_COLUMNS = ("hole_id", *HOLE_NUMBERS, "polarity", "source")
LEAST_EXTENT_DEG = 2.0
"""A region without an extent, such as a plage, is given this: positions are whole degrees."""

SUMMARY_NAME = re.compile(r"(\d{8})SRS\.txt", re.IGNORECASE)
HOLES_NAME = re.compile(r"coronal-holes-(\d{8}T\d{4})\.csv", re.IGNORECASE)
OLDEST_REGIONS = np.timedelta64(48, "h")
"""Regions of a time further away are not used: an active region may have appeared or decayed."""

LAST_SHORT_YEAR, LAST_SHORT_NUMBER = 2002, 19_000
"""In June 2002 the numbers passed 10 000; they are near 15 000 in 2026."""

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

        Parameters
        ----------
        utc : numpy.datetime64

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
    from sunpy.io.special.srs import read_srs  # noqa: PLC0415

    try:
        table = read_srs(path)
        issued = table.meta["issued"]
        rows = [row for row in table if row["ID"] in {"I", "IA"}]
        return [_active_region(row, issued) for row in rows]
    except (OSError, LookupError, ValueError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path.name} is not a Solar Region Summary ({type(error).__name__}); give the text file of NOAA"
        ) from error


def _active_region(row: Any, issued: datetime) -> SourceRegion:
    extent, spotless = row["Longitudinal Extent"], row["ID"] == "IA"
    width = LEAST_EXTENT_DEG if spotless else max(float(u.Quantity(extent).value), LEAST_EXTENT_DEG)
    return SourceRegion(
        name=str(_region_number(int(row["Number"]), issued)),
        kind="active region",
        longitude_deg=float(u.Quantity(row["Longitude"]).value),
        latitude_deg=float(u.Quantity(row["Latitude"]).value),
        width_deg=width,
        height_deg=float("nan"),
        utc=np.datetime64(datetime.combine(issued.date(), time()), "ns"),
        remark="plage" if spotless else str(row["Mag Type"]),
    )


def _region_number(number: int, issued: datetime) -> int:
    """Number of a region: sunpy adds 10 000 to all of four digits from 2002-06 on, also to those before 10 000."""
    return number - 10_000 if number >= LAST_SHORT_NUMBER and issued.year == LAST_SHORT_YEAR else number


def read_coronal_holes(path: Path, utc: np.datetime64) -> list[SourceRegion]:
    """Coronal holes from a table of their extents.

    Parameters
    ----------
    path : Path
        CSV with the columns that the module describes.
    utc : numpy.datetime64
        Time of the image in which they were measured.

    Returns
    -------
    list of SourceRegion

    Raises
    ------
    InputError
        If the file cannot be read, a column is missing, or a row has no possible extent.
    """
    try:
        frame = pd.read_csv(path, comment="#", skipinitialspace=True, dtype={"hole_id": str, "polarity": str})
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path.name} cannot be read ({reason}): give {', '.join(HOLE_COLUMNS)}") from error
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
    used : tuple of UsedFile
    left_out : tuple of str
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
    folder : Path or None
    utc : numpy.datetime64
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
    for path in files_below(folder):
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

"""Hourly solar wind speeds of a spacecraft, in the plain form in which they are handed on: year, day, hour, speed."""

from pathlib import Path

import numpy as np
import pandas as pd

from bella.exceptions import InputError, NoDataError

FILL_KM_S = 9999.0
FASTEST_KM_S = 3000.0
COLUMNS = ("year", "day_of_year", "hour", "speed_km_s")
OMNI2_COLUMNS = range(55, 60)
OMNI2_PLACES = (0, 1, 2, 24)
"""Where a record of the yearly OMNI 2 files has these four; records have had words added at their end."""


def hourly_speeds(path: Path) -> pd.Series:
    """Read hourly speeds: lines of year, day of year, hour and speed in km/s, as OMNIWeb and COHOWeb export lists.

    Parameters
    ----------
    path : Path
        Blanks between the columns; 9999 or more where there is no measurement. The yearly files of OMNI 2
        (``omni2_YYYY.dat``, 55 words and more) are read as they are.

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
    frame = _numbers(path)
    valid = frame[frame["speed_km_s"] < FILL_KM_S]
    if valid.empty:
        raise NoDataError(f"{path.name} holds no hour with a speed: choose another interval")
    if not valid["speed_km_s"].between(1.0, FASTEST_KM_S).all():
        raise InputError(f"{path.name} holds speeds that no solar wind has: give km/s, and 9999 for no measurement")
    speeds = pd.Series(valid["speed_km_s"].to_numpy(), index=_utc(valid, path), name=path.stem).sort_index()
    return speeds[~speeds.index.duplicated()]


def _numbers(path: Path) -> pd.DataFrame:
    try:
        frame = pd.read_csv(path, sep=r"\s+", header=None, comment="#", dtype=np.float64)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path.name} cannot be read ({reason}): give year, day of year, hour, speed") from error
    if frame.shape[1] in OMNI2_COLUMNS:
        frame = frame.iloc[:, list(OMNI2_PLACES)]
    if frame.shape[1] != len(COLUMNS):
        raise InputError(f"{path.name} has {frame.shape[1]} columns: give year, day of year, hour, speed")
    return frame.set_axis(list(COLUMNS), axis=1)


def _utc(frame: pd.DataFrame, path: Path) -> pd.DatetimeIndex:
    possible = frame["day_of_year"].between(1, 366) & frame["hour"].between(0, 23) & frame["year"].between(1960, 2200)
    if not possible.all():
        raise InputError(
            f"{path.name}, line {int(np.argmin(possible)) + 1}: no such hour; give year, day of year, hour"
        )
    start = pd.to_datetime(frame["year"].astype(int).astype(str), format="%Y")
    elapsed = (frame["day_of_year"] - 1) * 24 + frame["hour"]
    return pd.DatetimeIndex(start + pd.to_timedelta(elapsed, unit="h"))

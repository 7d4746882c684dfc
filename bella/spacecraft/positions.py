"""A table of receivers: where each was, in HEE, for fleets that the ephemeris does not know or that are imagined."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from bella.csv_tables import parse_table, read_table_text
from bella.exceptions import InputError

POSITION = ("x_rsun", "y_rsun", "z_rsun")
COLUMNS = ("observatory", *POSITION)
SIGMA = "sigma_s"


def read_positions(path: Path) -> pd.DataFrame:
    """Read a table of receivers from a CSV file; lines that begin with ``#`` are comments.

    Parameters
    ----------
    path : Path
        Columns ``observatory, x_rsun, y_rsun, z_rsun`` (HEE, solar radii) and, where wanted, ``sigma_s``.

    Returns
    -------
    pandas.DataFrame
        Columns observatory, x_rsun, y_rsun, z_rsun and sigma_s, which is NaN where the table has none.

    Raises
    ------
    InputError
        If the file cannot be read, or names the row (1 is the first under the heading) and column that is wrong.
    """
    frame = parse_table(read_table_text(path), str(path))
    missing = [name for name in COLUMNS if name not in frame.columns]
    if missing:
        raise InputError(f"{path}: column {missing[0]} is missing; needed are {', '.join(COLUMNS)}")
    table = pd.DataFrame({"observatory": frame["observatory"].str.strip()})
    _reject(table["observatory"] == "", frame, "observatory", path, "is empty; every row needs a name")
    _reject(table["observatory"].duplicated(), frame, "observatory", path, "occurs twice; keep one row for each")
    for name in POSITION:
        table[name] = _numbers(frame, name, path)
    table[SIGMA] = _sigma(frame, path)
    return table


def _numbers(frame: pd.DataFrame, column: str, path: Path) -> pd.Series:
    values = pd.to_numeric(frame[column], errors="coerce").astype(np.float64)
    _reject(~np.isfinite(values), frame, column, path, "is not a number; give solar radii, HEE")
    return values


def _sigma(frame: pd.DataFrame, path: Path) -> pd.Series:
    if SIGMA not in frame:
        return pd.Series(np.nan, index=frame.index)
    given = frame[SIGMA].str.strip() != ""
    values = pd.to_numeric(frame[SIGMA].where(given), errors="coerce").astype(np.float64)
    _reject(given & ~(values > 0), frame, SIGMA, path, "is not above 0; give seconds, or leave it empty")
    return values


def _reject(
    bad: "pd.Series | npt.NDArray[np.bool_]", frame: pd.DataFrame, column: str, path: Path, reason: str
) -> None:
    wrong = np.flatnonzero(bad)
    if wrong.size:
        raise InputError(f"{path}: row {wrong[0] + 1}, column {column}: {frame[column].iloc[wrong[0]]!r} {reason}")

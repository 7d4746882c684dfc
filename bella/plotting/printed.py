"""What the PNG figures share: how they are written, and what tables must have before they are drawn."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pandas as pd

from bella.exceptions import InputError
from bella.plotting.export import whole_file
from bella.units import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOTS_PER_INCH = 160

ARRIVAL_COLUMNS = ("observatory", "frequency_mhz", "arrival_utc", "sigma_s", "edge", "flag")
FLAGGED = "#9aa3ab"
"""Colour of edges that carry a flag: seen on dark, on ivory and on paper."""


def require_columns(table: pd.DataFrame, columns: Iterable[str], name: str) -> pd.DataFrame:
    """Refuse a table that lacks a column.

    Parameters
    ----------
    table : pandas.DataFrame
    columns : iterable of str
    name : str
        What the table is called in the error.

    Returns
    -------
    pandas.DataFrame
        The same table.

    Raises
    ------
    InputError
        If a column is missing.
    """
    missing = [column for column in columns if column not in table.columns]
    if missing:
        raise InputError(f"the {name} has no column {missing[0]!r}: add it, or make the table with bella anew")
    return table


def day_numbers(utc: npt.ArrayLike) -> FloatArray:
    """Days as matplotlib counts them.

    Parameters
    ----------
    utc : array_like of datetime64, shape (N,)
        With or without a time zone, which has to be UTC then.

    Returns
    -------
    ndarray, shape (N,)
        NaN where there is no time.
    """
    from matplotlib.dates import date2num  # noqa: PLC0415 - figures of the pages need no matplotlib

    times = pd.to_datetime(np.asarray(utc), utc=True).tz_localize(None).to_numpy().astype("datetime64[ns]")
    return np.asarray(date2num(times), dtype=np.float64)  # type: ignore[no-untyped-call]


def is_flagged(arrivals: pd.DataFrame) -> pd.Series:
    """Which edges carry a flag.

    Parameters
    ----------
    arrivals : pandas.DataFrame
        Has ``flag``, empty or missing for good edges.

    Returns
    -------
    pandas.Series of bool
    """
    return arrivals["flag"].fillna("").astype(str) != ""


def save_png(figure: "Figure", path: Path, *, colours: int | None = None) -> None:
    """Write a figure; the file appears whole or not at all.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    path : Path
        Its folder is made when it does not exist.
    colours : int or None
        Keep this many colours only: line drawings become several times smaller.
    """
    with whole_file(path) as staged:
        figure.savefig(staged, format="png", dpi=DOTS_PER_INCH, metadata={"Software": "BELLA service"})
        if colours is not None:
            from PIL import Image  # noqa: PLC0415

            fewer = Image.open(staged).convert("RGB").quantize(colours, dither=Image.Dither.NONE)
            fewer.save(staged, "PNG", optimize=True)

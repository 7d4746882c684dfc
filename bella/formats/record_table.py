"""A published table in memory: columns as numpy arrays, the same for every format that is written from it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from bella.exceptions import InputError
from bella.formats.columns import Column, Schema

Values = npt.NDArray[Any]

APART_US = 1000
"""Least distance of the times of records where they have to differ, microseconds: many readers keep milliseconds."""


@dataclass(frozen=True)
class RecordTable:
    """Rows of a published table.

    Attributes
    ----------
    schema : Schema
    data : dict of str to ndarray, shape (rows,)
        By column: datetime64[us], float64, int64, bool or str.
    header : dict of str to str
        What holds for the table as a whole, such as its frame.
    """

    schema: Schema
    data: Mapping[str, Values]
    header: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.data[self.schema.names[0]])

    def take(self, rows: npt.NDArray[Any]) -> "RecordTable":
        """Keep these rows, in this order."""
        return RecordTable(self.schema, {name: column[rows] for name, column in self.data.items()}, self.header)

    def in_time(self) -> "RecordTable":
        """The same rows by ascending time; rows of one time stay in their order."""
        return self.take(np.argsort(self.data[self.schema.time], kind="stable"))


def record_table(
    schema: Schema, rows: Iterable[Mapping[str, object]], header: Mapping[str, str] | None = None
) -> RecordTable:
    """Table of records.

    Parameters
    ----------
    schema : Schema
    rows : iterable of mapping
        By column name; what is missing or None is not known. Further keys are left out.
    header : mapping, optional

    Returns
    -------
    RecordTable
    """
    found = list(rows)
    columns = {one.name: column_values(one, [row.get(one.name) for row in found]) for one in schema.columns}
    return RecordTable(schema, columns, dict(header or {}))


def column_values(column: Column, given: list[object]) -> Values:
    """Values of a column with their type.

    Parameters
    ----------
    given : list
        None for what is not known; times with or without a zone, as text, datetime or datetime64.

    Returns
    -------
    ndarray, shape (rows,)

    Raises
    ------
    InputError
        If an integer is not known, for which no format has a sign.
    """
    match column.kind:
        case "time":
            return np.array([_utc(one) for one in given], dtype="datetime64[us]")
        case "float":
            values = np.array([np.nan if one is None else one for one in given], dtype=np.float64)
            return np.where(np.isfinite(values), values, np.nan)
        case "int" | "bool" if None in given:
            raise InputError(f"column {column.name}: row {given.index(None) + 1} is empty; give a value in every row")
        case "int":
            return np.array(given, dtype=np.int64)
        case "bool":
            return np.array(given, dtype=np.bool_)
        case _:
            return np.array(["" if one is None else str(one).strip() for one in given], dtype=np.str_)


def distinct_times(times: Values) -> Values:
    """Times of records for formats that allow one record per time: later ones of a time are put a millisecond on.

    Parameters
    ----------
    times : ndarray of datetime64[us], shape (rows,)
        Ascending, none unknown.

    Returns
    -------
    ndarray of datetime64[us], shape (rows,)
        At least `APART_US` apart. The times themselves stand in a column of their own.
    """
    number = np.arange(times.size, dtype=np.int64) * APART_US
    moved = np.maximum.accumulate(times.astype("datetime64[us]").astype(np.int64) - number) + number
    return moved.astype("datetime64[us]")


def iso_stamps(times: Values, *, microseconds: bool | None = None) -> list[str]:
    """Times as ISO 8601 with Z; empty where a time is not known.

    Parameters
    ----------
    microseconds : bool, optional
        Write six decimals of the second; without it, where three do not say it all.
    """
    known = times[~np.isnat(times)]
    fine = bool((known.astype(np.int64) % 1000).any()) if microseconds is None else microseconds
    written = np.datetime_as_string(times.astype("datetime64[us]" if fine else "datetime64[ms]"))
    return ["" if one == "NaT" else f"{one}Z" for one in written.tolist()]


def plain_rows(table: RecordTable) -> list[dict[str, object]]:
    """Rows as JSON holds them: times as text, None for what is not known."""
    columns = [_plain(column, table.data[column.name]) for column in table.schema.columns]
    return [dict(zip(table.schema.names, row, strict=True)) for row in zip(*columns, strict=True)]


def _plain(column: Column, values: Values) -> list[object]:
    if column.kind == "time":
        return [one or None for one in iso_stamps(values)]
    if column.kind == "float":
        return [one if np.isfinite(one) else None for one in values.tolist()]
    return list(values.tolist())


def _utc(one: object) -> np.datetime64:
    if one is None or one is pd.NaT or one == "":
        return np.datetime64("NaT", "us")
    stamp = pd.Timestamp(one if isinstance(one, datetime | np.datetime64) else str(one))
    bare = stamp if stamp.tzinfo is None else stamp.tz_convert("UTC").tz_localize(None)
    moment: np.datetime64 = bare.to_datetime64().astype("datetime64[us]")
    return moment

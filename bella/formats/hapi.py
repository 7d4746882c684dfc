"""HAPI 3.3: parameters, records and status of the replies (Heliophysics Application Programmer's Interface).

Specification: https://github.com/hapi-server/data-specification (3.3.1). A data set here is a published table by
ascending time, or a grid of times. Its first parameter, ``Time``, may not have the same value twice: later records of
one time are put a millisecond on (`bella.formats.record_table.distinct_times`), and the times themselves are parameters
too.
"""

import csv
import io
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from astropy import units as u

from bella.exceptions import InputError
from bella.formats.columns import Column, Schema
from bella.formats.record_table import RecordTable, Values, distinct_times, iso_stamps

VERSION = "3.3"
OUTPUT_FORMATS = {"csv": "text/csv", "json": "application/json", "binary": "application/octet-stream"}
TIME = "Time"
TIME_LENGTH = len("2012-06-07T19:29:15.123456Z")
TIME_FILL = "0001-01-01T00:00:00.000000Z"
FLOAT_FILL = "NaN"
TEXT_FILL = "-"
"""What stands for an empty text: readers drop an empty field at the end of a line."""

TEXT_BYTES = 64
LONG_TEXT_BYTES = 512
LONG_TEXTS = frozenset({"observatories", "flags", "sentence", "reason", "solution_id"})
"""Bytes of a text, which HAPI fixes beforehand; what is longer is cut and ends with ``...``."""

STATUS: dict[int, tuple[int, str]] = {
    1200: (200, "OK"),
    1201: (200, "OK - no data for time range"),
    1400: (400, "user input error"),
    1401: (400, "unknown request field"),
    1402: (400, "error in start time"),
    1403: (400, "error in stop time"),
    1404: (400, "start time equal to or after stop time"),
    1405: (400, "time outside valid range"),
    1406: (404, "unknown dataset id"),
    1407: (404, "unknown dataset parameter"),
    1408: (400, "too much time or data requested"),
    1409: (400, "unsupported output format"),
    1410: (400, "unsupported include value"),
    1411: (400, "out-of-order or duplicate parameters"),
    1412: (400, "unsupported resolve_references value"),
    1413: (400, "unsupported depth value"),
    1500: (500, "internal server error"),
    1501: (500, "upstream request error"),
}
"""HTTP status and words of each HAPI status code (section 4.2 of the specification)."""

Json = dict[str, Any]

_INSTANT = re.compile(
    r"(?P<year>\d{4})(?:-(?P<doy>\d{3})|-(?P<month>\d\d)(?:-(?P<day>\d\d))?)?"
    r"(?:T(?P<hour>\d\d)(?::(?P<minute>\d\d)(?::(?P<second>\d\d)(?:\.(?P<part>\d{0,9}))?)?)?)?Z?",
    re.ASCII,
)


class HapiError(InputError):
    """A request that HAPI refuses with one of its status codes."""

    def __init__(self, code: int, more: str = "") -> None:
        self.code = code
        super().__init__(f"HAPI error {code}: {STATUS[code][1]}{'; ' + more if more else ''}")


@dataclass(frozen=True)
class HapiParameter:
    """One parameter of a data set.

    Attributes
    ----------
    name, kind, units, description : str
        `kind` is isotime, double, integer or string; `units` is None for what has none.
    length : int or None
        Bytes of an isotime or a string.
    fill : str or None
        What stands for an unknown value.
    vector : tuple of str
        Names of the components of a vector; empty for a single number.
    """

    name: str
    kind: str
    units: str | None
    description: str
    length: int | None = None
    fill: str | None = None
    vector: tuple[str, ...] = ()

    def described(self) -> Json:
        """The parameter as ``info`` lists it."""
        found: Json = {"name": self.name, "type": self.kind, "units": self.units, "fill": self.fill}
        if self.length is not None:
            found["length"] = self.length
        if self.vector:
            found |= {"size": [len(self.vector)], "coordinateSystemName": "HEE", "vectorComponents": list(self.vector)}
        return found | {"description": self.description}


@dataclass(frozen=True)
class HapiRecords:
    """Records of a data set: parameters with their values, the time first.

    Attributes
    ----------
    columns : tuple of ndarray
        One per parameter, shape (records,), or (records, components) for a vector; times are datetime64[us].
    """

    parameters: tuple[HapiParameter, ...]
    columns: tuple[Values, ...]

    def __len__(self) -> int:
        return len(self.columns[0])

    def between(self, start: np.datetime64, stop: np.datetime64) -> "HapiRecords":
        """Records with their time in [start, stop)."""
        inside = (self.columns[0] >= start) & (self.columns[0] < stop)
        return HapiRecords(self.parameters, tuple(column[inside] for column in self.columns))

    def subset(self, names: Sequence[str]) -> "HapiRecords":
        """The time and these parameters."""
        kept = [i for i, one in enumerate(self.parameters) if i == 0 or one.name in names]
        return HapiRecords(tuple(self.parameters[i] for i in kept), tuple(self.columns[i] for i in kept))


TIME_PARAMETER = HapiParameter(TIME, "isotime", "UTC", "Time of the record, UTC.", TIME_LENGTH)


def table_parameters(schema: Schema) -> tuple[HapiParameter, ...]:
    """Parameters of a published table: its time, and all its columns."""
    return (TIME_PARAMETER, *map(_parameter, schema.columns))


def _parameter(column: Column) -> HapiParameter:
    match column.kind:
        case "time":
            return HapiParameter(column.name, "isotime", "UTC", column.description, TIME_LENGTH, TIME_FILL)
        case "text":
            length = LONG_TEXT_BYTES if column.name in LONG_TEXTS else TEXT_BYTES
            return HapiParameter(column.name, "string", None, column.description, length, TEXT_FILL)
        case "float":
            units = u.Unit(column.unit).to_string("vounit") if column.unit else None
            return HapiParameter(column.name, "double", units, column.description, fill=FLOAT_FILL)
        case _:
            return HapiParameter(column.name, "integer", None, column.description)


def table_records(table: RecordTable) -> HapiRecords:
    """Records of a published table by ascending time."""
    ordered = table.in_time()
    columns = (ordered.data[one.name] for one in table.schema.columns)
    return HapiRecords(table_parameters(table.schema), (distinct_times(ordered.data[table.schema.time]), *columns))


def parse_time(text: str, code: int) -> np.datetime64:
    """Time of a request: year-month-day or day of the year, cut short anywhere, with or without Z.

    Parameters
    ----------
    code : int
        Status code where it cannot be read.

    Returns
    -------
    numpy.datetime64
        Microseconds; further digits are dropped.

    Raises
    ------
    HapiError
    """
    found = _INSTANT.fullmatch(text)
    if not found or (found["hour"] and not (found["day"] or found["doy"])):
        raise HapiError(code, "write a UTC time as 2012-06-07T19:29:00Z or 2012-159Z")
    part = {name: int(value) for name, value in found.groupdict().items() if value and name != "part"}
    try:
        day = datetime(part["year"], part.get("month", 1), part.get("day", 1), tzinfo=UTC)
        if "doy" in part:
            day = datetime(part["year"], 1, 1, tzinfo=UTC) + timedelta(days=part["doy"] - 1)
            if part["doy"] == 0 or day.year != part["year"]:
                raise HapiError(code, "the year has no such day")
    except (ValueError, OverflowError) as error:
        raise HapiError(code, "the calendar has no such day") from error
    hour, minute, second = (part.get(name, 0) for name in ("hour", "minute", "second"))
    microsecond = int((found["part"] or "").ljust(6, "0")[:6])
    if minute > 59 or second > 60 or hour > 24 or (hour == 24 and (minute or second or microsecond)):
        raise HapiError(code, "the day has no such time")
    seconds = 3600 * hour + 60 * minute + second
    return np.datetime64(day.replace(tzinfo=None), "us") + np.timedelta64(seconds * 1_000_000 + microsecond, "us")


def chosen_parameters(known: Sequence[HapiParameter], asked: str | None) -> tuple[str, ...]:
    """Names of the parameters that a request asks for.

    Parameters
    ----------
    asked : str or None
        Separated by commas; None or empty for all.

    Raises
    ------
    HapiError
        If one is not known, occurs twice, or stands in another order than `known`.
    """
    names = [one.name for one in known]
    if not asked:
        return tuple(names)
    wanted = asked.split(",")
    if any(one not in names for one in wanted):
        raise HapiError(1407, f"known are {', '.join(names)}")
    places = [names.index(one) for one in wanted]
    if places != sorted(set(places)):
        raise HapiError(1411, f"the order is {', '.join(names)}")
    return tuple(wanted)


def status_object(code: int, message: str | None = None) -> Json:
    """Version and status, as every JSON reply begins."""
    return {"HAPI": VERSION, "status": {"code": code, "message": message or STATUS[code][1]}}


def encode(records: HapiRecords, output: str, header: Mapping[str, Any] | None) -> bytes:
    """Body of a reply with data.

    Parameters
    ----------
    output : {"csv", "json", "binary"}
    header : mapping or None
        What ``info`` says; None to leave it out (JSON always has it).
    """
    if output == "json":
        columns = [_json_column(*pair) for pair in zip(records.parameters, records.columns, strict=True)]
        rows = [list(row) for row in zip(*columns, strict=True)]
        return json.dumps({**(header or {}), "format": "json", "data": rows}, allow_nan=False).encode()
    said = b"" if header is None else b"#" + json.dumps({**header, "format": output}).encode() + b"\n"
    return said + (_binary(records) if output == "binary" else _csv(records))


def _csv(records: HapiRecords) -> bytes:
    cells: list[list[str]] = []
    for parameter, column in zip(records.parameters, records.columns, strict=True):
        cells += [_csv_column(parameter, part) for part in _components(column)]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(zip(*cells, strict=True))
    return text.getvalue().encode()


def _csv_column(parameter: HapiParameter, column: Values) -> list[str]:
    match parameter.kind:
        case "isotime" | "string":
            return _texts(parameter, column)
        case "double":
            return [repr(one) if np.isfinite(one) else FLOAT_FILL for one in column.tolist()]
        case _:
            return [str(int(one)) for one in column.tolist()]


def _json_column(parameter: HapiParameter, column: Values) -> list[Any]:
    if parameter.kind in {"isotime", "string"}:
        return _texts(parameter, column)
    if parameter.kind == "integer":
        return [int(one) for one in column.tolist()]
    # JSON has no number for NaN, and a fill value is a text: null is what clients take for it
    parts = [[one if np.isfinite(one) else None for one in part.tolist()] for part in _components(column)]
    return [list(row) for row in zip(*parts, strict=True)] if parameter.vector else parts[0]


def _binary(records: HapiRecords) -> bytes:
    fields: list[tuple[str, str]] = []
    values: list[Any] = []
    for parameter, column in zip(records.parameters, records.columns, strict=True):
        for part in _components(column):
            kind = {"double": "<f8", "integer": "<i4"}.get(parameter.kind, f"S{parameter.length}")
            texts = parameter.kind in {"isotime", "string"}
            fields.append((f"f{len(fields)}", kind))
            values.append([one.encode() for one in _texts(parameter, part)] if texts else part)
    packed = np.zeros(len(records), dtype=fields)
    for (name, _), part in zip(fields, values, strict=True):
        packed[name] = part
    return packed.tobytes()


def _components(column: Values) -> list[Values]:
    return list(column.T) if column.ndim > 1 else [column]


def _texts(parameter: HapiParameter, column: Values) -> list[str]:
    if parameter.kind == "isotime":
        return [one or TIME_FILL for one in iso_stamps(column, microseconds=True)]
    length = parameter.length or TEXT_BYTES
    return [
        TEXT_FILL if not one else one if len(one.encode()) <= length else _cut(one, length) for one in column.tolist()
    ]


def _cut(text: str, length: int) -> str:
    return text.encode()[: length - 3].decode(errors="ignore") + "..."

"""Published tables as text: CSV and JSON."""

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice

import numpy as np

from bella.formats.columns import Column, Schema
from bella.formats.record_table import RecordTable, Values, iso_stamps, plain_rows

ITEMS_AT_ONCE = 100
"""Items of a list of JSON that make one piece."""


def csv_text(table: RecordTable) -> bytes:
    """CSV with the header of the table as ``# key: value`` lines above the names of the columns.

    Numbers have as many digits as it takes to read the same number back; what is not known is empty.
    """
    return b"".join(csv_pieces(table.schema, table.header, [table]))


def csv_pieces(schema: Schema, header: Mapping[str, str], tables: Iterable[RecordTable]) -> Iterator[bytes]:
    """The same piece by piece, of tables that follow one another."""
    above = "".join(f"# {key}: {' '.join(str(value).split())}\n" for key, value in header.items())
    yield (above + _csv_lines([schema.names])).encode()
    for table in tables:
        columns = [_written(column, table.data[column.name]) for column in schema.columns]
        yield _csv_lines(zip(*columns, strict=True)).encode()


def _csv_lines(rows: Iterable[tuple[str, ...]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _written(column: Column, values: Values) -> list[str]:
    match column.kind:
        case "time":
            return iso_stamps(values)
        case "float":
            return [repr(one) if np.isfinite(one) else "" for one in values.tolist()]
        case "bool":
            return [str(one).lower() for one in values.tolist()]
        case _:
            return [str(one) for one in values.tolist()]


def json_text(table: RecordTable) -> bytes:
    """JSON object of the header, the columns with their units, and the rows; null for what is not known."""
    return b"".join(json_pieces(table.schema, table.header, [table]))


def json_pieces(schema: Schema, header: Mapping[str, str], tables: Iterable[RecordTable]) -> Iterator[bytes]:
    """The same piece by piece, of tables that follow one another."""
    described = [
        {"name": one.name, "kind": one.kind, "unit": one.unit or None, "ucd": one.ucd, "description": one.description}
        for one in schema.columns
    ]
    above = {"table": schema.name, "title": schema.title, "header": dict(header), "columns": described, "rows": []}
    rows = (_json(row) for table in tables for row in plain_rows(table))
    yield from json_list(_json(above).removesuffix("]}"), rows, "]}")


def json_list(above: str, items: Iterable[str], below: str) -> Iterator[bytes]:
    """A JSON list piece by piece, between what stands above and below it."""
    rest, before = iter(items), above
    while some := list(islice(rest, ITEMS_AT_ONCE)):
        yield (before + ", ".join(some)).encode()
        before = ", "
    yield ((above if before is above else "") + below).encode()


def _json(value: object) -> str:
    return json.dumps(value, allow_nan=False, ensure_ascii=False)

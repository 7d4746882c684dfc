"""Published tables as text: CSV and JSON."""

import csv
import io
import json
from collections.abc import Mapping

import numpy as np

from bella.formats.columns import Column
from bella.formats.record_table import RecordTable, Values, iso_stamps, plain_rows


def csv_text(table: RecordTable) -> bytes:
    """CSV with the header of the table as ``# key: value`` lines above the names of the columns.

    Numbers have as many digits as it takes to read the same number back; what is not known is empty.
    """
    columns = [_written(column, table.data[column.name]) for column in table.schema.columns]
    return csv_lines(table.schema.names, zip(*columns, strict=True), table.header).encode()


def csv_lines(names: tuple[str, ...], rows: object, header: Mapping[str, object]) -> str:
    """Text of a CSV table: header, names, rows."""
    text = io.StringIO()
    text.writelines(f"# {key}: {' '.join(str(value).split())}\n" for key, value in header.items())
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)  # type: ignore[arg-type]
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
    described = [
        {"name": one.name, "kind": one.kind, "unit": one.unit or None, "ucd": one.ucd, "description": one.description}
        for one in table.schema.columns
    ]
    whole = {
        "table": table.schema.name,
        "title": table.schema.title,
        "header": dict(table.header),
        "columns": described,
        "rows": plain_rows(table),
    }
    return json.dumps(whole, allow_nan=False, ensure_ascii=False).encode()

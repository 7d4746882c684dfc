"""Published tables as astropy tables, and what astropy writes: ECSV and VOTable."""

import io
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from astropy import units as u
from astropy.io.votable import from_table
from astropy.io.votable.tree import Info, TimeSys, VOTableFile
from astropy.table import QTable, Table
from astropy.time import Time

from bella.formats.columns import Column, Schema
from bella.formats.record_table import RecordTable, Values, iso_stamps, record_table

VOTABLE_VERSION = "1.4"
TIME_SYSTEM = "utc"
ROWS = re.compile(rb' nrows="\d+"')
"""What astropy says of the number of rows, which is not known where these are written piece by piece."""

STAMP_LENGTH = len("2012-06-07T19:29:15.123456Z")


def quantity_table(table: RecordTable) -> QTable:
    """Table with units: a Quantity for what has one, a Time for times.

    Returns
    -------
    astropy.table.QTable
        Columns carry their description, and their UCD in `info.meta`; the header is the `meta` of the table.
    """
    made = QTable(meta=dict(table.header))
    for column in table.schema.columns:
        made[column.name] = _mixin(column, table.data[column.name])
        made[column.name].info.description = column.description
        made[column.name].info.meta = {"ucd": column.ucd}
    return made


def _mixin(column: Column, values: Values) -> Any:
    if column.kind == "time":
        moments = Time(values, format="datetime64", scale="utc")
        moments.format, moments.precision = "isot", 6
        return moments
    return values * u.Unit(column.unit) if column.unit else values.copy()


def ecsv(table: RecordTable) -> bytes:
    """Enhanced CSV: text with units and descriptions, as ``astropy.table.QTable.read`` takes it.

    Times are written without a zone: their scale, UTC, stands in the header.
    """
    return b"".join(ecsv_pieces(table.schema, table.header, [table]))


def ecsv_pieces(schema: Schema, header: Mapping[str, str], tables: Iterable[RecordTable]) -> Iterator[bytes]:
    """The same piece by piece, of tables that follow one another."""
    with_rows = filter(len, tables)
    yield _ecsv(RecordTable(schema, next(with_rows, record_table(schema, ())).data, header))
    for table in with_rows:
        lines = _ecsv(table).splitlines(keepends=True)
        names = next(place for place, line in enumerate(lines) if not line.startswith(b"#"))
        yield b"".join(lines[names + 1 :])


def _ecsv(table: RecordTable) -> bytes:
    text = io.StringIO()
    quantity_table(table).write(text, format="ascii.ecsv", serialize_method={Time: "formatted_value"})
    return text.getvalue().encode()


def votable(table: RecordTable) -> bytes:
    """VOTable 1.4 with units, UCDs and the system of its times; times are ISO 8601 text (DALI timestamps)."""
    return b"".join(votable_pieces(table.schema, table.header, [table]))


def votable_pieces(schema: Schema, header: Mapping[str, str], tables: Iterable[RecordTable]) -> Iterator[bytes]:
    """The same piece by piece, of tables that follow one another."""
    below = b""
    for table in tables:
        above, begin, rest = _votable(RecordTable(schema, table.data, header)).partition(b"<TABLEDATA>")
        rows, end, rest = rest.partition(b"</TABLEDATA>")
        if end:
            yield rows if below else above + begin + rows
            below = end + rest
    yield below or _votable(record_table(schema, (), header))


def _votable(table: RecordTable) -> bytes:
    bare = Table(meta={})
    for column in table.schema.columns:
        values = table.data[column.name]
        bare[column.name] = np.array(iso_stamps(values), dtype=np.str_) if column.kind == "time" else values
    file = from_table(bare)
    _describe(file, table)
    raw = io.BytesIO()
    file.to_xml(raw, tabledata_format="tabledata")
    return ROWS.sub(b"", raw.getvalue(), 1)


def _describe(file: VOTableFile, table: RecordTable) -> None:
    file.version = VOTABLE_VERSION
    file.description = table.schema.title
    resource = file.resources[0]
    resource.type = "results"
    resource.infos.append(Info(name="QUERY_STATUS", value="OK"))
    resource.infos.extend(Info(name=name, value=value) for name, value in table.header.items())
    known = {"version": VOTABLE_VERSION, "version_1_4_or_later": True}
    resource.time_systems.append(TimeSys(ID=TIME_SYSTEM, timescale="UTC", refposition="UNKNOWN", config=known))
    inner = resource.tables[0]
    inner.name = table.schema.name
    for field, column in zip(inner.fields, table.schema.columns, strict=True):
        field.ID = None
        field.ucd = column.ucd
        field.description = column.description
        field.unit = u.Unit(column.unit).to_string("vounit") if column.unit else None
        field.arraysize = {"time": f"{STAMP_LENGTH}*", "text": "*"}.get(column.kind)
        if column.kind == "time":
            field.datatype, field.xtype, field.ref = "char", "timestamp", TIME_SYSTEM
        elif column.kind == "bool":
            field.datatype = "boolean"  # astropy would write a bit, which few readers know as a truth value

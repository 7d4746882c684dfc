"""Published tables as binary files: netCDF, CDF by the ISTP guidelines, and Parquet."""

import io
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, islice
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import xarray as xr
from astropy.time import Time

from bella.exceptions import InputError, require_extra
from bella.formats.columns import Column, Schema
from bella.formats.record_table import RecordTable, Values, distinct_times, record_table
from bella.units import DAY_S

J2000_JD = 2_451_545.0
J2000 = np.datetime64("2000-01-01T12:00", "ns")
"""J2000, 2000-01-01T12:00 TT, as a Julian date and as a calendar date."""

ISTP_VALID = ("1990-01-01", "2100-01-01")
"""Times outside these years are mistakes: to a minute, which the future leap seconds leave open."""

PARQUET_CODEC = "zstd"
GROUP_ROWS, PIECE_BYTES = 50_000, 1 << 20
NO_TIME = np.iinfo(np.int64).min

ISTP_FILL = -1.0e31
ISTP_FILL_INTEGER = -(2**63)
"""Values that the ISTP guidelines set for what is not known."""


def netcdf(table: RecordTable) -> bytes:
    """NetCDF-4 with one dimension, ``row``; times are whole microseconds, text is of variable length (CF-1.11)."""
    return b"".join(netcdf_pieces(table.schema, table.header, [table]))


def netcdf_pieces(schema: Schema, header: Mapping[str, str], tables: Iterable[RecordTable]) -> Iterator[bytes]:
    """The same piece by piece, of tables that follow one another; they are put into a temporary file first."""
    rest = filter(len, tables)
    first, second = next(rest, record_table(schema, ())), list(islice(rest, 1))
    with tempfile.TemporaryDirectory(prefix="bella-netcdf-") as folder:
        path = Path(folder) / "table.nc"
        _begin_netcdf(path, RecordTable(schema, first.data, header), grows=bool(second))
        with h5netcdf.File(path, "a") as file:
            for table in chain(second, rest):
                done = file.dimensions["row"].size
                file.resize_dimension("row", done + len(table))
                for one in schema.columns:
                    values = table.data[one.name]
                    kinds = {"time": np.int64, "bool": np.int8, "text": object}
                    file.variables[one.name][done:] = values.astype(kinds.get(one.kind, values.dtype))
        with path.open("rb") as stream:
            while piece := stream.read(PIECE_BYTES):
                yield piece


def _begin_netcdf(path: Path, table: RecordTable, *, grows: bool) -> None:
    """File of a table, to which rows can be added if it grows."""
    dataset = xr.Dataset(
        {one.name: ("row", table.data[one.name], _cf(one)) for one in table.schema.columns},
        attrs={"Conventions": "CF-1.11", "title": table.schema.title, **table.header},
    )
    chunks = {"chunksizes": (len(table),)} if grows else {}
    encoding: dict[str, dict[str, Any]] = {one.name: {**chunks} for one in table.schema.columns}
    for one in table.schema.columns:
        if one.kind == "time":
            encoding[one.name] |= {"units": "microseconds since 1970-01-01", "dtype": "int64", "_FillValue": NO_TIME}
        elif one.kind == "text":
            dataset[one.name] = dataset[one.name].astype(object)
    dataset.to_netcdf(path, engine="h5netcdf", encoding=encoding, unlimited_dims=["row"] if grows else [])


def _cf(column: Column) -> dict[str, str]:
    unit = {"units": column.unit or "1"} if column.kind in {"float", "int"} else {}
    return {"long_name": column.description, "ucd": column.ucd, **unit}


def parquet(table: RecordTable) -> bytes:
    """Parquet, zstd: units, UCDs and descriptions in the metadata of the fields, the header in that of the schema.

    Raises
    ------
    MissingExtraError
        If the package pyarrow is not installed.
    """
    require_extra("pyarrow")
    return b"".join(parquet_pieces(table.schema, table.header, [table]))


def parquet_pieces(schema: Schema, header: Mapping[str, str], tables: Iterable[RecordTable]) -> Iterator[bytes]:
    """The same piece by piece, of tables that follow one another, in groups of `GROUP_ROWS` rows."""
    require_extra("pyarrow")
    import pyarrow as pa  # noqa: PLC0415 - heavy, and optional
    import pyarrow.parquet as pq  # noqa: PLC0415

    written = _Written()
    with pq.ParquetWriter(written, arrow_schema(schema, header), compression=PARQUET_CODEC) as writer:
        group: list[Any] = []
        for table in tables:
            group.append(arrow_table(RecordTable(schema, table.data, header)))
            if sum(map(len, group)) >= GROUP_ROWS:
                writer.write_table(pa.concat_tables(group))
                group.clear()
                yield written.taken()
        if group:
            writer.write_table(pa.concat_tables(group))
    yield written.taken()


class _Written(io.RawIOBase):
    """A file that is only written, whose content is taken away now and then."""

    def __init__(self) -> None:
        super().__init__()
        self._content = bytearray()

    def writable(self) -> bool:
        return True

    def write(self, some: Any) -> int:
        self._content += some
        return len(some)

    def taken(self) -> bytes:
        """What was written since this was called last."""
        some = bytes(self._content)
        self._content.clear()
        return some


def arrow_table(table: RecordTable) -> Any:
    """Table of pyarrow, as Parquet has it."""
    import pyarrow as pa  # noqa: PLC0415 - heavy, and optional

    schema = arrow_schema(table.schema, table.header)
    arrays = [pa.array(table.data[one.name], schema.field(one.name).type) for one in table.schema.columns]
    return pa.Table.from_arrays(arrays, schema=schema)


def arrow_schema(schema: Schema, header: Mapping[str, str]) -> Any:
    """Schema of pyarrow with units, UCDs and descriptions of the columns, and the header of the table."""
    import pyarrow as pa  # noqa: PLC0415 - heavy, and optional

    kinds = {
        "time": pa.timestamp("us", tz="UTC"),
        "float": pa.float64(),
        "int": pa.int64(),
        "bool": pa.bool_(),
        "text": pa.string(),
    }
    fields = [
        pa.field(one.name, kinds[one.kind], metadata={"unit": one.unit, "ucd": one.ucd, "description": one.description})
        for one in schema.columns
    ]
    return pa.schema(fields, metadata={"title": schema.title, **header})


def from_arrow(schema: Schema, table: Any) -> RecordTable:
    """What `arrow_table` was given.

    Raises
    ------
    InputError
        If it has other columns.
    """
    if tuple(table.column_names) != schema.names:
        raise InputError(
            f"{schema.name}: the columns are {', '.join(table.column_names)[:80]}, not those of this version"
        )
    columns: dict[str, Values] = {}
    for one in schema.columns:
        values = table.column(one.name)
        found = np.array(values.to_pylist(), dtype=np.str_) if one.kind == "text" else values.to_numpy()
        columns[one.name] = found.astype("datetime64[us]") if one.kind == "time" else found
    return RecordTable(schema, columns, {})


def istp_cdf(table: RecordTable) -> bytes:
    """CDF by the ISTP guidelines, rows by ascending time: ``Epoch`` is the time that orders the table.

    Every column is a variable that depends on Epoch, which may not have the same time twice (see `distinct_times`).
    Times are TT2000; text is ASCII, which spells out degrees and has "?" for other characters.

    Raises
    ------
    InputError
        If the table has no row, for which CDF has no form.
    """
    from cdflib.xarray import xarray_to_cdf  # noqa: PLC0415 - heavy

    if len(table) == 0:
        raise InputError(f"{table.schema.name}: no row, and CDF has no empty table; ask for other rows or a format")
    ordered = table.in_time()
    epoch = ("record", tt2000_ns(distinct_times(ordered.data[table.schema.time])), _istp_epoch())
    dataset = xr.Dataset({"Epoch": epoch}, attrs=_istp_header(table))
    for one in table.schema.columns:
        dataset[one.name] = ("record", _istp_values(one, ordered.data[one.name]), _istp(one, ordered))
    with tempfile.TemporaryDirectory(prefix="bella-cdf-") as folder:
        path = Path(folder) / "table.cdf"
        xarray_to_cdf(dataset, str(path), terminate_on_warning=True, istp=True)
        return path.read_bytes()


def tt2000_ns(times: Values) -> Values:
    """Times as TT2000: nanoseconds of Terrestrial Time since J2000, leap seconds included.

    Parameters
    ----------
    times : ndarray of datetime64[us], shape (rows,)
        UTC.

    Returns
    -------
    ndarray of int64, shape (rows,)
        `ISTP_FILL_INTEGER` for NaT.
    """
    known = ~np.isnat(times)
    found = np.full(times.shape, ISTP_FILL_INTEGER, dtype=np.int64)
    if known.any():
        moments = Time(times[known], format="datetime64", scale="utc").tt
        # both products are whole to well below a microsecond: the days are halves, and 2**53 microseconds are 285 years
        microseconds = (moments.jd1 - J2000_JD) * DAY_S * 1e6 + moments.jd2 * DAY_S * 1e6
        found[known] = np.rint(microseconds).astype(np.int64) * 1000
    return found


def _istp_header(table: RecordTable) -> dict[str, Any]:
    """Global attributes that the ISTP guidelines require, and the header of the table."""
    source = f"bella_{table.schema.name}"
    return {
        "Project": "BELLA>Type III radio bursts",
        "Source_name": "BELLA>BELLA service",
        "Discipline": "Space Physics>Interplanetary Studies",
        "Data_type": "L4>Level 4",
        "Descriptor": f"{table.schema.name}>{table.schema.title}",
        "Data_version": "1",
        "Logical_file_id": source,
        "Logical_source": source,
        "Logical_source_description": table.schema.title,
        "PI_name": "The BELLA service developers",
        "PI_affiliation": "BELLA service",
        "TEXT": table.header.get("remark", table.schema.title),
        "Instrument_type": "Radio and Plasma Waves (space)",
        "Mission_group": ["Wind", "STEREO", "Parker Solar Probe", "Solar Orbiter"],
        **{f"bella_{name}": _ascii(value) for name, value in table.header.items()},
    }


def _istp_epoch() -> dict[str, Any]:
    return {
        "CATDESC": "Time of the record, UTC",
        "FIELDNAM": "Epoch",
        "LABLAXIS": "Epoch",
        "UNITS": "ns",
        "VAR_TYPE": "support_data",
        "SCALETYP": "linear",
        "MONOTON": "INCREASE",
        "TIME_BASE": "J2000",
        "TIME_SCALE": "Terrestrial Time",
        "REFERENCE_POSITION": "Rotating Earth Geoid",
        **_istp_time_limits(),
    }


def _istp_time_limits() -> dict[str, Any]:
    limits = [np.int64((np.datetime64(day, "ns") - J2000).astype(np.int64)) for day in ISTP_VALID]
    return {
        "FORMAT": "I22",
        "CDF_DATA_TYPE": "CDF_TIME_TT2000",
        "FILLVAL": np.int64(ISTP_FILL_INTEGER),
        "VALIDMIN": limits[0],
        "VALIDMAX": limits[1],
    }


def _istp(column: Column, table: RecordTable) -> dict[str, Any]:
    values = table.data[column.name]
    common = {
        "CATDESC": _ascii(column.description)[:80],
        "FIELDNAM": column.name[:30],
        "LABLAXIS": column.name[:20],
        "DEPEND_0": "Epoch",
        "UCD": column.ucd,
        "VAR_TYPE": "data",
        "DISPLAY_TYPE": "time_series",
        "UNITS": column.unit or " ",
    }
    if column.kind == "time":
        return common | {"UNITS": "ns", **_istp_time_limits()}
    if column.kind == "text":
        return common | {"VAR_TYPE": "metadata", "FORMAT": f"A{_text_width(values)}", "FILLVAL": " "}
    if column.kind == "float":
        limit = 1e30
        return common | {"FORMAT": "E24.16", "FILLVAL": ISTP_FILL, "VALIDMIN": -limit, "VALIDMAX": limit}
    bounds = {"VALIDMIN": np.int64(0), "VALIDMAX": np.int64(1 if column.kind == "bool" else 2**31)}
    return common | {"FORMAT": "I11", "FILLVAL": np.int64(ISTP_FILL_INTEGER), **bounds}


def _istp_values(column: Column, values: Values) -> Values:
    match column.kind:
        case "time":
            return tt2000_ns(values)
        case "int" | "bool":
            return values.astype(np.int64)
        case "text":
            return np.array([_ascii(one) for one in values.tolist()], dtype=np.str_)
        case _:
            return values


def _text_width(values: Values) -> int:
    return max(1, *(len(_ascii(one)) for one in values.tolist()))


def _ascii(text: str) -> str:
    """Text as CDF readers expect it."""
    return text.replace("°", " deg").encode("ascii", "replace").decode()

"""Units in every format, and HAPI and TFCat with the numbers of the table."""

import csv
import io
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cdflib
import h5netcdf
import numpy as np
import pyarrow.parquet as pq
import pytest
from astropy import units as u
from astropy.io.votable import parse_single_table
from astropy.table import QTable
from hypothesis import given, settings

from bella.formats import ARRIVALS, DETECTIONS, EVENTS, FORMATS, SCHEMAS, RecordTable, Schema, record_table
from bella.formats.hapi import FLOAT_FILL, TEXT_FILL, TIME_FILL, encode, table_records
from bella.formats.record_table import distinct_times
from bella.formats.tfcat import tfcat_collections
from tests.formats.test_formats import tables

NOON = np.datetime64("2012-06-07T12:00:00.123456", "us")
ONE = {"time": NOON, "float": 1.5, "int": 3, "bool": True, "text": "WIND"}


def one_row(schema: Schema) -> RecordTable:
    return record_table(schema, [{one.name: ONE[one.kind] for one in schema.columns}], {"frame": "HEE"})


def of_cdf(raw: bytes, name: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.cdf"
        path.write_bytes(raw)
        return str(cdflib.CDF(path).varattsget(name)["UNITS"])


def of_netcdf(raw: bytes, name: str) -> str:
    with h5netcdf.File(io.BytesIO(raw)) as file:
        return str(file.variables[name].attrs["units"])


UNITS: dict[str, Callable[[bytes, str], Any]] = {
    "json": lambda raw, name: {one["name"]: one["unit"] for one in json.loads(raw)["columns"]}[name],
    "ecsv": lambda raw, name: QTable.read(raw.decode(), format="ascii.ecsv")[name].unit,
    "votable": lambda raw, name: parse_single_table(io.BytesIO(raw)).get_field_by_id_or_name(name).unit,
    "cdf": of_cdf,
    "netcdf": of_netcdf,
    "parquet": lambda raw, name: pq.read_schema(io.BytesIO(raw)).field(name).metadata[b"unit"].decode(),
}


@pytest.mark.parametrize("schema", SCHEMAS.values(), ids=lambda one: one.name)
@pytest.mark.parametrize("name", UNITS)
def test_every_format_has_the_unit_of_every_number(name: str, schema: Schema) -> None:
    raw = FORMATS[name].write(one_row(schema))
    chosen = {column.unit: column for column in schema.columns if column.kind == "float"}
    for column in chosen.values():  # one of each unit
        found = UNITS[name](raw, column.name)
        assert u.Unit("" if found in {None, " ", "1"} else found) == u.Unit(column.unit), column.name


def test_a_cdf_says_from_when_on_its_times_are_valid() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.cdf"
        path.write_bytes(FORMATS["cdf"].write(one_row(ARRIVALS)))
        said = cdflib.CDF(path).varattsget("arrival_utc")
    first, last = (str(cdflib.cdfepoch.encode_tt2000(int(said[name])))[:7] for name in ("VALIDMIN", "VALIDMAX"))
    assert (first, last) in {("1990-01", "2100-01"), ("1990-01", "2099-12"), ("1989-12", "2099-12")}


def test_a_netcdf_has_times_in_microseconds_since_1970() -> None:
    with h5netcdf.File(io.BytesIO(FORMATS["netcdf"].write(one_row(ARRIVALS)))) as file:
        stored = file.variables["arrival_utc"]
        assert stored.attrs["units"] == "microseconds since 1970-01-01"
        assert stored[0] == NOON.astype(np.int64)


def hapi_values(raw: bytes, output: str, table: RecordTable) -> list[list[Any]]:
    """Columns of a reply, as text or numbers, NaN where not known."""
    parameters = table_records(table).parameters
    if output == "json":
        return [list(one) for one in zip(*json.loads(raw)["data"], strict=True)]
    if output == "csv":
        return [list(one) for one in zip(*csv.reader(io.StringIO(raw.decode(), newline="")), strict=True)]
    kinds = {"double": "<f8", "integer": "<i4"}
    dtype = [(one.name, kinds.get(one.kind, f"S{one.length}")) for one in parameters]
    packed = np.frombuffer(raw, dtype=np.dtype(dtype))
    plain = [packed[one.name].tolist() for one in parameters]
    return [[one.decode() if isinstance(one, bytes) else one for one in column] for column in plain]


@settings(max_examples=6)
@given(tables())
def test_hapi_holds_the_same_numbers(table: RecordTable) -> None:
    ordered = table.in_time()
    integers = [one.name for one in table.schema.columns if one.kind == "int"]
    data = {**ordered.data, **{name: np.minimum(ordered.data[name], 2**31 - 1) for name in integers}}
    ordered = RecordTable(table.schema, data, table.header)
    for output in ("csv", "json", "binary"):
        time, *columns = hapi_values(encode(table_records(ordered), output, None), output, ordered)
        assert [np.datetime64(one.removesuffix("Z"), "us") for one in time] == list(
            distinct_times(ordered.data[table.schema.time])
        )
        for column, found in zip(table.schema.columns, columns, strict=True):
            expected = ordered.data[column.name]
            if column.kind == "time":
                got = [np.datetime64("NaT" if one == TIME_FILL else one.removesuffix("Z"), "us") for one in found]
            elif column.kind == "text":
                got = ["" if one == TEXT_FILL else one for one in found]
                expected = np.where(expected == TEXT_FILL, "", expected)
            else:
                got = [float(FLOAT_FILL if one is None else one) for one in found]
            np.testing.assert_array_equal(np.array(got, dtype=expected.dtype), expected, err_msg=column.name)


def test_hapi_has_the_unit_of_every_number() -> None:
    for schema in SCHEMAS.values():
        described = {one.name: one.described() for one in table_records(one_row(schema)).parameters}
        for column in schema.columns:
            expected = {"time": "UTC", "float": column.unit or None}.get(column.kind)
            found = described[column.name]["units"]
            assert found == expected or u.Unit(found) == u.Unit(expected), column.name


@settings(max_examples=6)
@given(tables((DETECTIONS, EVENTS)))
def test_tfcat_holds_the_same_numbers(table: RecordTable) -> None:
    boxed = table.data["f_low_mhz"] + table.data["f_high_mhz"]
    known = table.take(np.flatnonzero(np.isfinite(boxed) & ~np.isnat(table.data["end_utc"])))
    for observatory, collection in tfcat_collections(known).items():
        own = known.take(np.flatnonzero(known.data["observatory"] == observatory))
        for column in table.schema.columns:
            found = [one["properties"][column.name] for one in collection["features"]]
            if column.kind == "time":
                found = [np.datetime64(one.removesuffix("Z") if one else "NaT", "us") for one in found]
            elif column.kind == "float":
                found = [np.nan if one is None else one for one in found]
            expected = own.data[column.name]
            np.testing.assert_array_equal(np.array(found, dtype=expected.dtype), expected, err_msg=column.name)


def test_tfcat_has_the_unit_of_every_number() -> None:
    for schema in (DETECTIONS, EVENTS):
        (collection,) = tfcat_collections(one_row(schema)).values()
        found = {name: one.get("unit", "") for name, one in collection["fields"].items()}
        assert found == {one.name: one.unit for one in schema.columns}
        assert collection["crs"]["properties"]["spectral_coords"] == {"type": "frequency", "unit": "MHz"}
        assert collection["crs"]["properties"]["time_coords_id"] == "unix"
        (feature,) = collection["features"]
        assert feature["bbox"][0] == NOON.astype(np.int64) / 1e6

"""One table, many formats: each holds the same rows, numbers to the last bit, units and meanings."""

import csv
import io
import json
import math
import string
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from astropy import units as u
from astropy.io.votable import parse
from astropy.io.votable.ucd import parse_ucd
from astropy.table import QTable
from hypothesis import given, settings
from hypothesis import strategies as st

from bella.exceptions import InputError
from bella.formats import ARRIVALS, DETECTIONS, FORMATS, SCHEMAS, Column, RecordTable, Schema, find_format, record_table
from bella.formats.record_table import distinct_times
from bella.formats.tfcat import tfcat_collections
from tests.formats.reading import READERS, read_back

FIRST, LAST = (int(np.datetime64(year, "us").astype(int)) for year in ("1995-01-01", "2030-01-01"))

KNOWN_TIMES = st.integers(FIRST, LAST).map(lambda us: np.datetime64(us, "us"))
TIMES = st.none() | KNOWN_TIMES
FLOATS = st.none() | st.floats(allow_nan=False, allow_infinity=False, min_value=-1e30, max_value=1e30)
TEXTS = st.text(string.ascii_letters + string.digits + " ,;\"'<>&-_.()", max_size=20).map(str.strip)
VALUES = {"time": TIMES, "float": FLOATS, "int": st.integers(0, 2**31), "bool": st.booleans(), "text": TEXTS}


def values_of(column: Column, schema: Schema) -> st.SearchStrategy[Any]:
    if column.name == schema.time:
        return KNOWN_TIMES
    return VALUES[column.kind]


@st.composite
def tables(draw: st.DrawFn, schemas: tuple[Schema, ...] = tuple(SCHEMAS.values())) -> RecordTable:
    schema = draw(st.sampled_from(schemas))
    row = st.fixed_dictionaries({one.name: values_of(one, schema) for one in schema.columns})
    return record_table(schema, draw(st.lists(row, min_size=1, max_size=4)), {"frame": "HEE", "remark": "apparent"})


def assert_same(table: RecordTable, found: dict[str, list[Any]], name: str) -> None:
    for column in table.schema.columns:
        expected = table.data[column.name]
        got = np.array(found[column.name], dtype=expected.dtype if column.kind != "text" else np.str_)
        np.testing.assert_array_equal(got, expected, err_msg=f"{name}: {column.name}")


@settings(max_examples=12)
@given(tables())
def test_all_formats_hold_the_same_numbers(table: RecordTable) -> None:
    for name in READERS:
        written = FORMATS[name].write(table)
        assert_same(table.in_time() if name == "cdf" else table, read_back(name, written, table.schema), name)


STREAMED = [name for name, one in FORMATS.items() if one.pieces]


@settings(max_examples=8)
@given(tables(), st.lists(st.integers(0, 4), max_size=3))
def test_pieces_are_the_whole_table(table: RecordTable, cuts: list[int]) -> None:
    """Cut anywhere, also into parts without rows."""
    ends = [0, *sorted(min(cut, len(table)) for cut in cuts), len(table)]
    parts = [table.take(np.arange(*between)) for between in pairwise(ends)]
    for name in STREAMED:
        written = b"".join(FORMATS[name].write_pieces(table.schema, table.header, parts))
        assert_same(table, read_back(name, written, table.schema), name)
        assert b"apparent" in written, name


@pytest.mark.parametrize("name", STREAMED)
def test_no_pieces_are_a_table_without_rows(name: str) -> None:
    written = b"".join(FORMATS[name].write_pieces(DETECTIONS, {}, []))
    found = read_back(name, written, DETECTIONS)
    assert {column: len(values) for column, values in found.items()} == dict.fromkeys(DETECTIONS.names, 0)


def test_parquet_has_large_groups_of_rows(detections: RecordTable, monkeypatch: pytest.MonkeyPatch) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr("bella.formats.binary.GROUP_ROWS", 2 * len(detections))

    pieces = list(FORMATS["parquet"].write_pieces(DETECTIONS, {}, iter([detections] * 5)))

    file = pq.ParquetFile(io.BytesIO(b"".join(pieces)))
    assert [file.metadata.row_group(one).num_rows for one in range(3)] == [
        count * len(detections) for count in (2, 2, 1)
    ]
    assert len(pieces) == 3


@pytest.mark.parametrize("schema", SCHEMAS.values(), ids=lambda one: one.name)
@pytest.mark.parametrize("name", [name for name in READERS if name != "cdf"])
def test_a_table_without_rows_has_its_columns(name: str, schema: Schema) -> None:
    empty = record_table(schema, [])
    found = read_back(name, FORMATS[name].write(empty), schema)
    assert {column: len(values) for column, values in found.items()} == dict.fromkeys(schema.names, 0)


def test_cdf_says_that_it_has_no_empty_table() -> None:
    with pytest.raises(InputError, match="no empty table"):
        FORMATS["cdf"].write(record_table(DETECTIONS, []))


def test_a_degree_sign_is_kept_by_all_but_cdf_which_spells_it(detections: RecordTable) -> None:
    said = "26° W, \u03c6 wide"
    table = record_table(DETECTIONS, [row | {"reason": said} for row in rows_of(detections)])
    for name in READERS:
        read = read_back(name, FORMATS[name].write(table), DETECTIONS)["reason"][0]
        assert read == ("26 deg W, ? wide" if name == "cdf" else said), name


def rows_of(table: RecordTable) -> list[dict[str, Any]]:
    return [dict(zip(table.schema.names, row, strict=True)) for row in zip(*table.data.values(), strict=True)]


@pytest.fixture
def detections() -> RecordTable:
    received = {"f_low_mhz": 0.25, "f_high_mhz": 8.0, "channels": 40, "isolated": True, "score": 9.5}
    times = {"start_utc": "2012-06-07T19:29:15.5Z", "peak_utc": "2012-06-07T19:32Z", "end_utc": "2012-06-07T20:00:00Z"}
    return record_table(DETECTIONS, [{"observatory": name, **times, **received} for name in ("WIND", "STEREO-A")])


def test_times_are_utc_whatever_zone_they_came_in() -> None:
    row = {"observatory": "WIND", "start_utc": "2012-06-07T21:29:15+02:00", "channels": 1, "isolated": False}
    table = record_table(DETECTIONS, [row])
    assert table.data["start_utc"][0] == np.datetime64("2012-06-07T19:29:15", "us")


def test_infinite_numbers_are_not_known() -> None:
    row = {"channels": 1, "isolated": False, "start_utc": "2012-06-07", "score": math.inf, "drift": -math.inf}
    table = record_table(DETECTIONS, [row])
    assert json.loads(FORMATS["json"].write(table))["rows"][0]["score"] is None
    assert np.isnan(table.data["drift"][0])


def test_times_of_records_are_made_distinct_and_stay_in_order() -> None:
    times = np.array([0, 0, 500, 900, 5000, 5000, 9000], dtype="datetime64[us]")
    assert distinct_times(times).astype(int).tolist() == [0, 1000, 2000, 3000, 5000, 6000, 9000]


def test_an_integer_that_is_not_known_is_refused_by_column_and_row() -> None:
    row = {"channels": 1, "isolated": False, "start_utc": "2012-06-07"}
    with pytest.raises(InputError, match="column channels: row 2"):
        record_table(DETECTIONS, [row, row | {"channels": None}])


@pytest.mark.parametrize("schema", SCHEMAS.values(), ids=lambda one: one.name)
def test_every_column_has_a_meaning_and_a_unit_that_its_name_carries(schema: Schema) -> None:
    tails = {
        "_mhz": "MHz",
        "_rsun": "solRad",
        "_rsun2": "solRad2",
        "_deg": "deg",
        "_km_s": "km/s",
        "_s": "s",
        "_d": "d",
        "_sfu_1au": "10**4 Jy",
    }
    assert len(set(schema.names)) == len(schema.names)
    assert schema.time in schema.names
    for column in schema.columns:
        assert column.description.endswith("."), column.name
        assert parse_ucd(column.ucd, check_controlled_vocabulary=True), column.name
        tail = next((unit for end, unit in tails.items() if column.name.endswith(end) and column.kind == "float"), "")
        assert column.unit in {tail, "dB"}, column.name


def test_ecsv_has_units_and_times_that_astropy_knows(detections: RecordTable) -> None:
    table = QTable.read(FORMATS["ecsv"].write(detections).decode(), format="ascii.ecsv")
    assert table["f_high_mhz"][0] == 8 * u.MHz
    assert table["start_utc"].scale == "utc"
    assert table["start_utc"][0].isot == "2012-06-07T19:29:15.500000"
    assert table["score"].info.description == "Of the matched filter, in standard deviations of noise."


def test_a_flux_density_is_in_solar_flux_units_and_its_unit_says_how_large_they_are(detections: RecordTable) -> None:
    table = record_table(
        DETECTIONS, [row | {"flux_sfu_1au": 250.0, "origin": "archive"} for row in rows_of(detections)]
    )
    read = QTable.read(FORMATS["ecsv"].write(table).decode(), format="ascii.ecsv")
    assert read["flux_sfu_1au"][0].to_value("W m-2 Hz-1") == pytest.approx(250.0 * 1e-22)
    fields = {one.name: one for one in parse(io.BytesIO(FORMATS["votable"].write(table))).get_first_table().fields}
    assert (1 * fields["flux_sfu_1au"].unit).to_value("Jy") == pytest.approx(1e4)
    assert json.loads(FORMATS["json"].write(table))["rows"][0]["origin"] == "archive"


def test_votable_has_units_ucds_and_a_time_system(detections: RecordTable) -> None:
    file = parse(io.BytesIO(FORMATS["votable"].write(detections)))
    table = file.get_first_table()
    fields = {field.name: field for field in table.fields}
    assert file.version == "1.4"
    assert (str(fields["f_low_mhz"].unit), fields["f_low_mhz"].ucd) == ("MHz", "em.freq;stat.min")
    assert [one.timescale for one in file.resources[0].time_systems] == ["UTC"]
    assert fields["start_utc"].xtype == "timestamp"


def test_a_comma_or_line_break_in_a_header_line_stays_in_its_line(detections: RecordTable) -> None:
    table = RecordTable(detections.schema, detections.data, {"remark": "first,\nsecond"})
    lines = FORMATS["csv"].write(table).decode().splitlines()
    assert lines[0] == "# remark: first, second"
    assert next(csv.reader(lines[1:2])) == list(DETECTIONS.names)


def test_tfcat_has_one_collection_per_spacecraft_with_the_box_of_each_detection(detections: RecordTable) -> None:
    found = tfcat_collections(detections)
    assert list(found) == ["WIND", "STEREO-A"]
    wind = found["WIND"]
    assert wind["crs"]["properties"]["ref_position_id"] == "wind"
    ring = np.array(wind["features"][0]["geometry"]["coordinates"][0])
    begin, end = 1339097355.5, 1339099200.0
    assert ring.tolist() == [[begin, 0.25], [end, 0.25], [end, 8.0], [begin, 8.0], [begin, 0.25]]
    assert wind["features"][0]["bbox"] == [begin, 0.25, end, 8.0]
    assert set(wind["features"][0]["properties"]) == set(wind["fields"]) == set(DETECTIONS.names)


def test_tfcat_draws_the_edge_of_a_burst_as_a_line_upward_in_frequency() -> None:
    rows = [
        {"burst_id": "T3", "observatory": "WIND", "frequency_mhz": f, "arrival_utc": t, "edge": "half_rise"}
        for f, t in ((0.5, "2012-06-07T19:40:00Z"), (1.0, "2012-06-07T19:35:00Z"), (0.25, "2012-06-07T19:50:00Z"))
    ]
    (feature,) = tfcat_collections(record_table(ARRIVALS, rows))["WIND"]["features"]
    line = feature["geometry"]["coordinates"]
    assert feature["geometry"]["type"] == "LineString"
    assert [f for _, f in line] == [0.25, 0.5, 1.0]
    assert [t - line[2][0] for t, _ in line] == [900.0, 300.0, 0.0]
    assert feature["properties"]["edge"] == "half_rise"


def test_tfcat_of_several_spacecraft_asks_for_one(detections: RecordTable) -> None:
    with pytest.raises(InputError, match=r"WIND, STEREO-A.*observatory="):
        FORMATS["tfcat"].write(detections)
    with pytest.raises(InputError, match="detections, arrivals, events only"):
        FORMATS["tfcat"].write(record_table(SCHEMAS["tracks"], []))


def test_an_unknown_format_is_refused_with_the_list_of_known_ones() -> None:
    with pytest.raises(InputError, match=r"'xls'.*json, csv, ecsv, votable, tfcat, cdf, netcdf, parquet"):
        find_format("xls")

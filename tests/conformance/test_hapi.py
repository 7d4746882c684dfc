"""HAPI: every data set against the rules of the published schema (3.3), the data against their header, and a client."""

import csv
import gzip
import http.client
import io
import json
import re
import struct
import urllib.parse
import warnings
from itertools import pairwise
from typing import Any

import jsonschema
import numpy as np
import pytest

from api.hapi_datasets import DATASETS
from tests.plotting.synthetic import BURST_ID

INSTANT = r"^\d{4}(-\d{3}|-(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01]))T([01]\d|2[0-3]):[0-5]\d:[0-5]\d(\.\d{0,9})?Z$"
STATUS = {
    "type": "object",
    "required": ["code", "message"],
    "additionalProperties": False,
    "properties": {"code": {"type": "integer"}, "message": {"type": "string", "pattern": r"\S"}},
}
HEAD = {"HAPI": {"const": "3.3"}, "status": STATUS}
PARAMETER = {
    "type": "object",
    "required": ["name", "type", "units", "fill"],
    "additionalProperties": False,
    "properties": {
        "name": {"type": "string", "pattern": "^[_a-zA-Z][_a-zA-Z0-9]{0,30}$"},
        "type": {"enum": ["string", "double", "integer", "isotime"]},
        "units": {"type": ["string", "null"], "minLength": 1},
        "fill": {"type": ["string", "null"]},
        "length": {"type": "integer", "minimum": 1},
        "size": {"type": "array", "items": {"type": "integer", "minimum": 2}, "minItems": 1},
        "description": {"type": "string"},
        "coordinateSystemName": {"type": "string"},
        "vectorComponents": {"type": "array", "items": {"enum": ["x", "y", "z"]}},
    },
}


def reply_schema(**more: Any) -> dict[str, Any]:
    return {
        "type": "object",
        "required": ["HAPI", "status", *more],
        "additionalProperties": False,
        "properties": HEAD | more,
    }


LISTED = {"type": "object", "required": ["id"], "properties": {"id": {"type": "string"}, "title": {"maxLength": 40}}}
SCHEMAS = {
    "about": reply_schema(
        **{name: {"type": "string", "minLength": 1} for name in ("id", "title", "contact", "description")},
        serverCitation={"type": "string"},
    ),
    "capabilities": reply_schema(
        outputFormats={
            "type": "array",
            "minItems": 1,
            "uniqueItems": True,
            "items": {"enum": ["csv", "binary", "json"]},
        }
    ),
    "catalog": reply_schema(catalog={"type": "array", "minItems": 1, "uniqueItems": True, "items": LISTED}),
    "info": reply_schema(
        **{
            name: {"type": "string", "pattern": INSTANT}
            for name in ("startDate", "stopDate", "sampleStartDate", "sampleStopDate")
        },
        cadence={"type": "string", "pattern": r"^P(\d+D)?(T(\d+H)?(\d+M)?(\d+S)?)?$"},
        timeStampLocation={"enum": ["begin", "center", "end", "other"]},
        description={"type": "string"},
        unitsSchema={"enum": ["astropy3", "cdf-cluster", "udunits2", "vounits1.1"]},
        datasetCitation={"type": "string"},
        parameters={"type": "array", "minItems": 2, "uniqueItems": True, "items": PARAMETER},
    ),
}

Reply = tuple[http.client.HTTPResponse, bytes]


def asked(address: str, path: str, method: str = "GET", encoding: str = "", **query: str) -> Reply:
    host = urllib.parse.urlsplit(address).netloc
    connection = http.client.HTTPConnection(host, timeout=30)
    words = f"?{urllib.parse.urlencode(query)}" if query else ""
    connection.request(method, f"/hapi/{path}{words}", headers={"Accept-Encoding": encoding} if encoding else {})
    reply = connection.getresponse()
    return reply, reply.read()


def header_of(address: str, name: str) -> dict[str, Any]:
    return json.loads(asked(address, "info", dataset=name)[1])  # type: ignore[no-any-return]


def sample(address: str, name: str, **query: str) -> Reply:
    header = header_of(address, name)
    return asked(address, "data", dataset=name, start=header["sampleStartDate"], stop=header["sampleStopDate"], **query)


def rows(body: bytes) -> list[list[str]]:
    return list(csv.reader(io.StringIO(body.decode(), newline="")))


@pytest.mark.parametrize("path", ["about", "capabilities", "catalog"])
def test_metadata_follow_the_schema(address: str, path: str) -> None:
    reply, body = asked(address, path)
    assert reply.status == 200
    assert reply.headers["Content-Type"] == "application/json"
    assert reply.headers["Last-Modified"]
    jsonschema.validate(json.loads(body), SCHEMAS[path])


def test_data_sets_are_listed_once_they_have_a_record(address: str, empty_address: str) -> None:
    assert [one["id"] for one in json.loads(asked(address, "catalog")[1])["catalog"]] == list(DATASETS)
    listed = json.loads(asked(empty_address, "catalog")[1])["catalog"]
    assert [one["id"] for one in listed] == ["spacecraft_positions"]
    assert asked(empty_address, "info", dataset="detections")[0].status == 200


@pytest.mark.parametrize("name", DATASETS)
def test_headers_follow_the_schema_and_describe_the_time_first(address: str, name: str) -> None:
    header = header_of(address, name)
    jsonschema.validate(header, SCHEMAS["info"])
    first, *others = header["parameters"]
    assert (first["name"], first["type"], first["units"], first["fill"]) == ("Time", "isotime", "UTC", None)
    for one in others:
        assert ("length" in one) == (one["type"] in {"isotime", "string"}), one
        assert one["type"] != "isotime" or (one["units"] == "UTC" and len(one["fill"]) == one["length"])
        assert "vectorComponents" not in one or one["size"] == [len(one["vectorComponents"])]


@pytest.mark.parametrize("name", DATASETS)
def test_csv_binary_and_json_hold_the_same_records(address: str, name: str) -> None:
    parameters = header_of(address, name)["parameters"]
    text = rows(sample(address, name)[1])
    whole = json.loads(sample(address, name, format="json")[1])
    packed = sample(address, name, format="binary")[1]
    parts = [(one, i) for one in parameters for i in range(one.get("size", [1])[0])]
    kinds = {"double": "d", "integer": "i"}
    layout = struct.Struct("<" + "".join(kinds.get(one["type"], f"{one.get('length')}s") for one, _ in parts))
    assert len(text) > 1
    assert len(packed) == layout.size * len(text)
    assert len(whole["data"]) == len(text)
    assert all(len(row) == len(parts) for row in text)
    times = [row[0] for row in text]
    assert times == sorted(set(times))
    for row, binary, plain in zip(text, layout.iter_unpack(packed), whole["data"], strict=True):
        flat = [part for one in plain for part in (one if isinstance(one, list) else [one])]
        for (parameter, _), cell, stored, value in zip(parts, row, binary, flat, strict=True):
            if parameter["type"] == "double":
                assert np.array_equal(float(cell), stored, equal_nan=True)
                assert (value is None and np.isnan(stored)) or value == stored
            elif parameter["type"] == "integer":
                assert int(cell) == stored == value
            else:
                assert stored.rstrip(b"\0").decode() == cell == value
                assert len(cell.encode()) <= parameter["length"]


def test_records_of_one_time_are_put_apart_and_keep_their_own_time(address: str) -> None:
    found = rows(sample(address, "detections", parameters="observatory,start_utc")[1])
    assert [row[1] for row in found] == ["STEREO-A", "WIND", "WIND"]
    assert found[0][2] == found[1][2] == found[0][0] == "2012-06-07T19:29:15.000000Z"
    assert found[1][0] == "2012-06-07T19:29:15.001000Z"


def test_adjacent_requests_make_the_whole_with_no_record_twice(address: str) -> None:
    def between(start: str, stop: str) -> list[list[str]]:
        return rows(asked(address, "data", dataset="detections", start=start, stop=stop)[1])

    whole = between("2012-06-07Z", "2012-06-08Z")
    cuts = [
        "2012-06-07Z",
        "2012-06-07T19:29:15Z",
        "2012-06-07T19:29:15.001Z",
        "2012-06-07T19:36:15.0005Z",
        "2012-06-08Z",
    ]
    assert [row for pair in pairwise(cuts) for row in between(*pair)] == whole
    assert len(whole) == 3


@pytest.mark.parametrize("name", ["localisations", "arrivals"])
def test_a_record_long_after_the_onset_of_its_burst_is_found_at_its_own_time(address: str, name: str) -> None:
    times = [row[0] for row in rows(sample(address, name, parameters="burst_id")[1]) if row[1] == BURST_ID]
    late = times[-1]
    after = f"{np.datetime64(late.removesuffix('Z'), 'us') + np.timedelta64(1, 'us')}Z"
    found = rows(asked(address, "data", dataset=name, start=late, stop=after, parameters="burst_id")[1])
    assert found == [[late, BURST_ID]]
    assert abs(np.datetime64(late.removesuffix("Z")) - np.datetime64("2012-06-07T19:29:15")) > np.timedelta64(5, "s")


@pytest.mark.parametrize(
    ("start", "stop"),
    [
        ("2012-06-07", "2012-06-08Z"),
        ("2012-159Z", "2012-160"),
        ("2012-06-07T19Z", "2012-159T24Z"),
        ("2012-06Z", "2013Z"),
    ],
)
def test_times_may_be_cut_short_and_count_days(address: str, start: str, stop: str) -> None:
    found = rows(asked(address, "data", id="bursts", **{"time.min": start, "time.max": stop}, parameters="burst_id")[1])
    assert found[0] == ["2012-06-07T19:29:15.000000Z", BURST_ID]
    assert len(found) == (3 if stop == "2013Z" else 1)


def test_a_header_stands_above_the_data_and_parameters_are_chosen(address: str) -> None:
    reply, body = sample(address, "bursts", include="header", parameters="phi0_deg,sentence")
    first, *lines = body.decode().splitlines()
    header = json.loads(first.removeprefix("#"))
    assert reply.headers["Content-Type"].startswith("text/csv")
    assert header.pop("format") == "csv"
    jsonschema.validate(header, SCHEMAS["info"])
    assert [one["name"] for one in header["parameters"]] == ["Time", "phi0_deg", "sentence"]
    assert header["parameters"][1]["units"] == "deg"
    assert all(len(row) == 3 for row in csv.reader(lines))


def test_compressed_data_are_the_same(address: str) -> None:
    reply, body = sample(address, "bursts", encoding="gzip", parameters="phi0_deg")
    assert reply.headers["Content-Encoding"] == "gzip"
    assert "Accept-Encoding" in reply.headers["Vary"]
    assert gzip.decompress(body) == sample(address, "bursts", parameters="phi0_deg")[1]


@pytest.mark.parametrize("path", ["", "about", "capabilities", "catalog", "info?dataset=bursts"])
def test_head_is_answered_without_a_body(address: str, path: str) -> None:
    reply, body = asked(address, path, "HEAD")
    assert (reply.status, body) == (200, b"")


def test_no_data_in_a_time_is_1201_in_the_status_line_and_in_json(address: str) -> None:
    nothing = {"dataset": "bursts", "start": "2001-01-01Z", "stop": "2001-01-02Z"}
    reply, body = asked(address, "data", **nothing)
    assert (reply.status, body) == (200, b"")
    assert reply.reason == "OK; HAPI 1201 OK - no data for time range"
    said = json.loads(asked(address, "data", **nothing, format="json")[1])
    assert (said["status"]["code"], said["data"]) == (1201, [])


DATA = {"dataset": "bursts", "start": "2012-06-07Z", "stop": "2012-06-08Z"}


@pytest.mark.parametrize(
    ("path", "query", "http_status", "code"),
    [
        ("nothing", {}, 400, 1400),
        ("data", {"start": "2012Z", "stop": "2013Z"}, 400, 1400),
        ("data", DATA | {"fields": "x"}, 400, 1401),
        ("about", {"dataset": "bursts"}, 400, 1401),
        ("data", DATA | {"start": "yesterday"}, 400, 1402),
        ("data", DATA | {"start": "2012-13-01Z"}, 400, 1402),
        ("data", DATA | {"start": "2011-366Z"}, 400, 1402),
        ("data", DATA | {"start": "2012-000Z"}, 400, 1402),
        ("data", DATA | {"start": "2012T10Z"}, 400, 1402),
        ("data", DATA | {"start": "2012-06-07T24:01Z"}, 400, 1402),
        ("data", {"dataset": "bursts", "stop": "2013Z"}, 400, 1402),
        ("data", DATA | {"stop": "2012-06-07T10:61Z"}, 400, 1403),
        ("data", DATA | {"stop": "2012-06-07Z"}, 400, 1404),
        ("data", DATA | {"start": "1980Z"}, 400, 1405),
        ("data", DATA | {"stop": "2999Z"}, 400, 1405),
        ("info", {"dataset": "type2"}, 404, 1406),
        ("data", DATA | {"parameters": "phi0_rad"}, 404, 1407),
        ("info", {"dataset": "bursts", "parameters": "phi0_rad"}, 404, 1407),
        ("data", {"dataset": "spacecraft_positions", "start": "1995Z", "stop": "2025Z"}, 400, 1408),
        ("data", DATA | {"format": "xml"}, 400, 1409),
        ("data", DATA | {"include": "footer"}, 400, 1410),
        ("data", DATA | {"parameters": "sentence,phi0_deg"}, 400, 1411),
        ("data", DATA | {"parameters": "phi0_deg,phi0_deg"}, 400, 1411),
        ("info", {"dataset": "bursts", "resolve_references": "maybe"}, 400, 1412),
        ("catalog", {"depth": "all"}, 400, 1413),
    ],
)
def test_what_is_wrong_has_its_code_and_is_not_echoed(
    address: str, path: str, query: dict[str, str], http_status: int, code: int
) -> None:
    reply, body = asked(address, path, **query)
    said = json.loads(body)
    jsonschema.validate(said, reply_schema())
    assert (reply.status, said["status"]["code"]) == (http_status, code)
    assert said["status"]["message"].startswith(f"HAPI error {code}: ")
    assert f"HAPI error {code}" in reply.reason
    for wrong in ("yesterday", "type2", "phi0_rad", "fields", "xml", "footer", "maybe"):
        assert not re.search(rf"\b{wrong}\b", said["status"]["message"])


def test_hapiclient_reads_the_bursts(address: str) -> None:
    hapiclient = pytest.importorskip("hapiclient", reason="hapiclient is not installed: pip install hapiclient")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data, header = hapiclient.hapi(
            f"{address}/hapi", "bursts", "phi0_deg,sentence", "2012-06-07Z", "2012-06-09Z", cache=False, usecache=False
        )
    assert header["parameters"][1]["units"] == "deg"
    assert data["phi0_deg"].tolist() == [
        float(row[1]) for row in rows(sample(address, "bursts", parameters="phi0_deg")[1])[:2]
    ]


def records(address: str, name: str) -> list[dict[str, str]]:
    """Records of the sample of a data set, by the names of its parameters."""
    names: list[str] = []
    for one in header_of(address, name)["parameters"]:
        names += [f"{one['name']}_{part}" for part in one["vectorComponents"]] if "size" in one else [one["name"]]
    return [dict(zip(names, row, strict=True)) for row in rows(sample(address, name)[1])]


def test_availability_says_what_was_searched_and_who_had_data(address: str) -> None:
    searched, silent = records(address, "availability")
    assert (searched["Time"], silent["Time"]) == ("2012-06-07T00:00:00.000000Z", "2012-06-08T00:00:00.000000Z")
    assert (searched["answer"], silent["answer"], silent["reason"]) == ("no burst", "archive silent", "no answer")
    assert (searched["detections"], searched["rejected"], searched["shared"]) == ("2", "1", "1")
    assert (searched["observatories"], float(searched["wind_hours"])) == ("WIND STEREO-A", 12.0)
    assert (float(searched["stereo_a_hours"]), silent["wind_hours"]) == (0.0, "NaN")


def test_latency_says_how_long_each_solution_took(address: str) -> None:
    one, other = records(address, "latency")
    assert (other["data_to_published_s"], other["solution_id"] != one["solution_id"]) == ("324000.0", True)
    assert one["Time"] == one["published_utc"] == "2012-06-11T13:29:15.000000Z"
    assert one["burst_id"] == BURST_ID
    assert one["solution_id"].startswith(f"{BURST_ID}.half_maximum")
    hours = {step: float(one[f"{step}_to_published_s"]) / 3600 for step in ("data", "seen", "fetched")}
    assert hours == {"data": 89.0, "seen": 3.0, "fetched": 2.0}
    assert (one["detected_utc"], one["detected_to_published_s"]) == ("0001-01-01T00:00:00.000000Z", "NaN")


def test_events_come_with_the_burst_that_they_are_near_to(address: str) -> None:
    flare, cme = records(address, "events")
    assert (flare["event_id"], flare["burst_id"], float(flare["delay_s"])) == ("DONKI:F", BURST_ID, -120.0)
    assert (cme["event_id"], cme["burst_id"], cme["delay_s"]) == ("DONKI:C", "-", "NaN")
    assert flare["Time"] == flare["start_utc"] == "2012-06-07T19:27:15.000000Z"
    later = {"start": "2012-06-07T19:30Z", "stop": "2012-06-08Z", "parameters": "event_id"}
    assert [one[1] for one in rows(asked(address, "data", dataset="events", **later)[1])] == ["DONKI:C"]

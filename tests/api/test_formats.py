"""One query, many formats: chosen by name or by the Accept header, with the same numbers, and cuts that are said."""

import json
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from bella.formats import BURSTS, FORMATS, LOCALISATIONS
from tests.api.published import CHANNELS
from tests.formats.reading import READERS, read_back
from tests.plotting.synthetic import BURST_ID, synthetic_posterior

TABLES = ["bursts", "tracks", "localisations", f"bursts/{BURST_ID}/track", f"bursts/{BURST_ID}/arrivals"]


def got(client: TestClient, path: str, accept: str = "*/*", **query: Any) -> Any:
    reply = client.get(f"/api/v1/{path}", params=query, headers={"Accept": accept})
    assert reply.status_code == 200, reply.text
    return reply


@pytest.mark.parametrize("path", TABLES)
@pytest.mark.parametrize("name", [name for name in FORMATS if name not in {"json", "tfcat"}])
def test_a_format_is_chosen_by_name_or_by_media_type(client: TestClient, path: str, name: str) -> None:
    media_type = FORMATS[name].media_type
    named, accepted = got(client, path, format=name), got(client, path, accept=media_type)
    for reply in (named, accepted):
        assert reply.headers["content-type"].partition(";")[0] == media_type
        assert reply.headers["content-disposition"].endswith(f'{FORMATS[name].suffix}"')
        assert "Accept" in reply.headers["vary"].split(", ")


@pytest.mark.parametrize(
    ("accept", "expected"),
    [
        ("*/*", "application/json"),
        ("", "application/json"),
        ("text/html,application/xhtml+xml,*/*;q=0.8", "application/json"),
        ("text/csv;q=0.5, application/json", "application/json"),
        ("application/json;q=0.2, text/csv;q=0.9", "text/csv"),
        ("application/x-votable+xml, */*;q=0.1", "application/x-votable+xml"),
        ("image/png, text/csv", "text/csv"),
    ],
)
def test_the_best_accepted_format_is_taken(client: TestClient, accept: str, expected: str) -> None:
    assert got(client, "bursts", accept).headers["content-type"].partition(";")[0] == expected


@pytest.mark.parametrize("path", [*TABLES, "detections?start=2012-06-07&stop=2012-06-08"])
def test_what_is_not_known_is_refused_with_what_is(client: TestClient, path: str) -> None:
    join = "&" if "?" in path else "?"
    named = client.get(f"/api/v1/{path}{join}format=xls")
    accepted = client.get(f"/api/v1/{path}", headers={"Accept": "image/png, text/csv;q=0"})
    assert named.status_code == 406
    assert "json, csv, ecsv, votable, tfcat, cdf, netcdf, parquet" in named.json()["detail"]
    assert accepted.status_code == 406
    assert "application/x-votable+xml" in accepted.json()["detail"]


def test_a_table_that_tfcat_cannot_hold_says_so(client: TestClient) -> None:
    reply = client.get("/api/v1/bursts?format=tfcat")
    assert reply.status_code == 422
    assert "detections, arrivals, events only" in reply.json()["detail"]


def test_json_of_the_api_and_all_tables_hold_the_same_numbers(client: TestClient) -> None:
    bursts = got(client, "bursts", sort="start").json()["bursts"]
    for name in READERS:
        if name == "json":
            continue
        found = read_back(name, got(client, "bursts", format=name, sort="start").content, BURSTS)
        assert found["burst_id"] == [one["burst_id"] for one in bursts], name
        for column in ("phi0_deg", "range_low_rsun", "v_sw_high_km_s"):
            assert found[column] == [one["solutions"][0][column] for one in bursts], name
        assert found["solution_id"] == [one["preferred_solution"] for one in bursts], name
        for column in ("origin", "grade", "tier"):
            assert found[column] == [one[column] for one in bursts], name


def test_localisations_are_those_of_the_track_to_the_last_digit(client: TestClient) -> None:
    expected = got(client, f"bursts/{BURST_ID}/track").json()["localisations"]
    for name in READERS:
        if name in {"json", "csv", "cdf"}:  # the route has its own JSON and CSV; CDF has its rows by time
            continue
        found = read_back(name, got(client, f"bursts/{BURST_ID}/track", format=name).content, LOCALISATIONS)
        for column in ("frequency_mhz", "x_rsun", "cov_xy_rsun2", "modes", "log_evidence"):
            assert found[column] == [row[column] for row in expected], (name, column)
    csv = got(client, f"bursts/{BURST_ID}/track", format="csv").text.splitlines()
    heading = next(i for i, line in enumerate(csv) if not line.startswith("#"))
    x = csv[heading].split(",").index("x_rsun")
    assert [float(line.split(",")[x]) for line in csv[heading + 1 :]] == [row["x_rsun"] for row in expected]


def test_a_cut_table_says_so_and_its_pages_make_the_whole(client: TestClient) -> None:
    whole = read_back("csv", got(client, "bursts", format="csv").content, BURSTS)["burst_id"]
    reply = got(client, "bursts", format="csv", limit=3)
    seen: list[str] = []
    while True:
        seen += read_back("csv", reply.content, BURSTS)["burst_id"]
        if "link" not in reply.headers:
            break
        following = reply.links["next"]["url"]
        assert f"# next: {following}" in reply.text.splitlines()
        reply = client.get(following)
    assert seen == whole
    assert len(whole) == 8


def test_arrival_times_are_those_of_the_posterior_and_of_one_spacecraft_where_asked(client: TestClient) -> None:
    rows = json.loads(got(client, f"bursts/{BURST_ID}/arrivals").content)["rows"]
    one = json.loads(got(client, f"bursts/{BURST_ID}/arrivals", observatory="WIND").content)["rows"]
    assert {row["observatory"] for row in rows} == {"WIND", "STEREO-A", "STEREO-B"}
    assert one == [row for row in rows if row["observatory"] == "WIND"]
    posterior = synthetic_posterior("half_maximum", frequencies=CHANNELS)
    after_s = posterior["arrival_s"].sel(observatory="WIND").to_numpy()
    start = np.datetime64(posterior.attrs["reference_time"].removesuffix("Z"))
    away = [np.datetime64(row["arrival_utc"].removesuffix("Z")) - start for row in one]
    np.testing.assert_allclose(np.array(away) / np.timedelta64(1, "s"), after_s, atol=1e-6)
    refused = client.get(f"/api/v1/bursts/{BURST_ID}/arrivals?observatory=PSP")
    assert refused.status_code == 422
    assert "WIND" in refused.json()["detail"]
    tfcat = got(client, f"bursts/{BURST_ID}/arrivals", observatory="WIND", format="tfcat").json()
    line = tfcat["features"][0]["geometry"]["coordinates"]
    assert [f for _, f in line] == sorted(row["frequency_mhz"] for row in one)

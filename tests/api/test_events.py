"""Published events over HTTP: beside a burst, as a list, and as tables with positions."""

import csv
import io
import json
from pathlib import Path
from typing import Any

import httpx
import pytest
import tfcat
from fastapi.testclient import TestClient

from api.app import create_app
from bella.catalogue import Catalogue
from bella.pipeline.linked_events import refresh_events
from bella.settings import Settings
from tests.api.published import publish_event, settings_of
from tests.linked_events.published import FILES
from tests.plotting.synthetic import BURST_ID


@pytest.fixture(scope="module")
def settings(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    lists = tmp_path_factory.mktemp("lists")
    for name, content in FILES.items():
        (lists / name).write_text(content)
    (lists / "broken.json").write_text("{")
    made = settings_of(tmp_path_factory.mktemp("home"), events=lists)
    with Catalogue.open(made.catalogue_url, create=True) as catalogue:
        publish_event(made, catalogue)
    refresh_events(made)
    return made


@pytest.fixture(scope="module")
def client(settings: Settings) -> TestClient:
    return TestClient(create_app(settings))


def asked(client: TestClient, path: str) -> Any:
    reply = client.get(f"/api/v1/{path}")
    assert reply.status_code == 200, reply.text
    return reply.json()


def test_caches_keep_the_formats_of_the_list_apart(client: TestClient) -> None:
    for media_type in ("application/json", "text/csv"):
        reply = client.get("/api/v1/events", headers={"Accept": media_type})
        assert reply.headers["content-type"].startswith(media_type)
        assert "Accept" in reply.headers["vary"].split(", ")


def test_events_of_a_burst_come_with_their_delays_and_the_lists(client: TestClient) -> None:
    reply = asked(client, f"bursts/{BURST_ID}/events")
    kinds = [one["kind"] for one in reply["events"]]
    assert sorted(kinds) == ["cme", "flare", "flare", "particles", "radio"]
    assert [abs(one["delay_s"]) for one in reply["events"]] == sorted(abs(one["delay_s"]) for one in reply["events"])
    flare = next(one for one in reply["events"] if one["source"] == "DONKI" and one["kind"] == "flare")
    assert (flare["size"], flare["longitude_deg"], flare["region"]) == ("C3.4", 62.0, 11494)
    assert flare["start_utc"] == "2012-06-07T19:24:00Z"
    states = {one["name"]: one["state"] for one in reply["lists"]}
    assert states == dict.fromkeys(FILES, "read") | {"broken.json": "refused"}
    assert "is damaged" in next(one["message"] for one in reply["lists"] if one["state"] == "refused")
    assert "no proof" in reply["remark"]
    assert asked(client, f"bursts/{BURST_ID}")["events"] == reply["events"]
    assert asked(client, "bursts")["bursts"][0]["events"] is None
    assert asked(client, f"bursts/{BURST_ID}")["links"]["events"] == f"/api/v1/bursts/{BURST_ID}/events"
    assert client.get("/api/v1/bursts/T3-19990101-0000/events").status_code == 404


def test_without_lists_it_says_that_nothing_was_compared(tmp_path: Path) -> None:
    settings = settings_of(tmp_path)
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        publish_event(settings, catalogue)
    reply = asked(TestClient(create_app(settings)), f"bursts/{BURST_ID}/events")
    assert (reply["events"], reply["lists"]) == ([], [])
    assert "was not compared with any" in reply["remark"]


def test_events_are_listed_page_by_page(client: TestClient) -> None:
    everything = asked(client, "events")
    assert (everything["total"], everything["returned"], everything["truncated"]) == (8, 8, False)
    page = asked(client, "events?limit=5")
    assert page["truncated"]
    rest = client.get(page["next"]).json()
    assert page["events"] + rest["events"] == everything["events"]
    linked = asked(client, "events?kind=cme&kind=radio&linked=true&start=2012-06-07&stop=2012-06-08")["events"]
    assert [one["kind"] for one in linked] == ["radio", "cme"]
    assert list(linked[0]["bursts"]) == [BURST_ID]


@pytest.mark.parametrize(
    "query", ["kind=storm", "start=then", "start=2013-01-01&stop=2012-01-01", "limit=0", "cursor=x", "year=2012"]
)
def test_what_is_wrong_is_refused(client: TestClient, query: str) -> None:
    assert client.get(f"/api/v1/events?{query}").status_code == 422


def test_ids_of_a_radio_catalogue_come_back_with_positions(client: TestClient, settings: Settings) -> None:
    text = client.get("/api/v1/events?kind=radio&format=csv").text
    first, second = csv.DictReader(
        io.StringIO("".join(line for line in text.splitlines(keepends=True) if line[0] != "#"))
    )
    with Catalogue.open(settings.catalogue_url) as catalogue:
        answer = catalogue.burst(BURST_ID).preferred
    assert answer is not None
    assert (first["published_id"], first["burst_id"], first["solution_id"]) == ("17", BURST_ID, answer.solution_id)
    assert float(first["phi0_deg"]) == answer.answer.phi0_deg
    assert float(first["range_low_rsun"]) == answer.answer.range_low_rsun
    assert first["sentence"] == answer.answer.sentence
    assert (second["published_id"], second["burst_id"], second["phi0_deg"]) == ("18", "", "")
    reply = client.get("/api/v1/events?format=tfcat")
    assert reply.headers["content-type"] == "application/tfcat+json"
    made = tfcat.loads(reply.text)
    assert made.crs["properties"]["ref_position_id"] == "stereo-a"
    assert [one.properties["published_id"] for one in made.features] == ["17", "18"]
    assert made.features[0].properties["burst_id"] == BURST_ID
    assert json.loads(reply.text)["features"][0]["bbox"][1::2] == [0.2, 16.0]


def test_events_are_chosen_by_where_they_were_seen_from(client: TestClient) -> None:
    assert {one["kind"] for one in asked(client, "events?observatory=STA")["events"]} == {"radio"}
    assert asked(client, "events?observatory=EARTH")["total"] == 6
    assert asked(client, "events?observatory=SOLO")["total"] == 0


def test_a_reply_has_a_tag_that_changes_with_the_lists(client: TestClient) -> None:
    reply: httpx.Response = client.get("/api/v1/events")
    assert client.get("/api/v1/events", headers={"If-None-Match": reply.headers["etag"]}).status_code == 304

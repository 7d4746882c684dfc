"""Alerts over HTTP: the list, the stream of a real server, and the feed."""

import json
import shutil
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import httpx
import jsonschema
import pytest
import uvicorn
from fastapi.testclient import TestClient

from api.app import create_app
from api.serve import options
from bella.catalogue import Catalogue
from bella.records import Origin
from bella.settings import Settings
from tests.api.published import published, served, settings_of, synthetic_burst
from tests.plotting.synthetic import BURST_ID
from tests.waiting import PATIENCE_S

STREAM = "/api/v1/alerts/stream"


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Home folder with three alerts of real bursts, one of a test, one of a submission."""
    settings = settings_of(tmp_path_factory.mktemp("told"))
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        published(settings, catalogue)
        published(settings, catalogue, inputs_hash="b" * 64)
        publish(settings, catalogue, "TEST-1", Origin.TEST)
        publish(settings, catalogue, "S-1", Origin.SUBMISSION)
        catalogue.retract(BURST_ID, "interference")
    return settings.home


@pytest.fixture
def told(template: Path, tmp_path: Path) -> Settings:
    """A copy of it."""
    return settings_of(Path(shutil.copytree(template, tmp_path / "home")))


def publish(settings: Settings, catalogue: Catalogue, burst_id: str, origin: Origin) -> None:
    from dataclasses import replace

    published(settings, catalogue, burst=replace(synthetic_burst(burst_id=burst_id), origin=origin))


def client_of(settings: Settings) -> TestClient:
    return TestClient(create_app(settings), raise_server_exceptions=False)


def test_the_list_holds_what_everybody_gets(told: Settings) -> None:
    reply = client_of(told).get("/api/v1/alerts").json()
    assert [(one["sequence"], one["type"]) for one in reply["alerts"]] == [
        (1, "PRELIMINARY"),
        (2, "UPDATE"),
        (5, "RETRACTION"),
    ]
    assert (reply["returned"], reply["last"], reply["truncated"]) == (3, 5, False)
    schema = client_of(told).get("/api/v1/alerts/schema").json()
    for one in reply["alerts"]:
        jsonschema.Draft202012Validator(schema).validate(one)
        assert one["data_archive_page"] == f"http://testserver/bursts/{BURST_ID}"


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("origin=test", [3]),
        ("origin=submission", [4]),
        ("origin=all", [1, 2, 3, 4, 5]),
        ("after=2", [5]),
        (f"burst={BURST_ID}&after=1", [2, 5]),
        ("burst=T3-1", []),
    ],
)
def test_the_list_holds_what_is_asked_for(told: Settings, query: str, expected: list[int]) -> None:
    reply = client_of(told).get(f"/api/v1/alerts?{query}").json()
    assert [one["sequence"] for one in reply["alerts"]] == expected


def test_the_list_goes_on_after_its_last(told: Settings) -> None:
    client = client_of(told)
    first = client.get("/api/v1/alerts?limit=2").json()
    assert (first["last"], first["truncated"]) == (2, True)
    rest = client.get(f"/api/v1/alerts?limit=2&after={first['last']}").json()
    assert ([one["sequence"] for one in rest["alerts"]], rest["truncated"]) == ([5], False)
    assert client.get("/api/v1/alerts?limit=0").status_code == 422
    assert client.get("/api/v1/alerts?origin=martian").status_code == 422


@contextmanager
def listening(address: str, query: str = "", **headers: str) -> Iterator[Iterator[dict[str, str]]]:
    """Events of the stream of a real server."""
    timeout = httpx.Timeout(PATIENCE_S)
    with (
        httpx.Client(trust_env=False, timeout=timeout) as client,
        client.stream("GET", f"{address}{STREAM}{query}", headers=headers) as reply,
    ):
        assert reply.status_code == 200
        assert reply.headers["content-type"].startswith("text/event-stream")
        assert reply.headers["cache-control"] == "no-store"
        assert reply.headers["x-accel-buffering"] == "no"  # a proxy before it must not hold events back
        assert "content-encoding" not in reply.headers
        yield _events(reply)


def _events(reply: httpx.Response) -> Iterator[dict[str, str]]:
    event: dict[str, str] = {}
    for line in reply.iter_lines():
        if line:
            name, _, value = line.partition(": ")
            event[name] = value
        elif event:
            yield event
            event = {}


def alerts_of(events: Iterator[dict[str, str]], count: int) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = []
    while len(found) < count:
        event = next(events)
        if "id" in event:
            found.append(event | {"document": json.loads(event["data"])})
    return found


def test_a_stream_goes_on_after_the_last_event_that_arrived(told: Settings) -> None:
    with served(told) as address:
        with listening(address, **{"Last-Event-ID": "1"}) as events:
            assert next(events) == {"retry": "5000"}
            assert next(events)["event"] == "heartbeat"
            second, last = alerts_of(events, 2)
        with listening(address, "?after=0&origin=all") as events:
            everything = alerts_of(events, 5)
    assert (second["id"], second["event"]) == ("2", "UPDATE")
    assert (last["id"], last["event"]) == ("5", "RETRACTION")
    assert second["document"]["data_archive_page"] == f"{address}/bursts/{BURST_ID}"
    assert [one["id"] for one in everything] == ["1", "2", "3", "4", "5"]


def test_a_stream_without_a_number_begins_with_what_comes(told: Settings) -> None:
    with served(told) as address, listening(address) as events:
        assert next(events) == {"retry": "5000"}
        next(events)
        with Catalogue.open(told.catalogue_url) as catalogue:
            publish(told, catalogue, "T3-20990101-0000", Origin.ARCHIVE)
        (alert,) = alerts_of(events, 1)
    assert (alert["id"], alert["document"]["event_name"]) == ("6", "T3-20990101-0000")


def test_a_quiet_stream_says_that_it_is_alive(empty: Settings) -> None:
    assert Settings.model_fields["heartbeat_s"].default <= 60
    with served(empty.model_copy(update={"heartbeat_s": 0.2})) as address, listening(address) as events:
        beats = [next(events) for _ in range(4)]
    assert [one.get("event") for one in beats[1:]] == ["heartbeat"] * 3
    assert json.loads(beats[1]["data"])["time"].endswith("Z")


def test_too_many_streams_are_asked_to_come_later(empty: Settings) -> None:
    with served(empty.model_copy(update={"max_streams": 1, "heartbeat_s": 0.2})) as address:
        with listening(address) as events:
            next(events)
            reply = httpx.get(f"{address}{STREAM}", trust_env=False, timeout=PATIENCE_S)
            assert reply.status_code == 503
            assert int(reply.headers["retry-after"]) > 0
        for _ in range(100):
            with httpx.Client(trust_env=False).stream("GET", f"{address}{STREAM}", timeout=PATIENCE_S) as again:
                if again.status_code == 200:
                    break
        assert again.status_code == 200


def test_the_feed_holds_the_newest_first_and_is_sent_once(told: Settings) -> None:
    client = client_of(told)
    reply = client.get("/feed.atom")
    assert reply.headers["content-type"] == "application/atom+xml; charset=utf-8"
    entries = Xml.fromstring(reply.text).findall("{http://www.w3.org/2005/Atom}entry")
    titles = [entry.findtext("{http://www.w3.org/2005/Atom}title") or "" for entry in entries]
    assert [title.split(":")[0] for title in titles] == [
        f"{BURST_ID} {kind}" for kind in ("retraction", "update", "preliminary")
    ]
    again = client.get("/feed.atom", headers={"If-None-Match": reply.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    with Catalogue.open(told.catalogue_url) as catalogue:
        publish(told, catalogue, "T3-20990101-0000", Origin.ARCHIVE)
    assert client.get("/feed.atom", headers={"If-None-Match": reply.headers["etag"]}).status_code == 200


def test_pages_name_the_feed(told: Settings) -> None:
    page = client_of(told).get("/", headers={"Accept": "text/html"}).text
    assert '<link rel="alternate" type="application/atom+xml" title="Alerts" href="/feed.atom">' in page


def test_a_server_ends_although_a_stream_is_open(empty: Settings) -> None:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        server = uvicorn.Server(uvicorn.Config(create_app(empty), lifespan="off", **options()))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
        thread.start()
        while not server.started:
            time.sleep(0.02)
        with listening(f"http://127.0.0.1:{listener.getsockname()[1]}") as events:
            next(events)
            server.should_exit = True
            thread.join(60)
            assert not thread.is_alive()

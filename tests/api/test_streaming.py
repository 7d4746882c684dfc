"""Everything that a query finds in one reply: of one moment, piece by piece, and let go with its reader."""

import asyncio
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from datetime import timedelta
from functools import partial
from pathlib import Path
from threading import BoundedSemaphore
from typing import Any
from urllib.parse import urlsplit

import pytest
from fastapi.testclient import TestClient

from api import tables
from api.app import create_app
from bella.catalogue import Catalogue
from bella.settings import Settings
from tests.api.published import settings_of
from tests.catalogue.examples import START, burst, publication

ADDRESSES = [
    f"/api/v1/{path}?limit=all&sort=start&format={name}"
    for path in ("bursts", "tracks", "localisations")
    for name in ("csv", "json")
]


@pytest.fixture
def settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Settings:
    """Five bursts that are read one by one."""
    monkeypatch.setattr("api.tables.PAGE", 1)
    monkeypatch.setattr("bella.pipeline.rows.AT_ONCE", 1)
    monkeypatch.setattr("bella.formats.text.ITEMS_AT_ONCE", 2)
    found = settings_of(tmp_path)
    with Catalogue.open(found.catalogue_url, create=True) as catalogue:
        for number in range(5):
            add(catalogue, number)
    return found


def add(catalogue: Catalogue, number: int) -> None:
    catalogue.publish(publication(of=burst(f"B{number}", START + timedelta(hours=number))))


def ask(settings: Settings, address: str, on_piece: Callable[[int], None]) -> list[dict[str, Any]]:
    """Messages of a reply, of which the reader says something after each piece of its body."""
    messages: list[dict[str, Any]] = []
    parts = urlsplit(address)
    scope = {
        "type": "http",
        "asgi": {"version": "3.0", "spec_version": "2.4"},
        "http_version": "1.1",
        "method": "GET",
        "path": parts.path,
        "query_string": parts.query.encode(),
        "headers": [(b"host", b"127.0.0.1"), (b"accept-encoding", b"identity")],
        "client": ("127.0.0.1", 1),
        "server": ("127.0.0.1", 80),
        "scheme": "http",
        "root_path": "",
    }

    async def receive() -> dict[str, Any]:
        await asyncio.sleep(3600)
        return {"type": "http.disconnect"}

    async def send(message: Any) -> None:
        messages.append(message)
        if message.get("body"):
            on_piece(sum(bool(one.get("body")) for one in messages))

    answer = partial(asyncio.run, create_app(settings)(scope, receive, send))  # type: ignore[arg-type]
    with ThreadPoolExecutor(1) as own:  # a browser of another test may have left its loop running in this thread
        own.submit(answer).result()
    return messages


def ids_in(messages: list[dict[str, Any]]) -> list[str]:
    text = b"".join(one.get("body", b"") for one in messages).decode()
    if text.startswith("{"):
        found = json.loads(text)
        return [one["burst_id"] for one in found.get("bursts", found.get("rows"))]
    names, *rows = (line.split(",") for line in text.splitlines() if not line.startswith("#"))
    return [row[names.index("burst_id")] for row in rows]


@pytest.mark.parametrize("address", [one for one in ADDRESSES if "tracks" not in one])
def test_a_long_reply_is_of_one_moment(settings: Settings, address: str) -> None:
    def publish_once(number: int) -> None:
        if number == 2:
            with Catalogue.open(settings.catalogue_url) as catalogue:
                add(catalogue, 9)

    messages = ask(settings, address, publish_once)
    assert messages[0]["status"] == 200
    assert len(messages) > 5, "piece by piece"
    assert list(dict.fromkeys(ids_in(messages))) == [f"B{number}" for number in range(5)]
    if "bursts?" in address and "json" in address:
        whole = json.loads(b"".join(one.get("body", b"") for one in messages))
        assert (whole["total"], whole["returned"], whole["truncated"], whole["next"]) == (5, 5, False, None)
    assert list(dict.fromkeys(ids_in(ask(settings, address, lambda _: None))))[-1] == "B9"


def test_a_reader_that_goes_away_holds_nothing(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "_FREE", BoundedSemaphore(1))
    ended: list[str] = []
    of_one_moment = Catalogue.snapshot

    def noted(self: Catalogue) -> Any:

        stack = ExitStack()
        stack.callback(ended.append, "snapshot")
        stack.enter_context(of_one_moment(self))
        return stack

    monkeypatch.setattr(Catalogue, "snapshot", noted)

    def leave(_: int) -> None:
        raise OSError("connection reset")

    for _ in range(3):
        with pytest.raises(Exception, match=r"connection reset|^$") as error:
            ask(settings, ADDRESSES[0], leave)
        assert not isinstance(error.value, AssertionError)
    assert ended == ["snapshot"] * 3
    assert ask(settings, ADDRESSES[0], lambda _: None)[0]["status"] == 200


def test_one_too_many_is_asked_to_come_again(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    taken = BoundedSemaphore(1)
    taken.acquire()
    monkeypatch.setattr(tables, "_FREE", taken)
    with TestClient(create_app(settings)) as reader:
        reply = reader.get(ADDRESSES[0])
        assert (reply.status_code, int(reply.headers["retry-after"]) > 0) == (503, True)
        assert reader.head(ADDRESSES[0]).status_code == 200, "nothing is read for it"


@pytest.mark.parametrize("address", ADDRESSES)
def test_tags_are_made_without_the_body(settings: Settings, address: str) -> None:
    with TestClient(create_app(settings)) as reader:
        first = reader.get(address)
        tag = first.headers["etag"]
        head = reader.head(address)
        assert (head.status_code, head.headers["etag"], head.content) == (200, tag, b"")
        assert head.headers["content-type"] == first.headers["content-type"]
        assert head.headers.get("content-length") in {None, str(len(first.content))}
        assert "Accept" in first.headers["vary"].split(", ")
        known = reader.get(address, headers={"If-None-Match": tag})
        assert (known.status_code, known.headers["etag"]) == (304, tag)
        with Catalogue.open(settings.catalogue_url) as catalogue:
            catalogue.retract("B3", "interference")
            assert reader.get(address, headers={"If-None-Match": tag}).status_code == 200
            gone = reader.get(address).headers["etag"]
            assert gone != tag
            add(catalogue, 7)
            assert reader.get(address).headers["etag"] not in {tag, gone}


def test_formats_and_prefixes_have_tags_of_their_own(settings: Settings) -> None:
    with TestClient(create_app(settings), client=("127.0.0.1", 1)) as reader:
        asked = [{"Accept": "text/csv"}, {"Accept": "application/json"}, {"X-Forwarded-Prefix": "/bella"}]
        tags = {reader.get("/api/v1/bursts?limit=all", headers=one).headers["etag"] for one in asked}
        assert len(tags) == 3


@pytest.mark.parametrize("query", ["cursor=nonsense", "sort=beauty", "cursor=bm9uc2Vuc2U"])
def test_what_cannot_be_answered_is_an_error_and_not_half_a_file(settings: Settings, query: str) -> None:
    with TestClient(create_app(settings)) as reader:
        for address in ADDRESSES:
            assert reader.get(f"{address.replace('&sort=start', '')}&{query}").status_code == 422


def test_nothing_found_is_an_empty_list(settings: Settings) -> None:
    with TestClient(create_app(settings)) as reader:
        assert reader.get("/api/v1/bursts?limit=all&start=2030-01-01").json()["bursts"] == []
        assert reader.get("/api/v1/tracks?limit=all&start=2030-01-01").json()["rows"] == []
        text = reader.get("/api/v1/tracks?limit=all&start=2030-01-01&format=csv").text
        assert [line[:8] for line in text.splitlines() if not line.startswith("#")] == ["burst_id"]

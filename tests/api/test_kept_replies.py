"""Replies that are kept: the same bytes as if they were made again, never older than the catalogue."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import Any, TypeVar

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import Engine, event

import api.middleware
from api.app import create_app
from api.service import Service
from bella.catalogue import Catalogue
from bella.settings import Settings
from tests.api.published import published, settings_of, synthetic_burst
from tests.fixtures_postgres import postgres_database
from tests.plotting.synthetic import BURST_ID

T = TypeVar("T")
LIST, BURST = "/api/v1/bursts", f"/api/v1/bursts/{BURST_ID}"


@pytest.fixture
def statements() -> Iterator[list[str]]:
    """Statements that the catalogue is asked."""
    found: list[str] = []

    def note(_connection: object, _cursor: object, statement: str, *_: object) -> None:
        found.append(statement)

    event.listen(Engine, "before_cursor_execute", note)
    yield found
    event.remove(Engine, "before_cursor_execute", note)


@pytest.mark.parametrize("address", [LIST, BURST, f"{LIST}?format=csv", "/", f"/bursts/{BURST_ID}", "/days"])
def test_what_was_asked_before_is_not_read_again(client: TestClient, statements: list[str], address: str) -> None:
    first = client.get(address)
    statements.clear()
    second = client.get(address)
    assert not statements
    assert second.content == first.content
    assert second.headers == first.headers
    known = client.get(address, headers={"If-None-Match": first.headers["etag"]})
    assert (known.status_code, known.content, statements) == (304, b"", [])
    assert known.headers["content-security-policy"] == first.headers["content-security-policy"]


def test_a_kept_reply_is_of_one_question(client: TestClient) -> None:
    asked: list[dict[str, str]] = [
        {},
        {"accept": "text/csv"},
        {"accept-encoding": "identity"},
        {"host": "elsewhere.example"},
    ]
    for _ in range(2):
        replies = [client.get(f"{LIST}?limit=3", headers=one) for one in asked]
        assert [one.headers["content-type"].partition(";")[0] for one in replies[:2]] == [
            "application/json",
            "text/csv",
        ]
        assert "content-encoding" in replies[0].headers
        assert "content-encoding" not in replies[2].headers
        assert replies[3].json()["next"].startswith("http://elsewhere.example/")
        assert client.get(f"https://testserver{LIST}?limit=3").json()["next"].startswith("https://testserver/")
        assert replies[0].json()["next"].startswith("http://testserver/")
    assert client.get(f"{LIST}?limit=3").json()["next"] != client.get(f"{LIST}?limit=2").json()["next"]


def test_a_kept_reply_is_of_one_prefix(filled: Settings) -> None:
    with TestClient(create_app(filled), client=("127.0.0.1", 1)) as reader:
        for _ in range(2):
            assert reader.get(LIST).json()["bursts"][0]["links"]["self"].startswith("/api/")
            behind = reader.get(LIST, headers={"X-Forwarded-Prefix": "/bella"})
            assert behind.json()["bursts"][0]["links"]["self"].startswith("/bella/api/")
            assert reader.get(LIST, headers={"X-Forwarded-Prefix": "/api"}).status_code == 404


@pytest.mark.parametrize("backend", ["sqlite", "postgresql"])
def test_a_commit_of_anybody_ends_what_was_kept(empty: Settings, backend: str) -> None:
    with postgres_database() as url:
        settings = empty.model_copy(update={"database_url": url}) if backend == "postgresql" else empty
        with (
            Catalogue.open(settings.catalogue_url, create=True) as catalogue,
            TestClient(create_app(settings)) as reader,
        ):
            published(settings, catalogue)
            assert reader.get(LIST).json()["total"] == 1
            assert reader.get(LIST).json()["total"] == 1
            published(settings, catalogue, burst=synthetic_burst(burst_id="T3-20120608-0100"))
            assert reader.get(LIST).json()["total"] == 2
            catalogue.retract(BURST_ID, "a test")
            assert reader.get(LIST).json()["total"] == 1
            reader.app.state.service.opened.close()  # type: ignore[attr-defined]


def test_errors_moments_and_what_needs_a_token_are_not_kept(client: TestClient, statements: list[str]) -> None:
    for address in ("/status", "/health", "/metrics", f"{LIST}/T3-20000101-0000"):
        for _ in range(2):
            statements.clear()
            client.get(address)
            assert statements, address
    client.get(LIST)
    statements.clear()
    client.get(LIST, headers={"Authorization": "Bearer x"})
    assert statements


def test_what_is_not_kept_is_not_sent_to_who_has_it(
    settings_with_figures: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(api.middleware, "LARGEST_BYTES", 1)
    with TestClient(create_app(settings_with_figures)) as reader:
        solution = reader.get(BURST).json()["preferred_solution"]
        for address in (LIST, f"{LIST}?limit=%61ll", f"/api/v1/solutions/{solution}/figures/wind.svg"):
            first = reader.get(address)
            assert (first.status_code, bool(first.content)) == (200, True)
            known = reader.get(address, headers={"If-None-Match": first.headers["etag"]})
            assert (known.status_code, known.content, known.headers["etag"]) == (304, b"", first.headers["etag"])
            assert reader.get(address, headers={"If-None-Match": '"other"'}).content == first.content


def test_kept_replies_grow_old(client: TestClient, statements: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(api.middleware, "AGE_S", -1.0)
    client.get(LIST)
    statements.clear()
    client.get(LIST)
    assert statements


@pytest.mark.parametrize(("most", "is_read"), [(10**6, False), (3000, True)])
def test_kept_replies_make_room(
    filled: Settings, statements: list[str], monkeypatch: pytest.MonkeyPatch, most: int, is_read: bool
) -> None:
    monkeypatch.setattr(api.middleware, "MOST_BYTES", most)
    with TestClient(create_app(filled)) as client:
        client.get(LIST)
        client.get(f"{LIST}?limit=2")
        statements.clear()
        client.get(LIST)
        assert bool(statements) is is_read


def test_what_one_process_keeps_of_a_burst_ends_with_any_change_of_it(empty: Settings) -> None:
    with (
        Catalogue.open(empty.catalogue_url, create=True) as catalogue,
        TestClient(create_app(empty)) as reader,
    ):
        published(empty, catalogue)

        def said() -> dict[str, Any]:
            (one,) = reader.get(f"{LIST}?retracted=true").json()["bursts"]
            return dict(one)

        first = said()
        catalogue.prefer(BURST_ID, first["preferred_solution"], "by hand")
        assert said()["preference"]["reason"] == "by hand"
        catalogue.retract(BURST_ID, "a test")
        assert said()["retracted"]["reason"] == "a test"


def test_a_catalogue_that_is_away_is_still_said(empty: Settings) -> None:
    with TestClient(create_app(settings_of(empty.home / "elsewhere")), raise_server_exceptions=False) as reader:
        reply = reader.get(LIST)
    assert reply.status_code >= 500
    assert "there is no catalogue" in reply.json()["detail"]


def at_once(ask: Callable[[], T]) -> list[T]:
    """What eight threads are answered that ask at the same moment."""
    begin = Barrier(8)

    def one(_: int) -> T:
        begin.wait()
        return ask()

    with ThreadPoolExecutor(8) as threads:
        return list(threads.map(one, range(8)))


def test_who_asks_at_the_same_moment_shares_what_is_opened_and_looked_up(
    filled: Settings, statements: list[str]
) -> None:
    service = Service(filled)
    opened = at_once(service.catalogue)
    assert len({id(one) for one in opened}) == 1
    statements.clear()
    assert len(set(at_once(lambda: service.newest_alert(60.0)))) == 1
    assert sum(one.startswith("SELECT") for one in statements) == 1
    opened[0].close()

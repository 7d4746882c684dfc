"""One shape for all errors."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

import bella.exceptions
from api.app import create_app
from api.errors import STATUS, status_of
from bella.exceptions import BellaError, BusyError
from bella.settings import Settings
from tests.api.published import settings_of

MEMBERS = {"type", "title", "status", "detail", "instance"}


def all_errors(kind: type[BellaError] = BellaError) -> Iterator[type[BellaError]]:
    yield kind
    for below in kind.__subclasses__():
        yield from all_errors(below)


@pytest.fixture
def failing(filled: Settings) -> FastAPI:
    app = create_app(filled)

    def fail(name: str) -> None:
        raise getattr(bella.exceptions, name, RuntimeError)("secret: /root/password; do this next")

    app.router.add_api_route("/api/v1/fail/{name}", fail)
    app.router.add_api_route("/fail/{name}", fail)
    return app


def test_every_error_of_the_tree_has_a_status_and_says_what_its_message_says(failing: FastAPI) -> None:
    with TestClient(failing) as client:
        kinds = [kind for kind in all_errors() if kind.__module__ == "bella.exceptions"]
        assert len(kinds) >= 8
        for kind in kinds:
            reply = client.get(f"/api/v1/fail/{kind.__name__}")
            assert reply.status_code == status_of(kind("x"))[0] >= 400
            assert reply.headers["content-type"] == "application/problem+json"
            assert set(reply.json()) == MEMBERS
            assert reply.json()["detail"].endswith("do this next")
            assert ("retry-after" in reply.headers) == kind.retriable


def test_a_class_without_a_row_takes_that_of_its_parent() -> None:
    class QueueFullError(BusyError):
        pass

    assert status_of(QueueFullError("x")) == STATUS[BusyError]


def test_what_nobody_foresaw_tells_nothing(failing: FastAPI) -> None:
    with TestClient(failing, raise_server_exceptions=False) as client:
        reply = client.get("/api/v1/fail/unforeseen")
    assert reply.status_code == 500
    assert set(reply.json()) == MEMBERS
    assert "secret" not in reply.text
    assert "RuntimeError" not in reply.text


def test_a_browser_gets_the_same_words_as_a_page(failing: FastAPI) -> None:
    with TestClient(failing) as client:
        reply = client.get("/fail/BusyError", headers={"Accept": "text/html,*/*"})
        data = client.get("/fail/BusyError", headers={"Accept": "application/json"})
    assert reply.status_code == data.status_code == 503
    assert reply.headers["content-type"].startswith("text/html")
    assert reply.headers["retry-after"] == data.headers["retry-after"]
    assert "do this next" in reply.text


@pytest.mark.parametrize(("method", "path", "status"), [("GET", "/nowhere", 404), ("DELETE", "/api/v1/bursts", 405)])
def test_routing_errors_have_the_shape_too(client: TestClient, method: str, path: str, status: int) -> None:
    reply = client.request(method, path)
    assert reply.status_code == reply.json()["status"] == status
    assert set(reply.json()) == MEMBERS
    assert reply.headers["content-type"] == "application/problem+json"


def test_user_text_is_not_markup(client: TestClient) -> None:
    reply = client.get("/bursts/<script>alert(1)</script>", headers={"Accept": "text/html"})
    assert reply.status_code == 404
    assert "<script>alert" not in reply.text


def test_without_a_catalogue_the_page_says_how_to_get_one(tmp_path: Path) -> None:
    with TestClient(create_app(settings_of(tmp_path / "nothing"))) as client:
        page = client.get("/", headers={"Accept": "text/html"})
        data = client.get("/api/v1/bursts")
    assert page.status_code == data.status_code == 503
    assert "bella run" in page.text
    assert data.json()["title"] == "The catalogue or the posterior store cannot be used"
    assert not (tmp_path / "nothing").exists()

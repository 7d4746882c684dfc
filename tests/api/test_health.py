"""Health tells what is away, and the rest of the service lives on."""

import sqlite3
from pathlib import Path

from fastapi.testclient import TestClient

from api.app import create_app
from bella.catalogue import Catalogue
from bella.catalogue.schema import REVISION_TABLE
from bella.settings import Settings
from tests.api.published import settings_of


def test_all_is_well(client: TestClient) -> None:
    reply = client.get("/health")
    assert reply.status_code == 200
    assert reply.json()["status"] == "ok"
    links = {"fetcher", "archive", "ephemeris", "worker", "disk"}
    assert set(reply.json()["checks"]) == {"database", "schema", "store", *links}
    assert set(client.get("/health/api").json()["checks"]) == {"database", "schema", "store"}
    assert reply.headers["cache-control"] == "no-store"


def test_nothing_there_yet_is_not_well_and_comes_up_without_a_restart(tmp_path: Path) -> None:
    settings = settings_of(tmp_path / "home")
    with TestClient(create_app(settings)) as client:
        reply = client.get("/health")
        assert reply.status_code == 503
        assert reply.json()["status"] == "failing"
        assert reply.json()["checks"]["database"] != "ok"
        settings.store_root.mkdir(parents=True)
        Catalogue.open(settings.catalogue_url, create=True).close()
        assert client.get("/health").status_code == 200


def test_a_missing_store_is_told(empty: Settings) -> None:
    empty.store_root.rmdir()
    with TestClient(create_app(empty)) as client:
        reply = client.get("/health")
        assert reply.status_code == 503
        assert "store" in reply.json()["checks"]["store"]
        assert reply.json()["checks"]["database"] == "ok"
        assert client.get("/api/v1/bursts").status_code == 200


def test_a_catalogue_of_a_later_version_is_refused_and_left_as_it_is(empty: Settings) -> None:
    path = empty.home / "catalogue.sqlite"
    with sqlite3.connect(path) as connection:
        connection.execute(f"UPDATE {REVISION_TABLE} SET version_num = '9999'")
    connection.close()
    before = path.read_bytes()
    with TestClient(create_app(empty)) as client:
        assert client.get("/health").status_code == 503
        assert client.get("/api/v1/bursts").status_code == 503
    assert path.read_bytes() == before


def test_a_damaged_catalogue_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    settings = settings_of(tmp_path)
    path = tmp_path / "catalogue.sqlite"
    path.write_bytes(b"this is no database" * 500)
    before = path.read_bytes()
    with TestClient(create_app(settings)) as client:
        assert client.get("/api/v1/bursts").status_code == 503
        assert client.get("/health").status_code == 503
    assert path.read_bytes() == before


def test_a_database_that_does_not_answer_is_told_without_its_password(tmp_path: Path) -> None:
    url = "postgresql+psycopg://bella:geheim@127.0.0.1:1/bella"
    with TestClient(create_app(Settings(home=tmp_path, database_url=url))) as client:
        health, bursts = client.get("/health"), client.get("/api/v1/bursts")
    assert health.status_code == bursts.status_code == 503
    assert "retry-after" in bursts.headers
    assert "geheim" not in health.text + bursts.text

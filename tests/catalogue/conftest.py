"""Each test of the catalogue that asks for `database_url` or `catalogue` runs on SQLite and on a real PostgreSQL.

`database_url` is empty, `catalogue_url` is a copy of a catalogue without bursts, and `catalogue` is that one opened.
"""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import make_url

from bella.catalogue import Catalogue
from tests.fixtures_postgres import postgres_database


@pytest.fixture
def sqlite_url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'catalogue.sqlite'}"


@pytest.fixture(params=["sqlite", "postgresql"])
def backend(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def database_url(request: pytest.FixtureRequest, backend: str) -> str:
    return str(request.getfixturevalue({"sqlite": "sqlite_url", "postgresql": "postgres_url"}[backend]))


@pytest.fixture(scope="session")
def empty_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("empty") / "catalogue.sqlite"
    Catalogue.open(f"sqlite:///{file}", create=True).close()
    return file


@pytest.fixture(scope="session")
def empty_postgres_database() -> Iterator[str]:
    with postgres_database() as url:
        Catalogue.open(url, create=True).close()
        yield make_url(url).database or ""


@pytest.fixture
def catalogue_url(request: pytest.FixtureRequest, backend: str, sqlite_url: str) -> Iterator[str]:
    if backend == "sqlite":
        shutil.copy(request.getfixturevalue("empty_file"), make_url(sqlite_url).database or "")
        yield sqlite_url
        return
    with postgres_database(template=request.getfixturevalue("empty_postgres_database")) as url:
        yield url


@pytest.fixture
def catalogue(catalogue_url: str) -> Iterator[Catalogue]:
    with Catalogue.open(catalogue_url) as opened:
        yield opened

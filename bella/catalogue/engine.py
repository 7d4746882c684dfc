"""Connections: SQLite and PostgreSQL made to behave alike, and their errors turned into ours."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Lock
from typing import Any, ClassVar

from sqlalchemy import (
    URL,
    Connection,
    Engine,
    PoolProxiedConnection,
    Table,
    create_engine,
    event,
    literal_column,
    make_url,
    text,
)
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.exc import ArgumentError, DataError, DBAPIError, SQLAlchemyError

from bella.exceptions import BellaError, BusyError, InputError, StoreError, UnreachableError

_BUSY_TIMEOUT_S = 30
_CONNECT_TIMEOUT_S = 10
_WRITES = "bella_writes"
# SQLSTATE classes: serialisation failure and deadlock, lock not available, too many connections
_TRY_AGAIN_STATES = ("40001", "40P01", "55P03", "53300")
_BEGIN = text("SELECT count(*) FROM stage_run WHERE stage_run_id < 0")
_snapshot: ContextVar[tuple[Engine, Connection] | None] = ContextVar("snapshot", default=None)


def parse_url(database_url: str) -> URL:
    """Check the URL of a catalogue.

    Parameters
    ----------
    database_url : str
        SQLAlchemy URL of a SQLite file or a PostgreSQL database.

    Returns
    -------
    sqlalchemy.URL
        With the driver this package comes with.

    Raises
    ------
    InputError
        Where it is neither; the message does not repeat it, because it may hold a password.
    """
    example = "give sqlite:////path/catalogue.sqlite or postgresql+psycopg://user:password@host/database"
    try:
        url = make_url(database_url)
    except (ArgumentError, ValueError):
        raise InputError(f"BELLA_DATABASE_URL is not the URL of a database: {example}") from None
    if url.drivername in {"postgresql", "postgres", "postgresql+psycopg"}:
        return url.set(drivername="postgresql+psycopg")
    if url.drivername in {"sqlite", "sqlite+pysqlite"} and url.database not in {None, "", ":memory:"}:
        return url
    raise InputError(f"a catalogue cannot be kept in {display_name(url)!r}: {example}")


def display_name(url: URL) -> str:
    """Name of a database for messages, without password and without options, which may hold one too."""
    if url.get_backend_name() == "sqlite" and url.database:
        return url.database
    return url.set(query={}).render_as_string(hide_password=True)


def connect(url: URL) -> Engine:
    """Make the engine of a catalogue; nothing is opened yet.

    Parameters
    ----------
    url : sqlalchemy.URL
        What `parse_url` returned.

    Returns
    -------
    sqlalchemy.Engine
        Foreign keys on; SQLite in WAL mode with real transactions that include changes of the schema.
    """
    if url.get_backend_name() == "sqlite":
        engine = create_engine(url, connect_args={"timeout": _BUSY_TIMEOUT_S, "check_same_thread": False})
        event.listen(engine, "connect", _prepare_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
        return engine
    # UTC so that what a person sees in psql is what the records say
    defaults = {"connect_timeout": _CONNECT_TIMEOUT_S, "options": "-c timezone=UTC"}
    arguments = {name: value for name, value in defaults.items() if name not in url.query}
    return create_engine(url, connect_args=arguments, pool_pre_ping=True)


def not_a_catalogue(url: URL) -> StoreError:
    """The error for a database of something else, or one that is damaged."""
    return StoreError(f"{display_name(url)} is not a BELLA catalogue; move it away or set BELLA_DATABASE_URL")


@contextmanager
def reading(engine: Engine) -> Iterator[Connection]:
    """Transaction that sees one state of the catalogue; inside a `snapshot`, that of the snapshot.

    Raises
    ------
    BusyError, StoreError, UnreachableError
        See `translated`.
    """
    pinned = _snapshot.get()
    if pinned is not None and pinned[0] is engine:
        with translated(engine.url):
            yield pinned[1]
        return
    with translated(engine.url), engine.connect() as bare:
        # a page and its total come from one moment; SQLite gives that to every transaction
        snapshot = {} if engine.dialect.name == "sqlite" else {"isolation_level": "REPEATABLE READ"}
        connection = bare.execution_options(**snapshot)
        with connection.begin():
            yield connection


class State:
    """Looks whether anything was committed, by a connection of its own that is kept."""

    _ASK: ClassVar = {"sqlite": "PRAGMA data_version", "postgresql": "SELECT pg_current_snapshot()::text"}

    def __init__(self, engine: Engine) -> None:
        self._engine, self._asking = engine, Lock()
        self._connection: PoolProxiedConnection | None = None
        self._opened = 0

    def now(self) -> str:
        """Text that is the same as long as nothing was committed.

        Raises
        ------
        BusyError, StoreError, UnreachableError
            See `translated`.
        """
        with self._asking, translated(self._engine.url):
            try:
                return self._asked()
            except self._engine.dialect.loaded_dbapi.Error:  # the server was started again
                self._drop()
            try:
                return self._asked()
            except self._engine.dialect.loaded_dbapi.Error as error:
                self._drop()
                raise UnreachableError(f"{display_name(self._engine.url)} does not answer ({error})") from error

    def close(self) -> None:
        """Give the connection back."""
        with self._asking:
            self._drop()

    def _asked(self) -> str:
        if self._connection is None:
            self._connection = self._engine.raw_connection()
            self._opened += 1
            if self._engine.dialect.name == "postgresql":
                self._connection.driver_connection.autocommit = True  # type: ignore[union-attr]
        cursor = self._connection.cursor()
        cursor.execute(self._ASK[self._engine.dialect.name])
        (found,) = cursor.fetchone()  # type: ignore[misc]
        # SQLite counts for each connection anew
        return f"{self._opened}:{found}"

    def _drop(self) -> None:
        if self._connection is not None:
            self._connection.invalidate()
            self._connection = None


@contextmanager
def snapshot(engine: Engine) -> Iterator[None]:
    """Let everything that is read in this block, and in this thread, come from one moment."""
    with reading(engine) as connection:
        # a transaction begins with its first statement, not before
        connection.execute(_BEGIN)
        token = _snapshot.set((engine, connection))
        try:
            yield
        finally:
            _snapshot.reset(token)


@contextmanager
def writing(engine: Engine) -> Iterator[Connection]:
    """Transaction that changes the catalogue; on SQLite it holds the write lock from the beginning.

    Raises
    ------
    BusyError, StoreError, UnreachableError
        See `translated`.
    """
    with translated(engine.url), engine.connect() as bare:
        connection = bare.execution_options(**{_WRITES: True})
        with connection.begin():
            yield connection


@contextmanager
def translated(url: URL) -> Iterator[None]:
    """Errors of SQLAlchemy and the drivers as errors of this package.

    Raises
    ------
    BusyError
        Where another transaction holds what is needed.
    UnreachableError
        Where the server does not answer.
    StoreError
        Where the database is damaged or refuses.
    """
    try:
        yield
    except BellaError:
        raise
    except SQLAlchemyError as error:
        raise _translate(error, url) from error


def _translate(error: SQLAlchemyError, url: URL) -> BellaError:
    name = display_name(url)
    if isinstance(error, DataError):
        return InputError(f"{name} cannot hold a value ({str(error.orig).partition(chr(10))[0]}): correct the input")
    cause = error.orig if isinstance(error, DBAPIError) else error
    reason = str(cause).strip().partition("\n")[0]
    if isinstance(cause, sqlite3.Error):
        return _translate_sqlite(cause, reason, url)
    state = getattr(cause, "sqlstate", None)
    if state in _TRY_AGAIN_STATES:
        return BusyError(f"{name} is busy ({reason}): try again")
    unreachable = isinstance(error, DBAPIError) and (error.connection_invalidated or state is None)
    if unreachable or str(state)[:2] in {"08", "57", "28", "3D"}:
        return UnreachableError(f"{name} cannot be reached ({reason}): check BELLA_DATABASE_URL and that it runs")
    return StoreError(f"{name} refused ({reason}): check it and run again")


def _translate_sqlite(cause: sqlite3.Error, reason: str, url: URL) -> BellaError:
    code = getattr(cause, "sqlite_errorcode", 0) & 0xFF
    if code in {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}:
        return BusyError(f"{display_name(url)} is busy: another process is writing, try again")
    if code == sqlite3.SQLITE_NOTADB:
        return not_a_catalogue(url)
    if code == sqlite3.SQLITE_CORRUPT:
        return StoreError(f"{display_name(url)} is damaged ({reason}): restore it from a backup or move it away")
    if code in {sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN}:
        return StoreError(f"{display_name(url)} cannot be used ({reason}): check the disk and its permissions")
    return StoreError(f"{display_name(url)} refused ({reason}): check it and run again")


def _prepare_sqlite(connection: Any, _record: Any) -> None:
    # transactions are begun below; the driver's own way leaves changes of the schema outside of them
    connection.isolation_level = None
    connection.execute(f"PRAGMA busy_timeout = {_BUSY_TIMEOUT_S * 1000}")
    connection.execute("PRAGMA foreign_keys = ON")


def _begin_sqlite(connection: Connection) -> None:
    writes = connection.get_execution_options().get(_WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def dialect_insert(connection: Connection, table: Table) -> sqlite.Insert | postgresql.Insert:
    """Insert statement with ON CONFLICT of the connection's dialect.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        To a SQLite or PostgreSQL database.
    table : sqlalchemy.Table
        Table to insert into.

    Returns
    -------
    sqlalchemy.dialects.sqlite.Insert or sqlalchemy.dialects.postgresql.Insert
        Both have `on_conflict_do_nothing` and `on_conflict_do_update`.
    """
    return sqlite.insert(table) if connection.dialect.name == "sqlite" else postgresql.insert(table)


def insert_ignoring(connection: Connection, table: Table, values: dict[str, Any]) -> bool:
    """Insert a row unless one of its keys is taken; waits for a rival that is inserting the same.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        In a writing transaction.
    table : sqlalchemy.Table
        Table to insert into.
    values : dict
        Columns of the row.

    Returns
    -------
    bool
        True where the row was inserted.
    """
    statement = dialect_insert(connection, table).on_conflict_do_nothing().values(values)
    return connection.execute(statement.returning(literal_column("1"))).first() is not None

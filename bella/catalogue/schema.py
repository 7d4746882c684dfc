"""State of the schema: which revision a database is at, and bringing it to the newest one."""

import sqlite3
import time
from contextlib import closing, suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import structlog
from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, Engine, inspect, text

from bella.catalogue.engine import display_name, not_a_catalogue, reading, translated, writing
from bella.exceptions import StoreError

REVISION_TABLE = "bella_revision"
# any number will do, as long as every process of this package takes the same one
_ADVISORY_LOCK = 0x42454C4C41
_SWITCH_TIMEOUT_S = 30

log = structlog.get_logger(__name__)
_SOUND_FILES: set[tuple[int, int]] = set()
"""Device and inode of the files that this process has checked."""


def migration_config(connection: Connection | None = None) -> Config:
    """Alembic's configuration, with the scripts of the package `migrations`.

    Parameters
    ----------
    connection : sqlalchemy.Connection, optional
        Connection in whose transaction the migrations run.

    Returns
    -------
    alembic.config.Config
        For `alembic.command`.

    Raises
    ------
    StoreError
        Where the installation lacks the scripts.
    """
    spec = find_spec("migrations")
    if spec is None or not spec.submodule_search_locations:
        raise StoreError("the package `migrations` is missing: install bella-service again")
    config = Config()
    config.set_main_option("script_location", next(iter(spec.submodule_search_locations)).replace("%", "%%"))
    config.attributes["connection"] = connection
    return config


def prepare(engine: Engine, *, create: bool) -> None:
    """Make sure that a database is a catalogue at the newest revision.

    Parameters
    ----------
    create : bool
        True to make the schema, or to bring an older one to the newest revision. Processes that start at once wait
        for one another.

    Raises
    ------
    StoreError
        Where the database is damaged, belongs to something else, or was written by a newer version; with `create`
        False also where it is empty or older.
    UnreachableError
        Where the server does not answer.
    """
    if engine.dialect.name == "sqlite":
        _prepare_file(engine, create=create)
    with reading(engine) as connection:
        current = _revision_to_upgrade(connection, create=create)
    if current is not None:
        _upgrade(engine)


def revision_of(connection: Connection) -> str | None:
    """Revision a database is at, None where it has none."""
    return MigrationContext.configure(connection, opts={"version_table": REVISION_TABLE}).get_current_revision()


@cache
def _revisions() -> tuple[frozenset[str], str | None]:
    """All revisions, and the newest one; read once, since the scripts of an installation do not change."""
    scripts = ScriptDirectory.from_config(migration_config())
    return frozenset(script.revision for script in scripts.walk_revisions()), scripts.get_current_head()


def _revision_to_upgrade(connection: Connection, *, create: bool) -> str | None:
    """Revision to upgrade from ("" for an empty database), None for the newest one; refuses what is not ours."""
    name = display_name(connection.engine.url)
    known, newest = _revisions()
    tables = set(inspect(connection).get_table_names())
    current = revision_of(connection) or ""
    if tables - {REVISION_TABLE} and not current:
        raise not_a_catalogue(connection.engine.url)
    if current and current not in known:
        raise StoreError(
            f"{name} was written by a newer version (revision {current}): "
            "upgrade the package or restore an older backup"
        )
    if current == newest:
        return None
    if not create:
        state = f"is at the older revision {current}" if current else "is empty"
        raise StoreError(f"{name} {state}: `bella run` brings it to the newest revision")
    return current


def _upgrade(engine: Engine) -> None:
    with writing(engine) as connection:
        if engine.dialect.name == "postgresql":
            connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _ADVISORY_LOCK})
        # another process may have been faster while this one waited for the lock
        if (current := _revision_to_upgrade(connection, create=True)) is not None:
            command.upgrade(migration_config(connection), "head")
            log.info("catalogue upgraded", from_revision=current or None, to_revision=revision_of(connection))


def _prepare_file(engine: Engine, *, create: bool) -> None:
    """Checks and settings that only a SQLite file needs, in an order that never writes to a file that is not ours."""
    path = Path(engine.url.database or "")
    if create:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(f"{path.parent} cannot be made ({error.strerror}): choose another home") from error
    elif not path.exists():
        raise StoreError(f"there is no catalogue at {path}: `bella run` makes one")
    # only SQLite may open this file: closing any other handle on it would drop the locks of all connections of this
    # process (POSIX), and two processes would then write at once
    with translated(engine.url), engine.connect() as connection:
        status = path.stat()
        # reads all of it, so once, and only before something may be written: who reads is told of damage by SQLite
        if create and (status.st_dev, status.st_ino) not in _SOUND_FILES:
            if connection.exec_driver_sql("PRAGMA quick_check(1)").scalar() != "ok":
                raise StoreError(f"{path} is damaged: restore it from a backup or move it away")
            _SOUND_FILES.add((status.st_dev, status.st_ino))
        _revision_to_upgrade(connection, create=create)
    _use_write_ahead_log(engine)


def _use_write_ahead_log(engine: Engine) -> None:
    """Switch on the write-ahead log, which lets readers go on while a run writes; the file remembers it."""
    give_up = time.monotonic() + _SWITCH_TIMEOUT_S
    with translated(engine.url), closing(engine.raw_connection()) as connection:
        cursor = connection.cursor()
        while cursor.execute("PRAGMA journal_mode").fetchone() != ("wal",) and time.monotonic() < give_up:
            # SQLite does not wait for other connections here, whatever its busy timeout; and on a disk that cannot
            # share memory it says so by answering with another mode, in which everything works but slower
            with suppress(sqlite3.OperationalError):
                cursor.execute("PRAGMA journal_mode = WAL")
                return
            time.sleep(0.05)

"""The database service as a process: PostgreSQL of the system, over TCP and with a password, as in its container."""

import os
import pwd
import re
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psycopg
import pytest
from sqlalchemy import make_url

from tests.fixtures_postgres import postgres_server
from tests.service_processes.compose import services
from tests.service_processes.processes import free_port
from tests.waiting import PATIENCE_S, until

INSTALLED = Path("/usr/lib/postgresql")
EXTENSIONS = "/usr/share/postgresql/{version}/extension/pg_trgm.control"
PASSWORD = "aPasswordOfATest"


@dataclass(frozen=True)
class Databases:
    """Where catalogue and Prefect keep their tables.

    Attributes
    ----------
    catalogue, prefect : str
        URLs.
    """

    catalogue: str
    prefect: str


@contextmanager
def databases(folder: Path) -> Iterator[Databases]:
    """Both databases on one server; where that lacks what Prefect asks for, Prefect gets a file instead."""
    programs = complete_postgres()
    if programs is not None:
        with _system_server(programs) as port:
            place = f"bella:{PASSWORD}@127.0.0.1:{port}"
            yield Databases(f"postgresql+psycopg://{place}/bella", f"postgresql+asyncpg://{place}/prefect")
    else:
        with _catalogue_alone() as url:
            yield Databases(url, f"sqlite+aiosqlite:///{folder / 'prefect.db'}")


def complete_postgres() -> Path | None:
    """Folder of the programs of an installed PostgreSQL that has pg_trgm, which the schema of Prefect needs.

    The PostgreSQL of the package index comes without it.
    """
    for programs in sorted(INSTALLED.glob("*/bin"), reverse=True):
        if Path(EXTENSIONS.format(version=programs.parent.name)).is_file() and (programs / "initdb").is_file():
            return programs
    return None


def statements_at_first_start() -> list[str]:
    """SQL that the database service runs when its volume is empty."""
    command = " ".join(services()["database"]["command"])
    return re.findall(r"echo '([^']*)' > /docker-entrypoint-initdb\.d/", command)


@contextmanager
def _catalogue_alone() -> Iterator[str]:
    server, name = make_url(postgres_server().get_uri()), f"bella_services_{os.getpid()}"
    with psycopg.connect(server.render_as_string(hide_password=False), autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}")
        yield server.set(drivername="postgresql+psycopg", database=name).render_as_string(hide_password=False)
        connection.execute(f"DROP DATABASE {name} WITH (FORCE)")


@contextmanager
def _system_server(programs: Path) -> Iterator[int]:
    # not below the folder of the test, which only its owner may enter
    folder, port = Path(tempfile.mkdtemp(prefix="bella-postgres-")), free_port()
    (folder / "password").write_text(PASSWORD)
    (folder / "log").touch()
    account = _account(folder)
    initialise = ["--username=bella", f"--pwfile={folder / 'password'}", "--auth=scram-sha-256", "--encoding=UTF8"]
    _start([programs / "initdb", "-D", folder / "data", *initialise], folder, account).wait(PATIENCE_S)
    options = {"listen_addresses": "127.0.0.1", "port": port, "unix_socket_directories": "", "fsync": "off"}
    settings = [f"--{name}={value}" for name, value in options.items()]
    server = _start([programs / "postgres", "-D", folder / "data", *settings], folder, account)
    try:
        until(lambda: _answers(port) or server.poll() is not None, "PostgreSQL answers")
        _make_databases(port, folder / "log")
        yield port
    finally:
        server.send_signal(signal.SIGQUIT)
        server.wait(PATIENCE_S)
        shutil.rmtree(folder)


def _account(folder: Path) -> dict[str, Any]:
    """Account for PostgreSQL, which refuses to run as root."""
    if os.getuid() != 0:
        return {}
    account = pwd.getpwnam("postgres")
    for path in (folder, *folder.iterdir()):
        os.chown(path, account.pw_uid, account.pw_gid)
    return {"user": account.pw_uid, "group": account.pw_gid, "extra_groups": []}


def _start(command: Sequence[str | Path], folder: Path, account: dict[str, Any]) -> "subprocess.Popen[bytes]":
    with (folder / "log").open("ab") as log:
        return subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=log, stderr=log, **account)


def _connect(port: int) -> "psycopg.Connection[tuple[Any, ...]]":
    return psycopg.connect(
        host="127.0.0.1", port=port, user="bella", password=PASSWORD, dbname="postgres", autocommit=True
    )


def _answers(port: int) -> bool:
    try:
        _connect(port).close()
    except psycopg.OperationalError:
        return False
    return True


def _make_databases(port: int, log: Path) -> None:
    """Do what the entry point of the image does: the database of POSTGRES_DB, then the statements of the file."""
    if not _answers(port):
        pytest.fail(f"PostgreSQL does not start:\n{log.read_text()}")
    with _connect(port) as connection:
        name = services()["database"]["environment"]["POSTGRES_DB"]
        for statement in (f"CREATE DATABASE {name}", *statements_at_first_start()):
            connection.execute(statement.encode())

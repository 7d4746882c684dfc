"""PostgreSQL, Prefect's server, the worker and the API as processes that may be killed and started again."""

import os
import pwd
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx

from bella.catalogue import Catalogue

INSTALLED = Path("/usr/lib/postgresql")
PATIENCE_S = 300.0
PROBE_S = 1.0
"""Between two requests to the API."""


def programs() -> Path | None:
    """Folder of the programs of the newest PostgreSQL of the system; None where there is none."""
    found = sorted(INSTALLED.glob("*/bin/initdb"), key=lambda path: float(path.parts[-3]))
    return found[-1].parent if found else None


@dataclass
class Services:
    """The services around a home folder, each in a process group of its own.

    Attributes
    ----------
    home : pathlib.Path
    settings : dict of str to str
        Variables of the service beside its home and its database.
    names : tuple of str
        What is started at once; without "database" the catalogue is a file in the home.
    api_processes : int
        That answer requests.
    answers : collections.Counter
        Replies of the API by status ("none" where it did not answer) and by whether the database was up.
    """

    home: Path
    settings: dict[str, str] = field(default_factory=dict)
    names: tuple[str, ...] = ("database", "prefect", "api")
    api_processes: int = 1
    answers: "Counter[str]" = field(default_factory=Counter)
    _running: dict[str, "subprocess.Popen[bytes]"] = field(default_factory=dict)
    _ended: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> "Services":
        self.folder = Path(tempfile.mkdtemp(prefix="bella-services-"))
        self.ports = {name: _free_port() for name in ("database", "prefect", "api")}
        self._database_is_up, self._programs = False, programs() or Path()
        if "database" in self.names:
            self._make_databases()
            Catalogue.open(self.environment["BELLA_DATABASE_URL"], create=True).close()
        for name in self.names:
            if name != "database":
                self.start(name)
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        for name in list(self._running)[::-1]:
            self.kill(name)
        shutil.rmtree(self.folder, ignore_errors=True)

    @property
    def environment(self) -> dict[str, str]:
        """Variables with which a command works on the home of these services."""
        url = f"postgresql+psycopg://bella@127.0.0.1:{self.ports['database']}/bella"
        return {
            "PATH": os.environ["PATH"],
            "HOME": str(self.folder),
            "OPENBLAS_NUM_THREADS": "1",
            "BELLA_HOME": str(self.home),
            **({"BELLA_DATABASE_URL": url} if "database" in self.names else {}),
            "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
            "PREFECT_API_URL": f"http://127.0.0.1:{self.ports['prefect']}/api",
            **self.settings,
        }

    def start(self, name: str) -> None:
        """Start a service that is not running, and wait until it answers."""
        command, variables = self._commands()[name]
        self._running[name] = self._begin(command, variables)
        if name == "worker":
            return
        _until(lambda: self._answers(name), f"{name} answers: see {self.folder / 'log'}")
        self._database_is_up |= name == "database"

    def watch(self) -> "Services":
        """Ask the API again and again, and count its `answers`, from now on."""
        threading.Thread(target=self._probe, name="probe", daemon=True).start()
        return self

    def process_id(self, name: str) -> int:
        """Number of the process of a service."""
        return self._running[name].pid

    def kill(self, name: str) -> None:
        """End a service with kill -9, and all that it has started."""
        if name == "database":
            self._database_is_up = False
        process = self._running.pop(name)
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        if name == "database":  # its processes are in groups of their own, and end when they see that it is gone
            data = str(self.folder / "data")
            _until(lambda: not _processes_with(data, process.pid), "PostgreSQL has ended")

    def _commands(self) -> dict[str, tuple[list[str], dict[str, str]]]:
        python, ports = sys.executable, self.ports
        database = f"postgresql+asyncpg://bella@127.0.0.1:{ports['database']}/prefect"
        prefect = {"PREFECT_API_DATABASE_CONNECTION_URL": database, "PREFECT_HOME": str(self.folder / "prefect")}
        options = {"listen_addresses": "127.0.0.1", "port": ports["database"], "unix_socket_directories": ""}
        given = [f"--{name}={value}" for name, value in options.items()]
        processes = ["--processes", f"{self.api_processes}"]
        listen, server = ["--host", "127.0.0.1", "--port"], ["server", "start", "--no-ui"]
        return {
            "database": ([str(self._programs / "postgres"), "-D", str(self.folder / "data"), *given], {}),
            "prefect": ([python, "-m", "prefect", *server, *listen, f"{ports['prefect']}"], prefect),
            "api": ([python, "-m", "api.serve", *listen, f"{ports['api']}", *processes], {}),
            "worker": ([python, "-m", "flows.serve"], {}),
        }

    def _begin(self, command: Sequence[str], variables: dict[str, str]) -> "subprocess.Popen[bytes]":
        own = {} if "postgres" not in Path(command[0]).name else _account(self.folder)
        with (self.folder / "log").open("ab") as log:
            return subprocess.Popen(
                command,
                env=self.environment | variables,
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                **own,
            )

    def _make_databases(self) -> None:
        if not self._programs.is_absolute():
            raise RuntimeError(f"PostgreSQL is needed below {INSTALLED}")
        account = _account(self.folder)
        initialise = [
            self._programs / "initdb",
            "-D",
            self.folder / "data",
            "--username=bella",
            "--auth=trust",
            "--encoding=UTF8",
        ]
        subprocess.run(initialise, cwd=self.folder, check=True, capture_output=True, **account)
        self.start("database")
        for name in ("bella", "prefect"):
            place = ["--host=127.0.0.1", f"--port={self.ports['database']}", "--username=bella", name]
            subprocess.run([self._programs / "createdb", *place], check=True, capture_output=True)

    def _answers(self, name: str) -> bool:
        if self._running[name].poll() is not None:  # an earlier one was not quite gone
            command, variables = self._commands()[name]
            self._running[name] = self._begin(command, variables)
            time.sleep(1.0)
        if name == "database":
            ready = [
                self._programs / "pg_isready",
                "--quiet",
                "--host=127.0.0.1",
                "--username=bella",
                f"--port={self.ports['database']}",
            ]
            return subprocess.run(ready, check=False).returncode == 0
        path = {"prefect": "/api/health", "api": "/health/api"}[name]
        return self.status(path, name) not in {"none", "502"}

    def status(self, path: str, name: str = "api") -> str:
        """Status with which a service answers; "none" where it does not."""
        try:
            return str(httpx.get(f"http://127.0.0.1:{self.ports[name]}{path}", trust_env=False, timeout=30).status_code)
        except httpx.HTTPError:
            return "none"

    def _probe(self) -> None:
        """Ask the API for bursts, again and again; what is asked while the database goes or comes is not counted."""
        while not self._ended.wait(PROBE_S):
            before = self._database_is_up
            status = self.status("/api/v1/bursts?limit=1&origin=all")
            if before == self._database_is_up:
                self.answers[f"{status}, database {'up' if before else 'down'}"] += 1


def _until(condition: Callable[[], object], what: str) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > end:
            raise RuntimeError(f"not within {PATIENCE_S:g} s: {what}")
        time.sleep(0.1)


def _account(folder: Path) -> dict[str, Any]:
    """Account for PostgreSQL, which refuses to run as root."""
    if os.getuid() != 0:
        return {}
    account = pwd.getpwnam("postgres")
    os.chown(folder, account.pw_uid, account.pw_gid)
    folder.chmod(0o755)
    return {"user": account.pw_uid, "group": account.pw_gid, "extra_groups": []}


def _processes_with(data: str, postmaster: int) -> bool:
    """Whether processes of a PostgreSQL that was killed are still there: they keep its memory."""
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if int(place.name) != postmaster and str((place / "cwd").readlink()) == data:
                return True
    return False


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])

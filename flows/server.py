"""An embedded Prefect server: lives as long as one command, keeps its database and its log in the home folder."""

import ctypes
import fcntl
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bella.exceptions import UnreachableError
from bella.settings import Settings

START_S = 120.0
STOP_S = 10.0
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG


@contextmanager
def prefect_server(settings: Settings) -> Iterator[str]:
    """Use the Prefect server of ``PREFECT_API_URL``, or run one of our own until the block ends.

    Parameters
    ----------
    settings : Settings

    Yields
    ------
    str
        URL of its API.

    Raises
    ------
    UnreachableError
        If the embedded server does not come up.
    """
    given = os.environ.get("PREFECT_API_URL")
    if given:
        yield given
        return
    log = settings.home / "prefect" / "server.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    url = f"http://127.0.0.1:{_free_port()}/api"
    server = _started(url, log)
    os.environ["PREFECT_API_URL"] = url
    try:
        yield url
    finally:
        del os.environ["PREFECT_API_URL"]
        _stop(server)


def _started(url: str, log: Path) -> subprocess.Popen[bytes]:
    """Start a server and wait until it answers; one at a time, because two that lay out one database fail."""
    with log.with_name("server.lock").open("w") as turn:
        fcntl.flock(turn, fcntl.LOCK_EX)
        server = _start(url, log)
        try:
            _wait_until_healthy(server, url, log)
        except BaseException:
            _stop(server)
            raise
        return server


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _start(url: str, log: Path) -> subprocess.Popen[bytes]:
    port = url.rsplit(":", 1)[1].removesuffix("/api")
    command = [sys.executable, "-m", "prefect", "server", "start", "--host", "127.0.0.1", "--port", port, "--no-ui"]
    with log.open("ab") as stream:
        return subprocess.Popen(  # noqa: S603 - the command is ours from first to last word
            command,
            stdout=stream,
            stderr=stream,
            stdin=subprocess.DEVNULL,
            preexec_fn=_die_with_parent if sys.platform == "linux" else None,  # noqa: PLW1509 - no thread runs yet
        )


def _die_with_parent() -> None:
    """Let no server outlive a command that was killed."""
    ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGTERM)


def _wait_until_healthy(server: subprocess.Popen[bytes], url: str, log: Path) -> None:
    until = time.monotonic() + START_S
    while time.monotonic() < until and server.poll() is None:
        try:
            with urllib.request.urlopen(f"{url}/health", timeout=5):  # noqa: S310 - a loopback address of our own
                return
        except (urllib.error.URLError, OSError):
            time.sleep(0.1)
    raise UnreachableError(f"the embedded Prefect server did not start; its log is {log}")


def _stop(server: subprocess.Popen[bytes]) -> None:
    server.terminate()
    try:
        server.wait(STOP_S)
    except subprocess.TimeoutExpired:
        server.kill()
        server.wait()

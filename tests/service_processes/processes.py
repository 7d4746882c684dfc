"""Services as processes: started in groups of their own, killed as a container is killed, none left behind."""

import os
import signal
import socket
import subprocess
import uuid
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from tests.waiting import until

TOKEN = "BELLA_TEST_TOKEN"
LOG_LINES_SHOWN = 40


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@dataclass
class Processes:
    """Processes of one test with their logs.

    Attributes
    ----------
    work : Path
        Working folder of all of them; nothing may be written there.
    logs : Path
    """

    work: Path
    logs: Path
    token: str = field(default_factory=lambda: uuid.uuid4().hex)
    running: dict[str, "subprocess.Popen[bytes]"] = field(default_factory=dict)

    def start(self, name: str, command: Sequence[str], environment: Mapping[str, str]) -> None:
        with (self.logs / f"{name}.log").open("ab") as log:
            self.running[name] = subprocess.Popen(
                command,
                cwd=self.work,
                env={"PATH": os.environ["PATH"], TOKEN: self.token, **environment},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def kill(self, name: str) -> None:
        """End a process and all it started, without a chance to tidy up: as the end of a container does."""
        process = self.running.pop(name)
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        until(lambda: group_is_empty(process.pid), f"all processes of {name} gone")

    def is_up(self, name: str) -> bool:
        return self.running[name].poll() is None

    def end(self) -> list[int]:
        """Kill what still runs; also what left its group, whose numbers are returned."""
        for name in list(self.running):
            self.kill(name)
        escaped = self._escaped()
        for pid in escaped:
            os.kill(pid, signal.SIGKILL)
        return escaped

    def told(self) -> str:
        """The last lines of every log."""
        parts = []
        for log in sorted(self.logs.glob("*.log")):
            lines = log.read_text(encoding="utf-8", errors="replace").splitlines()[-LOG_LINES_SHOWN:]
            parts.append("\n".join([f"----- {log.name}", *lines]))
        return "\n".join(parts)

    def _escaped(self) -> list[int]:
        mark = f"{TOKEN}={self.token}".encode()
        return [pid for pid in _pids() if mark in _environment(pid)]


def group_is_empty(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    return False


def _pids() -> list[int]:
    return [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()]


def _environment(pid: int) -> list[bytes]:
    try:
        return Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    except OSError:
        return []

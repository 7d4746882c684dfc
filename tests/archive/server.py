"""A small archive on the loopback that misbehaves on demand, and real CDF files to put into it."""

import hashlib
import socket
import struct
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from datetime import date
from email.utils import formatdate
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import unquote

import numpy as np

from bella.archive import Archive, Dataset, Manners, find_datasets
from bella.archive.sources import open_source

DAY = date(2012, 6, 7)
(H1, L2, STEREO, L3) = find_datasets(["WI_H1_WAV", "WI_L2_WAV_RAD1", "STEREO_LEVEL2_SWAVES", "STA_L3_WAV_HFR"])
Fault = Callable[["Handler"], None]


@cache
def cdf(seed: int = 0, compressed: int = 0) -> bytes:
    """Content of a real CDF file, some 80 kB, as an archive holds it."""
    from cdflib.cdfwrite import CDF

    with TemporaryDirectory() as folder:
        path = Path(folder) / "x.cdf"
        file = CDF(path, cdf_spec={"Compressed": compressed}, delete=True)
        values = np.random.default_rng(seed).random((100, 100))
        spec = {
            "Variable": "E_VOLTAGE_RAD1",
            "Data_Type": 45,
            "Num_Elements": 1,
            "Rec_Vary": True,
            "Dim_Sizes": [100],
            "Compress": 0,
        }
        file.write_var(spec, var_data=values)
        file.close()
        return path.read_bytes()


def path_of(dataset: Dataset, day: date = DAY, version: str = "01", spelling: int = 0) -> str:
    """Path of a file below the root of the archive."""
    name = dataset.name.format(date=f"{day:%Y%m%d}", version=version)
    return f"{dataset.folders(day)[spelling]}/{name}"


class Server:
    """What the archive holds, how it fails, and what it was asked.

    Attributes
    ----------
    files : dict of str to bytes
        By path.
    faults : dict of str to list
        What happens instead of the next answers for a path, the first first.
    asked : list of tuple
        Path and request headers of every request.
    sent : dict of str to int
        Bytes of the bodies that were sent, by path.
    """

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self.faults: dict[str, list[Fault]] = defaultdict(list)
        self.asked: list[tuple[str, dict[str, str]]] = []
        self.sent: dict[str, int] = defaultdict(int)
        self.has_validators = True
        self.has_ranges = True
        self._http = ThreadingHTTPServer(("127.0.0.1", 0), type("Bound", (Handler,), {"archive": self}))
        self._http.daemon_threads = True
        self._thread = threading.Thread(target=self._http.serve_forever, args=(0.02,), daemon=True)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._http.server_port}"

    def put(self, path: str, content: bytes) -> str:
        self.files[path] = content
        return path

    def asked_for(self, path: str) -> list[dict[str, str]]:
        return [headers for asked, headers in self.asked if asked == path]

    def names(self, folder: str) -> list[str]:
        below = [path.removeprefix(folder) for path in self.files if path.startswith(folder)]
        return sorted({name.split("/")[0] + "/" * ("/" in name) for name in below})

    def __enter__(self) -> "Server":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._http.shutdown()
        self._http.server_close()


class Handler(BaseHTTPRequestHandler):
    """Answers as Apache does."""

    archive: Server

    def log_message(self, *_: Any) -> None:
        pass

    def do_GET(self) -> None:
        path = unquote(self.path).lstrip("/")
        self.archive.asked.append((path, dict(self.headers)))
        faults = self.archive.faults[path]
        if faults:
            faults.pop(0)(self)
        elif path in self.archive.files:
            self.send_file(path, self.archive.files[path])
        elif path.endswith("/") and self.archive.names(path):
            self.send_listing(path)
        else:
            self.answer(404, b"<html>not found</html>")

    def answer(self, status: int, body: bytes = b"", **headers: str) -> None:
        self.send_response(status)
        for name, value in ({"Content_Length": str(len(body))} | headers).items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        self.wfile.write(body)
        self.archive.sent[unquote(self.path).lstrip("/")] += len(body)

    def send_listing(self, path: str) -> None:
        links = "".join(f'<li><a href="{name}">{name}</a>\n' for name in self.archive.names(path))
        page = f'<html><title>Index of /{path}</title><a href="?C=N;O=D">Name</a><a href="../">Up</a>{links}</html>'
        self.answer(200, page.encode())

    def send_file(self, path: str, content: bytes) -> None:
        tag = f'"{hashlib.md5(content).hexdigest()}"'
        about = {"ETag": tag, "Last_Modified": formatdate(1e9, usegmt=True)} if self.archive.has_validators else {}
        wanted = self.headers.get("Range")
        if self.headers.get("If-None-Match") == tag:
            self.answer(304, **about)
        elif wanted and self.archive.has_ranges and self.headers.get("If-Range") == tag:
            start = int(wanted.removeprefix("bytes=").rstrip("-"))
            span = f"bytes {start}-{len(content) - 1}/{len(content)}"
            self.answer(206, content[start:], Content_Range=span, **about)
        else:
            self.answer(200, content, **about)


def status(code: int, **headers: str) -> Fault:
    """Answer with an error."""
    return lambda handler: handler.answer(code, b"<html>error</html>", **headers)


def body(content: bytes, **headers: str) -> Fault:
    """Answer 200 with something else."""
    return lambda handler: handler.answer(200, content, **headers)


def cut_after(size: int) -> Fault:
    """Send the head of the file with the length of all of it, then hang up."""

    def cut(handler: Handler) -> None:
        path = unquote(handler.path).lstrip("/")
        content = handler.archive.files[path]
        tag = {"ETag": f'"{hashlib.md5(content).hexdigest()}"'} if handler.archive.has_validators else {}
        handler.answer(200, content[:size], **({"Content_Length": str(len(content))} | tag))
        handler.close_connection = True

    return cut


def whole_without_length(content: bytes) -> Fault:
    """Answer 200 without saying how much will come, and hang up after it."""

    def send(handler: Handler) -> None:
        handler.send_response(200)
        handler.end_headers()
        handler.wfile.write(content)

    return send


def reset(handler: Handler) -> None:
    """Reset the connection in the middle of the file."""
    handler.send_response(200)
    handler.send_header("Content-Length", "100000")
    handler.end_headers()
    handler.wfile.write(b"x" * 1000)
    handler.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    handler.connection.close()


def dribble(handler: Handler) -> None:
    """Send the file so slowly that it never comes to an end, though never silent for long."""
    content = handler.archive.files[unquote(handler.path).lstrip("/")]
    handler.send_response(200)
    handler.send_header("Content-Length", str(len(content)))
    handler.end_headers()
    with suppress(OSError):
        for start in range(0, len(content), 10):
            handler.wfile.write(content[start : start + 10])
            time.sleep(0.01)


def silent(released: threading.Event) -> Fault:
    """Say nothing until the test ends."""

    def wait(handler: Handler) -> None:
        released.wait(10)
        handler.close_connection = True

    return wait


class Clock:
    """Time that passes only where somebody waits."""

    def __init__(self) -> None:
        self.now = 0.0
        self.waits: list[float] = []

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.waits.append(seconds)
        self.now += seconds


def visit(server: Server | str, clock: Clock, timeout_s: float = 5.0, **manners: float) -> Archive:
    """An archive as a new run sees it."""
    url = server if isinstance(server, str) else server.url
    return Archive(open_source(url, timeout_s), Manners(clock=clock, sleep=clock.sleep, **manners))  # type: ignore[arg-type]


def visible(mirror: Path) -> list[str]:
    """Files that a reader of the mirror would find."""
    return sorted(str(path.relative_to(mirror)) for path in mirror.rglob("*.cdf") if not path.name.startswith("."))

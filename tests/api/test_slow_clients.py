"""Clients that send slowly do not keep the service from others: real sockets against the real server."""

import asyncio
import socket
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass

import httpx
import pytest
import uvicorn
from starlette.responses import StreamingResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from api import serve
from api.app import create_app
from bella.settings import Settings
from tests.service_processes.processes import free_port
from tests.waiting import PATIENCE_S, until

HEAD = b"GET /health/api HTTP/1.1\r\nHost: x\r\n"


@dataclass(frozen=True)
class Up:
    port: int

    def connect(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S)

    def answers(self) -> bool:
        url = f"http://127.0.0.1:{self.port}/health/api"
        return httpx.get(url, trust_env=False, timeout=PATIENCE_S).status_code == 200


@pytest.fixture
def up(empty: Settings, monkeypatch: pytest.MonkeyPatch) -> Iterator[Up]:
    monkeypatch.setattr(serve, "HEAD_S", 0.8)
    monkeypatch.setattr(serve, "BODY_S", 0.8)
    monkeypatch.setattr(serve, "MOST_CONNECTIONS", 40)
    with serving(create_app(empty)) as port:
        yield Up(port)


@contextmanager
def serving(app: ASGIApp) -> Iterator[int]:
    """Port at which the real server answers for an application."""
    port = free_port()
    options = serve.options() | {"timeout_keep_alive": 60}
    server = uvicorn.Server(uvicorn.Config(app, host="127.0.0.1", port=port, **options))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    until(lambda: server.started, "server started")
    yield port
    server.should_exit = True
    thread.join(30)


def is_closed(connection: socket.socket) -> bool:
    """Whether the server hangs up, without an answer."""
    try:
        return connection.recv(1) == b""
    except ConnectionError:
        return True


def dribble(connection: socket.socket, text: bytes, ended: list[float]) -> None:
    """Send a byte every 50 ms until the server hangs up."""
    began = time.monotonic()
    with suppress(OSError):
        for byte in text * 20:
            connection.sendall(bytes([byte]))
            time.sleep(0.05)
            connection.setblocking(False)
            with suppress(BlockingIOError):
                if connection.recv(1) == b"":
                    break
            connection.setblocking(True)
    ended.append(time.monotonic() - began)


def test_half_a_head_is_given_up(up: Up) -> None:
    with closing(up.connect()) as silent, closing(up.connect()) as half:
        half.sendall(HEAD)
        assert is_closed(half)
        assert is_closed(silent)
    assert up.answers()


def test_a_head_that_dribbles_in_wins_no_time(up: Up) -> None:
    ended: list[float] = []
    with closing(up.connect()) as slow:
        thread = threading.Thread(target=dribble, args=(slow, HEAD + b"X: y\r\n" * 100, ended))
        thread.start()
        thread.join(60)
    assert ended
    assert up.answers()


def test_a_body_that_stalls_is_given_up(up: Up) -> None:
    with closing(up.connect()) as slow:
        slow.sendall(b"POST /api/v1/arrivals HTTP/1.1\r\nHost: x\r\nContent-Type: text/csv\r\n")
        slow.sendall(b"Content-Length: 1000\r\n\r\nobservatory")
        while not is_closed(slow):  # an answer may come first, and is no reason to wait on
            pass
    assert up.answers()


def answer(line: socket.socket) -> bytes:
    """Head and body of a reply of /health/api, which may come in pieces."""
    got = b""
    while not got.endswith(b"}}"):
        more = line.recv(65536)
        assert more, "closed before the end of the reply"
        got += more
    return got


def test_the_second_request_of_a_connection_is_watched_too(up: Up) -> None:
    with closing(up.connect()) as slow:
        slow.sendall(HEAD + b"\r\n")
        assert answer(slow).startswith(b"HTTP/1.1 200")
        time.sleep(1.2)  # idle, which is allowed for longer than a head may take
        slow.sendall(HEAD + b"\r\n")
        assert answer(slow).startswith(b"HTTP/1.1 200")
        slow.sendall(HEAD)
        assert is_closed(slow)


def test_half_open_connections_do_not_shut_others_out(up: Up) -> None:
    with ExitStack() as stack:
        for _ in range(120):
            stack.enter_context(closing(up.connect())).sendall(HEAD)
        began = [up.answers() for _ in range(5)]
    assert began == [True] * 5


def test_a_head_without_end_is_refused(up: Up) -> None:
    with closing(up.connect()) as greedy:
        with suppress(OSError):
            greedy.sendall(HEAD + b"X: " + b"y" * 3 * serve.LARGEST_HEAD_BYTES)
        with suppress(ConnectionError):
            assert greedy.recv(65536).startswith(b"HTTP/1.1 400")
    assert up.answers()


def test_a_client_that_reads_nothing_of_its_reply_is_given_up_and_one_that_reads_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(serve, "READ_S", 0.5)
    ended: list[str] = []

    async def without_end(who: str) -> AsyncIterator[bytes]:
        try:
            while True:
                yield bytes(60_000)
                await asyncio.sleep(0.001)
        finally:
            ended.append(who)

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            await StreamingResponse(without_end(scope["path"]))(scope, receive, send)

    with serving(app) as port, closing(Up(port).connect()) as reads, closing(Up(port).connect()) as waits:
        for one, path in ((reads, b"/reads"), (waits, b"/waits")):
            one.sendall(b"GET " + path + b" HTTP/1.1\r\nHost: x\r\n\r\n")
        until(lambda: reads.recv(2**20) and ended, "one was given up", pause_s=0.0)
        assert ended == ["/waits"]
        for _ in range(100):
            assert reads.recv(2**20)
        with suppress(ConnectionError):
            while waits.recv(2**20):  # what was on its way, and then the end of a connection that was cut
                pass


def test_replies_do_not_wait_for_acknowledgements_on_a_shared_socket(empty: Settings) -> None:
    """As with several processes: asyncio itself sets this for sockets alone that it made."""
    config = uvicorn.Config(create_app(empty), host="127.0.0.1", port=free_port(), **serve.options())
    shared, server = config.bind_socket(), uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [shared]}, daemon=True)
    thread.start()
    until(lambda: server.started, "server started")
    with closing(socket.create_connection(("127.0.0.1", config.port), timeout=PATIENCE_S)):
        until(lambda: server.server_state.connections, "connection made")
        (connection,) = server.server_state.connections
        known = connection.transport.get_extra_info("socket")  # type: ignore[union-attr]
        assert known.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    server.should_exit = True
    thread.join(30)

"""The server process: uvicorn, with time limits on clients that send slowly. ``python -m api.serve --port 8000``.

uvicorn writes the usual phrase of a status; HAPI wants its code there: a reply with the header ``X-HAPI-Status`` has
the words of it after that phrase.
"""

import argparse
import asyncio
import socket
import sys
from collections.abc import Sequence
from http import HTTPStatus
from typing import Any

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from bella.catalogue.engine import parse_url
from bella.exceptions import BellaError
from bella.settings import read_settings

LAST_PORT = 65535
STATUS_HEADER = "X-HAPI-Status"
LARGEST_HEAD_BYTES = 16_384
"""Of a request."""

KEEP_ALIVE_S = 5
GRACE_S = 3
"""Time to finish replies when the process is told to end: a stream of alerts would never finish by itself."""

MOST_CONNECTIONS = 500
"""Connections at a time; above, those that have been sending the head of a request for longest are closed."""


class _Phrased(h11.Connection):
    def send(self, event: h11.Event) -> bytes | None:  # type: ignore[override]  # its overloads say no more
        """Bytes of an event; the status line of a response has the words of its header."""
        if isinstance(event, h11.Response):
            words = dict(event.headers).get(STATUS_HEADER.lower().encode())
            if words is not None:
                reason = HTTPStatus(event.status_code).phrase.encode() + b"; " + words
                event = h11.Response(status_code=event.status_code, headers=event.headers, reason=reason)
        return super().send(event)


class PhrasedProtocol(H11Protocol):
    """HTTP/1.1 of uvicorn with the phrases of :data:`STATUS_HEADER`."""

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self.conn = _Phrased(h11.SERVER, LARGEST_HEAD_BYTES)


HEAD_S, BODY_S = 10.0, 30.0
"""Longest time that a client may take to send the head of a request, and its body of at most a few MB."""

READ_S = 120.0
"""Longest time in which a client may take nothing of a reply that waits for it: a long one holds a connection to the
database meanwhile. What is on its way is some MB at most, so that a client of 100 kB/s is never closed."""


class TimedProtocol(PhrasedProtocol):
    """HTTP/1.1 that closes a connection whose client is too slow; uvicorn itself waits for ever."""

    _patience: asyncio.TimerHandle | None = None
    _waits_for = ""
    _reading: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for the head of a request."""
        super().connection_made(transport)
        # asyncio does not, for a socket that processes share: every reply would wait 40 ms for an acknowledgement
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._watch()
        if len(self.connections) > MOST_CONNECTIONS:
            self._make_room()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop to wait."""
        self._wait("", 0.0)
        self._stop_reading_watch()
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        """Begin to wait for a client that does not read what it asked for."""
        super().pause_writing()
        self._reading = self.loop.call_later(READ_S, self._close)

    def resume_writing(self) -> None:
        """Go on: the client has read."""
        self._stop_reading_watch()
        super().resume_writing()

    def _stop_reading_watch(self) -> None:
        if self._reading is not None:
            self._reading.cancel()

    def data_received(self, data: bytes) -> None:
        """Take what came; what is still missing of head or body has until the end of its time."""
        super().data_received(data)
        self._watch()

    def on_response_complete(self) -> None:
        """Let uvicorn wait for the next request: it closes a connection that is idle."""
        super().on_response_complete()
        self._watch()

    def _watch(self) -> None:
        cycle = self.cycle
        if cycle is not None and not cycle.response_complete:
            self._wait("body" if cycle.more_body else "", BODY_S)
        elif self.conn.their_state is h11.SEND_BODY:  # refused before its body had come
            self._wait("body", BODY_S)
        elif self.conn.their_state is h11.IDLE and (cycle is None or self.conn.trailing_data[0]):
            self._wait("head", HEAD_S)
        else:
            self._wait("", 0.0)

    def _wait(self, what: str, seconds: float) -> None:
        """Begin to wait for something, unless it is waited for already: data that dribble in win no time."""
        if what == self._waits_for:
            return
        if self._patience is not None:
            self._patience.cancel()
        self._waits_for = what
        self._patience = self.loop.call_later(seconds, self._close) if what else None

    def _close(self) -> None:
        if not self.transport.is_closing():
            self.transport.abort()

    def _make_room(self) -> None:
        """Close the connection that has waited for the head of a request for longest."""
        slow = [one for one in self.connections if isinstance(one, TimedProtocol) and one._waits_for == "head"]
        if slow:
            min(slow, key=lambda one: one._patience.when() if one._patience else 0.0)._close()


def options() -> dict[str, Any]:
    """Options of uvicorn that protect the service from its clients."""
    return {
        "http": TimedProtocol,
        "timeout_keep_alive": KEEP_ALIVE_S,
        "timeout_graceful_shutdown": GRACE_S,
        "log_level": "warning",
        "proxy_headers": True,
    }


def run(host: str, port: int, processes: int = 1) -> None:
    """Serve the application of the environment until the process is told to end.

    Parameters
    ----------
    processes : int
        That answer side by side; one that ends is started again.
    """
    uvicorn.run("api.app:create_app", host=host, port=port, workers=processes, factory=True, **options())


def port(text: str) -> int:
    """Number of a port that can be listened on; argparse says what is wrong with another."""
    number = int(text)
    if not 0 < number <= LAST_PORT:
        raise ValueError(text)
    return number


def main(arguments: Sequence[str] | None = None) -> None:
    """Serve the application of the environment."""
    parser = argparse.ArgumentParser(prog="python -m api.serve", description=__doc__)
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=port, default=8000)
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args(arguments)
    parse_url(read_settings().catalogue_url)  # what is wrong ends it here; what is away may come back
    run(given.host, given.port, given.processes)


if __name__ == "__main__":
    try:
        main()
    except BellaError as failure:
        sys.exit(f"api.serve: {failure}")

"""HTTP status lines in words of our own, where a reply asks for them: HAPI wants its code there.

uvicorn writes the usual phrase of a status. A reply with the header ``X-HAPI-Status`` has its words after that phrase.
Give the class to uvicorn as ``http=``; without it everything works, with the usual phrases.
"""

from http import HTTPStatus
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

STATUS_HEADER = "X-HAPI-Status"
LARGEST_HEAD_BYTES = 65_536
"""Of a request, as uvicorn sets it by default for its other protocol."""


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
        self.conn = _Phrased(h11.SERVER, self.config.h11_max_incomplete_event_size or LARGEST_HEAD_BYTES)

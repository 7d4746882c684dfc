"""Replies that are written while they are read: from one moment of the catalogue, with one page of it in memory."""

from collections.abc import Generator, Iterator
from contextvars import copy_context
from itertools import chain
from threading import BoundedSemaphore

from anyio import CancelScope
from fastapi import Request, Response
from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool
from starlette.types import Receive, Scope, Send

from api.freshness import REVALIDATE, WITHOUT_BODY
from bella.exceptions import BusyError

AT_ONCE = 8
"""Replies that are streamed at a time: each holds a connection to the database until its reader has it all."""

_FREE = BoundedSemaphore(AT_ONCE)


def streamed(request: Request, pieces: Generator[bytes], media_type: str, headers: dict[str, str]) -> Response:
    """Reply of these pieces; what fails before the first one is an error like any other.

    Parameters
    ----------
    request : Request
    pieces : generator of bytes
        Its steps run in several threads, one after the other, and see one context (so that a snapshot holds).
    media_type : str
    headers : dict of str to str

    Raises
    ------
    BusyError
        Where `AT_ONCE` replies are streamed already.
    """
    headers = {"Cache-Control": REVALIDATE, **headers}
    if request.scope.get(WITHOUT_BODY):
        return StreamingResponse(iter(()), media_type=media_type, headers=headers)
    running = _in_one_context(pieces)
    return _Streamed(next(running), running, media_type, headers)


def _in_one_context(pieces: Generator[bytes]) -> Generator[bytes]:
    if not _FREE.acquire(blocking=False):
        raise BusyError(f"{AT_ONCE} large replies are being sent already: try again, or ask page by page")
    context = copy_context()
    try:
        while (piece := context.run(next, pieces, None)) is not None:
            yield piece
    finally:
        context.run(pieces.close)
        _FREE.release()


class _Streamed(StreamingResponse):
    """A reply whose pieces end with it, also where its reader goes away."""

    def __init__(self, first: bytes, rest: Generator[bytes], media_type: str, headers: dict[str, str]) -> None:
        self._rest = rest
        pieces: Iterator[bytes] = chain([first], rest)
        super().__init__(pieces, media_type=media_type, headers=headers)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            with CancelScope(shield=True):
                await run_in_threadpool(self._rest.close)

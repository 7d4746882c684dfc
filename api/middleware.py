"""What is the same for all replies: tags and HEAD, compression, keeping, usual headers, and who may read."""

import time
from dataclasses import dataclass

from cachetools import LRUCache
from fastapi import FastAPI
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware.cors import CORSMiddleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.freshness import ENDLESS, REVALIDATE, OutgoingReply, Revalidated
from api.links import own_path
from api.service import Service

NEVER = (ENDLESS, "/static/", "/status", "/health", "/metrics")
"""Addresses whose replies are of this moment, or are not made of the catalogue."""

FILES = ("/figure.", "/posterior.zarr/")
"""Have in them addresses of files, with tags of their own."""

CONDITIONS = (b"if-none-match", b"if-modified-since")
"""Headers of a request that may make its reply a 304."""

AGE_S = 60.0
"""Longest time that a reply is kept: some hold the date of today, or figures that were drawn after the last commit."""

MOST_BYTES, LARGEST_BYTES = 64_000_000, 1_000_000
"""Of all replies of one process, and of one."""
# scripts and styles come from this service alone; spectra are data: images inside of figures
CONTENT_SECURITY_POLICY = "; ".join(
    [
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data:",
        "connect-src 'self'",
        "form-action 'self'",
        "base-uri 'none'",
        "frame-ancestors 'self'",
    ]
)
ALWAYS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Content-Security-Policy": CONTENT_SECURITY_POLICY,
    "Cache-Control": REVALIDATE,
}


@dataclass(frozen=True)
class _Kept:
    """A whole reply, and the state of the catalogue that it was made of."""

    state: str
    until_s: float
    headers: list[tuple[bytes, bytes]]
    body: bytes


class KeptReplies:
    """Answers a GET from memory where the same was asked since the catalogue changed last.

    The state is looked up before a reply is made, so that one is never older than it is said to be.
    """

    def __init__(self, app: ASGIApp, service: Service) -> None:
        self.app, self.service = app, service
        self._kept = LRUCache[tuple[str, ...], _Kept](MOST_BYTES, getsizeof=lambda one: len(one.body))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or pass the request on and keep the reply."""
        asked = Headers(scope=scope) if scope["type"] == "http" else Headers()
        state = await run_in_threadpool(self.service.state) if _may_be_kept(scope, asked) else None
        if state is None:
            await self.app(scope, receive, send)
            return
        key, reply = _key(scope, asked), OutgoingReply(asked, send, without_body=False)
        kept = self._kept.get(key)
        if kept is None or kept.state != state or kept.until_s < time.monotonic():
            kept = await self._made(scope, receive, reply, state)
            if kept is None:
                return
            self._kept[key] = kept
        await reply.take({"type": "http.response.start", "status": 200, "headers": [*kept.headers]})
        await reply.take({"type": "http.response.body", "body": kept.body})

    async def _made(self, scope: Scope, receive: Receive, reply: OutgoingReply, state: str) -> _Kept | None:
        """The reply of the application; None where it is not kept, and was sent."""
        start: Message = {}
        found: list[_Kept] = []

        async def _take(message: Message) -> None:
            nonlocal start
            if message["type"] == "http.response.start":
                start = message
                return
            if start and not found:
                body, headers = message.get("body", b""), Headers(raw=start["headers"])
                is_whole = start["status"] == 200 and not message.get("more_body") and "etag" in headers
                if is_whole and "cache-control" not in headers and len(body) <= LARGEST_BYTES:
                    until_s = time.monotonic() + AGE_S
                    found.append(_Kept(state, until_s, [*start["headers"]], body))
                    return
                await reply.take(start)
                start = {}
            await reply.take(message)

        rest = [(name, value) for name, value in scope["headers"] if name not in CONDITIONS]
        await self.app({**scope, "headers": rest}, receive, _take)
        return found[0] if found else None


def _may_be_kept(scope: Scope, asked: Headers) -> bool:
    if scope["type"] != "http" or scope["method"] != "GET":
        return False
    path = own_path(scope)
    is_file = any(one in path for one in FILES)
    is_streamed = b"limit=all" in scope["query_string"]  # sent piece by piece, which are made as they are taken
    return not (path.startswith(NEVER) or is_file or is_streamed or "authorization" in asked)


def _key(scope: Scope, asked: Headers) -> tuple[str, ...]:
    """All of a request that a reply depends on; addresses in it begin with scheme, host and prefix."""
    return (
        scope["scheme"],
        asked.get("host", ""),
        scope.get("root_path", ""),
        scope["path"],
        scope["query_string"].decode("latin-1"),
        asked.get("accept", ""),
        "gzip" if "gzip" in asked.get("accept-encoding", "") else "",
    )


class UsualHeaders:
    """Adds the headers of `ALWAYS` to each reply that has none of its own."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on and mark the reply."""

        async def _marked(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in ALWAYS.items():
                    headers.setdefault(name, value)
            await send(message)

        await self.app(scope, receive, _marked if scope["type"] == "http" else send)


class CompressAllButStore(GZipMiddleware):
    """Compresses replies, but not the files of the store: those are compressed already, and read in byte ranges."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Compress, or pass on as it is."""
        if "/posterior.zarr/" in scope.get("path", ""):
            await self.app(scope, receive, send)
        else:
            await super().__call__(scope, receive, send)


def install_headers(app: FastAPI, service: Service) -> None:
    """Add all of this to an application."""
    app.add_middleware(Revalidated)
    # the best compression takes twice the time of this one, for a reply that is 3 to 20 % smaller
    app.add_middleware(CompressAllButStore, minimum_size=1000, compresslevel=4)
    app.add_middleware(KeptReplies, service=service)
    app.add_middleware(
        CORSMiddleware,
        allow_origins=["*"],
        allow_methods=["GET", "HEAD"],
        allow_headers=["Range", "If-None-Match", "If-Modified-Since", "Accept", "Last-Event-ID"],
        expose_headers=["ETag", "Content-Range", "Content-Length", "Accept-Ranges", "Retry-After"],
    )

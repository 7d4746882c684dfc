"""What is the same for all replies: tags and HEAD, compression, keeping, security headers, and who may read."""

from fastapi import FastAPI
from starlette.datastructures import MutableHeaders
from starlette.middleware.cors import CORSMiddleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.freshness import Revalidated
from api.kept import KeptReplies
from api.service import Service

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
}


class SecurityHeaders:
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
    """Add all of this to an application.

    Parameters
    ----------
    app : FastAPI
    service : Service
    """
    app.add_middleware(Revalidated)
    app.add_middleware(CompressAllButStore, minimum_size=1000, compresslevel=6)
    app.add_middleware(KeptReplies, service=service)
    app.add_middleware(
        CORSMiddleware,
        allow_origins=["*"],
        allow_methods=["GET", "HEAD"],
        allow_headers=["Range", "If-None-Match", "If-Modified-Since", "Accept", "Last-Event-ID"],
        expose_headers=["ETag", "Content-Range", "Content-Length", "Accept-Ranges", "Retry-After"],
    )
    app.add_middleware(SecurityHeaders)

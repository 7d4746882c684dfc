"""Addresses of bursts, solutions and days, as the readers of the service know them: behind a proxy with a prefix."""

import re
from contextvars import ContextVar
from datetime import date, timedelta
from urllib.parse import urlencode

from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from bella.catalogue import Burst, Solution
from bella.records import REAL_ORIGINS, Origin

FORWARDED = b"x-forwarded-prefix"
"""Header in which a proxy on this machine says what it puts before every path."""

_PREFIX_PATTERN = re.compile(r"(/[A-Za-z0-9._~-]+)+")
_LOCAL = ("127.0.0.1", "::1")
_PREFIX: ContextVar[str] = ContextVar("prefix", default="")
API = "/api/v1"


def linked(path: str) -> str:
    """Path of an address of this service, for a link in the reply to the present request."""
    return _PREFIX.get() + path


def site_url(request: Request) -> str:
    """Scheme and host of this service, to which paths from `linked` are appended."""
    return str(request.base_url).rstrip("/").removesuffix(_PREFIX.get())


def linked_text(page: str) -> str:
    """A page whose links to this service lead there behind a proxy, too."""
    prefix = _PREFIX.get()
    return re.sub(rf'="(?=/(?!/|{re.escape(prefix[1:])}/))', f'="{prefix}', page) if prefix else page


def own_path(scope: Scope) -> str:
    """Path of a request without the prefix of a proxy."""
    path: str = scope.get("path", "")
    return path.removeprefix(scope.get("root_path", ""))


class Prefixed:
    """Serves below a prefix, whether or not the proxy takes it off what it passes on.

    Parameters
    ----------
    prefix : str
        Such as ``/bella``; empty to take that of the header X-Forwarded-Prefix, from this machine alone.
    """

    def __init__(self, app: ASGIApp, prefix: str) -> None:
        self.app, self.prefix = app, prefix.rstrip("/")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on with its prefix as the root of the application."""
        prefix = self.prefix or _forwarded(scope) if scope["type"] == "http" else ""
        if not prefix:
            await self.app(scope, receive, send)
            return
        path: str = scope["path"]
        whole = path if path.startswith(f"{prefix}/") else prefix + path
        token = _PREFIX.set(prefix)
        try:
            await self.app({**scope, "root_path": prefix, "path": whole}, receive, send)
        finally:
            _PREFIX.reset(token)


def _forwarded(scope: Scope) -> str:
    if (scope.get("client") or ("",))[0] not in _LOCAL:
        return ""
    given = next((value.decode("latin-1") for name, value in scope["headers"] if name == FORWARDED), "").rstrip("/")
    return given if _PREFIX_PATTERN.fullmatch(given) else ""


def zarr_path(solution: Solution) -> str:
    """Address path of the Zarr group of a solution."""
    return f"{API}/solutions/{solution.solution_id}/posterior.zarr"


def figure_path(solution: Solution, name: str) -> str:
    """Address path of a figure of a solution."""
    return linked(f"{API}/solutions/{solution.solution_id}/figures/{name}")


def day_links(day: date, origin: Origin = Origin.ARCHIVE) -> dict[str, str]:
    """Addresses of everything about a searched day; those of simulated and test data ask for their origin."""
    base = linked(f"{API}/days/{day}")
    asked = {} if origin in REAL_ORIGINS else {"origin": origin.value}
    received = urlencode({"start": day, "stop": day + timedelta(days=1), **asked})
    tail = f"?{urlencode(asked)}" if asked else ""
    return {
        "self": f"{base}{tail}",
        "page": linked(f"/days/{day}{tail}"),
        "figure": f"{base}/figure.svg{tail}",
        "detections": linked(f"{API}/detections?{received}"),
        "observability": f"{base}/observability{tail}",
    }


def burst_links(burst: Burst) -> dict[str, str]:
    """Addresses of everything about a burst."""
    base = linked(f"{API}/bursts/{burst.burst_id}")
    parts = ("versions", "track", "posterior", "events")
    figures = {f"figure_{name}": f"{base}/figures/{name}.svg" for name in ("constellation", "spectra")}
    return {
        "self": base,
        "page": linked(f"/bursts/{burst.burst_id}"),
        **{part: f"{base}/{part}" for part in parts},
        **figures,
    }

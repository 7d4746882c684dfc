"""Entity tags and times of change: what has not changed is not sent again. HEAD: what is sent, without sending it."""

import hashlib
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime, parsedate_to_datetime
from pathlib import Path

from fastapi import Request, Response
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.links import own_path
from bella import __version__
from bella.catalogue import Solution

ENDLESS = "/api/v1/alerts/stream"

STARTED_UTC = datetime.now(UTC)
SETTLED = timedelta(seconds=60)
"""Times of change are those of the writer, not of its commit, and whole seconds: a list may change again unseen until
they are as old as this (RFC 9110, 8.8.2.2)."""

WITHOUT_BODY = "bella.without_body"
"""Key of the scope of a request: the body of its reply is not sent, so that it need not be made."""

IMMUTABLE = "public, max-age=31536000, immutable"
REVALIDATE = "no-cache"


def tag_of(solutions: Iterable[Solution], *more: object) -> str:
    """Entity tag of a reply that is made from these solutions, by this version, of these further values.

    Returns
    -------
    str
        Quoted, as the header wants it.
    """
    content = "|".join([__version__, *(solution.store_sha256 for solution in solutions), *map(str, more)])
    return f'W/"{hashlib.sha256(content.encode()).hexdigest()[:32]}"'


def file_tag(path: Path) -> str:
    """Entity tag of a file that is replaced whole where it changes."""
    known = path.stat()
    return f'W/"{known.st_mtime_ns:x}-{known.st_size:x}"'


def last_modified(*changed: datetime | None) -> dict[str, str]:
    """Header that says when something was changed last; none where that is not known, or less than `SETTLED` ago.

    Replies are changed by a new version of this software, too: none is older than this process.
    """
    known = [one for one in changed if one is not None]
    newest = max((STARTED_UTC, *known))
    if not known or datetime.now(UTC) - newest < SETTLED:
        return {}
    return {"Last-Modified": format_datetime(newest, usegmt=True)}


def is_known(request: Request, tag: str, modified: str | None = None) -> bool:
    """Whether the reader has this entity already, by its tag, or else by its Last-Modified (RFC 9110, 13.2.2)."""
    return has_entity(request.headers, tag, modified)


def has_entity(asked: Headers, tag: str, modified: str | None) -> bool:
    """Whether the headers of a request say that the reader has this entity."""
    if "if-none-match" in asked:
        known = {part.strip().removeprefix("W/") for part in asked["if-none-match"].split(",")}
        return tag.removeprefix("W/") in known or "*" in known
    since, changed = _moment(asked.get("if-modified-since")), _moment(modified)
    return since is not None and changed is not None and changed <= since


def _moment(text: str | None) -> datetime | None:
    try:
        moment = parsedate_to_datetime(text) if text else None
    except (ValueError, OverflowError):
        return None
    return moment and (moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment)


def not_modified(tag: str, **more: str) -> Response:
    """Reply to a reader who has this entity already; `more` are what its whole reply says of caches beside these."""
    return Response(status_code=304, headers={"ETag": tag, **more})


def not_modified_headers(whole: Headers) -> MutableHeaders:
    """Headers of a 304, of those of the whole reply."""
    return MutableHeaders({name: whole[name] for name in ("etag", "cache-control", "vary") if name in whole})


class Revalidated:
    """Gives every whole reply an entity tag, answers 304 to who has it already, and HEAD as GET without the body.

    Tags are of the content of a reply: they save sending it, and not reading it from the catalogue.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, as GET where it is HEAD, and mark the reply."""
        path = own_path(scope)
        asked = scope["type"] == "http" and scope["method"] in {"GET", "HEAD"}
        if not asked or path == ENDLESS or "/posterior.zarr/" in path:
            await self.app(scope, receive, send)
            return
        is_head = scope["method"] == "HEAD"
        reply = OutgoingReply(Headers(scope=scope), send, without_body=is_head)
        await self.app({**scope, "method": "GET", WITHOUT_BODY: is_head}, receive, reply.take)


class OutgoingReply:
    """A reply on its way: its start waits for its body, whose tag it carries; 304 where the reader has it already.

    Parameters
    ----------
    asked : Headers
        Of the request.
    """

    def __init__(self, asked: Headers, send: Send, *, without_body: bool) -> None:
        self.asked, self.send, self.without_body = asked, send, without_body
        self.start: Message = {}
        self.is_begun = False
        self.is_over = False

    async def take(self, message: Message) -> None:
        """Take the next message of the application."""
        if message["type"] == "http.response.start":
            self.start = message
        elif self.is_over:
            return  # the rest of a body that nobody asked for
        elif message["type"] == "http.response.body" and not self.is_begun:
            await self._begin(message)
        else:
            await self.send(message)

    async def _begin(self, body: Message) -> None:
        self.is_begun = True
        headers = MutableHeaders(raw=self.start["headers"])
        if self.start["status"] == 200:
            if "etag" not in headers and not body.get("more_body"):
                content = headers.get("content-type", "").encode() + body.get("body", b"")
                headers["ETag"] = f'W/"{hashlib.sha256(content).hexdigest()[:32]}"'
            if "etag" in headers and has_entity(self.asked, headers["etag"], headers.get("last-modified")):
                raw = not_modified_headers(headers).raw
                self.start = {"type": "http.response.start", "status": 304, "headers": raw}
                self.without_body = True
        self.is_over = self.without_body
        await self.send(self.start)
        await self.send({"type": "http.response.body", "body": b""} if self.without_body else body)

"""Entity tags: what has not changed is not sent again."""

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from fastapi import Request, Response
from fastapi.responses import JSONResponse

from bella import __version__
from bella.catalogue import Solution

IMMUTABLE = "public, max-age=31536000, immutable"
REVALIDATE = "no-cache"


def tag_of(solutions: Iterable[Solution], *more: object) -> str:
    """Entity tag of a reply that is made from these solutions, by this version, of these further values.

    Parameters
    ----------
    solutions : iterable of Solution
    *more : object

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


def is_known(request: Request, tag: str) -> bool:
    """Whether the reader has this entity already."""
    known = {part.strip().removeprefix("W/") for part in request.headers.get("if-none-match", "").split(",")}
    return tag.removeprefix("W/") in known or "*" in known


def fresh_json(content: Any, tag: str) -> Response:
    """JSON reply with its entity tag."""
    return JSONResponse(content, headers={"ETag": tag, "Cache-Control": REVALIDATE})


def not_modified(tag: str) -> Response:
    """Reply to a reader who has this entity already."""
    return Response(status_code=304, headers={"ETag": tag, "Cache-Control": REVALIDATE})

"""Style sheets, scripts and pictures of the pages: read, tagged and compressed once."""

import gzip
import hashlib
import mimetypes
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from fastapi import APIRouter, Request, Response

from api.freshness import IMMUTABLE
from bella.exceptions import NoDataError
from bella.plotting import figure_style

STATIC = Path(__file__).parent / "static"
FIGURE_STYLE = "figure.css"
"""Style of figures, on pages and in files the same."""

router = APIRouter(include_in_schema=False)


@dataclass(frozen=True)
class _File:
    body: bytes
    compressed: bytes
    media_type: str
    tag: str


@router.get("/static/{name}")
def static_file(request: Request, name: str) -> Response:
    """A file of the pages; for good where its address names a version, as those in pages do."""
    file = _files().get(name)
    if file is None:
        raise NoDataError(f"there is no file {name[:40]!r}")
    body, headers = file.body, {"ETag": file.tag, "Vary": "Accept-Encoding"}
    if "v" in request.query_params:
        headers["Cache-Control"] = IMMUTABLE
    if "gzip" in request.headers.get("accept-encoding", ""):
        body, headers["Content-Encoding"] = file.compressed, "gzip"
    return Response(body, media_type=file.media_type, headers=headers)


@cache
def _files() -> dict[str, _File]:
    contents = {path.name: path.read_bytes() for path in STATIC.iterdir()} | {FIGURE_STYLE: figure_style().encode()}
    return {name: _file(name, body) for name, body in contents.items()}


def _file(name: str, body: bytes) -> _File:
    media_type = mimetypes.guess_type(name)[0] or "application/octet-stream"
    return _File(body, gzip.compress(body, 9, mtime=0), media_type, f'W/"{hashlib.sha256(body).hexdigest()[:32]}"')

"""Parts of a body: how Zarr reads one chunk of a file that holds many."""

import re
import zlib

from fastapi import Request, Response

RANGE = re.compile(r"bytes=(\d{1,18})?-(\d{1,18})?")


def ranged(request: Request, content: bytes, kind: str, headers: dict[str, str]) -> Response:
    """Answer with what the header Range asks for of a body, or with all of it.

    Parameters
    ----------
    kind : str
        Media type.

    Returns
    -------
    Response
        206 with a part; 416 where it begins after the end; 200 without the header, or where it asks for several parts.
    """
    size = len(content)
    headers = headers | {"Accept-Ranges": "bytes", "ETag": f'"{zlib.crc32(content):08x}-{size}"'}
    asked = RANGE.fullmatch(request.headers.get("range", ""))
    is_other = request.headers.get("if-range", headers["ETag"]) != headers["ETag"]
    if asked is None or asked.groups() == (None, None) or is_other:
        return Response(content, media_type=kind, headers=headers)
    first, last = (None if one is None else int(one) for one in asked.groups())
    if first is None:
        first, last = max(0, size - (last or 0)), size
    stop = size if last is None else min(last + 1, size)
    if first >= size:
        return Response(status_code=416, headers=headers | {"Content-Range": f"bytes */{size}"})
    if stop <= first:
        return Response(content, media_type=kind, headers=headers)
    part = {"Content-Range": f"bytes {first}-{stop - 1}/{size}"}
    return Response(content[first:stop], 206, media_type=kind, headers=headers | part)

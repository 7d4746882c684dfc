"""Whether what came from the archive is a whole CDF file."""

import hashlib
import struct
from pathlib import Path
from typing import BinaryIO

MAGIC = (b"\xcd\xf3\x00\x01", b"\xcd\xf2\x60\x02", b"\x00\x00\xff\xff")
COMPRESSED = b"\xcc\xcc\x00\x01"
HEAD_BYTES = 512
HAS_MD5 = 0b1100


def complaint(path: Path) -> str:
    """What is wrong with a file that should be CDF.

    Parameters
    ----------
    path : pathlib.Path
        File to look at.

    Returns
    -------
    str
        Empty if nothing is wrong, as far as magic numbers, the length that the file states of itself and, where it has
        one, its checksum can tell.
    """
    with path.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
        if not head.startswith(MAGIC):
            return "an HTML page" if b"<html" in head.lower() or b"<!doctype" in head.lower() else "not a CDF file"
        if not head.startswith(MAGIC[0]):
            return ""  # version 2, in use until 2005, does not say how long it is in the same place
        return _wrong_length(stream, head, path.stat().st_size)


def _wrong_length(stream: BinaryIO, head: bytes, size: int) -> str:
    """Check version 3: its first record (CDR) has the offset of the second (GDR) at byte 20 and flags at byte 40.

    The second has the length of the file at its byte 36, not counting an MD5 checksum behind it (CDF Internal Format
    Description, version 3, sections 2.2 and 2.3; agrees with real files of three producers). In a file that is
    compressed as a whole, the second record (CPR) is the last, and has its own length at its byte 0.
    """
    is_compressed = head[4:8] == COMPRESSED
    has_md5 = not is_compressed and len(head) > 43 and head[43] & HAS_MD5 == HAS_MD5
    second = _integer(head[20:28])
    stream.seek(min(max(second, 0), size))
    record = stream.read(44)
    length = second + _integer(record[:8]) if is_compressed else _integer(record[36:44])
    if not 0 < second < length <= size - 16 * has_md5:
        return f"cut after {size} bytes"
    stream.seek(0)
    is_damaged = has_md5 and hashlib.md5(stream.read(length), usedforsecurity=False).digest() != stream.read(16)
    return "damaged: its checksum does not fit" if is_damaged else ""


def _integer(raw: bytes) -> int:
    """Signed 8 bytes, big-endian; -1 where they are not all there."""
    return int(struct.unpack(">q", raw)[0]) if len(raw) == 8 else -1

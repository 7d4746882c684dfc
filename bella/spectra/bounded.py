"""Reading damaged files without harm: every length a file claims is held against what the file can hold.

A file cut short, or with a flipped bit, may claim records of exabytes, lists that run in circles, or compressed blocks
that swell a thousandfold. The libraries that read such files believe them. Here they are given a stream that does not.
"""

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import BinaryIO

import numpy as np

from bella.exceptions import BellaError, InputError

READS = 100_000
"""Pieces that may be read from one file; the richest archive file needs about a tenth."""

MARGIN_BYTES = 16 << 20
REREAD = 20
PIECE_BYTES = 1 << 16
INFLATED_BYTES = 256 << 20
"""Most that one file may hold once decompressed; a day at native cadence holds less than half."""


@contextmanager
def reading(name: str, kind: str) -> Iterator[None]:
    """Turn whatever a library raises on a damaged file into an error that names file and reason.

    Parameters
    ----------
    name : str
        Name of the file.
    kind : str
        What it is read as, such as "CDF".

    Raises
    ------
    InputError
        In place of any other exception.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except BellaError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise InputError(f"{name} cannot be read as {kind} ({reason}): download it again") from error


class BoundedStream:
    """A file that refuses to be read beyond its end, too often or too much.

    Parameters
    ----------
    stream : BinaryIO
        Open for reading and seekable; closed with this object.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self.size = stream.seek(0, 2)
        stream.seek(0)
        self._reads_left = READS
        self._bytes_left = REREAD * self.size + MARGIN_BYTES

    def read(self, size: int = -1) -> bytes:
        """The next `size` bytes, all of them.

        Raises
        ------
        ValueError
            If there are fewer, or if too much was read already.
        """
        self._reads_left -= 1
        self._bytes_left -= max(size, 0)
        if not 0 <= size <= self.size:
            raise ValueError(f"a record claims {size} bytes in a file of {self.size}")
        if self._reads_left < 0 or self._bytes_left < 0:
            raise ValueError("its records do not end")
        piece = self._stream.read(size)
        if len(piece) < size:
            raise ValueError(f"it ends early, after {self.size} bytes")
        return piece

    def seek(self, offset: int, whence: int = 0) -> int:
        """Go to a place in the file.

        Raises
        ------
        ValueError
            If it lies outside.
        """
        if whence == 0 and not 0 <= offset <= self.size:
            raise ValueError(f"it ends early: a record is at byte {offset} of {self.size}")
        return self._stream.seek(offset, whence)

    def tell(self) -> int:
        """Where in the file the next byte is read."""
        return self._stream.tell()

    def close(self) -> None:
        """Close the file."""
        self._stream.close()


def inflate(compressed: bytes, limit: int) -> bytearray:
    """Decompress gzip, but no more than `limit` bytes.

    Piece by piece, as zlib holds all it made a second time before it returns it.

    Parameters
    ----------
    compressed : bytes
        A gzip or zlib stream.
    limit : int
        Largest size to accept, bytes.

    Returns
    -------
    bytearray
        What was compressed.

    Raises
    ------
    ValueError
        If it is larger, or cut short.
    """
    inflater = zlib.decompressobj(wbits=zlib.MAX_WBITS | 32)
    content = bytearray()
    for begin in range(0, len(compressed), PIECE_BYTES):
        content += inflater.decompress(compressed[begin : begin + PIECE_BYTES], limit + 1 - len(content))
        if len(content) > limit:
            raise ValueError(f"a compressed record holds more than {limit} bytes")
        if inflater.eof:
            break
    if not inflater.eof:
        raise ValueError("a compressed record is cut short")
    return content

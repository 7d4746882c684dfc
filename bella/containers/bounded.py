"""Reading damaged files without harm: libraries that believe what a file claims read it in a process of their own.

A file cut short, or with a flipped bit, may claim records of exabytes, lists that run in circles, or compressed blocks
that swell a thousandfold. That process has little time and memory (:mod:`bella.containers.reader_process`); it is
started with the first file and serves all that follow, as starting it takes longer than reading a day of minutes.
"""

import atexit
import json
import math
import os
import re
import select
import signal
import subprocess
import sys
import threading
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from bella.exceptions import BellaError, InputError, WorkerLostError
from bella.threads import ONE_THREAD

SCRIPT = Path(__file__).with_name("reader_process.py")
LEAST_CPU_S, CPU_S_PER_MB = 5, 1.0
"""Longest that reading may take, s of the processor; reading a real day takes a twentieth of it."""

WALL_FACTOR = 20.0
"""A machine at work on other things gives a process this share of its time at least."""

PIECE_BYTES = 1 << 16
INFLATED_BYTES = 256 << 20
"""Most that one file may hold once decompressed; a day at native cadence holds less than half."""

LARGEST_ANSWER_BYTES = 1 << 30
KILLED = "the process that reads files was killed, perhaps for want of memory: try again"
ANOTHER = "take another version of the file"
"""What to do about a file that is whole, but not as its product is."""

UNREADABLE = re.compile(r"(?<!de)compression|encod|unsupported|not (?:implemented|supported|registered)", re.IGNORECASE)
"""Words of libraries about what they do not read in a file that may be whole."""


@contextmanager
def reading(name: str, kind: str) -> Iterator[None]:
    """Turn whatever a library raises on a damaged file into an error that names file and reason.

    Parameters
    ----------
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
        advice = f"write it anew as a plain {kind}" if UNREADABLE.search(reason) else "download it again"
        raise InputError(f"{name} cannot be read as {kind} ({reason}): {advice}") from error


class ReaderProcess:
    """The process that reads files, started anew whenever a file has ended it."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0

    def ask(self, do: str, *of: Any, cpu_s: float = LEAST_CPU_S) -> Any:
        """What the process answers to a request; hold ``lock`` through the requests of one file.

        Parameters
        ----------
        do : str
            Name of the request.
        of : Any
            Its arguments, as JSON has them.
        cpu_s : float
            Longest that it may take, s of the processor.

        Returns
        -------
        Any
            A value of JSON, or an array.

        Raises
        ------
        ValueError
            With the reason where the file cannot be read, or not within the limits.
        WorkerLostError
            If somebody killed the process: the file may be whole.
        """
        with self.lock:
            if self._was_killed():
                self.stop()  # with it went the file that was open
                raise WorkerLostError(KILLED)
            process = self._running()
            request = json.dumps({"do": do, "of": of, "cpu_s": cpu_s}).encode() + b"\n"
            try:
                process.stdin.write(request)  # type: ignore[union-attr]
                process.stdin.flush()  # type: ignore[union-attr]
                return self._answer(process, cpu_s)
            except (OSError, EOFError, json.JSONDecodeError):
                raise self._why_ended(cpu_s) from None

    def stop(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is not None and self._owner == os.getpid():
            process.kill()
            process.communicate()

    def _was_killed(self) -> bool:
        is_mine = self._process is not None and self._owner == os.getpid()
        return is_mine and self._process.poll() == -signal.SIGKILL  # type: ignore[union-attr]

    def _running(self) -> "subprocess.Popen[bytes]":
        is_mine = self._owner == os.getpid()  # after a fork the process belongs to the parent
        if self._process is None or not is_mine or self._process.poll() is not None:
            self._owner = os.getpid()
            self._process = subprocess.Popen(  # noqa: S603 - a script of this package
                [sys.executable, "-I", os.fspath(SCRIPT)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **ONE_THREAD},
            )
        return self._process

    def _answer(self, process: "subprocess.Popen[bytes]", cpu_s: float) -> Any:
        stream = process.stdout
        if stream is None or not select.select([stream], [], [], WALL_FACTOR * cpu_s)[0]:
            raise EOFError
        head = json.loads(stream.readline())
        if "error" in head:
            raise ValueError(head["error"])
        if "dtype" not in head:
            return head["value"]
        dtype, shape = np.dtype(head["dtype"]), tuple(head["shape"])
        if dtype.kind not in "iufc" or not 0 <= dtype.itemsize * math.prod(shape) <= LARGEST_ANSWER_BYTES:
            raise EOFError
        values = np.empty(shape, dtype)
        left = values.data.cast("B") if values.size else memoryview(b"")
        while left:
            count = stream.readinto(left)  # type: ignore[attr-defined]
            if not count:
                raise EOFError
            left = left[count:]
        return values

    def _why_ended(self, cpu_s: float) -> Exception:
        process = self._process
        try:
            code = process.wait(1.0) if process is not None else 0
        except subprocess.TimeoutExpired:
            code = 0
        self.stop()
        if code == -signal.SIGKILL:
            return WorkerLostError(KILLED)
        hangs = "the library that reads it hangs or crashes on it"
        if code in {0, -signal.SIGPROF}:
            return ValueError(f"{hangs}: it does not end within {cpu_s:g} s")
        return ValueError(f"{hangs}, signal {-code}")


READER = ReaderProcess()
atexit.register(READER.stop)


def check_hdf5(path: Path, cpu_s: float = LEAST_CPU_S) -> None:
    """Read a file in the process for damaged files, where the HDF5 library may hang or crash without harm.

    Parameters
    ----------
    path : pathlib.Path
        HDF5 file.
    cpu_s : float
        Longest it may take, s of the processor.

    Raises
    ------
    ValueError
        If it cannot be read, or not in bounded time and memory.
    """
    READER.ask("probe", str(path.absolute()), cpu_s=cpu_s)


def cpu_limit_s(path: Path) -> int:
    """Longest that reading a file may take, s of the processor."""
    return LEAST_CPU_S + int(CPU_S_PER_MB * path.stat().st_size / 1e6)


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

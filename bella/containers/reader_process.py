"""Reads CDF, HDF5 and Zarr for another process: a script, run with little memory and time.

A damaged file may claim records of exabytes, run in circles, or crash the library that reads it; nothing in Python can
stop that from inside. Here it may happen: when this process ends, the other one says so and starts the next.

A request is a line of JSON, an answer a line of JSON and, where it has an array, the bytes of the array.
"""

import contextlib
import json
import math
import os
import resource
import signal
import struct
import sys
import tempfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cdflib
import numpy as np

MEMORY_BYTES = 3 << 30
LARGEST_BYTES = 1 << 30
"""Most that one variable or one decompressed file may hold; a day of 42 811 sweeps of 321 channels has 55 MB."""

MOST_VALUES = 1 << 25
"""Most of one variable; the same day has 14 million."""

GZIP_FACTOR, ROOM_BYTES = 1032, 1 << 20
"""Most that gzip packs into a byte (zlib's technical details); what a small file may claim beyond that."""

LARGEST_PROBED_BYTES = 256 << 20
GZIP = b"\x1f\x8b"
VERSION_2 = (b"\xcd\xf2\x60\x02", b"\x00\x00\xff\xff")
UNPACKED = b"\x00\x00\xff\xff"
PIECE_BYTES = 1 << 20
UNCOMPRESSED, COMPRESSED = b"\xcd\xf3\x00\x01\x00\x00\xff\xff", b"\xcd\xf3\x00\x01\xcc\xcc\x00\x01"
MOST_PACKED = 3
"""A CDF compressed as a whole may be in a .cdf.gz, and that be packed a second time by its user."""

CCR_BYTES = 40
"""Before what is compressed: eight bytes that mark the file, and the head of the record that holds it."""


class Reader:
    """One open CDF at a time."""

    def __init__(self) -> None:
        self._cdf: Any = None
        self._unpacked: Path | None = None
        self._bytes = self._packed_bytes = 0

    def open(self, path: str) -> dict[str, dict[str, Any]]:
        """Open a CDF, which may be a .cdf.gz; returns its variables, with type and number of records of each."""
        self.close()
        plain, head = path, _head(path)
        for _ in range(MOST_PACKED):
            if head.startswith(GZIP):
                unpacked = _unpacked(plain, b"", 0)
            elif head.startswith(COMPRESSED) and head.endswith(GZIP):  # cdflib unpacks the other kind, run lengths
                unpacked = _unpacked(plain, UNCOMPRESSED, CCR_BYTES)
            else:
                break
            self.close()
            self._unpacked, plain = unpacked, str(unpacked)
            head = _head(plain)
        if self._unpacked is not None and not _is_cdf(plain):
            raise ValueError("what is packed in it is no CDF")
        _check_length(plain)
        self._bytes = Path(plain).stat().st_size
        self._packed_bytes = GZIP_FACTOR * self._bytes
        if head.startswith(COMPRESSED):
            self._bytes = self._packed_bytes
        self._cdf = cdflib.CDF(plain)
        contents = self._cdf.cdf_info()
        return {name: self._described(name) for name in (*contents.zVariables, *contents.rVariables)}

    def close(self) -> None:
        """Close the CDF that was open, if any."""
        self._cdf = None
        if self._unpacked is not None:
            self._unpacked.unlink(missing_ok=True)
            self._unpacked = None

    def _described(self, variable: str) -> dict[str, Any]:
        try:
            found = self._cdf.varinq(variable)
            self._check_claim(found)
        except Exception as error:  # noqa: BLE001 - the others may be whole
            return {"kind": 0, "records": 0, "varies": 0, "sparse": 0, "fault": str(error)[:160]}
        sparse = ("no_sparse", "pad_sparse", "prev_sparse").index(str(found.Sparse).lower())
        records, varies = int(found.Last_Rec) + 1, int(bool(found.Rec_Vary))
        return {"kind": int(found.Data_Type), "records": records, "varies": varies, "sparse": sparse, "fault": ""}

    def _check_claim(self, found: Any) -> None:
        """Hold how many values a variable claims against what the file can hold, a byte each."""
        count = (int(found.Last_Rec) + 1 if found.Rec_Vary else 1) * math.prod(int(size) for size in found.Dim_Sizes)
        is_all_stored = not found.Compress and str(found.Sparse).lower() == "no_sparse"
        held = ROOM_BYTES + (self._bytes if is_all_stored else self._packed_bytes)
        if count > min(held, MOST_VALUES):
            raise ValueError(f"it claims {count} values")

    def attribute(self, name: str, variable: str | None) -> str | float | None:
        """Attribute of a variable, or of the file; None where there is none, or no single value."""
        try:
            value = self._cdf.attget(name, 0 if variable is None else variable).Data
        except (KeyError, ValueError):
            return None
        value = value.item() if isinstance(value, np.ndarray | np.generic) and np.size(value) == 1 else value
        if isinstance(value, str | int | float):
            return value
        return " ".join(map(str, np.ravel(value)[:64])) if isinstance(value, list | np.ndarray) else None

    def values(self, variable: str) -> np.ndarray:
        """Values of a variable, records first."""
        found = self._cdf.varget(variable)
        values = np.ascontiguousarray(np.asarray(found))
        if values.dtype.kind not in "iufc":
            raise ValueError(f"variable {variable!r} holds no numbers")
        if values.nbytes > LARGEST_BYTES:
            raise ValueError(f"variable {variable!r} holds {values.nbytes} bytes")
        values = values.astype(values.dtype.newbyteorder("="), copy=False)
        description = self._cdf.varinq(variable)
        is_padded = str(description.Sparse).lower() == "pad_sparse" and values.ndim > 1
        return _padded(values, np.ravel(description.Pad)[0]) if is_padded else values


def _padded(values: np.ndarray, pad: Any) -> np.ndarray:
    """Records that are not stored as what stands for them: cdflib writes a zero behind each."""
    rows = values.reshape(len(values), -1)
    wrong = np.zeros(rows.shape[1], dtype=values.dtype)
    wrong[::2] = pad
    rows[(rows == wrong).all(axis=1)] = pad
    return values


def _head(path: str) -> bytes:
    with Path(path).open("rb") as stream:
        return stream.read(CCR_BYTES + 2)


def _is_cdf(path: str) -> bool:
    return _head(path)[:4] in {UNCOMPRESSED[:4], *(head[:4] for head in VERSION_2)}


def _unpacked(path: str, head: bytes, begin: int) -> Path:
    """What is packed with gzip from a byte on, behind a new head, in a temporary place."""
    handle, name = tempfile.mkstemp(suffix=".cdf")
    try:
        with os.fdopen(handle, "wb") as plain:
            plain.write(head)
            for piece in _pieces(path, begin):
                plain.write(piece)
    except Exception:
        Path(name).unlink(missing_ok=True)
        raise
    return Path(name)


def _pieces(path: str, begin: int) -> Iterator[bytes]:
    """What is packed with gzip from a byte on, piece by piece."""
    inflater, size, rest = zlib.decompressobj(wbits=zlib.MAX_WBITS | 32), 0, b""
    with Path(path).open("rb") as stream:
        stream.seek(begin)
        while not inflater.eof:
            packed = inflater.unconsumed_tail or rest or stream.read(PIECE_BYTES)
            rest = b""
            if not packed:
                raise ValueError("what it holds is cut short")
            piece = inflater.decompress(packed, PIECE_BYTES)
            size += len(piece)
            if size > LARGEST_BYTES:
                raise ValueError(f"it unpacks to more than {LARGEST_BYTES >> 20} MiB")
            yield piece
            if inflater.eof and begin == 0:  # a file may be packed in parts, one behind the other
                rest = inflater.unused_data or stream.read(PIECE_BYTES)
                inflater = zlib.decompressobj(wbits=zlib.MAX_WBITS | 32) if rest.startswith(GZIP) else inflater


def _check_length(path: str) -> None:
    """Hold what an uncompressed CDF states of its length (CDF Internal Format Description, GDR) against the file's."""
    size = Path(path).stat().st_size
    with Path(path).open("rb") as stream:
        head = stream.read(28)
        if len(head) < 28 or head[4:8] != UNPACKED:
            return
        is_old = head[:4] in VERSION_2
        (place,) = struct.unpack_from(">i", head, 16) if is_old else struct.unpack_from(">q", head, 20)
        if not 0 <= place < size:
            raise ValueError(f"it ends early: a record is at byte {place} of {size}")
        stream.seek(place)
        general = stream.read(24 if is_old else 44)
    width, begin = (4, 8) if is_old else (8, 12)
    places = [int.from_bytes(general[begin + n * width : begin + (n + 1) * width], "big") for n in range(4)]
    if max(places) > size:  # the first variables and attributes, and the end of the file
        raise ValueError(f"it ends early: {size} of {max(places)} bytes")


def probe(path: str) -> None:
    """Read every attribute, dimension and value of an HDF5 file."""
    import h5py  # noqa: PLC0415 - takes 0.1 s, and few files need it

    def read(name: str, item: Any) -> None:
        for attribute in item.attrs:
            item.attrs.get(attribute)
        if not isinstance(item, h5py.Dataset):
            return
        chunk = int(item.dtype.itemsize)
        for length in item.chunks or (0,):
            chunk *= int(length)
        claimed = max(item.nbytes, chunk)
        if claimed > LARGEST_PROBED_BYTES:
            raise ValueError(f"variable {name!r} claims {claimed} bytes")
        for dimension in item.dims:
            len(dimension)
        if item.shape is not None:
            item[()]

    with h5py.File(path, "r") as file:
        read("/", file)
        file.visititems(read)


class ZarrReader:
    """One open Zarr store at a time."""

    def __init__(self) -> None:
        self._path = ""
        self._groups: dict[str, Any] = {}

    def groups(self, path: str) -> dict[str, Any]:
        """Attributes and variables of each group by its path, the root as an empty one."""
        import xarray as xr  # noqa: PLC0415 - takes 0.5 s, and few files need it

        tree = xr.open_datatree(path, engine="zarr", consolidated=False, decode_cf=False)
        self._path = path
        self._groups = {group.path.rstrip("/"): group.to_dataset(inherit=False) for group in tree.subtree}
        return {
            name: {
                "attrs": _plain(group.attrs),
                "variables": {key: self._described(variable) for key, variable in group.variables.items()},
            }
            for name, group in self._groups.items()
        }

    def values(self, path: str, group: str, name: str) -> np.ndarray | list[str]:
        """All values of a variable; text as a list, and truth and times as whole numbers."""
        if path != self._path:
            self.groups(path)
        variable = self._groups[group].variables[name]
        described = self._described(variable)
        claimed = max(variable.nbytes, variable.dtype.itemsize * math.prod(described["chunks"] or [0]))
        if claimed > LARGEST_PROBED_BYTES:
            raise ValueError(f"variable {name!r} claims {claimed} bytes")
        values = variable.to_numpy()
        if described["dtype"] == "O":
            texts = [one.decode("latin-1") if isinstance(one, bytes) else str(one) for one in values.ravel()]
            if sum(map(len, texts)) > LARGEST_PROBED_BYTES:
                raise ValueError(f"variable {name!r} holds too much text")
            return texts
        values = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("="))
        return values.view({"b": "u1", "M": "i8", "m": "i8"}.get(values.dtype.kind, values.dtype))

    def _described(self, variable: Any) -> dict[str, Any]:
        dtype = variable.dtype.newbyteorder("=").str if variable.dtype.kind in "iufcbMm" else "O"
        chunks = variable.encoding.get("shards") or variable.encoding.get("chunks") or ()
        return {
            "dims": list(map(str, variable.dims)),
            "shape": list(variable.shape),
            "dtype": dtype,
            "chunks": [int(size) for size in chunks],
            "attrs": _plain(variable.attrs),
        }


def _plain(attributes: dict[Any, Any]) -> dict[str, Any]:
    """Attributes as JSON has them."""
    return {
        str(name): value.tolist() if isinstance(value, np.ndarray | np.generic) else value
        for name, value in attributes.items()
    }


def answers() -> Iterator[tuple[dict[str, Any], bytes | memoryview]]:
    """Answer to each request on the standard input."""
    reader, stores = Reader(), ZarrReader()
    does: dict[str, Callable[..., Any]] = {
        "open": reader.open,
        "close": reader.close,
        "attribute": reader.attribute,
        "values": reader.values,
        "probe": probe,
        "zarr_groups": stores.groups,
        "zarr_values": stores.values,
    }
    for line in sys.stdin.buffer:
        request = json.loads(line)
        signal.setitimer(signal.ITIMER_PROF, request["cpu_s"])  # of the processor; ends the process
        try:
            with np.errstate(all="ignore"):
                value = does[request["do"]](*request["of"])
        except MemoryError:
            yield {"error": f"it claims more than {MEMORY_BYTES >> 30} GiB"}, b""
        except Exception as error:  # noqa: BLE001 - whatever it is, it is the reason
            reason = " ".join(str(error).split())[:160] or type(error).__name__
            yield {"error": reason, "kind": type(error).__name__}, b""
        else:
            if isinstance(value, np.ndarray):
                yield {"dtype": value.dtype.str, "shape": value.shape}, value.data if value.size else b""
            else:
                yield {"value": value}, b""


def _limit(kind: int, most: int) -> None:
    """Limit what this process may use; not every system has every limit."""
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(kind, (most, resource.getrlimit(kind)[1]))


if __name__ == "__main__":
    _limit(resource.RLIMIT_CORE, 0)
    _limit(resource.RLIMIT_AS, MEMORY_BYTES)
    out, sys.stdout = sys.stdout.buffer, sys.stderr  # what a library prints must not be taken for an answer
    for head, body in answers():
        out.write(json.dumps(head).encode() + b"\n")
        out.write(body)
        out.flush()

"""Reads an HDF5 file from end to end and keeps nothing: a script, run in a process of its own.

The HDF5 library can run in a circle, or crash, on a file whose metadata are damaged, and nothing in Python can stop it
then. Here it may do so: the process has little time and memory, and its end tells whether the file can be read.
"""

import contextlib
import resource
import sys

import h5py

MEMORY_BYTES = 3 << 30
LARGEST_BYTES = 256 << 20


def probe(path: str) -> None:
    """Read every attribute, dimension and value of a file.

    Parameters
    ----------
    path : str
        HDF5 file.

    Raises
    ------
    ValueError
        If a variable claims more than can be.
    OSError, KeyError, RuntimeError
        If the library finds the file damaged.
    """
    with h5py.File(path, "r") as file:
        _read("/", file)
        file.visititems(_read)


def _read(name: str, item: h5py.HLObject) -> None:
    for attribute in item.attrs:
        item.attrs.get(attribute)
    if not isinstance(item, h5py.Dataset):
        return
    claimed = max(item.nbytes, _chunk_bytes(item))
    if claimed > LARGEST_BYTES:
        raise ValueError(f"variable {name!r} claims {claimed} bytes")
    for dimension in item.dims:
        len(dimension)
    if item.shape is not None:
        item[()]


def _chunk_bytes(item: h5py.Dataset) -> int:
    size = int(item.dtype.itemsize)
    for length in item.chunks or (0,):
        size *= int(length)
    return size


def _limit(kind: int, most: int) -> None:
    """Not every system has every limit."""
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(kind, (most, most))


if __name__ == "__main__":
    _limit(resource.RLIMIT_CORE, 0)
    _limit(resource.RLIMIT_CPU, int(sys.argv[2]))
    _limit(resource.RLIMIT_AS, MEMORY_BYTES)
    try:
        probe(sys.argv[1])
    except Exception as error:  # noqa: BLE001 - whatever it is, it is the reason
        sys.exit(" ".join(str(error).split()) or type(error).__name__)

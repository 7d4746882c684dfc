"""Zarr stores of users: what they hold, described and decompressed by the process for damaged files.

The codecs of Zarr believe what a chunk says of its length; in a damaged store they read and write beyond their memory.
"""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core.indexing import ExplicitIndexer, IndexingSupport, LazilyIndexedArray, explicit_indexing_adapter

from bella.containers.bounded import CPU_S_PER_MB, LEAST_CPU_S, READER

MARKS = ("zarr.json", ".zgroup", ".zmetadata")
"""Files of which a Zarr store has at least one."""

DESCRIPTIONS = (*MARKS, ".zarray", ".zattrs")
DESCRIPTION_BYTES, STORED_FILES = 1 << 20, 100_000
"""Most that a day of spectra needs: bytes of one description, and files."""


def is_zarr(path: Path) -> bool:
    """Whether a folder is a Zarr store."""
    return path.is_dir() and any((path / mark).is_file() for mark in MARKS)


def zarr_groups(path: Path) -> dict[str, xr.Dataset]:
    """Groups of a Zarr store by their path, the root as an empty one; values are read when they are asked for.

    Parameters
    ----------
    path : pathlib.Path
        Folder of the store.

    Raises
    ------
    ValueError
        If a description is too large, the store has too many files, or it cannot be read in bounded time and memory;
        when values are asked for, too.
    """
    cpu_s = LEAST_CPU_S + CPU_S_PER_MB * _checked_bytes(path) / 1e6
    groups = READER.ask("zarr_groups", str(path.absolute()), cpu_s=cpu_s)
    return {name: xr.decode_cf(_described(path, name, found, cpu_s)) for name, found in groups.items()}


def _checked_bytes(path: Path) -> int:
    total = 0
    for number, file in enumerate(path.rglob("*")):
        if number > STORED_FILES:
            raise ValueError(f"it has more than {STORED_FILES} files")
        size = file.stat().st_size
        if file.name in DESCRIPTIONS and size > DESCRIPTION_BYTES:
            raise ValueError(f"{file.name} has more than {DESCRIPTION_BYTES >> 20} MiB")
        total += size
    return total


def _described(path: Path, group: str, found: dict[str, Any], cpu_s: float) -> xr.Dataset:
    variables = {}
    for name, one in found["variables"].items():
        stored = LazilyIndexedArray(_Stored(path, group, name, one, cpu_s))
        variables[name] = xr.Variable(one["dims"], stored, one["attrs"], {"chunks": one["chunks"]})
    return xr.Dataset(variables, attrs=found["attrs"])


class _Stored(BackendArray):
    """One array of a store."""

    def __init__(self, path: Path, group: str, name: str, found: dict[str, Any], cpu_s: float) -> None:
        self.shape = tuple(found["shape"])
        self.dtype = np.dtype(found["dtype"])
        self._of = (str(path.absolute()), group, name)
        self._cpu_s = cpu_s

    def __getitem__(self, key: ExplicitIndexer) -> Any:
        return explicit_indexing_adapter(key, self.shape, IndexingSupport.BASIC, self._values)

    def _values(self, key: tuple[Any, ...]) -> Any:
        found = READER.ask("zarr_values", *self._of, cpu_s=self._cpu_s)
        values = np.array(found, dtype=object) if self.dtype.kind == "O" else found.view(self.dtype)
        return values.reshape(self.shape)[key]

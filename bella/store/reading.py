"""Opening a group so that damage is an error: a chunk that is missing or broken never reads as numbers."""

import asyncio
import itertools
import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import xarray as xr
from zarr.core.sync import sync
from zarr.storage import ZipStore

from bella.exceptions import NoDataError, StoreError
from bella.store.digest import content_sha256, datasets_of
from bella.store.layout import inside

FORMAT_VERSION = 1
ROOT = "zarr.json"
"""Metadata of a group, and in the root those of all in it."""

# what is smaller is read at once when a group is opened; draws of many frequencies stay on disk until asked for
_READ_AT_ONCE_BYTES = 2_000_000

Group = TypeVar("Group", xr.Dataset, xr.DataTree)
Result = TypeVar("Result")


def open_group(root: Path, store_path: str, sha256: str | None = None) -> xr.Dataset:
    """Open a posterior read-only.

    Parameters
    ----------
    store_path : str
        Path relative to the root as the catalogue keeps it.
    sha256 : str, optional
        Checksum from the catalogue; with it everything is read and compared.

    Returns
    -------
    xarray.Dataset
        Small variables in memory, large ones read when they are used.

    Raises
    ------
    StoreError
        Where the group is missing, damaged, of a newer format, or outside the root.
    """
    return _open(root, store_path, sha256, _open_dataset)


def open_tree(root: Path, store_path: str, sha256: str | None = None) -> xr.DataTree:
    """Open spectra, one child per observatory, read-only; otherwise like `open_group`.

    Parameters
    ----------
    store_path : str
        Path relative to the root as the catalogue keeps it.
    sha256 : str, optional
        Checksum from the catalogue; with it everything is read and compared.

    Returns
    -------
    xarray.DataTree
        Small variables in memory, large ones read when they are used.

    Raises
    ------
    StoreError
        Where the group is missing, damaged, of a newer format, or outside the root.
    """
    return _open(root, store_path, sha256, _open_datatree)


def file_of_group(root: Path, store_path: str, key: str) -> bytes:
    """One file of a group, for serving it read-only.

    Parameters
    ----------
    store_path : str
        Path of the group as the catalogue keeps it.
    key : str
        Zarr key such as ``zarr.json`` or ``draws/c/0/0/0``.

    Raises
    ------
    NoDataError
        Where there is no such file in the group.
    StoreError
        Where the group is missing or damaged, or outside the root.
    """
    path = _present(root, store_path)

    def _read() -> bytes | None:
        with zipfile.ZipFile(path) as packed:
            return packed.read(key) if key in packed.namelist() else None

    found = _guarded(path, _read)
    if found is None:
        raise NoDataError(f"there is no {key!r} in {store_path}: begin with its zarr.json")
    return found


def read_everything(path: Path, *, tree: bool) -> xr.Dataset | xr.DataTree:
    """Read all of a group, staged or placed, from disk.

    Parameters
    ----------
    path : Path
        ZIP file of the group.
    tree : bool
        True for a tree, False for a single dataset.

    Returns
    -------
    xarray.Dataset or xarray.DataTree
        All variables in memory.

    Raises
    ------
    StoreError
        Where anything is missing or damaged, or the format is newer.
    """
    if tree:
        return _guarded(path, lambda: _checked(path, _open_datatree).load())
    return _guarded(path, lambda: _checked(path, _open_dataset).load())


def _open(root: Path, store_path: str, sha256: str | None, opener: Callable[[Path], Group]) -> Group:
    path = _present(root, store_path)

    def _opened() -> Group:
        group = _checked(path, opener)
        return group.load() if sha256 else _small_loaded(group)

    group = _guarded(path, _opened)
    if sha256 and content_sha256(group) != sha256:
        raise StoreError(f"{store_path} does not match its checksum in the catalogue: restore it from a backup")
    return group


def _present(root: Path, store_path: str) -> Path:
    path = inside(root, store_path)
    if not path.is_file():
        raise StoreError(
            f"{store_path} is not in the store {root}: restore it from a backup or localise the burst anew"
        )
    return path


def _guarded(path: Path, read: Callable[[], Result]) -> Result:
    """Result of a read; whatever zarr, its codecs or the disk raise over a damaged group is one StoreError."""
    try:
        return read()
    except StoreError:
        raise
    # the codecs raise RuntimeError, ValueError, KeyError, EOFError and more, depending on where a byte is off
    except Exception as error:
        cause = str(error).partition("\n")[0]
        raise StoreError(f"{path.name} is damaged ({cause}): restore it from a backup or localise anew") from error


def _open_dataset(path: Path) -> xr.Dataset:
    return xr.open_dataset(_store(path), engine="zarr", chunks=None, zarr_format=3, consolidated=True)


def _open_datatree(path: Path) -> xr.DataTree:
    return xr.open_datatree(_store(path), engine="zarr", chunks=None, zarr_format=3, consolidated=True)


def _store(path: Path) -> Any:  # xarray takes stores of zarr, and its types do not say so
    return ZipStore(path, mode="r")


def _checked(path: Path, opener: Callable[[Path], Group]) -> Group:
    """Opened group, after its versions and the presence of each of its chunks were checked."""
    with zipfile.ZipFile(path) as packed:
        sizes = {one.filename: one.file_size for one in packed.infolist()}
        text = packed.read(ROOT)
    metadata = json.loads(text)
    _refuse_unknown_format(path, metadata)
    for name, node in metadata["consolidated_metadata"]["metadata"].items():
        if node["node_type"] == "array":
            _refuse_missing_chunks(path, name, node, sizes)
    return opener(path)


def _refuse_unknown_format(path: Path, metadata: dict[str, Any]) -> None:
    version = metadata.get("attributes", {}).get("format_version", FORMAT_VERSION)
    if metadata["zarr_format"] != 3 or not isinstance(version, int) or version > FORMAT_VERSION:
        raise StoreError(
            f"{path.name} has format {version} of Zarr {metadata['zarr_format']}, "
            f"this version reads up to {FORMAT_VERSION} of Zarr 3: upgrade bella-service"
        )


def _refuse_missing_chunks(path: Path, name: str, array: dict[str, Any], present: Mapping[str, int]) -> None:
    """Zarr reads a missing file as the fill value; and an empty shard too; here each has content, so that is damage."""
    sizes = array["chunk_grid"]["configuration"]["chunk_shape"]
    counts = [-(-length // size) for length, size in zip(array["shape"], sizes, strict=True)]
    for index in itertools.product(*map(range, counts)):
        key = "/".join(map(str, (name, "c", *index)))
        if not present.get(key):
            raise StoreError(f"{path.name} lacks {key}: restore it from a backup or localise the burst anew")


def _small_loaded(group: Group) -> Group:
    """Group with its small variables in memory; one value of each large one is read, which a truncated file fails."""
    small = []
    for _, dataset in datasets_of(group):
        for variable in dataset.variables.values():
            if variable.nbytes <= _READ_AT_ONCE_BYTES:
                small.append(variable)
            else:
                np.asarray(variable[(0,) * variable.ndim])
    sync(_loaded(small))
    return group


async def _loaded(variables: Sequence[xr.Variable]) -> None:
    """Read variables side by side: each alone waits for a thread."""
    await asyncio.gather(*(one.load_async() for one in variables))

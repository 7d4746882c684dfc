"""Dynamic spectra in netCDF and Zarr, opened only once it is known that they can be read and how large they are."""

import math
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import xarray as xr

from bella.exceptions import InputError
from bella.spectra.bounded import INFLATED_BYTES, reading
from bella.spectra.dynamic_spectrum import validate_spectrum

ZARR_MARKS = ("zarr.json", ".zgroup", ".zmetadata")
ZARR_METADATA = (*ZARR_MARKS, ".zarray", ".zattrs")
METADATA_BYTES, STORED_FILES = 1 << 20, 100_000
"""Largest description of a Zarr group, and most files in a store; a day has a few kilobytes in a few dozen."""

PROBE = Path(__file__).with_name("hdf5_probe.py")
PROBE_CPU_S, PROBE_S = 5, 60.0
"""Longest that a file may be looked at, s of the processor and of wall clock."""


def open_cf(path: Path, engine: str) -> tuple[xr.Dataset, ...]:
    """Every dynamic spectrum of a netCDF file or Zarr store.

    Parameters
    ----------
    path : pathlib.Path
        File or store.
    engine : str
        h5netcdf, scipy or zarr.

    Returns
    -------
    tuple of xarray.Dataset
        In memory, one for each group that has a variable ``intensity``.

    Raises
    ------
    InputError
        If it is damaged, too large, or holds no dynamic spectrum.
    """
    with reading(str(path), "netCDF or Zarr"):
        if engine == "h5netcdf":
            check_hdf5(path)
        elif engine == "zarr":
            check_zarr(path)
        with _groups(path, engine) as groups:
            chosen = {name: group for name, group in groups.items() if "intensity" in group.data_vars}
            if not chosen:
                raise InputError(f"{path} is not a dynamic spectrum: add the variable 'intensity'")
            if _claimed_bytes(list(chosen.values())) > INFLATED_BYTES:
                raise InputError(f"{path} holds more than {INFLATED_BYTES >> 20} MiB: divide it into days")
            return tuple(_loaded(group, f"{path}{name}") for name, group in chosen.items())


def check_hdf5(path: Path, cpu_s: int = PROBE_CPU_S) -> None:
    """Read a file in a process of its own, where the HDF5 library may hang or crash without harm.

    Parameters
    ----------
    path : pathlib.Path
        HDF5 file.
    cpu_s : int
        Longest it may take, s of the processor.

    Raises
    ------
    ValueError
        If it cannot be read, or not in bounded time and memory.
    """
    command = [sys.executable, "-I", os.fspath(PROBE), os.fspath(path.absolute()), str(cpu_s)]
    try:
        done = subprocess.run(  # noqa: S603 - see above
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=PROBE_S, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise ValueError(f"reading it does not end within {PROBE_S:.0f} s") from error
    if done.returncode < 0:
        raise ValueError(f"the HDF5 library hangs or crashes on it, signal {-done.returncode}")
    if done.returncode:
        raise ValueError(done.stderr.decode(errors="replace").strip().rsplit("\n", 1)[-1])


def check_zarr(path: Path) -> None:
    """Hold the descriptions of a store against what a day of spectra can have.

    Parameters
    ----------
    path : pathlib.Path
        Folder of the store.

    Raises
    ------
    ValueError
        If one is too large, or the store has too many files.
    """
    for number, file in enumerate(path.rglob("*")):
        if number > STORED_FILES:
            raise ValueError(f"it has more than {STORED_FILES} files")
        if file.name in ZARR_METADATA and file.stat().st_size > METADATA_BYTES:
            raise ValueError(f"{file.name} has more than {METADATA_BYTES >> 20} MiB")


@contextmanager
def _groups(path: Path, engine: str) -> Iterator[dict[str, xr.Dataset]]:
    """Groups by their path, the root as an empty one; nothing is loaded yet."""
    if engine == "scipy":  # netCDF 3 has no groups
        with xr.open_dataset(path, engine="scipy") as only:
            yield {"": only}
        return
    with xr.open_datatree(path, engine=engine) as tree:
        yield {node.path.rstrip("/"): node.to_dataset(inherit=False) for node in tree.subtree}


def _claimed_bytes(groups: Sequence[xr.Dataset]) -> int:
    """What all groups take together, or the largest chunk of any of their variables if that takes more."""
    variables = [variable for group in groups for variable in group.variables.values()]
    return max(sum(group.nbytes for group in groups), *(_chunk_bytes(variable) for variable in variables))


def _chunk_bytes(variable: xr.Variable) -> int:
    stored = [variable.encoding.get(name) for name in ("chunks", "shards", "chunksizes")]
    return int(variable.dtype.itemsize) * max(math.prod(int(size) for size in sizes or ()) for sizes in stored)


def _loaded(stored: xr.Dataset, source: str) -> xr.Dataset:
    spectrum = validate_spectrum(stored.load(), source)
    return spectrum.assign(intensity=spectrum["intensity"].astype(np.float32, keep_attrs=True))

"""Dynamic spectra of any instrument: netCDF and Zarr, spectrograms of radiospectra, and those of the built-in event.

Files are opened only once it is known that they can be read and how large they are.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from bella.exceptions import InputError, require_extra
from bella.records import Origin
from bella.spacecraft import observatory_name
from bella.spectra.assembly import Origin as Measured
from bella.spectra.assembly import assemble, cadence_s
from bella.spectra.bounded import INFLATED_BYTES, LEAST_CPU_S, READER, reading
from bella.spectra.dynamic_spectrum import POSITION, validate_spectrum

if TYPE_CHECKING:
    from radiospectra.spectrogram import GenericSpectrogram

ZARR_MARKS = ("zarr.json", ".zgroup", ".zmetadata")
ZARR_METADATA = (*ZARR_MARKS, ".zarray", ".zattrs")
METADATA_BYTES, STORED_FILES = 1 << 20, 100_000
"""Largest description of a Zarr group, and most files in a store; a day has a few kilobytes in a few dozen."""

EVENT = "event_2012-06-07.nc"


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
            require_extra("zarr")
            check_zarr(path)
        with _groups(path, engine) as groups:
            chosen = {name: group for name, group in groups.items() if "intensity" in group.data_vars}
            if not chosen:
                raise InputError(f"{path} is not a dynamic spectrum: add the variable 'intensity'")
            if _claimed_bytes(list(chosen.values())) > INFLATED_BYTES:
                raise InputError(f"{path} holds more than {INFLATED_BYTES >> 20} MiB: divide it into days")
            return tuple(_loaded(group, f"{path}{name}", path) for name, group in chosen.items())


def check_hdf5(path: Path, cpu_s: int = LEAST_CPU_S) -> None:
    """Read a file in the process for damaged files, where the HDF5 library may hang or crash without harm.

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
    READER.ask("probe", str(path.absolute()), cpu_s=cpu_s)


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


def _loaded(stored: xr.Dataset, source: str, path: Path) -> xr.Dataset:
    """The spectrum of a group with what can be filled in; of a spacecraft by the name it has here."""
    spectrum = stored.load()
    given = spectrum.attrs
    if str(given.get("observatory", "")).strip():
        given["observatory"] = observatory_name(str(given["observatory"]))
    given.setdefault("source_files", [path.name])
    given.setdefault("origin", Origin.USER.value)
    if given["origin"] not in set(Origin):
        raise InputError(f"{source}: attribute 'origin' is {given['origin']!r}: use user, or leave it out")
    if "time" in spectrum.coords and np.issubdtype(spectrum["time"].dtype, np.datetime64):
        given.setdefault("integration_s", cadence_s(spectrum["time"].to_numpy().ravel()))
    if POSITION in spectrum and spectrum[POSITION].dims == ("axis",) and "time" in spectrum.sizes:
        everywhere = spectrum[POSITION].expand_dims(time=spectrum.sizes["time"]).transpose("time", "axis")
        spectrum[POSITION] = everywhere.copy()
    spectrum = validate_spectrum(spectrum, source)
    return spectrum.assign(intensity=spectrum["intensity"].astype(np.float32, keep_attrs=True))


def from_radiospectra(
    spectrogram: "GenericSpectrogram", quantity: str, receiver: str = "", observatory: str = ""
) -> xr.Dataset:
    """A dynamic spectrum from a spectrogram of radiospectra, which also reads e-CALLISTO and other files.

    Parameters
    ----------
    spectrogram : radiospectra.spectrogram.GenericSpectrogram
        With its times and frequencies; its data may have either axis first.
    quantity : str
        What its values are, one of ``QUANTITIES``: radiospectra does not state it.
    receiver, observatory : str, optional
        In place of its own ``detector`` and ``observatory``.

    Returns
    -------
    xarray.Dataset
        Of origin ``user``.

    Raises
    ------
    InputError
        If data, times and frequencies do not fit together.
    """
    meta, values = spectrogram.meta, np.asarray(spectrogram.data, dtype=np.float32)
    name = str(observatory or meta["observatory"])
    times = np.asarray(spectrogram.times.utc.to_value("datetime64")).astype("datetime64[ns]")
    frequency_mhz = np.asarray(spectrogram.frequencies.to_value("MHz"), dtype=np.float64)
    if values.shape == (frequency_mhz.size, times.size):
        values = values.T
    measured = Measured(
        observatory_name(name), str(receiver or meta.get("detector") or meta.get("instrument", "")), quantity, name
    )
    sources = [str(meta["filename"])] if meta.get("filename") else []
    return assemble(measured, times, frequency_mhz, values).assign_attrs(
        origin=Origin.USER.value, source_files=sources or [f"spectrogram of {name}"]
    )


def to_radiospectra(spectrum: xr.Dataset) -> "GenericSpectrogram":
    """A spectrogram of radiospectra from a dynamic spectrum; needs the extra ``radiospectra``.

    Parameters
    ----------
    spectrum : xarray.Dataset
        A dynamic spectrum.

    Returns
    -------
    radiospectra.spectrogram.GenericSpectrogram
        Data of shape (frequency, time). Sample times and what else stands beside the intensity have no place in it.

    Raises
    ------
    MissingExtraError
        If radiospectra is not installed.
    """
    require_extra("radiospectra")
    import astropy.units as u  # noqa: PLC0415 - heavy, and few need it
    from astropy.time import Time  # noqa: PLC0415
    from radiospectra.spectrogram import GenericSpectrogram  # noqa: PLC0415
    from sunpy.net import attrs as a  # noqa: PLC0415

    times = Time(spectrum["time"].to_numpy(), scale="utc")
    frequency = spectrum["frequency"].to_numpy() * u.MHz
    meta: dict[str, Any] = {
        "observatory": spectrum.attrs["observatory"],
        "instrument": spectrum.attrs["observatory"],
        "detector": spectrum.attrs["receiver"],
        "start_time": times[0],
        "end_time": times[-1],
        "wavelength": a.Wavelength(frequency[0], frequency[-1]),
        "times": times,
        "freqs": frequency,
        "filename": ", ".join(str(name) for name in np.atleast_1d(spectrum.attrs["source_files"])),
        "quantity": spectrum.attrs["quantity"],
    }
    return GenericSpectrogram(spectrum["intensity"].transpose("frequency", "time").to_numpy(), meta=meta)


def event_spectra() -> xr.DataTree:
    """Spectra of the built-in event of 2012-06-07, as seen by Wind, STEREO-A and STEREO-B, read off a published figure.

    The figure belongs to the public notebook TDOA_OpenSource.ipynb (STBadman/Radio-Public,
    doi:10.5281/zenodo.10107890). Its colour map can be inverted exactly, so the values are good to 1/255 and the times
    to 3 s. Each channel is divided by its maximum between 19:25 and 20:30 UT. What Wind shows is a ratio of voltages,
    what STEREO shows a flux (the attribute ``power_exponent`` says so): only the square of Wind's values decays as fast
    as what STEREO shows.

    Returns
    -------
    xarray.DataTree
        Children "WIND", "STEREO-A" and "STEREO-B", each a dynamic spectrum in memory, quantity ``relative_flux``.
    """
    with (
        resources.as_file(resources.files("bella.spectra") / EVENT) as path,
        xr.open_datatree(path, engine="h5netcdf") as stored,
    ):
        children = {name: child.to_dataset().load() for name, child in stored.children.items()}
        root = stored.to_dataset().load()
    spectra = {name: _spectrum(child, f"{EVENT}/{name}") for name, child in children.items()}
    return xr.DataTree.from_dict({"/": root, **spectra})


def _spectrum(stored: xr.Dataset, source: str) -> xr.Dataset:
    stored.attrs["origin"] = Origin.EVENT.value
    return validate_spectrum(stored.assign(intensity=stored["intensity"].astype(np.float32, keep_attrs=True)), source)

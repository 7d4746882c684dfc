"""Opening a file of spectra, whichever product it is of."""

from pathlib import Path

import xarray as xr

from bella.exceptions import InputError
from bella.records import Origin
from bella.spectra.cdf import MAGIC, CdfFile, open_cdf
from bella.spectra.cf_files import ZARR_MARKS, open_cf
from bella.spectra.products import Product, Spectra, find_product

HDF5, NETCDF3, IDL = b"\x89HDF", b"CDF", b"SR\x00"
ORIGIN_ATTRIBUTE = "Data_origin"
"""Global attribute of a CDF that was not measured: `simulated`, `test`."""
CONTAINERS = {"cdf": "a CDF", "idl": "an IDL save set", "binary": "a binary", "text": "a table", "cf": "netCDF"}


def open_spectra(path: str | Path) -> Spectra:
    """Read every dynamic spectrum of a file.

    The product is recognised from the name of the file and from what it holds; where the two disagree the file is
    refused. A file of any other instrument can be read if it is netCDF or Zarr in the form of a dynamic spectrum
    (:mod:`bella.spectra.dynamic_spectrum`), one spectrum at the root or one in each group.

    Parameters
    ----------
    path : str or pathlib.Path
        File of an archive, netCDF file or Zarr group.

    Returns
    -------
    tuple of xarray.Dataset
        Dynamic spectra in memory, one per spacecraft and receiver.

    Raises
    ------
    InputError
        If there is no such file, or if it is damaged, of no known product or not what its name says.
    """
    path = Path(path)
    if path.is_dir() and any((path / mark).is_file() for mark in ZARR_MARKS):
        return open_cf(path, "zarr")
    if not path.is_file():
        raise InputError(f"{path} is no file and no Zarr group: check the name")
    head = _head(path)
    if head.lstrip().lower().startswith((b"<!doctype", b"<html", b"<?xml")):
        raise InputError(f"{path} is a web page, not data: the server answered with an error; download it again")
    if head.startswith(MAGIC):
        return _open_archive_cdf(path)
    if head.startswith((HDF5, NETCDF3)):
        return open_cf(path, "h5netcdf" if head.startswith(HDF5) else "scipy")
    return _open_other(path, head)


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            head = stream.read(512)
    except OSError as error:
        raise InputError(f"{path} cannot be opened ({error.strerror}): check who may read it") from error
    if not head:
        raise InputError(f"{path} is empty: download it again")
    return head


def _open_archive_cdf(path: Path) -> Spectra:
    with open_cdf(path) as cdf:
        product, receiver = _product_of(cdf)
        absent = [name for name in product.signature if name not in cdf.variables]
        if absent:
            raise InputError(f"{path} has no variable {absent[0]!r}: it is not {product.name} as its name says")
        if product.read is None:
            raise InputError(f"{path} is CDF, but {product.name} is not")
        return tuple(_with_origin(one, cdf) for one in product.read(cdf, receiver))


def _with_origin(spectrum: xr.Dataset, cdf: CdfFile) -> xr.Dataset:
    """Spectrum with where its file says that it comes from; files of the archives do not say it."""
    stated = cdf.attribute(ORIGIN_ATTRIBUTE)
    if not stated:
        return spectrum
    if stated not in set(Origin):
        raise InputError(f"{cdf.name} says that its origin is {stated[:40]!r}: use one of {', '.join(Origin)}")
    return spectrum.assign_attrs(origin=stated)


def _product_of(cdf: CdfFile) -> tuple[Product, str]:
    """Product by content where the file says so itself, else by its name."""
    named = find_product(cdf.name)
    stated = [cdf.attribute(name) for name in ("Logical_file_id", "Logical_source")]
    holds = next((found for found in map(find_product, stated) if found), None)
    if named and holds and named != holds:
        raise InputError(f"{cdf.name} is named after {named[0].name}, but holds {holds[0].name} {holds[1]}".rstrip())
    found = holds or named
    if found is None or found[0].container != "cdf":
        raise InputError(
            f"{cdf.name} ({next(filter(None, stated), 'no identity')}) is of no known product: see 'bella formats'"
        )
    return found


def _open_other(path: Path, head: bytes) -> Spectra:
    found = find_product(path.name)
    if found is None or found[0].read is None:
        raise InputError(f"{path} is of no known product: see 'bella formats' for names and forms that can be read")
    product, receiver = found
    if product.container == "cdf" or (product.container == "idl") != head.startswith(IDL):
        raise InputError(f"{path} is named after {product.name}, but is not {CONTAINERS[product.container]}")
    return product.read(path, receiver)  # type: ignore[misc]

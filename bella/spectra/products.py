"""The archive products that can be read, their known quirks, and opening a file of spectra, whichever it is of.

A product is how its files are named, what they hold, and whether its reader was ever run on a file of the archive.
A quirk has its dates, its effect on the data, what the readers do about it, and where it is known from; a spectrum
carries the names of those that apply to it in the attribute ``quirks``, with semicolons between them.
"""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr
from pydantic import Field

from bella.containers import ANOTHER, MAGIC, CdfFile, is_zarr, open_cdf
from bella.exceptions import InputError
from bella.records import Origin, Record
from bella.spectra import psp, solo, stereo, wind
from bella.spectra.assembly import dates_in
from bella.spectra.cf_files import open_cf
from bella.spectra.positions import with_stated_positions

Spectra = tuple[xr.Dataset, ...]

HDF5, NETCDF3, IDL, GZIP, FITS = b"\x89HDF", b"CDF", b"SR\x00", b"\x1f\x8b", b"SIMPLE  ="
PACKERS = {
    GZIP: ("gzip", "gunzip"),
    b"PK\x03\x04": ("zip", "unzip"),
    b"BZh": ("bzip2", "bunzip2"),
    b"\xfd7zXZ": ("xz", "unxz"),
    b"\x28\xb5\x2f\xfd": ("zstd", "unzstd"),
}
"""What a file is packed with, and what unpacks it, by its first bytes."""

NUMPY = (".npy", ".npz")
CONTAINERS = {"cdf": "a CDF", "idl": "an IDL save set", "binary": "a binary", "text": "a table", "cf": "netCDF"}
ORIGIN_ATTRIBUTE = "Bella_origin"
"""Attribute of a CDF that was not measured: files that `bella simulate` writes say ``simulated`` in it."""

QUIRKS = "quirks.json"
NEAR_DAY = np.timedelta64(1, "D")
"""A file may reach so far into the days around that of its name: those of Wind L2 begin on the evening before."""


@dataclass(frozen=True)
class Product:
    """An archive product.

    Attributes
    ----------
    name : str
        Name of the product.
    mission : str
        Whose it is.
    naming : str
        How its files are named.
    cadence : str
        Time between records.
    quantity : str
        What ``intensity`` is, one of ``QUANTITIES``.
    verified : bool
        Whether the reader was ever run on a file of the archive, and not only on files written for its tests.
    container : str
        cdf, binary, idl, text or cf (netCDF and Zarr).
    regex : str
        What the names of its files begin with, lower case; groups are the receiver.
    signature : tuple of str
        Variables without which a CDF is not of this product.
    read : callable
        Reader, of the open CDF or the path, and the receiver.
    """

    name: str
    mission: str
    naming: str
    cadence: str
    quantity: str
    verified: bool
    container: Literal["cdf", "binary", "idl", "text", "cf"]
    regex: str
    signature: tuple[str, ...]
    read: Callable[[Any, str], Spectra] | None

    def receiver_of(self, identity: str) -> str | None:
        """Receiver that a name or logical identity states, "" if the product has one file for all, None if no match."""
        found = re.match(self.regex, identity.lower()) if self.regex else None
        return "_".join(group for group in found.groups() if group) if found else None


PRODUCTS = (
    Product(
        "Wind/WAVES H1",
        "Wind",
        "wi_h1_wav_YYYYMMDD_vNN.cdf",
        "60 s",
        "voltage_ratio",
        True,
        "cdf",
        r"wi_h1_wav",
        (),
        wind.read_h1,
    ),
    Product(
        "Wind/WAVES L2",
        "Wind",
        "wi_l2_wav_{rad1,rad2,tnr}_YYYYMMDD_vNN.cdf",
        "16 s",
        "psd_v2_hz",
        False,
        "cdf",
        r"wi_l2_wav_(rad1|rad2|tnr)",
        ("FREQUENCY",),
        wind.read_l2,
    ),
    Product(
        "Wind/WAVES K0",
        "Wind",
        "wi_k0_wav_YYYYMMDD_vNN.cdf",
        "180 s",
        "db_over_background",
        False,
        "cdf",
        r"wi_k0_wav",
        ("E_Average",),
        wind.read_k0,
    ),
    Product(
        "Wind/WAVES RAD1 L3 DF",
        "Wind",
        "wi_wa_rad1_l3_df_YYYYMMDD_vNN.cdf",
        "46 s",
        "flux_w_m2_hz",
        True,
        "cdf",
        r"wi_wav?_(rad1)_l3_df",
        ("FREQUENCY", "STOKES_I"),
        wind.read_l3_directions,
    ),
    Product(
        "Wind/WAVES 60 s",
        "Wind",
        "wi_wa_{rad1,rad2,tnr}_l2_60s_YYYYMMDD_vNN.dat",
        "60 s",
        "psd_v2_hz",
        False,
        "binary",
        r"wi(?:_wa|n)_(rad1|rad2|tnr)_(?:l2_)?60s_",
        (),
        wind.read_60s,
    ),
    Product(
        "Wind/WAVES IDL",
        "Wind",
        "wind_waves_{rad1,rad2}_YYYYMMDD.{R1,R2}",
        "60 s",
        "voltage_ratio",
        False,
        "idl",
        r"(?:wind_waves_rad1_)?\d{8}\.(r1)$|(?:wind_waves_rad2_)?\d{8}\.(r2)$",
        (),
        wind.read_idl,
    ),
    Product(
        "STEREO/WAVES level 2",
        "STEREO",
        "stereo_level2_swaves_YYYYMMDD_vNN.cdf",
        "60 s",
        "db_over_background",
        True,
        "cdf",
        r"stereo_level2_swaves",
        ("frequency",),
        stereo.read_level2,
    ),
    Product(
        "STEREO/WAVES L3",
        "STEREO",
        "{sta,stb}_l3_wav_{lfr,hfr}_YYYYMMDD_vNN.cdf",
        "15-60 s",
        "flux_w_m2_hz",
        False,
        "cdf",
        r"st([ab])_l3_wav_(lfr|hfr)",
        ("FREQUENCY", "PSD_FLUX"),
        stereo.read_l3,
    ),
    Product(
        "STEREO/WAVES text",
        "STEREO",
        "swaves_average_YYYYMMDD_{a,b}_{lfr,hfr}.dat",
        "60 s",
        "db_over_background",
        False,
        "text",
        r"swaves_average_\d{8}_([ab])_(lfr|hfr)\.",
        (),
        stereo.read_text,
    ),
    Product(
        "STEREO/WAVES text, new name",
        "STEREO",
        "stereo-{a,b}_swaves_{lfr,hfr}_average_YYYYMMDD_vNN.txt",
        "60 s",
        "db_over_background",
        False,
        "text",
        r"stereo-([ab])_swaves_(lfr|hfr)_average_\d{8}",
        (),
        stereo.read_text,
    ),
    Product(
        "PSP FIELDS/RFS L2",
        "PSP",
        "psp_fld_l2_rfs_{lfr,hfr}_YYYYMMDD_vNN.cdf",
        "7-56 s",
        "psd_v2_hz",
        False,
        "cdf",
        r"psp_fld_l2_rfs_(lfr|hfr)",
        (),
        psp.read_l2,
    ),
    Product(
        "PSP FIELDS/RFS L3",
        "PSP",
        "psp_fld_l3_rfs_{lfr,hfr}_YYYYMMDD_vNN.cdf",
        "7-56 s",
        "flux_w_m2_hz",
        False,
        "cdf",
        r"psp_fld_l3_rfs_(lfr|hfr)",
        (),
        psp.read_l3,
    ),
    Product(
        "Solar Orbiter RPW L2 HFR",
        "Solar Orbiter",
        "solo_L2_rpw-hfr-surv_YYYYMMDD_VNN.cdf",
        "sweep",
        "psd_v2_hz",
        False,
        "cdf",
        r"solo_l2_rpw-(hfr)-surv",
        ("FREQUENCY", "SWEEP_NUM"),
        solo.read_l2_hfr,
    ),
    Product(
        "Solar Orbiter RPW L2 TNR",
        "Solar Orbiter",
        "solo_L2_rpw-tnr-surv_YYYYMMDD_VNN.cdf",
        "sweep",
        "psd_v2_hz",
        False,
        "cdf",
        r"solo_l2_rpw-(tnr)-surv",
        ("TNR_BAND", "TNR_BAND_FREQ"),
        solo.read_l2_tnr,
    ),
    Product(
        "Solar Orbiter RPW L3 flux",
        "Solar Orbiter",
        "solo_L3_rpw-{hfr,tnr}-surv-flux_YYYYMMDD_VNN.cdf",
        "sweep",
        "flux_w_m2_hz",
        False,
        "cdf",
        r"solo_l3_rpw-(hfr|tnr)(?:-surv)?-flux",
        ("FREQUENCY", "PSD_FLUX"),
        solo.read_l3,
    ),
    Product(
        "Dynamic spectrum",
        "any",
        "*.nc, *.zarr in the form of a dynamic spectrum",
        "any",
        "any",
        True,
        "cf",
        "",
        (),
        None,
    ),
)
"""Every product that :func:`bella.spectra.open_spectra` reads."""


def find_product(identity: str) -> tuple[Product, str] | None:
    """Product and receiver that a file name or a logical identity stands for.

    Parameters
    ----------
    identity : str
        Such as "sta_l3_wav_hfr_20200711_v01.cdf".

    Returns
    -------
    tuple of Product and str, or None
        None where no product is named so.
    """
    found = ((product, product.receiver_of(identity)) for product in PRODUCTS)
    return next(((product, receiver) for product, receiver in found if receiver is not None), None)


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
    if is_zarr(path):
        return open_cf(path, "zarr")
    if not path.is_file():
        raise InputError(f"{path} is no file and no Zarr group: check the name")
    head = _head(path)
    found = find_product(path.name)
    is_packed_cdf = head.startswith(GZIP) and found is not None and found[0].container == "cdf"
    if head.startswith(MAGIC) or is_packed_cdf:
        return _open_archive_cdf(path)
    _refuse_others(path, head)
    if head.startswith((HDF5, NETCDF3)):
        return open_cf(path, "h5netcdf" if head.startswith(HDF5) else "scipy")
    return _open_other(path, head)


def _refuse_others(path: Path, head: bytes) -> None:
    """Refuse what holds data, but in no form that is read here, with what to do about it."""
    if head.lstrip().lower().startswith((b"<!doctype", b"<html", b"<?xml")):
        raise InputError(f"{path} is a web page, not data: the server answered with an error; download it again")
    if head.startswith(FITS):
        raise InputError(
            f"{path} is FITS: read it with radiospectra and bella.spectra.from_radiospectra (docs/spectra.md)"
        )
    if path.suffix.lower() in NUMPY:
        raise InputError(f"{path} holds arrays of NumPy: write them to netCDF in the form of docs/spectra.md")
    for begins, (name, unpack) in PACKERS.items():
        if head.startswith(begins):
            raise InputError(f"{path} is packed with {name}: unpack it with {unpack}")


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
        absent = [name for name in product.signature if not cdf.stored_name(name)]
        if absent:
            raise InputError(
                f"{path} has no variable {absent[0]!r}: it is not {product.name} as its name says; correct its name or "
                f"{ANOTHER}"
            )
        if product.read is None:
            raise InputError(f"{path} is CDF, but {product.name} is not; correct its name")
        spectra = product.read(cdf, receiver)
        if len({str(one.attrs["observatory"]) for one in spectra}) == 1:
            spectra = tuple(with_stated_positions(cdf, one) for one in spectra)
        origin = _origin_of(cdf)
        identity = cdf.attribute("Logical_file_id")
    return tuple(_held_against(one, (path.name, identity), path.name, origin) for one in spectra)


def _origin_of(cdf: CdfFile) -> Origin:
    stated = cdf.attribute(ORIGIN_ATTRIBUTE).lower()
    if stated and stated not in set(Origin):
        raise InputError(f"{cdf.name}: attribute {ORIGIN_ATTRIBUTE} is {stated!r}: use simulated, or leave it out")
    return Origin(stated or Origin.ARCHIVE)


def _held_against(spectrum: xr.Dataset, names: tuple[str, ...], source: str, origin: Origin) -> xr.Dataset:
    """A spectrum with its origin and quirks, if its times are near the days that the file is named after.

    Raises
    ------
    InputError
        If a record or a sample is farther than `NEAR_DAY` from a day in one of the names.
    """
    times = [spectrum["time"].to_numpy()]
    if "sample_time" in spectrum:
        times.append(spectrum["sample_time"].to_numpy())
    first, last = min(one.min() for one in times), max(one.max() for one in times)
    for day in (day for name in names for day in dates_in(name)):
        is_beside = last < day or first >= day + np.timedelta64(1, "D")
        if is_beside or first < day - NEAR_DAY or last >= day + 2 * NEAR_DAY:
            raise InputError(
                f"{source} is named after {day.astype('datetime64[D]')}, but holds times from "
                f"{np.datetime_as_string(first, 's')} to {np.datetime_as_string(last, 's')}: its clock or its name is "
                f"wrong; {ANOTHER}"
            )
    spectrum = spectrum.assign_attrs(origin=origin.value)
    found = quirks_of(spectrum)
    return spectrum.assign_attrs(quirks=";".join(found)) if found else spectrum


def _product_of(cdf: CdfFile) -> tuple[Product, str]:
    """Product by content where the file says so itself, else by its name."""
    named = find_product(cdf.name)
    stated = [cdf.attribute(name) for name in ("Logical_file_id", "Logical_source")]
    holds = next((found for found in map(find_product, stated) if found), None)
    if named and holds and named != holds:
        called = f"{named[0].name} {named[1]}" if named[0] == holds[0] else named[0].name
        held = f"{holds[0].name} {holds[1]}".rstrip()
        raise InputError(f"{cdf.name} is named after {called}, but holds {held}: correct its name")
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
        raise InputError(
            f"{path} is named after {product.name}, but is not {CONTAINERS[product.container]}; correct its name, or "
            "download it again"
        )
    spectra: Spectra = found[0].read(path, receiver)
    return tuple(_held_against(one, (path.name,), path.name, Origin.ARCHIVE) for one in spectra)


class Quirk(Record):
    """A known quirk of an instrument or a product."""

    name: str = Field(description="Name that spectra carry; several spacecraft may share one.")
    observatory: str
    receivers: tuple[str, ...] = Field(description="Receivers concerned; none means all.")
    products: tuple[str, ...] = Field(description="Beginnings of file names, lower case; none means all.")
    first: str = Field(description="First day, UTC.")
    last: str | None = Field(description="Last day, UTC; null where it goes on.")
    effect: str
    handling: str = Field(description="What the readers do about it.")
    source: str

    def applies_to(self, spectrum: xr.Dataset) -> bool:
        """Whether a dynamic spectrum has it: by spacecraft, receiver, names of its files, and days."""
        if spectrum.attrs["observatory"] != self.observatory:
            return False
        held = set(str(spectrum.attrs["receiver"]).split("+"))
        names = [str(name).lower() for name in np.atleast_1d(spectrum.attrs.get("source_files", ()))]
        begin, end = spectrum["time"].to_numpy()[[0, -1]].astype("datetime64[D]")
        return (
            (not self.receivers or bool(held & set(self.receivers)))
            and (not self.products or any(name.startswith(self.products) for name in names))
            and end >= np.datetime64(self.first)
            and (self.last is None or begin <= np.datetime64(self.last))
        )


@cache
def quirks() -> tuple[Quirk, ...]:
    """All known quirks, in the order of the ledger."""
    stored = json.loads((resources.files("bella.spectra") / QUIRKS).read_text(encoding="utf-8"))
    return tuple(Quirk.model_validate(one) for one in stored)


def quirks_of(spectrum: xr.Dataset) -> list[str]:
    """Names of the quirks that apply to a dynamic spectrum."""
    return list(dict.fromkeys(one.name for one in quirks() if one.applies_to(spectrum)))

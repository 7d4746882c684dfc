"""The archive products that can be read: how their files are named, what they hold, and whether that was ever tried."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import xarray as xr

from bella.spectra import psp, solo, stereo, stereo_text, wind, wind_files

Spectra = tuple[xr.Dataset, ...]


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
        ("Epoch", "E_VOLTAGE_RAD1", "E_VOLTAGE_RAD2"),
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
        ("Epoch", "FREQUENCY"),
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
        ("Epoch", "E_Average"),
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
        ("Epoch", "SWEEP", "FREQUENCY", "STOKES_I"),
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
        wind_files.read_60s,
    ),
    Product(
        "Wind/WAVES IDL",
        "Wind",
        "wind_waves_{rad1,rad2}_YYYYMMDD.{R1,R2}",
        "60 s",
        "voltage_ratio",
        False,
        "idl",
        r"(?:wind_waves_rad[12]_)?\d{8}\.(r[12])$",
        (),
        wind_files.read_idl,
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
        ("Epoch", "frequency", "avg_intens_ahead"),
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
        ("Epoch", "FREQUENCY", "PSD_FLUX"),
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
        stereo_text.read_text,
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
        stereo_text.read_text,
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
        ("FREQUENCY", "SWEEP_NUM", "AGC1", "AGC2"),
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
        ("TNR_BAND", "TNR_BAND_FREQ", "AUTO1", "AUTO2"),
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

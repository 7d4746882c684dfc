"""STEREO/WAVES CDFs: 1-minute averages of both spacecraft (level 2), and native cadence with directions (L3)."""

from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.exceptions import InputError
from bella.spectra.assembly import Origin, assemble, cadence_s
from bella.spectra.cdf import CdfFile
from bella.spectra.combination import combine_receivers
from bella.spectra.given_positions import read_positions
from bella.spectra.sweeps import mean_time_sd_s

SPACECRAFT = {"ahead": "STEREO-A", "behind": "STEREO-B"}
BY_LETTER = {"a": "STEREO-A", "b": "STEREO-B"}
DIRECTIONS = {
    f"wave_{angle}_{frame}_deg": f"WAVE_{angle}_{frame}".upper()
    for frame in ("hee", "rtn")
    for angle in ("colatitude", "azimuth")
} | {"source_size_deg": "SOURCE_SIZE"}
SWEEP_S = 38.05
"""Duration of a sweep, s (Canizares et al. 2024, A&A 684, A182, doi:10.1051/0004-6361/202347747)."""

MINUTE_AVERAGES_S = 30.0
"""What a minute averages over, as far as edges are concerned, s: between one sweep, which is a snapshot in a channel,
and two, 38 s apart. Edges of simulated minutes are least biased so; taken for means of a minute they are late."""

POSITIONS = ("SC_POS_HEE", "SC_POS_HEEQ", "SC_POS_HCI")


def read_level2(cdf: CdfFile, receiver: str = "") -> tuple[xr.Dataset, ...]:
    """STEREO-A and STEREO-B of a day at 1 minute, dB over background.

    Run on the archive file of 2010-01-17. A minute without data is stored as minus the background, and becomes NaN.
    A minute averages one or two sweeps, which may lie anywhere in it: ``sample_time_sd_s``.
    The bands of LFR and HFR overlap at 125 to 153 kHz, where the LFR's channels are kept, as they are denser.

    Parameters
    ----------
    cdf : CdfFile
        The open file.
    receiver : str
        Not used.

    Returns
    -------
    tuple of xarray.Dataset
        Quantity ``db_over_background``, shape (1440, 366) each; a spacecraft without any data is left out.

    Raises
    ------
    InputError
        If the file is not of this product, or holds no data at all.
    """
    del receiver
    time, frequency_mhz = cdf.utc("Epoch"), cdf.frequency_mhz("frequency", "kHz")
    spectra = tuple(
        _level2_spacecraft(cdf, name, time, frequency_mhz)
        for name in SPACECRAFT
        if cdf.has_records(f"avg_intens_{name}")
    )
    seen = tuple(one for one in spectra if np.isfinite(one["intensity"]).any())
    if not seen:
        raise InputError(f"{cdf.name} holds no data of either spacecraft")
    return seen


def _level2_spacecraft(
    cdf: CdfFile, name: str, time: npt.NDArray[np.datetime64], frequency_mhz: np.ndarray
) -> xr.Dataset:
    decibel = _over_background(cdf, name)
    falls = np.flatnonzero(np.diff(frequency_mhz) < 0.0)
    bands = [slice(None, falls[0] + 1), slice(falls[0] + 1, None)] if falls.size else [slice(None)]
    receivers = ["LFR", "HFR"] if falls.size else ["LFR+HFR"]
    parts = [
        assemble(
            Origin(SPACECRAFT[name], receiver, "db_over_background", cdf.name),
            time,
            frequency_mhz[band],
            decibel[:, band],
        )
        for receiver, band in zip(receivers, bands, strict=True)
    ]
    return by_minute(combine_receivers(*parts) if len(parts) == 2 else parts[0])


def by_minute(spectrum: xr.Dataset) -> xr.Dataset:
    """With what averages of a minute are, and how well their times are known.

    Parameters
    ----------
    spectrum : xarray.Dataset
        1-minute averages of STEREO/WAVES.

    Returns
    -------
    xarray.Dataset
        With ``sample_time_sd_s``, 5.7 s; ``integration_s`` is 30 s.
    """
    sd_s = np.full(spectrum.sizes["frequency"], mean_time_sd_s(SWEEP_S))
    known = spectrum.assign(sample_time_sd_s=("frequency", sd_s))
    return known.assign_attrs(integration_s=MINUTE_AVERAGES_S)


def _over_background(cdf: CdfFile, name: str) -> npt.NDArray[Any]:
    decibel, background = cdf.numbers(f"avg_intens_{name}", 2), cdf.numbers(f"background_{name}", 2)
    if decibel.shape != background.shape:
        raise InputError(f"{cdf.name}: background_{name} has another shape than avg_intens_{name}")
    background += decibel
    decibel[background == 0.0] = np.nan
    return decibel


def read_l3(cdf: CdfFile, receiver: str) -> tuple[xr.Dataset, ...]:
    """LFR or HFR of one spacecraft at native cadence, flux density with the direction it came from.

    Not yet run on an archive file: written to the published description of the product. The background is subtracted
    already, so that flux may be negative where there is none. The unit of frequency is read from the file, as manual
    and files do not agree on it. The HFR steps through its channels (Bougeret et al. 2008, Space Sci. Rev. 136, 487,
    doi:10.1007/s11214-007-9298-8), so that a sample takes no longer than the sweep over their number.

    Parameters
    ----------
    cdf : CdfFile
        The open file.
    receiver : str
        Letter of the spacecraft and receiver, such as "a_hfr".

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``flux_w_m2_hz``, with wave angles (time, frequency) and
        ``position_km`` where the file has them.

    Raises
    ------
    InputError
        If the file is not of this product.
    """
    letter, band = receiver.split("_")
    extra = {name: cdf.numbers(variable, 2) for name, variable in DIRECTIONS.items() if cdf.has_records(variable)}
    flux, frequency_mhz = cdf.numbers("PSD_FLUX", 2), cdf.frequency_mhz("FREQUENCY", "Hz")
    if frequency_mhz.ndim == 2:
        frequency_mhz = frequency_mhz[0]
    time = cdf.utc("Epoch")
    longest_s = cadence_s(time) / frequency_mhz.size if band == "hfr" else np.inf
    origin = Origin(BY_LETTER[letter], band.upper(), "flux_w_m2_hz", cdf.name, longest_s)
    return (read_positions(cdf, assemble(origin, time, frequency_mhz, flux, extra), time, POSITIONS),)

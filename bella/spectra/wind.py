"""Wind/WAVES CDFs: 1-minute (H1), native cadence (L2), key parameters (K0) and RAD1 direction finding (L3)."""

import numpy as np
import xarray as xr

from bella.exceptions import InputError
from bella.spectra.assembly import Origin, assemble, cadence_s, shared_channels
from bella.spectra.cdf import CdfFile
from bella.spectra.list_mode import with_visits
from bella.spectra.sweep_minutes import with_sweeps
from bella.spectra.sweeps import assemble_sweeps

OBSERVATORY = "WIND"
DIRECTIONS = {
    "wave_colatitude_rtn_deg": "WAVE_COLATITUDE_RTN",
    "wave_azimuth_rtn_deg": "WAVE_AZIMUTH_RTN",
    "source_size_deg": "SOURCE_SIZE",
    "modulation_rate": "MODULATION_RATE",
}


def read_h1(cdf: CdfFile, receiver: str = "") -> tuple[xr.Dataset, ...]:
    """RAD1, RAD2 and TNR of a day at 1 minute, as ratios of voltage to the background of the day.

    Run on the archive file of 2010-01-17. A channel whose background is zero was interpolated between measured ones,
    and is flagged ``interpolated``; a ratio of zero is no data. Ratios of two days have two backgrounds. What the list
    mode of RAD1 did not visit in a minute is NaN, and samples have the time of the visit
    (:mod:`bella.spectra.list_mode`); those of RAD2 the mean time of the sweeps in the minute
    (:mod:`bella.spectra.sweep_minutes`).

    Parameters
    ----------
    cdf : CdfFile
        The open file.
    receiver : str
        Not used: the file holds all three.

    Returns
    -------
    tuple of xarray.Dataset
        Quantity ``voltage_ratio``, 1 = background; shape (1440, 256), (1440, 256) and (1440, 96).

    Raises
    ------
    InputError
        If the file is not of this product.
    """
    del receiver
    time = cdf.utc("Epoch")
    # least memory is used at a time if those come last that take least to read
    by_name = {name: _h1_receiver(cdf, name, time) for name in ("TNR", "RAD1", "RAD2")}
    return tuple(by_name[name] for name in ("RAD1", "RAD2", "TNR"))


def _h1_receiver(cdf: CdfFile, receiver: str, time: np.ndarray) -> xr.Dataset:
    ratio = cdf.numbers(f"E_VOLTAGE_{receiver}", 2)
    ratio[ratio <= 0.0] = np.nan
    background = cdf.numbers(f"Minimum_voltage_{receiver}", 2)[0]
    frequency_mhz = cdf.frequency_mhz(f"Frequency_{receiver}", "kHz")
    origin = Origin(OBSERVATORY, receiver, "voltage_ratio", cdf.name)
    spectrum = assemble(origin, time, frequency_mhz, ratio, {"interpolated": ~(background > 0.0)})
    by_name = {"RAD1": with_visits, "RAD2": with_sweeps}
    return by_name[receiver](spectrum) if receiver in by_name else spectrum


def read_l2(cdf: CdfFile, receiver: str) -> tuple[xr.Dataset, ...]:
    """RAD1, RAD2 or TNR at native cadence, V^2/Hz before antenna calibration.

    Not yet run on an archive file: written to the published description of the product. The summed pair of antennas
    (SP) is read, as the spacecraft's spin shows least in it, else the one along the spin axis (Z). Of the 256 columns
    those without data, which the receiver did not visit, are dropped. A file is not a civil day. RAD1 and RAD2 step
    through their channels (Bougeret et al. 1995, Space Sci. Rev. 71, 231, doi:10.1007/BF00751331), so that a sample
    takes no longer than a record over the number of samples in it.

    Parameters
    ----------
    cdf : CdfFile
        The open file.
    receiver : str
        rad1, rad2 or tnr.

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``psd_v2_hz``.

    Raises
    ------
    InputError
        If the file is not of this product or holds no data.
    """
    variable = "PSD_V2_SP" if cdf.has_records("PSD_V2_SP") else "PSD_V2_Z"
    density = cdf.numbers(variable, 2)
    for part in np.array_split(density, 16):
        part[part <= 0.0] = np.nan
    frequency_mhz, density = shared_channels(cdf.frequency_mhz("FREQUENCY", "Hz"), density, cdf.name)
    time = cdf.utc("Epoch")
    if frequency_mhz.size != density.shape[1]:
        raise InputError(f"{cdf.name}: {frequency_mhz.size} frequencies for {density.shape[1]} columns of {variable}")
    visited = np.isfinite(frequency_mhz) & np.isfinite(np.fmax.reduce(density))
    if not visited.any():
        raise InputError(f"{cdf.name}: {variable} holds no data")
    each = max(1.0, float(np.median(np.isfinite(density).sum(axis=1))))
    longest_s = np.inf if receiver == "tnr" else cadence_s(time) / each
    origin = Origin(OBSERVATORY, receiver.upper(), "psd_v2_hz", cdf.name, longest_s)
    return (assemble(origin, time, frequency_mhz[visited], density[:, visited]),)


def read_k0(cdf: CdfFile, receiver: str = "") -> tuple[xr.Dataset, ...]:
    """Key parameters: 76 channels of all receivers, dB over background, preliminary, every 3 minutes or so.

    Not yet run on an archive file: written to the published description of the product. Good to see that there was a
    burst, too coarse to time it.

    Parameters
    ----------
    cdf : CdfFile
        The open file.
    receiver : str
        Not used.

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``db_over_background``.

    Raises
    ------
    InputError
        If the file is not of this product.
    """
    del receiver
    decibel = cdf.numbers("E_Average", 2)
    named = cdf.attribute("DEPEND_1", "E_Average")
    frequency_mhz = cdf.frequency_mhz(named if named in cdf.variables else "E_freq_val", "Hz")
    origin = Origin(OBSERVATORY, "TNR+RAD1+RAD2", "db_over_background", cdf.name)
    return (assemble(origin, cdf.utc("Epoch"), *shared_channels(frequency_mhz, decibel, cdf.name)),)


def read_l3_directions(cdf: CdfFile, receiver: str) -> tuple[xr.Dataset, ...]:
    """RAD1 flux density with the direction it came from, at native cadence.

    Run on the archive file of 2020-07-11. The receiver visits its lowest channels once and its highest four times in a
    sweep of 183 s; a sweep is four records here, and every sample keeps its own time (``sample_time``).

    Parameters
    ----------
    cdf : CdfFile
        The open file.
    receiver : str
        rad1.

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``flux_w_m2_hz``, with ``wave_colatitude_rtn_deg``, ``wave_azimuth_rtn_deg``,
        ``source_size_deg`` and ``modulation_rate`` (time, frequency).

    Raises
    ------
    InputError
        If the file is not of this product.
    """
    values = {"intensity": cdf.numbers("STOKES_I", 1)}
    values |= {name: cdf.numbers(variable, 1) for name, variable in DIRECTIONS.items()}
    origin = Origin(OBSERVATORY, receiver.upper(), "flux_w_m2_hz", cdf.name)
    # no names for what is not needed once it is in order
    return (
        assemble_sweeps(
            origin, cdf.numbers("SWEEP", 1), cdf.utc("Epoch"), cdf.frequency_mhz("FREQUENCY", "kHz"), values
        ),
    )

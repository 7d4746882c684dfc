"""Solar Orbiter RPW CDFs: HFR and TNR, as voltage (L2) and as flux (L3).

Both receivers step through their channels, so that every sample has its own time. Taking the time of the sweep for all
channels would be wrong by up to half a sweep.
"""

from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.containers import ANOTHER, CdfFile, TimeArray
from bella.exceptions import InputError
from bella.spectra.assembly import Origin, assemble, assemble_sweeps, dwell_s, record_centres, without_strays
from bella.spectra.beside import Beside, epoch_of, read_records
from bella.spectra.dynamic_spectrum import in_unit

OBSERVATORY = "SOLO"
HIGHEST_MHZ = {"hfr": 16.4, "tnr": 1.0}
HFR_DIPOLES = (9, 10, 11)
TNR_DIPOLES = (4, 5, 6)
PREAMPLIFIER = 1


def read_l2_hfr(cdf: CdfFile, receiver: str = "hfr") -> tuple[xr.Dataset, ...]:
    """HFR as a list of samples, V^2/Hz, of the dipole with most data.

    Not yet run on an archive file: written to the published description of the product. Zero means that the channel
    was not read. A new sweep begins where ``SWEEP_NUM`` changes.

    Parameters
    ----------
    receiver : str
        hfr.

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``psd_v2_hz``, with ``sample_time``.

    Raises
    ------
    InputError
        If the file is not of this product, or no dipole was read.
    """
    time = cdf.utc(epoch_of(cdf))
    power, dipole = _of_one_dipole(cdf, ("AGC1", "AGC2"), HFR_DIPOLES, 1)
    sweep, frequency_mhz = cdf.numbers("SWEEP_NUM", 1), cdf.frequency_mhz("FREQUENCY", "kHz", HIGHEST_MHZ["hfr"])
    if not time.shape == power.shape == sweep.shape == frequency_mhz.shape:
        raise InputError(f"{cdf.name}: AGC1, SWEEP_NUM, FREQUENCY and Epoch have different lengths; {ANOTHER}")
    beside = Beside(cdf, time.shape)
    time = without_strays(beside.shifted(time))
    read = np.isfinite(power) & ~np.isnat(time)
    order = np.flatnonzero(read)[np.argsort(time[read], kind="stable")]
    origin = Origin(OBSERVATORY, receiver.upper(), "psd_v2_hz", cdf.name)
    values = {"intensity": power[order]}
    spectrum = assemble_sweeps(origin, _counted(sweep[order]), time[order], frequency_mhz[order], values)
    return (beside.noted(spectrum.assign_attrs(sensor=dipole)),)


def read_l2_tnr(cdf: CdfFile, receiver: str = "tnr") -> tuple[xr.Dataset, ...]:
    """TNR, V^2/Hz, of the dipole with most data: four bands of 32 channels, read one after the other, are a record.

    Not yet run on an archive file: written to the published description of the product.

    Parameters
    ----------
    receiver : str
        tnr.

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``psd_v2_hz``, 128 channels, with ``sample_time``.

    Raises
    ------
    InputError
        If the file is not of this product, or no dipole was read.
    """
    time = cdf.utc(epoch_of(cdf))
    power, dipole = _of_one_dipole(cdf, ("AUTO1", "AUTO2"), TNR_DIPOLES, 2)
    beside, bands_mhz = Beside(cdf, time.shape), cdf.frequency_mhz("TNR_BAND_FREQ", "Hz", HIGHEST_MHZ["tnr"])
    time = beside.shifted(time)
    band, sweep = cdf.numbers("TNR_BAND", 1), cdf.numbers("SWEEP_NUM", 1)
    if not time.size == len(power) == band.size == sweep.size or bands_mhz.shape != (4, power.shape[1]):
        raise InputError(f"{cdf.name}: AUTO1, TNR_BAND, SWEEP_NUM and TNR_BAND_FREQ do not fit together; {ANOTHER}")
    time = without_strays(time)
    read = np.isfinite(power).any(axis=1) & ~np.isnat(time) & np.isin(band, range(4))
    if cdf.has_records("FRONT_END"):
        read &= cdf.numbers("FRONT_END", 1) == PREAMPLIFIER
    order = np.flatnonzero(read)[np.argsort(time[read], kind="stable")]
    if not order.size:
        raise InputError(f"{cdf.name}: no band of a dipole was read; leave the file out")
    row = np.unique(_counted(sweep[order]), return_inverse=True)[1]
    spectrum = _tnr_records(cdf.name, row, band[order].astype(int), time[order], power[order], bands_mhz)
    return (beside.noted(spectrum.assign_attrs(sensor=dipole, receiver=receiver.upper())),)


def _tnr_records(  # noqa: PLR0913, PLR0917 - one argument per variable of the file
    source: str,
    row: npt.NDArray[np.intp],
    band: npt.NDArray[Any],
    time: TimeArray,
    power: npt.NDArray[Any],
    bands_mhz: npt.NDArray[Any],
) -> xr.Dataset:
    """Records of all bands from records of one band each; of two visits in a sweep the first stays."""
    centre = record_centres(row, time)
    shape = (centre.size, *bands_mhz.shape)
    density = np.full(shape, np.nan, dtype=np.float32)
    when = np.broadcast_to(centre[:, None, None], shape).copy()
    density[row[::-1], band[::-1]] = power[::-1]
    when[row[::-1], band[::-1]] = time[::-1, None]
    flat = (centre.size, bands_mhz.size)
    origin = Origin(OBSERVATORY, "TNR", "psd_v2_hz", source, dwell_s(time))
    return assemble(origin, centre, bands_mhz.ravel(), density.reshape(flat), {"sample_time": when.reshape(flat)})


def read_l3(cdf: CdfFile, receiver: str) -> tuple[xr.Dataset, ...]:
    """HFR or TNR flux density, with the time of every sample where the file gives its offset from the record.

    Not yet run on an archive file: written to the published description of the product.

    Parameters
    ----------
    receiver : str
        hfr or tnr.

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``flux_w_m2_hz``, with what :func:`bella.spectra.beside.read_records` finds.

    Raises
    ------
    InputError
        If the file is not of this product.
    """
    origin = Origin(OBSERVATORY, receiver.upper(), "flux_w_m2_hz", cdf.name)
    start = cdf.utc(epoch_of(cdf, "PSD_FLUX"))
    frequency_mhz = cdf.frequency_mhz("FREQUENCY", "kHz", HIGHEST_MHZ[receiver])
    return (read_records(cdf, origin, "PSD_FLUX", start, frequency_mhz, cdf.numbers("PSD_FLUX", 2)),)


def _of_one_dipole(
    cdf: CdfFile, channels: tuple[str, str], dipoles: tuple[int, ...], dimensions: int
) -> tuple[npt.NDArray[Any], int]:
    """Power of the sensor pair that has most data, NaN where it was not read, and its number in the file."""
    sensor = cdf.numbers("SENSOR_CONFIG", 2)
    read = [cdf.numbers(variable, dimensions) for variable in channels]
    for variable, power in zip(channels, read, strict=True):
        if sensor.shape != (power.shape[0], 2):
            raise InputError(
                f"{cdf.name}: SENSOR_CONFIG has the shape {sensor.shape}, not {(power.shape[0], 2)}; {ANOTHER}"
            )
        power[~(power > 0.0)] = np.nan
        in_unit(power, cdf.attribute("UNITS", variable), "psd_v2_hz")
        Beside(cdf, power.shape, variable).clear(power)
    has_data = [np.isfinite(power).reshape(len(power), -1).any(axis=1) for power in read]
    counts = [
        sum(int(((sensor[:, column] == dipole) & has_data[column]).sum()) for column in range(2)) for dipole in dipoles
    ]
    if not max(counts):
        raise InputError(f"{cdf.name}: no dipole was read; leave the file out")
    dipole = dipoles[int(np.argmax(counts))]
    for column, power in enumerate(read):
        power[sensor[:, column] != dipole] = np.nan
    return np.where(np.isfinite(read[0]), read[0], read[1]), dipole


def _counted(sweep: npt.NDArray[Any]) -> npt.NDArray[np.intp]:
    """Sweeps counted from 0 in order of time; the file's number starts again now and then."""
    return np.concatenate([[0], np.cumsum(np.diff(sweep) != 0.0)]).astype(np.intp)[: sweep.size]

"""Solar Orbiter RPW CDFs: HFR and TNR, as voltage (L2) and as flux (L3).

Both receivers step through their channels, so that every sample has its own time. Taking the time of the sweep for all
channels would be wrong by up to half a sweep.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.exceptions import InputError
from bella.spectra.assembly import Origin, assemble, shared_channels
from bella.spectra.cdf import CdfFile, TimeArray
from bella.spectra.given_positions import read_positions
from bella.spectra.sweeps import assemble_sweeps, dwell_s, record_centres

OBSERVATORY = "SOLO"
HFR_DIPOLES = (9, 10, 11)
TNR_DIPOLES = (4, 5, 6)
PREAMPLIFIER = 1
ELAPSED = ("ELAPSED_TIME_SINCE_EPOCH", "TIMING")
ELAPSED_UNITS = {"ns": 1.0, "us": 1e3, "ms": 1e6, "s": 1e9}
LONGEST_SWEEP_NS = 3600e9
POSITIONS = ("SC_POS_HCI",)


def read_l2_hfr(cdf: CdfFile, receiver: str = "hfr") -> tuple[xr.Dataset, ...]:
    """HFR as a list of samples, V^2/Hz, of the dipole that was read most.

    Not yet run on an archive file: written to the published description of the product. Zero means that the channel
    was not read. A new sweep begins where ``SWEEP_NUM`` changes.

    Parameters
    ----------
    cdf : CdfFile
        The open file.
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
    time = cdf.utc("Epoch" if "Epoch" in cdf.variables else "EPOCH")
    power, dipole = _of_one_dipole(cdf, ("AGC1", "AGC2"), HFR_DIPOLES, 1)
    sweep, frequency_mhz = cdf.numbers("SWEEP_NUM", 1), cdf.frequency_mhz("FREQUENCY", "kHz")
    if not time.shape == power.shape == sweep.shape == frequency_mhz.shape:
        raise InputError(f"{cdf.name}: AGC1, SWEEP_NUM, FREQUENCY and Epoch have different lengths")
    read = np.isfinite(power) & ~np.isnat(time)
    order = np.flatnonzero(read)[np.argsort(time[read], kind="stable")]
    origin = Origin(OBSERVATORY, receiver.upper(), "psd_v2_hz", cdf.name)
    values = {"intensity": power[order]}
    spectrum = assemble_sweeps(origin, _counted(sweep[order]), time[order], frequency_mhz[order], values)
    return (spectrum.assign_attrs(sensor=dipole),)


def read_l2_tnr(cdf: CdfFile, receiver: str = "tnr") -> tuple[xr.Dataset, ...]:
    """TNR, V^2/Hz, of the dipole that was read most: four bands of 32 channels, read one after the other, are a record.

    Not yet run on an archive file: written to the published description of the product.

    Parameters
    ----------
    cdf : CdfFile
        The open file.
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
    time = cdf.utc("Epoch" if "Epoch" in cdf.variables else "EPOCH")
    power, dipole = _of_one_dipole(cdf, ("AUTO1", "AUTO2"), TNR_DIPOLES, 2)
    bands_mhz = cdf.frequency_mhz("TNR_BAND_FREQ", "Hz")
    band, sweep = cdf.numbers("TNR_BAND", 1), cdf.numbers("SWEEP_NUM", 1)
    if not time.size == len(power) == band.size == sweep.size or bands_mhz.shape != (4, power.shape[1]):
        raise InputError(f"{cdf.name}: AUTO1, TNR_BAND, SWEEP_NUM and TNR_BAND_FREQ do not fit together")
    read = np.isfinite(power).any(axis=1) & ~np.isnat(time) & np.isin(band, range(4))
    if "FRONT_END" in cdf.variables:
        read &= cdf.numbers("FRONT_END", 1) == PREAMPLIFIER
    order = np.flatnonzero(read)[np.argsort(time[read], kind="stable")]
    if not order.size:
        raise InputError(f"{cdf.name}: no band of a dipole was read")
    row = np.unique(_counted(sweep[order]), return_inverse=True)[1]
    spectrum = _tnr_records(cdf.name, row, band[order].astype(int), time[order], power[order], bands_mhz)
    return (spectrum.assign_attrs(sensor=dipole, receiver=receiver.upper()),)


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

    Not yet run on an archive file: written to the published description of the product. Samples that were interpolated
    are NaN; channels of which all were are flagged ``interpolated`` instead.

    Parameters
    ----------
    cdf : CdfFile
        The open file.
    receiver : str
        hfr or tnr.

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``flux_w_m2_hz``, with ``interpolated``, ``sample_time`` and ``position_km``
        where known.

    Raises
    ------
    InputError
        If the file is not of this product.
    """
    flux, start = cdf.numbers("PSD_FLUX", 2), cdf.utc("Epoch" if "Epoch" in cdf.variables else "EPOCH")
    stated_mhz = cdf.frequency_mhz("FREQUENCY", "kHz")
    extra: dict[str, npt.NDArray[Any]] = {}
    if cdf.has_records("INTERPOL_FLAG"):
        flux, extra["interpolated"] = _without_interpolated(cdf, flux, stated_mhz)
    frequency_mhz, flux = shared_channels(stated_mhz, flux, cdf.name)
    time, when = _sample_times(cdf, start, stated_mhz, flux.shape)
    origin = Origin(OBSERVATORY, receiver.upper(), "flux_w_m2_hz", cdf.name)
    if when is not None:
        extra["sample_time"] = when
        origin = replace(origin, integration_s=dwell_s(when[0]))
    return (read_positions(cdf, assemble(origin, time, frequency_mhz, flux, extra), start, POSITIONS),)


def _of_one_dipole(
    cdf: CdfFile, channels: tuple[str, str], dipoles: tuple[int, ...], dimensions: int
) -> tuple[npt.NDArray[Any], int]:
    """Power of the sensor pair that was read most, NaN where it was not, and its number in the file."""
    sensor = cdf.numbers("SENSOR_CONFIG", 2)
    counts = [int((sensor == dipole).sum()) for dipole in dipoles]
    dipole = dipoles[int(np.argmax(counts))]
    chosen: npt.NDArray[Any] | None = None
    for column, variable in enumerate(channels):
        power = cdf.numbers(variable, dimensions)
        if sensor.shape != (power.shape[0], 2):
            raise InputError(f"{cdf.name}: SENSOR_CONFIG has the shape {sensor.shape}, not {(power.shape[0], 2)}")
        power[~(power > 0.0)] = np.nan
        power[sensor[:, column] != dipole] = np.nan
        chosen = power if chosen is None else np.where(np.isfinite(chosen), chosen, power)
    if chosen is None or not np.isfinite(chosen).any():
        raise InputError(f"{cdf.name}: no dipole was read")
    return chosen, dipole


def _counted(sweep: npt.NDArray[Any]) -> npt.NDArray[np.intp]:
    """Sweeps counted from 0 in order of time; the file's number starts again now and then."""
    return np.concatenate([[0], np.cumsum(np.diff(sweep) != 0.0)]).astype(np.intp)[: sweep.size]


def _without_interpolated(
    cdf: CdfFile, flux: npt.NDArray[Any], frequency_mhz: npt.NDArray[Any]
) -> tuple[npt.NDArray[Any], npt.NDArray[np.bool_]]:
    flag = cdf.numbers("INTERPOL_FLAG", cdf.dimensions("INTERPOL_FLAG"))
    flagged = np.isfinite(flag) & (flag != 0.0)
    if flagged.shape == flux.shape[1:]:
        return flux, flagged
    if flagged.shape != flux.shape:
        raise InputError(f"{cdf.name}: INTERPOL_FLAG has the shape {flag.shape}, not {flux.shape}")
    never_measured = flagged.all(axis=0)
    flux[flagged & ~never_measured] = np.nan
    if frequency_mhz.ndim == 2:
        _, spread = shared_channels(frequency_mhz, np.where(flagged, 0.0, 1.0), cdf.name)
        never_measured = ~(spread == 1.0).any(axis=0)
    return flux, never_measured


def _sample_times(
    cdf: CdfFile, start: TimeArray, frequency_mhz: npt.NDArray[Any], shape: tuple[int, ...]
) -> tuple[TimeArray, TimeArray | None]:
    """Centre of each record, and the time of each sample if the file has offsets."""
    names = [name for name in ELAPSED if cdf.has_records(name)]
    if not names:
        return start, None
    offset, middle = _offsets(cdf, names[0], frequency_mhz)
    if offset.shape not in {shape, shape[1:]} or start.size != shape[0]:
        raise InputError(f"{cdf.name}: {names[0]} has the shape {offset.shape}, not {shape}")
    if np.isnat(middle):
        return start, None
    return start + middle, start[:, None] + np.broadcast_to(offset, shape)


def _offsets(
    cdf: CdfFile, name: str, frequency_mhz: npt.NDArray[Any]
) -> tuple[npt.NDArray[np.timedelta64], np.timedelta64]:
    """How long after the start of its sweep a sample was taken, and the middle of the sweep; NaT if none is known."""
    elapsed_ns = cdf.numbers(name, cdf.dimensions(name)).astype(np.float64)
    elapsed_ns *= ELAPSED_UNITS.get(cdf.attribute("UNITS", name).lower(), 1e9)
    elapsed_ns = elapsed_ns if elapsed_ns.ndim == 1 else shared_channels(frequency_mhz, elapsed_ns, cdf.name)[1]
    elapsed_ns[(elapsed_ns >= LONGEST_SWEEP_NS) | (elapsed_ns <= -LONGEST_SWEEP_NS)] = np.nan
    if not np.isfinite(elapsed_ns).any():
        return np.zeros(elapsed_ns.shape, "timedelta64[ns]"), np.timedelta64("NaT", "ns")
    middle_ns = (np.nanmin(elapsed_ns) + np.nanmax(elapsed_ns)) / 2.0
    elapsed_ns[np.isnan(elapsed_ns)] = middle_ns
    return np.rint(elapsed_ns, out=elapsed_ns).astype("timedelta64[ns]"), np.timedelta64(round(middle_ns), "ns")

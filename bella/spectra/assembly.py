"""From the arrays of an archive file to a dynamic spectrum."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.exceptions import InputError
from bella.spectra.dynamic_spectrum import validate_spectrum

LONG_NAMES = {
    "db_over_background": ("intensity over background", "dB"),
    "voltage_ratio": ("voltage over background", "1"),
    "psd_v2_hz": ("spectral density of voltage", "V2 Hz-1"),
    "flux_w_m2_hz": ("flux density", "W m-2 Hz-1"),
    "relative_flux": ("relative flux", "1"),
}


@dataclass(frozen=True)
class Origin:
    """Who measured a spectrum, and where it was read.

    Attributes
    ----------
    observatory, receiver : str
        Names, such as STEREO-A and HFR.
    quantity : str
        One of ``QUANTITIES``.
    source : str
        Name of the file.
    integration_s : float, optional
        The longest that a sample can have been integrated, s, where that is less than the time between records.
    """

    observatory: str
    receiver: str
    quantity: str
    source: str
    integration_s: float = math.inf


def assemble(
    origin: Origin,
    time: npt.NDArray[np.datetime64],
    frequency_mhz: npt.NDArray[Any],
    intensity: npt.NDArray[Any],
    extra: Mapping[str, npt.NDArray[Any]] | None = None,
) -> xr.Dataset:
    """Order records and channels of what was read and give it the form of a dynamic spectrum.

    Records without a time, channels without a frequency and repeated ones are dropped: the first stays.

    Parameters
    ----------
    origin : Origin
        Where it comes from.
    time : numpy.ndarray
        datetime64[ns], UTC, shape (records,).
    frequency_mhz : numpy.ndarray
        Shape (channels,).
    intensity : numpy.ndarray
        Shape (records, channels), NaN where there are no data.
    extra : mapping of str to numpy.ndarray, optional
        Further variables, each of shape (channels,) or (records, channels).

    Returns
    -------
    xarray.Dataset
        A dynamic spectrum; ``integration_s`` is what the origin says, at most the median step between records.

    Raises
    ------
    InputError
        If the shapes do not fit or less than two records remain.
    """
    variables = {"intensity": intensity, **(extra or {})}
    records, channels = _ascending(time), _ascending(frequency_mhz)
    for name, values in variables.items():
        if values.shape not in {(time.size, frequency_mhz.size), (frequency_mhz.size,)}:
            raise InputError(
                f"{origin.source}: {name} of {origin.receiver} has the shape {values.shape}, "
                f"but there are {time.size} times and {frequency_mhz.size} frequencies"
            )
    ordered = {
        name: (("frequency",), values[channels])
        if values.ndim == 1
        else (("time", "frequency"), _picked(values, records, channels))
        for name, values in variables.items()
    }
    coords = {"time": time[records].astype("datetime64[ns]"), "frequency": frequency_mhz[channels].astype(np.float64)}
    spectrum = xr.Dataset(ordered, coords=coords, attrs=_attributes(origin, coords["time"]))
    spectrum["intensity"] = spectrum["intensity"].astype(np.float32, copy=False)
    return label(validate_spectrum(spectrum, origin.source))


def label(spectrum: xr.Dataset) -> xr.Dataset:
    """Name and unit of intensity and frequency, as CF has them."""
    long_name, units = LONG_NAMES[spectrum.attrs["quantity"]]
    spectrum["intensity"].attrs.update(long_name=long_name, units=units)
    spectrum["frequency"].attrs.update(long_name="frequency", units="MHz")
    return spectrum


def cadence_s(time: npt.NDArray[np.datetime64]) -> float:
    """Median step between records, s; 1 where there are none."""
    return float(np.median(np.diff(time)) / np.timedelta64(1, "s")) if time.size > 1 else 1.0


def shared_channels(
    frequency_mhz: npt.NDArray[Any], values: npt.NDArray[Any], source: str
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Put records whose list of channels may change from one to the next on one list of channels.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray
        Shape (channels,), then everything is returned as it is, or (records, channels).
    values : numpy.ndarray
        Shape (records, channels).
    source : str
        File, named in the error.

    Returns
    -------
    frequency_mhz : numpy.ndarray
        Shape (all channels,).
    values : numpy.ndarray
        Shape (records, all channels), NaN where a record lacks a channel.

    Raises
    ------
    InputError
        If the shapes do not fit or the channels are never the same.
    """
    if frequency_mhz.ndim == 1:
        return frequency_mhz, values
    if frequency_mhz.shape != values.shape:
        raise InputError(f"{source}: frequencies of shape {frequency_mhz.shape} for values of shape {values.shape}")
    if (frequency_mhz == frequency_mhz[0]).all():
        return frequency_mhz[0], values
    known = np.isfinite(frequency_mhz)
    channels = np.unique(frequency_mhz[known])
    if channels.size > 16 * values.shape[1]:
        raise InputError(f"{source}: {channels.size} frequencies in records of {values.shape[1]} channels")
    spread = np.full((values.shape[0], channels.size), np.nan, dtype=values.dtype)
    row = np.broadcast_to(np.arange(values.shape[0])[:, None], values.shape)
    spread[row[known], np.searchsorted(channels, frequency_mhz[known])] = values[known]
    return channels, spread


def _ascending(axis: npt.NDArray[Any]) -> npt.NDArray[np.intp]:
    """Indices that order an axis without its gaps and repetitions."""
    known = np.flatnonzero(~np.isnan(axis) if axis.dtype.kind in "fM" else np.ones(axis.size, dtype=bool))
    _, first = np.unique(axis[known], return_index=True)
    return np.asarray(known[first], dtype=np.intp)


def _picked(
    values: npt.NDArray[Any], records: npt.NDArray[np.intp], channels: npt.NDArray[np.intp]
) -> npt.NDArray[Any]:
    """Values in order; those that are in order already are not copied."""
    if values.shape == (records.size, channels.size) and _is_range(records) and _is_range(channels):
        return values
    return values[np.ix_(records, channels)]


def _is_range(index: npt.NDArray[np.intp]) -> bool:
    return bool((index == np.arange(index.size)).all())


def _attributes(origin: Origin, time: npt.NDArray[np.datetime64]) -> dict[str, Any]:
    return {
        "observatory": origin.observatory,
        "receiver": origin.receiver,
        "quantity": origin.quantity,
        "integration_s": min(cadence_s(time), origin.integration_s),
        "source_files": [origin.source],
    }

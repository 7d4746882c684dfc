"""The form of a dynamic spectrum, and reading light curves off it.

A dynamic spectrum is an :class:`xarray.Dataset` with dimensions ``time`` and ``frequency``:

- ``time``: UTC centre of each record, ascending; ``frequency``: MHz, ascending;
- ``intensity(time, frequency)``: NaN where there are no data;
- optional ``sample_offset_s(frequency)`` or ``sample_time(time, frequency)`` for receivers that step through a sweep;
- optional ``interpolated(frequency)``: True for channels that were not measured;
- optional ``channel_integration_s(frequency)`` where channels differ in it; ``sample_time_sd_s(frequency)``, how well
  the times of their samples are known;
- optional ``visits_apart_s(time, frequency)``: time between the two visits that a sample is the mean of, 0 where it is
  of one;
- optional ``flux_sfu_1au(time, frequency)``: flux density as it would be at 1 au, sfu, where the archive has it;
- optional ``position_km(time, axis)``: where the spacecraft was, NaN where not known, with the attribute ``frame``, one
  of ``POSITION_FRAMES``;
- attributes ``observatory``, ``receiver``, ``quantity`` (one of ``QUANTITIES``), ``integration_s``, ``source_files``;
- attribute ``origin``, one of :class:`bella.records.Origin`, which the reader fills in: ``archive``, ``simulated``
  where the file says so, ``user`` for netCDF and Zarr without it;
- optional attributes ``quirks``, names of the known quirks of the instrument that apply (:func:`bella.spectra.quirks`),
  and ``left_out``, variables of the file that did not fit, with semicolons between the names;
- optional attribute ``power_exponent`` with ``relative_flux``: 2 where intensity is an amplitude, as of Wind, else 1.

Whatever is written in this form to netCDF or Zarr can be fed in, whichever instrument it comes from.
"""

import re
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.exceptions import InputError
from bella.spacecraft import FRAMES
from bella.units import R_SUN_KM, FloatArray

QUANTITIES = ("db_over_background", "voltage_ratio", "psd_v2_hz", "flux_w_m2_hz", "relative_flux")
"""What ``intensity`` may be."""

ATTRIBUTES = ("observatory", "receiver", "quantity", "integration_s", "source_files")
POSITION, GEOCENTRIC = "position_km", "gse"
FARTHEST_KM = 3e10
"""200 au: no spacecraft is farther."""

POSITION_FRAMES = (*FRAMES, GEOCENTRIC)
"""Frames of ``position_km``: those of the ephemeris, and the one that is centred on Earth."""

OPTIONAL_DIMENSIONS = {
    "sample_offset_s": ("frequency",),
    "sample_time": ("time", "frequency"),
    "interpolated": ("frequency",),
    "channel_integration_s": ("frequency",),
    "sample_time_sd_s": ("frequency",),
    "visits_apart_s": ("time", "frequency"),
    "flux_sfu_1au": ("time", "frequency"),
    POSITION: ("time", "axis"),
}

LONG_NAMES = {
    "db_over_background": ("intensity over background", "dB"),
    "voltage_ratio": ("voltage over background", "1"),
    "psd_v2_hz": ("spectral density of voltage", "V2 Hz-1"),
    "flux_w_m2_hz": ("flux density", "W m-2 Hz-1"),
    "relative_flux": ("relative flux", "1"),
}


LOWEST_VALUE, HIGHEST_VALUE, HIGHEST_DB = -999.0, 1e15, 9000.0
"""Nothing that is measured, in any quantity, is as low or as high: fill values are, such as -9999 and 1e20."""

SMALLEST = {"psd_v2_hz": 1e-22, "flux_w_m2_hz": 1e-26}
"""What is below the noise of every receiver: a unit by which all values are is not theirs."""

UNIT_FACTORS = {
    "psd_v2_hz": {"mv2/hz": 1e-6, "uv2/hz": 1e-12, "nv2/hz": 1e-18},
    "flux_w_m2_hz": {"sfu": 1e-22, "solarfluxunit": 1e-22, "solarfluxunits": 1e-22, "jy": 1e-26, "jansky": 1e-26},
}
"""From other units of a quantity to its own; as plain text without blanks and signs of powers."""


UNITS_OF = (
    (r"db", ("db_over_background",)),
    (r"sfu|solarfluxunits?|jy|jansky|w/?m-?2/?hz", ("flux_w_m2_hz", "relative_flux")),
    (r"[mun]?v2/?hz", ("psd_v2_hz", "relative_flux")),
)
"""Beginnings of units, as plain text, and the quantities that can be in them."""

NO_UNIT = re.compile(r"\d{4}|.{60}", re.DOTALL)
"""What no unit has; astropy would compute 10**999999999."""

ASTROPY_UNITS = {"psd_v2_hz": "V2 / Hz", "flux_w_m2_hz": "W / (m2 Hz)"}


def _plain_unit(unit: str) -> str:
    plain = re.sub(r"[\s^*{}()\[\]_.]", "", unit.lower().replace("µ", "u").replace("μ", "u"))
    return plain.replace("hz-1", "/hz")


def unit_of_another(unit: str, quantity: str) -> bool:
    """Whether a unit, as a file states it, can only be that of another quantity."""
    found = [quantities for begins, quantities in UNITS_OF if re.match(begins, _plain_unit(unit))]
    return any(quantity not in quantities for quantities in found) or _parsed_factor(unit, quantity) is None


def in_unit(values: npt.NDArray[Any], unit: str, quantity: str) -> None:
    """Convert values, in place, from a unit that a file states to that of a quantity, unless they are in it already.

    Parameters
    ----------
    values : numpy.ndarray
        Floating-point, NaN where there are no data.
    unit : str
        One that is not known leaves them as they are.
    quantity : str
        One of ``QUANTITIES``.
    """
    factor = UNIT_FACTORS.get(quantity, {}).get(_plain_unit(unit)) or _parsed_factor(unit, quantity) or 1.0
    if factor != 1.0 and np.nanmax(values, initial=0.0) * factor > SMALLEST[quantity]:
        values *= values.dtype.type(factor)


def _parsed_factor(unit: str, quantity: str) -> float | None:
    """From a unit that astropy understands to that of a quantity: 1 from what is no unit, None from that of another."""
    is_known = any(re.match(f"({begins})$", _plain_unit(unit)) for begins, _ in UNITS_OF)
    if quantity not in ASTROPY_UNITS or is_known or not unit.strip() or NO_UNIT.search(unit):
        return 1.0
    from astropy import units as u  # noqa: PLC0415 - heavy, and few files need it

    with warnings.catch_warnings(action="ignore"):  # of ways to write units that are understood all the same
        stated = u.Unit(unit, parse_strict="silent")
    if isinstance(stated, u.UnrecognizedUnit) or stated == u.dimensionless_unscaled:
        return 1.0
    return float(stated.to(ASTROPY_UNITS[quantity])) if stated.is_equivalent(ASTROPY_UNITS[quantity]) else None


def without_fill(intensity: npt.NDArray[Any], quantity: str) -> npt.NDArray[Any]:
    """Intensity with NaN for what no receiver measures: fill values that no file states.

    Parameters
    ----------
    intensity : numpy.ndarray
        NaN where there are no data.
    quantity : str
        One of ``QUANTITIES``.

    Returns
    -------
    numpy.ndarray
        The same array where all can be, else a copy.
    """
    highest = HIGHEST_DB if quantity == "db_over_background" else HIGHEST_VALUE
    is_fill = (intensity <= LOWEST_VALUE) | (intensity > highest)
    return np.where(is_fill, np.float32(np.nan), intensity) if is_fill.any() else intensity


def validate_spectrum(spectrum: xr.Dataset, source: str) -> xr.Dataset:
    """Check that a dataset has the form of a dynamic spectrum.

    Parameters
    ----------
    spectrum : xarray.Dataset
        What was read.
    source : str
        File or group it came from, named in the error.

    Returns
    -------
    xarray.Dataset
        The same dataset, so that a reader can end with this call.

    Raises
    ------
    InputError
        If it has not; the message names what is wrong.
    """
    complaint = (
        _wrong_attribute(spectrum) or without_intensity(spectrum) or _wrong_axis(spectrum) or _wrong_variable(spectrum)
    )
    if complaint:
        raise InputError(f"{source} is not a dynamic spectrum: {complaint}")
    return spectrum


def without_intensity(stored: xr.Dataset) -> str:
    """What to do about a dataset without ``intensity``, which may have it under another name; empty with it."""
    if "intensity" in stored.variables:
        return ""
    others = [str(name) for name, one in stored.data_vars.items() if one.ndim > 1 and one.dtype.kind in "iuf"]
    return f"name its values 'intensity' (one of {', '.join(others)})" if others else "add the variable 'intensity'"


def _wrong_attribute(spectrum: xr.Dataset) -> str:
    missing = [name for name in ATTRIBUTES if name not in spectrum.attrs]
    if missing:
        return f"add the attribute {missing[0]!r}"
    if not str(spectrum.attrs["observatory"]).strip():
        return "attribute 'observatory' is empty: name the spacecraft"
    if spectrum.attrs["quantity"] not in QUANTITIES:
        return f"attribute 'quantity' is {spectrum.attrs['quantity']!r}: use one of {', '.join(QUANTITIES)}"
    return _wrong_number(spectrum, "integration_s") or _wrong_number(spectrum, "power_exponent")


def _wrong_number(spectrum: xr.Dataset, name: str) -> str:
    value = spectrum.attrs.get(name, 1.0)
    try:
        return "" if 0.0 < float(value) < np.inf else f"attribute {name!r} is {value!r}: give a number above zero"
    except (TypeError, ValueError):
        return f"attribute {name!r} is {value!r}: give a number above zero"


def _wrong_axis(spectrum: xr.Dataset) -> str:
    missing = [name for name in ("time", "frequency") if name not in spectrum.coords or spectrum[name].dims != (name,)]
    if missing:
        return f"add the coordinate {missing[0]!r} along a dimension of that name"
    time, frequency = spectrum["time"].to_numpy(), spectrum["frequency"].to_numpy()
    if not np.issubdtype(time.dtype, np.datetime64):
        return f"coordinate 'time' is {time.dtype}: store UTC with CF time units"
    if not np.issubdtype(frequency.dtype, np.number):
        return f"coordinate 'frequency' is {frequency.dtype}: give MHz"
    if spectrum["frequency"].attrs.get("units", "MHz") != "MHz":
        return f"coordinate 'frequency' is in {spectrum['frequency'].attrs['units']}: convert it to MHz"
    return _wrong_order(time, frequency)


def _wrong_order(time: npt.NDArray[np.datetime64], frequency: FloatArray) -> str:
    if time.size < 2 or frequency.size < 1:
        return f"it holds {time.size} records of {frequency.size} channels: give at least two records of one channel"
    if np.isnat(time).any() or not (np.diff(time) > np.timedelta64(0)).all():
        return "coordinate 'time' does not ascend: sort the records and drop repeated ones"
    if not (np.isfinite(frequency).all() and frequency[0] > 0.0 and (np.diff(frequency) > 0.0).all()):
        return "coordinate 'frequency' does not ascend from above zero: sort the channels and drop repeated ones"
    return ""


def _wrong_variable(spectrum: xr.Dataset) -> str:
    if not np.issubdtype(spectrum["intensity"].dtype, np.floating):
        return f"variable 'intensity' is {spectrum['intensity'].dtype}: use float32, NaN where there are no data"
    expected = {"intensity": ("time", "frequency"), **OPTIONAL_DIMENSIONS}
    for name, dims in expected.items():
        if name in spectrum and set(surplus := spectrum[name].dims) > set(dims):
            (first, *_) = (dim for dim in surplus if dim not in dims)
            return f"variable {name!r} has {spectrum.sizes[first]} values along {str(first)!r}: select one of them"
        if name in spectrum and spectrum[name].dims != dims:
            return f"variable {name!r} has dimensions {spectrum[name].dims}: order them {dims}"
    return _wrong_position(spectrum) if POSITION in spectrum else ""


def _wrong_position(spectrum: xr.Dataset) -> str:
    stated = spectrum[POSITION]
    if stated.sizes["axis"] != 3 or not np.issubdtype(stated.dtype, np.floating):
        return f"variable {POSITION!r} holds {stated.sizes['axis']} columns of {stated.dtype}: give x, y, z as float64"
    if str(stated.attrs.get("frame")).lower() not in POSITION_FRAMES:
        return f"{POSITION!r} is in frame {stated.attrs.get('frame')!r}: use one of {', '.join(POSITION_FRAMES)}"
    if stated.attrs.get("units", "km") != "km":
        return f"variable {POSITION!r} is in {stated.attrs['units']}: convert it to km"
    range_km = np.linalg.norm(stated.to_numpy(), axis=1)
    is_of_earth = str(stated.attrs["frame"]).lower() == GEOCENTRIC
    lowest_km = 0.0 if is_of_earth else R_SUN_KM
    if (range_km < lowest_km).any() or (range_km > FARTHEST_KM).any():
        return (
            f"variable {POSITION!r} is {np.nanmin(range_km):.3g} to {np.nanmax(range_km):.3g} km from the centre of "
            f"{'Earth' if is_of_earth else 'the Sun'}: correct its unit or frame"
        )
    return ""


def label(spectrum: xr.Dataset) -> xr.Dataset:
    """Name and unit of intensity and frequency, as CF has them."""
    long_name, units = LONG_NAMES[spectrum.attrs["quantity"]]
    spectrum["intensity"].attrs.update(long_name=long_name, units=units)
    spectrum["frequency"].attrs.update(long_name="frequency", units="MHz")
    return spectrum


def relative_power(spectrum: xr.Dataset) -> xr.DataArray:
    """Intensity as a quantity proportional to power, so that half of it is the same level for every receiver.

    Parameters
    ----------
    spectrum : xarray.Dataset
        A dynamic spectrum.

    Returns
    -------
    xarray.DataArray
        Float64 (time, frequency), arbitrary unit. Amplitudes are squared, decibels raised; NaN stays NaN.
    """
    intensity = spectrum["intensity"].astype(np.float64)
    quantity = spectrum.attrs["quantity"]
    if quantity == "db_over_background":
        return 10.0 ** (intensity / 10.0)
    exponent = 2.0 if quantity == "voltage_ratio" else float(spectrum.attrs.get("power_exponent", 1.0))
    return intensity**exponent


def power_above_background(spectrum: xr.Dataset) -> xr.DataArray:
    """Power of what is above the background, so that half of its maximum is half of the burst.

    Parameters
    ----------
    spectrum : xarray.Dataset
        A dynamic spectrum, in decibels over background or with its background taken away.

    Returns
    -------
    xarray.DataArray
        Float64 (time, frequency), in units of the background where the spectrum is in decibels over it.
    """
    power = relative_power(spectrum)
    return power - 1.0 if spectrum.attrs["quantity"] == "db_over_background" else power


def sample_times(spectrum: xr.Dataset) -> xr.DataArray:
    """When every sample was taken.

    Parameters
    ----------
    spectrum : xarray.Dataset
        A dynamic spectrum.

    Returns
    -------
    xarray.DataArray
        datetime64[ns] (time, frequency), UTC: the time of the record unless the spectrum says how the sweep went.
    """
    if "sample_time" in spectrum:
        return spectrum["sample_time"]
    shape = xr.zeros_like(spectrum["intensity"], dtype="timedelta64[ns]")
    if "sample_offset_s" in spectrum:
        shape = shape + (spectrum["sample_offset_s"] * 1e9).round().astype("timedelta64[ns]")
    return (spectrum["time"] + shape).transpose("time", "frequency")


def integration_times_s(spectrum: xr.Dataset) -> FloatArray:
    """How long the samples of every channel average over.

    Parameters
    ----------
    spectrum : xarray.Dataset
        A dynamic spectrum.

    Returns
    -------
    numpy.ndarray, shape (channels,)
        ``channel_integration_s`` where it is known, else the attribute ``integration_s``; s.
    """
    whole_s = float(spectrum.attrs["integration_s"])
    if "channel_integration_s" not in spectrum:
        return np.full(spectrum.sizes["frequency"], whole_s)
    stated_s = spectrum["channel_integration_s"].to_numpy()
    return np.where(stated_s > 0.0, stated_s, whole_s)


def light_curve(spectrum: xr.Dataset, frequency_mhz: float) -> xr.DataArray:
    """Relative power of the channel nearest to a frequency.

    Parameters
    ----------
    spectrum : xarray.Dataset
        A dynamic spectrum.
    frequency_mhz : float
        MHz, not outside the first and last channel by more than a channel.

    Returns
    -------
    xarray.DataArray
        Shape (time,), with ``time`` the time of the samples of this channel and ``frequency`` its frequency, MHz.

    Raises
    ------
    InputError
        If the spectrum does not reach that frequency.
    """
    channels = spectrum["frequency"].to_numpy()
    margin = np.diff(channels)[[0, -1]] if channels.size > 1 else np.zeros(2)
    if not channels[0] - margin[0] <= frequency_mhz <= channels[-1] + margin[1]:
        raise InputError(f"no channel at {frequency_mhz:g} MHz: choose from {channels[0]:g} to {channels[-1]:g} MHz")
    nearest = {"frequency": int(np.abs(channels - frequency_mhz).argmin())}
    curve = relative_power(spectrum).isel(nearest)
    return curve.assign_coords(time=sample_times(spectrum).isel(nearest).to_numpy())

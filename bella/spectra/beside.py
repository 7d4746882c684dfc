"""What stands beside the intensity in a CDF: sample times, interpolation flags, flux at 1 au, directions, positions.

All of it is looked for by name in every product, in whatever shape it comes. None of it refuses a spectrum: what does
not fit is left out, and the attribute ``left_out`` names it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.exceptions import InputError
from bella.spectra.assembly import Origin, assemble, cadence_s, dwell_s, shared_channels
from bella.spectra.cdf import CdfFile, TimeArray
from bella.spectra.positions import with_positions
from bella.units import FloatArray

TIMES = ("ELAPSED_TIME_SINCE_EPOCH", "TIMING")
FLAGS = ("INTERPOL_FLAG",)
FLUX_AT_1_AU = ("PSD_SFU",)
POSITIONS = ("SC_POS_HEE", "SC_POS_HEEQ", "SC_POS_HCI")
"""Names in the files, the best first."""

SECONDS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "sec": 1.0, "seconds": 1.0, "second": 1.0, "": 1.0}
LONGEST_SWEEP_S = 3600.0
KILOMETRES = ("", "km", "kilometer", "kilometers", "kilometre", "kilometres")


def epoch_of(cdf: CdfFile, variable: str = "") -> str:
    """Name of the times of a variable: what it depends on, else the epoch of the file that has times.

    Raises
    ------
    InputError
        If there is none.
    """
    stated = cdf.attribute("DEPEND_0", variable) if variable else ""
    found = cdf.first_with_data(*filter(None, (stated, "Epoch", "EPOCH", "epoch")))
    if not found:
        raise InputError(
            f"{cdf.name} has no times: neither Epoch nor EPOCH holds any; take another version of the file"
        )
    return found


def read_records(  # noqa: PLR0913, PLR0917 - one argument per variable of the file
    cdf: CdfFile,
    origin: Origin,
    variable: str,
    time: TimeArray,
    frequency_mhz: npt.NDArray[Any],
    values: npt.NDArray[Any],
    *,
    extra: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """A dynamic spectrum of a CDF with one row of channels per record, and all that stands beside it.

    Parameters
    ----------
    cdf : CdfFile
        The open file.
    origin : Origin
        Who measured it.
    variable : str
        Name of the intensity in the file.
    time : numpy.ndarray
        datetime64[ns], UTC, shape (records,); the start of each sweep where the file has the offsets of its samples.
    frequency_mhz : numpy.ndarray
        Shape (channels,) or (records, channels).
    values : numpy.ndarray
        Intensity, shape (records, channels); changed in place.
    extra : mapping of str to str, optional
        Names of further variables in the spectrum, and in the file.

    Returns
    -------
    xarray.Dataset
        With ``sample_time``, ``interpolated``, ``flux_sfu_1au``, ``position_km`` and what `extra` names, where the file
        has them. Interpolated samples are NaN; a channel of which all are is marked ``interpolated`` instead.

    Raises
    ------
    InputError
        If intensity, times and frequencies do not fit together.
    """
    beside = Beside(cdf, values.shape)
    channels = frequency_mhz.shape[-1]
    if values.shape != (time.size, channels):
        raise InputError(
            f"{cdf.name}: {variable} has the shape {values.shape}, but there are {time.size} times and {channels} "
            "frequencies: take another version of the file"
        )
    found: dict[str, npt.NDArray[Any]] = {}
    at_1_au = [("flux_sfu_1au", name) for name in FLUX_AT_1_AU if cdf.has_records(name)]
    wanted = {**dict(at_1_au), **(extra or {})}
    for name, stored in wanted.items():
        matrix = beside.matrix(stored)
        if matrix is not None:
            found[name] = shared_channels(frequency_mhz, matrix, cdf.name)[1].astype(np.float32, copy=False)
    flagged = beside.flagged()
    if flagged is not None:
        found["interpolated"] = _without_flagged(flagged, frequency_mhz, values, cdf.name)
    offset_s = beside.offset_s()
    shared_mhz, values = shared_channels(frequency_mhz, values, cdf.name)
    start = time
    if offset_s is not None:
        offset_s = shared_channels(frequency_mhz, offset_s, cdf.name)[1]
        time, found["sample_time"] = _timed(start, offset_s)
        origin = replace(origin, integration_s=dwell_s(found["sample_time"][0]))
    spectrum = assemble(origin, time, shared_mhz, values, found)
    if "flux_sfu_1au" in spectrum:
        spectrum["flux_sfu_1au"] = spectrum["flux_sfu_1au"].where(np.isfinite(spectrum["intensity"]))
        spectrum["flux_sfu_1au"].attrs = {"long_name": "flux density at 1 au", "units": "sfu"}
    spectrum = _placed(cdf, spectrum, start)
    return spectrum.assign_attrs(left_out=";".join(beside.left_out)) if beside.left_out else spectrum


class Beside:
    """Optional variables of a CDF, in the shape of its intensity.

    Parameters
    ----------
    cdf : CdfFile
        The open file.
    shape : tuple of int
        Of the intensity, records first.

    Attributes
    ----------
    left_out : list of str
        Names of variables that are there and do not fit.
    """

    def __init__(self, cdf: CdfFile, shape: tuple[int, ...]) -> None:
        self._cdf, self._shape = cdf, shape
        self.left_out: list[str] = []

    def offset_s(self) -> npt.NDArray[Any] | None:
        """How long after the time of its record each sample was taken, s, NaN where not known; None without any."""
        for name in self._named(TIMES):
            seconds = SECONDS.get(self._cdf.attribute("UNITS", name).lower().strip("[]() "))
            offset = self.matrix(name) if seconds is not None else None
            if offset is None or seconds is None:
                self._leave_out(name)
                continue
            offset_s = offset.astype(np.float64) * seconds
            offset_s[np.abs(offset_s) >= LONGEST_SWEEP_S] = np.nan
            if np.isfinite(offset_s).any():
                return offset_s
        return None

    def flagged(self) -> npt.NDArray[np.bool_] | None:
        """Samples that were not measured, in the shape of the intensity; None without flags."""
        for name in self._named(FLAGS):
            flag = self.matrix(name)
            if flag is not None:
                return np.asarray(np.isfinite(flag) & (flag != 0.0))
        return None

    def matrix(self, name: str) -> npt.NDArray[Any] | None:
        """A variable in the shape of the intensity, from one value per record, channel or sample; None if it is none.

        What has a further axis, of antennas, is the mean along it.
        """
        try:
            values = self._cdf.numbers(name)
        except InputError:
            self._leave_out(name)
            return None
        if values.ndim == len(self._shape) + 1 and values.shape[:-1] == self._shape:
            count = np.isfinite(values).sum(axis=-1)
            values = np.where(count > 0, np.nansum(values, axis=-1) / np.maximum(count, 1), np.nan)
        if values.shape == self._shape:
            return values
        whole = values.squeeze()
        if len(self._shape) == 2 and whole.shape == self._shape[:1] and self._cdf.varies(name):
            return np.repeat(whole[:, None], self._shape[1], axis=1)
        if whole.ndim <= 1 and whole.shape in {(), self._shape[-1:]}:
            return np.array(np.broadcast_to(whole, self._shape))
        self._leave_out(name)
        return None

    def _leave_out(self, name: str) -> None:
        if name not in self.left_out:
            self.left_out.append(name)

    def _named(self, names: Sequence[str]) -> list[str]:
        by_name = {name.upper(): name for name in sorted(self._cdf.variables)}
        return [by_name[name] for name in names if name in by_name and self._cdf.has_records(by_name[name])]


def _without_flagged(
    flagged: npt.NDArray[np.bool_], frequency_mhz: npt.NDArray[Any], values: npt.NDArray[Any], source: str
) -> npt.NDArray[np.bool_]:
    """Take the samples away that were not measured; which channels never were, shape (channels,)."""
    never: npt.NDArray[np.bool_] = np.asarray(flagged.all(axis=0))
    values[flagged & ~never] = np.nan
    if frequency_mhz.ndim == 2:
        _, spread = shared_channels(frequency_mhz, np.where(flagged, 0.0, 1.0), source)
        never = np.asarray(~(spread == 1.0).any(axis=0))
    return never


def _timed(start: TimeArray, offset_s: npt.NDArray[Any]) -> tuple[TimeArray, TimeArray]:
    """Middle of each record, and the time of each sample; one without an offset has that of the middle."""
    middle_s = 0.5 * (np.nanmin(offset_s) + np.nanmax(offset_s))
    offset_ns = np.where(np.isfinite(offset_s), offset_s, middle_s)
    offset_ns *= 1e9
    offset = np.rint(offset_ns, out=offset_ns).astype("timedelta64[ns]")
    return start + np.timedelta64(round(middle_s * 1e9), "ns"), start[:, None] + offset


def _placed(cdf: CdfFile, spectrum: xr.Dataset, time: TimeArray) -> xr.Dataset:
    """With the first positions in km that the file has."""
    for name in POSITIONS:
        if not cdf.has_records(name) or cdf.attribute("UNITS", name).lower() not in KILOMETRES:
            continue
        try:
            stated_km: FloatArray = cdf.numbers(name, 2).astype(np.float64)
        except InputError:
            continue
        if stated_km.shape == (time.size, 3) and np.isfinite(stated_km).any():
            return with_positions(spectrum, time, stated_km, name.rsplit("_", 1)[-1].lower())
    return spectrum


def longest_dwell_s(time: TimeArray, channels: int) -> float:
    """Longest that a receiver which steps through its channels can stay at one, s."""
    return cadence_s(time) / channels

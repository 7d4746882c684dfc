"""What stands beside the intensity in a CDF: sample times, interpolation flags, flux at 1 au, directions.

All of it is looked for by name in every product, in whatever shape it comes. None of it refuses a spectrum: what does
not fit is left out, and the attribute ``left_out`` names it.
"""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.containers import ANOTHER, CdfFile, TimeArray
from bella.exceptions import InputError
from bella.spectra.assembly import Origin, assemble, cadence_s, dwell_s, shared_channels
from bella.spectra.dynamic_spectrum import in_unit

TIMES = re.compile(r"TIMING|ELAPSED|SAMPLE_?TIME|TIME_?(OFFSET|SHIFT|DELAY|SINCE)|OFFSET_?(TIME|S$|SEC|EPOCH)")
TIMES_DESCRIBED = re.compile(
    r"(time|temporal) offset|offset (in time|from|of each|of the)|elapsed|time (since|after)|seconds? (since|after)"
)
FLAGS = re.compile(r"INTERP(?!RET)")
FLAGS_DESCRIBED, FLAG_LIKE = re.compile(r"interpolat"), re.compile(r"FLAG|QUALITY|STATUS|MASK|MEASURED|VALID")
FLUX_AT_1_AU = re.compile(r"(^|_)(PSD_SFU|SFU_?1_?AU|FLUX_?(AT_)?1_?AU)$")
"""Names in the files, upper case, and what descriptions say of variables whose names do not tell."""

INTERPOLATED = re.compile(
    r"(\d+)\W*(?:means|is|if|for|are)?\W*(?:(?:the|sample|samples|value|values|data|was|were|is|been|has)\W+)*"
    r"(not\W+|non\W*|un)?interpolat"
)
AFTERWARDS = re.compile(
    r"(not\W+|non\W*|un)?interpolat\w*\W*(?:(?:sample|samples|value|values|data|are|is)\W+)*[=:(]\W*(\d+)"
)
MEASURED = re.compile(r"(\d+)\W*(?:means|is|if|for|are)?\W*(?:measured|observed|original|valid|good)")
DESCRIPTIONS = ("CATDESC", "FIELDNAM", "VAR_NOTES", "LABLAXIS", "DESCRIPTION", "LONG_NAME")
FLAG_FILLS = (255, -128, -32768, 65535, -(2**31), 2**32 - 1)
"""Fill values of whole numbers where a file states none (ISTP guidelines)."""

NO_UNIT = re.compile(r"TIMING|ELAPSED")
"""Times that are in seconds where no unit is stated."""

SECONDS = {
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("us", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("min", "mins", "minute", "minutes"), 60.0),
}
LONGEST_SWEEP_S = 900.0
"""No receiver takes longer for a sweep; what is farther from the time of a record, such as -999, is no offset."""

SFU = {"sfu": 1.0, "solar flux unit": 1.0, "solar flux units": 1.0, "": 1.0, "w/m^2/hz": 1e22, "w m-2 hz-1": 1e22}


def epoch_of(cdf: CdfFile, variable: str = "") -> str:
    """Name of the times of a variable: what it depends on, else the epoch of the file that has times.

    Raises
    ------
    InputError
        If there is none.
    """
    stated = cdf.attribute("DEPEND_0", variable) if variable else ""
    others = sorted(name for name in cdf.variables if cdf.is_epoch(name) and cdf.varies(name))
    found = cdf.first_with_data(*filter(None, (stated, "Epoch", *others)))
    if not found:
        raise InputError(f"{cdf.name} has no times that can be read: {ANOTHER}")
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
        With ``sample_time``, ``interpolated``, ``flux_sfu_1au`` and what `extra` names, where the file
        has them. Interpolated samples are NaN; a channel of which all are is marked ``interpolated`` instead.

    Raises
    ------
    InputError
        If intensity, times and frequencies do not fit together.
    """
    in_unit(values, cdf.attribute("UNITS", variable), origin.quantity)
    beside = Beside(cdf, values.shape, variable)
    channels = frequency_mhz.shape[-1]
    if values.shape != (time.size, channels):
        raise InputError(
            f"{cdf.name}: {variable} has the shape {values.shape}, but there are {time.size} times and {channels} "
            f"frequencies: {ANOTHER}"
        )
    found: dict[str, npt.NDArray[Any]] = {}
    for name, stored in (extra or {}).items():
        matrix = beside.matrix(stored)
        if matrix is not None:
            found[name] = shared_channels(frequency_mhz, matrix, cdf.name)[1].astype(np.float32, copy=False)
    sfu = beside.flux_sfu_1au()
    if sfu is not None:
        found["flux_sfu_1au"] = shared_channels(frequency_mhz, sfu, cdf.name)[1].astype(np.float32, copy=False)
    flagged = beside.flagged()
    if flagged is not None:
        found["interpolated"] = _without_flagged(flagged, frequency_mhz, values, cdf.name)
    offset_s = beside.offset_s(time)
    shared_mhz, values = shared_channels(frequency_mhz, values, cdf.name)
    if offset_s is not None:
        offset_s = shared_channels(frequency_mhz, offset_s, cdf.name)[1]
        time, found["sample_time"] = timed(time, offset_s)
        origin = replace(origin, integration_s=min(origin.integration_s, dwell_s(found["sample_time"][0])))
    spectrum = assemble(origin, time, shared_mhz, values, found)
    if "flux_sfu_1au" in spectrum:
        spectrum["flux_sfu_1au"] = spectrum["flux_sfu_1au"].where(np.isfinite(spectrum["intensity"]))
        spectrum["flux_sfu_1au"].attrs = {"long_name": "flux density at 1 au", "units": "sfu"}
    return beside.noted(spectrum)


class Beside:
    """Optional variables of a CDF, in the shape of its intensity.

    Parameters
    ----------
    shape : tuple of int
        Of the intensity, records first.
    variable : str
        Its name in the file.
    others : sequence of str
        Words in the names of variables that belong to another intensity of the file, such as ``RAD2``.

    Attributes
    ----------
    left_out : list of str
        Names of variables that are there and do not fit.
    """

    def __init__(self, cdf: CdfFile, shape: tuple[int, ...], variable: str = "", others: Sequence[str] = ()) -> None:
        self._cdf, self._shape, self._variable = cdf, shape, variable
        self._others = tuple(one.upper() for one in others)
        self.left_out: list[str] = []

    def noted(self, spectrum: xr.Dataset) -> xr.Dataset:
        """A spectrum with the names of what did not fit."""
        return spectrum.assign_attrs(left_out=";".join(self.left_out)) if self.left_out else spectrum

    def offset_s(self, start: TimeArray) -> npt.NDArray[Any] | None:
        """How long after the time of its record each sample was taken, s, NaN where not known; None without any."""
        for name in self._named(TIMES, TIMES_DESCRIBED):
            is_epoch = self._cdf.is_epoch(name)
            offset_s = self._absolute_s(name, start) if is_epoch else self._relative_s(name)
            if offset_s is None:
                if not is_epoch:
                    self._leave_out(name)
                continue
            offset_s[~(np.abs(offset_s) < LONGEST_SWEEP_S)] = np.nan
            if np.isfinite(offset_s).any():
                return offset_s
            self._leave_out(name)
        return None

    def _relative_s(self, name: str) -> npt.NDArray[Any] | None:
        unit = self._cdf.attribute("UNITS", name).lower().strip("[]() ")
        seconds = SECONDS.get(unit) if unit or not NO_UNIT.search(name.upper()) else 1.0
        offset = self.matrix(name) if seconds is not None else None
        return None if offset is None or seconds is None else offset.astype(np.float64) * seconds

    def _absolute_s(self, name: str, start: TimeArray) -> npt.NDArray[Any] | None:
        """Of samples that have times of their own."""
        try:
            times = self._cdf.utc(name, dimensions=None)
        except InputError:
            return None
        if times.ndim < 2 or times.shape != self._shape:  # else they are those of records
            return None
        offset = times - start.reshape(-1, *[1] * (times.ndim - 1))
        offset_s = np.where(np.isnat(offset), np.nan, offset / np.timedelta64(1, "s"))
        return self._fitted(name, offset_s)

    def flagged(self) -> npt.NDArray[np.bool_] | None:
        """Samples that were not measured, in the shape of the intensity; None without flags."""
        found: npt.NDArray[np.bool_] | None = None
        for name in self._named(FLAGS, FLAGS_DESCRIBED, FLAG_LIKE):
            flag = self._flag(name)
            if flag is not None:
                found = flag if found is None else found | flag
        return found

    def shifted(self, time: TimeArray) -> TimeArray:
        """Times of samples that have one each, with their offsets, if the file has any."""
        offset_s = self.offset_s(time)
        return time if offset_s is None else time + np.rint(np.nan_to_num(offset_s) * 1e9).astype("timedelta64[ns]")

    def clear(self, values: npt.NDArray[Any]) -> None:
        """Take away, in place, what was not measured."""
        flagged = self.flagged()
        if flagged is not None:
            values[flagged] = np.nan

    def flux_sfu_1au(self) -> npt.NDArray[Any] | None:
        """Flux density at 1 au, sfu, in the shape of the intensity; None without any."""
        for name in self._named(FLUX_AT_1_AU):
            factor = SFU.get(self._cdf.attribute("UNITS", name).lower().strip("[]() "))
            sfu = self.matrix(name) if factor is not None else None
            if sfu is not None and factor is not None:
                return sfu * np.float32(factor)
            self._leave_out(name)
        return None

    def matrix(self, name: str) -> npt.NDArray[Any] | None:
        """A variable in the shape of the intensity, from one value per record, channel or sample; None if it is none.

        What has a further axis, of antennas, is the mean along it.
        """
        values = self._read(name)
        return None if values is None else self._fitted(name, values)

    def _read(self, name: str) -> npt.NDArray[Any] | None:
        """Values of a variable; None of what is damaged, or longer than the intensity, which is not even read."""
        if self._cdf.record_count(name) <= max(self._shape):
            with suppress(InputError):
                return self._cdf.numbers(name)
        self._leave_out(name)
        return None

    def _fitted(self, name: str, values: npt.NDArray[Any]) -> npt.NDArray[Any] | None:
        wanted = self._shape if self._cdf.varies(name) else self._shape[-1:]
        along = [one for one in range(values.ndim) if (*values.shape[:one], *values.shape[one + 1 :]) == wanted]
        if along and values.shape != self._shape:
            count = np.isfinite(values).sum(axis=along[-1])
            values = np.where(count > 0, np.nansum(values, axis=along[-1]) / np.maximum(count, 1), np.nan)
        if values.shape == self._shape:
            return values
        whole = values.squeeze()
        if len(self._shape) == 2 and whole.shape == self._shape[:1] and self._cdf.varies(name):
            return np.repeat(whole[:, None], self._shape[1], axis=1)
        if whole.ndim <= 1 and whole.shape in {(), self._shape[-1:]}:
            return np.array(np.broadcast_to(whole, self._shape))
        self._leave_out(name)
        return None

    def _flag(self, name: str) -> npt.NDArray[np.bool_] | None:
        """Where a flag says that a sample was interpolated, as far as its description tells what it means."""
        values = self._read(name)
        flagged = None if values is None else interpolated_where(values, name, self._described(name))
        fitted = None if flagged is None else self._fitted(name, flagged.astype(np.float32))
        return None if fitted is None else fitted > 0.0

    def _described(self, name: str) -> str:
        said = " ".join(self._cdf.attribute(one, name) for one in DESCRIPTIONS)
        return flag_words(said, *(self._cdf.attribute(one, name) for one in ("FLAG_VALUES", "FLAG_MEANINGS")))

    def _leave_out(self, name: str) -> None:
        if name not in self.left_out:
            self.left_out.append(name)

    def _named(
        self, names: re.Pattern[str], descriptions: re.Pattern[str] | None = None, like: re.Pattern[str] | None = None
    ) -> list[str]:
        """Variables with data that are named or described so, those that are named so first."""
        own = self._variable.upper()
        for name in self._cdf.variables:
            if names.search(name.upper()) and self._cdf.is_damaged(name):
                self._leave_out(name)
        held = [
            name
            for name in sorted(self._cdf.variables)
            if name != self._variable
            and not any(one in name.upper() and one not in own for one in self._others)
            and self._cdf.has_records(name)
        ]
        named = [name for name in held if names.search(name.upper())]
        if descriptions is None:
            return named
        rest = [name for name in held if name not in named and (like is None or like.search(name.upper()))]
        return named + [name for name in rest if descriptions.search(self._cdf.attribute("CATDESC", name).lower())]


def interpolated_where(values: npt.NDArray[Any], name: str, said: str) -> npt.NDArray[np.bool_] | None:
    """Where a flag says that a sample was interpolated.

    Parameters
    ----------
    values : numpy.ndarray
        Of the flag.
    name, said : str
        Name of its variable, and what is said of its values, lower case.

    Returns
    -------
    numpy.ndarray of bool or None
        None where it is no such flag.
    """
    known = np.isfinite(values)
    is_whole = known & (values == np.rint(np.where(known, values, 0.0)))
    if (known & ~is_whole).any() and "FLAG" not in name.upper():
        return None  # values that were interpolated, no flags
    known &= ~np.isin(values, FLAG_FILLS)
    if found := INTERPOLATED.search(said):
        at = values == int(found[1])
        flagged = ~at if found[2] else at
    elif found := AFTERWARDS.search(said):
        at = values == int(found[2])
        flagged = ~at if found[1] else at
    elif found := MEASURED.search(said):
        flagged = values != int(found[1])
    elif not FLAGS.search(name.upper()):
        return None
    else:
        flagged = (values == 0.0) if re.search(r"(NOT|NON|UN)_?INTERP", name.upper()) else (values != 0.0)
    return np.asarray(flagged & known)


def flag_words(said: str, values: str, meanings: str) -> str:
    """What is said of the values of a flag, with each of them and its meaning."""
    pairs = zip(re.findall(r"-?\d+", values), re.split(r"[\s,;]+", meanings), strict=False)
    return "; ".join([said, *(f"{value}: {meaning.replace('_', ' ')}" for value, meaning in pairs)]).lower()


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


def timed(start: TimeArray, offset_s: npt.NDArray[Any]) -> tuple[TimeArray, TimeArray]:
    """Middle of each record, and the time of each sample; one without an offset has that of the middle.

    Parameters
    ----------
    start : numpy.ndarray
        datetime64[ns], shape (records,).
    offset_s : numpy.ndarray
        Shape (records, channels), NaN where not known.

    Returns
    -------
    tuple of numpy.ndarray
        datetime64[ns], of shapes (records,) and (records, channels).
    """
    middle_s = float(np.nanmedian(0.5 * (np.fmin.reduce(offset_s, axis=1) + np.fmax.reduce(offset_s, axis=1))))
    offset_ns = np.where(np.isfinite(offset_s), offset_s, middle_s)
    offset_ns *= 1e9
    offset = np.rint(offset_ns, out=offset_ns).astype("timedelta64[ns]")
    return start + np.timedelta64(round(middle_s * 1e9), "ns"), start[:, None] + offset


def longest_dwell_s(time: TimeArray, channels: int) -> float:
    """Longest that a receiver which steps through its channels can stay at one, s."""
    return cadence_s(time) / channels

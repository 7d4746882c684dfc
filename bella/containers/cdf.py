"""CDF files, read with cdflib in a process of its own: fill values become NaN, epochs become UTC."""

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cdflib
import numpy as np
import numpy.typing as npt

from bella.containers.bounded import ANOTHER, READER, cpu_limit_s, reading
from bella.exceptions import InputError

TimeArray = npt.NDArray[np.datetime64]
NumberArray = npt.NDArray[np.floating[Any]]

MAGIC = (b"\xcd\xf3\x00\x01", b"\xcd\xf2\x60\x02", b"\x00\x00\xff\xff\x00\x00\xff\xff")
LARGEST_NUMBER = 9.0e29
"""Fill values are -1e31, some -1e30; nothing measured comes near."""

UNIX_EPOCH_MS = 62_167_219_200_000.0
"""1970-01-01 as CDF_EPOCH, ms since the year 0."""

YEAR_9000_MS = 284_012_524_800_000.0
"""A CDF_EPOCH from here on, or not above zero, is a fill value: 9999-12-31 and 0000-01-01 are in use."""

PICOSECONDS = 1e12
"""In a second."""

LOWEST_TT2000 = -(2**63) + 16
"""The first values of the type are fill and pad values."""

FIRST, LAST = np.datetime64("1990-01-01", "ns"), np.datetime64("2060-01-01", "ns")
"""No file of these receivers is older, and none of ours will be read later."""

J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
CDF_EPOCH, CDF_EPOCH16, CDF_TIME_TT2000 = 31, 32, 33
EPOCHS = (CDF_EPOCH, CDF_EPOCH16, CDF_TIME_TT2000)
PREVIOUS, MOST_ADDED = 2, 1 << 24
"""Kind of sparse records that repeat the one before; most values that are made of those that are not stored."""

AT_ONCE = 1 << 16
"""Values that are converted at once, so that what that takes stays small."""

MHZ = {"hz": 1e-6, "khz": 1e-3, "mhz": 1.0, "ghz": 1e3}
MHZ |= {"hertz": 1e-6, "kilohertz": 1e-3, "megahertz": 1.0, "gigahertz": 1e3}


TOO_LOW, TOO_HIGH = 100.0, 300.0
"""Units differ by factors of 1000, and the bands that are read of a receiver by less than these."""

NOT_STATED = 3.0
"""A unit that the file does not state is taken if the band does not end higher by more than this."""


class CdfFile:
    """An open CDF, by what its variables mean.

    Attributes
    ----------
    name : str
        Name of the file, for errors and provenance.
    variables : frozenset of str
        Names of its variables.
    """

    def __init__(self, path: Path) -> None:
        self.name = path.name
        self._cpu_s = cpu_limit_s(path)
        self._described: dict[str, dict[str, Any]] = self._ask("open", str(path.absolute()))
        self.variables: frozenset[str] = frozenset(self._described)
        self._by_plain_name: dict[str, str] = {
            name.strip().lower(): name for name in sorted(self._described, reverse=True)
        }

    def attribute(self, name: str, variable: str | None = None) -> str:
        """Text of an attribute of the file, or of one of its variables; empty where there is none."""
        stored = None if variable is None else self.stored_name(variable)
        value = None if variable is not None and not stored else self._ask("attribute", name, stored)
        return "" if value is None else str(value).strip()

    def stored_name(self, variable: str) -> str:
        """Name of a variable as the file has it, which may differ in case and blanks; empty where there is none."""
        if variable in self.variables:
            return variable
        return str(self._by_plain_name.get(variable.strip().lower(), ""))

    def has_records(self, variable: str) -> bool:
        """Whether anything was written to a variable: many of PSP's have a name and nothing else."""
        return self.record_count(variable) > 0

    def record_count(self, variable: str) -> int:
        """How many records were written to a variable; none where there is no such."""
        stored = self.stored_name(variable)
        return int(self._described[stored]["records"]) if stored else 0

    def is_damaged(self, variable: str) -> bool:
        """Whether a variable is there and cannot be read."""
        stored = self.stored_name(variable)
        return bool(stored and self._described[stored]["fault"])

    def varies(self, variable: str) -> bool:
        """Whether a variable has one value, or row of values, for each record."""
        return bool(self._description(variable)["varies"])

    def first_with_data(self, *variables: str) -> str:
        """The first of some variables that has a value which is no fill value; empty where none has."""
        return next((name for name in variables if self.has_records(name) and self._has_values(name)), "")

    def first_with_records(self, *variables: str) -> str:
        """The first of some variables with data; where none has, the first with records, all of which are fill."""
        return self.first_with_data(*variables) or next(filter(self.has_records, variables), "")

    def _has_values(self, variable: str) -> bool:
        if self.is_epoch(variable):
            return bool((~np.isnat(self.utc(variable))).any())
        try:
            return bool(np.isfinite(self.numbers(variable)).any())
        except InputError:
            return False

    def numbers(self, variable: str, dimensions: int | None = None) -> NumberArray:
        """Values of a variable.

        Parameters
        ----------
        dimensions : int, optional
            How many the array must have, records included; axes of length 1 beyond them are taken away.

        Returns
        -------
        numpy.ndarray
            Float32 where the file has float32, else float64; NaN where the file has a fill value.

        Raises
        ------
        InputError
            If there is no such variable, or if it is empty or has other dimensions.
        """
        stored = self._values(variable, dimensions)
        if not np.issubdtype(stored.dtype, np.number) or np.iscomplexobj(stored):
            raise InputError(f"{self.name}: variable {variable!r} holds no numbers; {ANOTHER}")
        fill = self._ask("attribute", "FILLVAL", self.stored_name(variable))
        values = stored if stored.dtype == np.float32 else stored.astype(np.float64)
        rows, origin = np.atleast_1d(values), np.atleast_1d(stored)
        step = max(AT_ONCE * len(rows) // max(rows.size, 1), 1)
        for begin in range(0, len(rows), step):
            part = rows[begin : begin + step]
            if isinstance(fill, int | float) and np.isfinite(fill):
                part[origin[begin : begin + step] == np.asarray(fill).astype(stored.dtype)] = np.nan
            part[np.abs(part) >= LARGEST_NUMBER] = np.nan
        return values if stored.dtype.kind == "f" else self._scaled(variable, values)

    def _scaled(self, variable: str, values: NumberArray) -> NumberArray:
        """Whole numbers as what they stand for, where the file says how (conventions of CF)."""
        factor, shift = (
            self._ask("attribute", one, self.stored_name(variable)) for one in ("SCALE_FACTOR", "ADD_OFFSET")
        )
        values = values * factor if isinstance(factor, int | float) else values
        return values + shift if isinstance(shift, int | float) else values

    def is_epoch(self, variable: str) -> bool:
        """Whether a variable has times."""
        return bool(self.has_records(variable) and self._described[self.stored_name(variable)]["kind"] in EPOCHS)

    def utc(self, variable: str, dimensions: int | None = 1) -> TimeArray:
        """Times of a variable of type CDF_EPOCH, CDF_EPOCH16 or CDF_TIME_TT2000.

        Parameters
        ----------
        dimensions : int, optional
            How many the array must have.

        Returns
        -------
        numpy.ndarray
            datetime64[ns], UTC; NaT where the file has a fill value.

        Raises
        ------
        InputError
            If there is no such variable, if it is of another type, or if a time is none of the space age.
        """
        kind = self._description(variable)["kind"]
        if kind not in EPOCHS:
            raise InputError(
                f"{self.name}: variable {variable!r} is not CDF_EPOCH, CDF_EPOCH16 or CDF_TIME_TT2000; {ANOTHER}"
            )
        stored = self._values(variable, dimensions)
        stored = _undoubled(stored) if kind == CDF_EPOCH16 else stored
        fill = self._ask("attribute", "FILLVAL", self.stored_name(variable))
        times = np.empty(stored.shape, dtype="datetime64[ns]")
        for begin in range(0, stored.size, AT_ONCE):
            part = stored.reshape(-1)[begin : begin + AT_ONCE]
            found, is_fill = _converted(part, kind)
            if isinstance(fill, int | float):
                is_fill |= part == fill
            if (np.isnat(found) & ~is_fill).any():
                raise InputError(
                    f"{self.name}: {variable} has times that are not between {FIRST.astype('M8[Y]')} and "
                    f"{LAST.astype('M8[Y]')}: its clock is wrong; {ANOTHER}"
                )
            times.reshape(-1)[begin : begin + AT_ONCE] = found
        return times

    def frequency_mhz(self, variable: str, unit: str = "", highest_mhz: float | None = None) -> NumberArray:
        """Frequencies in MHz, from the unit the file states.

        Parameters
        ----------
        variable : str
            Name of the variable.
        unit : str
            Unit to take where the file states none: Hz, kHz or MHz.
        highest_mhz : float, optional
            About where the band of the receiver ends. A unit by which it ends elsewhere, by two powers of ten or more,
            is wrong; one by which it ends there is taken.

        Returns
        -------
        numpy.ndarray
            Float64, MHz; shape (channels,), or (records, channels) where the channels may change.

        Raises
        ------
        InputError
            If there is no such variable, or if its unit is not known.
        """
        values = self.numbers(variable)
        values = values.reshape(values.shape[:1] + tuple(size for size in values.shape[1:] if size > 1))
        if values.ndim == 2 and len(values) and ((values == values[0]) | np.isnan(values)).all():
            values = values[0] if np.isfinite(values[0]).any() else np.fmax.reduce(values)
        stated = re.sub(r"[^a-z]", "", self.attribute("UNITS", variable).lower()) or unit.lower()
        if stated.startswith("log"):
            raise InputError(f"{self.name}: variable {variable!r} holds logarithms: {ANOTHER}")
        if highest_mhz is None:
            if stated not in MHZ:
                raise InputError(
                    f"{self.name}: variable {variable!r} is in {stated!r}, not in Hz, kHz or MHz; {ANOTHER}"
                )
            return values.astype(np.float64) * MHZ[stated]
        return in_mhz(values, stated, highest_mhz, f"{self.name}: variable {variable!r}")

    def _ask(self, do: str, *of: Any) -> Any:
        return READER.ask(do, *of, cpu_s=self._cpu_s)

    def _description(self, variable: str) -> dict[str, Any]:
        stored = self.stored_name(variable)
        if not stored:
            raise InputError(
                f"{self.name} has no variable {variable!r}: it is not the product it is named after; {ANOTHER}"
            )
        if self._described[stored]["fault"]:
            raise InputError(
                f"{self.name}: variable {variable!r} cannot be read ({self._described[stored]['fault']}): download it "
                "again"
            )
        return self._described[stored]

    def _values(self, variable: str, dimensions: int | None) -> npt.NDArray[Any]:
        if self._description(variable)["records"] <= 0:
            raise InputError(f"{self.name}: variable {variable!r} is empty: the receiver was off; leave the file out")
        values = self._whole(variable, self._ask("values", self.stored_name(variable)))
        surplus = 0 if dimensions is None else values.ndim - dimensions
        if surplus > 0:
            single = [axis for axis in range(values.ndim - 1, -1, -1) if values.shape[axis] == 1][:surplus]
            values = values.squeeze(tuple(single))
        if dimensions is not None and values.ndim != dimensions:
            raise InputError(
                f"{self.name}: variable {variable!r} has {values.ndim} dimensions, not {dimensions}; {ANOTHER}"
            )
        return values

    def _whole(self, variable: str, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Records of a sparse variable, with those that are not stored at its end.

        They are as the last one where the file says that the one before counts, else without data.
        """
        sparse = self._description(variable)["sparse"]
        if not sparse or not self.varies(variable):
            return values
        along = self.stored_name(self.attribute("DEPEND_0", variable))
        others = [along] if along and along != self.stored_name(variable) else list(self.variables)
        count = max(self._described[one]["records"] for one in others) - len(values)
        if count <= 0 or not len(values) or count * values[0].size > MOST_ADDED:
            return values
        if sparse == PREVIOUS:
            return np.concatenate([values, np.repeat(values[-1:], count, axis=0)])
        if values.dtype.kind != "f":
            values = values.astype(np.float64)
        return np.concatenate([values, np.full((count, *values.shape[1:]), np.nan, dtype=values.dtype)])


def _converted(stored: npt.NDArray[Any], kind: int) -> tuple[TimeArray, npt.NDArray[np.bool_]]:
    """UTC of times of a type, and which of them are fill values of the type."""
    if kind == CDF_TIME_TT2000:
        counts = stored.astype(np.int64)
        return utc_of_tt2000(counts), counts <= LOWEST_TT2000
    if kind == CDF_EPOCH16:
        times, epoch_ms = utc_of_cdf_epoch16(stored), stored.real * 1e3
    else:
        times, epoch_ms = utc_of_cdf_epoch(stored), stored.real
    return times, ~((epoch_ms > 0.0) & (epoch_ms < YEAR_9000_MS))


def in_mhz(values: npt.NDArray[Any], unit: str, highest_mhz: float, what: str) -> npt.NDArray[np.float64]:
    """Frequencies in MHz, in the unit that is stated if by it they end about where the band of the receiver does.

    Parameters
    ----------
    unit : str
        What the file states, lower case; another is tried where this is none, or cannot be.
    highest_mhz : float
        About where the band ends.
    what : str
        Named in the error.

    Returns
    -------
    numpy.ndarray
        Float64, MHz.

    Raises
    ------
    InputError
        If they end there in no unit.
    """
    highest = float(np.nanmax(values, initial=0.0))
    for one in ([unit] if unit in MHZ else []) + ["hz", "khz", "mhz"]:
        if highest_mhz / TOO_LOW < highest * MHZ[one] < highest_mhz * (TOO_HIGH if one == unit else NOT_STATED):
            return values.astype(np.float64) * MHZ[one]
    raise InputError(
        f"{what} reaches {highest:g}, which in no unit is near the {highest_mhz:g} MHz of this receiver: take another "
        "version of the file"
    )


@contextmanager
def open_cdf(path: Path) -> Iterator[CdfFile]:
    """Open a CDF, packed as .cdf.gz too; whatever goes wrong while it is open is raised as an error of this file.

    Yields
    ------
    CdfFile
        The open file; no other one can be open at the same time.

    Raises
    ------
    InputError
        If it is damaged, or cannot be read within the limits of :mod:`bella.containers.bounded`.
    """
    with READER.lock, reading(str(path), "CDF"):
        try:
            yield CdfFile(path)
        finally:
            with suppress(ValueError):
                READER.ask("close")


def utc_of_cdf_epoch(epoch_ms: npt.NDArray[np.float64]) -> TimeArray:
    """UTC of CDF_EPOCH, which knows no leap seconds.

    Parameters
    ----------
    epoch_ms : numpy.ndarray
        Milliseconds since the year 0.

    Returns
    -------
    numpy.ndarray
        datetime64[ns], to the microsecond the float can hold; NaT outside 1990 to 2060.
    """
    unix_us = (np.asarray(epoch_ms, dtype=np.float64) - UNIX_EPOCH_MS) * 1e3
    usable = (unix_us >= _us(FIRST)) & (unix_us < _us(LAST))
    times = np.round(np.where(usable, unix_us, 0.0)).astype("datetime64[us]").astype("datetime64[ns]")
    times[~usable] = np.datetime64("NaT")
    return times


def utc_of_cdf_epoch16(epoch: npt.NDArray[np.complex128]) -> TimeArray:
    """UTC of CDF_EPOCH16, which knows no leap seconds.

    Parameters
    ----------
    epoch : numpy.ndarray
        Seconds since the year 0 as the real part, picoseconds within the second as the imaginary one.

    Returns
    -------
    numpy.ndarray
        datetime64[ns]; NaT outside 1990 to 2060, and where the picoseconds are not those of a second.
    """
    stored = np.asarray(epoch, dtype=np.complex128)
    usable = (stored.imag >= 0.0) & (stored.imag < PICOSECONDS) & (stored.real == np.rint(stored.real))
    times = utc_of_cdf_epoch(np.where(usable, stored.real * 1e3, np.nan))
    within_ns = np.rint(np.where(usable, stored.imag, 0.0) * 1e-3)
    return np.asarray(times + within_ns.astype("timedelta64[ns]"))


def _undoubled(epoch: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
    """Times of a CDF_EPOCH16 that cdflib wrote: seconds and picoseconds as records of their own (cdflib 1.3)."""
    if epoch.ndim != 1 or epoch.size % 2 or epoch.imag.any():
        return epoch
    seconds, picoseconds = epoch.real[::2], epoch.real[1::2]
    if (picoseconds >= PICOSECONDS).any() or not np.isnat(utc_of_cdf_epoch(picoseconds * 1e3)).any():
        return epoch
    return seconds + 1j * picoseconds


def utc_of_tt2000(tt2000_ns: npt.NDArray[np.int64]) -> TimeArray:
    """UTC of CDF_TIME_TT2000, which counts Terrestrial Time: 66.184 s ahead in June 2012, 69.184 s since 2017.

    Parameters
    ----------
    tt2000_ns : numpy.ndarray
        Nanoseconds since 2000-01-01 12:00 TT.

    Returns
    -------
    numpy.ndarray
        datetime64[ns], by the table of leap seconds; NaT outside 1990 to 2060.
    """
    stored = np.asarray(tt2000_ns, dtype=np.int64)
    usable = (stored >= (FIRST - J2000).astype(np.int64)) & (stored < (LAST - J2000).astype(np.int64))
    times = np.full(stored.shape, np.datetime64("NaT"), dtype="datetime64[ns]")
    if not usable.any():
        return times
    ends = np.array([stored[usable].min(), stored[usable].max()])
    ahead = ends - (np.asarray(cdflib.cdfepoch.to_datetime(ends)) - J2000).astype(np.int64)
    if ahead[0] == ahead[1]:  # the leap seconds only grow: none lies between
        times[usable] = J2000 + (stored[usable] - ahead[0]).astype("timedelta64[ns]")
        return times
    times[usable] = np.asarray(cdflib.cdfepoch.to_datetime(stored[usable]))
    return times


def _us(time: np.datetime64) -> float:
    return float(time.astype("datetime64[us]").astype(np.int64))

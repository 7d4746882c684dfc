"""CDF files, read with cdflib behind bounds: fill values become NaN, epochs become UTC."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import cdflib
import numpy as np
import numpy.typing as npt

from bella.exceptions import InputError
from bella.spectra.bounded import INFLATED_BYTES, BoundedStream, inflate, reading

TimeArray = npt.NDArray[np.datetime64]
NumberArray = npt.NDArray[np.floating[Any]]

MAGIC = (b"\xcd\xf3\x00\x01", b"\xcd\xf2\x60\x02", b"\x00\x00\xff\xff")
UNCOMPRESSED = b"\xcd\xf3\x00\x01\x00\x00\xff\xff"
COMPRESSED = b"\xcd\xf3\x00\x01\xcc\xcc\x00\x01"

LARGEST_NUMBER = 9.0e29
"""Fill values are -1e31, some -1e30; nothing measured comes near."""

DEFLATE_RATIO = 1032
"""The most that deflate can shrink anything (RFC 1951)."""

RECORDS, DIMENSIONS, LONGEST_TEXT = 2_000_000, 10, 1 << 16
"""More records than a day has, the most dimensions that CDF allows, and more characters than any text has."""

TEXTS, Z_VARIABLE, LARGEST_WIDTH = (51, 52), 8, 8
UNIX_EPOCH_MS = 62_167_219_200_000.0
"""1970-01-01 as CDF_EPOCH, ms since the year 0."""

FIRST, LAST = np.datetime64("1990-01-01", "ns"), np.datetime64("2060-01-01", "ns")
J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
CDF_EPOCH, CDF_TIME_TT2000 = 31, 33
AT_ONCE = 2048
"""Values that are converted at once, so that what that takes stays small: 280 bytes for each time in cdflib."""
MHZ = {"hz": 1e-6, "khz": 1e-3, "mhz": 1.0}


class _BoundedCdf(cdflib.CDF):  # type: ignore[misc]
    """cdflib's reader on a bounded stream.

    cdflib 1.3 allocates what a descriptor claims before it looks at the data, and follows lists as long as a counter
    says; both come straight from the file. It also copies values twice more than is needed.
    """

    _is_swapped = False
    """Whether the values at hand are in the byte order of this machine already."""
    _followed: frozenset[int] = frozenset()

    def _file_or_url_or_s3_handler(self, filename: str, filetype: str, s3_read_method: int) -> BoundedStream:
        del filetype, s3_read_method
        self._inflated_left = INFLATED_BYTES
        self._f = stream = BoundedStream(Path(filename).open("rb"))  # noqa: SIM115 - cdflib closes it
        if stream.size >= 8 and stream.read(8) == COMPRESSED:
            record_size = int.from_bytes(stream.read(8), "big")
            stream.seek(40)
            content = self._inflate(stream.read(record_size - 32))
            stream.close()
            stream = BoundedStream(BytesIO(UNCOMPRESSED + content))
        stream.seek(0)
        return stream

    def _uncompress_file(self) -> None:
        raise ValueError("it is compressed as a whole in a way that CDF 3 does not use")

    def _read_gdr(self, byte_loc: int) -> Any:
        self._check_count(byte_loc + 56, DIMENSIONS)
        return self._whole(super()._read_gdr(byte_loc))

    def _read_gdr2(self, byte_loc: int) -> Any:
        self._check_count(byte_loc + 36, DIMENSIONS)
        return self._whole(super()._read_gdr2(byte_loc))

    def _read_vdr3(self, byte_loc: int) -> Any:
        self._check_count(byte_loc + 64, LONGEST_TEXT)
        if self._integer(byte_loc + 8) == Z_VARIABLE:
            self._check_count(byte_loc + 340, DIMENSIONS)
        return super()._read_vdr3(byte_loc)

    def _read_vdr2(self, byte_loc: int) -> Any:
        begin = byte_loc if self._post25 is True else byte_loc + 128
        self._check_count(begin + 48, LONGEST_TEXT)
        if self._integer(byte_loc + 4) == Z_VARIABLE:
            self._check_count(begin + 128, DIMENSIONS)
        return super()._read_vdr2(byte_loc)

    def _read_vxrs(self, byte_loc: int, *found: Any, **named: Any) -> Any:
        return self._once(super()._read_vxrs, byte_loc, *found, **named)

    def _read_vxrs2(self, byte_loc: int, *found: Any, **named: Any) -> Any:
        return self._once(super()._read_vxrs2, byte_loc, *found, **named)

    def _once(self, follow: Callable[..., Any], byte_loc: int, *found: Any, **named: Any) -> Any:
        """Follow no record of an index twice: cdflib would go on to the recursion limit, which PyTensor raises."""
        before = self._followed
        if byte_loc in before:
            raise ValueError("its index comes back to itself")
        self._followed = before | {byte_loc}
        result = follow(byte_loc, *found, **named)
        self._followed = self._followed if before else before
        return result

    def _integer(self, offset: int) -> int:
        self._f.seek(offset)
        return int.from_bytes(self._f.read(4), "big", signed=True)

    def _check_count(self, offset: int, most: int) -> None:
        """Hold a count of what cdflib will loop over or reserve, without reading, against what there can be."""
        count = self._integer(offset)
        if count > most:
            raise ValueError(f"a descriptor claims a count of {count}")

    def _whole(self, description: Any) -> Any:
        if description.eof > self._f.size:
            raise ValueError(f"it ends early: {self._f.size} of {description.eof} bytes")
        return description

    def _inflate(self, compressed: bytes) -> bytearray:
        content = inflate(compressed, self._inflated_left)
        self._inflated_left -= len(content)
        return content

    def _read_vvr_block(self, offset: int) -> bytes | bytearray:
        return self._block(offset, 8)

    def _read_vvr_block2(self, offset: int) -> bytes | bytearray:
        return self._block(offset, 4)

    def _block(self, offset: int, width: int) -> bytes | bytearray:
        """Values of one record of the file, decompressed; `width` is that of its integers, bytes."""
        self._f.seek(offset)
        block = self._f.read(int.from_bytes(self._f.read(width), "big") - width)
        kind = int.from_bytes(block[:4], "big")
        if kind == 7:
            return bytes(block[4:])
        if kind != 13:
            raise ValueError("a record of values is of another kind")
        begin = 8 + width
        return self._inflate(block[begin : begin + int.from_bytes(block[8:begin], "big")])

    def _read_vvrs(self, vdr: Any, *blocks_and_records: Any) -> Any:
        records = blocks_and_records[-1] - blocks_and_records[-2] + 1
        claimed = self._type_size(vdr.data_type, vdr.num_elements) * self._num_values(vdr) * records
        swell = DEFLATE_RATIO if vdr.compression_bool else 4
        if vdr.data_type in TEXTS:
            raise ValueError(f"variable {vdr.name!r} holds text")
        if records > RECORDS or not 0 <= claimed <= min(swell * self._f.size, INFLATED_BYTES):
            raise ValueError(f"variable {vdr.name!r} claims {records} records of {claimed} bytes")
        offsets, first = blocks_and_records[0], blocks_and_records[-2]
        width = self._type_size(vdr.data_type, vdr.num_elements)
        if vdr.sparse or first or width > LARGEST_WIDTH:
            return super()._read_vvrs(vdr, *blocks_and_records)
        return self._in_place(vdr, self._joined(offsets, claimed, vdr.name), width)

    def _in_place(self, vdr: Any, content: bytearray, width: int) -> npt.NDArray[Any]:
        """Numbers of a variable in the memory of its bytes, `width` each."""
        dimensions = [size for size, varies in zip(vdr.dim_sizes, vdr.dim_vary, strict=True) if varies]
        records = len(content) // (width * max(self._num_values(vdr), 1))
        if self._convert_option() != "=":
            np.frombuffer(content, dtype=f"u{width}").byteswap(inplace=True)
        self._is_swapped = True
        try:
            return np.asarray(self._read_data(content, vdr.data_type, records, vdr.num_elements, dimensions))
        finally:
            self._is_swapped = False

    def _convert_option(self) -> str:
        return "=" if self._is_swapped else str(super()._convert_option())

    def _joined(self, offsets: list[int], size: int, name: str) -> bytearray:
        """The first bytes of all blocks of a variable; cdflib would copy them once more."""
        content, filled = bytearray(size), 0
        for offset in offsets:
            block = self._block(offset, 8 if self.cdfversion == 3 else 4)[: size - filled]
            content[filled : filled + len(block)] = block
            filled += len(block)
            if filled == size:
                return content
        raise ValueError(f"variable {name!r} has {filled} bytes of {size}")


class CdfFile:
    """An open CDF, by what its variables mean.

    Parameters
    ----------
    cdf : cdflib.CDF
        The open file.
    name : str
        Name of the file, for errors and provenance.

    Attributes
    ----------
    variables : frozenset of str
        Names of its variables.
    """

    def __init__(self, cdf: Any, name: str) -> None:
        self._cdf = cdf
        self.name = name
        contents = cdf.cdf_info()
        self.variables = frozenset([*contents.zVariables, *contents.rVariables])

    def attribute(self, name: str, variable: str | int = 0) -> str:
        """Text of a global attribute, or of an attribute of a variable; empty where there is none."""
        return str(self._attribute(name, variable)).strip()

    def has_records(self, variable: str) -> bool:
        """Whether anything was written to a variable: many of PSP's have a name and nothing else."""
        return variable in self.variables and int(self._descriptor(variable).Last_Rec) >= 0

    def dimensions(self, variable: str) -> int:
        """How many dimensions a variable has, records included."""
        descriptor = self._descriptor(variable)
        return len(descriptor.Dim_Sizes) + bool(descriptor.Rec_Vary)

    def numbers(self, variable: str, dimensions: int) -> NumberArray:
        """Values of a variable.

        Parameters
        ----------
        variable : str
            Its name.
        dimensions : int
            How many the array must have, records included.

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
        fill = self._number(self._attribute("FILLVAL", variable))
        if not np.issubdtype(stored.dtype, np.number):
            raise InputError(f"{self.name}: variable {variable!r} holds no numbers")
        values = stored if stored.dtype == np.float32 else stored.astype(np.float64)
        step = max(AT_ONCE * len(values) // max(values.size, 1), 1) if values.ndim else 1
        for begin in range(0, len(values) if values.ndim else 0, step):
            part = values[begin : begin + step]
            if np.isfinite(fill):
                part[stored[begin : begin + step] == fill] = np.nan
            part[np.abs(part) >= LARGEST_NUMBER] = np.nan
        return values

    def utc(self, variable: str) -> TimeArray:
        """Times of a variable of type CDF_EPOCH or CDF_TIME_TT2000.

        Parameters
        ----------
        variable : str
            Its name.

        Returns
        -------
        numpy.ndarray
            datetime64[ns], UTC, shape (records,); NaT where the file has a fill value or no time of the space age.

        Raises
        ------
        InputError
            If there is no such variable, or if it is of another type.
        """
        kind = self._descriptor(variable).Data_Type
        if kind not in {CDF_EPOCH, CDF_TIME_TT2000}:
            raise InputError(f"{self.name}: variable {variable!r} is not CDF_EPOCH or CDF_TIME_TT2000")
        stored = self._values(variable, 1)
        return utc_of_tt2000(stored) if kind == CDF_TIME_TT2000 else utc_of_cdf_epoch(stored)

    def frequency_mhz(self, variable: str, unit: str = "") -> NumberArray:
        """Frequencies in MHz, from the unit the file states.

        Parameters
        ----------
        variable : str
            Name of the variable.
        unit : str
            Unit to take where the file states none: Hz, kHz or MHz.

        Returns
        -------
        numpy.ndarray
            Float64, MHz; shape (channels,), or (records, channels) where the channels may change.

        Raises
        ------
        InputError
            If there is no such variable, or if its unit is not known.
        """
        values = self.numbers(variable, self.dimensions(variable))
        stated = re.sub(r"[^a-z]", "", self.attribute("UNITS", variable).lower()) or unit.lower()
        if stated not in MHZ:
            raise InputError(f"{self.name}: variable {variable!r} is in {stated!r}, not in Hz, kHz or MHz")
        if values.ndim == 2 and len(values) and (values == values[0]).all():
            values = values[0]
        return values.astype(np.float64) * MHZ[stated]

    def _descriptor(self, variable: str) -> Any:
        if variable not in self.variables:
            raise InputError(f"{self.name} has no variable {variable!r}: it is not the product it is named after")
        return self._cdf.varinq(variable)

    def _values(self, variable: str, dimensions: int) -> npt.NDArray[Any]:
        if self._descriptor(variable).Last_Rec < 0:
            raise InputError(f"{self.name}: variable {variable!r} is empty")
        values = np.asarray(self._cdf.varget(variable))
        if values.ndim != dimensions:
            raise InputError(f"{self.name}: variable {variable!r} has {values.ndim} dimensions, not {dimensions}")
        return values

    def _attribute(self, name: str, variable: str | int) -> Any:
        try:
            return self._cdf.attget(name, variable).Data
        except (KeyError, ValueError):
            return ""

    @staticmethod
    def _number(value: Any) -> float:
        return float(value) if np.ndim(value) == 0 and isinstance(value, (int, float, np.number)) else np.nan


@contextmanager
def open_cdf(path: Path) -> Iterator[CdfFile]:
    """Open a CDF; whatever goes wrong while it is open is told as an error of this file.

    Parameters
    ----------
    path : pathlib.Path
        The file.

    Yields
    ------
    CdfFile
        The open file.

    Raises
    ------
    InputError
        If it is damaged or no CDF.
    """
    with reading(str(path), "CDF"):
        yield CdfFile(_BoundedCdf(path), path.name)


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
    for begin in range(0, stored.size, AT_ONCE):
        part = slice(begin, begin + AT_ONCE)
        known = stored[part][usable[part]]
        if known.size:
            times[part][usable[part]] = np.asarray(cdflib.cdfepoch.to_datetime(known))
    return times


def _us(time: np.datetime64) -> float:
    return float(time.astype("datetime64[us]").astype(np.int64))

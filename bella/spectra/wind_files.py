"""Wind/WAVES files that are no CDFs: the 60-s binary of CDPP and the IDL save sets of the 1-minute averages."""

import re
import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.io import readsav

from bella.exceptions import InputError
from bella.spectra.assembly import Origin, assemble, shared_channels
from bella.spectra.bounded import inflate, reading
from bella.spectra.dynamic_spectrum import GEOCENTRIC
from bella.spectra.given_positions import EARTH_RADIUS_KM, with_positions
from bella.spectra.list_mode import with_visits
from bella.spectra.sweep_minutes import with_sweeps

OBSERVATORY = "WIND"
LARGEST_FILE = 64 << 20
HEADER = struct.Struct(">8s h i 6h 3h 3f".replace(" ", ""))
LENGTH = struct.Struct(">i")
MOST_CHANNELS = 1024
CALENDAR_1950 = np.datetime64("1950-01-01", "ns")
UNITS = {2: ("psd_v2_hz", 1.0), 3: ("psd_v2_hz", 1e-12), 4: ("flux_w_m2_hz", 1e-22)}
"""Quantity, and factor to V^2/Hz or W/m^2/Hz, by the unit code of the binary; code 1, telemetry volts, has neither."""

IDL_MAGIC = b"SR\x00\x04"
IDL_COMPRESSED = b"SR\x00\x06"
IDL_VARIABLE, IDL_END = 2, 6
IDL_ARRAY_FLAG, IDL_ARRAY = 4, 8
BANDS_MHZ = {"rad1": (0.020, 1.040), "rad2": (1.075, 13.825)}
CHANNELS = 256
MINUTES = 1440


def read_60s(path: Path, receiver: str) -> tuple[xr.Dataset, ...]:
    """60-s averages of CDPP, the product the original BELLA read.

    Not yet run on an archive file: written to the published description of the product.

    Parameters
    ----------
    path : pathlib.Path
        Big-endian sequential records.
    receiver : str
        rad1, rad2 or tnr.

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``psd_v2_hz`` or, where the file has solar flux units, ``flux_w_m2_hz``;
        ``position_km`` is where Wind was, GSE, and the attribute ``position_gse_re`` its mean of the day, Earth radii.

    Raises
    ------
    InputError
        If the file is damaged or of another product.
    """
    with reading(str(path), "a Wind 60-s binary"):
        records = _records(_content(path))
        headers = [header for header, _ in records]
        units = {header[10] for header in headers}
        if len(units) != 1 or units <= {1} or not units <= set(UNITS):
            raise InputError(f"{path.name} is in units {sorted(units)}: only one of {sorted(UNITS)} has a meaning here")
        quantity, factor = UNITS[units.pop()]
        frequency_khz, mean = _matrix([block[0] for _, block in records]), _matrix([block[1] for _, block in records])
        mean[~((mean > 0.0) & (mean < 1e30))] = np.nan
        frequency_mhz, mean = shared_channels(frequency_khz * 1e-3, mean * factor, path.name)
        time = CALENDAR_1950 + np.array([header[2] for header in headers], dtype="timedelta64[s]")
        origin = Origin(OBSERVATORY, receiver.upper(), quantity, path.name)
        position_re = np.array([header[-3:] for header in headers], dtype=np.float64)
        return (_placed(assemble(origin, time.astype("datetime64[ns]"), frequency_mhz, mean), time, position_re),)


def _placed(spectrum: xr.Dataset, time: npt.NDArray[np.datetime64], position_re: npt.NDArray[np.float64]) -> xr.Dataset:
    """With the position of each record, GSE; the centre of Earth is no position."""
    there_km = np.where(position_re.any(axis=1, keepdims=True), position_re, np.nan) * EARTH_RADIUS_KM
    placed = with_positions(spectrum, time.astype("datetime64[ns]"), there_km, GEOCENTRIC)
    return placed.assign_attrs(position_gse_re=position_re.mean(axis=0).tolist())


def read_idl(path: Path, receiver: str) -> tuple[xr.Dataset, ...]:
    """1-minute averages as an IDL save set: the same values as in the H1 CDF.

    Not yet run on an archive file: written to the published description of the product. Frequencies are not stored in
    the file but agreed on; channels without a background are flagged ``interpolated``, and the times of samples are
    found as in H1.

    Parameters
    ----------
    path : pathlib.Path
        Save set with the variable ``arrayb``.
    receiver : str
        rad1 or rad2, or r1 or r2.

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``voltage_ratio``, shape (1440, 256).

    Raises
    ------
    InputError
        If the file is damaged, of another product, or has no date in its name.
    """
    band = "rad" + receiver[-1]
    midnight = date_of(path.name)
    with reading(str(path), "an IDL save set"):
        _walk_idl(_content(path))
        stored = readsav(str(path))
        if "arrayb" not in stored or np.shape(stored["arrayb"]) != (MINUTES + 1, CHANNELS):
            raise InputError(f"{path.name} has no array 'arrayb' of {CHANNELS} channels and {MINUTES + 1} columns")
        columns = np.asarray(stored["arrayb"], dtype=np.float32)
    ratio, background = np.where(columns[:-1] > 0.0, columns[:-1], np.nan), columns[-1]
    time = midnight + np.arange(MINUTES) * np.timedelta64(60, "s") + np.timedelta64(30, "s")
    origin = Origin(OBSERVATORY, band.upper(), "voltage_ratio", path.name)
    spectrum = assemble(
        origin, time, np.linspace(*BANDS_MHZ[band], CHANNELS), ratio, {"interpolated": ~(background > 0.0)}
    )
    return (with_visits(spectrum) if band == "rad1" else with_sweeps(spectrum),)


def date_of(name: str) -> np.datetime64:
    """Midnight of the day in the name of a file that states no date itself.

    Parameters
    ----------
    name : str
        Name with eight digits YYYYMMDD in it.

    Returns
    -------
    numpy.datetime64
        UTC, ns.

    Raises
    ------
    InputError
        If there is no date.
    """
    found = re.search(r"(?<!\d)(\d{4})(\d{2})(\d{2})(?!\d)", name)
    try:
        day = np.datetime64("-".join(found.groups()) if found else "NaT", "ns")
    except ValueError as error:
        raise InputError(f"{name} does not say of which day it is: name it ..._YYYYMMDD...") from error
    if np.isnat(day):
        raise InputError(f"{name} does not say of which day it is: name it ..._YYYYMMDD...")
    return day


def _content(path: Path) -> bytes:
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise InputError(f"{path.name} has {size} bytes, too many for one day of this product")
    return path.read_bytes()


def _records(content: bytes) -> list[tuple[tuple[int, ...], npt.NDArray[np.float64]]]:
    """Header and the rows frequency, mean, minimum and maximum of every record."""
    records, position = [], 0
    while position < len(content):
        length = LENGTH.unpack_from(content, position)[0]
        header = HEADER.unpack_from(content, position + LENGTH.size)
        channels = header[11]
        end = position + LENGTH.size + length
        if not 0 < channels <= MOST_CHANNELS or length != HEADER.size + 16 * channels:
            raise ValueError(f"the record at byte {position} has {length} bytes for {channels} channels")
        if LENGTH.unpack_from(content, end)[0] != length:
            raise ValueError(f"the record at byte {position} ends with another length than it begins with")
        begin = position + LENGTH.size + HEADER.size
        block = np.frombuffer(content, dtype=">f4", count=4 * channels, offset=begin).reshape(4, channels)
        records.append((header, block.astype(np.float64)))
        position = end + LENGTH.size
    return records


def _matrix(rows: list[npt.NDArray[np.float64]]) -> npt.NDArray[np.float64]:
    """Rows of different lengths, filled up with NaN."""
    matrix = np.full((len(rows), max(map(len, rows))), np.nan)
    for row, values in zip(matrix, rows, strict=True):
        row[: len(values)] = values
    return matrix


def _walk_idl(content: bytes) -> None:
    """Follow the chain of records to its end, which scipy does without asking whether there is one."""
    if content[:4] not in {IDL_MAGIC, IDL_COMPRESSED}:
        raise ValueError("it does not begin as one")
    position, left = 4, LARGEST_FILE
    while position + 16 <= len(content):
        kind, low, high = struct.unpack_from(">iII", content, position)
        if kind == IDL_END:
            return
        following = low + (high << 32)
        if following <= position:
            raise ValueError("its records run in a circle")
        payload = content[position + 16 : following]
        if content[:4] == IDL_COMPRESSED:
            payload = bytes(inflate(payload, left))
            left -= len(payload)
        if kind == IDL_VARIABLE:
            _check_array(payload)
        position = following
    raise ValueError("it ends early")


def _check_array(variable: bytes) -> None:
    """Hold the size that an array claims, which scipy would reserve, against that of its record."""
    name_length = struct.unpack_from(">i", variable)[0]
    _, flags, kind, _, claimed, elements = struct.unpack_from(">6i", variable, 4 + -(-name_length // 4) * 4)
    if flags & IDL_ARRAY_FLAG and (kind != IDL_ARRAY or not 0 <= max(claimed, elements) <= len(variable)):
        raise ValueError(f"an array claims {claimed} bytes in a record of {len(variable)}")

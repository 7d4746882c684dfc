"""Wind/WAVES: CDFs, the 60-s binary of CDPP, and the IDL save sets of the 1-minute averages.

The CDFs are at 1 minute (H1), at native cadence (L2), key parameters (K0), and RAD1 direction finding (L3).
"""

import struct
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.io import readsav

from bella.containers import ANOTHER, CdfFile, NumberArray, in_mhz, inflate, reading
from bella.exceptions import InputError
from bella.spectra.assembly import Origin, assemble, assemble_sweeps, cadence_s, date_of, shared_channels
from bella.spectra.beside import Beside, epoch_of, read_records, timed
from bella.spectra.dynamic_spectrum import GEOCENTRIC, in_unit
from bella.spectra.minutes import with_sweeps, with_visits
from bella.spectra.positions import EARTH_RADIUS_KM, with_positions

OBSERVATORY = "WIND"
HIGHEST_MHZ = {"rad1": 1.04, "rad2": 13.825, "tnr": 0.256}
ANGLES = ("colatitude", "azimuth")
DENSITIES = ("PSD_V2_SP", "PSD_V2_Z", "PSD_V2_S", "PSD_V2")
"""Antennas of L2, the best first: the summed pair, along the spin axis, in the spin plane; TNR has one."""

AS_FULL = 0.02
"""Another antenna is taken where it has so much more data."""

DIRECTIONS = {
    **{f"wave_{angle}_{frame}_deg": f"WAVE_{angle}_{frame}".upper() for frame in ("rtn", "srf") for angle in ANGLES},
    "source_size_deg": "SOURCE_SIZE",
    "modulation_rate": "MODULATION_RATE",
}

LARGEST_FILE = 64 << 20
HEADER = struct.Struct(">8s h i 6h 3h 3f".replace(" ", ""))
LENGTH = struct.Struct(">i")
MOST_CHANNELS = 1024
CALENDAR_1950 = np.datetime64("1950-01-01", "s")
WRAP_S = 1 << 32
UNITS = {2: ("psd_v2_hz", 1.0), 3: ("psd_v2_hz", 1e-12), 4: ("flux_w_m2_hz", 1e-22)}
"""Quantity, and factor to V^2/Hz or W/m^2/Hz, by the unit code of the binary; code 1, telemetry volts, has neither."""

IDL_MAGIC = b"SR\x00\x04"
IDL_COMPRESSED = b"SR\x00\x06"
IDL_VARIABLE, IDL_END = 2, 6
IDL_ARRAY_FLAG, IDL_ARRAY = 4, 8
BANDS_MHZ = {"rad1": (0.020, 1.040), "rad2": (1.075, 13.825)}
CHANNELS = 256
MINUTES = 1440


def read_h1(cdf: CdfFile, receiver: str = "") -> tuple[xr.Dataset, ...]:
    """RAD1, RAD2 and TNR of a day at 1 minute, as ratios of voltage to the background of the day.

    Run on the archive file of 2010-01-17. A channel whose background is zero was interpolated between measured ones,
    and is flagged ``interpolated``; a ratio of zero is no data. Ratios of two days have two backgrounds. What the list
    mode of RAD1 did not visit in a minute is NaN, and samples have the time of the visit
    (:mod:`bella.spectra.minutes`); those of RAD2 the mean time of the sweeps in the minute
    (:mod:`bella.spectra.minutes`).

    Parameters
    ----------
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
    held = [name for name in ("TNR", "RAD1", "RAD2") if cdf.first_with_data(f"E_VOLTAGE_{name}")]
    if not held:
        raise InputError(
            f"{cdf.name} holds no data of RAD1, RAD2 or TNR: it is not the product it is named after; {ANOTHER}"
        )
    time = cdf.utc(epoch_of(cdf, f"E_VOLTAGE_{held[-1]}"))
    # least memory is used at a time if those come last that take least to read
    by_name = {name: _h1_receiver(cdf, name, time) for name in held}
    return tuple(by_name[name] for name in ("RAD1", "RAD2", "TNR") if name in by_name)


def _h1_receiver(cdf: CdfFile, receiver: str, time: np.ndarray) -> xr.Dataset:
    ratio = cdf.numbers(f"E_VOLTAGE_{receiver}", 2)
    ratio[~(ratio > 0.0)] = np.nan
    beside = Beside(cdf, ratio.shape, f"E_VOLTAGE_{receiver}", ("TNR", "RAD1", "RAD2"))
    beside.clear(ratio)
    offset_s = beside.offset_s(time)
    name = f"Minimum_voltage_{receiver}"
    background = cdf.numbers(name).reshape(-1)[: ratio.shape[1]] if cdf.has_records(name) else np.ones(ratio.shape[1])
    stated_mhz = cdf.frequency_mhz(f"Frequency_{receiver}", "kHz", HIGHEST_MHZ[receiver.lower()])
    frequency_mhz, ratio = shared_channels(stated_mhz, ratio, cdf.name)
    origin = Origin(OBSERVATORY, receiver, "voltage_ratio", cdf.name)
    extra: dict[str, npt.NDArray[Any]] = {"interpolated": ~(background > 0.0)}
    if offset_s is not None:
        time, extra["sample_time"] = timed(time, offset_s)
    spectrum = beside.noted(assemble(origin, time, frequency_mhz, ratio, extra))
    by_name = {"RAD1": with_visits, "RAD2": with_sweeps} if offset_s is None else {}
    return by_name[receiver](spectrum) if receiver in by_name else spectrum


def read_l2(cdf: CdfFile, receiver: str) -> tuple[xr.Dataset, ...]:
    """RAD1, RAD2 or TNR at native cadence, V^2/Hz before antenna calibration.

    Not yet run on an archive file: written to the published description of the product. The summed pair of antennas
    (SP) is read, as the spacecraft's spin shows least in it; where it lacks data that the one along the spin axis (Z)
    or the one in the spin plane (S) has, that one: the attribute ``antenna``. Of the 256 columns those without data,
    which the receiver did not visit, are dropped, unless none has any. A file is not a civil day. RAD1 and RAD2 step
    through their channels (Bougeret et al. 1995, Space Sci. Rev. 71, 231, doi:10.1007/BF00751331), so that a sample
    takes no longer than a record over the number of samples in it.

    Parameters
    ----------
    receiver : str
        rad1, rad2 or tnr.

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``psd_v2_hz``.

    Raises
    ------
    InputError
        If the file is not of this product or holds no records.
    """
    time, stated_mhz = cdf.utc(epoch_of(cdf)), cdf.frequency_mhz("FREQUENCY", "Hz", HIGHEST_MHZ[receiver])
    variable, density = _fullest(cdf, DENSITIES)
    frequency_mhz = stated_mhz if stated_mhz.ndim == 2 else stated_mhz[: density.shape[1]]
    if frequency_mhz.shape[-1] != density.shape[1]:
        raise InputError(
            f"{cdf.name}: {stated_mhz.shape[-1]} frequencies for {density.shape[1]} columns of {variable}; {ANOTHER}"
        )
    each = max(1.0, float(np.median(np.isfinite(density).sum(axis=1))))
    longest_s = np.inf if receiver == "tnr" else cadence_s(time) / each
    origin = Origin(OBSERVATORY, receiver.upper(), "psd_v2_hz", cdf.name, longest_s)
    spectrum = read_records(cdf, origin, variable, time, frequency_mhz, density)
    visited = np.isfinite(np.fmax.reduce(spectrum["intensity"].to_numpy()))
    if visited.any() and not visited.all():
        spectrum = spectrum.isel(frequency=np.flatnonzero(visited))
    return (spectrum.assign_attrs(antenna=variable),)


def _fullest(cdf: CdfFile, variables: tuple[str, ...]) -> tuple[str, NumberArray]:
    """Name and values, above zero, of the variable with most data; of equal ones the first."""
    best: tuple[int, str, NumberArray] | None = None
    for name in variables:
        if not cdf.has_records(name):
            continue
        values = cdf.numbers(name, 2)
        for part in np.array_split(values, 16):
            part[~(part > 0.0)] = np.nan
        count = int(np.count_nonzero(np.isfinite(values)))
        if best is None or count > (1.0 + AS_FULL) * best[0]:
            best = count, name, values
    if best is None:
        held = [name for name in variables if cdf.stored_name(name)]
        if not held:
            raise InputError(
                f"{cdf.name} has no variable {variables[0]!r}: it is not the product it is named after; {ANOTHER}"
            )
        raise InputError(f"{cdf.name}: {', '.join(held)} are empty: the receiver was off; leave the file out")
    return best[1:]


def read_k0(cdf: CdfFile, receiver: str = "") -> tuple[xr.Dataset, ...]:
    """Key parameters: 76 channels of all receivers, dB over background, preliminary, every 3 minutes or so.

    Not yet run on an archive file: written to the published description of the product. Good to see that there was a
    burst, too coarse to time it well.

    Parameters
    ----------
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
    frequency = cdf.first_with_data(cdf.attribute("DEPEND_1", "E_Average"), "E_freq_val")
    if not frequency:
        raise InputError(f"{cdf.name}: E_Average has no frequencies; {ANOTHER}")
    origin = Origin(OBSERVATORY, "TNR+RAD1+RAD2", "db_over_background", cdf.name)
    time, frequency_mhz = cdf.utc(epoch_of(cdf, "E_Average")), cdf.frequency_mhz(frequency, "Hz", HIGHEST_MHZ["rad2"])
    return (read_records(cdf, origin, "E_Average", time, frequency_mhz, decibel),)


def read_l3_directions(cdf: CdfFile, receiver: str) -> tuple[xr.Dataset, ...]:
    """RAD1 flux density with the direction it came from, at native cadence.

    Run on the archive file of 2020-07-11. The receiver visits its lowest channels once and its highest four times in a
    sweep of 183 s; a sweep is four records here, and every sample keeps its own time (``sample_time``).

    Parameters
    ----------
    receiver : str
        rad1.

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``flux_w_m2_hz``, with ``source_size_deg``, ``modulation_rate`` and the wave
        angles (time, frequency) where the file has them: ``wave_azimuth_rtn_deg`` and ``wave_colatitude_rtn_deg`` of
        version 1, the same with ``srf``, the frame of the spinning spacecraft, of version 2.

    Raises
    ------
    InputError
        If the file is not of this product.
    """
    time, flux = cdf.utc(epoch_of(cdf, "STOKES_I")), cdf.numbers("STOKES_I", 1)
    in_unit(flux, cdf.attribute("UNITS", "STOKES_I"), "flux_w_m2_hz")
    beside = Beside(cdf, flux.shape, "STOKES_I")
    beside.clear(flux)
    time = beside.shifted(time)
    values = {"intensity": flux}
    for name, stored in DIRECTIONS.items():
        column = beside.matrix(stored) if cdf.has_records(stored) else None
        if column is not None:
            values[name] = column
    sfu = beside.flux_sfu_1au()
    if sfu is not None:
        values["flux_sfu_1au"] = sfu
    sweep = beside.matrix("SWEEP") if cdf.has_records("SWEEP") else None
    origin = Origin(OBSERVATORY, receiver.upper(), "flux_w_m2_hz", cdf.name)
    # without a number of the sweep it is cut by the visits of the channels alone
    sweep = np.zeros(time.size, np.float32) if sweep is None else sweep.astype(np.float32)
    spectrum = assemble_sweeps(
        origin, sweep, time, cdf.frequency_mhz("FREQUENCY", "kHz", HIGHEST_MHZ[receiver]), values
    )
    return (beside.noted(spectrum),)


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
            raise InputError(
                f"{path.name} is in units {sorted(units)}: only one of {sorted(UNITS)} has a meaning here; {ANOTHER}"
            )
        quantity, factor = UNITS[units.pop()]
        frequency_khz, mean = _matrix([block[0] for _, block in records]), _matrix([block[1] for _, block in records])
        mean[~((mean > 0.0) & (mean < 1e30))] = np.nan
        stated_mhz = in_mhz(frequency_khz, "khz", HIGHEST_MHZ[receiver], f"{path.name}: its frequency")
        lowest, highest = BANDS_MHZ.get(receiver, (0.0, np.inf))
        if np.nanmin(stated_mhz) > highest or np.nanmax(stated_mhz) < lowest:
            raise InputError(
                f"{path.name} is named after {receiver.upper()}, but holds {np.nanmin(stated_mhz):.3g} to "
                f"{np.nanmax(stated_mhz):.3g} MHz: correct its name"
            )
        frequency_mhz, mean = shared_channels(stated_mhz, mean * factor, path.name)
        time = _header_times(headers, path.name)
        origin = Origin(OBSERVATORY, receiver.upper(), quantity, path.name)
        position_re = np.array([header[-3:] for header in headers], dtype=np.float64)
        return (_placed(assemble(origin, time.astype("datetime64[ns]"), frequency_mhz, mean), time, position_re),)


def _header_times(headers: list[tuple[int, ...]], source: str) -> npt.NDArray[np.datetime64]:
    """Middle of the interval of every record, from the three clocks of its header.

    The count of seconds since 1950 has 32 bits and wraps on 2018-01-19, so the calendar counts. Where the seconds,
    or the day and milliseconds of the CCSDS time, agree with it to within the interval, they give the second.

    Raises
    ------
    InputError
        If a calendar is no date, or neither of the other clocks agrees with it.
    """
    calendar = np.full(len(headers), np.datetime64("NaT"), dtype="datetime64[s]")
    for row, header in enumerate(headers):
        is_leap = header[8] == 60
        date = "{:04d}-{:02d}-{:02d}T{:02d}:{:02d}:{:02d}".format(*header[3:8], header[8] - is_leap)
        try:
            datetime.fromisoformat(date)  # numpy takes a damaged minute for an offset from UTC
            calendar[row] = np.datetime64(date, "s") + np.timedelta64(int(is_leap), "s")
        except ValueError as error:
            raise InputError(f"{source}: record {row + 1} has the date {date}: download it again") from error
    second = np.array([header[2] for header in headers], dtype=np.int64)
    interval_s = np.array([max(header[9], 1) for header in headers], dtype=np.int64)
    stated = (calendar - CALENDAR_1950) // np.timedelta64(1, "s")
    off = (second - stated + WRAP_S // 2) % WRAP_S - WRAP_S // 2
    ccsds = np.array([_ccsds_s(header[0]) for header in headers], dtype=np.int64)  # type: ignore[arg-type]
    agrees = np.abs(off) <= interval_s
    is_alone = ~agrees & (np.abs(ccsds - stated) > interval_s) & (np.abs(second) < WRAP_S // 2 - 1)
    if is_alone.any():
        row = int(np.argmax(is_alone))
        raise InputError(
            f"{source}: record {row + 1} has the date {calendar[row]}, but its seconds since 1950 are of "
            f"{CALENDAR_1950.astype('M8[s]') + second[row]}: its clock is wrong; {ANOTHER}"
        )
    return np.asarray(calendar + np.where(agrees, off, 0).astype("timedelta64[s]"))


def _ccsds_s(stamp: bytes) -> int:
    """Seconds since 1950 of a CCSDS day-segmented time: a preamble, three bytes of days, four of ms."""
    return int.from_bytes(stamp[1:4], "big") * 86_400 - 86_400 + int.from_bytes(stamp[4:8], "big") // 1000


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
            raise InputError(
                f"{path.name} has no array 'arrayb' of {CHANNELS} channels and {MINUTES + 1} columns; {ANOTHER}"
            )
        columns = np.asarray(stored["arrayb"], dtype=np.float32)
    ratio, background = np.where(columns[:-1] > 0.0, columns[:-1], np.nan), columns[-1]
    time = midnight + np.arange(MINUTES) * np.timedelta64(60, "s") + np.timedelta64(30, "s")
    origin = Origin(OBSERVATORY, band.upper(), "voltage_ratio", path.name)
    spectrum = assemble(
        origin, time, np.linspace(*BANDS_MHZ[band], CHANNELS), ratio, {"interpolated": ~(background > 0.0)}
    )
    return (with_visits(spectrum) if band == "rad1" else with_sweeps(spectrum),)


def _content(path: Path) -> bytes:
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise InputError(f"{path.name} has {size} bytes, too many for one day of this product; {ANOTHER}")
    return path.read_bytes()


def _records(content: bytes) -> list[tuple[tuple[int, ...], npt.NDArray[np.float64]]]:
    """Header and the rows frequency, mean, minimum and maximum of every record."""
    records, position = [], 0
    while position < len(content):
        if len(content) - position < LENGTH.size + HEADER.size:
            raise ValueError("it ends within a record")
        length = LENGTH.unpack_from(content, position)[0]
        header = HEADER.unpack_from(content, position + LENGTH.size)
        channels = header[11]
        end = position + LENGTH.size + length
        if not 0 < channels <= MOST_CHANNELS or length != HEADER.size + 16 * channels:
            raise ValueError(f"the record at byte {position} has {length} bytes for {channels} channels")
        if len(content) < end + LENGTH.size:
            raise ValueError("it ends within a record")
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

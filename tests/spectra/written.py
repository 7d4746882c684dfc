"""Files written to the layouts of the archives, one function per product.

They are written without any code of the package, and know the leap seconds by themselves, so that what reads them is
held against something.
"""

import struct
from pathlib import Path
from typing import Any

import numpy as np
from cdflib.cdfwrite import CDF

REAL4, REAL8, INT2, UINT1, UINT2, EPOCH, TT2000 = 21, 22, 2, 11, 12, 31, 33
FILL = np.float32(-1e31)
J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
TT_AHEAD_S = (("2009-01-01", 66.184), ("2012-07-01", 67.184), ("2015-07-01", 68.184), ("2017-01-01", 69.184))
"""How far Terrestrial Time is ahead of UTC, from each day on (IERS Bulletin C)."""

Variable = tuple[str, int, Any, bool, dict[str, Any]]


def tt2000(utc: np.ndarray) -> np.ndarray:
    """Nanoseconds since J2000 in Terrestrial Time."""
    ahead_s = np.zeros(utc.shape)
    for day, seconds in TT_AHEAD_S:
        ahead_s[utc >= np.datetime64(day)] = seconds
    ahead = np.round(ahead_s * 1e3).astype(np.int64) * 1_000_000
    return (utc.astype("datetime64[ns]") - J2000).astype(np.int64) + ahead


def cdf_epoch(utc: np.ndarray) -> np.ndarray:
    """Milliseconds since the year 0."""
    days = (np.datetime64("1970-01-01") - np.datetime64("0000-01-01")).astype(int)
    return days * 86_400_000.0 + utc.astype("datetime64[ns]").astype(np.int64) / 1e6


def filled(values: np.ndarray) -> np.ndarray:
    """NaN as the fill value."""
    return np.where(np.isnan(values), FILL, values).astype(np.float32)


def write_cdf(path: Path, identity: str, variables: list[Variable], compress: int = 6) -> Path:
    """A CDF with a logical identity; a variable is name, type, values, whether it varies by record, attributes."""
    path.unlink(missing_ok=True)
    cdf = CDF(str(path), cdf_spec={"Compressed": 0})
    cdf.write_globalattrs({"Logical_file_id": {0: identity}, "Logical_source": {0: identity}})
    for name, kind, values, varies, attributes in variables:
        stored = np.asarray(values)
        spec = {
            "Variable": name,
            "Data_Type": kind,
            "Num_Elements": 1,
            "Rec_Vary": varies,
            "Dim_Sizes": list(stored.shape[1:] if varies else stored.shape),
            "Compress": compress,
        }
        fill = {"FILLVAL": FILL} if kind == REAL4 else {}
        cdf.write_var(spec, var_attrs=fill | attributes, var_data=stored)
    cdf.close()
    return path


def write_wind_h1(path: Path, utc: np.ndarray, ratio: dict[str, np.ndarray], measured: dict[str, np.ndarray]) -> Path:
    """Wind 1-minute CDF: ratios of voltage by receiver, zero where there is no data."""
    khz = {
        "RAD1": np.arange(20, 1041, 4, dtype=np.int16),
        "RAD2": np.arange(1075, 13826, 50, dtype=np.int16),
        "TNR": np.geomspace(4, 245, 96).astype(np.float32),
    }
    variables: list[Variable] = [
        ("Epoch", EPOCH, cdf_epoch(utc), True, {}),
        ("Epoch2", EPOCH, cdf_epoch(utc[:1]), True, {}),
    ]
    for name, values in ratio.items():
        kind = REAL4 if name == "TNR" else INT2
        minimum = np.where(measured[name], 0.5, 0.0).astype(np.float32)[None]
        variables += [
            (f"E_VOLTAGE_{name}", REAL4, np.nan_to_num(values).astype(np.float32), True, {}),
            (f"Minimum_voltage_{name}", REAL4, minimum, True, {}),
            (f"Frequency_{name}", kind, khz[name], False, {"UNITS": "kHz"}),
        ]
    return write_cdf(path, path.stem, variables, compress=0)


def write_wind_l2(path: Path, utc: np.ndarray, frequency_hz: np.ndarray, density: np.ndarray) -> Path:
    """Wind native cadence: 256 columns allotted, those of no channel are fill."""
    columns = np.full((utc.size, 256), np.nan)
    columns[:, : density.shape[1]] = density
    channels = np.full(256, FILL, dtype=np.float32)
    channels[: frequency_hz.size] = frequency_hz
    variables: list[Variable] = [
        ("Epoch", TT2000, tt2000(utc), True, {}),
        ("FREQUENCY", REAL4, channels, False, {"UNITS": "Hz"}),
        *((f"PSD_V2_{name}", REAL4, filled(columns), True, {"UNITS": "V^2/Hz"}) for name in ("S", "SP", "Z")),
    ]
    return write_cdf(path, path.stem, variables)


def write_wind_k0(path: Path, utc: np.ndarray, decibel: np.ndarray) -> Path:
    """Wind key parameters: 76 channels."""
    variables: list[Variable] = [
        ("Epoch", EPOCH, cdf_epoch(utc), True, {}),
        ("E_freq_val", REAL4, np.geomspace(4e3, 13.8e6, 76).astype(np.float32), False, {"UNITS": "Hz"}),
        ("E_Average", REAL4, filled(decibel), True, {"DEPEND_1": "E_freq_val", "UNITS": "dB"}),
    ]
    return write_cdf(path, path.stem, variables)


def write_wind_60s(path: Path, utc: np.ndarray, frequency_khz: np.ndarray, mean: np.ndarray, unit: int) -> Path:
    """Wind 60-s binary of CDPP: sequential records, big-endian, with their length on either side."""
    records = []
    for time, values in zip(utc, mean, strict=True):
        seconds = int((time - np.datetime64("1950-01-01")) / np.timedelta64(1, "s"))
        date = time.astype("datetime64[s]").item()
        header = struct.pack(
            ">8shi6h3h3f",
            b"\x4c" * 8,
            1,
            seconds,
            *date.timetuple()[:6],
            60,
            unit,
            frequency_khz.size,
            200.0,
            -30.0,
            5.0,
        )
        block = np.stack([frequency_khz, values, values * 0.9, values * 1.1]).astype(">f4").tobytes()
        length = struct.pack(">i", len(header) + len(block))
        records.append(length + header + block + length)
    path.write_bytes(b"".join(records))
    return path


def write_wind_idl(path: Path, ratio: np.ndarray, background: np.ndarray) -> Path:
    """IDL save set with ``arrayb`` [256, 1441]: 1440 minutes and the background."""
    columns = np.concatenate([np.nan_to_num(ratio), background[None]]).astype(">f4")
    name = b"ARRAYB"
    body = struct.pack(">i", len(name)) + name.ljust(8, b"\0")
    body += struct.pack(">2i", 4, 4)  # type float, flag: an array
    dimensions = struct.pack(">8i", columns.shape[1], columns.shape[0], *[1] * 6)
    body += struct.pack(">8i", 8, 4, columns.nbytes, columns.size, 2, 0, 0, 8) + dimensions
    body += struct.pack(">i", 7) + columns.tobytes()
    begin = 4
    after = begin + 16 + len(body)
    variable = struct.pack(">4I", 2, after, 0, 0) + body
    path.write_bytes(b"SR\x00\x04" + variable + struct.pack(">4I", 6, 0, 0, 0))
    return path


def write_stereo_level2(path: Path, utc: np.ndarray, decibel: dict[str, np.ndarray]) -> Path:
    """STEREO 1-minute CDF: a missing minute is minus the background."""
    khz = np.concatenate([np.geomspace(2.61, 153.4, 48), np.arange(125, 16026, 50)]).astype(np.float32)
    variables: list[Variable] = [
        ("Epoch", EPOCH, cdf_epoch(utc), True, {}),
        ("frequency", REAL4, khz, False, {"UNITS": "kHz"}),
    ]
    background = np.broadcast_to(np.linspace(6, 74, khz.size).astype(np.float32), (utc.size, khz.size))
    for name, values in decibel.items():
        stored = np.where(np.isnan(values), -background, values).astype(np.float32)
        variables += [
            (f"avg_intens_{name}", REAL4, stored, True, {"UNITS": "dB>bgnd"}),
            (f"background_{name}", REAL4, background, True, {"UNITS": "dB"}),
        ]
    return write_cdf(path, path.stem, variables, compress=9)


def write_stereo_l3(
    path: Path,
    utc: np.ndarray,
    frequency_hz: np.ndarray,
    flux: np.ndarray,
    *,
    angles: np.ndarray | None = None,
    allotted: int = 0,
) -> Path:
    """STEREO native cadence with wave angles, frequencies in Hz; `allotted` is how many of these are written, 0 all."""
    names = [f"WAVE_{angle}_{frame}" for angle in ("COLATITUDE", "AZIMUTH") for frame in ("RTN", "HCI", "HEE", "HEEQ")]
    angles = np.broadcast_to(np.linspace(0, 90, frequency_hz.size), flux.shape) if angles is None else angles
    variables: list[Variable] = [
        ("Epoch", TT2000, tt2000(utc), True, {}),
        ("FREQUENCY", REAL4, frequency_hz[: allotted or None].astype(np.float32), False, {"UNITS": "Hz"}),
        ("PSD_FLUX", REAL4, filled(flux), True, {"UNITS": "W/m^2/Hz"}),
        ("STOKES_I", REAL4, filled(flux), True, {}),
        *((name, REAL4, filled(angles), True, {"UNITS": "degrees"}) for name in names),
        ("SC_POS_HEE", REAL4, np.ones((utc.size, 3), dtype=np.float32), True, {"UNITS": "km"}),
    ]
    return write_cdf(path, path.stem, variables)


def write_stereo_text(path: Path, frequency_khz: np.ndarray, background: np.ndarray, decibel: np.ndarray) -> Path:
    """STEREO 1-minute text: minutes by their start, columns that may touch."""
    stored = np.where(np.isnan(decibel), -background, decibel)
    lines = ["".join(f"{value:9.1f}" for value in frequency_khz), "".join(f"{value:8.3f}" for value in background)]
    lines += [f"{minute:4d}" + "".join(f"{value:8.3f}" for value in row) for minute, row in enumerate(stored)]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


def write_psp_l2(path: Path, utc: np.ndarray, frequency_hz: np.ndarray, dipoles: dict[str, np.ndarray]) -> Path:
    """PSP receiver: each source has its own epoch and frequencies; most sources of a file are empty."""
    band = "hfr" if "hfr" in path.name else "lfr"
    variables: list[Variable] = []
    for dipole, density in dipoles.items():
        suffix = f"{band}_auto_averages_{dipole}"
        repeated = np.broadcast_to(frequency_hz.astype(np.float64), density.shape)
        variables += [
            (f"epoch_{suffix}", TT2000, tt2000(utc), True, {}),
            (f"frequency_{suffix}", REAL8, repeated, True, {"UNITS": "Hz"}),
            (f"psp_fld_l2_rfs_{suffix}", REAL4, filled(density), True, {"UNITS": "V2/Hz"}),
        ]
    return write_cdf(path, path.stem, variables)


def write_psp_l3(path: Path, utc: np.ndarray, frequency_hz: np.ndarray, flux: np.ndarray) -> Path:
    """PSP receiver with flux."""
    band = "hfr" if "hfr" in path.name else "lfr"
    epoch, frequency, name = f"epoch_{band}_stokes", f"frequency_{band}_stokes", f"psp_fld_l3_rfs_{band}_PSD_FLUX"
    repeated = np.broadcast_to(frequency_hz.astype(np.float64), flux.shape)
    variables: list[Variable] = [
        (epoch, TT2000, tt2000(utc), True, {}),
        (frequency, REAL8, repeated, True, {"UNITS": "Hz"}),
        (name, REAL4, filled(flux), True, {"DEPEND_0": epoch, "DEPEND_1": frequency, "UNITS": "W/m^2/Hz"}),
    ]
    return write_cdf(path, path.stem, variables)


def write_solo_l2_hfr(
    path: Path, utc: np.ndarray, frequency_khz: np.ndarray, sweep: np.ndarray, density: np.ndarray
) -> Path:
    """Solar Orbiter HFR as a list of samples: the dipole on channel 2, nothing (zero) on channel 1."""
    sensor = np.broadcast_to(np.array([0, 9], dtype=np.uint8), (utc.size, 2))
    variables: list[Variable] = [
        ("Epoch", TT2000, tt2000(utc), True, {}),
        ("FREQUENCY", REAL4, frequency_khz.astype(np.float32), True, {"UNITS": "kHz"}),
        ("SWEEP_NUM", UINT2, sweep.astype(np.uint16), True, {}),
        ("SENSOR_CONFIG", UINT1, sensor, True, {}),
        ("AGC1", REAL4, np.zeros(utc.size, dtype=np.float32), True, {}),
        ("AGC2", REAL4, filled(density), True, {}),
    ]
    return write_cdf(path, path.stem, variables)


def write_solo_l2_tnr(path: Path, utc: np.ndarray, sweep: np.ndarray, band: np.ndarray, density: np.ndarray) -> Path:
    """Solar Orbiter TNR: records of one band of 32 channels each."""
    bands_hz = (3991.785737 * 4.0 ** (np.arange(128) / 32.0)).reshape(4, 32)
    sensor = np.broadcast_to(np.array([4, 7], dtype=np.uint8), (utc.size, 2))
    variables: list[Variable] = [
        ("Epoch", TT2000, tt2000(utc), True, {}),
        ("TNR_BAND_FREQ", REAL8, bands_hz, False, {"UNITS": "Hz"}),
        ("TNR_BAND", UINT1, band.astype(np.uint8), True, {}),
        ("SWEEP_NUM", UINT2, sweep.astype(np.uint16), True, {}),
        ("FRONT_END", UINT1, np.ones(utc.size, dtype=np.uint8), True, {}),
        ("SENSOR_CONFIG", UINT1, sensor, True, {}),
        ("AUTO1", REAL4, filled(density), True, {}),
        ("AUTO2", REAL4, np.zeros(density.shape, dtype=np.float32), True, {}),
    ]
    return write_cdf(path, path.stem, variables)


def write_solo_l3(  # noqa: PLR0917
    path: Path,
    utc: np.ndarray,
    frequency_khz: np.ndarray,
    flux: np.ndarray,
    elapsed_s: np.ndarray,
    interpolated: np.ndarray,
) -> Path:
    """Solar Orbiter flux: Epoch is the start of the sweep, each sample has its offset from it."""
    variables: list[Variable] = [
        ("Epoch", TT2000, tt2000(utc), True, {}),
        ("FREQUENCY", REAL4, frequency_khz.astype(np.float32), False, {"UNITS": "kHz"}),
        ("PSD_FLUX", REAL4, filled(flux), True, {}),
        ("ELAPSED_TIME_SINCE_EPOCH", REAL4, elapsed_s.astype(np.float32), True, {"UNITS": "s"}),
        ("INTERPOL_FLAG", UINT1, interpolated.astype(np.uint8), True, {}),
    ]
    return write_cdf(path, path.stem, variables)

"""Files written to the layouts of the archives that the simulator does not write, one function per product.

They are written without any code of the readers, so that what reads them is held against something.
"""

import struct
from pathlib import Path

import numpy as np

from bella.simulation.archive_files import (
    REAL4,
    REAL8,
    TT2000,
    Variable,
    filled,
    tt2000,
    write_cdf,
)

UINT1, UINT2 = 11, 12


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


def write_stereo_text(path: Path, frequency_khz: np.ndarray, background: np.ndarray, decibel: np.ndarray) -> Path:
    """STEREO 1-minute text: minutes by their start, columns that may touch."""
    stored = np.where(np.isnan(decibel), -background, decibel)
    lines = ["".join(f"{value:9.1f}" for value in frequency_khz), "".join(f"{value:8.3f}" for value in background)]
    lines += [f"{minute:4d}" + "".join(f"{value:8.3f}" for value in row) for minute, row in enumerate(stored)]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


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

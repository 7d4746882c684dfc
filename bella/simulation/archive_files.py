"""Files in the layouts of the archives, one function per product.

They are written without any code of the readers, and know the leap seconds by themselves: reading a written file back
holds one against the other. Layouts are those of the archives' descriptions and of the archive files of 2010-01-17.
Every file says in the global attribute ``Bella_origin`` that it is simulated; nothing but CDFs is written.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from cdflib.cdfwrite import CDF

from bella.units import FloatArray

REAL4, REAL8, INT2, UINT1, EPOCH, TT2000 = 21, 22, 2, 11, 31, 33
FILL = np.float32(-1e31)
J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
TT_AHEAD_S = (
    ("1999-01-01", 64.184),
    ("2006-01-01", 65.184),
    ("2009-01-01", 66.184),
    ("2012-07-01", 67.184),
    ("2015-07-01", 68.184),
    ("2017-01-01", 69.184),
)
"""How far Terrestrial Time is ahead of UTC, from each day on (IERS Bulletin C)."""

H1_KHZ: dict[str, npt.NDArray[Any]] = {
    "RAD1": np.arange(20, 1041, 4, dtype=np.int16),
    "RAD2": np.arange(1075, 13826, 50, dtype=np.int16),
    "TNR": np.geomspace(4, 245, 96).astype(np.float32),
}
K0_HZ: FloatArray = np.geomspace(4e3, 13.8e6, 76)
L2_COLUMNS = 256
LEVEL2_KHZ = np.concatenate([np.geomspace(2.61, 153.4, 48), np.arange(125, 16026, 50)]).astype(np.float32)
LEVEL2_BACKGROUND_DB = np.linspace(6, 74, LEVEL2_KHZ.size).astype(np.float32)
WAVE_ANGLES = tuple(
    f"WAVE_{angle}_{frame}" for angle in ("COLATITUDE", "AZIMUTH") for frame in ("RTN", "HCI", "HEE", "HEEQ")
)

Instants = npt.NDArray[np.datetime64]
Variable = tuple[str, int, Any, bool, dict[str, Any]]
"""Name, type, values, whether it varies by record, attributes."""


class Sweeps(NamedTuple):
    """When a receiver that steps through its channels took its samples."""

    start: Instants
    """Start of every sweep, UTC, shape (records,)."""
    elapsed_s: FloatArray
    """How long after it each sample was taken, s, shape (records, channels)."""
    position_km: FloatArray | None = None
    """Where the spacecraft was at the start of every sweep, HCI, km, shape (records, 3)."""


class Beside(NamedTuple):
    """What STEREO's files at native cadence hold beside the flux."""

    angles: Mapping[str, npt.NDArray[Any]] = {}
    """Those of `WAVE_ANGLES` that are known, degrees, shape (records, channels)."""
    position_km: FloatArray | None = None
    """Where the spacecraft was, HEE, km, shape (records, 3)."""


def tt2000(utc: Instants) -> npt.NDArray[np.int64]:
    """Nanoseconds since J2000 in Terrestrial Time.

    Parameters
    ----------
    utc : numpy.ndarray of datetime64
        From 1999 on.

    Returns
    -------
    numpy.ndarray of int64
        As CDF_TIME_TT2000 counts them.
    """
    ahead_s = np.zeros(utc.shape)
    for day, seconds in TT_AHEAD_S:
        ahead_s[utc >= np.datetime64(day)] = seconds
    ahead = np.round(ahead_s * 1e3).astype(np.int64) * 1_000_000
    return np.asarray((utc.astype("datetime64[ns]") - J2000).astype(np.int64) + ahead)


def cdf_epoch(utc: Instants) -> FloatArray:
    """Milliseconds since the year 0, without leap seconds.

    Returns
    -------
    numpy.ndarray
        As CDF_EPOCH counts them.
    """
    days = (np.datetime64("1970-01-01") - np.datetime64("0000-01-01")).astype(int)
    return np.asarray(days * 86_400_000.0 + utc.astype("datetime64[ns]").astype(np.int64) / 1e6)


def filled(values: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """Values with NaN as the fill value.

    Returns
    -------
    numpy.ndarray of float32
        Same shape.
    """
    return np.where(np.isnan(values), FILL, values).astype(np.float32)


def write_cdf(path: Path, identity: str, variables: Sequence[Variable], compress: int = 6) -> Path:
    """A CDF with a logical identity.

    Parameters
    ----------
    path : pathlib.Path
        Ends in ``.cdf``; what is there is replaced.
    identity : str
        Such as the name of the file without its ending.
    compress : int
        Level of gzip, 0 for none.

    Returns
    -------
    pathlib.Path
        The path.
    """
    path.unlink(missing_ok=True)
    cdf = CDF(str(path), cdf_spec={"Compressed": 0})
    cdf.write_globalattrs(
        {"Logical_file_id": {0: identity}, "Logical_source": {0: identity}, "Bella_origin": {0: "simulated"}}
    )
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


def write_wind_h1(
    path: Path,
    utc: Instants,
    ratio: Mapping[str, npt.NDArray[Any]],
    measured: Mapping[str, npt.NDArray[np.bool_]],
) -> Path:
    """Wind 1-minute CDF.

    Parameters
    ----------
    utc : numpy.ndarray of datetime64
        Centres of the minutes, shape (N,).
    ratio : mapping of str to numpy.ndarray
        Ratio of voltage to background by receiver (RAD1, RAD2, TNR), shape (N, 256 or 96); NaN, stored as zero, where
        there are no data.
    measured : mapping of str to numpy.ndarray
        False for channels that are interpolated between others: their background is stored as zero.
    """
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
            (f"Frequency_{name}", kind, H1_KHZ[name], False, {"UNITS": "kHz"}),
        ]
    return write_cdf(path, path.stem, variables, compress=0)


def write_wind_l2(path: Path, utc: Instants, frequency_hz: FloatArray, density: npt.NDArray[Any]) -> Path:
    """Wind native cadence: 256 columns are allotted, those of no channel are fill.

    Parameters
    ----------
    utc : numpy.ndarray of datetime64
        Shape (N,).
    frequency_hz : numpy.ndarray
        Shape (C,).
    density : numpy.ndarray
        V^2/Hz, shape (N, C).
    """
    columns = np.full((utc.size, L2_COLUMNS), np.nan)
    columns[:, : density.shape[1]] = density
    channels = np.full(L2_COLUMNS, FILL, dtype=np.float32)
    channels[: frequency_hz.size] = frequency_hz
    variables: list[Variable] = [
        ("Epoch", TT2000, tt2000(utc), True, {}),
        ("FREQUENCY", REAL4, channels, False, {"UNITS": "Hz"}),
        *((f"PSD_V2_{name}", REAL4, filled(columns), True, {"UNITS": "V^2/Hz"}) for name in ("S", "SP", "Z")),
    ]
    return write_cdf(path, path.stem, variables)


def write_wind_k0(path: Path, utc: Instants, decibel: npt.NDArray[Any]) -> Path:
    """Wind key parameters, which have their epochs as CDF_EPOCH and one row of channels every three minutes.

    Parameters
    ----------
    utc : numpy.ndarray of datetime64
        Middles of the records, shape (N,).
    decibel : numpy.ndarray
        dB over background, shape (N, 76), channels as in `K0_HZ`.
    """
    variables: list[Variable] = [
        ("Epoch", EPOCH, cdf_epoch(utc), True, {}),
        ("E_freq_val", REAL4, K0_HZ.astype(np.float32), False, {"UNITS": "Hz"}),
        ("E_Average", REAL4, filled(decibel), True, {"DEPEND_1": "E_freq_val", "UNITS": "dB"}),
    ]
    return write_cdf(path, path.stem, variables)


def write_stereo_level2(path: Path, utc: Instants, decibel: Mapping[str, npt.NDArray[Any]]) -> Path:
    """STEREO 1-minute CDF of both spacecraft.

    Parameters
    ----------
    utc : numpy.ndarray of datetime64
        Centres of the minutes, shape (N,).
    decibel : mapping of str to numpy.ndarray
        dB over background of "ahead" and "behind", shape (N, 367), channels as in `LEVEL2_KHZ`; NaN is stored as minus
        the background.
    """
    variables: list[Variable] = [
        ("Epoch", EPOCH, cdf_epoch(utc), True, {}),
        ("frequency", REAL4, LEVEL2_KHZ, False, {"UNITS": "kHz"}),
    ]
    background = np.broadcast_to(LEVEL2_BACKGROUND_DB, (utc.size, LEVEL2_KHZ.size))
    for name, values in decibel.items():
        stored = np.where(np.isnan(values), -background, values).astype(np.float32)
        variables += [
            (f"avg_intens_{name}", REAL4, stored, True, {"UNITS": "dB>bgnd"}),
            (f"background_{name}", REAL4, background, True, {"UNITS": "dB"}),
        ]
    return write_cdf(path, path.stem, variables)


def write_stereo_l3(
    path: Path,
    utc: Instants,
    frequency_hz: FloatArray,
    flux: npt.NDArray[Any],
    beside: Beside = Beside(),  # noqa: B008 - a tuple does not change
) -> Path:
    """STEREO native cadence with wave angles and positions.

    Parameters
    ----------
    utc : numpy.ndarray of datetime64
        Shape (N,).
    frequency_hz : numpy.ndarray
        Shape (C,).
    flux : numpy.ndarray
        W/m^2/Hz with the background taken away, shape (N, C).
    beside : Beside
        Wave angles that it does not have are fill, as in the LFR files of most of the mission; without positions there
        are none.
    """
    unknown = np.full(flux.shape, np.nan)
    variables: list[Variable] = [
        ("Epoch", TT2000, tt2000(utc), True, {}),
        ("FREQUENCY", REAL4, frequency_hz.astype(np.float32), False, {"UNITS": "Hz"}),
        ("PSD_FLUX", REAL4, filled(flux), True, {"UNITS": "W/m^2/Hz"}),
        *((name, REAL4, filled(beside.angles.get(name, unknown)), True, {"UNITS": "degrees"}) for name in WAVE_ANGLES),
        *_positions("SC_POS_HEE", beside.position_km),
    ]
    return write_cdf(path, path.stem, variables)


def write_psp_l2(path: Path, utc: Instants, frequency_hz: FloatArray, dipoles: Mapping[str, npt.NDArray[Any]]) -> Path:
    """PSP receiver: each source has its own epoch and frequencies; most sources of a file are empty.

    Parameters
    ----------
    path : pathlib.Path
        Its name says whether it is LFR or HFR.
    utc : numpy.ndarray of datetime64
        Shape (N,).
    frequency_hz : numpy.ndarray
        Shape (C,).
    dipoles : mapping of str to numpy.ndarray
        V^2/Hz of "ch0_V1V2" and "ch1_V3V4", shape (N, C).
    """
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


def write_solo_l3(
    path: Path,
    sweeps: Sweeps,
    frequency_khz: FloatArray,
    flux: npt.NDArray[Any],
    interpolated: npt.NDArray[Any],
) -> Path:
    """Solar Orbiter flux: Epoch is the start of the sweep, each sample has its offset from it.

    Parameters
    ----------
    sweeps : Sweeps
        Of N records and C channels.
    frequency_khz : numpy.ndarray
        Shape (C,).
    flux : numpy.ndarray
        W/m^2/Hz, shape (N, C).
    interpolated : numpy.ndarray
        Non-zero where a sample was not measured, shape (N, C).
    """
    variables: list[Variable] = [
        ("Epoch", TT2000, tt2000(sweeps.start), True, {}),
        ("FREQUENCY", REAL4, frequency_khz.astype(np.float32), False, {"UNITS": "kHz"}),
        ("PSD_FLUX", REAL4, filled(flux), True, {}),
        ("ELAPSED_TIME_SINCE_EPOCH", REAL4, sweeps.elapsed_s.astype(np.float32), True, {"UNITS": "s"}),
        ("INTERPOL_FLAG", UINT1, interpolated.astype(np.uint8), True, {}),
        *_positions("SC_POS_HCI", sweeps.position_km),
    ]
    return write_cdf(path, path.stem, variables)


def _positions(name: str, position_km: FloatArray | None) -> list[Variable]:
    return [] if position_km is None else [(name, REAL8, position_km, True, {"UNITS": "km"})]

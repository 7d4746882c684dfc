"""The receivers behind the data sets of the archive that can be written: channels, cadence, background, noise."""

from dataclasses import dataclass, replace
from datetime import date

import numpy as np
import numpy.typing as npt

from bella.exceptions import InputError
from bella.simulation.archive_files import H1_KHZ, K0_HZ, LEVEL2_KHZ
from bella.simulation.receiver import Receiver
from bella.spacecraft import position_hee
from bella.spectra.minutes import DWELL_S, LIST_KHZ, LIST_S
from bella.spectra.stereo import SWEEP_S
from bella.units import AU_RSUN, FloatArray

ENCOUNTER_RSUN = 0.25 * AU_RSUN
"""Nearer to the Sun than this PSP samples fast."""

PSP_CADENCES_S = 55.92, 6.99
"""Far from the Sun, and near it (Pulupa et al. 2017, JGR Space Physics 122, 2836, doi:10.1002/2016JA023345). The low
and the high band are sampled in turn, each for half of the time."""

LIST_MODE_KHZ: FloatArray = np.unique(LIST_KHZ).astype(np.float64)
"""Channels that Wind RAD1 measures in its list mode; the others are interpolated between them."""

K0_CADENCE_S = 180.0
"""Of Wind's key parameters (SPASE record: PT3M)."""

L2_LEAD_S = 71.0
"""How long before midnight a Wind level-2 file begins, as that of 2020-07-12 does."""

WRITABLE = (
    "WI_H1_WAV",
    "WI_L2_WAV_RAD1",
    "WI_L2_WAV_RAD2",
    "STEREO_LEVEL2_SWAVES",
    "STA_L3_WAV_LFR",
    "STA_L3_WAV_HFR",
    "STB_L3_WAV_LFR",
    "STB_L3_WAV_HFR",
    "PSP_FLD_L2_RFS_LFR",
    "PSP_FLD_L2_RFS_HFR",
    "SOLO_L3_RPW-HFR-SURV-FLUX",
    "SOLO_L3_RPW-TNR-SURV-FLUX",
    "WI_K0_WAV",
)
"""Keys of the data sets whose files can be written."""


@dataclass(frozen=True)
class Instrument:
    """A receiver as one data set of the archive has it.

    Attributes
    ----------
    dataset : str
        Key of the data set.
    quantity : str
        What the data set holds, one of ``QUANTITIES``.
    background : ndarray, shape (C,)
        Quiet level in that quantity (1 for ratios).
    measured : ndarray of bool, shape (C,)
        False for channels that the data set interpolates between others.
    lead_s : float
        How long before midnight its first record begins, s.
    finds_directions : bool
        The data set tells where the waves came from.
    averaged : tuple of Receiver
        Receivers whose samples a record is the mean of; none where it is a sample itself.
    shortest_s : float
        Records that are the mean of samples of less time together have no value.
    fast : Receiver, optional
        The receiver in its fast mode, where it has one and is not in it.
    """

    dataset: str
    receiver: Receiver
    quantity: str
    background: FloatArray
    measured: npt.NDArray[np.bool_]
    lead_s: float = 0.0
    finds_directions: bool = False
    averaged: tuple[Receiver, ...] = ()
    shortest_s: float = 0.0
    fast: Receiver | None = None


def instruments(dataset: str, day: date) -> tuple[Instrument, ...]:
    """Receivers whose spectra the files of a data set hold.

    Parameters
    ----------
    dataset : str
        Key, one of `WRITABLE`.
    day : datetime.date
        PSP's cadence depends on where it is.

    Raises
    ------
    InputError
        If files of the data set cannot be written.
    NoDataError
        If the ephemeris does not have the spacecraft.
    """
    if dataset not in WRITABLE:
        raise InputError(f"files of data set {dataset!r} cannot be simulated; choose from {', '.join(WRITABLE)}")
    if dataset == "WI_H1_WAV":
        return _h1()
    if dataset == "WI_K0_WAV":
        return (_k0(),)
    if dataset == "STEREO_LEVEL2_SWAVES":
        return tuple(_level2(name) for name in ("STEREO-A", "STEREO-B"))
    if dataset.startswith("WI_L2"):
        return (_wind_l2(dataset),)
    if dataset.startswith("ST"):
        return (_stereo_l3(dataset),)
    return (_psp(dataset, day),) if dataset.startswith("PSP") else (_solo(dataset),)


def _quiet_v2_hz(frequency_mhz: FloatArray) -> FloatArray:
    """Noise of a receiver, the plasma's thermal noise below 0.1 MHz, the galaxy's about 3 MHz; orders of magnitude."""
    galaxy = np.exp(-0.5 * (np.log(frequency_mhz / 3.0) / 0.8) ** 2)
    return np.asarray(3.5e-17 * (1.0 + 2.0 * galaxy + (0.06 / frequency_mhz) ** 3))


def _quiet_w_m2_hz(frequency_mhz: FloatArray) -> FloatArray:
    return np.asarray(1e-20 * _quiet_v2_hz(frequency_mhz) / 3.5e-17)


def _at_once(
    observatory: str, name: str, frequency_mhz: FloatArray, cadence_s: float, integration_s: float
) -> Receiver:
    """A receiver whose file gives one time for all channels of a record."""
    return Receiver(observatory, name, frequency_mhz, cadence_s, integration_s, np.zeros(frequency_mhz.size))


def _whole(dataset: str, receiver: Receiver, quantity: str, background: FloatArray, lead_s: float = 0.0) -> Instrument:
    measured = np.ones(receiver.frequency_mhz.size, dtype=bool)
    return Instrument(dataset, receiver, quantity, background, measured, lead_s)


def _h1() -> tuple[Instrument, ...]:
    rad1, rad2 = (
        _at_once("WIND", name, H1_KHZ[name].astype(np.float64) * 1e-3, 60.0, 60.0) for name in ("RAD1", "RAD2")
    )
    ones = np.ones(rad1.frequency_mhz.size)
    listed = np.isin(H1_KHZ["RAD1"], LIST_KHZ)
    hopping = Instrument("WI_H1_WAV", rad1, "voltage_ratio", ones, listed, averaged=_list_mode())
    return hopping, _whole("WI_H1_WAV", rad2, "voltage_ratio", np.ones(rad2.frequency_mhz.size))


def _list_mode() -> tuple[Receiver, ...]:
    """RAD1 as receivers with as many visits to each of their channels in a list."""
    visits = np.array([np.count_nonzero(khz == LIST_KHZ) for khz in LIST_MODE_KHZ])
    middle_s = (np.array([np.argmax(khz == LIST_KHZ) for khz in LIST_MODE_KHZ]) + 0.5) * DWELL_S
    groups = [(number, visits == number) for number in np.unique(visits)]
    return tuple(
        Receiver("WIND", "RAD1", LIST_MODE_KHZ[those] * 1e-3, LIST_S / number, DWELL_S, middle_s[those])
        for number, those in groups
    )


def _wind_l2(dataset: str) -> Instrument:
    name = dataset[-4:]
    channels: FloatArray = LIST_MODE_KHZ * 1e-3 if name == "RAD1" else np.arange(1.075, 13.8251, 0.4)
    receiver = _at_once("WIND", name, channels, 17.0 if name == "RAD1" else 16.0, 1.0)
    return _whole(dataset, receiver, "psd_v2_hz", _quiet_v2_hz(channels), L2_LEAD_S)


def _k0() -> Instrument:
    records = _at_once("WIND", "TNR+RAD1+RAD2", K0_HZ * 1e-6, K0_CADENCE_S, K0_CADENCE_S)
    return _whole("WI_K0_WAV", records, "db_over_background", np.ones(K0_HZ.size))


def _level2(observatory: str) -> Instrument:
    channels = level2_channels_khz()
    minutes = _at_once(observatory, "LFR+HFR", channels * 1e-3, 60.0, 60.0)
    whole = _whole("STEREO_LEVEL2_SWAVES", minutes, "db_over_background", np.ones(channels.size))
    return replace(whole, averaged=(replace(minutes, cadence_s=SWEEP_S, integration_s=1.0),))


def level2_channels_khz() -> FloatArray:
    """Channels of STEREO level 2 in ascending order, with the LFR's alone where both receivers overlap.

    Returns
    -------
    numpy.ndarray, shape (366,)
        kHz.
    """
    low, high = LEVEL2_KHZ[:48].astype(np.float64), LEVEL2_KHZ[48:].astype(np.float64)
    return np.concatenate([low, high[high > low[-1]]])


def _stereo_l3(dataset: str) -> Instrument:
    observatory = {"A": "STEREO-A", "B": "STEREO-B"}[dataset[2]]
    name = dataset[-3:]
    channels = np.geomspace(2.61e-3, 153.4e-3, 48) if name == "LFR" else np.arange(0.125, 16.0251, 0.05)
    receiver = _at_once(observatory, name, channels, SWEEP_S, 1.0)
    whole = _whole(dataset, receiver, "flux_w_m2_hz", _quiet_w_m2_hz(channels))
    return replace(whole, finds_directions=name == "HFR")  # the LFR does so from December 2012 on only


def _psp(dataset: str, day: date) -> Instrument:
    noon = np.datetime64(day, "ns") + np.timedelta64(12, "h")
    away_rsun = float(np.linalg.norm(position_hee("PSP", np.array([noon]), noon)[0]))
    name = dataset[-3:]
    channels = np.geomspace(0.0105, 1.69, 64) if name == "LFR" else np.geomspace(1.275, 19.17, 64)
    slow, fast = (_at_once("PSP", name, channels, cadence_s, 0.5 * cadence_s) for cadence_s in PSP_CADENCES_S)
    lead_s = 0.0 if name == "LFR" else 2.24
    if away_rsun < ENCOUNTER_RSUN:
        return _whole(dataset, fast, "psd_v2_hz", _quiet_v2_hz(channels), lead_s)
    return replace(_whole(dataset, slow, "psd_v2_hz", _quiet_v2_hz(channels), lead_s), fast=fast)


def _solo(dataset: str) -> Instrument:
    is_high = "HFR" in dataset
    channels = np.linspace(0.425, 16.325, 50) if is_high else 3.9918e-3 * 4.0 ** (np.arange(128) / 32.0)
    cadence_s = 17.0
    offsets = np.linspace(-0.45, 0.45, channels.size) * cadence_s
    receiver = Receiver("SOLO", "HFR" if is_high else "TNR", channels, cadence_s, 0.1, offsets)
    return _whole(dataset, receiver, "flux_w_m2_hz", _quiet_w_m2_hz(channels))

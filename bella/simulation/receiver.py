"""What a receiver makes of bursts: it steps through its channels, integrates, and adds noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from bella.exceptions import InputError
from bella.simulation.burst import SimulatedBurst, arrival_s, contrast_at
from bella.simulation.light_curve import light_curve
from bella.spectra.dynamic_spectrum import validate_spectrum
from bella.units import FloatArray

MAX_RECORDS = 200_000
LIGHT_CURVE_DIGITS = 3
"""Channels whose frequencies agree to this many digits share a light curve."""


@dataclass(frozen=True)
class Receiver:
    """A radio receiver that sweeps over its channels.

    Attributes
    ----------
    observatory, name : str
    frequency_mhz : ndarray, shape (C,)
        Ascending.
    cadence_s : float
        Time from sweep to sweep, s.
    integration_s : float
        Time that one sample averages over, s.
    sample_offset_s : ndarray, shape (C,)
        When the middle of a channel's sample is after the middle of its record, s.
    noise : float
        Standard deviation of one sample of pure background, as a share of the background.
    """

    observatory: str
    name: str
    frequency_mhz: FloatArray
    cadence_s: float
    integration_s: float
    sample_offset_s: FloatArray
    noise: float = 0.05


def observe(
    receiver: Receiver,
    bursts: Sequence[SimulatedBurst],
    start_utc: np.datetime64,
    stop_utc: np.datetime64,
    rng: np.random.Generator,
) -> xr.Dataset:
    """Dynamic spectrum of bursts as a receiver records it.

    Parameters
    ----------
    receiver : Receiver
    bursts : sequence of SimulatedBurst
        May be empty.
    start_utc, stop_utc : numpy.datetime64
        First record begins at the start, the last ends by the stop.
    rng : numpy.random.Generator

    Returns
    -------
    xarray.Dataset
        A dynamic spectrum in dB over background.

    Raises
    ------
    InputError
        If there is no record between start and stop, or there are too many.
    """
    middle_s = _middles(receiver, start_utc, stop_utc)
    power = 1.0 + received_power(receiver, bursts, start_utc, middle_s)
    power *= 1 + receiver.noise * rng.standard_normal(power.shape)
    with np.errstate(invalid="ignore", divide="ignore"):
        intensity = 10 * np.log10(np.where(power > 0, power, np.nan))
    return validate_spectrum(_dataset(receiver, intensity, start_utc, middle_s), f"simulated {receiver.name}")


def _middles(receiver: Receiver, start_utc: np.datetime64, stop_utc: np.datetime64) -> FloatArray:
    """Middles of the records, seconds after the start."""
    records = int((stop_utc - start_utc) / np.timedelta64(1, "s") // receiver.cadence_s)
    if not 0 < records <= MAX_RECORDS:
        raise InputError(
            f"{records} records of {receiver.cadence_s:g} s from {start_utc} to {stop_utc}; "
            f"ask for 1 to {MAX_RECORDS}: a stop after the start, and not too far"
        )
    return np.asarray((np.arange(records) + 0.5) * receiver.cadence_s)


def received_power(
    receiver: Receiver, bursts: Sequence[SimulatedBurst], start_utc: np.datetime64, middle_s: FloatArray
) -> FloatArray:
    """Power of bursts in every sample of a receiver, without background and noise.

    Parameters
    ----------
    receiver : Receiver
    bursts : sequence of SimulatedBurst
    start_utc : numpy.datetime64
        What the middles are counted from.
    middle_s : numpy.ndarray, shape (N,)
        Middles of the records, ascending, s.

    Returns
    -------
    numpy.ndarray, shape (N, C)
        In units of the background.

    Raises
    ------
    NoDataError
        If the ephemeris does not have the spacecraft.
    """
    power = np.zeros((middle_s.size, receiver.frequency_mhz.size))
    for burst in bursts:
        _add(power, receiver, burst, middle_s - (burst.release_utc - start_utc) / np.timedelta64(1, "s"))
    return power


def _add(power: FloatArray, receiver: Receiver, burst: SimulatedBurst, released_s: FloatArray) -> None:
    """Add a burst where it is heard; records are counted from its release."""
    height = contrast_at(burst, receiver.frequency_mhz, receiver.observatory)
    heard = np.flatnonzero(height > 0)
    arrived_s = arrival_s(burst, receiver.frequency_mhz[heard], receiver.observatory)
    half = 0.5 * receiver.integration_s
    for column, arrived in zip(heard, arrived_s, strict=True):
        shared_mhz = float(f"{receiver.frequency_mhz[column]:.{LIGHT_CURVE_DIGITS}g}")
        curve = light_curve(shared_mhz, decay_factor=burst.decay_factor, gamma_shape=burst.gamma_shape)
        begin_s = arrived - receiver.sample_offset_s[column]
        reach = begin_s + curve.time_s[[0, -1]] * burst.width_factor + (-half, half)
        rows = slice(*np.searchsorted(released_s, reach))
        after = (released_s[rows] - begin_s) / burst.width_factor
        margin = half / burst.width_factor
        power[rows, column] += height[column] * curve.mean(after - margin, after + margin)


def _dataset(receiver: Receiver, intensity: FloatArray, start_utc: np.datetime64, middle_s: FloatArray) -> xr.Dataset:
    time = start_utc.astype("datetime64[ns]") + np.rint(middle_s * 1e9).astype("timedelta64[ns]")
    return xr.Dataset(
        {
            "intensity": (("time", "frequency"), intensity.astype(np.float32), {"units": "dB"}),
            "sample_offset_s": ("frequency", receiver.sample_offset_s, {"units": "s"}),
        },
        coords={"time": time, "frequency": ("frequency", receiver.frequency_mhz, {"units": "MHz"})},
        attrs={
            "observatory": receiver.observatory,
            "receiver": receiver.name,
            "quantity": "db_over_background",
            "integration_s": receiver.integration_s,
            "source_files": "simulated",
        },
    )

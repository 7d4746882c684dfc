"""A day as a receiver records it: bursts and what is none, gain, noise, gaps, in the quantity of a data set."""

from collections.abc import Sequence
from datetime import date

import numpy as np
import xarray as xr

from bella.simulation.burst import SimulatedBurst
from bella.simulation.instruments import Instrument
from bella.simulation.nuisances import add_nuisance
from bella.simulation.receiver import Receiver, received_power
from bella.simulation.sky import Conditions, Sky
from bella.simulation.wave_angles import wave_angles
from bella.spectra.assembly import Origin, assemble
from bella.units import DAY_S, FloatArray

BURST_LASTS_S = 4 * 3600.0
"""How long after its release a burst may still be heard."""


def observe_day(instrument: Instrument, skies: Sequence[Sky], day: date, rng: np.random.Generator) -> xr.Dataset:
    """Spectrum of a day in the quantity of a data set.

    Parameters
    ----------
    instrument : Instrument
    skies : sequence of Sky
        The day and those next to it, whose bursts may reach into it; of one, its nuisances are recorded too.
    day : datetime.date
    rng : numpy.random.Generator
        Of the noise.

    Returns
    -------
    xarray.Dataset
        A dynamic spectrum; records of gaps are not in it.

    Raises
    ------
    NoDataError
        If the ephemeris does not have the spacecraft.
    """
    receiver = instrument.receiver
    midnight = np.datetime64(day, "ns")
    middle_s = (np.arange(DAY_S // receiver.cadence_s) + 0.5) * receiver.cadence_s - instrument.lead_s
    conditions = _conditions(skies, day, receiver.observatory)
    middle_s = _without_gaps(middle_s, conditions)
    bursts, storm = _audible(skies, midnight)
    power = received_power(receiver, [*bursts, *storm], midnight, middle_s)
    for nuisance in conditions.nuisances:
        add_nuisance(power, nuisance, middle_s, receiver.frequency_mhz)
    power += 1.0
    power *= conditions.gain.factor(middle_s)[:, None]
    power *= 1.0 + receiver.noise * rng.standard_normal(power.shape)
    time = midnight + np.rint(middle_s * 1e9).astype("timedelta64[ns]")
    angles = wave_angles(receiver, bursts, midnight, middle_s, rng) if instrument.finds_directions else {}
    return _recorded(instrument, time, power, angles)


def _conditions(skies: Sequence[Sky], day: date, observatory: str) -> Conditions:
    return next((sky.conditions.get(observatory, Conditions()) for sky in skies if sky.day == day), Conditions())


def _audible(skies: Sequence[Sky], midnight: np.datetime64) -> tuple[list[SimulatedBurst], list[SimulatedBurst]]:
    """Bursts, and those of noise storms, that may be heard on the day."""
    begin = midnight - np.timedelta64(int(BURST_LASTS_S), "s")
    end = midnight + np.timedelta64(int(DAY_S), "s")
    both = [burst for sky in skies for burst in sky.bursts], [burst for sky in skies for burst in sky.storm]
    bursts, storm = ([burst for burst in part if begin <= burst.release_utc <= end] for part in both)
    return bursts, storm


def _without_gaps(middle_s: FloatArray, conditions: Conditions) -> FloatArray:
    kept = np.ones(middle_s.size, dtype=bool)
    for start_s, stop_s in conditions.gaps_s:
        kept &= (middle_s < start_s) | (middle_s > stop_s)
    return middle_s[kept]


def _recorded(instrument: Instrument, time: np.ndarray, power: FloatArray, angles: dict[str, FloatArray]) -> xr.Dataset:
    receiver = instrument.receiver
    intensity = _in_quantity(instrument, power)
    extra: dict[str, np.ndarray] = {name: angle.astype(np.float32) for name, angle in angles.items()}
    if not instrument.measured.all():
        extra["interpolated"] = ~instrument.measured
        intensity = _interpolated(intensity, receiver, instrument.measured)
    if receiver.sample_offset_s.any():
        extra["sample_offset_s"] = receiver.sample_offset_s
    origin = Origin(receiver.observatory, receiver.name, instrument.quantity, "simulated")
    return assemble(origin, time, receiver.frequency_mhz, intensity.astype(np.float32), extra)


def _in_quantity(instrument: Instrument, power: FloatArray) -> FloatArray:
    """Power over background in the unit of the data set; NaN where it has no value for it."""
    if instrument.quantity == "flux_w_m2_hz":  # published with the background taken away
        return instrument.background * (power - 1.0)
    positive = np.where(power > 0, power, np.nan)
    if instrument.quantity == "db_over_background":
        return np.asarray(10.0 * np.log10(positive))
    return instrument.background * (np.sqrt(positive) if instrument.quantity == "voltage_ratio" else positive)


def _interpolated(intensity: FloatArray, receiver: Receiver, measured: np.ndarray) -> FloatArray:
    """Channels that are not measured, drawn straight between those that are."""
    channels = receiver.frequency_mhz
    place = np.interp(channels, channels[measured], np.arange(np.count_nonzero(measured)))
    below = np.minimum(place.astype(np.intp), np.count_nonzero(measured) - 2)
    share = place - below
    known = intensity[:, measured]
    return np.asarray(known[:, below] * (1 - share) + known[:, below + 1] * share)

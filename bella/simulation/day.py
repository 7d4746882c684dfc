"""A day as a receiver records it: bursts and what is none, gain, noise, gaps, in the quantity of a data set."""

from collections.abc import Sequence
from datetime import date
from typing import NamedTuple

import numpy as np
import xarray as xr

from bella.simulation.burst import SimulatedBurst
from bella.simulation.instruments import Instrument
from bella.simulation.minutes import MINUTE_S, MINUTES, Samples, minute_means
from bella.simulation.nuisances import add_nuisance
from bella.simulation.receiver import Receiver, received_power
from bella.simulation.sky import Conditions, Sky
from bella.simulation.wave_angles import wave_angles
from bella.spectra.assembly import Origin, assemble
from bella.units import DAY_S, FloatArray

BURST_LASTS_S = 4 * 3600.0
"""How long after its release a burst may still be heard."""


class Heard(NamedTuple):
    """What there is to record on a day at a spacecraft."""

    midnight: np.datetime64
    bursts: Sequence[SimulatedBurst]
    storm: Sequence[SimulatedBurst]
    conditions: Conditions


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
        A dynamic spectrum; records of gaps are not in it. Averages of a minute have the mean time of their samples
        (``sample_time``); what was not measured is NaN.

    Raises
    ------
    NoDataError
        If the ephemeris does not have the spacecraft.
    """
    receiver = instrument.receiver
    midnight = np.datetime64(day, "ns")
    heard = Heard(midnight, *_audible(skies, midnight), _conditions(skies, day, receiver.observatory))
    if instrument.averaged:
        return _averaged(instrument, heard, rng)
    middle_s = (np.arange(DAY_S // receiver.cadence_s) + 0.5) * receiver.cadence_s - instrument.lead_s
    middle_s = middle_s[~_in_gap(middle_s, heard.conditions)]
    power = _samples(receiver, heard, middle_s, rng).power
    angles = wave_angles(receiver, heard.bursts, midnight, middle_s, rng) if instrument.finds_directions else {}
    extra: dict[str, np.ndarray] = {name: angle.astype(np.float32) for name, angle in angles.items()}
    if receiver.sample_offset_s.any():
        extra["sample_offset_s"] = receiver.sample_offset_s
    return _recorded(instrument, _utc(midnight, middle_s), power, extra)


def _samples(receiver: Receiver, heard: Heard, middle_s: FloatArray, rng: np.random.Generator) -> Samples:
    """Samples with all that is in them; those of gaps too."""
    time_s = middle_s[:, None] + receiver.sample_offset_s
    power = received_power(receiver, [*heard.bursts, *heard.storm], heard.midnight, middle_s)
    for nuisance in heard.conditions.nuisances:
        add_nuisance(power, nuisance, time_s, receiver.frequency_mhz)
    power += 1.0
    power *= heard.conditions.gain.factor(time_s)
    power *= 1.0 + receiver.noise * rng.standard_normal(power.shape)
    return Samples(time_s, power)


def _averaged(instrument: Instrument, heard: Heard, rng: np.random.Generator) -> xr.Dataset:
    """A day of which the data set has the means of minutes; where in a record the day begins is drawn."""

    def take(receiver: Receiver, middle_s: FloatArray) -> Samples:
        """Samples without those of gaps."""
        taken = _samples(receiver, heard, middle_s, rng)
        taken.power[_in_gap(taken.time_s, heard.conditions)] = np.nan
        return taken

    phase_s = float(rng.uniform(0.0, max(one.cadence_s for one in instrument.averaged)))
    means = minute_means(instrument, take, phase_s)
    stamp_s = np.arange(MINUTES, dtype=np.float64) * MINUTE_S + 0.5 * MINUTE_S
    recorded = np.isfinite(means.power).any(axis=1)
    when_s = np.where(np.isfinite(means.time_s), means.time_s, stamp_s[:, None])
    extra = {"sample_time": _utc(heard.midnight, when_s)[recorded]}
    return _recorded(instrument, _utc(heard.midnight, stamp_s)[recorded], means.power[recorded], extra)


def _utc(midnight: np.datetime64, after_s: FloatArray) -> np.ndarray:
    return np.asarray(midnight + np.rint(after_s * 1e9).astype("timedelta64[ns]"))


def _conditions(skies: Sequence[Sky], day: date, observatory: str) -> Conditions:
    return next((sky.conditions.get(observatory, Conditions()) for sky in skies if sky.day == day), Conditions())


def _audible(skies: Sequence[Sky], midnight: np.datetime64) -> tuple[list[SimulatedBurst], list[SimulatedBurst]]:
    """Bursts, and those of noise storms, that may be heard on the day."""
    begin = midnight - np.timedelta64(int(BURST_LASTS_S), "s")
    end = midnight + np.timedelta64(int(DAY_S), "s")
    both = [burst for sky in skies for burst in sky.bursts], [burst for sky in skies for burst in sky.storm]
    bursts, storm = ([burst for burst in part if begin <= burst.release_utc <= end] for part in both)
    return bursts, storm


def _in_gap(time_s: FloatArray, conditions: Conditions) -> np.ndarray:
    missing = np.zeros(time_s.shape, dtype=bool)
    for start_s, stop_s in conditions.gaps_s:
        missing |= (time_s >= start_s) & (time_s <= stop_s)
    return missing


def _recorded(instrument: Instrument, time: np.ndarray, power: FloatArray, extra: dict[str, np.ndarray]) -> xr.Dataset:
    receiver = instrument.receiver
    flags = {} if instrument.measured.all() else {"interpolated": ~instrument.measured}
    origin = Origin(receiver.observatory, receiver.name, instrument.quantity, "simulated")
    intensity = _in_quantity(instrument, power).astype(np.float32)
    return assemble(origin, time, receiver.frequency_mhz, intensity, extra | flags)


def _in_quantity(instrument: Instrument, power: FloatArray) -> FloatArray:
    """Power over background in the unit of the data set; NaN where it has no value for it."""
    if instrument.quantity == "flux_w_m2_hz":  # published with the background taken away
        return instrument.background * (power - 1.0)
    positive = np.where(power > 0, power, np.nan)
    if instrument.quantity == "db_over_background":
        return np.asarray(10.0 * np.log10(positive))
    return instrument.background * (np.sqrt(positive) if instrument.quantity == "voltage_ratio" else positive)

"""Hours or a day as a receiver records them: bursts and what is none, gain, noise, gaps, in the unit of a data set."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from typing import NamedTuple

import numpy as np
import xarray as xr

from bella.simulation.burst import SimulatedBurst
from bella.simulation.instruments import Instrument
from bella.simulation.nuisances import add_nuisance
from bella.simulation.receiver import (
    MINUTE_S,
    Receiver,
    Samples,
    minute_means,
    received_power,
    record_middles_s,
    wave_angles,
)
from bella.simulation.sky import Conditions, Sky
from bella.spectra.assembly import Origin, assemble
from bella.spectra.minutes import APART_STEP_S
from bella.units import DAY_S, FloatArray

BURST_LASTS_S = 4 * 3600.0
"""How long after its release a burst may still be received."""


class Scene(NamedTuple):
    """What there is to record at a spacecraft; its seconds count from midnight."""

    midnight: np.datetime64
    bursts: Sequence[SimulatedBurst]
    conditions: Conditions
    unlocated: Sequence[SimulatedBurst] = ()
    """Weak bursts, such as those of a storm, whose direction is not found."""


def observe_day(instrument: Instrument, skies: Sequence[Sky], day: date, rng: np.random.Generator) -> xr.Dataset:
    """Spectrum of a day in the quantity of a data set.

    Parameters
    ----------
    skies : sequence of Sky
        The day and those next to it, whose bursts may reach into it; of one, its nuisances are recorded too.
    rng : numpy.random.Generator
        Of the noise.

    Returns
    -------
    xarray.Dataset
        As :func:`observe_scene` returns it.

    Raises
    ------
    NoDataError
        If the ephemeris does not have the spacecraft.
    """
    midnight = np.datetime64(day, "ns")
    known = {sky.day: sky.conditions.get(instrument.receiver.observatory, Conditions()) for sky in skies}
    bursts, storm = _audible(skies, midnight)
    scene = Scene(midnight, bursts, known.get(day, Conditions()), storm)
    return observe_scene(instrument, scene, (0.0, DAY_S), rng)


def observe_scene(
    instrument: Instrument, scene: Scene, between_s: tuple[float, float], rng: np.random.Generator
) -> xr.Dataset:
    """Spectrum of some time in the quantity of a data set.

    Parameters
    ----------
    between_s : tuple of float
        Seconds after midnight.
    rng : numpy.random.Generator
        Of the noise.

    Returns
    -------
    xarray.Dataset
        A dynamic spectrum; records of gaps are not in it. Averages of a minute have the mean time of their samples
        (``sample_time``) and the time between the visits of two (``visits_apart_s``); what was not measured is NaN.

    Raises
    ------
    InputError
        If there is no record in that time, or there are too many.
    NoDataError
        If the ephemeris does not have the spacecraft.
    """
    if instrument.averaged:
        return _averaged(instrument, scene, between_s, rng)
    receiver, fast_from_s = instrument.receiver, scene.conditions.fast_from_s
    start_s, stop_s = (end - instrument.lead_s for end in between_s)
    if instrument.fast is None or not start_s < fast_from_s < stop_s:
        return _sampled(instrument, receiver, scene, record_middles_s(receiver.cadence_s, start_s, stop_s), rng)
    slow_s = record_middles_s(receiver.cadence_s, start_s, fast_from_s)
    fast_s = record_middles_s(instrument.fast.cadence_s, slow_s[-1] + 0.5 * receiver.cadence_s, stop_s)
    parts = [
        _sampled(instrument, receiver, scene, slow_s, rng),
        _sampled(instrument, instrument.fast, scene, fast_s, rng),
    ]
    return xr.concat(parts, "time", combine_attrs="override")


def _sampled(
    instrument: Instrument, receiver: Receiver, scene: Scene, middle_s: FloatArray, rng: np.random.Generator
) -> xr.Dataset:
    middle_s = middle_s[~_in_gap(middle_s, scene.conditions)]
    power = _samples(receiver, scene, middle_s, rng).power
    finds = instrument.finds_directions
    angles = wave_angles(receiver, scene.bursts, scene.midnight, middle_s, rng) if finds else {}
    extra: dict[str, np.ndarray] = {name: angle.astype(np.float32) for name, angle in angles.items()}
    if receiver.sample_offset_s.any():
        extra["sample_offset_s"] = receiver.sample_offset_s
    return _recorded(instrument, receiver, _utc(scene.midnight, middle_s), power, extra)


def _samples(receiver: Receiver, scene: Scene, middle_s: FloatArray, rng: np.random.Generator) -> Samples:
    """Samples with all that is in them; those of gaps too."""
    time_s = middle_s[:, None] + receiver.sample_offset_s
    power = received_power(receiver, [*scene.bursts, *scene.unlocated], scene.midnight, middle_s)
    for nuisance in scene.conditions.nuisances:
        add_nuisance(power, nuisance, time_s, receiver.frequency_mhz)
    power += 1.0
    power *= scene.conditions.gain.factor(time_s)
    power *= 1.0 + receiver.noise * rng.standard_normal(power.shape)
    np.minimum(power, scene.conditions.clip, out=power)
    return Samples(time_s, power)


def _averaged(
    instrument: Instrument, scene: Scene, between_s: tuple[float, float], rng: np.random.Generator
) -> xr.Dataset:
    """Means of minutes; where in a record of the receivers the time begins is drawn."""

    def take(receiver: Receiver, middle_s: FloatArray) -> Samples:
        """Samples without those of gaps."""
        taken = _samples(receiver, scene, middle_s, rng)
        taken.power[_in_gap(taken.time_s, scene.conditions)] = np.nan
        return taken

    phase_s = float(rng.uniform(0.0, max(one.cadence_s for one in instrument.averaged)))
    ends = (int(between_s[0] // MINUTE_S), int(between_s[1] // MINUTE_S))
    means = minute_means(instrument.receiver.frequency_mhz, instrument.averaged, take, phase_s, ends)
    stamp_s = np.arange(*ends, dtype=np.float64) * MINUTE_S + 0.5 * MINUTE_S
    power = np.where(means.length_s >= instrument.shortest_s, means.power, np.nan)
    recorded = np.isfinite(power).any(axis=1)
    when_s = np.where(np.isfinite(means.time_s), means.time_s, stamp_s[:, None])
    extra = {"sample_time": _utc(scene.midnight, when_s)[recorded]}
    receiver = instrument.receiver
    if not instrument.measured.all():  # the reader tells apart means of one visit and of two, in these steps
        apart_s = np.rint(APART_STEP_S * np.rint(np.nan_to_num(means.apart_s) / APART_STEP_S))
        extra["visits_apart_s"] = apart_s[recorded].astype(np.uint8)
        receiver = replace(receiver, integration_s=instrument.averaged[0].integration_s)
    return _recorded(instrument, receiver, _utc(scene.midnight, stamp_s)[recorded], power[recorded], extra)


def _utc(midnight: np.datetime64, after_s: FloatArray) -> np.ndarray:
    return np.asarray(midnight + np.rint(after_s * 1e9).astype("timedelta64[ns]"))


def _audible(skies: Sequence[Sky], midnight: np.datetime64) -> tuple[list[SimulatedBurst], list[SimulatedBurst]]:
    """Bursts, and those of noise storms, that may be received on the day."""
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


def _recorded(
    instrument: Instrument, receiver: Receiver, time: np.ndarray, power: FloatArray, extra: dict[str, np.ndarray]
) -> xr.Dataset:
    flags = {} if instrument.measured.all() else {"interpolated": ~instrument.measured}
    origin = Origin(receiver.observatory, receiver.name, instrument.quantity, "simulated", receiver.integration_s)
    intensity = _in_quantity(instrument, power).astype(np.float32)
    spectrum = assemble(origin, time, receiver.frequency_mhz, intensity, extra | flags)
    return spectrum.assign_attrs(origin="simulated")


def _in_quantity(instrument: Instrument, power: FloatArray) -> FloatArray:
    """Power over background in the unit of the data set; NaN where it has no value for it."""
    if instrument.quantity == "flux_w_m2_hz":  # published with the background taken away
        return instrument.background * (power - 1.0)
    positive = np.where(power > 0, power, np.nan)
    if instrument.quantity == "db_over_background":
        return np.asarray(10.0 * np.log10(positive))
    return instrument.background * (np.sqrt(positive) if instrument.quantity == "voltage_ratio" else positive)

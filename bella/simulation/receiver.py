"""What a receiver makes of bursts: it steps through its channels, integrates, adds noise, and may average minutes.

A channel holds the mean of the true light curve over the integration time of the sample, at the time at which that
sample was taken. One-minute averages are means of what falls into a minute, whenever in it that was.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.interpolate import interp1d

from bella.exceptions import InputError
from bella.simulation.burst import SimulatedBurst, received, source_position_rsun
from bella.spacecraft import position_hee
from bella.spectra.dynamic_spectrum import validate_spectrum
from bella.units import FloatArray

MAX_RECORDS = 200_000
MINUTE_S = 60.0
PART_S = 0.7
"""Longer samples are cut into parts of at least this length, as a minute may begin in one."""
COLATITUDE, AZIMUTH = "wave_colatitude_hee_deg", "wave_azimuth_hee_deg"
SCATTER_DEG = 2.0
"""Error of a direction that no background disturbs; of the order that goniopolarimetry of STEREO states for strong
bursts (Cecconi et al. 2008, Space Sci. Rev. 136, 549, doi:10.1007/s11214-007-9255-6)."""


@dataclass(frozen=True)
class Receiver:
    """A radio receiver that sweeps over its channels.

    Attributes
    ----------
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


class Samples(NamedTuple):
    """What a receiver took, shape (N, C) each."""

    time_s: FloatArray
    """Seconds after the reference time."""
    power: FloatArray
    """In units of the background; NaN in gaps."""


class MinuteMeans(NamedTuple):
    """Means over minutes, shape (N, C) each."""

    time_s: FloatArray
    """Mean time of the samples, seconds after the reference time; NaN where there are none."""
    power: FloatArray
    """In units of the background; NaN where there are no samples."""
    length_s: FloatArray
    """How long the samples are together."""
    apart_s: FloatArray
    """Time between two equal visits whose times have the standard deviation of those of the samples."""


Take = Callable[[Receiver, FloatArray], Samples]
"""Takes samples of a receiver whose records have their middles at so many seconds after the reference, shape (N,)."""


def observe(
    receiver: Receiver,
    bursts: Sequence[SimulatedBurst],
    start_utc: np.datetime64,
    stop_utc: np.datetime64,
    rng: np.random.Generator,
) -> xr.Dataset:
    """Dynamic spectrum of bursts as a receiver records it, with nothing else in it.

    Parameters
    ----------
    bursts : sequence of SimulatedBurst
        May be empty.
    start_utc, stop_utc : numpy.datetime64
        First record begins at the start, the last ends by the stop.

    Returns
    -------
    xarray.Dataset
        A dynamic spectrum in dB over background.

    Raises
    ------
    InputError
        If there is no record between start and stop, or there are too many.
    """
    middle_s = record_middles_s(receiver.cadence_s, 0.0, float((stop_utc - start_utc) / np.timedelta64(1, "s")))
    power = 1.0 + received_power(receiver, bursts, start_utc, middle_s)
    power *= 1 + receiver.noise * rng.standard_normal(power.shape)
    with np.errstate(invalid="ignore", divide="ignore"):
        intensity = 10 * np.log10(np.where(power > 0, power, np.nan))
    time = start_utc.astype("datetime64[ns]") + np.rint(middle_s * 1e9).astype("timedelta64[ns]")
    spectrum = xr.Dataset(
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
            "origin": "simulated",
            "source_files": "simulated",
        },
    )
    return validate_spectrum(spectrum, f"simulated {receiver.name}")


def record_middles_s(cadence_s: float, start_s: float, stop_s: float) -> FloatArray:
    """Middles of the records of a receiver, the first of which begins at the start.

    Parameters
    ----------
    start_s, stop_s : float
        After a reference time, s.

    Returns
    -------
    numpy.ndarray, shape (N,)
        s.

    Raises
    ------
    InputError
        If there is no record between start and stop, or there are too many.
    """
    records = int((stop_s - start_s) // cadence_s)
    if not 0 < records <= MAX_RECORDS:
        raise InputError(
            f"{records} records of {cadence_s:g} s in {stop_s - start_s:g} s; "
            f"ask for 1 to {MAX_RECORDS}: a stop after the start, and not too far"
        )
    return np.asarray(start_s + (np.arange(records) + 0.5) * cadence_s)


def received_power(
    receiver: Receiver, bursts: Sequence[SimulatedBurst], reference_utc: np.datetime64, middle_s: FloatArray
) -> FloatArray:
    """Power of bursts in every sample of a receiver, without background and noise.

    Parameters
    ----------
    reference_utc : numpy.datetime64
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
        _add(power, receiver, burst, middle_s - (burst.release_utc - reference_utc) / np.timedelta64(1, "s"))
    return power


def _add(power: FloatArray, receiver: Receiver, burst: SimulatedBurst, released_s: FloatArray) -> None:
    """Add a burst where it is received; records are counted from its release."""
    channels = receiver.frequency_mhz
    band = np.flatnonzero((channels >= burst.f_low_mhz) & (channels <= burst.f_high_mhz))
    if not band.size:
        return
    what = received(burst, channels[band], receiver.observatory)
    curves, half_s = what.curves(burst.pulse.family), 0.5 * receiver.integration_s
    begin_s, height = what.arrival_s.ravel(), what.height.ravel()
    column = np.repeat(band, what.height.shape[1])
    begin_s = begin_s - receiver.sample_offset_s[column]
    early_s, late_s = curves.reach_s()
    first = np.searchsorted(released_s, begin_s + early_s - half_s)
    last = np.searchsorted(released_s, begin_s + late_s + half_s)
    count = np.where(height > 0, np.maximum(last - first, 0), 0)
    pulse = np.repeat(np.arange(count.size), count)
    row = np.arange(pulse.size) - np.repeat(np.cumsum(count) - count, count) + first[pulse]
    after_s = released_s[row] - begin_s[pulse]
    mean = height[pulse] * curves.mean(pulse, after_s - half_s, after_s + half_s)
    np.add.at(power, (row, column[pulse]), mean)


def minute_means(
    channels_mhz: FloatArray, averaged: Sequence[Receiver], take: Take, phase_s: float, ends: tuple[int, int]
) -> MinuteMeans:
    """Means of the samples of every minute.

    Parameters
    ----------
    channels_mhz : numpy.ndarray, shape (C,)
        Ascending; those that no receiver has are NaN.
    averaged : sequence of Receiver
        Whose samples the means are of.
    phase_s : float
        When a record of the receivers begins, seconds after the reference time.
    ends : tuple of int
        First minute after the reference time, and the one after the last.

    Returns
    -------
    MinuteMeans
        One row for each minute.
    """
    minutes = ends[1] - ends[0]
    size = minutes * channels_mhz.size
    longest_s = max(one.cadence_s for one in averaged)
    first_s, last_s = MINUTE_S * ends[0] - 2 * longest_s, MINUTE_S * ends[1] + longest_s
    count, length, total, moment, square = np.zeros((5, size))
    for receiver in averaged:
        records = np.arange(first_s // receiver.cadence_s, last_s // receiver.cadence_s)
        middle_s, power, part_s = _in_parts(receiver, take, phase_s + records * receiver.cadence_s)
        minute = np.floor(middle_s / MINUTE_S).astype(np.intp) - ends[0]
        used = (minute >= 0) & (minute < minutes) & np.isfinite(power)
        cell = (minute * channels_mhz.size + np.searchsorted(channels_mhz, receiver.frequency_mhz))[used]
        within_s = middle_s[used] % MINUTE_S
        count += np.bincount(cell, minlength=size)
        length += part_s * np.bincount(cell, minlength=size)
        total += np.bincount(cell, power[used], size)
        moment += np.bincount(cell, within_s, size)
        square += np.bincount(cell, within_s**2, size)
    number = np.where(count > 0, count, np.nan)
    mean_s = moment / number
    apart_s = 2.0 * np.sqrt(np.maximum(square / number - mean_s**2, 0.0))
    begins_s = MINUTE_S * np.arange(*ends)[:, None]
    shape = (minutes, channels_mhz.size)
    means = (begins_s + mean_s.reshape(shape), *(one.reshape(shape) for one in (total / number, length, apart_s)))
    return MinuteMeans(*means)


def _in_parts(receiver: Receiver, take: Take, middle_s: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Times, power and length of parts of samples, which together have the noise of the whole."""
    number = max(1, int(receiver.integration_s // PART_S))
    part_s = receiver.integration_s / number
    after_s = (np.arange(number) - 0.5 * (number - 1)) * part_s
    part = replace(receiver, integration_s=part_s, noise=receiver.noise * np.sqrt(number))
    taken = take(part, (middle_s[:, None] + after_s).ravel())
    return taken.time_s, taken.power, part_s


def filled_in_frequency(spectrum: xr.Dataset) -> xr.Dataset:
    """One-minute averages of Wind RAD1 as the archive stores them.

    Parameters
    ----------
    spectrum : xarray.Dataset
        NaN where the receiver was not in a minute.

    Returns
    -------
    xarray.Dataset
        All minutes of the day: straight lines in frequency between what was measured in one, and beyond it at the ends,
        in the unit of the spectrum; without times of samples, which the archive does not have.
    """
    midnight = spectrum["time"].to_numpy()[0].astype("datetime64[D]").astype("datetime64[ns]")
    stamp = midnight + np.arange(1440) * np.timedelta64(1, "m") + np.timedelta64(30, "s")
    stored = spectrum.drop_vars(["sample_time", "visits_apart_s"], errors="ignore").reindex(time=stamp)
    channels, values = stored["frequency"].to_numpy(), stored["intensity"].to_numpy().astype(np.float64)
    for row in values:
        known = np.isfinite(row)
        if known.sum() > 1:
            row[~known] = interp1d(channels[known], row[known], fill_value="extrapolate")(channels[~known])
    return stored.assign(intensity=stored["intensity"].copy(data=values.astype(np.float32)))


def wave_angles(
    receiver: Receiver,
    bursts: Sequence[SimulatedBurst],
    reference_utc: np.datetime64,
    middle_s: FloatArray,
    rng: np.random.Generator,
) -> dict[str, FloatArray]:
    """Directions towards the sources, weighted by what is received from each, with a background from anywhere.

    Parameters
    ----------
    reference_utc : numpy.datetime64
        What the middles are counted from.
    middle_s : numpy.ndarray, shape (N,)
        Middles of the records, ascending, s.

    Returns
    -------
    dict of str to numpy.ndarray, shape (N, C)
        ``wave_colatitude_hee_deg`` and ``wave_azimuth_hee_deg``, HEE, degrees: apparent sources are true ones here.

    Raises
    ------
    NoDataError
        If the ephemeris does not have the spacecraft.
    """
    towards = rng.standard_normal((middle_s.size, receiver.frequency_mhz.size, 3))
    towards /= np.linalg.norm(towards, axis=2, keepdims=True)
    for burst in bursts:
        power = received_power(receiver, [burst], reference_utc, middle_s)
        rows = np.flatnonzero(power.any(axis=1))
        towards[rows] += power[rows][:, :, None] * _sight(burst, receiver)
    towards /= np.linalg.norm(towards, axis=2, keepdims=True)
    towards += np.radians(SCATTER_DEG) * rng.standard_normal(towards.shape)
    towards /= np.linalg.norm(towards, axis=2, keepdims=True)
    return {
        COLATITUDE: np.degrees(np.arccos(towards[..., 2])),
        AZIMUTH: np.degrees(np.arctan2(towards[..., 1], towards[..., 0])),
    }


def _sight(burst: SimulatedBurst, receiver: Receiver) -> FloatArray:
    """Unit vectors from the spacecraft to the source of each channel in the band of the burst, else 0, (C, 3)."""
    frequency = receiver.frequency_mhz
    inside = (frequency >= burst.f_low_mhz) & (frequency <= burst.f_high_mhz)
    place = position_hee(receiver.observatory, np.array([burst.release_utc]), burst.release_utc)[0]
    sight = np.zeros((frequency.size, 3))
    sight[inside] = source_position_rsun(burst, frequency[inside]) - place
    return np.asarray(sight / np.maximum(np.linalg.norm(sight, axis=1, keepdims=True), 1e-9))

"""One-minute averages as archives hold them: means of what falls into a minute, whenever in it that was."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.interpolate import interp1d

from bella.simulation.instruments import Instrument
from bella.simulation.receiver import Receiver
from bella.units import DAY_S, FloatArray

MINUTE_S = 60.0
MINUTES = int(DAY_S // MINUTE_S)
PART_S = 0.7
"""Longer samples are cut into parts of at least this length, as a minute may begin in one."""


class Samples(NamedTuple):
    """What a receiver took, shape (N, C) each."""

    time_s: FloatArray
    """Seconds after midnight."""
    power: FloatArray
    """In units of the background; NaN in gaps."""


Take = Callable[[Receiver, FloatArray], Samples]
"""Takes samples of a receiver whose records have their middles at so many seconds after midnight, shape (N,)."""


def minute_means(instrument: Instrument, take: Take, phase_s: float) -> Samples:
    """Mean of the samples of every minute of a day.

    Parameters
    ----------
    instrument : Instrument
        Whose records are averages.
    take : callable
    phase_s : float
        When a record of its receivers begins, seconds after midnight.

    Returns
    -------
    Samples
        Shape (1440, C); times are the mean times of the samples, NaN like the power where there is none.
    """
    channels = instrument.receiver.frequency_mhz
    size = MINUTES * channels.size
    longest_s = max(one.cadence_s for one in instrument.averaged)
    count, total, moment = np.zeros((3, size))
    for receiver in instrument.averaged:
        records = np.arange(-2 * longest_s // receiver.cadence_s, (DAY_S + longest_s) // receiver.cadence_s)
        time_s, power = _in_parts(receiver, take, phase_s + records * receiver.cadence_s)
        minute = np.floor(time_s / MINUTE_S).astype(np.intp)
        used = (minute >= 0) & (minute < MINUTES) & np.isfinite(power)
        cell = (minute * channels.size + np.searchsorted(channels, receiver.frequency_mhz))[used]
        count += np.bincount(cell, minlength=size)
        total += np.bincount(cell, power[used], size)
        moment += np.bincount(cell, time_s[used], size)
    number = np.where(count > 0, count, np.nan)
    return Samples(*(np.reshape(one / number, (MINUTES, channels.size)) for one in (moment, total)))


def _in_parts(receiver: Receiver, take: Take, middle_s: FloatArray) -> Samples:
    """Parts of samples, which together have the noise of the whole."""
    number = max(1, int(receiver.integration_s // PART_S))
    part_s = receiver.integration_s / number
    after_s = (np.arange(number) - 0.5 * (number - 1)) * part_s
    part = replace(receiver, integration_s=part_s, noise=receiver.noise * np.sqrt(number))
    return take(part, (middle_s[:, None] + after_s).ravel())


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
    stamp = midnight + np.arange(MINUTES) * np.timedelta64(1, "m") + np.timedelta64(30, "s")
    stored = spectrum.drop_vars("sample_time", errors="ignore").reindex(time=stamp)
    channels, values = stored["frequency"].to_numpy(), stored["intensity"].to_numpy().astype(np.float64)
    for row in values:
        known = np.isfinite(row)
        if known.sum() > 1:
            row[~known] = interp1d(channels[known], row[known], fill_value="extrapolate")(channels[~known])
    return stored.assign(intensity=stored["intensity"].copy(data=values.astype(np.float32)))

"""The 1-minute averages of Wind/WAVES RAD1: which samples were measured, and when.

In its list mode RAD1 hops through 64 steps of 2.86 s on 32 frequencies: the lowest are visited once in 183 s, the
highest four times. In the 1-minute files, what was not visited in a minute, channel or sample, is a straight line in
frequency between its measured neighbours. So which minutes hold a visit is seen in the file itself, and with the order
of the list this gives the time of every visit to a second, where the stamp of the minute is off by 7 s (standard
deviation) in the highest channels and 17 s in the others.

The order is that of the direction-finding file of 2020-07-11, whose samples carry their own times; it explains 99.6 %
of the minutes in the 1-minute files of 2010-01-17 and of 2020-07-21. RAD1 is described by Bougeret et al. 1995, Space
Sci. Rev. 71, 231, doi:10.1007/BF00751331.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.units import FloatArray

BoolArray = npt.NDArray[np.bool_]

LIST_KHZ = np.array(
    [
        [1040, 804, 624, 484, 376, 224, 136, 48, 916, 708, 548, 428, 292, 176, 80, 32],
        [1040, 804, 624, 484, 332, 196, 104, 40, 916, 708, 548, 428, 256, 152, 60, 24],
        [1040, 804, 624, 484, 376, 224, 116, 44, 916, 708, 548, 428, 292, 176, 72, 28],
        [1040, 804, 624, 484, 332, 196, 92, 36, 916, 708, 548, 428, 256, 152, 52, 20],
    ]
).ravel()
"""Frequencies in the order of the list, kHz."""

LIST_S = 183.26398
"""Duration of the list, s; its clock kept this to 0.5 ms through a day."""

DWELL_S = LIST_S / LIST_KHZ.size
MINUTE_S = 60.0
STRAIGHT = 3e-6
"""Departure from a straight line, as a share of the value, that rounding to float32 leaves."""

MEASURED_SHARE, FILLED_SHARE = 0.1, 0.1
"""A channel is measured if so many of its samples are; one with fewer straight ones was visited every minute, and these
are so by chance.
"""

RECOGNISED = 0.98
"""Share of the visits that the list has to explain."""

APART_STEP_S = 4 * DWELL_S
"""Times between the two visits of a minute are rounded to this and to seconds, as every one needs curves of its own."""

COARSE_S, FINE_S = 1.0, 0.25
COARSE_CHANNELS = 3
ROWS = 64
"""So many minutes are looked at in one go, to keep memory small."""


class Visits(NamedTuple):
    """Which samples of a day were measured."""

    measured: BoolArray
    """Shape (minutes, channels)."""
    known: BoolArray
    """Minutes with data, shape (minutes,)."""


def measured_samples(intensity: FloatArray, frequency_mhz: FloatArray) -> BoolArray:
    """Samples that are not on the straight line between their neighbours in frequency.

    Parameters
    ----------
    intensity : numpy.ndarray, shape (N, C)
        In the unit in which the archive interpolated.
    frequency_mhz : numpy.ndarray, shape (C,)
        Ascending, MHz.

    Returns
    -------
    numpy.ndarray of bool, shape (N, C)
        True also for the first and the last channel, of which nothing can be said, and next to missing samples.
    """
    measured = np.ones(intensity.shape, dtype=bool)
    share = (frequency_mhz[1:-1] - frequency_mhz[:-2]) / (frequency_mhz[2:] - frequency_mhz[:-2])
    for first in range(0, len(intensity), ROWS):
        rows = intensity[first : first + ROWS].astype(np.float64)
        line = (1.0 - share) * rows[:, :-2] + share * rows[:, 2:]
        with np.errstate(invalid="ignore"):
            straight = np.abs(line - rows[:, 1:-1]) < STRAIGHT * np.abs(rows[:, 1:-1])
        measured[first : first + ROWS, 1:-1] = ~straight
    return measured


class VisitedMinutes(NamedTuple):
    """When the list visits a frequency within each of N minutes."""

    duration_s: FloatArray
    """Time of the minute at this frequency, s; 0 without a visit."""
    middle_s: FloatArray
    """Mean time of what is in the minute, seconds after the first minute begins; NaN without a visit."""
    apart_s: FloatArray
    """Time between two visits in the minute, whole s; 0 where there is one. Where one of two is cut by the end of the
    minute, that of two equal visits whose times have the same standard deviation."""


def visited_minutes(frequency_khz: int, start_s: float, minutes: int) -> VisitedMinutes:
    """When the list visits a frequency within each minute.

    Parameters
    ----------
    frequency_khz : int
    start_s : float
        When the list begins, seconds after the first minute does.
    minutes : int
        Their number, N.

    Returns
    -------
    VisitedMinutes
    """
    runs = np.arange(-2, int(minutes * MINUTE_S / LIST_S) + 2) * LIST_S
    steps = np.flatnonzero(frequency_khz == LIST_KHZ) * DWELL_S
    begin = np.sort((start_s + runs[:, None] + steps).ravel())
    minute = np.floor(begin / MINUTE_S).astype(np.intp)
    border = (minute + 1) * MINUTE_S
    pieces = [(minute, begin, np.minimum(begin + DWELL_S, border))]
    pieces.append((minute + 1, np.minimum(border, begin + DWELL_S), begin + DWELL_S))
    duration, moment, square = np.zeros(minutes), np.zeros(minutes), np.zeros(minutes)
    for of, first, last in pieces:
        inside = (of >= 0) & (of < minutes)
        length = (last - first)[inside]
        within = 0.5 * (first + last)[inside] - MINUTE_S * of[inside]
        duration += np.bincount(of[inside], length, minutes)
        moment += np.bincount(of[inside], length * within, minutes)
        square += np.bincount(of[inside], length * within**2, minutes)
    with np.errstate(invalid="ignore", divide="ignore"):
        middle, variance = moment / duration, square / duration - (moment / duration) ** 2
    apart = np.rint(APART_STEP_S * np.rint(2.0 * np.sqrt(np.maximum(variance, 0.0)) / APART_STEP_S))
    return VisitedMinutes(duration, MINUTE_S * np.arange(minutes) + middle, np.nan_to_num(apart))


def with_visits(spectrum: xr.Dataset) -> xr.Dataset:
    """One-minute averages of RAD1 without what was interpolated, every sample at the time it was taken.

    Parameters
    ----------
    spectrum : xarray.Dataset
        Dynamic spectrum as it was archived, all channels and minutes of a day in the unit of the archive.

    Returns
    -------
    xarray.Dataset
        Interpolated samples are NaN and channels that are interpolated throughout are flagged ``interpolated``. With
        ``sample_time`` and ``visits_apart_s`` where the visits are those of the list; else ``sample_time_sd_s`` says
        that a sample which is not taken every minute is anywhere in its own. A spectrum without interpolated samples
        stays as it is.
    """
    intensity = np.array(spectrum["intensity"])
    frequency_mhz = spectrum["frequency"].to_numpy()
    if frequency_mhz.size < COARSE_CHANNELS:
        return spectrum
    visits = Visits(measured_samples(intensity, frequency_mhz), np.isfinite(intensity).all(axis=1))
    share = visits.measured[visits.known].mean(axis=0) if visits.known.any() else np.ones(frequency_mhz.size)
    sometimes = (share > MEASURED_SHARE) & (share < 1.0 - FILLED_SHARE)
    never = share <= MEASURED_SHARE
    if not (sometimes.any() or never.any()):
        return spectrum
    flagged = never | spectrum["interpolated"].to_numpy().astype(bool) if "interpolated" in spectrum else never
    intensity[~visits.measured & (sometimes & ~flagged)] = np.nan
    marked = spectrum.assign(intensity=spectrum["intensity"].copy(data=intensity), interpolated=("frequency", flagged))
    return _timed(marked, visits, sometimes & ~flagged) if sometimes.any() else marked


def _timed(marked: xr.Dataset, visits: Visits, sometimes: BoolArray) -> xr.Dataset:
    khz = np.rint(marked["frequency"].to_numpy() * 1e3).astype(np.intp)
    by_minute = (np.diff(marked["time"].to_numpy()) == np.timedelta64(60, "s")).all()
    columns = np.flatnonzero(sometimes & np.isin(khz, LIST_KHZ)) if by_minute else np.empty(0, dtype=np.intp)
    start_s = _list_start_s(visits, khz, columns)
    if start_s is None:
        return marked.assign(sample_time_sd_s=("frequency", np.where(sometimes, MINUTE_S / np.sqrt(12.0), 0.0)))
    minutes = marked.sizes["time"]
    sample_time = np.repeat(marked["time"].to_numpy()[:, None], khz.size, axis=1)
    midway_s = (np.arange(minutes) + 0.5) * MINUTE_S
    intensity, apart_s = marked["intensity"].to_numpy(), np.zeros((minutes, khz.size), dtype=np.uint8)
    for column in np.flatnonzero(np.isin(khz, LIST_KHZ)):
        visited = visited_minutes(int(khz[column]), start_s, minutes)
        late_s = np.where(visited.duration_s > 0.0, visited.middle_s - midway_s, 0.0)
        sample_time[:, column] += np.rint(late_s * 1e9).astype("timedelta64[ns]")
        apart_s[:, column] = visited.apart_s
        # of a visit that two minutes share the longer part stays
        intensity[visited.duration_s < 0.5 * DWELL_S, column] = np.nan
    unlisted = marked["interpolated"].to_numpy() | ~np.isin(khz, LIST_KHZ)
    return marked.assign(
        sample_time=(("time", "frequency"), sample_time),
        visits_apart_s=(("time", "frequency"), apart_s),
        interpolated=("frequency", unlisted),
    ).assign_attrs(integration_s=DWELL_S)


def _list_start_s(visits: Visits, khz: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]) -> float | None:
    """When the list begins, seconds after the first minute; None where it does not explain the visits."""
    if columns.size < COARSE_CHANNELS:
        return None
    highest = columns[-COARSE_CHANNELS:]
    coarse = np.arange(0.0, LIST_S, COARSE_S)
    first = coarse[int(np.argmax([_explained(visits, khz, highest, start) for start in coarse]))]
    # half a list later the highest channels have the same visits
    near = first + np.arange(-2 * COARSE_S, 2 * COARSE_S, FINE_S)
    fine = np.concatenate([near, near + 0.5 * LIST_S])
    explained = [_explained(visits, khz, columns, start) for start in fine]
    return float(fine[int(np.argmax(explained))]) if max(explained) >= RECOGNISED else None


def _explained(visits: Visits, khz: npt.NDArray[np.intp], columns: npt.NDArray[np.intp], start_s: float) -> float:
    """Share of minutes in which there is a visit where there should be, and none where not; median over channels."""
    agree = [
        (visited_minutes(int(khz[one]), start_s, visits.known.size).duration_s > 0.0)[visits.known]
        == visits.measured[visits.known, one]
        for one in columns
    ]
    return float(np.median([one.mean() for one in agree]))

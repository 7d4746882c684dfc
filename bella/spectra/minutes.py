"""Averages over a minute: which samples were measured in it, and when.

Wind/WAVES RAD1. In its list mode it hops through 64 steps of 2.86 s on 32 frequencies: the lowest are visited once in
183 s, the highest four times. In the 1-minute files, what was not visited in a minute, channel or sample, is a straight
line in frequency between its measured neighbours. So which minutes hold a visit is seen in the file itself, and with
the order of the list this gives the time of every visit to a second, where the stamp of the minute is off by 7 s
(standard deviation) in the highest channels and 17 s in the others.

The order is that of the direction-finding file of 2020-07-11, whose samples carry their own times; it explains 99.6 %
of the minutes in the 1-minute files of 2010-01-17 and of 2020-07-21. RAD1 is described by Bougeret et al. 1995, Space
Sci. Rev. 71, 231, doi:10.1007/BF00751331.

Wind/WAVES RAD2. It sweeps upward through its 256 channels in 16.192 s, so a minute of a channel is the mean of three or
four snapshots and the mean of their times is off the middle of the minute by up to 8 s, 2.9 s in standard deviation.
All channels of a burst err together, as neighbours are sampled together.

Means of three snapshots scatter more than those of four. So the noise of a day tells which minutes held three, and that
when the sweeps began.
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

SWEEP_S = 16.192
"""Duration of a sweep, s; the same in the files of 2010-01-17 and 2020-07-21 to 0.5 ms."""

SWEEP_LOWEST_MHZ, SWEEP_STEP_MHZ, SWEEP_CHANNELS = 1.075, 0.05, 256
FEWEST_MINUTES = 360
GROUP = 16
"""So many neighbouring channels are looked at together: they are swept within a second."""

LARGEST_SCATTER = 4.0
"""Departures are cut at so many times their median, as single samples are disturbed."""

SWEEPS_RECOGNISED = 0.05
"""Correlation of scatter and number of snapshots. With 23000 values of no order it stays below 0.03."""

COARSE_SWEEP_S, FINE_SWEEP_S = 0.5, 0.1


class Visits(NamedTuple):
    """Which samples of a day were measured."""

    measured: BoolArray
    """Shape (minutes, channels)."""
    known: BoolArray
    """Minutes with data, shape (minutes,)."""


def mean_time_sd_s(revisit_s: float, span_s: float = 60.0) -> float:
    """How far from the middle of an interval the mean time of the samples is that fall in it.

    A minute that averages one or two sweeps of 38 s holds them anywhere; its middle is not when it was measured.

    Parameters
    ----------
    revisit_s : float
        Time from one sample of a channel to the next, s.
    span_s : float
        Length of the interval, s.

    Returns
    -------
    float
        Standard deviation over all ways in which samples and intervals may lie, of intervals with a sample, s.
    """
    whole = np.floor(span_s / revisit_s)
    # the mean of one sample more is uniform over the first width, of as many as fit over the second
    widths = np.array([span_s - whole * revisit_s, (whole + 1) * revisit_s - span_s if whole else 0.0])
    return float(np.sqrt((widths**3).sum() / 12.0 / widths.sum()))


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
    start_s : float
        When the list begins, seconds after the first minute does.
    minutes : int
        Their number, N.
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
    known = np.flatnonzero(visits.known)
    agree = [
        (_is_visited(int(khz[one]), start_s, visits.known.size)[known] == visits.measured[known, one]).mean()
        for one in columns
    ]
    return float(np.median(agree))


def _is_visited(frequency_khz: int, start_s: float, minutes: int) -> BoolArray:
    """Whether the list visits a frequency within each minute."""
    runs = np.arange(-2, int(minutes * MINUTE_S / LIST_S) + 2) * LIST_S
    begin = (start_s + runs[:, None] + np.flatnonzero(frequency_khz == LIST_KHZ) * DWELL_S).ravel()
    ends = np.concatenate([begin // MINUTE_S, np.ceil((begin + DWELL_S) / MINUTE_S) - 1.0]).astype(np.intp)
    visited = np.zeros(minutes, dtype=bool)
    visited[ends[(ends >= 0) & (ends < minutes)]] = True
    return visited


def snapshots(channel: int, start_s: float, minutes: int) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """How many snapshots of a channel fall into each minute, and when.

    Parameters
    ----------
    channel : int
        Counted from the lowest.
    start_s : float
        When a sweep begins, seconds after the first minute does.
    minutes : int
        Their number, N.

    Returns
    -------
    number : numpy.ndarray of int, shape (N,)
    middle_s : numpy.ndarray, shape (N,)
        Mean of their times, seconds after the first minute begins.
    """
    first_s = (start_s + (channel + 0.5) * SWEEP_S / SWEEP_CHANNELS) % SWEEP_S
    # the first snapshot of every minute, counted from the first of all
    begin = np.ceil((np.arange(minutes + 1) * MINUTE_S - first_s) / SWEEP_S)
    number = np.diff(begin).astype(np.intp)
    return number, first_s + SWEEP_S * 0.5 * (begin[:-1] + begin[1:] - 1.0)


def with_sweeps(spectrum: xr.Dataset) -> xr.Dataset:
    """One-minute averages of RAD2, every sample at the mean time of its snapshots.

    Parameters
    ----------
    spectrum : xarray.Dataset
        Dynamic spectrum as it was archived, all channels and minutes of a day.

    Returns
    -------
    xarray.Dataset
        With ``sample_time`` where the noise shows the sweeps; else with ``sample_time_sd_s``, 2.9 s.
    """
    start_s = sweep_start_s(spectrum)
    if start_s is None:
        sd_s = np.full(spectrum.sizes["frequency"], mean_time_sd_s(SWEEP_S))
        return spectrum.assign(sample_time_sd_s=("frequency", sd_s))
    minutes = spectrum.sizes["time"]
    midway_s = (np.arange(minutes) + 0.5) * MINUTE_S
    record = spectrum["time"].to_numpy().astype("datetime64[ns]")
    sample_time = np.empty((minutes, spectrum.sizes["frequency"]), dtype="datetime64[ns]")
    for column, channel in enumerate(_sweep_channels(spectrum)):
        late_s = snapshots(int(channel), start_s, minutes)[1] - midway_s
        sample_time[:, column] = record + np.rint(late_s * 1e9).astype("timedelta64[ns]")
    return spectrum.assign(sample_time=(("time", "frequency"), sample_time))


def sweep_start_s(spectrum: xr.Dataset) -> float | None:
    """When a sweep begins, as the noise shows it.

    Parameters
    ----------
    spectrum : xarray.Dataset
        As for :func:`with_sweeps`.

    Returns
    -------
    float or None
        Seconds after the first minute, below the duration of a sweep; None where the noise shows no sweeps.
    """
    channels = _sweep_channels(spectrum)
    by_minute = (np.diff(spectrum["time"].to_numpy()) == np.timedelta64(60, "s")).all()
    if (
        not by_minute
        or spectrum.sizes["time"] < FEWEST_MINUTES
        or not np.array_equal(channels, np.arange(SWEEP_CHANNELS))
    ):
        return None
    scatter = _scatter(spectrum["intensity"].to_numpy())
    coarse = np.arange(0.0, SWEEP_S, COARSE_SWEEP_S)
    first = coarse[int(np.argmax([_correlation(scatter, start) for start in coarse]))]
    fine = first + np.arange(-COARSE_SWEEP_S, COARSE_SWEEP_S + FINE_SWEEP_S, FINE_SWEEP_S)
    found = [_correlation(scatter, start) for start in fine]
    return float(fine[int(np.argmax(found))] % SWEEP_S) if max(found) >= SWEEPS_RECOGNISED else None


def _sweep_channels(spectrum: xr.Dataset) -> npt.NDArray[np.intp]:
    return np.rint((spectrum["frequency"].to_numpy() - SWEEP_LOWEST_MHZ) / SWEEP_STEP_MHZ).astype(np.intp)


def _scatter(ratio: npt.NDArray[np.float32]) -> FloatArray:
    """How far samples depart from the mean of their neighbours in frequency, over what is usual; (minutes, groups)."""
    groups = [ratio[:, max(first - 1, 0) : first + GROUP + 1] for first in range(0, SWEEP_CHANNELS, GROUP)]
    return np.stack([_scatter_of_group(one.astype(np.float64)) for one in groups], axis=1)


def _scatter_of_group(ratio: FloatArray) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):
        level = np.log(ratio)
    departure = np.abs(level[:, 1:-1] - 0.5 * (level[:, 2:] + level[:, :-2]))
    known = np.isfinite(departure)
    usual = [np.median(column[of]) if of.any() else 1.0 for column, of in zip(departure.T, known.T, strict=True)]
    with np.errstate(divide="ignore", invalid="ignore"):
        departure = np.minimum(departure / np.array(usual), LARGEST_SCATTER)
    total, number = np.where(known, departure, 0.0).sum(axis=1), known.sum(axis=1)
    return np.where(number > GROUP // 2, total / np.maximum(number, 1), np.nan)


def _correlation(scatter: FloatArray, start_s: float) -> float:
    """Of the scatter with the number of snapshots, taken negative; every group of channels about its own mean."""
    middles = np.arange(GROUP // 2, SWEEP_CHANNELS, GROUP)
    number = np.stack([snapshots(int(one), start_s, len(scatter))[0] for one in middles], axis=1).astype(np.float64)
    known = np.isfinite(scatter)
    departure, excess = (_about_mean(one, known) for one in (scatter, number))
    size = np.sqrt((departure**2).sum() * (excess**2).sum())
    return float(-(departure * excess).sum() / size) if size > 0.0 else 0.0


def _about_mean(values: FloatArray, known: npt.NDArray[np.bool_]) -> FloatArray:
    filled = np.where(known, values, 0.0)
    return np.where(known, filled - filled.sum(axis=0) / np.maximum(known.sum(axis=0), 1), 0.0)

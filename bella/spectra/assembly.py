"""From the arrays of an archive file, or a list of samples of a receiver that hops, to a dynamic spectrum.

Nothing here refuses a spectrum for what stands beside it: twins keep the one with data, records are put in order, a
record whose clock jumped is left out, frequencies that move a little are one channel.
"""

import math
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.containers import ANOTHER
from bella.exceptions import InputError
from bella.spectra.dynamic_spectrum import label, validate_spectrum, without_fill

SAME_CHANNEL = 0.1
"""Frequencies of two records within this share of the step between channels are one channel."""

STRAY_STEPS, MOST_STRAY = 10.0, 10
"""Records, as many at most, so many steps outside their neighbours in the file, which follow one another, have a wrong
time."""

STANDING_SHARE = 0.05
"""Share of records above which a clock that repeats its times stood still."""

SAME_FREQUENCY = 3e-4
"""Samples whose frequencies differ by less, in ln f, are of one channel: a tenth of the narrowest step of any receiver,
50 kHz at 16 MHz."""

EARLY = 0.02
"""Share of a pass by which a sample may come before its pass begins: cadences are not exact to the last tick."""


@dataclass(frozen=True)
class Origin:
    """Who measured a spectrum, and where it was read.

    Attributes
    ----------
    observatory, receiver : str
        Names, such as STEREO-A and HFR.
    quantity : str
        One of ``QUANTITIES``.
    integration_s : float, optional
        The longest that a sample can have been integrated, s, where that is less than the time between records.
    """

    observatory: str
    receiver: str
    quantity: str
    source: str
    integration_s: float = math.inf


def assemble(
    origin: Origin,
    time: npt.NDArray[np.datetime64],
    frequency_mhz: npt.NDArray[Any],
    intensity: npt.NDArray[Any],
    extra: Mapping[str, npt.NDArray[Any]] | None = None,
) -> xr.Dataset:
    """Order records and channels of what was read and give it the form of a dynamic spectrum.

    Records without a time and channels without a frequency are dropped; of repeated ones that with most data stays.

    Parameters
    ----------
    origin : Origin
        Where it comes from.
    time : numpy.ndarray
        datetime64[ns], UTC, shape (records,).
    frequency_mhz : numpy.ndarray
        Shape (channels,).
    intensity : numpy.ndarray
        Shape (records, channels), NaN where there are no data.
    extra : mapping of str to numpy.ndarray, optional
        Further variables, each of shape (channels,) or (records, channels).

    Returns
    -------
    xarray.Dataset
        A dynamic spectrum; ``integration_s`` is what the origin says, at most the median step between records.

    Raises
    ------
    InputError
        If the shapes do not fit or less than two records remain.
    """
    intensity = without_fill(intensity, origin.quantity)
    check_clock(time, origin.source)
    frequency_mhz = np.where(frequency_mhz > 0.0, frequency_mhz, np.nan)
    variables = {"intensity": intensity, **(extra or {})}
    for name, values in variables.items():
        if values.shape not in {(time.size, frequency_mhz.size), (frequency_mhz.size,)}:
            raise InputError(
                f"{origin.source}: {name} of {origin.receiver} has the shape {values.shape}, "
                f"but there are {time.size} times and {frequency_mhz.size} frequencies; {ANOTHER}"
            )
    records = ascending(without_strays(time), lambda: np.isfinite(intensity).sum(axis=1))
    channels = ascending(frequency_mhz, lambda: np.isfinite(intensity).sum(axis=0))
    ordered = {
        name: (("frequency",), values[channels])
        if values.ndim == 1
        else (("time", "frequency"), _picked(values, records, channels))
        for name, values in variables.items()
    }
    coords = {"time": time[records].astype("datetime64[ns]"), "frequency": frequency_mhz[channels].astype(np.float64)}
    spectrum = xr.Dataset(ordered, coords=coords, attrs=_attributes(origin, coords["time"]))
    spectrum["intensity"] = spectrum["intensity"].astype(np.float32, copy=False)
    return label(validate_spectrum(spectrum, origin.source))


def check_clock(time: npt.NDArray[np.datetime64], source: str) -> None:
    """Refuse records of a clock that stood still, which would pass for repeated ones.

    Parameters
    ----------
    time : numpy.ndarray
        datetime64[ns], in the order of the file.
    source : str
        File, named in the error.

    Raises
    ------
    InputError
        If too many records have the time of the two before.
    """
    same = np.diff(time) == np.timedelta64(0, "ns")
    still = np.flatnonzero(same[1:] & same[:-1])
    if still.size > STANDING_SHARE * time.size:
        raise InputError(
            f"{source}: {still.size} of {time.size} records have the time of the two before, such as "
            f"{np.datetime_as_string(time[still[0]], 's')}: its clock stood still; {ANOTHER}"
        )


def dates_in(name: str) -> list[np.datetime64]:
    """Days that the name of a file states as YYYYMMDD; digits that are no day of the space age are none.

    Parameters
    ----------
    name : str
        Name of a file, or a logical identity.

    Returns
    -------
    list of numpy.datetime64
        Midnights, UTC, ns.
    """
    days: list[np.datetime64] = []
    for year, month, day in re.findall(r"(?<!\d)((?:19|20)\d{2})(\d{2})(\d{2})(?!\d)", name):
        with suppress(ValueError):
            days.append(np.datetime64(f"{year}-{month}-{day}", "ns"))
    return days


def date_of(name: str) -> np.datetime64:
    """Midnight of the day in the name of a file that states no date itself.

    Parameters
    ----------
    name : str
        Name with eight digits YYYYMMDD in it.

    Returns
    -------
    numpy.datetime64
        UTC, ns.

    Raises
    ------
    InputError
        If there is no date.
    """
    days = dates_in(name)
    if not days:
        raise InputError(f"{name} does not say of which day it is: name it ..._YYYYMMDD...")
    return days[0]


def cadence_s(time: npt.NDArray[np.datetime64]) -> float:
    """Median step between records in whatever order, s; 1 where there are none."""
    steps = np.diff(np.unique(time[~np.isnat(time)]))
    return float(np.median(steps) / np.timedelta64(1, "s")) if steps.size else 1.0


def shared_channels(
    frequency_mhz: npt.NDArray[Any], values: npt.NDArray[Any], source: str
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Put records whose list of channels may change from one to the next on one list of channels.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray
        Shape (channels,), then everything is returned as it is, or (records, channels).
    values : numpy.ndarray
        Shape (records, channels).
    source : str
        File, named in the error.

    Returns
    -------
    frequency_mhz : numpy.ndarray
        Shape (all channels,); where a channel moves a little, its mean.
    values : numpy.ndarray
        Shape (records, all channels), NaN where a record lacks a channel.

    Raises
    ------
    InputError
        If the shapes do not fit or the channels are never the same.
    """
    if frequency_mhz.ndim == 1:
        return frequency_mhz, values
    if frequency_mhz.shape != values.shape:
        raise InputError(
            f"{source}: frequencies of shape {frequency_mhz.shape} for values of shape {values.shape}; {ANOTHER}"
        )
    if (frequency_mhz == frequency_mhz[0]).all():
        return frequency_mhz[0], values
    known = np.isfinite(frequency_mhz) & (frequency_mhz > 0.0)
    if (settled := _settled(frequency_mhz, known)) is not None:
        return settled, values
    rows = np.sort(np.log(np.where(known, frequency_mhz, np.nan)), axis=1)
    steps = np.diff(rows, axis=1)
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    channels, column = merged_channels(frequency_mhz[known], SAME_CHANNEL * step)
    if channels.size > 16 * values.shape[1]:
        raise InputError(f"{source}: {channels.size} frequencies in records of {values.shape[1]} channels; {ANOTHER}")
    no_data = "NaT" if values.dtype.kind == "M" else np.nan
    spread = np.full((values.shape[0], channels.size), no_data, dtype=values.dtype)
    row = np.broadcast_to(np.arange(values.shape[0])[:, None], values.shape)[known]
    has_value = np.isfinite(values[known])
    spread[row[has_value], column[has_value]] = values[known][has_value]
    return channels, spread


def _settled(frequency_mhz: npt.NDArray[Any], known: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64] | None:
    """Mean of every column where each moves by less than it is from its neighbours; None where one moves more."""
    if not (known.any(axis=0) == known.all(axis=0)).all():
        return None
    with np.errstate(invalid="ignore", divide="ignore"):
        level = np.log(np.where(known, frequency_mhz, np.nan))
    apart = np.abs(np.diff(level, axis=1))
    moved = level.max(axis=0) - level.min(axis=0)
    least = np.nanmin(apart) if np.isfinite(apart).any() else np.inf
    return np.asarray(frequency_mhz.mean(axis=0), np.float64) if np.nanmax(moved) <= SAME_CHANNEL * least else None


def merged_channels(
    frequency_mhz: npt.NDArray[Any], tolerance: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp]]:
    """Channels of a list of frequencies, those that differ by little taken as one.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray
        Shape (samples,), above zero.
    tolerance : float
        Largest step in ln f within a channel.

    Returns
    -------
    channels : numpy.ndarray
        Ascending, MHz: the mean of each.
    column : numpy.ndarray of int
        Channel of every sample.
    """
    distinct, inverse = np.unique(frequency_mhz, return_inverse=True)
    level = np.log(distinct)
    label = np.concatenate([[0], np.cumsum(np.diff(level) > tolerance)]).astype(np.intp)[: distinct.size]
    first = np.flatnonzero(np.diff(label, prepend=-1))
    last = np.append(first[1:], distinct.size) - 1
    if (level[last] - level[first] > 3.0 * tolerance).any():  # they follow one another without a gap: no channels
        return distinct.astype(np.float64), np.asarray(inverse, dtype=np.intp)
    column = label[inverse]
    if first.size == distinct.size:
        return distinct.astype(np.float64), np.asarray(column, dtype=np.intp)
    mean = np.bincount(column, weights=frequency_mhz) / np.bincount(column)
    return np.asarray(mean, dtype=np.float64), np.asarray(column, dtype=np.intp)


def nearest_records(
    leader: npt.NDArray[np.datetime64], follower: npt.NDArray[np.datetime64], within_s: float
) -> npt.NDArray[np.intp]:
    """Record of one axis that each record of another joins, each at most one, the nearest first.

    Parameters
    ----------
    leader, follower : numpy.ndarray
        datetime64[ns], the first ascending with two records at least.
    within_s : float
        How far apart they may be, s.

    Returns
    -------
    numpy.ndarray of int
        Index into `leader` for each of `follower`; -1 where it stands alone.
    """
    partner = np.full(follower.size, -1, dtype=np.intp)
    if leader.size < 2:
        return partner
    after = np.clip(np.searchsorted(leader, follower), 1, leader.size - 1)
    nearest = np.where(follower - leader[after - 1] <= leader[after] - follower, after - 1, after)
    distance_s = np.abs(follower - leader[nearest]) / np.timedelta64(1, "s")
    closest_first = np.argsort(distance_s, kind="stable")
    closest_first = closest_first[distance_s[closest_first] <= within_s]
    _, index = np.unique(nearest[closest_first], return_index=True)
    chosen = closest_first[index]
    partner[chosen] = nearest[chosen]
    return partner


def without_strays(time: npt.NDArray[np.datetime64]) -> npt.NDArray[np.datetime64]:
    """Times of records, NaT for few that lie far outside their neighbours in the file, which follow one another.

    Parameters
    ----------
    time : numpy.ndarray
        datetime64[ns], in the order of the file.

    Returns
    -------
    numpy.ndarray
        Of the same shape.
    """
    known = np.flatnonzero(~np.isnat(time))
    if known.size < 5:
        return time
    second = (time[known] - time[known[0]]) / np.timedelta64(1, "s")
    steps = np.diff(second)
    step = np.median(np.abs(steps))
    first = np.concatenate([[0], np.flatnonzero(np.abs(steps) > STRAY_STEPS * step) + 1])  # of what has no jump in it
    if first.size < 3:
        return time
    begin, end = first[1:-1], first[2:]
    count = end - begin
    before, after = second[begin - 1], second[end]
    lowest, highest = (reduced.reduceat(second, first)[1:-1] for reduced in (np.minimum, np.maximum))
    outside = np.maximum(np.minimum(before, after) - highest, lowest - np.maximum(before, after))
    follow = np.abs(after - before) <= (2.0 * count + 2.0) * step
    is_stray = follow & (outside > STRAY_STEPS * step) & (count <= min(MOST_STRAY, known.size // 4))
    if not is_stray.any():
        return time
    kept = time.copy()
    for one, beyond in zip(begin[is_stray], end[is_stray], strict=True):
        kept[known[one:beyond]] = np.datetime64("NaT")
    return kept


def ascending(axis: npt.NDArray[Any], data_count: Callable[[], npt.NDArray[Any]]) -> npt.NDArray[np.intp]:
    """Indices that order an axis without its gaps; of equal ones that with most data, of those the first.

    Parameters
    ----------
    axis : numpy.ndarray
        Times, frequencies.
    data_count : callable
        Gives how many data stand at each place; is called only where some are equal.
    """
    known = np.flatnonzero(~np.isnan(axis) if axis.dtype.kind in "fM" else np.ones(axis.size, dtype=bool))
    _, first = np.unique(axis[known], return_index=True)
    if first.size < known.size:
        order = known[np.lexsort((-data_count()[known], axis[known]))]
        first = np.flatnonzero(np.concatenate([[True], axis[order][1:] != axis[order][:-1]]))
        return np.asarray(order[first], dtype=np.intp)
    return np.asarray(known[first], dtype=np.intp)


def _picked(
    values: npt.NDArray[Any], records: npt.NDArray[np.intp], channels: npt.NDArray[np.intp]
) -> npt.NDArray[Any]:
    """Values in order; those that are in order already are not copied."""
    if values.shape == (records.size, channels.size) and _is_range(records) and _is_range(channels):
        return values
    return values[np.ix_(records, channels)]


def _is_range(index: npt.NDArray[np.intp]) -> bool:
    return bool((index == np.arange(index.size)).all())


def _attributes(origin: Origin, time: npt.NDArray[np.datetime64]) -> dict[str, Any]:
    return {
        "observatory": origin.observatory,
        "receiver": origin.receiver,
        "quantity": origin.quantity,
        "integration_s": min(cadence_s(time), origin.integration_s),
        "source_files": [origin.source],
    }


def assemble_sweeps(
    origin: Origin,
    sweep: npt.NDArray[Any],
    time: npt.NDArray[np.datetime64],
    frequency_mhz: npt.NDArray[Any],
    values: Mapping[str, npt.NDArray[Any]],
) -> xr.Dataset:
    """Order samples by pass and frequency.

    A receiver may visit some channels several times in a sweep. A sweep is then cut into as many passes as its most
    visited channel has, of equal length; a channel that is not visited in a pass is NaN there. Nothing is interpolated.

    Parameters
    ----------
    origin : Origin
        Where the samples come from.
    sweep : numpy.ndarray
        Number of the sweep of each sample, shape (samples,).
    time : numpy.ndarray
        datetime64[ns], UTC, of each sample.
    frequency_mhz : numpy.ndarray
        Of each sample; NaN where not known.
    values : mapping of str to numpy.ndarray
        "intensity" and others, shape (samples,).

    Returns
    -------
    xarray.Dataset
        A dynamic spectrum with ``sample_time``; ``time`` is half way between the first and last sample of a record.
        ``integration_s`` is the time from one sample to the next: the receiver cannot have dwelt for longer.

    Raises
    ------
    InputError
        If the arrays have different lengths, or no samples remain.
    """
    if any(array.shape != time.shape for array in (sweep, frequency_mhz, *values.values())):
        raise InputError(f"{origin.source}: the variables of {origin.receiver} have different lengths; {ANOTHER}")
    time = without_strays(time)
    order = np.argsort(time, kind="stable")
    order = order[(~np.isnat(time) & (frequency_mhz > 0.0) & np.isfinite(sweep))[order]]
    if not order.size:
        raise InputError(
            f"{origin.source}: no sample of {origin.receiver} has a time, a frequency and a sweep; {ANOTHER}"
        )
    sweep, time, frequency_mhz = sweep[order], time[order], frequency_mhz[order]
    origin = replace(origin, integration_s=dwell_s(time))
    channels, column = merged_channels(frequency_mhz, SAME_FREQUENCY)
    row = _passes(np.unique(sweep, return_inverse=True)[1], column, time)
    shape = (int(row.max()) + 1, channels.size)
    if shape[0] * shape[1] > 64 * time.size + 4096:
        raise InputError(
            f"{origin.source}: {time.size} samples at {channels.size} frequencies are no sweeps; {ANOTHER}"
        )
    when = np.full(shape, np.datetime64("NaT"), dtype="datetime64[ns]")
    # what is written last stays: the first visit with a value of several in one record
    last = np.argsort(np.isfinite(values["intensity"][order])[::-1], kind="stable").astype(np.int32)
    np.subtract(order.size - 1, last, out=last)
    row, column, order, time = row[last], column[last], order[last], time[last]
    when[row, column] = time
    centre = record_centres(row, time)
    del time, last
    missing = np.isnat(when)
    when[missing] = np.broadcast_to(centre[:, None], shape)[missing]
    extra = {name: _spread(array[order], row, column, shape) for name, array in values.items()}
    del row, column, order, missing
    return assemble(origin, centre, channels, extra.pop("intensity"), {"sample_time": when, **extra})


def dwell_s(time: npt.NDArray[np.datetime64]) -> float:
    """Longest that a receiver can have stayed at a frequency before it went on to the next.

    Parameters
    ----------
    time : numpy.ndarray
        datetime64[ns] of samples, in any order.

    Returns
    -------
    float
        Median step from one sample to the next, s; infinite where all were taken at once.
    """
    steps = np.diff(np.unique(time[~np.isnat(time)]))
    return float(np.median(steps) / np.timedelta64(1, "s")) if steps.size else np.inf


def _passes(
    sweep: npt.NDArray[np.intp], column: npt.NDArray[np.intp], time: npt.NDArray[np.datetime64]
) -> npt.NDArray[np.intp]:
    """Number of the pass of each sample, counted without gaps; samples are in order of time."""
    second = (time - time[0]) / np.timedelta64(1, "s")
    begin = np.full(int(sweep.max()) + 1, np.inf)
    np.minimum.at(begin, sweep, second)
    step_s = _pass_length_s(sweep, column, second)
    within = np.floor((second - begin[sweep]) / step_s + EARLY).astype(np.int64)
    longest = int(within.max()) + 1
    return np.asarray(np.unique(sweep * longest + within, return_inverse=True)[1], dtype=np.intp)


def _pass_length_s(sweep: npt.NDArray[np.intp], column: npt.NDArray[np.intp], second: npt.NDArray[np.float64]) -> float:
    """Median time between two visits of the most visited channel in one sweep, s; infinite where it has one visit."""
    counts = np.bincount(column)
    busiest = column == counts.argmax()
    steps = np.diff(second[busiest])[np.diff(sweep[busiest]) == 0]
    return float(np.median(steps)) if 2 * steps.size > np.unique(sweep[busiest]).size else np.inf


def record_centres(row: npt.NDArray[np.intp], time: npt.NDArray[np.datetime64]) -> npt.NDArray[np.datetime64]:
    """Half way between the first and the last sample of every record.

    Parameters
    ----------
    row : numpy.ndarray
        Record of each sample, counted without gaps.
    time : numpy.ndarray
        datetime64[ns] of each sample, none missing.

    Returns
    -------
    numpy.ndarray
        datetime64[ns], shape (records,).
    """
    nanosecond = time.astype("datetime64[ns]").astype(np.int64)
    first = np.full(int(row.max()) + 1, np.iinfo(np.int64).max)
    last = np.full(first.size, np.iinfo(np.int64).min)
    np.minimum.at(first, row, nanosecond)
    np.maximum.at(last, row, nanosecond)
    return np.asarray(first + (last - first) // 2, dtype="datetime64[ns]")


def _spread(
    values: npt.NDArray[Any], row: npt.NDArray[np.intp], column: npt.NDArray[np.intp], shape: tuple[int, int]
) -> npt.NDArray[np.float32]:
    grid = np.full(shape, np.nan, dtype=np.float32)
    grid[row, column] = values
    return grid

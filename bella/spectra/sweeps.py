"""Receivers that hop between frequencies: from a list of samples to records, each sample with its own time."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.exceptions import InputError
from bella.spectra.assembly import Origin, assemble

EARLY = 0.02
"""Share of a pass by which a sample may come before its pass begins: cadences are not exact to the last tick."""


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
        raise InputError(f"{origin.source}: the variables of {origin.receiver} have different lengths")
    order = np.argsort(time, kind="stable")
    order = order[(~np.isnat(time) & np.isfinite(frequency_mhz) & np.isfinite(sweep))[order]]
    if not order.size:
        raise InputError(f"{origin.source}: no sample of {origin.receiver} has a time, a frequency and a sweep")
    sweep, time, frequency_mhz = sweep[order], time[order], frequency_mhz[order]
    origin = replace(origin, integration_s=dwell_s(time))
    channels, column = np.unique(frequency_mhz, return_inverse=True)
    row = _passes(np.unique(sweep, return_inverse=True)[1], column, time)
    shape = (int(row.max()) + 1, channels.size)
    if shape[0] * shape[1] > 64 * time.size + 4096:
        raise InputError(f"{origin.source}: {time.size} samples at {channels.size} frequencies are no sweeps")
    when = np.full(shape, np.datetime64("NaT"), dtype="datetime64[ns]")
    when[row[::-1], column[::-1]] = time[::-1]  # from the back, so that the first of two visits stays
    centre = record_centres(row, time)
    missing = np.isnat(when)
    when[missing] = np.broadcast_to(centre[:, None], shape)[missing]
    extra = {name: _spread(array[order], row, column, shape) for name, array in values.items()}
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
    grid[row[::-1], column[::-1]] = values[::-1]
    return grid

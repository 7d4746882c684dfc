"""The 1-minute averages of Wind/WAVES RAD2: when their sweeps were.

RAD2 sweeps upward through its 256 channels in 16.192 s, so a minute of a channel is the mean of three or four snapshots
and the mean of their times is off the middle of the minute by up to 8 s, 2.9 s in standard deviation. All channels of a
burst err together, as neighbours are sampled together.

Means of three snapshots scatter more than those of four. So the noise of a day tells which minutes held three, and that
when the sweeps began. RAD2 is described by Bougeret et al. 1995, Space Sci. Rev. 71, 231, doi:10.1007/BF00751331.
"""

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.spectra.list_mode import MINUTE_S
from bella.spectra.sweeps import mean_time_sd_s
from bella.units import FloatArray

SWEEP_S = 16.192
"""Duration of a sweep, s; the same in the files of 2010-01-17 and 2020-07-21 to 0.5 ms."""

LOWEST_MHZ, STEP_MHZ, CHANNELS = 1.075, 0.05, 256
FEWEST_MINUTES = 360
GROUP = 16
"""So many neighbouring channels are looked at together: they are swept within a second."""

LARGEST_SCATTER = 4.0
"""Departures are cut at so many times their median, as single samples are disturbed."""

RECOGNISED = 0.05
"""Correlation of scatter and number of snapshots. With 23000 values of no order it stays below 0.03."""

COARSE_S, FINE_S = 0.5, 0.1


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
    first_s = (start_s + (channel + 0.5) * SWEEP_S / CHANNELS) % SWEEP_S
    moment = np.arange(first_s, minutes * MINUTE_S, SWEEP_S)
    minute = (moment // MINUTE_S).astype(np.intp)
    number = np.bincount(minute, minlength=minutes)
    return number, np.bincount(minute, moment, minutes) / number


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
    for column, channel in enumerate(_channels(spectrum)):
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
    channels = _channels(spectrum)
    by_minute = (np.diff(spectrum["time"].to_numpy()) == np.timedelta64(60, "s")).all()
    if not by_minute or spectrum.sizes["time"] < FEWEST_MINUTES or not np.array_equal(channels, np.arange(CHANNELS)):
        return None
    scatter = _scatter(spectrum["intensity"].to_numpy())
    coarse = np.arange(0.0, SWEEP_S, COARSE_S)
    first = coarse[int(np.argmax([_correlation(scatter, start) for start in coarse]))]
    fine = first + np.arange(-COARSE_S, COARSE_S + FINE_S, FINE_S)
    found = [_correlation(scatter, start) for start in fine]
    return float(fine[int(np.argmax(found))] % SWEEP_S) if max(found) >= RECOGNISED else None


def _channels(spectrum: xr.Dataset) -> npt.NDArray[np.intp]:
    return np.rint((spectrum["frequency"].to_numpy() - LOWEST_MHZ) / STEP_MHZ).astype(np.intp)


def _scatter(ratio: npt.NDArray[np.float32]) -> FloatArray:
    """How far samples depart from the mean of their neighbours in frequency, over what is usual; (minutes, groups)."""
    groups = [ratio[:, max(first - 1, 0) : first + GROUP + 1] for first in range(0, CHANNELS, GROUP)]
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
    middles = np.arange(GROUP // 2, CHANNELS, GROUP)
    number = np.stack([snapshots(int(one), start_s, len(scatter))[0] for one in middles], axis=1).astype(np.float64)
    known = np.isfinite(scatter)
    departure, excess = (_about_mean(one, known) for one in (scatter, number))
    size = np.sqrt((departure**2).sum() * (excess**2).sum())
    return float(-(departure * excess).sum() / size) if size > 0.0 else 0.0


def _about_mean(values: FloatArray, known: npt.NDArray[np.bool_]) -> FloatArray:
    filled = np.where(known, values, 0.0)
    return np.where(known, filled - filled.sum(axis=0) / np.maximum(known.sum(axis=0), 1), 0.0)

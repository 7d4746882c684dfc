"""The coarse grid on which bursts are searched: minutes, and channels evenly spaced in the logarithm of frequency."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.spectra import over_background, relative_power, sample_times
from bella.units import FloatArray

STEP_S = 60.0
LOWEST_MHZ, HIGHEST_MHZ = 0.1, 14.0
CHANNELS = 56
RELATIVE_BACKGROUND = 0.05
LEAST_NOISE_DB = 0.25
"""Channels whose noise is less count as if it were this: what is left of a background is never flat to less."""

SPIKE_DB = 2.0
SPIKE_SHARE = 0.5
SPIKE_BELOW_MHZ = 1.0
SPIKE_RECORDS = (1, 2)
"""How many minutes a calibration lasts."""

EDGES_MHZ: FloatArray = np.geomspace(LOWEST_MHZ, HIGHEST_MHZ, CHANNELS + 1)
FREQUENCY_MHZ: FloatArray = np.sqrt(EDGES_MHZ[1:] * EDGES_MHZ[:-1])


def over_quiet(spectrum: xr.Dataset) -> xr.Dataset:
    """Measured channels over their background, as bursts are searched in and timed on.

    Parameters
    ----------
    spectrum : xarray.Dataset
        A dynamic spectrum of any quantity, best of a whole day.

    Returns
    -------
    xarray.Dataset
        In decibels over background without channels marked as interpolated; a relative flux, whose background was taken
        away, stays what it is.

    Raises
    ------
    InputError
        If the quantity of the spectrum is not known.
    """
    measured = spectrum
    if "interpolated" in spectrum:
        measured = spectrum.isel(frequency=np.flatnonzero(spectrum["interpolated"].to_numpy() == 0))
    is_without = spectrum.attrs["quantity"] == "relative_flux" or measured.sizes["frequency"] == 0
    return measured if is_without else over_background(measured)


class SearchGrid(NamedTuple):
    """A spectrum on the grid."""

    start: np.datetime64
    """UTC of the beginning of the first minute."""
    excess_db: FloatArray
    """Mean over background, dB, shape (minutes, CHANNELS); NaN where nothing was measured."""
    noise_db: FloatArray
    """Scatter of quiet minutes, shape (CHANNELS,); NaN for channels without data."""


def search_grid(over: xr.Dataset) -> SearchGrid:
    """Put a spectrum on the grid, clean of single-minute columns, in dB over background.

    Parameters
    ----------
    over : xarray.Dataset
        As :func:`over_quiet` returns it.

    Returns
    -------
    SearchGrid
    """
    start = over["time"].to_numpy()[0].astype("datetime64[m]")
    if over.sizes["frequency"] == 0:
        minutes = int((over["time"].to_numpy()[-1] - start) / np.timedelta64(60, "s")) + 1
        return SearchGrid(start, np.full((minutes, CHANNELS), np.nan), np.full(CHANNELS, np.nan))
    over = _raised(over) if over.attrs["quantity"] == "relative_flux" else over
    binned = _despiked(_binned(over, start))
    smooth = _median_of_three(binned)
    return SearchGrid(start.astype("datetime64[ns]"), smooth, _noise_db(smooth))


def _raised(spectrum: xr.Dataset) -> xr.Dataset:
    """Decibels over a background that is put under a flux which has none and is relative to its maximum."""
    power = relative_power(spectrum)
    decibel = 10.0 * np.log10(1.0 + np.maximum(power, 0.0) / (power.max("time") * RELATIVE_BACKGROUND))
    return spectrum.assign(intensity=decibel)


def _binned(over: xr.Dataset, start: np.datetime64) -> FloatArray:
    """Mean of the samples in every cell."""
    column = np.searchsorted(EDGES_MHZ, over["frequency"].to_numpy(), side="right") - 1
    inside = (column >= 0) & (column < CHANNELS)
    times = sample_times(over).to_numpy()[:, inside]
    row = ((times - start) / np.timedelta64(1, "s") // STEP_S).astype(np.intp)
    values = over["intensity"].to_numpy()[:, inside].astype(np.float64)
    minutes = int(row.max(initial=0)) + 1
    known = np.isfinite(values) & (row >= 0)
    cell = (row * CHANNELS + column[inside])[known]
    count = np.bincount(cell, minlength=minutes * CHANNELS)
    total = np.bincount(cell, weights=values[known], minlength=minutes * CHANNELS)
    with np.errstate(invalid="ignore"):
        return np.asarray((total / np.where(count, count, np.nan)).reshape(minutes, CHANNELS))


def _despiked(excess_db: FloatArray) -> FloatArray:
    """Without columns that rise and fall at once in most channels where bursts last for many minutes."""
    low = excess_db[:, FREQUENCY_MHZ < SPIKE_BELOW_MHZ]
    known = np.maximum(np.isfinite(low).sum(axis=1), 1)
    is_spike = np.zeros(len(excess_db), dtype=bool)
    for length in SPIKE_RECORDS:
        before, after = _shifted(low, 1), _shifted(low, -length)
        up = (low > before + SPIKE_DB) & (_shifted(low, 1 - length) > after + SPIKE_DB)
        begins = up.sum(axis=1) > SPIKE_SHARE * known
        for record in range(length):
            is_spike |= np.roll(begins, record)
    return np.where(is_spike[:, None], np.nan, excess_db)


def _shifted(values: FloatArray, records: int) -> FloatArray:
    """Values of so many records earlier (later, below 0); NaN beyond the ends."""
    moved = np.full_like(values, np.nan)
    if records > 0:
        moved[records:] = values[:-records]
    elif records < 0:
        moved[:records] = values[-records:]
    else:
        moved[:] = values
    return moved


def _median_of_three(excess_db: FloatArray) -> FloatArray:
    """Median over neighbouring channels that have data: single disturbed channels go, edges in time stay."""
    known = np.flatnonzero(np.isfinite(excess_db).any(axis=0))
    if known.size < 3:
        return excess_db
    padded = np.pad(excess_db[:, known], ((0, 0), (1, 1)), mode="edge")
    stacked = np.stack([padded[:, :-2], padded[:, 1:-1], padded[:, 2:]])
    smooth = np.full_like(excess_db, np.nan)
    smooth[:, known] = np.where(np.isfinite(stacked).all(axis=0), np.sort(stacked, axis=0)[1], padded[:, 1:-1])
    return smooth


def _noise_db(excess_db: FloatArray) -> FloatArray:
    """Scatter about 0 dB by the negative side, which bursts do not reach."""
    negative = np.where(excess_db < 0, excess_db, np.nan)
    count = np.isfinite(negative).sum(axis=0)
    squares = np.nansum(negative**2, axis=0)
    noise = np.maximum(np.sqrt(squares / np.maximum(count, 1)), LEAST_NOISE_DB)
    return np.where(np.isfinite(excess_db).any(axis=0), noise, np.nan)


def minutes_utc(grid: SearchGrid) -> npt.NDArray[np.datetime64]:
    """Middle of every minute of a grid, UTC, shape (minutes,)."""
    middle = (np.arange(len(grid.excess_db)) + 0.5) * STEP_S
    return np.asarray(grid.start + np.rint(middle * 1e9).astype("timedelta64[ns]"))

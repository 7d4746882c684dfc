"""The quiet level of every channel through a day, and spectra in dB over it.

The level is followed per channel: medians of 15-minute blocks, then the 30 % quantile of the blocks within 2.25 h to
either side. A burst is shorter than that window, and lifts few of its blocks; a storm is not, and lifts them all. So
the level is held down: it may be at most 2 dB over the channel's floor of the day.

A step of the receiver's gain is told from radiation by its being the same in all channels: such a lift is not held
down, and near the step the level is that of the side a block belongs to. A storm that is equally strong in all channels
of a receiver would be taken for one.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.exceptions import InputError
from bella.units import FloatArray

BLOCK_S = 900.0
WINDOW_S = 4.5 * 3600.0
QUANTILE = 0.3
FLOOR_QUANTILE = 0.05
LARGEST_LIFT_DB = 2.0
SMALLEST_STEP_DB = 1.0
LARGEST_SPREAD_DB = 1.5
"""How far the quartiles of the channels may be apart where a lift counts as a step of the gain."""

FEWEST_CHANNELS_FOR_A_STEP = 8
CHANNELS_AT_ONCE = 32
"""Channels whose samples are turned at once, so that a long day takes little memory."""

QUIET_SD = 2.0
SUBTRACTED_SHARE = 0.02
"""From this share of samples not above zero on, the background of a channel was taken away before publication."""

QUIET_SCATTER = 0.05
"""Scatter of quiet samples over their background, as receivers of space missions show: what was taken away is taken to
be the noise that is left over this."""

DECIBELS_PER_DECADE = {"voltage_ratio": 20.0, "psd_v2_hz": 10.0, "flux_w_m2_hz": 10.0, "relative_flux": 10.0}

Instants = npt.NDArray[np.datetime64]


class Background(NamedTuple):
    """Quiet level of every channel."""

    level_db: FloatArray
    """Shape (time, frequency), dB in the unit of the spectrum; NaN for channels without any data."""
    noise_db: FloatArray
    """Scatter about the level, one standard deviation, shape (frequency,), dB."""


def decibels(spectrum: xr.Dataset) -> FloatArray:
    """Intensity in dB, whatever the quantity.

    Parameters
    ----------
    spectrum : xarray.Dataset
        A dynamic spectrum.

    Returns
    -------
    numpy.ndarray
        Shape (time, frequency), dB over the unit of the spectrum. Amplitudes count twice; what is not above zero has no
        logarithm and is NaN. Where a flux was published with its background taken away, a background is given back to
        it, of the size that its noise suggests.

    Raises
    ------
    InputError
        If the quantity is not known.
    """
    quantity = str(spectrum.attrs["quantity"])
    values = spectrum["intensity"].transpose("time", "frequency").to_numpy().astype(np.float64)
    if quantity == "db_over_background":
        return values
    if quantity not in DECIBELS_PER_DECADE:
        raise InputError(f"quantity {quantity!r} cannot be turned into dB: use one of {', '.join(DECIBELS_PER_DECADE)}")
    if quantity == "flux_w_m2_hz":
        values = _with_background(values)
    per_decade = DECIBELS_PER_DECADE[quantity]
    if quantity == "relative_flux":
        per_decade *= float(spectrum.attrs.get("power_exponent", 1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        level = per_decade * np.log10(values)
    return np.where(np.isfinite(level), level, np.nan)


def _with_background(flux: FloatArray) -> FloatArray:
    """Flux with a background in the channels that have none."""
    share = np.count_nonzero(flux <= 0.0, axis=0) / np.maximum(np.count_nonzero(np.isfinite(flux), axis=0), 1)
    without = np.flatnonzero(share > SUBTRACTED_SHARE)
    if not without.size:
        return flux
    below = np.where(flux[:, without] < 0.0, flux[:, without], np.nan)
    noise = _nan_quantile(-below, 0.6827)
    restored = flux.copy()
    restored[:, without] += noise / QUIET_SCATTER
    return restored


def quiet_level(intensity_db: FloatArray, time: Instants) -> Background:
    """Quiet level of every channel through the time of a spectrum.

    Parameters
    ----------
    intensity_db : numpy.ndarray
        dB, shape (time, frequency), NaN where there are no data.
    time : numpy.ndarray of datetime64
        Ascending, shape (time,); records need not be evenly spaced.

    Returns
    -------
    Background
        Unbiased for noise: the median of quiet samples over it is 0 dB.

    Raises
    ------
    InputError
        If the shapes do not match, or there are no records.
    """
    return _quiet(intensity_db, _levels(_medians(intensity_db, time)), time)


def _medians(intensity_db: FloatArray, time: Instants) -> FloatArray:
    """Median of every block of a spectrum, shape (block, frequency)."""
    seconds = _seconds(intensity_db, time)
    return _block_medians(intensity_db, np.searchsorted(seconds, np.arange(0.0, seconds[-1] + BLOCK_S, BLOCK_S)))


def _levels(medians: FloatArray) -> FloatArray:
    """Quiet level of every block, of all channels together."""
    return _held_down(_followed(medians))


def _quiet(intensity_db: FloatArray, levels: FloatArray, time: Instants) -> Background:
    """Quiet level of every record from those of the blocks."""
    centres = np.asarray((np.arange(len(levels)) + 0.5) * BLOCK_S, dtype=np.float64)
    return _centred(intensity_db, _interpolated(levels, centres, _seconds(intensity_db, time)))


def over_background(spectrum: xr.Dataset) -> xr.Dataset:
    """The spectrum in dB over its background.

    Parameters
    ----------
    spectrum : xarray.Dataset
        A dynamic spectrum of any quantity, best of a whole day.

    Returns
    -------
    xarray.Dataset
        A dynamic spectrum with quantity ``db_over_background``, and beside its other variables
        ``noise_db(frequency)``, the scatter of quiet samples about 0 dB.

    Raises
    ------
    InputError
        If the quantity is not known.
    """
    ordered = spectrum.transpose("time", "frequency", ...)
    channels, time = ordered.sizes["frequency"], ordered["time"].to_numpy()
    parts = [slice(begin, begin + CHANNELS_AT_ONCE) for begin in range(0, max(channels, 1), CHANNELS_AT_ONCE)]
    levels = _levels(np.concatenate([_medians(decibels(ordered.isel(frequency=part)), time) for part in parts], axis=1))
    excess_db = np.empty((time.size, channels), dtype=np.float32)
    noise_db = np.empty(channels, dtype=np.float32)
    for part in parts:
        level = decibels(ordered.isel(frequency=part))
        quiet = _quiet(level, levels[:, part], time)
        excess_db[:, part], noise_db[part] = level - quiet.level_db, quiet.noise_db
    attributes = {name: value for name, value in spectrum.attrs.items() if name != "power_exponent"}
    over = ordered.assign(intensity=(("time", "frequency"), excess_db), noise_db=("frequency", noise_db))
    over.attrs = attributes | {
        "quantity": "db_over_background",
        "background": f"{QUANTILE:g} quantile of {BLOCK_S / 60:g} min medians over {WINDOW_S / 3600:g} h, "
        f"at most {LARGEST_LIFT_DB:g} dB over the floor of the day",
    }
    return over


def _seconds(intensity_db: FloatArray, time: Instants) -> FloatArray:
    if intensity_db.ndim != 2 or time.shape != intensity_db.shape[:1] or time.size == 0:
        raise InputError(f"a background needs records: {time.size} times go with intensity of {intensity_db.shape}")
    return np.asarray((time - time[0]) / np.timedelta64(1, "s"), dtype=np.float64)


def _nan_quantile(values: FloatArray, quantile: float) -> FloatArray:
    """Quantile along the first axis without NaN; several times as fast as numpy's own."""
    ordered = np.sort(values, axis=0)
    place = quantile * np.maximum(np.count_nonzero(np.isfinite(values), axis=0) - 1, 0)
    below = place.astype(np.intp)
    above = np.minimum(below + 1, len(values) - 1)
    low, high = (np.take_along_axis(ordered, which[np.newaxis], axis=0)[0] for which in (below, above))
    share = place - below
    return np.asarray(np.where(share > 0.0, low + share * (high - low), low), dtype=np.float64)


def _block_medians(intensity_db: FloatArray, starts: npt.NDArray[np.intp]) -> FloatArray:
    """Median of every block, shape (block, frequency), NaN for blocks without data."""
    medians = np.full((len(starts), intensity_db.shape[1]), np.nan)
    for block, (start, stop) in enumerate(zip(starts, [*starts[1:], len(intensity_db)], strict=True)):
        if stop > start:
            medians[block] = _nan_quantile(intensity_db[start:stop], 0.5)
    return medians


def _followed(medians: FloatArray) -> FloatArray:
    """Level of every block: of the blocks around it, or near a step of the gain of those on its own side."""
    width = round(WINDOW_S / BLOCK_S)
    around = _sliding_quantile(medians, width // 2, width // 2)
    before, after = _sliding_quantile(medians, width, 0), _sliding_quantile(medians, 0, width)
    # at the ends of the day one side is short, and a burst could pass for a step there
    before[: width // 2] = after[len(after) - width // 2 :] = np.nan
    step = np.abs(_shared_db(after - before)) > SMALLEST_STEP_DB
    belongs_after = np.abs(_shared_db(medians - after)) < np.abs(_shared_db(medians - before))
    own_side = np.where(belongs_after, after, before)
    return np.where(step & np.isfinite(own_side), own_side, around)


def _sliding_quantile(medians: FloatArray, earlier: int, later: int) -> FloatArray:
    """Low quantile of each block with those before and after; at the ends of the day, of those that there are."""
    padded = np.pad(medians, ((earlier, later), (0, 0)), constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, earlier + later + 1, axis=0)
    return _nan_quantile(np.moveaxis(windows, -1, 0), QUANTILE)


def _shared_db(difference_db: FloatArray) -> FloatArray:
    """What the channels share of a difference of levels, shape (block, 1); 0 where they do not agree, or are few."""
    if difference_db.shape[1] < FEWEST_CHANNELS_FOR_A_STEP:
        return np.zeros((len(difference_db), 1))
    lower, middle, upper = (_nan_quantile(difference_db.T, quantile) for quantile in (0.25, 0.5, 0.75))
    return np.where(upper - lower <= LARGEST_SPREAD_DB, middle, 0.0)[:, np.newaxis]


def _held_down(levels: FloatArray) -> FloatArray:
    """Level of every block, no higher than a storm may lift it; where a gap is wider than the window, the floor."""
    floor = _nan_quantile(levels, FLOOR_QUANTILE)
    shared = _shared_db(levels - floor)
    highest = floor + np.where(shared > SMALLEST_STEP_DB, shared, 0.0) + LARGEST_LIFT_DB
    return np.where(np.isfinite(levels), np.minimum(levels, highest), floor)


def _interpolated(levels: FloatArray, centres: FloatArray, seconds: FloatArray) -> FloatArray:
    """Levels at the time of every record, on straight lines between the centres of the blocks."""
    place = np.interp(seconds, centres, np.arange(len(centres)))
    below = np.minimum(place.astype(np.intp), max(len(centres) - 2, 0))
    above = np.minimum(below + 1, len(centres) - 1)
    share = (place - below)[:, np.newaxis]
    between: FloatArray = (1.0 - share) * levels[below] + share * levels[above]
    return between


def _centred(intensity_db: FloatArray, level_db: FloatArray) -> Background:
    """Move the level into the middle of the quiet samples: a low quantile is below it.

    What lies below the level is noise for certain, and tells how wide noise is; samples within twice that are quiet.
    """
    residual = intensity_db - level_db
    below = np.minimum(residual, 0.0)
    noise_db = np.sqrt(_mean(below**2, residual < 0.0))
    shift = np.zeros(intensity_db.shape[1])
    for _ in range(2):
        offset = residual - shift
        shift = shift + _mean(offset, np.abs(offset) <= QUIET_SD * noise_db)
        offset = residual - shift
        noise_db = np.sqrt(_mean(offset**2, offset < 0.0))
    empty = ~np.isfinite(intensity_db).any(axis=0)
    return Background(np.where(empty, np.nan, level_db + shift), np.where(empty, np.nan, noise_db))


def _mean(values: FloatArray, chosen: npt.NDArray[np.bool_]) -> FloatArray:
    """Mean of the chosen samples of each channel, 0 where there are none."""
    count = np.count_nonzero(chosen, axis=0)
    return np.asarray(np.where(chosen, values, 0.0).sum(axis=0) / np.maximum(count, 1), dtype=np.float64)

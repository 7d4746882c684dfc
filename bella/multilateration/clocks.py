"""Clocks of receivers: whether one is off, and what an offset does to the positions.

Where more receivers heard a burst than a position takes, an offset that a receiver has at all frequencies shows. Its
size is that of generalised least squares over all arrival times of the burst, around the positions found: with r the
arrival times less what is predicted, V their covariance with positions, emission times, slowness and kappa free within
their priors, and e_i the indicator of a receiver, o_i = e_i^T V^-1 r / e_i^T V^-1 e_i, variance 1 / e_i^T V^-1 e_i. One
receiver at a time is taken to be off; of two that explain the times nearly as well, either may be.
"""

from dataclasses import dataclass, replace

import numpy as np
from astropy.time import Time

from bella.arrivals import ArrivalGrid
from bella.heliosphere.scattering import DirectionalDelay, one_minus_cosine
from bella.multilateration.priors import Priors
from bella.multilateration.problems import IntArray
from bella.units import DAY_S, FloatArray

SIGNIFICANT_SD = 3.0
"""An offset of so many of its standard deviations is flagged."""
ALIKE_CHI2 = 4.0
"""Receivers whose offsets lower chi-squared by so much less than the best one's, two standard deviations, may be it."""
FREQUENCIES = 40
"""Most frequencies that are used: more lower the error of an offset by little."""
STEPS = 3
"""Positions are found again so often without the offset; 69 s move them so far that distances are no longer linear."""
EMISSION_SD_S = 1e4
"""Standard deviation of the free emission time of each frequency: so large that it says nothing."""
LEAST_S = 1e-3
"""Independent error beside the free time of emission, without which the covariance of exact times is singular."""

SHIFT_S = 10.0
"""Offset for which the move of a position is stated."""


@dataclass(frozen=True)
class ClockCheck:
    """What the arrival times of a burst say of the clocks.

    Attributes
    ----------
    offset_s, offset_sd_s : ndarray, shape (n,)
        How late each receiver is if it alone is, and its standard deviation; NaN where no receiver is redundant.
    message : str
        Which clock is off and by how much, in words; empty where none is.
    """

    offset_s: FloatArray
    offset_sd_s: FloatArray
    message: str


def check_clocks(grid: ArrivalGrid, position_rsun: FloatArray, priors: Priors, delay: DirectionalDelay) -> ClockCheck:
    """Offset of each receiver over all frequencies of a burst, and whether one is significant.

    Parameters
    ----------
    grid : ArrivalGrid
    position_rsun : ndarray, shape (F, D)
        Where the sources were found.
    priors : Priors
    delay : DirectionalDelay

    Returns
    -------
    ClockCheck
    """
    dimensions = position_rsun.shape[1]
    heard = np.isfinite(grid.arrival_s).sum(axis=1)
    none = np.full(len(grid.observatories), np.nan)
    if not (heard > dimensions + 1).any():
        return ClockCheck(none, none, "")
    rows = np.unique(np.linspace(0, heard.size - 1, min(FREQUENCIES, heard.size)).astype(np.intp))
    some, position, late_s = grid.take(rows), position_rsun[rows], np.zeros(none.size)
    for _ in range(STEPS):
        position, offset_s, offset_sd_s = _fitted(some, position, late_s, priors, delay)
        gain = np.nan_to_num((offset_s / offset_sd_s) ** 2)
        worst = int(gain.argmax())
        late_s = np.where(np.arange(none.size) == worst, offset_s, 0.0)
    suspects = np.flatnonzero(gain > gain[worst] - ALIKE_CHI2)
    message = "" if gain[worst] < SIGNIFICANT_SD**2 else _message(grid, suspects, offset_s, offset_sd_s)
    return ClockCheck(offset_s, offset_sd_s, message)


def _fitted(
    grid: ArrivalGrid, position: FloatArray, late_s: FloatArray, priors: Priors, delay: DirectionalDelay
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions with some receivers late, and the offset of each receiver with its standard deviation."""
    row, column = np.nonzero(np.isfinite(grid.arrival_s))
    travel_s, delay_s, slope = _linearised(grid, position, priors, delay)
    place = row[:, None] == row
    slope, dimensions = slope[row, column], position.shape[1]
    prior_rsun2 = priors.position_sd_rsun(dimensions) ** 2
    relative = priors.slowness_sd / priors.slowness_mean
    free = EMISSION_SD_S**2 + prior_rsun2 * slope @ slope.T
    shared = np.outer(relative * travel_s[row, column], relative * travel_s[row, column])
    turned = delay.kappa_sd * delay_s[row, column]
    stated = grid.covariance_s2() + LEAST_S**2 * np.eye(row.size)
    inverse = np.linalg.inv(stated + np.where(place, free, 0.0) + shared + np.outer(turned, turned))
    predicted = grid.delay_s + travel_s + delay.kappa * delay_s
    residual = (grid.arrival_s - predicted)[row, column] + np.einsum("nd,nd->n", slope, position[row])
    indicator: FloatArray = (column[:, None] == np.arange(len(grid.observatories))).astype(np.float64)
    precision = np.einsum("ni,nm,mi->i", indicator, inverse, indicator, optimize=True)
    offset_s = indicator.T @ inverse @ residual / precision
    weighted = inverse @ (residual - late_s[column])
    moved: FloatArray = np.stack(
        [np.bincount(row, prior_rsun2 * axis * weighted, len(position)) for axis in slope.T], axis=1
    )
    return moved, offset_s, 1 / np.sqrt(precision)


def _linearised(
    grid: ArrivalGrid, position: FloatArray, priors: Priors, delay: DirectionalDelay
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Travel times, delays for a kappa of one, (F, n), and the slope of their sum with the position, (F, n, D)."""

    def _times(at: FloatArray) -> tuple[FloatArray, FloatArray]:
        source = np.pad(at, ((0, 0), (0, 3 - at.shape[1])))[:, None]
        distance = np.linalg.norm(source - grid.receiver_rsun, axis=-1)
        return priors.slowness_mean * distance, grid.rise_s * one_minus_cosine(source, grid.receiver_rsun)

    travel_s, delay_s = _times(position)
    step = 0.01
    slopes = []
    for axis in np.eye(position.shape[1]):
        ahead, behind = _times(position + step * axis), _times(position - step * axis)
        slopes.append(
            ((ahead[0] - behind[0]) + delay.kappa * (ahead[1] - behind[1])) / (2 * step)  # central differences
        )
    return travel_s, delay_s, np.stack(slopes, axis=-1)


def _message(grid: ArrivalGrid, suspects: IntArray, offset_s: FloatArray, offset_sd_s: FloatArray) -> str:
    """Which clocks may be off, the likeliest first."""
    order = suspects[np.argsort(-np.abs(offset_s[suspects] / offset_sd_s[suspects]))]
    ahead_s = _tt_less_utc(grid.reference_utc)
    parts = []
    for which in order:
        words = "late" if offset_s[which] > 0 else "early"
        text = f"{grid.observatories[which]} is {words} by {abs(offset_s[which]):.1f} ± {offset_sd_s[which]:.1f} s"
        if abs(abs(offset_s[which]) - ahead_s) < SIGNIFICANT_SD * offset_sd_s[which]:
            text += f": Terrestrial Time taken for UTC ({ahead_s:.3f} s), or the reverse"
        parts.append(text)
    return parts[0] if len(parts) == 1 else "one of these: " + "; ".join(parts)


def _tt_less_utc(time_utc: np.datetime64) -> float:
    """Terrestrial Time less UTC at some time, s: 69.184 since 2017."""
    utc = Time(np.datetime_as_string(time_utc, unit="s"), scale="utc")
    return float((utc.tt.jd1 - utc.jd1) + (utc.tt.jd2 - utc.jd2)) * DAY_S


def clock_shift_rsun(
    grid: ArrivalGrid, position_rsun: FloatArray, covariance_rsun2: FloatArray, priors: Priors, delay: DirectionalDelay
) -> FloatArray:
    """Move of each position if one clock were late by `SHIFT_S`, to first order.

    Parameters
    ----------
    grid : ArrivalGrid
    position_rsun : ndarray, shape (F, D)
    covariance_rsun2 : ndarray, shape (F, D, D)
        Of the posterior.
    priors : Priors
    delay : DirectionalDelay

    Returns
    -------
    ndarray, shape (F, n, D)
        Solar radii; NaN where a receiver is missing.
    """
    heard = np.isfinite(grid.arrival_s)
    present = replace(grid, receiver_rsun=np.where(heard[..., None], grid.receiver_rsun, 1.0))
    travel_s, delay_s, slope = _linearised(present, position_rsun, priors, delay)
    both = heard[:, :, None] & heard[:, None, :]
    relative = priors.slowness_sd / priors.slowness_mean
    nuisance = EMISSION_SD_S**2 + (relative * travel_s[:, :, None]) * (relative * travel_s[:, None, :])
    turned = np.nan_to_num(delay.kappa_sd * delay_s)
    nuisance = nuisance + turned[:, :, None] * turned[:, None, :]
    stated = grid.covariances_s2() + nuisance + LEAST_S**2 * np.eye(heard.shape[1])
    weight = np.where(both, np.linalg.inv(np.where(both, stated, np.eye(heard.shape[1]))), 0.0)
    shift = SHIFT_S * np.einsum("fde,fie,fij->fjd", covariance_rsun2, np.nan_to_num(slope), weight, optimize=True)
    return np.where(heard[..., None], shift, np.nan)

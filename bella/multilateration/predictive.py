"""What the posterior predicts for each arrival time, and whether the one that was seen is likely.

Posterior predictive checks after Gelman, Meng & Stern (1996, Statistica Sinica 6, 733): residuals are averaged over
draws, and a p-value is the probability, averaged over draws, of a discrepancy larger than the one seen. Arrival times
are used twice, to fit and to check, so these p-values lie near one half or above where all is well and are no test of
fixed size; with three receivers nearly everything can be fitted.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, ndtr

from bella.arrivals import ArrivalGrid
from bella.multilateration.draws import Draws
from bella.units import C_RSUN_S, FloatArray

DRAWS_USED = 400
"""Draws that are compared with the arrival times: p-values are good to 0.02 or better."""
BLOCK = 200
"""Frequencies treated together, so that memory stays bounded."""


@dataclass(frozen=True)
class Predictive:
    """Comparison of arrival times with what the posterior predicts.

    Attributes
    ----------
    residual_s : ndarray, shape (F, n)
        Arrival time seen less predicted, mean over the posterior, s; NaN where a receiver is missing.
    receiver_p : ndarray, shape (F, n)
        Probability of a larger residual of that receiver.
    burst_p : ndarray, shape (F,)
        Probability of a larger sum of squared residuals.
    """

    residual_s: FloatArray
    receiver_p: FloatArray
    burst_p: FloatArray


def predictive_check(grid: ArrivalGrid, draws: Draws, bad_probability: FloatArray) -> Predictive:
    """Compare the arrival times of a grid with draws of its posterior.

    Parameters
    ----------
    grid : ArrivalGrid
    draws : Draws
        One problem per frequency of the grid.
    bad_probability : ndarray, shape (F, n)
        That an arrival time is bad.

    Returns
    -------
    Predictive
    """
    blocks = [slice(first, first + BLOCK) for first in range(0, len(draws.position), BLOCK)]
    rows = np.arange(grid.frequency_mhz.size)
    parts = [_checked(grid.take(rows[some]), _thinned(draws, some), bad_probability[some]) for some in blocks]
    return Predictive(*(np.concatenate([getattr(one, name) for one in parts]) for name in Predictive.__annotations__))


def _thinned(draws: Draws, some: slice) -> tuple[FloatArray, FloatArray, FloatArray]:
    step = max(1, draws.position.shape[1] // DRAWS_USED)
    return draws.position[some, ::step], draws.emission_s[some, ::step], draws.v_over_c[some, ::step]


def _checked(
    grid: ArrivalGrid, draws: tuple[FloatArray, FloatArray, FloatArray], bad_probability: FloatArray
) -> Predictive:
    residual = grid.arrival_s[:, None] - grid.delay_s[:, None] - predicted_arrivals(grid, *draws)
    variance = grid.sigma_s**2 + grid.delay_sd_s**2 + grid.offset_sd_s**2
    deviation = residual / np.sqrt(variance)[:, None]
    heard = np.isfinite(grid.arrival_s)
    discrepancy = np.nansum(deviation**2, axis=2)
    return Predictive(
        residual_s=_without_emission(residual, (1 - bad_probability) / variance).mean(axis=1),
        receiver_p=2 * ndtr(-np.abs(deviation)).mean(axis=1),
        burst_p=chdtrc(heard.sum(axis=1)[:, None], discrepancy).mean(axis=1),
    )


def _without_emission(residual: FloatArray, weight: FloatArray) -> FloatArray:
    """Residuals (F, N, n) with the scatter of the emission time given position and speed averaged out exactly."""
    weight = np.where(np.isfinite(residual[:, 0]), weight, 0.0)[:, None]
    common = np.nansum(weight * residual, axis=2) / weight.sum(axis=2)
    return np.asarray(residual - common[..., None])


def predicted_arrivals(
    grid: ArrivalGrid, position: FloatArray, emission_s: FloatArray, v_over_c: FloatArray
) -> FloatArray:
    """Arrival times that draws predict, without delays beyond light travel.

    Parameters
    ----------
    grid : ArrivalGrid
    position : ndarray, shape (F, N, D)
        Solar radii.
    emission_s : ndarray, shape (F, N)
        After the reference time of the grid, s.
    v_over_c : ndarray, shape (F, N)

    Returns
    -------
    ndarray, shape (F, N, n)
        After the reference time of the grid, s; NaN where a receiver is missing.
    """
    dimensions = position.shape[2]
    offset = position[:, :, None, :] - grid.receiver_rsun[:, None, :, :dimensions]
    squared = (offset**2).sum(axis=-1) + (grid.receiver_rsun[:, None, :, dimensions:] ** 2).sum(axis=-1)
    return np.asarray(emission_s[..., None] + np.sqrt(squared) / (v_over_c[..., None] * C_RSUN_S))

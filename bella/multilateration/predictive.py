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
from bella.heliosphere.scattering import one_minus_cosine
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


def _thinned(draws: Draws, some: slice) -> Draws:
    step = max(1, draws.position.shape[1] // DRAWS_USED)
    thin = {name: getattr(draws, name)[some, ::step] for name in ("position", "emission_s", "v_over_c", "kappa")}
    return Draws(**thin, effective=draws.effective[some])


def _checked(grid: ArrivalGrid, draws: Draws, bad_probability: FloatArray) -> Predictive:
    residual = grid.arrival_s[:, None] - grid.delay_s[:, None] - predicted_arrivals(grid, draws)
    covariance = grid.covariances_s2()
    deviation = residual / np.sqrt(np.einsum("fii->fi", covariance))[:, None]
    heard = np.isfinite(grid.arrival_s)
    precision = np.linalg.inv(np.where(np.isfinite(covariance), covariance, np.eye(heard.shape[1])))
    known = np.where(heard[:, None], residual, 0.0)
    discrepancy = np.einsum("fdi,fij,fdj->fd", known, precision, known, optimize=True)
    weight = (1 - bad_probability) * np.einsum("fij,fj->fi", precision, heard.astype(np.float64))
    return Predictive(
        residual_s=_without_emission(residual, weight).mean(axis=1),
        receiver_p=2 * ndtr(-np.abs(deviation)).mean(axis=1),
        burst_p=chdtrc(heard.sum(axis=1)[:, None], discrepancy).mean(axis=1),
    )


def _without_emission(residual: FloatArray, weight: FloatArray) -> FloatArray:
    """Residuals (F, N, n) with the scatter of the emission time given position and speed averaged out exactly."""
    weight = np.where(np.isfinite(residual[:, 0]), weight, 0.0)[:, None]
    common = np.nansum(weight * residual, axis=2) / weight.sum(axis=2)
    return np.asarray(residual - common[..., None])


def predicted_arrivals(grid: ArrivalGrid, draws: Draws) -> FloatArray:
    """Arrival times that draws predict, without the known delays of the grid.

    Parameters
    ----------
    grid : ArrivalGrid
    draws : Draws
        One problem per frequency of the grid, of N draws.

    Returns
    -------
    ndarray, shape (F, N, n)
        After the reference time of the grid, s; NaN where a receiver is missing.
    """
    source = np.pad(draws.position.astype(np.float64), ((0, 0), (0, 0), (0, 3 - draws.position.shape[2])))[:, :, None]
    receivers = grid.receiver_rsun[:, None]
    travel_s = np.linalg.norm(source - receivers, axis=-1) / (draws.v_over_c[..., None] * C_RSUN_S)
    predicted = draws.emission_s[..., None] + travel_s
    if draws.kappa.any():
        late = grid.rise_s[:, None] * one_minus_cosine(source, receivers)
        predicted = predicted + draws.kappa[..., None] * late
    return np.asarray(predicted)

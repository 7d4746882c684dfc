"""Whether a localisation is to be believed: what it predicts for each arrival time, and the quality flags it raises.

What the flags mean is in :mod:`bella.flags`. Posterior predictive checks after Gelman, Meng & Stern (1996, Statistica
Sinica 6, 733): residuals are averaged over draws, and a p-value is the probability, averaged over draws, of a
discrepancy larger than the one seen. Arrival times are used twice, to fit and to check, so these p-values lie near one
half or above where all is well and are no test of fixed size; with three receivers nearly everything can be fitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy import stats
from scipy.special import chdtrc, ndtr

from bella.arrivals import ArrivalGrid
from bella.flags import NOT_CONSTRAINED
from bella.heliosphere.scattering import one_minus_cosine
from bella.multilateration.posterior import Draws
from bella.units import C_RSUN_S, FloatArray

ONCE_IN = 10_000
"""How often arrival times with errors as stated may be called inconsistent."""
DOMINATED_SD = 0.5
"""Move of the mean by the prior of the position, in standard deviations, from which the prior is said to decide."""
LIKELY_ABOVE_C = 0.95
"""Probability of v > c, one half in the prior, from which the arrival times are said to prefer it."""
LIKELY_BAD = 0.5
DRAWS_USED = 400
"""Draws that are compared with the arrival times: p-values are good to 0.02 or better."""
BLOCK = 200
"""Frequencies treated together, so that memory stays bounded."""


def flags_of(posterior: xr.Dataset, remarks: Sequence[str] = ()) -> list[str]:
    """Flags of each frequency of a posterior, joined by semicolons.

    Parameters
    ----------
    posterior : xarray.Dataset
        With the summary variables of a solution.
    remarks : sequence of str
        Flags that the method raised itself, one text per frequency; none if empty.

    Returns
    -------
    list of str
        One per frequency; empty where nothing is to be said.
    """
    axes = [axis for axis in "xyz" if f"contraction_{axis}" in posterior]
    raised = {
        "speed_not_constrained": posterior["contraction_v"] > NOT_CONSTRAINED,
        "speed_above_c": posterior["above_c_probability"] > LIKELY_ABOVE_C,
        **{f"{axis}_not_constrained": posterior[f"contraction_{axis}"] > NOT_CONSTRAINED for axis in axes},
        "position_not_constrained": _widest_sd(posterior, axes)
        > NOT_CONSTRAINED * posterior.attrs["position_prior_sd_rsun"],
        "prior_dominated": _pull_in_sd(posterior, axes) > DOMINATED_SD,
        "multimodal": posterior["modes"] > 1,
        "arrivals_inconsistent": posterior["misfit"] > _largest_misfit(posterior),
        "bad_arrival": posterior["bad_probability"].max("observatory") > LIKELY_BAD,
        "clock_offset": np.full(posterior.sizes["frequency"], bool(posterior.attrs["clock_offset"])),
        "few_effective_draws": posterior["draw_ess"] < 0.5 * posterior.sizes["draw"],
    }
    table = {name: np.asarray(where) for name, where in raised.items()}
    own = list(remarks) or [""] * posterior.sizes["frequency"]
    return [
        ";".join(filter(None, [*(name for name in table if table[name][row]), own[row]]))
        for row in range(posterior.sizes["frequency"])
    ]


def _largest_misfit(posterior: xr.Dataset) -> FloatArray:
    """Misfit that consistent arrival times exceed once in `ONCE_IN` times at most, shape (frequency,)."""
    receivers = np.isfinite(posterior["arrival_s"].to_numpy()).sum(axis=1)
    return np.asarray(stats.chi2.isf(1 / ONCE_IN, receivers - 1))


def _widest_sd(posterior: xr.Dataset, axes: Sequence[str]) -> FloatArray:
    """Root of the largest eigenvalue of the covariance, shape (frequency,)."""
    return np.asarray(np.sqrt(np.linalg.eigvalsh(_covariance(posterior, axes))[:, -1]))


def _pull_in_sd(posterior: xr.Dataset, axes: Sequence[str]) -> FloatArray:
    """Length of the pull of the prior in standard deviations of the position along it, shape (frequency,)."""
    pull = np.stack([posterior[f"prior_pull_{axis}_rsun"].to_numpy() for axis in axes], axis=-1)
    return np.asarray(np.sqrt(np.einsum("fi,fij,fj->f", pull, np.linalg.pinv(_covariance(posterior, axes)), pull)))


def _covariance(posterior: xr.Dataset, axes: Sequence[str]) -> FloatArray:
    """Covariance of the position, shape (frequency, D, D)."""
    names = [[f"cov_{min(one, other)}{max(one, other)}_rsun2" for other in axes] for one in axes]
    return np.stack([np.stack([posterior[name].to_numpy() for name in row], axis=-1) for row in names], axis=-1)


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

"""Whether a localisation is to be believed: clocks, predicted arrival times, and the quality flags that it raises.

What the flags mean is in :mod:`bella.flags`.

**Clocks.** Where more spacecraft received a burst than a position takes, an offset that one of them has at all
frequencies shows. Its size is that of generalised least squares over all arrival times of the burst, around the
positions found: with r the arrival times less what is predicted, V their covariance with positions, emission times,
slowness and kappa free within their priors, and e_i the indicator of a receiver, o_i = e_i^T V^-1 r / e_i^T V^-1 e_i,
variance 1 / e_i^T V^-1 e_i. One receiver at a time is taken to be off; of two that explain the times nearly as well,
either may be.

**Predictions.** Posterior predictive checks after Gelman, Meng & Stern (1996, Statistica Sinica 6, 733): residuals are
averaged over draws, and a p-value is the probability, averaged over draws, of a discrepancy larger than the one seen.
Arrival times are used twice, to fit and to check, so these p-values lie near one half or above where all is well and
are no test of fixed size; with three receivers nearly everything can be fitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from astropy.time import Time
from scipy import stats
from scipy.special import chdtrc, ndtr

from bella.arrivals import ArrivalGrid
from bella.flags import NOT_CONSTRAINED
from bella.heliosphere.scattering import DirectionalDelay, one_minus_cosine
from bella.multilateration.posterior import Draws, Recipe, log_evidence
from bella.multilateration.priors import THRESHOLDS, Priors
from bella.multilateration.problems import IntArray, LateClocks
from bella.units import C_RSUN_S, DAY_S, FloatArray

FREQUENCIES = 40
"""Most frequencies that are used: more lower the error of an offset by little."""
STEPS = 3
"""Positions are found again so often without the offset; 69 s move them so far that distances are no longer linear."""
EMISSION_SD_S = 1e4
"""Standard deviation of the free emission time of each frequency: so large that it says nothing."""
LEAST_S = 1e-3
"""Independent error beside the free time of emission, without which the covariance of exact times is singular."""

LEAST_LIKELY = 1e-4
"""Probability that a clock is late below which positions need not allow for it: means move by less than 1e-3 of their
standard deviations."""

EVERY, FAR_NATS = 5, 25.0
"""Clocks whose evidence at one of so many frequencies is so far below that of the best one are not looked at further:
at all of them they are less likely still."""

SHIFT_S = 10.0
"""Offset for which the move of a position is stated."""
DRAWS_USED = 400
"""Draws that are compared with the arrival times: p-values are good to 0.02 or better."""
BLOCK = 200
"""Frequencies treated together, so that memory stays bounded."""


@dataclass(frozen=True)
class ClockCheck:
    """What the arrival times of a burst say of the clocks.

    Attributes
    ----------
    offset_s, offset_sd_s : ndarray, shape (n,)
        How late each receiver is if it alone is, and its standard deviation; NaN where no receiver is redundant.
    chi2 : ndarray, shape (n,)
        By how much the offset of each lowers chi-squared.
    message : str
        Which clock is off and by how much, in words; empty where none is.
    """

    offset_s: FloatArray
    offset_sd_s: FloatArray
    chi2: FloatArray
    message: str

    @property
    def is_doubtful(self) -> bool:
        """Whether a clock may be off, so that positions have to allow for it."""
        return bool(self.chi2.max() > THRESHOLDS.doubtful_clock_sd**2)


def _suspects(chi2: FloatArray) -> IntArray:
    order = np.argsort(-chi2, kind="stable")
    return np.asarray(order[chi2[order] > chi2.max() - THRESHOLDS.alike_clock_chi2], dtype=np.intp)


def check_clocks(grid: ArrivalGrid, position_rsun: FloatArray, priors: Priors, delay: DirectionalDelay) -> ClockCheck:
    """Offset of each receiver over all frequencies of a burst, and whether one is significant.

    Parameters
    ----------
    position_rsun : ndarray, shape (F, D)
        Where the sources were found.
    """
    dimensions = position_rsun.shape[1]
    received = np.isfinite(grid.arrival_s).sum(axis=1)
    none = np.full(len(grid.observatories), np.nan)
    if not (received > dimensions + 1).any():
        return ClockCheck(none, none, np.zeros(none.size), "")
    rows = np.unique(np.linspace(0, received.size - 1, min(FREQUENCIES, received.size)).astype(np.intp))
    some, offset_s, offset_sd_s = grid.take(rows), none.copy(), none.copy()
    for which in range(none.size):
        position, late_s = position_rsun[rows], np.zeros(none.size)
        for _ in range(STEPS):
            position, fitted_s, fitted_sd_s = _fitted(some, position, late_s, priors, delay)
            late_s[which] = np.nan_to_num(fitted_s[which])
        offset_s[which], offset_sd_s[which] = fitted_s[which], fitted_sd_s[which]
    chi2 = np.nan_to_num((offset_s / offset_sd_s) ** 2)
    significant = chi2.max() >= THRESHOLDS.late_clock_sd**2
    message = _message(grid, _suspects(chi2), offset_s, offset_sd_s) if significant else ""
    return ClockCheck(offset_s, offset_sd_s, chi2, message)


def late_clocks(grid: ArrivalGrid, check: ClockCheck, recipe: Recipe, none_late: FloatArray) -> LateClocks:
    """Noise in which one clock is late or none, each as likely as all arrival times of the burst say.

    Before the data a late clock and none are equally likely, with an offset of about `Thresholds.typical_offset_s`.
    Components would be weighted by the arrival times of a frequency once more, so each has the weight that all other
    frequencies give it: the evidence of a frequency is then that of its times given all others. Those
    that are less likely than `LEAST_LIKELY` are left out.

    Parameters
    ----------
    check : ClockCheck
        With offsets that are known.
    none_late : ndarray, shape (F,)
        Evidence of each frequency if no clock is late, as a logarithm.
    """
    number = len(grid.observatories)
    chosen = np.eye(number + 1, number, k=-1)  # first that no clock is late
    late_s, late_sd_s = chosen * check.offset_s, chosen * check.offset_sd_s
    occam = np.append(0.0, np.log(check.offset_sd_s / THRESHOLDS.typical_offset_s / number))
    few = grid.take(np.arange(0, none_late.size, EVERY))
    first = np.array([log_evidence(few, recipe, *one).sum() for one in zip(late_s[1:], late_sd_s[1:], strict=True)])
    first = np.append(none_late[::EVERY].sum(), first) + occam
    possible = first > first.max() - FAR_NATS
    possible[0] = True
    late_s, late_sd_s, occam = late_s[possible], late_sd_s[possible], occam[possible]
    late = [log_evidence(grid, recipe, *one) for one in zip(late_s[1:], late_sd_s[1:], strict=True)]
    own = np.stack([none_late, *late])
    log_weight = own.sum(axis=1) + occam
    log_weight = log_weight - np.logaddexp.reduce(log_weight)
    likely = log_weight > np.log(LEAST_LIKELY)
    by_others = (log_weight[:, None] - own)[likely]
    return LateClocks(late_s[likely], late_sd_s[likely], by_others - np.logaddexp.reduce(by_others, axis=0))


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
    ahead_s = _tt_less_utc(grid.reference_utc)
    parts = []
    for which in suspects:
        words = "late" if offset_s[which] > 0 else "early"
        text = f"{grid.observatories[which]} is {words} by {abs(offset_s[which]):.1f} ± {offset_sd_s[which]:.1f} s"
        if abs(abs(offset_s[which]) - ahead_s) < THRESHOLDS.late_clock_sd * offset_sd_s[which]:
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
    position_rsun : ndarray, shape (F, D)
    covariance_rsun2 : ndarray, shape (F, D, D)
        Of the posterior.

    Returns
    -------
    ndarray, shape (F, n, D)
        Solar radii; NaN where a receiver is missing.
    """
    received = np.isfinite(grid.arrival_s)
    present = replace(grid, receiver_rsun=np.where(received[..., None], grid.receiver_rsun, 1.0))
    travel_s, delay_s, slope = _linearised(present, position_rsun, priors, delay)
    both = received[:, :, None] & received[:, None, :]
    relative = priors.slowness_sd / priors.slowness_mean
    nuisance = EMISSION_SD_S**2 + (relative * travel_s[:, :, None]) * (relative * travel_s[:, None, :])
    turned = np.nan_to_num(delay.kappa_sd * delay_s)
    nuisance = nuisance + turned[:, :, None] * turned[:, None, :]
    stated = grid.covariances_s2() + nuisance + LEAST_S**2 * np.eye(received.shape[1])
    weight = np.where(both, np.linalg.inv(np.where(both, stated, np.eye(received.shape[1]))), 0.0)
    shift = SHIFT_S * np.einsum("fde,fie,fij->fjd", covariance_rsun2, np.nan_to_num(slope), weight, optimize=True)
    return np.where(received[..., None], shift, np.nan)


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
        "speed_above_c": posterior["above_c_probability"] > THRESHOLDS.likely_above_c,
        **{f"{axis}_not_constrained": posterior[f"contraction_{axis}"] > NOT_CONSTRAINED for axis in axes},
        "position_not_constrained": _widest_sd(posterior, axes)
        > NOT_CONSTRAINED * posterior.attrs["position_prior_sd_rsun"],
        "prior_dominated": _pull_in_sd(posterior, axes) > THRESHOLDS.dominated_sd,
        "multimodal": posterior["modes"] > 1,
        "arrivals_inconsistent": posterior["misfit"] > _largest_misfit(posterior),
        "bad_arrival": posterior["bad_probability"].max("observatory") > THRESHOLDS.likely_bad,
        "clock_offset": np.full(posterior.sizes["frequency"], bool(posterior.attrs["clock_offset"])),
        "few_effective_draws": posterior["draw_ess"] < THRESHOLDS.few_draws_share * posterior.sizes["draw"],
    }
    table = {name: np.asarray(where) for name, where in raised.items()}
    own = list(remarks) or [""] * posterior.sizes["frequency"]
    return [
        ";".join(filter(None, [*(name for name in table if table[name][row]), own[row]]))
        for row in range(posterior.sizes["frequency"])
    ]


def _largest_misfit(posterior: xr.Dataset) -> FloatArray:
    """Misfit that consistent arrival times exceed with the probability of the threshold at most, shape (frequency,)."""
    receivers = np.isfinite(posterior["arrival_s"].to_numpy()).sum(axis=1)
    return np.asarray(stats.chi2.isf(1 / THRESHOLDS.inconsistent_once_in, receivers - 1))


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
    draws : Draws
        One problem per frequency of the grid.
    bad_probability : ndarray, shape (F, n)
        That an arrival time is bad.
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
    received = np.isfinite(grid.arrival_s)
    precision = np.linalg.inv(np.where(np.isfinite(covariance), covariance, np.eye(received.shape[1])))
    known = np.where(received[:, None], residual, 0.0)
    discrepancy = np.einsum("fdi,fij,fdj->fd", known, precision, known, optimize=True)
    weight = (1 - bad_probability) * np.einsum("fij,fj->fi", precision, received.astype(np.float64))
    return Predictive(
        residual_s=_without_emission(residual, weight).mean(axis=1),
        receiver_p=2 * ndtr(-np.abs(deviation)).mean(axis=1),
        burst_p=chdtrc(received.sum(axis=1)[:, None], discrepancy).mean(axis=1),
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

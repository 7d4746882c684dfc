"""How the arrival time of a burst depends on frequency, t(f), fitted to the edges of many channels.

The basis *paper* is a2/f^2 + a1/f + a0 of Canizares et al. 2024, A&A 684, A182, doi:10.1051/0004-6361/202347747. It
misses simulated beams by 2 s rms (11 s at most) between 0.2 and 10 MHz. The basis *five_term* adds ln f and f^-1/2 and
misses them by 0.2 s rms (0.6 s at most).
"""

import math
from typing import NamedTuple

import numpy as np

from bella.bursts.widths import rise_half_width_s
from bella.exceptions import InputError
from bella.units import FloatArray

BASES = {
    "paper": (lambda f: f**-2.0, lambda f: 1 / f, np.ones_like),
    "five_term": (lambda f: f**-2.0, lambda f: 1 / f, np.ones_like, np.log, lambda f: f**-0.5),
}
"""Terms of t(f) by the name of the basis, frequency in MHz."""

HUBER = 1.345
"""Residuals beyond so many sigmas count linearly: 95 % of the efficiency of least squares without outliers."""

SIGMA_FLOOR = 0.1
"""No channel counts as better known than this share of the half width of its rise."""

MOST_ALIKE = 0.9
"""Neighbouring residuals count as correlated by no more than this."""

ITERATIONS, CONVERGED = 100, 1e-10
CUT_MHZ, LOW_OFFSET_S = 2.0, 2.0


class TimeEvolution(NamedTuple):
    """Arrival time as a function of frequency."""

    coefficients: FloatArray
    """Of the terms of the basis, in seconds on some axis and powers of MHz, shape (K,); of *paper* a2, a1, a0."""
    covariance: FloatArray
    """Of the coefficients in that order, shape (K, K); NaN where unknown."""
    basis: str = "paper"
    """A name of ``BASES``."""
    inflation: float = 1.0
    """Factor by which the covariance is larger than the given sigmas imply."""
    bic: float = math.nan
    """Bayesian information criterion, to compare fits to the same channels; NaN where not fitted robustly."""

    def arrival_s(self, frequency_mhz: FloatArray) -> FloatArray:
        """Arrival times.

        Parameters
        ----------
        frequency_mhz : numpy.ndarray
            MHz, above zero, shape (F,).

        Returns
        -------
        numpy.ndarray
            s on the axis of the coefficients, shape (F,).
        """
        return np.asarray(_terms(frequency_mhz, self.basis) @ self.coefficients, dtype=np.float64)

    def covariance_s2(self, frequency_mhz: FloatArray) -> FloatArray:
        """Covariance of the arrival times: they come from one curve, so all of them are correlated.

        Parameters
        ----------
        frequency_mhz : numpy.ndarray
            MHz, above zero, shape (F,).

        Returns
        -------
        numpy.ndarray
            s^2, shape (F, F), of a rank not above the number of terms.
        """
        terms = _terms(frequency_mhz, self.basis)
        return np.asarray(terms @ self.covariance @ terms.T)


class Edges(NamedTuple):
    """Channels that a curve is fitted to."""

    frequency_mhz: FloatArray
    arrival_s: FloatArray
    sigma_s: FloatArray


def _terms(frequency_mhz: FloatArray, basis: str) -> FloatArray:
    frequency = np.asarray(frequency_mhz, dtype=np.float64)
    return np.stack([term(frequency) for term in BASES[basis]], axis=-1)


def fit_time_evolution(
    frequency_mhz: FloatArray, arrival_s: FloatArray, sigma_s: FloatArray, basis: str = "paper"
) -> TimeEvolution:
    """Weighted least-squares fit of t(f).

    Parameters
    ----------
    frequency_mhz, arrival_s, sigma_s : numpy.ndarray
        MHz; s; standard deviation, s; shape (N,), N at least the number of terms. Rows with NaN are left out.
    basis : {"paper", "five_term"}

    Returns
    -------
    TimeEvolution
        With the covariance that the given sigmas imply, not rescaled by the residuals.

    Raises
    ------
    InputError
        If the basis is not known, fewer different frequencies remain than it has terms, or a sigma is not above zero.
    """
    edges = _usable(frequency_mhz, arrival_s, sigma_s, basis)
    coefficients, covariance = _least_squares(_terms(edges.frequency_mhz, basis), edges.arrival_s, 1 / edges.sigma_s)
    return TimeEvolution(coefficients, covariance, basis)


def robust_time_evolution(
    frequency_mhz: FloatArray, arrival_s: FloatArray, sigma_s: FloatArray, basis: str = "five_term"
) -> TimeEvolution:
    """Fit of t(f) that channels with a wrong edge hardly move.

    Huber's estimator by reweighted least squares; its covariance is scaled by the scatter of the residuals where that
    is larger than the sigmas say (Huber & Ronchetti 2009, Robust Statistics, chapter 7, doi:10.1002/9780470434697), and
    by how alike the residuals of neighbouring channels are, since these share their records and what the form of the
    curve cannot follow (Bayley & Hammersley 1946, Suppl. J. R. Stat. Soc. 8, 184, doi:10.2307/2983560).

    Parameters
    ----------
    frequency_mhz, arrival_s, sigma_s : numpy.ndarray
        MHz; s; standard deviation, s; shape (N,), N above the number of terms. Rows with NaN are left out; a sigma
        below a tenth of the half width of the rise is raised to it.
    basis : {"paper", "five_term"}

    Returns
    -------
    TimeEvolution
        With its inflation and Bayesian information criterion.

    Raises
    ------
    InputError
        As of :func:`fit_time_evolution`, and if no more channels than terms remain.
    """
    edges = _usable(frequency_mhz, arrival_s, sigma_s, basis)
    floor = SIGMA_FLOOR * np.array([rise_half_width_s(frequency) for frequency in edges.frequency_mhz])
    sigma, terms = np.maximum(edges.sigma_s, floor), _terms(edges.frequency_mhz, basis)
    channels, free = terms.shape[0], terms.shape[0] - terms.shape[1]
    if free < 1:
        raise InputError(f"{channels} edges say nothing of their scatter about {basis}: widen the frequency range")
    residual = _reweighted(terms, edges.arrival_s, sigma)
    weight = np.minimum(1.0, HUBER / np.maximum(np.abs(residual), HUBER))
    coefficients, _ = _least_squares(terms, edges.arrival_s, np.sqrt(weight) / sigma)
    inside = np.abs(residual) <= HUBER
    clipped = np.clip(residual, -HUBER, HUBER)
    scatter = max(1.0, float((clipped**2).sum() / free / max(inside.mean(), 1 / channels) ** 2))
    inflation = scatter * _alike(clipped[np.argsort(edges.frequency_mhz)])
    loss = 2 * np.where(inside, 0.5 * residual**2, HUBER * (np.abs(residual) - 0.5 * HUBER)).sum()
    covariance = inflation * _least_squares(terms, edges.arrival_s, 1 / sigma)[1]
    return TimeEvolution(coefficients, covariance, basis, inflation, float(loss + terms.shape[1] * math.log(channels)))


def best_time_evolution(frequency_mhz: FloatArray, arrival_s: FloatArray, sigma_s: FloatArray) -> TimeEvolution:
    """Robust fit in the basis that the Bayesian information criterion prefers.

    Parameters
    ----------
    frequency_mhz, arrival_s, sigma_s : numpy.ndarray
        As of :func:`robust_time_evolution`.

    Returns
    -------
    TimeEvolution
        ``basis`` says which it is.

    Raises
    ------
    InputError
        If there are too few channels even for the basis with the fewest terms.
    """
    channels = np.unique(np.asarray(frequency_mhz)[np.isfinite(arrival_s) & np.isfinite(sigma_s)]).size
    possible = [basis for basis, terms in BASES.items() if len(terms) < channels] or ["paper"]
    fits = [robust_time_evolution(frequency_mhz, arrival_s, sigma_s, basis) for basis in possible]
    return min(fits, key=lambda fit: fit.bic)


def common_offset_s(frequency_mhz: FloatArray, cadence_s: float, integration_s: float) -> FloatArray:
    """Standard deviation of the timing offset that the channels of a receiver share, as they share its records.

    The residuals of neighbouring channels do not show it: where a burst rises between two snapshots, it does so in all
    of them.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray, shape (F,)
        MHz.
    cadence_s, integration_s : float
        Time between records and time that a sample averages over, s.

    Returns
    -------
    numpy.ndarray, shape (F,)
        s: above 2 MHz cadence / sqrt(12) for snapshots, which average over less than half of the cadence; else 2 s.
    """
    snapshots = integration_s < 0.5 * cadence_s
    high = cadence_s / math.sqrt(12.0) if snapshots else LOW_OFFSET_S
    return np.where(np.asarray(frequency_mhz) > CUT_MHZ, max(high, LOW_OFFSET_S), LOW_OFFSET_S)


def _usable(frequency_mhz: FloatArray, arrival_s: FloatArray, sigma_s: FloatArray, basis: str) -> Edges:
    if basis not in BASES:
        raise InputError(f"{basis!r} is not a basis of t(f): choose one of {', '.join(BASES)}")
    known = np.isfinite(frequency_mhz) & np.isfinite(arrival_s) & np.isfinite(sigma_s)
    edges = Edges(frequency_mhz[known], arrival_s[known], sigma_s[known])
    channels, needed = np.unique(edges.frequency_mhz).size, len(BASES[basis])
    if channels < needed:
        number = {3: "three", 5: "five"}[needed]
        raise InputError(f"t(f) needs edges at {number} frequencies, not {channels}: widen the frequency range")
    if not (edges.sigma_s > 0.0).all():
        raise InputError("a timing sigma is not above zero: give the standard deviation of every arrival in seconds")
    return edges


def _least_squares(terms: FloatArray, arrival_s: FloatArray, root_weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    orthonormal, triangle = np.linalg.qr(terms * root_weight[:, np.newaxis])
    inverse = np.linalg.inv(triangle)
    return inverse @ (orthonormal.T @ (arrival_s * root_weight)), inverse @ inverse.T


def _alike(residual: FloatArray) -> float:
    """Channels per independent one, from the correlation of neighbours."""
    square = float((residual**2).sum())
    correlation = float((residual[1:] * residual[:-1]).sum()) / square if square > 0 else 0.0
    correlation = min(max(correlation, 0.0), MOST_ALIKE)
    return (1 + correlation) / (1 - correlation)


def _reweighted(terms: FloatArray, arrival_s: FloatArray, sigma_s: FloatArray) -> FloatArray:
    """Residuals of Huber's estimator, in sigmas."""
    weight, before = np.ones_like(sigma_s), np.full_like(sigma_s, np.inf)
    for _ in range(ITERATIONS):
        coefficients, _ = _least_squares(terms, arrival_s, np.sqrt(weight) / sigma_s)
        residual = (arrival_s - terms @ coefficients) / sigma_s
        if np.abs(residual - before).max() < CONVERGED:
            break
        weight, before = np.minimum(1.0, HUBER / np.maximum(np.abs(residual), HUBER)), residual
    return residual

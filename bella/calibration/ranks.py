"""Ranks of truths among draws: whether they are uniform, and the band in which their distribution should stay.

Simulation-based calibration: the rank of the truth among L draws from its posterior is uniform on 0 .. L if truth and
data came from the model that is fitted (Talts et al. 2018, arXiv:1804.06788, theorem 1).
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import stats

from bella.units import FloatArray

MOST_BINS = 20
SOURCES_PER_BIN = 10
BAND_SIMULATIONS = 10_000
BAND_SEED = 20120607


@dataclass(frozen=True)
class Uniformity:
    """P-values of two tests of uniformity: Kolmogorov-Smirnov sees shifts, chi-squared sees shapes."""

    ks_p: float
    chi2_p: float

    @property
    def smallest(self) -> float:
        """The smaller of the two."""
        return min(self.ks_p, self.chi2_p)


def fractional_ranks(truth: FloatArray, draws: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Ranks of truths among their draws, as numbers between 0 and 1.

    A truth that equals draws is put at random among them, and every rank at random within its share 1/(L + 1) of the
    unit interval, so that ranks that are uniform on 0 .. L become exactly uniform on (0, 1).

    Parameters
    ----------
    truth : ndarray, shape (B,)
    draws : ndarray, shape (B, L)

    Returns
    -------
    ndarray, shape (B,)
    """
    below = (draws < truth[:, None]).sum(axis=1)
    equal = (draws == truth[:, None]).sum(axis=1)
    rank = below + rng.integers(equal + 1)
    return np.asarray((rank + rng.random(truth.size)) / (draws.shape[1] + 1))


def bins_of(number: int) -> int:
    """Bins of the chi-squared test for a number of sources."""
    return int(np.clip(number // SOURCES_PER_BIN, 2, MOST_BINS))


def uniformity(ranks: FloatArray) -> Uniformity:
    """Test fractional ranks for uniformity.

    Parameters
    ----------
    ranks : ndarray, shape (B,)
        Between 0 and 1.
    """
    counts = np.histogram(ranks, bins=bins_of(ranks.size), range=(0, 1))[0]
    return Uniformity(float(stats.kstest(ranks, "uniform").pvalue), float(stats.chisquare(counts).pvalue))


def pp_curve(ranks: FloatArray, points: int) -> FloatArray:
    """Share of ranks up to each of the probabilities 1/K, 2/K .. 1: the P-P curve.

    Parameters
    ----------
    ranks : ndarray, shape (B,)
    points : int
        K.

    Returns
    -------
    ndarray, shape (K,)
    """
    probability = np.arange(1, points + 1) / points
    return np.asarray(np.searchsorted(np.sort(ranks), probability, side="right") / ranks.size)


@cache
def simultaneous_band(number: int, points: int, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
    """Band that holds the whole P-P curve of uniform ranks with a probability.

    Pointwise binomial intervals, all of the one level that makes them hold together; that level by simulation
    (Säilynoja, Bürkner & Vehtari 2022, doi:10.1007/s11222-022-10090-6).

    Parameters
    ----------
    number : int
        Sources B.
    points : int
        Probabilities K at which the curve is drawn.
    level : float
        Probability that the whole curve is inside.

    Returns
    -------
    low, high : ndarray, shape (K,)
        Shares.
    """
    probability = np.arange(1, points + 1) / points
    rng = np.random.default_rng(BAND_SEED)
    smallest = np.concatenate([_smallest_tail(number, probability, rng, BAND_SIMULATIONS // 10) for _ in range(10)])
    tail = float(np.quantile(smallest, 1 - level)) / 2
    return (
        stats.binom.ppf(tail, number, probability) / number,
        stats.binom.ppf(1 - tail, number, probability) / number,
    )


def _smallest_tail(number: int, probability: FloatArray, rng: np.random.Generator, simulations: int) -> FloatArray:
    """Twice the smaller binomial tail, where it is least along each simulated curve."""
    points = probability.size
    counts = rng.multinomial(number, np.full(points, 1 / points), size=simulations).cumsum(axis=1)[:, :-1]
    inner = probability[:-1]
    below = stats.binom.cdf(counts, number, inner)
    above = stats.binom.sf(counts - 1, number, inner)
    return np.asarray(np.minimum(1.0, 2 * np.minimum(below, above)).min(axis=1))

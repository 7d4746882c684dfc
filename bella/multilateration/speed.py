"""Propagation speed given the position, under the prior that is Gaussian in the speed itself.

:mod:`bella.multilateration.likelihood` integrates over the slowness u = 1/v with a prior that is Gaussian in u. The
prior of the model is Gaussian in v, perhaps with a largest speed, and the two differ by a smooth ratio. Moments take it
into account by quadrature over u | x: Gauss-Hermite, or Gauss-Legendre where a largest speed cuts u | x off. Draws take
v from the Gaussian that fits v | x best and carry the ratio as a weight.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri_exp

from bella.multilateration.likelihood import Local
from bella.multilateration.priors import Priors
from bella.units import C_RSUN_S, FloatArray

NARROW_SPEED_PRIOR = 0.01
"""Speed priors up to this, in c, are Gaussian in u to better than 1e-4 over the posterior."""
LARGEST_LOG_RATIO = 50.0
SMALLEST_LOG_RATIO = -460.0
"""Limits of the ratio of the two priors. Only arrival times that no source explains reach them; they keep those finite
until :mod:`bella.multilateration.checks` says so."""
WHOLE_NODES = 9
"""Nodes of the quadrature over a whole Gaussian."""
CUT_NODES = 24
CUT_RANGE_SD = 6.5
"""Quadrature over a Gaussian that is cut off: nodes, and how far they reach."""
NEWTON_STEPS = 2
SLOWEST = 0.05
"""Slowest speed, in c, at which v | x is expanded."""
LOG_ROOT_2PI = 0.5 * np.log(2 * np.pi)


@dataclass(frozen=True)
class SpeedMoments:
    """Moments of u | x and v | x at points, each of the shape of the integrals, under the prior of the model.

    Attributes
    ----------
    log_factor : ndarray
        Change of the log density of x against the prior that is Gaussian in u.
    u, u_variance : ndarray
        Mean and variance of the slowness, s and s^2 per (square) solar radius.
    v, v_variance : ndarray
        Mean and variance of v/c.
    above_c : ndarray
        Probability of v > c.
    """

    log_factor: FloatArray
    u: FloatArray
    u_variance: FloatArray
    v: FloatArray
    v_variance: FloatArray
    above_c: FloatArray


def speed_moments(local: Local, priors: Priors) -> SpeedMoments:
    """Moments of slowness and speed given the position."""
    if speed_prior_is_gaussian(priors):
        return _of_narrow_prior(local)
    nodes, log_weight = speed_nodes(local, priors)
    log_factor = _log_sum(log_weight)
    share = np.exp(log_weight - log_factor)
    u, u_variance = _mean_and_variance(share, nodes)
    v, v_variance = _mean_and_variance(share, 1 / (nodes * C_RSUN_S))
    if priors.is_truncated and priors.v_max_c <= 1:
        above_c = np.zeros_like(u)
    else:
        above_c = ndtr((1 / C_RSUN_S - local.slowness) / local.slowness_sd)
    return SpeedMoments(log_factor, u, u_variance, v, v_variance, above_c)


def _of_narrow_prior(local: Local) -> SpeedMoments:
    """Moments for a Gaussian in u that is so narrow that v = 1/u is expanded around its mean."""
    relative = local.slowness_sd / local.slowness
    v = (1 + relative**2) / (local.slowness * C_RSUN_S)
    above_c = ndtr((1 / C_RSUN_S - local.slowness) / local.slowness_sd)
    return SpeedMoments(
        np.zeros_like(v), local.slowness, local.slowness_sd**2, v, (v * relative) ** 2, np.asarray(above_c)
    )


def _log_sum(log_weight: FloatArray) -> FloatArray:
    top = log_weight.max(axis=0)
    return np.asarray(top + np.log(np.exp(log_weight - top).sum(axis=0)))


def _mean_and_variance(share: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean = (share * values).sum(axis=0)
    return mean, (share * (values - mean) ** 2).sum(axis=0)


def speed_prior_is_gaussian(priors: Priors) -> bool:
    """Whether the prior of the speed is as good as Gaussian in the slowness."""
    return priors.v_sd_c <= NARROW_SPEED_PRIOR and not priors.is_truncated


def log_speed_factor(local: Local, priors: Priors) -> FloatArray:
    """Change of the log density of x when the prior of the speed is that of the model instead of Gaussian in u.

    Returns
    -------
    ndarray
        The shape of the integrals. Left out (0) for priors up to `NARROW_SPEED_PRIOR` without a largest speed, where it
        changes by less than 1e-4 over the posterior.
    """
    if speed_prior_is_gaussian(priors):
        return np.zeros_like(local.log_density)
    return _log_sum(speed_nodes(local, priors)[1])


def speed_nodes(local: Local, priors: Priors) -> tuple[FloatArray, FloatArray]:
    """Quadrature over u | x under the prior of the model.

    Returns
    -------
    nodes : ndarray, shape (J, K, *S)
        Values of u, s per solar radius.
    log_weight : ndarray, shape (J, K, *S)
        Not normalised: the sum of the weights is the factor by which the density of x changes.
    """
    mean, sd = local.slowness, local.slowness_sd
    if priors.is_truncated:
        z, log_weight = _cut_nodes((1 / (priors.v_max_c * C_RSUN_S) - mean) / sd)
    else:
        z, log_weight = _whole_nodes(WHOLE_NODES, mean.ndim)
    nodes = mean + z * sd
    return nodes, log_weight + log_prior_ratio(nodes, priors)


@cache
def _hermite(number: int) -> tuple[FloatArray, FloatArray]:
    z, weight = np.polynomial.hermite_e.hermegauss(number)
    return z, np.log(weight / weight.sum())


def _whole_nodes(number: int, axes: int) -> tuple[FloatArray, FloatArray]:
    shape = (-1, *(1,) * axes)
    z, log_weight = _hermite(number)
    return z.reshape(shape), log_weight.reshape(shape)


def _cut_nodes(cut: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nodes and log weights of a standard Gaussian above a cut, which may be far in its tail."""
    low = np.maximum(cut, -CUT_RANGE_SD)
    high = np.maximum(np.sqrt(np.maximum(low, 0) ** 2 + CUT_RANGE_SD**2), low * (1 + 1e-12))
    place, weight = np.polynomial.legendre.leggauss(CUT_NODES)
    half = 0.5 * (high - low)
    shape = (-1, *(1,) * cut.ndim)
    z = low + half * (1 + place.reshape(shape))
    return z, np.log(weight.reshape(shape)) + np.log(half) - 0.5 * z**2 - LOG_ROOT_2PI


def log_prior_ratio(slowness: FloatArray, priors: Priors) -> FloatArray:
    """Logarithm of the ratio of the prior of the model, a density of u = 1/v, to the one that is Gaussian in u.

    Parameters
    ----------
    slowness : ndarray
        u, s per solar radius; any shape. Speeds above the largest are not looked for.

    Returns
    -------
    ndarray
        The shape of `slowness`; very small where u is not positive.
    """
    positive = slowness > 0
    u = np.where(positive, slowness, 1.0)
    v_deviation = (1 / (u * C_RSUN_S) - 1) / priors.v_sd_c
    u_deviation = (u - priors.slowness_mean) / priors.slowness_sd
    log_jacobian = np.log(priors.slowness_sd / (priors.v_sd_c * C_RSUN_S)) - priors.log_share_allowed
    exponent = np.clip(0.5 * (u_deviation**2 - v_deviation**2), SMALLEST_LOG_RATIO, LARGEST_LOG_RATIO)
    return np.where(positive, log_jacobian - 2 * np.log(u) + exponent, SMALLEST_LOG_RATIO)


def draw_slowness(local: Local, priors: Priors, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draw u given the position, near enough to be weighted to its exact density.

    Parameters
    ----------
    local : Local
        Of components that were drawn: shape (1, *S).

    Returns
    -------
    slowness : ndarray, shape S
        s per solar radius.
    log_weight : ndarray, shape S
        Logarithm of the density of u under the prior of the model, given x and times the change of the density of x,
        over the density it was drawn from.
    """
    mean, sd = local.slowness[0], local.slowness_sd[0]
    if speed_prior_is_gaussian(priors):
        return mean + sd * rng.standard_normal(mean.shape), np.zeros(())
    top, width = _speed_expansion(mean, sd, priors)
    z, log_share = _deviates((priors.v_max_c - top) / width, rng) if priors.is_truncated else _whole(mean.shape, rng)
    v = top + width * z
    u = 1 / (np.maximum(v, 1e-6) * C_RSUN_S)
    log_drawn = -0.5 * z**2 - np.log(width * u) - log_share + np.log(np.maximum(v, 1e-6))
    log_target = -0.5 * ((u - mean) / sd) ** 2 - np.log(sd) + log_prior_ratio(u, priors)
    return u, log_target - log_drawn


def _whole(shape: tuple[int, ...], rng: np.random.Generator) -> tuple[FloatArray, float]:
    return rng.standard_normal(shape), 0.0


def _deviates(cut: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Standard Gaussian deviates below a cut, which may be far in the tail, and the log of the share below it."""
    log_share = log_ndtr(cut)
    return ndtri_exp(np.log1p(-rng.random(cut.shape)) + log_share), log_share


def _speed_expansion(mean: FloatArray, sd: FloatArray, priors: Priors) -> tuple[FloatArray, FloatArray]:
    """Maximum and width of v | x in units of c, by Gauss-Newton on likelihood times prior."""
    u0, su, prior = priors.slowness_mean, priors.slowness_sd, priors.v_sd_c**-2
    data = np.maximum(sd**-2 - su**-2, 0)
    pull = mean / sd**2 - u0 / su**2
    v = np.maximum(1 / (np.maximum(mean, 1e-3) * C_RSUN_S), SLOWEST)
    for _ in range(NEWTON_STEPS):
        q = 1 / (v * C_RSUN_S)
        precision = prior + data * (q / v) ** 2
        step = (-(v - 1) * prior + (data * q - pull) * q / v) / precision
        v = np.maximum(v + step, SLOWEST)
    return v, 1 / np.sqrt(prior + data * (1 / (v * v * C_RSUN_S)) ** 2)

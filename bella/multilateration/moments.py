"""Mean, covariance and evidence of a posterior held by equal cells."""

from dataclasses import dataclass

import numpy as np

from bella.multilateration.cells import Cells
from bella.multilateration.likelihood import IntArray, Problems, log_constant
from bella.multilateration.priors import Priors
from bella.units import FloatArray


@dataclass(frozen=True)
class Moments:
    """Summary of each problem's posterior.

    Attributes
    ----------
    mean : ndarray, shape (B, D)
        Solar radii.
    covariance : ndarray, shape (B, D, D)
        Square solar radii.
    emission_s, emission_sd_s : ndarray, shape (B,)
        Emission time after the reference time of the grid, s.
    v_over_c, v_over_c_sd : ndarray, shape (B,)
        Propagation speed.
    log_evidence : ndarray, shape (B,)
    above_c : ndarray, shape (B,)
        Probability that the speed is above that of light.
    prior_pull : ndarray, shape (B, D)
        How far the prior moves the mean, to first order, solar radii.
    bad_probability : ndarray, shape (B, n)
        Probability that an arrival time is bad; 0 where the noise is Gaussian.
    kappa, kappa_sd : ndarray, shape (B,)
        Of the directional delay, in half widths of the rise.
    """

    mean: FloatArray
    covariance: FloatArray
    emission_s: FloatArray
    emission_sd_s: FloatArray
    v_over_c: FloatArray
    v_over_c_sd: FloatArray
    log_evidence: FloatArray
    above_c: FloatArray
    prior_pull: FloatArray
    bad_probability: FloatArray
    kappa: FloatArray
    kappa_sd: FloatArray


def summed(values: FloatArray, owner: IntArray, count: int) -> FloatArray:
    """Sum over the points of each problem: (M,) to (B,)."""
    return np.bincount(owner, values, minlength=count).astype(np.float64)


def normalised(log_density: FloatArray, owner: IntArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Probability of each point within its problem, and the logarithm of the sum it was divided by.

    Parameters
    ----------
    log_density : ndarray, shape (K, M)
        Of K components of the noise; the points in the order of their problems.
    owner : ndarray of int, shape (M,)
    count : int
        Number of problems B.

    Returns
    -------
    probability : ndarray, shape (K, M)
    log_sum : ndarray, shape (B,)
    """
    first = np.searchsorted(owner, np.arange(count))
    top = np.maximum.reduceat(log_density.max(axis=0), first)
    mass = np.exp(log_density - top[owner])
    total = np.add.reduceat(mass.sum(axis=0), first)
    return mass / total[owner], top + np.log(total)


def moments_of(problems: Problems, cells: Cells) -> Moments:
    """Summary of the posterior held by cells (midpoint rule).

    Parameters
    ----------
    problems : Problems
    cells : Cells

    Returns
    -------
    Moments
    """
    count, owner, local, speed = problems.count, cells.owner, cells.local, cells.speed
    joint, log_sum = normalised(cells.log_density, owner, count)

    def _mean(values: FloatArray) -> FloatArray:
        return summed((joint * values).sum(axis=0), owner, count)

    def _spread(values: FloatArray, within: FloatArray) -> FloatArray:
        return _mean((values - _mean(values)[owner]) ** 2 + within)

    here = problems.at(owner)
    kappa, kappa_variance = local.kappa_given(speed.u), local.kappa_slope**2 * speed.u_variance + local.kappa_sd**2
    emission = here.mean_arrival_s - problems.mean_arrival_s[0, owner] - local.mean_distance * speed.u
    emission = emission - local.mean_delay_s * kappa
    with_slowness = local.mean_distance + local.kappa_slope * local.mean_delay_s
    within = with_slowness**2 * speed.u_variance + (local.mean_delay_s * local.kappa_sd) ** 2 + 1 / here.total_weight
    emission_variance = _spread(emission, within)
    share = joint.sum(axis=0)
    position, covariance, prior_pull = _position_moments(share, cells, count, problems.priors)
    return Moments(
        mean=position,
        covariance=covariance,
        emission_s=problems.mean_arrival_s[0] + _mean(emission),
        emission_sd_s=np.sqrt(emission_variance),
        v_over_c=_mean(speed.v),
        v_over_c_sd=np.sqrt(_spread(speed.v, speed.v_variance)),
        log_evidence=log_sum + problems.dimensions * np.log(cells.side) + log_constant(problems),
        above_c=_mean(speed.above_c),
        prior_pull=prior_pull,
        bad_probability=np.stack([summed(one, owner, count) for one in joint], axis=1) @ problems.bad,
        kappa=_mean(kappa),
        kappa_sd=np.sqrt(_spread(kappa, kappa_variance)),
    )


def _position_moments(
    share: FloatArray, cells: Cells, count: int, priors: Priors
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean, covariance, and the change of the mean with the power to which the prior is raised, at the power of one.

    The last is the covariance of position and log prior, an identity of exponential families.
    """
    centres = cells.centres
    mean = np.stack([summed(share * axis, cells.owner, count) for axis in centres], axis=1)
    deviation = centres - mean.T[:, cells.owner]
    weighted = share * deviation
    covariance = [[summed(a * b, cells.owner, count) for b in deviation] for a in weighted]
    log_prior = priors.log_position((centres**2).sum(axis=0))
    pull = np.stack([summed(a * log_prior, cells.owner, count) for a in weighted], axis=1)
    return mean, np.moveaxis(np.array(covariance), -1, 0), pull

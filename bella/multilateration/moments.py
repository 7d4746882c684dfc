"""Mean, covariance and evidence of a posterior held by equal cells."""

from dataclasses import dataclass

import numpy as np

from bella.multilateration.cells import Cells
from bella.multilateration.likelihood import IntArray, Local, Problems, log_constant, speed_nodes
from bella.units import C_RSUN_S, FloatArray


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
    """

    mean: FloatArray
    covariance: FloatArray
    emission_s: FloatArray
    emission_sd_s: FloatArray
    v_over_c: FloatArray
    v_over_c_sd: FloatArray
    log_evidence: FloatArray


@dataclass(frozen=True)
class SpeedMoments:
    """Moments of u | x and v | x at points, each shape (M,), under the prior that is Gaussian in v.

    Attributes
    ----------
    log_factor : ndarray
        Change of the log density of x against the prior that is Gaussian in u.
    u, u_variance : ndarray
        Mean and variance of the slowness, s and s^2 per (square) solar radius.
    v, v_variance : ndarray
        Mean and variance of v/c.
    """

    log_factor: FloatArray
    u: FloatArray
    u_variance: FloatArray
    v: FloatArray
    v_variance: FloatArray


def speed_moments(problems: Problems, local: Local) -> SpeedMoments:
    """Moments of slowness and speed given the position.

    Parameters
    ----------
    problems : Problems
    local : Local

    Returns
    -------
    SpeedMoments
    """
    nodes, weights = speed_nodes(local.slowness, local.slowness_sd, problems.priors)
    factor = weights.sum(axis=0)
    share = weights / factor
    u, u_variance = _mean_and_variance(share, nodes)
    v, v_variance = _mean_and_variance(share, 1 / (nodes * C_RSUN_S))
    return SpeedMoments(np.log(factor), u, u_variance, v, v_variance)


def _mean_and_variance(share: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean = (share * values).sum(axis=0)
    return mean, (share * (values - mean) ** 2).sum(axis=0)


def summed(values: FloatArray, owner: IntArray, count: int) -> FloatArray:
    """Sum over the points of each problem: (M,) to (B,)."""
    return np.bincount(owner, values, minlength=count).astype(np.float64)


def normalised(log_density: FloatArray, owner: IntArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Probability of each point within its problem, and the logarithm of the sum it was divided by.

    Parameters
    ----------
    log_density : ndarray, shape (M,)
    owner : ndarray of int, shape (M,)
    count : int
        Number of problems B.

    Returns
    -------
    probability : ndarray, shape (M,)
    log_sum : ndarray, shape (B,)
    """
    top = np.full(count, -np.inf)
    np.maximum.at(top, owner, log_density)
    mass = np.exp(log_density - top[owner])
    total = summed(mass, owner, count)
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
    count, owner, local = problems.count, cells.owner, cells.local
    speed = speed_moments(problems, local)
    share, log_sum = normalised(local.log_density + speed.log_factor, owner, count)

    def _mean(values: FloatArray) -> FloatArray:
        return summed(share * values, owner, count)

    position, covariance = _position_moments(share, cells, count)

    def _spread(values: FloatArray, within: FloatArray) -> FloatArray:
        return _mean((values - _mean(values)[owner]) ** 2 + within)

    delay = local.mean_distance * speed.u
    delay_variance = _spread(delay, local.mean_distance**2 * speed.u_variance)
    area = cells.side**problems.dimensions
    return Moments(
        mean=position,
        covariance=covariance,
        emission_s=problems.mean_arrival_s - _mean(delay),
        emission_sd_s=np.sqrt(delay_variance + 1 / problems.total_weight),
        v_over_c=_mean(speed.v),
        v_over_c_sd=np.sqrt(_spread(speed.v, speed.v_variance)),
        log_evidence=log_sum + np.log(area) + log_constant(problems),
    )


def _position_moments(share: FloatArray, cells: Cells, count: int) -> tuple[FloatArray, FloatArray]:
    centres = cells.centres
    mean = np.stack([summed(share * axis, cells.owner, count) for axis in centres], axis=1)
    deviation = centres - mean.T[:, cells.owner]
    covariance = [[summed(share * a * b, cells.owner, count) for b in deviation] for a in deviation]
    return mean, np.moveaxis(np.array(covariance), -1, 0)

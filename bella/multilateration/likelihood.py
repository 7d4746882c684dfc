r"""Density of the source position with emission time and propagation speed integrated out.

A source at x that emits at time t0 is heard by receiver i, at s_i, at t0 + u d_i, where d_i = \|x - s_i\| and u = 1/v.
Arrival times y_i have Gaussian errors with weights w_i = 1/sigma_i^2 (the model of Canizares et al. 2024, A&A, in
solar radii and seconds). The emission time has a flat prior and u a Gaussian one, N(u0, su), so both integrals are
closed. With weighted means taken off (d~, y~), r~ = y~ - u0 d~ and

    A = sum w d~^2,   B = sum w d~ r~,   R = sum w r~^2,   P = A + 1/su^2,   W = sum w :

    log p(x | y) = -(R - B^2/P)/2 - log(P su^2)/2 - |x|^2/(2 tau^2) + const,
    u | x  ~  N(u0 + B/P, 1/P),        t0 | x, u  ~  N(y-bar - u d-bar, 1/W).

The prior of the speed is Gaussian in v, not in u; :func:`speed_moments` corrects for the ratio of the two by
Gauss-Hermite quadrature over u | x.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bella.arrivals import ArrivalGrid
from bella.multilateration.priors import Priors
from bella.units import C_RSUN_S, FloatArray

IntArray = npt.NDArray[np.intp]

NARROW_SPEED_PRIOR = 0.01
"""Speed priors up to this, in c, are Gaussian in u to better than 1e-4; three nodes then integrate the ratio."""
LARGEST_LOG_RATIO = 50.0
SMALLEST_RATIO = 1e-200
"""Limits of the ratio of the two priors. Only arrival times that no source explains reach them; they keep those finite
until :mod:`bella.multilateration.flags` says so."""


@dataclass(frozen=True)
class Problems:
    """Independent localisation problems, one per frequency, as arrays that can be gathered by owner.

    Attributes
    ----------
    receivers : ndarray, shape (3, n, B)
        Coordinates of the receivers, solar radii; 0 where a receiver is missing.
    delays : ndarray, shape (n, B)
        Arrival times less their weighted mean, s; 0 where missing.
    weights : ndarray, shape (n, B)
        1/sigma^2, s^-2; 0 where missing.
    total_weight, mean_arrival_s : ndarray, shape (B,)
    priors : Priors
    dimensions : int
        2: the source is in the ecliptic plane; the receivers never are made to be.
    """

    receivers: FloatArray
    delays: FloatArray
    weights: FloatArray
    total_weight: FloatArray
    mean_arrival_s: FloatArray
    priors: Priors
    dimensions: int

    @property
    def count(self) -> int:
        """Number of problems B."""
        return int(self.delays.shape[1])

    def take(self, some: slice) -> "Problems":
        """The problems of a slice."""
        return Problems(
            self.receivers[..., some],
            self.delays[:, some],
            self.weights[:, some],
            self.total_weight[some],
            self.mean_arrival_s[some],
            self.priors,
            self.dimensions,
        )


@dataclass(frozen=True)
class Local:
    """The integrals at points x; every array has shape (M,), one value per point.

    Attributes
    ----------
    log_density : ndarray
        log p(x | y) up to a constant of the problem, for the prior that is Gaussian in u.
    misfit : ndarray
        R - B^2/P: the smallest weighted sum of squares over emission time and slowness.
    slowness, slowness_sd : ndarray
        Mean and standard deviation of u | x, s per solar radius.
    mean_distance : ndarray
        d-bar, solar radii.
    """

    log_density: FloatArray
    misfit: FloatArray
    slowness: FloatArray
    slowness_sd: FloatArray
    mean_distance: FloatArray


def problems_of(grid: ArrivalGrid, priors: Priors, dimensions: int) -> Problems:
    """Localisation problems of the frequencies of a grid.

    Parameters
    ----------
    grid : ArrivalGrid
    priors : Priors
    dimensions : int

    Returns
    -------
    Problems
    """
    present = np.isfinite(grid.arrival_s).T
    weights = np.where(present, 1 / grid.sigma_s.T**2, 0.0)
    arrivals = np.where(present, grid.arrival_s.T, 0.0)
    total = weights.sum(axis=0)
    mean = (weights * arrivals).sum(axis=0) / total
    return Problems(
        receivers=np.ascontiguousarray(np.where(present, grid.receiver_rsun.T, 0.0)),
        delays=np.where(present, arrivals - mean, 0.0),
        weights=weights,
        total_weight=total,
        mean_arrival_s=mean,
        priors=priors,
        dimensions=dimensions,
    )


def evaluate(problems: Problems, points: FloatArray, owner: IntArray) -> Local:
    """Integrals at many points, each belonging to one of the problems.

    Parameters
    ----------
    problems : Problems
    points : ndarray, shape (D, M)
        Coordinates by row, solar radii.
    owner : ndarray, shape (M,)
        Problem of each point.

    Returns
    -------
    Local
    """
    u0, su = problems.priors.slowness_mean, problems.priors.slowness_sd
    weights = problems.weights[:, owner]
    distances, _ = _distances(problems, points, owner)
    mean_distance = (weights * distances).sum(axis=0) / problems.total_weight[owner]
    excess = distances - mean_distance
    residual = problems.delays[:, owner] - u0 * excess
    weighted = weights * excess
    A, B = (weighted * excess).sum(axis=0), (weighted * residual).sum(axis=0)
    R = (weights * residual**2).sum(axis=0)
    P = A + su**-2
    misfit = R - B**2 / P
    prior = (points**2).sum(axis=0) / problems.priors.tau_rsun**2
    return Local(
        log_density=-0.5 * (misfit + np.log(P * su**2) + prior),
        misfit=misfit,
        slowness=u0 + B / P,
        slowness_sd=1 / np.sqrt(P),
        mean_distance=mean_distance,
    )


def sharpness(problems: Problems, points: FloatArray, owner: IntArray) -> FloatArray:
    """Root of the trace of the information on x that the data (emission time free) and the prior carry.

    Parameters
    ----------
    problems : Problems
    points : ndarray, shape (D, M)
        Solar radii.
    owner : ndarray, shape (M,)
        Problem of each point.

    Returns
    -------
    ndarray, shape (M,)
        1/solar radius.
    """
    distances, offsets = _distances(problems, points, owner)
    total = problems.total_weight[owner]
    share = problems.weights[:, owner] / total / np.maximum(distances, 1e-9)
    squared_mean_direction = sum((share * offset).sum(axis=0) ** 2 for offset in offsets)
    data = problems.priors.slowness_mean**2 * total * np.maximum(1 - squared_mean_direction, 0)
    return np.asarray(np.sqrt(data + problems.priors.tau_rsun**-2))


def _distances(problems: Problems, points: FloatArray, owner: IntArray) -> tuple[FloatArray, list[FloatArray]]:
    """Distance to each receiver, shape (n, M), and the offsets from it along each axis of the source."""
    offsets = [points[axis] - problems.receivers[axis][:, owner] for axis in range(problems.dimensions)]
    beyond = sum(problems.receivers[axis] ** 2 for axis in range(problems.dimensions, 3))
    squared = sum(offset**2 for offset in offsets) + (beyond[:, owner] if problems.dimensions < 3 else 0.0)
    return np.asarray(np.sqrt(squared)), offsets


def log_speed_factor(problems: Problems, local: Local) -> FloatArray:
    """Change of the log density of x when the prior of the speed is Gaussian in v instead of in u.

    Parameters
    ----------
    problems : Problems
    local : Local

    Returns
    -------
    ndarray, shape (M,)
        Left out (0) for priors up to `NARROW_SPEED_PRIOR`, where it changes by less than 1e-4 over the posterior.
    """
    if problems.priors.v_sd_c <= NARROW_SPEED_PRIOR:
        return np.zeros_like(local.log_density)
    _, weights = speed_nodes(local.slowness, local.slowness_sd, problems.priors)
    return np.asarray(np.log(weights.sum(axis=0)))


def speed_nodes(slowness: FloatArray, slowness_sd: FloatArray, priors: Priors) -> tuple[FloatArray, FloatArray]:
    """Quadrature over u | x under the prior that is Gaussian in v.

    Parameters
    ----------
    slowness, slowness_sd : ndarray, shape (M,)
        Of u | x under the prior that is Gaussian in u.
    priors : Priors

    Returns
    -------
    nodes : ndarray, shape (K, M)
        Values of u, s per solar radius.
    weights : ndarray, shape (K, M)
        Not normalised: their sum is the factor by which the density of x changes.
    """
    z, omega = np.polynomial.hermite_e.hermegauss(3 if priors.v_sd_c <= NARROW_SPEED_PRIOR else 9)
    nodes = slowness + z[:, None] * slowness_sd
    return nodes, (omega / omega.sum())[:, None] * prior_ratio(nodes, priors)


def prior_ratio(slowness: FloatArray, priors: Priors) -> FloatArray:
    """Ratio of the prior that is Gaussian in v = 1/u to the one that is Gaussian in u.

    Parameters
    ----------
    slowness : ndarray
        u, s per solar radius; any shape.
    priors : Priors

    Returns
    -------
    ndarray
        The shape of `slowness`; all but 0 where u is not positive.
    """
    positive = slowness > 0
    u = np.where(positive, slowness, 1.0)
    v_deviation = (1 / (u * C_RSUN_S) - 1) / priors.v_sd_c
    u_deviation = (u - priors.slowness_mean) / priors.slowness_sd
    jacobian = priors.slowness_sd / (priors.v_sd_c * C_RSUN_S * u**2)
    exponent = np.minimum(0.5 * (u_deviation**2 - v_deviation**2), LARGEST_LOG_RATIO)
    return np.where(positive, jacobian * np.exp(exponent), SMALLEST_RATIO)


def log_constant(problems: Problems) -> FloatArray:
    """What turns the integral of exp(`Local.log_density`) over x into the evidence, shape (B,), as a logarithm."""
    heard = problems.weights > 0
    priors = problems.priors
    log_weights = np.log(problems.weights, where=heard, out=np.zeros_like(problems.weights)).sum(axis=0)
    return np.asarray(
        -0.5 * (heard.sum(axis=0) - 1) * np.log(2 * np.pi)
        + 0.5 * (log_weights - np.log(problems.total_weight))
        - np.log(2 * priors.emission_half_width_s)
        - 0.5 * problems.dimensions * np.log(2 * np.pi * priors.tau_rsun**2)
    )

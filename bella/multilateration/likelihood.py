r"""Density of the source position with emission time and propagation speed integrated out.

A source at x that emits at time t0 is heard by receiver i, at s_i, at t0 + u d_i, where d_i = \|x - s_i\| and u = 1/v.
Arrival times y_i have Gaussian errors with weights w_i = 1/sigma_i^2 (the model of Canizares et al. 2024, A&A, in
solar radii and seconds). The emission time has a flat prior and u a Gaussian one, N(u0, su), so both integrals are
closed. With weighted means taken off (d~, y~), r~ = y~ - u0 d~ and

    A = sum w d~^2,   B = sum w d~ r~,   R = sum w r~^2,   P = A + 1/su^2,   W = sum w :

    log p(x | y) = -(R - B^2/P)/2 - log(P su^2)/2 - |x|^2/(2 tau^2) + const,
    u | x  ~  N(u0 + B/P, 1/P),        t0 | x, u  ~  N(y-bar - u d-bar, 1/W).

A known delay is taken off the arrival time; its uncertainty and the offset of a receiver are Gaussian, so at one
frequency they only widen sigma_i. Noise with bad arrival times is a mixture of such Gaussian models, one for each set
of bad ones: its components k stand beside one another on the first axis. The prior of the speed is Gaussian in v, not
in u; :mod:`bella.multilateration.speed` corrects for that.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bella.arrivals import ArrivalGrid
from bella.multilateration.priors import Noise, Priors
from bella.units import FloatArray

IntArray = npt.NDArray[np.intp]

GAUSSIAN = Noise()


@dataclass(frozen=True)
class Problems:
    """Independent localisation problems, one per frequency.

    The last axis, of length B, is that of the problems; :meth:`at` and :meth:`spread` give it the shape S of points.

    Attributes
    ----------
    receivers : ndarray, shape (3, n, B)
        Coordinates of the receivers, solar radii; 0 where a receiver is missing.
    delays : ndarray, shape (K, n, B)
        Arrival times less their weighted mean, s; 0 where missing.
    weights : ndarray, shape (K, n, B)
        1/variance, s^-2; 0 where missing.
    total_weight, mean_arrival_s : ndarray, shape (K, B)
    log_norm : ndarray, shape (K, B)
        What the errors add to the log density, with the prior probability of the component.
    bad : ndarray of bool, shape (K, n)
        Which arrival times are bad in each component of the noise.
    priors : Priors
    dimensions : int
        2: the source is in the ecliptic plane; the receivers never are made to be.
    """

    receivers: FloatArray
    delays: FloatArray
    weights: FloatArray
    total_weight: FloatArray
    mean_arrival_s: FloatArray
    log_norm: FloatArray
    bad: npt.NDArray[np.bool_]
    priors: Priors
    dimensions: int

    @property
    def count(self) -> int:
        """Number of problems B."""
        return int(self.total_weight.shape[-1])

    @property
    def components(self) -> int:
        """Number of components K of the noise."""
        return int(self.total_weight.shape[0])

    def at(self, owner: slice | IntArray) -> "Problems":
        """The problem of each point; a single problem is left as it is, since it broadcasts."""
        if self.count == 1:
            return self
        return replace(self, **{name: getattr(self, name)[..., owner] for name in PER_PROBLEM})

    def spread(self) -> "Problems":
        """The problems with one more axis, along which each may have many points."""
        return replace(self, **{name: getattr(self, name)[..., None] for name in PER_PROBLEM})

    def component(self, chosen: IntArray) -> "Problems":
        """One component of the noise for each point of each problem: shape (B, N) to S = (B, N), K = 1."""
        if self.components == 1:
            return self.spread()
        row = np.arange(self.count)[:, None]
        gathered = {name: np.moveaxis(getattr(self, name), -1, 1)[chosen, row] for name in PER_COMPONENT}
        first = {name: np.moveaxis(values, -1, 0) if values.ndim > 2 else values for name, values in gathered.items()}
        return replace(
            self, receivers=self.receivers[..., None], **{name: values[None] for name, values in first.items()}
        )


PER_COMPONENT = ("delays", "weights", "total_weight", "mean_arrival_s", "log_norm")
PER_PROBLEM = ("receivers", *PER_COMPONENT)


@dataclass(frozen=True)
class Local:
    """The integrals at points x; every array has shape (K, *S), one value per component of the noise and point.

    Attributes
    ----------
    log_density : ndarray
        log p(x, k | y) up to a constant of the problem, for the prior that is Gaussian in u.
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


def problems_of(grid: ArrivalGrid, priors: Priors, dimensions: int, noise: Noise = GAUSSIAN) -> Problems:
    """Localisation problems of the frequencies of a grid.

    Parameters
    ----------
    grid : ArrivalGrid
    priors : Priors
    dimensions : int
    noise : Noise

    Returns
    -------
    Problems
    """
    present = np.isfinite(grid.arrival_s).T
    bad = noise.bad_sets(present.shape[0])
    stated = (grid.sigma_s**2 + grid.delay_sd_s**2 + grid.offset_sd_s**2).T
    weights = np.where(present, 1 / (stated + bad[:, :, None] * noise.bad_sd_s**2), 0.0)
    arrivals = np.where(present, (grid.arrival_s - grid.delay_s).T, 0.0)
    total = weights.sum(axis=1)
    mean = (weights * arrivals).sum(axis=1) / total
    log_weights = np.log(weights, where=present, out=np.zeros_like(weights)).sum(axis=1)
    return Problems(
        receivers=np.ascontiguousarray(np.where(present, grid.receiver_rsun.T, 0.0)),
        delays=np.where(present, arrivals - mean[:, None], 0.0),
        weights=weights,
        total_weight=total,
        mean_arrival_s=mean,
        log_norm=0.5 * (log_weights - np.log(total)) + _log_prior_of_components(bad, present, noise.bad_probability),
        bad=bad,
        priors=priors,
        dimensions=dimensions,
    )


def _log_prior_of_components(
    bad: npt.NDArray[np.bool_], present: npt.NDArray[np.bool_], bad_probability: float
) -> FloatArray:
    """Shape (K, B); a component with a bad arrival that is not there has no probability."""
    if len(bad) == 1:
        return np.zeros((1, present.shape[1]))
    number = bad.sum(axis=1)[:, None]
    heard = present.sum(axis=0)
    log_prior = number * np.log(bad_probability) + (heard - number) * np.log1p(-bad_probability)
    possible = ~(bad[:, :, None] & ~present).any(axis=1)
    log_prior = np.where(possible, log_prior, -np.inf)
    return np.asarray(log_prior - np.logaddexp.reduce(log_prior, axis=0))


def evaluate(problems: Problems, points: FloatArray) -> Local:
    """Integrals at many points, each belonging to one of the problems.

    Parameters
    ----------
    problems : Problems
        With the trailing shape S of the points, or one that broadcasts against it.
    points : ndarray, shape (D, *S)
        Coordinates by row, solar radii.

    Returns
    -------
    Local
    """
    u0, su = problems.priors.slowness_mean, problems.priors.slowness_sd
    distances, _ = _distances(problems, points)
    weights = problems.weights
    mean_distance = _over_receivers(weights, distances) / problems.total_weight
    excess = distances - mean_distance[:, None]
    residual = problems.delays - u0 * excess
    weighted = weights * excess
    A, B = _over_receivers(weighted, excess), _over_receivers(weighted, residual)
    R = _over_receivers(weights * residual, residual)
    P = A + su**-2
    misfit = R - B**2 / P
    prior = _squared(points) / problems.priors.tau_rsun**2
    return Local(
        log_density=problems.log_norm - 0.5 * (misfit + np.log(P * su**2) + prior),
        misfit=misfit,
        slowness=u0 + B / P,
        slowness_sd=1 / np.sqrt(P),
        mean_distance=mean_distance,
    )


def _over_receivers(one: FloatArray, other: FloatArray) -> FloatArray:
    """Sum of products over the axis of the receivers, the last but those of the points."""
    return np.asarray((one * other).sum(axis=1))


def _squared(points: FloatArray) -> FloatArray:
    return np.asarray(sum(axis**2 for axis in points))


def sharpness(problems: Problems, points: FloatArray) -> FloatArray:
    """Root of the trace of the information on x that the data (emission time free) and the prior carry.

    Parameters
    ----------
    problems : Problems
        With the trailing shape S of the points, or one that broadcasts against it.
    points : ndarray, shape (D, *S)
        Solar radii.

    Returns
    -------
    ndarray, shape S
        1/solar radius. That of the component without bad arrivals, which has the most.
    """
    distances, offsets = _distances(problems, points)
    total = problems.total_weight[0]
    share = problems.weights[0] / total / np.maximum(distances, 1e-9)
    squared_mean_direction = sum((share * offset).sum(axis=0) ** 2 for offset in offsets)
    data = problems.priors.slowness_mean**2 * total * np.maximum(1 - squared_mean_direction, 0)
    return np.asarray(np.sqrt(data + problems.priors.tau_rsun**-2))


def _distances(problems: Problems, points: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
    """Distance to each receiver, shape (n, *S), and the offsets from it along each axis of the source."""
    offsets = [points[axis] - problems.receivers[axis] for axis in range(problems.dimensions)]
    squared = sum(offset**2 for offset in offsets)
    for axis in range(problems.dimensions, 3):
        squared = squared + problems.receivers[axis] ** 2
    return np.asarray(np.sqrt(squared)), offsets


def log_constant(problems: Problems) -> FloatArray:
    """What turns the integral of exp(`Local.log_density`) over x into the evidence, shape (B,), as a logarithm."""
    heard = (problems.weights[0] > 0).sum(axis=0)
    priors = problems.priors
    return np.asarray(
        -0.5 * (heard - 1) * np.log(2 * np.pi)
        - np.log(2 * priors.emission_half_width_s)
        - 0.5 * problems.dimensions * np.log(2 * np.pi * priors.tau_rsun**2)
    )

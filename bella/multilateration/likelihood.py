r"""Density of the source position with emission time, propagation speed and directional delay integrated out.

What a source at x emits at time t0 is at receiver i, at s_i, at t0 + u d_i + kappa c_i. Here d_i = \|x - s_i\| is the
distance, u = 1/v the slowness (the model of Canizares et al. 2024, A&A, in solar radii and seconds), and c_i =
rise_i (1 - cos_i) the directional delay of :mod:`bella.heliosphere.scattering`. The errors of the arrival times y are
Gaussian with a covariance C between the receivers, which holds every term of the noise model of a table. The emission
time has a flat prior, u and kappa have Gaussian ones, N(u0, su) and N(k0, sk), so that all three integrals are closed:
a flat emission time leaves the n - 1 differences of arrival times, whose covariance D C D^T has the Cholesky factor L.
With T = L^-1 D and

    r = T (y - u0 d - k0 c),   M = (su T d, sk T c),   G = 1 + M^T M,   b = M^T r,

    log p(x | y) = -(r^T r - b^T G^-1 b)/2 - log det(G)/2 - log det(L) + log prior(x) + const,
    ((u - u0)/su, (kappa - k0)/sk) | x  ~  N(G^-1 b, G^-1),
    t0 | x, u, kappa  ~  N(a^T (y - u d - kappa c), 1/W),   a = C^-1 1 / W,   W = 1^T C^-1 1.

A known delay is taken off the arrival time. Noise with bad arrival times is a mixture of such Gaussian models, one for
each set of bad ones: its components k stand beside one another on the first axis. The prior of the speed is Gaussian in
v, not in u; :mod:`bella.multilateration.speed` corrects for that.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from bella.multilateration.problems import IntArray, Problems
from bella.units import FloatArray

NEAREST_RSUN = 1e-9
"""Distances are kept above this: a source on the Sun or on a receiver has no direction from it."""
NEAR_RSUN = 10.0
"""Closer to the Sun or to a receiver, where directions turn within a cell, the sharpness is that at this distance:
cells are not made finer there."""
LEAST_MISFIT = 1e-12
"""The slope of the root of the misfit is taken for no less: at 0 it has none."""
RANGE_SD = 4.0
"""Slowness and kappa are looked for within this many prior standard deviations of their means."""


@dataclass(frozen=True)
class Local:
    """The integrals at points x; every array has shape (K, *S), one value per component of the noise and point.

    Attributes
    ----------
    log_density : ndarray
        log p(x, k | y) up to a constant of the problem, for the prior that is Gaussian in u.
    misfit : ndarray
        r^T r - b^T G^-1 b: the smallest weighted sum of squares over emission time, slowness and kappa.
    log_det : ndarray
        log det G.
    slowness, slowness_sd : ndarray
        Mean and standard deviation of u | x, s per solar radius.
    kappa, kappa_slope, kappa_sd : ndarray
        Mean of kappa | x, its change with u, and its standard deviation once u is known.
    mean_distance, mean_delay_s : ndarray
        a^T d, solar radii, and a^T c, s.
    """

    log_density: FloatArray
    misfit: FloatArray
    log_det: FloatArray
    slowness: FloatArray
    slowness_sd: FloatArray
    kappa: FloatArray
    kappa_slope: FloatArray
    kappa_sd: FloatArray
    mean_distance: FloatArray
    mean_delay_s: FloatArray

    def kappa_given(self, slowness: FloatArray) -> FloatArray:
        """Mean of kappa once the slowness is known as well."""
        return np.asarray(self.kappa + self.kappa_slope * (slowness - self.slowness))


@dataclass(frozen=True)
class _Integrals:
    """Elements of G, b and r^T r of the module's equations, each of shape (K, *S); 1 and 0 for what is not free.

    `residual`, and the columns `travel` and `late` of M, have shape (K, n - 1, *S).
    """

    residual: FloatArray
    travel: FloatArray
    late: FloatArray | None
    uu: FloatArray
    kk: Any
    uk: Any
    u: FloatArray
    k: Any

    @cached_property
    def determinant(self) -> FloatArray:
        """Of G."""
        return np.asarray(self.uu * self.kk - self.uk * self.uk)

    @property
    def moved_u(self) -> FloatArray:
        """Best slowness, in prior standard deviations from the mean of its prior."""
        return np.asarray((self.kk * self.u - self.uk * self.k) / self.determinant)

    @property
    def moved_k(self) -> FloatArray:
        """Best kappa, likewise."""
        return np.asarray((self.uu * self.k - self.uk * self.u) / self.determinant)

    def freed(self, white: FloatArray) -> FloatArray:
        """Whitened differences v with slowness and kappa integrated out, (1 + M M^T)^-1 v, of the same shape."""
        along_u = _product(self.travel, white)
        if self.late is None:
            return white - self.travel * (along_u / self.uu)[:, None]
        along_k = _product(self.late, white)
        by_u = (self.kk * along_u - self.uk * along_k) / self.determinant
        by_k = (self.uu * along_k - self.uk * along_u) / self.determinant
        return np.asarray(white - self.travel * by_u[:, None] - self.late * by_k[:, None])


def _integrals(problems: Problems, distance: FloatArray, late: FloatArray | None) -> _Integrals:
    priors, delay = problems.priors, problems.delay
    travel = _whitened(problems, distance)
    residual = problems.differences - priors.slowness_mean * travel
    travel *= priors.slowness_sd
    if late is None:
        uu, u = 1 + _product(travel, travel), _product(travel, residual)
        return _Integrals(residual, travel, None, uu, kk=1.0, uk=0.0, u=u, k=0.0)
    scattered = _whitened(problems, late)
    residual -= delay.kappa * scattered
    scattered *= delay.kappa_sd
    return _Integrals(
        residual=residual,
        travel=travel,
        late=scattered,
        uu=1 + _product(travel, travel),
        kk=1 + _product(scattered, scattered),
        uk=_product(travel, scattered),
        u=_product(travel, residual),
        k=_product(scattered, residual),
    )


def _whitened(problems: Problems, values: FloatArray) -> FloatArray:
    """T v, shape (K, n - 1, *S)."""
    return _summed(problems.whitening.swapaxes(1, 2), values)


def _summed(weight: FloatArray, values: FloatArray) -> FloatArray:
    """Sum of weights (K, n, *R, *S) times values (n, *S) over the receivers, shape (K, *R, *S)."""
    total = weight[:, 0] * values[0]
    for receiver in range(1, len(values)):
        total += weight[:, receiver] * values[receiver]
    return np.asarray(total)


def _product(one: FloatArray, other: FloatArray) -> FloatArray:
    """Sum of products over the differences."""
    total = one[:, 0] * other[:, 0]
    for row in range(1, one.shape[1]):
        total += one[:, row] * other[:, row]
    return np.asarray(total)


def density(problems: Problems, points: FloatArray) -> FloatArray:
    """Log density of :class:`Local` alone, in half of the time.

    Parameters
    ----------
    points : ndarray, shape (D, *S)
        Solar radii.

    Returns
    -------
    ndarray, shape (K, *S)
    """
    distance, late = paths(problems, points)
    return _density(problems, points, _integrals(problems, distance, late))[0]


def _density(problems: Problems, points: FloatArray, g: _Integrals) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log density, misfit and log det G."""
    determinant = g.determinant
    explained = (g.kk * g.u * g.u - 2 * g.uk * g.u * g.k + g.uu * g.k * g.k) / determinant
    misfit = _product(g.residual, g.residual) - explained
    log_det = np.log(determinant)
    prior = problems.priors.log_position(_squared(points))
    return problems.log_norm - 0.5 * (misfit + log_det) + prior, misfit, log_det


def mixed(log_density: FloatArray) -> FloatArray:
    """Logarithm of the sum over the components of the noise: (K, *S) to S."""
    return log_density[0] if len(log_density) == 1 else np.asarray(np.logaddexp.reduce(log_density, axis=0))


def evaluate(problems: Problems, points: FloatArray) -> Local:
    """Integrals at many points, each belonging to one of the problems.

    Parameters
    ----------
    problems : Problems
        With the trailing shape S of the points, or one that broadcasts against it.
    points : ndarray, shape (D, *S)
        Coordinates by row, solar radii.
    """
    priors, delay = problems.priors, problems.delay
    distance, late = paths(problems, points)
    g = _integrals(problems, distance, late)
    log_density, misfit, log_det = _density(problems, points, g)
    nothing = np.zeros_like(misfit)
    return Local(
        log_density=log_density,
        misfit=misfit,
        log_det=log_det,
        slowness=priors.slowness_mean + priors.slowness_sd * g.moved_u,
        slowness_sd=priors.slowness_sd * np.sqrt(g.kk / g.determinant),
        kappa=delay.kappa + delay.kappa_sd * g.moved_k,
        kappa_slope=nothing - delay.kappa_sd / priors.slowness_sd * g.uk / g.kk,
        kappa_sd=nothing + delay.kappa_sd / np.sqrt(g.kk),
        mean_distance=_summed(problems.mean_weight, distance),
        mean_delay_s=nothing if late is None else _summed(problems.mean_weight, late),
    )


def paths(problems: Problems, points: FloatArray) -> tuple[FloatArray, FloatArray | None]:
    """Distance from each receiver, solar radii, and delay of each for a kappa of one, s.

    Parameters
    ----------
    points : ndarray, shape (D, *S)
        Solar radii.

    Returns
    -------
    distance : ndarray, shape (n, *S)
    late : ndarray, shape (n, *S), or None
        None where the model has no directional delay.
    """
    dot = points[0] * problems.receivers[0]
    for axis in range(1, problems.dimensions):
        dot += points[axis] * problems.receivers[axis]
    from_sun = _squared(points)
    distance = np.sqrt(np.maximum(problems.receiver_rsun2 + from_sun - 2 * dot, NEAREST_RSUN**2))
    if not problems.delay.is_free:
        return distance, None
    cosine = (dot - from_sun) / (np.maximum(np.sqrt(from_sun), NEAREST_RSUN) * distance)
    return distance, np.asarray(problems.rise_s * (1 - cosine))


def _squared(points: FloatArray) -> FloatArray:
    return np.asarray(sum(axis**2 for axis in points))


@dataclass(frozen=True)
class Survey:
    """What the division of space asks of points.

    Attributes
    ----------
    log_density, misfit, log_det : ndarray, shape (K, *S)
        As in :class:`Local`.
    distance : ndarray, shape (n, *S)
        From each receiver, solar radii.
    root_slope : ndarray, shape (D, K, *S)
        Change of the root of the misfit along each of the axes there, nuisances marginalised, 1/solar radius.
    sharpness : ndarray, shape (D, *S)
        Root of the information that the data carry on each coordinate alone, nuisances marginalised, 1/solar radius,
        along the axes there, for the likeliest component of the noise: the most that the slope can be.
    """

    log_density: FloatArray
    misfit: FloatArray
    log_det: FloatArray
    distance: FloatArray
    root_slope: FloatArray
    sharpness: FloatArray


def survey(problems: Problems, points: FloatArray, lean: FloatArray | None) -> Survey:
    """Density at many points, and how fast it changes.

    Parameters
    ----------
    problems : Problems
        With the trailing shape S of the points, or one that broadcasts against it.
    points : ndarray, shape (D, *S)
        Solar radii.
    lean : ndarray, shape (*S), or None
        Step along the first axis that goes with one along the second, where axes are bent.
    """
    distance, late = paths(problems, points)
    g = _integrals(problems, distance, late)
    log_density, misfit, log_det = _density(problems, points, g)
    likeliest = _likeliest(log_density)
    slopes = _slopes(problems, points, distance, late, _of(likeliest, g.moved_k))
    if lean is not None:
        slopes[1] = slopes[1] + lean * slopes[0]
    root = np.sqrt(np.maximum(misfit, LEAST_MISFIT))
    root_slope, information = [], []
    for slope in slopes:
        white = _whitened(problems, slope)
        freed = g.freed(white)
        root_slope.append(-_product(freed, g.residual) / root)
        information.append(_of(likeliest, _product(freed, white)))
    sharpness = np.sqrt(np.maximum(np.stack(information), 0))
    return Survey(log_density, misfit, log_det, distance, np.stack(root_slope), sharpness)


def slope_and_information(problems: Problems, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gradient of the log density, and the Fisher information that the data carry on the position.

    Both for a change of log det G that is left out. Of errors that are independent, with a flat emission time and no
    directional delay, the information is that of Canizares et al. (2024) with emission time and speed eliminated by
    their Schur complement.

    Parameters
    ----------
    problems : Problems
        With the trailing shape S of the points, or one that broadcasts against it.
    points : ndarray, shape (D, *S)
        Solar radii.

    Returns
    -------
    slope : ndarray, shape (D, K, *S)
        1/solar radius.
    information : ndarray, shape (D, D, K, *S)
        1/square solar radius.
    """
    distance, late = paths(problems, points)
    g = _integrals(problems, distance, late)
    likeliest = _likeliest(_density(problems, points, g)[0])
    slopes = _slopes(problems, points, distance, late, _of(likeliest, g.moved_k))
    white = [_whitened(problems, slope) for slope in slopes]
    freed = [g.freed(one) for one in white]
    prior = problems.priors.position_slope(_squared(points))
    slope = np.stack([_product(one, g.residual) + prior * axis for one, axis in zip(freed, points, strict=True)])
    return slope, np.stack([np.stack([_product(one, other) for other in white]) for one in freed])


def _likeliest(log_density: FloatArray) -> IntArray:
    """Component of the noise with the highest density, shape (1, *S), or (1,) where there is only one."""
    return log_density.argmax(axis=0)[None] if len(log_density) > 1 else np.zeros(1, dtype=np.intp)


def _of(component: IntArray, values: Any) -> FloatArray:
    """Value of one component of the noise for each point, shape (*S)."""
    return np.asarray(values[0] if len(values) == 1 else np.take_along_axis(values, component, axis=0)[0])


def _slopes(
    problems: Problems, points: FloatArray, distance: FloatArray, late: FloatArray | None, moved: FloatArray
) -> list[FloatArray]:
    """Change of the arrival time at each receiver with each coordinate of the source, shape (n, *S).

    For a kappa that has moved by some standard deviations from the mean of its prior.
    """
    near = np.maximum(distance, NEAR_RSUN)
    u0 = problems.priors.slowness_mean
    if late is None:
        return [u0 * (points[axis] - problems.receivers[axis]) / near for axis in range(problems.dimensions)]
    kappa = problems.delay.kappa + problems.delay.kappa_sd * np.clip(moved, -RANGE_SD, RANGE_SD)
    radius = np.maximum(np.sqrt(_squared(points)), NEAR_RSUN)
    # 1 - cos changes as one direction turns towards the other: by the part of each across the other over its distance
    cosine = problems.rise_s - late
    along_receiver = (u0 + kappa * (problems.rise_s / radius + cosine / near)) / near
    along_source = kappa * (problems.rise_s / near + cosine / radius) / radius
    return [
        along_receiver * (points[axis] - problems.receivers[axis]) + along_source * points[axis]
        for axis in range(problems.dimensions)
    ]

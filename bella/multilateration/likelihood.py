r"""Density of the source position with emission time, propagation speed and directional delay integrated out.

A source at x that emits at time t0 is heard by receiver i, at s_i, at t0 + u d_i + kappa c_i. Here d_i = \|x - s_i\| is
the distance, u = 1/v the slowness (the model of Canizares et al. 2024, A&A, in solar radii and seconds), and c_i =
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

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import numpy as np
import numpy.typing as npt

from bella.arrivals import ArrivalGrid
from bella.exceptions import InputError
from bella.heliosphere.scattering import NO_DELAY, DirectionalDelay
from bella.multilateration.priors import Noise, Priors
from bella.units import FloatArray

IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]

GAUSSIAN = Noise()
NEAREST_RSUN = 1e-9
"""Distances are kept above this: a source on the Sun or on a receiver has no direction from it."""
NEAR_RSUN = 10.0
"""Closer to the Sun or to a receiver, where directions turn within a cell, the sharpness is that at this distance:
cells are not made finer there."""
RANGE_SD = 4.0
"""Slowness and kappa are looked for within this many prior standard deviations of their means."""
ALONE, BLOCK = 500, 8_000
"""Points of a problem from which on they are treated alone, and most points treated at once: fastest as measured."""
MOST_SIGNS = 8
"""Receivers up to which every combination of signs is tried for the largest change of the residuals."""


@dataclass(frozen=True)
class Problems:
    """Independent localisation problems, one per frequency.

    The last axis, of length B, is that of the problems; :meth:`at` and :meth:`spread` give it the shape S of points.

    Attributes
    ----------
    receivers : ndarray, shape (3, n, B)
        Coordinates of the receivers, solar radii; 0 where a receiver is missing.
    rise_s : ndarray, shape (n, B)
        Half width of the rise, s; 0 where missing.
    whitening : ndarray, shape (K, n - 1, n, B)
        T: from arrival times to independent differences of unit variance; 0 for receivers that are missing.
    differences : ndarray, shape (K, n - 1, B)
        T y.
    mean_weight : ndarray, shape (K, n, B)
        a: the weights, which add up to one, of the best mean of the arrival times.
    total_weight, mean_arrival_s : ndarray, shape (K, B)
        W, s^-2, and a^T y, s.
    log_norm : ndarray, shape (K, B)
        What the errors add to the log density, with the prior probability of the component.
    steepest : ndarray, shape (K, B)
        Largest length of T v for any v whose elements lie within -1 and 1, s^-1.
    bad : ndarray of bool, shape (K, n)
        Which arrival times are bad in each component of the noise.
    priors : Priors
    delay : DirectionalDelay
    dimensions : int
        2: the source is in the ecliptic plane; the receivers never are made to be.
    """

    receivers: FloatArray
    rise_s: FloatArray
    whitening: FloatArray
    differences: FloatArray
    mean_weight: FloatArray
    total_weight: FloatArray
    mean_arrival_s: FloatArray
    log_norm: FloatArray
    steepest: FloatArray
    bad: BoolArray
    priors: Priors
    delay: DirectionalDelay
    dimensions: int

    @property
    def count(self) -> int:
        """Number of problems B."""
        return int(self.total_weight.shape[-1])

    @property
    def components(self) -> int:
        """Number of components K of the noise."""
        return int(self.total_weight.shape[0])

    @property
    def heard(self) -> FloatArray:
        """Number of receivers of each problem, shape (B,)."""
        return np.asarray((self.mean_weight[0] != 0).sum(axis=0))

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
        of_points = {name: np.moveaxis(values, (0, 1), (-2, -1))[None] for name, values in gathered.items()}
        return replace(self, receivers=self.receivers[..., None], rise_s=self.rise_s[..., None], **of_points)


PER_COMPONENT = (
    "whitening",
    "differences",
    "mean_weight",
    "total_weight",
    "mean_arrival_s",
    "log_norm",
    "steepest",
)
PER_PROBLEM = ("receivers", "rise_s", *PER_COMPONENT)


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


def problems_of(
    grid: ArrivalGrid, priors: Priors, dimensions: int, noise: Noise = GAUSSIAN, delay: DirectionalDelay = NO_DELAY
) -> Problems:
    """Localisation problems of the frequencies of a grid.

    Parameters
    ----------
    grid : ArrivalGrid
    priors : Priors
    dimensions : int
    noise : Noise
    delay : DirectionalDelay

    Returns
    -------
    Problems

    Raises
    ------
    InputError
        If the errors of the arrival times of a frequency have no positive definite covariance.
    """
    present = np.isfinite(grid.arrival_s)
    bad = noise.bad_sets(present.shape[1])
    arrival = np.where(present, grid.arrival_s - grid.delay_s, 0.0)
    white = whiten(
        grid.covariances_s2(), np.asarray(bad[:, None, :] * noise.bad_sd_s**2, dtype=np.float64), grid.frequency_mhz
    )
    first = np.take_along_axis(np.broadcast_to(arrival, white.mean_weight.shape), white.reference[..., None], axis=2)
    late = np.where(present, arrival - first, 0.0)
    log_prior = _log_prior_of_components(bad, present.T, noise.bad_probability)

    def _problems_last(values: FloatArray) -> FloatArray:
        return np.ascontiguousarray(np.moveaxis(values, 1, -1))

    return Problems(
        receivers=np.ascontiguousarray(np.where(present.T, grid.receiver_rsun.T, 0.0)),
        rise_s=np.ascontiguousarray(np.where(present, grid.rise_s, 0.0).T),
        whitening=_problems_last(white.whitening),
        differences=_problems_last((white.whitening @ late[..., None])[..., 0]),
        mean_weight=_problems_last(white.mean_weight),
        total_weight=white.total_weight,
        mean_arrival_s=(white.mean_weight * late).sum(axis=2) + first[..., 0],
        log_norm=white.log_norm + log_prior,
        steepest=_steepest(white.whitening),
        bad=bad,
        priors=priors,
        delay=delay,
        dimensions=dimensions,
    )


@dataclass(frozen=True)
class Whitened:
    """Covariance of the arrival times of B problems with K components, in the form that the density takes.

    Attributes
    ----------
    whitening : ndarray, shape (K, B, n - 1, n)
    mean_weight : ndarray, shape (K, B, n)
    total_weight, log_norm : ndarray, shape (K, B)
        W, and -log det L.
    reference : ndarray of int, shape (K, B)
        Receiver from which the differences are taken: that with the smallest error, so that none cancels.
    """

    whitening: FloatArray
    mean_weight: FloatArray
    total_weight: FloatArray
    log_norm: FloatArray
    reference: IntArray


def whiten(covariance_s2: FloatArray, extra_s2: FloatArray, frequency_mhz: FloatArray) -> Whitened:
    """Independent differences of arrival times with a covariance.

    Parameters
    ----------
    covariance_s2 : ndarray, shape (B, n, n)
        s^2; NaN in the rows and columns of receivers that are missing.
    extra_s2 : ndarray, shape (K, 1, n)
        Variance that is added in each component of the noise, s^2.
    frequency_mhz : ndarray, shape (B,)
        Named in the error.

    Returns
    -------
    Whitened

    Raises
    ------
    InputError
        If a covariance is not positive definite.
    """
    number = covariance_s2.shape[1]
    identity = np.eye(number)
    present = np.isfinite(np.einsum("bii->bi", covariance_s2))
    stated = np.where(present[:, :, None] & present[:, None, :], covariance_s2, identity)
    whole = stated + (extra_s2 * present)[..., None] * identity
    order = np.argsort(np.where(present, np.einsum("kbii->kbi", whole), np.inf), axis=2, kind="stable")
    others, reference = order[..., 1:], order[..., 0]
    heard = present[np.arange(len(present))[:, None], others]
    difference = np.where(heard[..., None], identity[others] - identity[reference][:, :, None, :], 0.0)
    between = difference @ whole @ difference.swapaxes(-1, -2) + np.where(heard, 0.0, 1.0)[..., None] * identity[1:, 1:]
    try:
        root = np.linalg.cholesky(between)
        solved = np.linalg.solve(whole, np.broadcast_to(present, whole.shape[:-1])[..., None].astype(np.float64))[
            ..., 0
        ]
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"the covariance of the arrival times at {frequency_mhz[0]:g} to {frequency_mhz[-1]:g} MHz is not that of "
            "errors; every eigenvalue must be above 0"
        ) from error
    total = solved.sum(axis=2)
    return Whitened(
        whitening=np.linalg.solve(root, difference),
        mean_weight=solved / total[..., None],
        total_weight=total,
        log_norm=-np.log(np.einsum("kbii->kbi", root)).sum(axis=2),
        reference=reference,
    )


def _steepest(whitening: FloatArray) -> FloatArray:
    """A convex function is largest at a corner of its cube; of many receivers the sum of all lengths is taken."""
    number = whitening.shape[-1]
    if number > MOST_SIGNS:
        return np.asarray(np.sqrt((whitening**2).sum(axis=-2)).sum(axis=-1))
    corners = np.array([(1.0, *signs) for signs in product((-1.0, 1.0), repeat=number - 1)])
    return np.asarray(np.sqrt(((whitening @ corners.T) ** 2).sum(axis=-2).max(axis=-1)))


def _log_prior_of_components(bad: BoolArray, present: BoolArray, bad_probability: float) -> FloatArray:
    """Shape (K, B); a component with a bad arrival that is not there has no probability."""
    if len(bad) == 1:
        return np.zeros((1, present.shape[1]))
    number = bad.sum(axis=1)[:, None]
    heard = present.sum(axis=0)
    log_prior = number * np.log(bad_probability) + (heard - number) * np.log1p(-bad_probability)
    possible = ~(bad[:, :, None] & ~present).any(axis=1)
    log_prior = np.where(possible, log_prior, -np.inf)
    return np.asarray(log_prior - np.logaddexp.reduce(log_prior, axis=0))


@dataclass(frozen=True)
class _Integrals:
    """Elements of G, b and r^T r of the module's equations, each of shape (K, *S); 1 and 0 for what is not free.

    `travel` and `late`, the columns of M, have shape (K, n - 1, *S).
    """

    travel: FloatArray
    late: FloatArray | None
    uu: FloatArray
    kk: Any
    uk: Any
    u: FloatArray
    k: Any
    square: FloatArray

    @property
    def determinant(self) -> FloatArray:
        """Of G."""
        return np.asarray(self.uu * self.kk - self.uk * self.uk)


def _integrals(problems: Problems, distance: FloatArray, late: FloatArray | None) -> _Integrals:
    priors, delay = problems.priors, problems.delay
    travel = _whitened(problems, distance)
    residual = problems.differences - priors.slowness_mean * travel
    travel *= priors.slowness_sd
    if late is None:
        whole, along = _product(residual, residual), _product(travel, residual)
        return _Integrals(travel, None, 1 + _product(travel, travel), 1.0, 0.0, along, 0.0, whole)
    scattered = _whitened(problems, late)
    residual -= delay.kappa * scattered
    scattered *= delay.kappa_sd
    return _Integrals(
        travel=travel,
        late=scattered,
        uu=1 + _product(travel, travel),
        kk=1 + _product(scattered, scattered),
        uk=_product(travel, scattered),
        u=_product(travel, residual),
        k=_product(scattered, residual),
        square=_product(residual, residual),
    )


def _whitened(problems: Problems, values: FloatArray) -> FloatArray:
    """T v, shape (K, n - 1, *S)."""
    total = problems.whitening[:, :, 0] * values[0]
    for receiver in range(1, len(values)):
        total += problems.whitening[:, :, receiver] * values[receiver]
    return np.asarray(total)


def _product(one: FloatArray, other: FloatArray) -> FloatArray:
    """Sum of products over the differences."""
    total = one[:, 0] * other[:, 0]
    for row in range(1, one.shape[1]):
        total += one[:, row] * other[:, row]
    return np.asarray(total)


def density(problems: Problems, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log density, misfit and log det G of :class:`Local` alone, in half of the time.

    Parameters
    ----------
    problems : Problems
    points : ndarray, shape (D, *S)
        Solar radii.

    Returns
    -------
    tuple of ndarray, each of shape (K, *S)
    """
    distance, late = paths(problems, points)
    return _density(problems, points, _integrals(problems, distance, late))


def _density(problems: Problems, points: FloatArray, g: _Integrals) -> tuple[FloatArray, FloatArray, FloatArray]:
    determinant = g.determinant
    misfit = g.square - (g.kk * g.u * g.u - 2 * g.uk * g.u * g.k + g.uu * g.k * g.k) / determinant
    log_det = np.log(determinant)
    prior = problems.priors.log_position(_squared(points))
    return problems.log_norm - 0.5 * (misfit + log_det) + prior, misfit, log_det


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
    priors, delay = problems.priors, problems.delay
    distance, late = paths(problems, points)
    g = _integrals(problems, distance, late)
    log_density, misfit, log_det = _density(problems, points, g)
    determinant, nothing = g.determinant, np.zeros_like(misfit)
    moved_k = (g.uu * g.k - g.uk * g.u) / determinant
    return Local(
        log_density=log_density,
        misfit=misfit,
        log_det=log_det,
        slowness=priors.slowness_mean + priors.slowness_sd * (g.kk * g.u - g.uk * g.k) / determinant,
        slowness_sd=priors.slowness_sd * np.sqrt(g.kk / determinant),
        kappa=delay.kappa + delay.kappa_sd * moved_k,
        kappa_slope=nothing - delay.kappa_sd / priors.slowness_sd * g.uk / g.kk,
        kappa_sd=nothing + delay.kappa_sd / np.sqrt(g.kk),
        mean_distance=(problems.mean_weight * distance).sum(axis=1),
        mean_delay_s=nothing if late is None else (problems.mean_weight * late).sum(axis=1),
    )


def paths(problems: Problems, points: FloatArray) -> tuple[FloatArray, FloatArray | None]:
    """Distance from each receiver, solar radii, and delay of each for a kappa of one, s.

    Parameters
    ----------
    problems : Problems
    points : ndarray, shape (D, *S)
        Solar radii.

    Returns
    -------
    distance : ndarray, shape (n, *S)
    late : ndarray, shape (n, *S), or None
        None where the model has no directional delay.
    """
    squared = sum((points[axis] - problems.receivers[axis]) ** 2 for axis in range(problems.dimensions))
    for axis in range(problems.dimensions, 3):
        squared = squared + problems.receivers[axis] ** 2
    distance = np.sqrt(squared)
    if not problems.delay.is_free:
        return np.asarray(distance), None
    # the law of cosines: twice (direction from the Sun) . (direction to the receiver) times both lengths
    from_sun = _squared(points)
    twice = (problems.receivers**2).sum(axis=0) - from_sun - squared
    lengths = np.maximum(np.sqrt(from_sun), NEAREST_RSUN) * np.maximum(distance, NEAREST_RSUN)
    return np.asarray(distance), np.asarray(problems.rise_s * (1 - 0.5 * twice / lengths))


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
    sharpness : ndarray, shape (*S)
        Root of the trace of the information on x that the data carry, nuisances marginalised, 1/solar radius, for
        the likeliest component of the noise.
    """

    log_density: FloatArray
    misfit: FloatArray
    log_det: FloatArray
    distance: FloatArray
    sharpness: FloatArray


def survey(problems: Problems, points: FloatArray) -> Survey:
    """Density at many points, and how fast it changes.

    Parameters
    ----------
    problems : Problems
        With the trailing shape S of the points, or one that broadcasts against it.
    points : ndarray, shape (D, *S)
        Solar radii.

    Returns
    -------
    Survey
    """
    distance, late = paths(problems, points)
    g = _integrals(problems, distance, late)
    log_density, misfit, log_det = _density(problems, points, g)
    likeliest = log_density.argmax(axis=0)[None]
    slopes = _slopes(problems, points, distance, late, _of(likeliest, (g.uu * g.k - g.uk * g.u) / g.determinant))
    information = _of(likeliest, _information(problems, g, slopes))
    return Survey(log_density, misfit, log_det, distance, np.sqrt(np.maximum(information, 0)))


def _of(component: IntArray, values: FloatArray) -> FloatArray:
    """Value of one component of the noise for each point, shape (*S)."""
    return values[0] if len(values) == 1 else np.asarray(np.take_along_axis(values, component, axis=0)[0])


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


def _information(problems: Problems, g: _Integrals, slopes: list[FloatArray]) -> FloatArray:
    """Trace of J^T (1 + M M^T)^-1 J for the whitened slopes J, shape (K, *S)."""
    whole = np.zeros(())
    for slope in slopes:
        white = _whitened(problems, slope)
        u = _product(g.travel, white)
        whole = whole + _product(white, white)
        if g.late is None:
            whole = whole - u * u / g.uu
        else:
            k = _product(g.late, white)
            whole = whole - (g.kk * u * u - 2 * g.uk * u * k + g.uu * k * k) / g.determinant
    return np.asarray(whole)


def blocks(owner: IntArray) -> Iterator[tuple[slice, slice | IntArray]]:
    """Points to be treated together, and the problem of each for :meth:`Problems.at`.

    Many points of one problem come alone, since nothing then has to be gathered for each, and in blocks that stay in
    the processor's cache.

    Parameters
    ----------
    owner : ndarray of int, shape (M,)
        Problem of each point, ascending.

    Yields
    ------
    slice, slice or ndarray of int
    """
    edges = [int(edge) for edge in np.flatnonzero(np.diff(owner, prepend=-1, append=-1))]
    first = 0
    for start, stop in pairwise(edges):
        if stop - start < ALONE and stop - first <= BLOCK:
            continue
        if start > first:
            yield slice(first, start), owner[first:start]
        first = start
        while stop - first >= ALONE:
            last = min(first + BLOCK, stop)
            yield slice(first, last), slice(int(owner[start]), int(owner[start]) + 1)
            first = last
    if first < owner.size:
        yield slice(first, owner.size), owner[first:]


def log_constant(problems: Problems) -> FloatArray:
    """What turns the integral of exp(`Local.log_density`) over x into the evidence, shape (B,), as a logarithm."""
    priors = problems.priors
    return np.asarray(
        -0.5 * (problems.heard - 1) * np.log(2 * np.pi)
        - np.log(2 * priors.emission_half_width_s)
        - priors.log_volume(problems.dimensions)
    )

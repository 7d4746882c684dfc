"""Localisation problems, one per frequency: arrival times and their covariance in the form that the density takes.

Arrival times enter as whitened differences, so that the emission time is gone and errors are independent: of a
covariance C the differences D y have the covariance D C D^T = L L^T, and T = L^-1 D. The best mean of the arrival times
has the weights a = C^-1 1 / W, W = 1^T C^-1 1 (:mod:`bella.multilateration.likelihood`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
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
BLOCK = 8_000
"""Most points treated at once: fastest as measured."""

MOST_SIGNS = 8
"""Receivers up to which every combination of signs is tried for the largest change of the residuals."""

PER_COMPONENT = (
    "whitening",
    "differences",
    "mean_weight",
    "total_weight",
    "mean_arrival_s",
    "log_norm",
    "steepest",
)
SHARED = ("receivers", "receiver_rsun2", "rise_s")
PER_PROBLEM = (*SHARED, *PER_COMPONENT)


@dataclass(frozen=True)
class Problems:
    """Independent localisation problems, one per frequency.

    The last axis, of length B, is that of the problems; :meth:`at` and :meth:`spread` give it the shape S of points.

    Attributes
    ----------
    receivers : ndarray, shape (D, n, B)
        Coordinates of the receivers along those of the source, solar radii; of another one where it is missing.
    receiver_rsun2 : ndarray, shape (n, B)
        Squared distances of the receivers from the Sun.
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
    dimensions : int
        2: the source is in the ecliptic plane; the receivers never are made to be.
    """

    receivers: FloatArray
    receiver_rsun2: FloatArray
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
    def received(self) -> FloatArray:
        """Number of receivers of each problem, shape (B,)."""
        return np.asarray((self.mean_weight[0] != 0).sum(axis=0))

    def at(self, owner: slice | IntArray) -> "Problems":
        """The problem of each point; a single problem is left as it is, since it broadcasts."""
        if self.count == 1:
            return self
        of_points: dict[str, Any] = {name: of_problem(getattr(self, name), owner) for name in PER_PROBLEM}
        return replace(self, **of_points)

    def turned(self, turn: FloatArray) -> "Problems":
        """The same in axes turned about the z axis: cosine and sine of an angle each, shape (2, B)."""
        (cosine, sine), (x, y) = turn, self.receivers[:2]
        across, ahead = cosine * x + sine * y, cosine * y - sine * x
        return replace(self, receivers=np.stack([across, ahead, *self.receivers[2:]]))

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
        shared = {name: getattr(self, name)[..., None] for name in SHARED}
        return replace(self, **shared, **of_points)


@dataclass(frozen=True)
class LateClocks:
    """That one of some receivers is late at all frequencies: one component of the noise for each of them.

    Attributes
    ----------
    late_s, late_sd_s : ndarray, shape (K, n)
        How late each receiver is in each component, and the standard deviation of that, s; 0 for those that are not.
    log_weight : ndarray, shape (K, B)
        Logarithm of the weight of each component at each frequency.
    """

    late_s: FloatArray
    late_sd_s: FloatArray
    log_weight: FloatArray


def problems_of(  # noqa: PLR0913, PLR0917
    grid: ArrivalGrid,
    priors: Priors,
    dimensions: int,
    noise: Noise = GAUSSIAN,
    delay: DirectionalDelay = NO_DELAY,
    clocks: LateClocks | None = None,
) -> Problems:
    """Localisation problems of the frequencies of a grid.

    Parameters
    ----------
    clocks : LateClocks, optional
        In place of `noise`.

    Raises
    ------
    InputError
        If the errors of the arrival times of a frequency have no positive definite covariance.
    """
    present = np.isfinite(grid.arrival_s)
    arrival = np.where(present, grid.arrival_s - grid.delay_s, 0.0)
    if clocks is None:
        bad = noise.bad_sets(present.shape[1])
        extra_s2 = bad * noise.bad_sd_s**2
        log_weight = _log_prior_of_components(bad, present.T, noise.bad_probability)
    else:
        bad, extra_s2 = np.zeros(clocks.late_s.shape, dtype=bool), clocks.late_sd_s**2
        log_weight, arrival = clocks.log_weight, np.where(present, arrival - clocks.late_s[:, None], 0.0)
    white = whiten(grid.covariances_s2(), np.asarray(extra_s2, dtype=np.float64)[:, None], grid.frequency_mhz)
    arrival = np.broadcast_to(arrival, white.mean_weight.shape)
    first = np.take_along_axis(arrival, white.reference[..., None], axis=2)
    late = np.where(present, arrival - first, 0.0)

    def _problems_last(values: FloatArray) -> FloatArray:
        return np.ascontiguousarray(np.moveaxis(values, 1, -1))

    one = np.take_along_axis(grid.receiver_rsun, white.reference[0, :, None, None], axis=1)
    receivers = np.ascontiguousarray(np.where(present.T, grid.receiver_rsun.T, one.T))
    return Problems(
        receivers=receivers[:dimensions],
        receiver_rsun2=(receivers**2).sum(axis=0),
        rise_s=np.ascontiguousarray(np.where(present, grid.rise_s, 0.0).T),
        whitening=_problems_last(white.whitening),
        differences=_problems_last((white.whitening @ late[..., None])[..., 0]),
        mean_weight=_problems_last(white.mean_weight),
        total_weight=white.total_weight,
        mean_arrival_s=(white.mean_weight * late).sum(axis=2) + first[..., 0],
        log_norm=white.log_norm + log_weight,
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
    received = present[np.arange(len(present))[:, None], others]
    difference = np.where(received[..., None], identity[others] - identity[reference][:, :, None, :], 0.0)
    between = (
        difference @ whole @ difference.swapaxes(-1, -2) + np.where(received, 0.0, 1.0)[..., None] * identity[1:, 1:]
    )
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
    received = present.sum(axis=0)
    log_prior = number * np.log(bad_probability) + (received - number) * np.log1p(-bad_probability)
    possible = ~(bad[:, :, None] & ~present).any(axis=1)
    log_prior = np.where(possible, log_prior, -np.inf)
    return np.asarray(log_prior - np.logaddexp.reduce(log_prior, axis=0))


def of_problem(values: FloatArray, owner: slice | IntArray) -> FloatArray:
    """Values of problems (*, B) for points that belong to them."""
    return np.asarray(values[..., owner] if isinstance(owner, slice) else values.take(owner, axis=-1))


def blocks(owner: IntArray) -> Iterator[tuple[slice, slice | IntArray]]:
    """Points to be treated together, few enough to stay in the processor's cache, and the problem of each.

    Parameters
    ----------
    owner : ndarray of int, shape (M,)
        Problem of each point, ascending.
    """
    for first in range(0, owner.size, BLOCK):
        some = owner[first : first + BLOCK]
        alone = some[0] == some[-1]  # nothing then has to be gathered for each point
        yield slice(first, first + BLOCK), slice(int(some[0]), int(some[0]) + 1) if alone else some


def log_constant(problems: Problems) -> FloatArray:
    """What turns the integral of exp(`Local.log_density`) over x into the evidence, shape (B,), as a logarithm."""
    priors = problems.priors
    return np.asarray(
        -0.5 * (problems.received - 1) * np.log(2 * np.pi)
        - np.log(2 * priors.emission_half_width_s)
        - priors.log_volume(problems.dimensions)
    )

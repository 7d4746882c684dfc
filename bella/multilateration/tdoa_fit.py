r"""Least squares on arrival times of a signal that travels at c, and the error of the position that comes out.

Receiver i, at p_i, hears at y_i = t0 + \|s - p_i\|/c. The best emission time is the weighted mean of y_i - d_i/c, so
it drops out when weighted means are taken off: with r~_i = (y_i - y-bar) - (d_i - d-bar)/c and unit vectors
e_i = (s - p_i)/d_i, the misfit is sum w r~^2 and its Jacobian -(e_i - e-bar)/c (Badman et al. 2022, ApJ 938:95,
doi:10.3847/1538-4357/ac90c2; the elimination is that of Torrieri 1984, IEEE Trans. AES-20:183). For errors that are
correlated between receivers, with the inverse P of their covariance, the weights of the means are P 1 / W and the
misfit is r~^T P r~ = r^T Q r, Q = P - P 1 1^T P / W, W = 1^T P 1.

With the emission time eliminated the information on the position is (J~^T W J~), J~_i = -(e_i - e-bar)/c. The sum over
receivers of the centred products equals a sum over pairs,

    J~^T W J~ = sum_{i<j} w_i w_j / W (e_i - e_j)(e_i - e_j)^T / c^2,      W = sum w,

with -Q_ij in place of w_i w_j / W where errors are correlated. It takes no difference of nearly equal numbers when one
receiver is far more precise than the rest. The emission time t0 = y-bar - d-bar/c then has the variance 1/W + e-bar^T C
e-bar / c^2 (Torrieri 1984, IEEE Trans. AES-20:183; the same as the t0 element of the inverse of the full normal
matrix).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bella.exceptions import InputError
from bella.multilateration.priors import Priors
from bella.units import C_RSUN_S, FloatArray

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.intp]

SEARCH_RSUN = 6 * Priors().tau_rsun
"""Least squares looks for the source no farther from the Sun than this: 484 solar radii."""
NODES = {2: 33, 3: 13}
"""Nodes per axis of the coarse lattice, by dimension."""
MAX_STEPS = 80
CONVERGED_RSUN = 1e-7
"""A step shorter than this ends the descent."""
NEAREST_RSUN = 1e-9
"""Distances are kept above this, so that a source at a receiver has a direction."""
SINGULAR = 1e-12
"""Ratio of the eigenvalues of the normal matrix below which floating-point numbers do not tell it from singular."""
LATTICE_TOGETHER = 4_000_000
"""Most distances to the lattice held at once, so that memory stays bounded."""


@dataclass(frozen=True)
class Timing:
    """Who received the signal when, for a batch of problems.

    Attributes
    ----------
    receivers : ndarray, shape (B, n, 3)
        Solar radii; 0 where a receiver is missing.
    delay_s : ndarray, shape (B, n)
        Time since the first arrival, s; 0 where missing.
    share : ndarray, shape (B, n)
        Weights of the best mean, which add up to one; 0 where missing.
    precision : ndarray, shape (B, n, n)
        Q of the module's equation, over the total weight.
    total_weight : ndarray, shape (B,)
        W, s^-2.
    first_s : ndarray, shape (B,)
        First arrival, s.
    """

    receivers: FloatArray
    delay_s: FloatArray
    share: FloatArray
    precision: FloatArray
    total_weight: FloatArray
    first_s: FloatArray

    @property
    def present(self) -> BoolArray:
        """Which spacecraft received it, shape (B, n)."""
        return np.asarray(self.share != 0)

    @property
    def positive_share(self) -> FloatArray:
        """Shares without those below 0 that strong correlations make: good enough to find a start."""
        positive = np.maximum(self.share, 0)
        return np.asarray(positive / positive.sum(axis=1, keepdims=True))

    def take(self, rows: IntArray) -> "Timing":
        """The problems of some rows."""
        return Timing(**{name: getattr(self, name)[rows] for name in Timing.__dataclass_fields__})


def timing_of(
    receivers: FloatArray,
    arrival_s: FloatArray,
    sigma_s: FloatArray,
    dimensions: int,
    correlation: FloatArray | None = None,
) -> Timing:
    """Check a batch of arrival times and take the first arrival off.

    Parameters
    ----------
    receivers : ndarray, shape (B, n, 3)
        Solar radii.
    arrival_s : ndarray, shape (B, n)
        Arrival times, s; NaN marks a receiver that did not hear it.
    sigma_s : ndarray, shape (B, n)
        Standard deviations, s; not read where the receiver is missing.
    dimensions : int
        2 or 3.
    correlation : ndarray, shape (B, n, n), optional
        Of the errors; not read where a receiver is missing.

    Raises
    ------
    InputError
        If shapes do not agree, or naming the row with too few receivers, or with a time, error or position that is
        not usable.
    """
    receivers, arrival_s, sigma_s = (np.asarray(values, dtype=np.float64) for values in (receivers, arrival_s, sigma_s))
    _check_shapes(receivers, arrival_s, sigma_s, dimensions)
    present = ~np.isnan(arrival_s)
    few = np.asarray(present.sum(axis=1) <= dimensions)
    reject_rows(few, f"reached fewer than {dimensions + 1} receivers; leave it out, or use the method posterior")
    reject_rows(np.any(np.isinf(arrival_s), axis=1), "has an arrival time that is not finite; mark it NaN")
    usable = np.isfinite(sigma_s) & (sigma_s > 0)
    reject_rows(np.any(present & ~usable, axis=1), "has a sigma_s that is not above 0")
    lost = np.any(present & ~np.isfinite(receivers).all(axis=2), axis=1)
    reject_rows(lost, "has a receiver without a position; give x_rsun, y_rsun, z_rsun")
    first = np.where(present, arrival_s, np.inf).min(axis=1, initial=np.inf)
    smallest = np.where(present, sigma_s, np.inf).min(axis=1, initial=np.inf)
    relative = np.where(present, smallest[:, None] / np.where(present, sigma_s, 1.0), 0.0) ** 2
    inverse = relative[..., None] * np.eye(relative.shape[1])
    if correlation is not None:
        both = present[:, :, None] & present[:, None, :]
        shared = np.where(both, correlation, np.eye(relative.shape[1]))
        lost = np.asarray(np.linalg.cond(shared) > 1.0 / np.finfo(np.float64).eps)
        reject_rows(lost, "has a sigma_s that is lost in the errors receivers share; raise it, or use method posterior")
        inverse = np.linalg.inv(shared)
        inverse *= np.sqrt(relative[:, :, None] * relative[:, None, :])
    total = inverse.sum(axis=(1, 2))
    share = inverse.sum(axis=2) / total[:, None]
    return Timing(
        receivers=np.where(present[..., None], receivers, 0.0),
        delay_s=np.where(present, arrival_s - first[:, None], 0.0),
        share=share,
        precision=inverse / total[:, None, None] - share[:, :, None] * share[:, None, :],
        total_weight=total / smallest**2,
        first_s=first,
    )


def _check_shapes(receivers: FloatArray, arrival_s: FloatArray, sigma_s: FloatArray, dimensions: int) -> None:
    if dimensions not in NODES:
        raise InputError(f"{dimensions} dimensions are not supported; use 2 (the ecliptic plane) or 3")
    if arrival_s.ndim != 2 or sigma_s.shape != arrival_s.shape or receivers.shape != (*arrival_s.shape, 3):
        raise InputError(
            f"receivers {receivers.shape}, arrival_s {arrival_s.shape} and sigma_s {sigma_s.shape} do not agree; "
            "give (B, n, 3), (B, n) and (B, n)"
        )


def reject_rows(bad: BoolArray, reason: str, error: type[InputError] = InputError) -> None:
    """Refuse a batch that has a bad row.

    Parameters
    ----------
    bad : ndarray of bool, shape (B,)
    reason : str
        What is wrong with it and what to do.
    error : type
        `InputError` or `GeometryError`.

    Raises
    ------
    InputError
        Names the first bad row, counted from 0.
    """
    if bad.any():
        raise error(f"row {int(np.argmax(bad))} {reason}")


def misfit(timing: Timing, points: FloatArray) -> FloatArray:
    """Weighted sum of squares with the best emission time, sum w r~^2 of the module's equation.

    Parameters
    ----------
    points : ndarray, shape (B, D)
        Solar radii.

    Returns
    -------
    ndarray, shape (B,)
        Chi-squared.
    """
    return np.asarray(_mean_square(timing, points) * timing.total_weight)


def _mean_square(timing: Timing, points: FloatArray) -> FloatArray:
    distance, _ = directions(timing, points)
    residual = _centred(timing, timing.delay_s - distance / C_RSUN_S)
    return np.asarray(np.einsum("bi,bij,bj->b", residual, timing.precision, residual))


def directions(timing: Timing, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances and unit vectors from the receivers to the source.

    Parameters
    ----------
    points : ndarray, shape (B, D)
        Solar radii.

    Returns
    -------
    distance : ndarray, shape (B, n)
        Solar radii.
    unit : ndarray, shape (B, n, D)
        Along the axes in which the source can move.
    """
    dimensions = points.shape[1]
    offset = points[:, None, :] - timing.receivers[..., :dimensions]
    squared = np.einsum("bnd,bnd->bn", offset, offset) + (timing.receivers[..., dimensions:] ** 2).sum(axis=2)
    distance = np.maximum(np.sqrt(squared), NEAREST_RSUN)
    return distance, offset / distance[..., None]


def _centred(timing: Timing, values: FloatArray) -> FloatArray:
    return np.asarray(values - (timing.share * values).sum(axis=1, keepdims=True))


def descend(timing: Timing, start: FloatArray) -> FloatArray:
    """Position of least misfit near a start, by damped Gauss-Newton steps (Levenberg 1944; Marquardt 1963).

    Parameters
    ----------
    start : ndarray, shape (B, D)
        Solar radii.

    Returns
    -------
    ndarray, shape (B, D)
        Within `SEARCH_RSUN` of the Sun.
    """
    points = _within_search(start)
    value = _mean_square(timing, points)
    damping = np.full(len(points), 1e-3)
    active = np.arange(len(points))
    some = timing
    for _ in range(MAX_STEPS):
        trial = _within_search(points[active] + _step(some, points[active], damping[active]))
        reached = _mean_square(some, trial)
        moved = np.linalg.norm(trial - points[active], axis=1)
        better = reached < value[active]
        points[active[better]], value[active[better]] = trial[better], reached[better]
        damping[active] = np.maximum(damping[active] * np.where(better, 0.1, 10.0), 1e-12)
        onward = moved > CONVERGED_RSUN
        if not onward.any():
            break
        if not onward.all():
            active, some = active[onward], some.take(np.flatnonzero(onward))
    return points


def _within_search(points: FloatArray) -> FloatArray:
    radius = np.linalg.norm(points, axis=1, keepdims=True)
    return np.asarray(points * np.minimum(1.0, SEARCH_RSUN / np.maximum(radius, 1e-300)))


def _step(timing: Timing, points: FloatArray, damping: FloatArray) -> FloatArray:
    """Solve (J^T w J + damping trace/D) step = -J^T w r: the damping knows no axes, so neither does the path."""
    distance, unit = directions(timing, points)
    residual = _centred(timing, timing.delay_s - distance / C_RSUN_S)
    jacobian = unit - np.einsum("bn,bnd->bd", timing.share, unit)[:, None, :]
    weighted = jacobian.swapaxes(1, 2) @ timing.precision
    normal = weighted @ jacobian
    scale = np.maximum(np.einsum("bii->b", normal) / points.shape[1], 1e-200)
    normal += (damping * scale)[:, None, None] * np.eye(points.shape[1])
    downhill = C_RSUN_S * (weighted @ residual[..., None])
    return np.asarray(np.linalg.solve(normal, downhill)[..., 0])


def coarse_start(timing: Timing, dimensions: int) -> FloatArray:
    """Node of least misfit of a coarse lattice over the search region.

    Returns
    -------
    ndarray, shape (B, D)
        Solar radii.
    """
    axis = np.linspace(-SEARCH_RSUN, SEARCH_RSUN, NODES[dimensions])
    nodes = np.stack(np.meshgrid(*[axis] * dimensions, indexing="ij"), axis=-1).reshape(-1, dimensions)
    nodes = nodes[np.linalg.norm(nodes, axis=1) <= SEARCH_RSUN]
    together = max(1, LATTICE_TOGETHER // (len(nodes) * timing.share.shape[1]))
    best = [
        _best_node(timing.take(np.arange(low, min(low + together, len(timing.share)))), nodes)
        for low in range(0, len(timing.share), together)
    ]
    return nodes[np.concatenate(best)] if best else np.empty((0, dimensions))


def _best_node(timing: Timing, nodes: FloatArray) -> IntArray:
    # |x - p|^2 multiplied out, receivers first, in single precision: one matrix product, and a start needs no more
    single = np.float32
    receivers = timing.receivers[..., : nodes.shape[1]].astype(single)
    length = (-2 * receivers) @ nodes.T.astype(single)
    length += (nodes**2).sum(axis=1).astype(single)
    length += (timing.receivers**2).sum(axis=2).astype(single)[..., None]
    np.sqrt(np.maximum(length, 0, out=length), out=length)
    residual = np.subtract((timing.delay_s * C_RSUN_S).astype(single)[..., None], length, out=length)
    share = timing.positive_share.astype(single)
    mean = (share[:, None, :] @ residual)[:, 0]
    residual *= residual
    return np.asarray(((share[:, None, :] @ residual)[:, 0] - mean**2).argmin(axis=1))


class Emission(NamedTuple):
    """When the signal left its source.

    Attributes
    ----------
    time_s, sd_s : ndarray, shape (B,)
        On the clock of the arrival times, and its standard deviation, s.
    """

    time_s: FloatArray
    sd_s: FloatArray


def information(timing: Timing, points: FloatArray) -> FloatArray:
    """Inverse of the covariance, J~^T W J~ of the module's equation.

    Parameters
    ----------
    points : ndarray, shape (B, D)
        Solar radii.

    Returns
    -------
    ndarray, shape (B, D, D)
        Per square solar radius.
    """
    _, unit = directions(timing, points)
    first, second = np.triu_indices(unit.shape[1], k=1)
    weight = -timing.precision[:, first, second] * timing.total_weight[:, None] / C_RSUN_S**2
    pairs = unit[:, first] - unit[:, second]
    return np.asarray((weight[..., None] * pairs).swapaxes(1, 2) @ pairs)


def is_singular(normal: FloatArray) -> BoolArray:
    """Which matrices cannot be inverted in floating-point numbers.

    Parameters
    ----------
    normal : ndarray, shape (B, D, D)
        Symmetric.

    Returns
    -------
    ndarray of bool, shape (B,)
    """
    values = np.linalg.eigvalsh(normal)
    return np.asarray(~(values[:, 0] > SINGULAR * values[:, -1]))


def inverse(normal: FloatArray) -> FloatArray:
    """Inverse of symmetric matrices, exactly symmetric.

    Parameters
    ----------
    normal : ndarray, shape (B, D, D)

    Returns
    -------
    ndarray, shape (B, D, D)
    """
    inverted = np.linalg.inv(normal)
    return np.asarray(0.5 * (inverted + inverted.swapaxes(1, 2)))


def limited_inverse(normal: FloatArray, limit_rsun: float) -> FloatArray:
    """Inverse of the information with that of a Gaussian prior of the position added, so that it always exists.

    Parameters
    ----------
    normal : ndarray, shape (B, D, D)
        Symmetric; eigenvalues that rounding does not tell from 0 count as 0.
    limit_rsun : float
        Standard deviation of the prior, solar radii: none of the result is larger.

    Returns
    -------
    ndarray, shape (B, D, D)
        Square solar radii.
    """
    values, axes = np.linalg.eigh(normal)
    told = np.where(values > SINGULAR * values[:, -1:], values, 0.0)
    variance = 1 / (told + limit_rsun**-2.0)
    return np.asarray((axes * variance[:, None, :]) @ axes.swapaxes(1, 2))


def emission(timing: Timing, points: FloatArray, position_covariance: FloatArray) -> Emission:
    """Emission time, and its error when the position is as uncertain as stated.

    Parameters
    ----------
    points : ndarray, shape (B, D)
        Solar radii.
    position_covariance : ndarray, shape (B, D, D)
        Square solar radii.
    """
    distance, unit = directions(timing, points)
    since_first = (timing.share * (timing.delay_s - distance / C_RSUN_S)).sum(axis=1)
    direction = np.einsum("bn,bnd->bd", timing.share, unit) / C_RSUN_S
    of_position = np.einsum("bd,bde,be->b", direction, position_covariance, direction)
    return Emission(timing.first_s + since_first, np.sqrt(1 / timing.total_weight + of_position))

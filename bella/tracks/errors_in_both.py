"""Straight and broken lines through points that have correlated errors in both coordinates.

For one straight line this is the best line of York et al. 2004, Am. J. Phys. 72, 367, doi:10.1119/1.1632486: the sum
of the squared distances, each in the metric of its point's covariance, is least. A broken line keeps that measure: a
point belongs to the nearest place on it, be that within a segment or at a knot.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from bella.exceptions import InputError
from bella.units import FloatArray

FEWEST_OF_SEGMENT = 3
CANDIDATES = 12
"""Distances at which knots are looked for, before the best of them move freely."""

REFINED = 2
"""How many of the best placements of knots are refined."""

TOLERANCE, EVALUATIONS = 1e-10, 200


@dataclass(frozen=True)
class Points:
    """Points with correlated errors.

    Attributes
    ----------
    x, y : ndarray, shape (N,)
        Ascending in x.
    covariance : ndarray, shape (N, 2, 2)
        Of x and y.
    """

    x: FloatArray
    y: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        if self.y.shape != self.x.shape or self.covariance.shape != (self.x.size, 2, 2):
            raise InputError(
                f"{self.x.size} points need as many values and 2 x 2 covariances: leave out what lacks them"
            )
        with np.errstate(invalid="ignore"):
            positive = (self.covariance[:, 0, 0] > 0) & (np.linalg.det(self.covariance) > 0)
        if not (positive.all() and np.isfinite(self.x).all() and np.isfinite(self.y).all()):
            raise InputError("a point is missing or its covariance is not positive definite: leave that point out")

    def variance_about(self, slope: FloatArray) -> FloatArray:
        """Variance of y - slope x: its errors seen along lines of a slope.

        Parameters
        ----------
        slope : ndarray, shape (N,) or broadcastable, such as (S, 1)

        Returns
        -------
        ndarray
            The broadcast shape.
        """
        xx, xy, yy = self.covariance[:, 0, 0], self.covariance[:, 0, 1], self.covariance[:, 1, 1]
        return np.asarray(yy - 2 * slope * xy + slope**2 * xx)


@dataclass(frozen=True)
class BrokenLine:
    """A continuous line, straight between knots.

    Attributes
    ----------
    value, value_sd : float
        Of the first segment, continued to the origin that was asked for.
    slope, slope_sd : ndarray, shape (K + 1,)
        Of each segment.
    knot : ndarray, shape (K,)
    chi2 : float
        Sum of the squared distances.
    points : int
    """

    value: float
    value_sd: float
    slope: FloatArray
    slope_sd: FloatArray
    knot: FloatArray
    chi2: float
    points: int

    @property
    def bic(self) -> float:
        """Bayesian information criterion (Schwarz 1978, Ann. Stat. 6, 461, doi:10.1214/aos/1176344136)."""
        parameters = 2 + 2 * self.knot.size
        return self.chi2 + parameters * float(np.log(self.points))


def fit_broken_line(points: Points, knots: int, origin: float = 0.0) -> BrokenLine | None:
    """Best line with a number of knots, wherever they are.

    Parameters
    ----------
    points : Points
    knots : int
        0 for a straight line.
    origin : float
        Where the value of the line is given.

    Returns
    -------
    BrokenLine or None
        None where there are too few points for so many segments.

    Notes
    -----
    The errors are those of York et al. 2004, from the adjusted points, and take the knots as known.
    """
    straight = _refined(points, _straight_start(points, origin), np.empty(0), origin)
    if not knots:
        return straight
    placements = _placements(points, straight, knots, origin)
    fits = [_refined(points, start, knot, origin) for start, knot in placements]
    good = [fit for fit in fits if _enough_in_each(points.x, fit.knot)]
    return min(good, key=lambda fit: fit.chi2) if good else None


def _enough_in_each(x: FloatArray, knot: FloatArray) -> bool:
    counts = np.diff([0, *np.searchsorted(x, knot), x.size])
    return bool((counts >= FEWEST_OF_SEGMENT).all())


def _design(x: FloatArray, knot: FloatArray, origin: float) -> FloatArray:
    """Columns of value, first slope, and change of slope at each knot, shape (N, 2 + K)."""
    return np.column_stack([np.ones_like(x), x - origin, *(np.maximum(x - k, 0.0) for k in knot)])


def _straight_start(points: Points, origin: float) -> FloatArray:
    solution, _ = _weighted(points, np.empty(0), np.zeros(1), origin)
    return _weighted(points, np.empty(0), solution[1:2], origin)[0]


def _weighted(points: Points, knot: FloatArray, slope: FloatArray, origin: float) -> tuple[FloatArray, float]:
    """Line by linear least squares, with the weights that a slope gives, and its chi2."""
    root = 1.0 / np.sqrt(points.variance_about(slope))
    design, target = _design(points.x, knot, origin) * root[:, None], points.y * root
    solution = np.linalg.lstsq(design, target, rcond=None)[0]
    return np.asarray(solution), float(np.sum((target - design @ solution) ** 2))


def _placements(points: Points, straight: BrokenLine, knots: int, origin: float) -> list[tuple[FloatArray, FloatArray]]:
    """The most promising knots, each with the line through them: first all knots of a coarse grid are tried."""
    inside = points.x[FEWEST_OF_SEGMENT - 1 : 1 - FEWEST_OF_SEGMENT]
    if inside.size < 2:
        return []
    candidates = np.unique(np.quantile(inside, np.linspace(0.0, 1.0, CANDIDATES + 2)[1:-1]))
    tried = []
    for chosen in combinations(candidates, knots):
        knot = np.array(chosen)
        if _enough_in_each(points.x, knot):
            solution, chi2 = _weighted(points, knot, straight.slope, origin)
            tried.append((chi2, solution, knot))
    tried.sort(key=lambda trial: trial[0])
    return [(solution, knot) for _, solution, knot in tried[:REFINED]]


def _refined(points: Points, start: FloatArray, knot: FloatArray, origin: float) -> BrokenLine:
    """Least sum of squared distances, knots moving between the midpoints to their neighbours."""
    lines = start.size
    edges = np.concatenate([points.x[:1], 0.5 * (knot[:-1] + knot[1:]), points.x[-1:]])
    free = np.full(lines, np.inf)
    found = least_squares(
        lambda theta: _distances(points, theta[:lines], theta[lines:], origin)[0],
        np.concatenate([start, knot]),
        bounds=(np.concatenate([-free, edges[: knot.size]]), np.concatenate([free, edges[1 : knot.size + 1]])),
        x_scale="jac",
        xtol=TOLERANCE,
        ftol=TOLERANCE,
        gtol=TOLERANCE,
        max_nfev=EVALUATIONS,
    )
    return _with_errors(points, found.x[:lines], found.x[lines:], origin)


def _distances(
    points: Points, line: FloatArray, knot: FloatArray, origin: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Signed distance of each point from the line in its own metric, its nearest place x, and the segment of that."""
    slope = np.cumsum(line[1:])[:, None]
    off = points.y - _design(points.x, knot, origin) @ line
    # lines of the segments, continued over all x
    bounds = np.concatenate([[-np.inf], knot, [np.inf]])
    at = np.concatenate([points.x[:1], knot])[:, None]
    height = (_design(at[:, 0], knot, origin) @ line)[:, None]
    apart = points.y - height - slope * (points.x - at)
    xx, xy = points.covariance[:, 0, 0], points.covariance[:, 0, 1]
    nearest = points.x - (xy - slope * xx) / points.variance_about(slope) * apart
    nearest = np.clip(nearest, bounds[:-1, None], bounds[1:, None])
    miss = np.stack([points.x - nearest, points.y - height - slope * (nearest - at)], axis=-1)
    chi2 = np.einsum("snj,njk,snk->sn", miss, np.linalg.inv(points.covariance), miss)
    segment = chi2.argmin(axis=0)
    every = np.arange(points.x.size)
    return np.copysign(np.sqrt(chi2[segment, every]), off), nearest[segment, every], segment


def _with_errors(points: Points, line: FloatArray, knot: FloatArray, origin: float) -> BrokenLine:
    distance, nearest, segment = _distances(points, line, knot, origin)
    slope = np.cumsum(line[1:])
    root = 1.0 / np.sqrt(points.variance_about(slope[segment]))
    weighted = _design(nearest, knot, origin) * root[:, None]
    covariance = np.linalg.pinv(weighted.T @ weighted)
    sums = np.tril(np.ones((slope.size, slope.size)))
    return BrokenLine(
        value=float(line[0]),
        value_sd=float(np.sqrt(covariance[0, 0])),
        slope=slope,
        slope_sd=np.sqrt(np.diag(sums @ covariance[1:, 1:] @ sums.T)),
        knot=knot,
        chi2=float(distance @ distance),
        points=points.x.size,
    )

"""Adaptive cells that hold the whole posterior of a position, none of its modes lost.

Space is divided into equal rectangles that are halved until the density changes little across one. One side lies along
the direction in which the posterior is sharpest, the other follows its ridge (:mod:`bella.multilateration.axes`): a
long narrow one then takes long narrow cells. A cell is dropped only when an upper bound of the density anywhere in it
is far below the best value found: the root of the misfit is Lipschitz in x, because distances change by no more than
the source moves and delays by no more than directions turn. The bound looks for slowness and kappa within `RANGE_SD`.
All final cells of a problem have one size, so that the midpoint rule on them is accurate far beyond its order. In space
the rectangles are boxes, turned about the z axis.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bella.exceptions import ConvergenceError
from bella.multilateration.axes import Axes, axes_of
from bella.multilateration.likelihood import (
    NEAR_RSUN,
    NEAREST_RSUN,
    RANGE_SD,
    Local,
    Survey,
    evaluate,
    mixed,
    survey,
)
from bella.multilateration.problems import BoolArray, IntArray, Problems, blocks
from bella.multilateration.speed import SpeedMoments, log_speed_factor, speed_moments
from bella.units import FloatArray

BOX_NATS = 18.0
"""The first box reaches to where the prior of the position has fallen by so much."""
FIRST_CELLS = 12
"""Cells per axis at the start."""
DROP_NATS = 13.0
"""A cell is dropped when its bound is this far below the best density."""
BELOW_NATS, BELOW_NATS_OF_MIXTURE = 14.5, 17.0
"""A final cell is dropped when its density is this far below; noise with bad arrival times has longer tails. Standard
deviations then hold to 5e-4 against brute force."""
FINE_NATS = 8.0
"""Cells whose bound is within this of the best density decide when to stop; near the Sun or a receiver, where the bound
says little, those whose centre is."""
TOLERANCE = 1.2
"""Longest edge of a final cell, in local standard deviations. Moments hold to 1e-4 with edges half as long again; it is
the draws, spread evenly within a cell, that want smaller ones."""
LOG_SLACK = 0.3
"""Allowance for what the bound of log det G leaves out, nats."""
MOST_LOG_DET = 700.0
"""Larger ones would overflow; the bound is then only less tight."""
MOST_PARTS = 3
"""In so many parts, at most, a cell is divided at once when that makes it final."""
WAITS = 3.0
"""Cells are not divided along an axis while they are so many times more too long along another: how sharp the posterior
is along its ridge shows only once they are narrow."""
OVERSIZE = 1.1
"""A final cell may be larger than the tolerance by this: the sharpest place is known only to a cell."""
MAX_CELLS, MAX_CELLS_IN_SPACE = 2_000_000, 6_000_000
"""Most cells of one problem, times components of the noise; more is an error, never a silent cut."""
MAX_CELLS_TOGETHER = 300_000
"""Most cells of several problems; they are then to be divided in smaller groups, so that memory stays bounded."""


@dataclass(frozen=True)
class Lattice:
    """Cells of several problems in one flat list; those of one problem have one size.

    Attributes
    ----------
    index : ndarray of int, shape (D, M)
        Coordinates in cells, along the axes.
    owner : ndarray of int, shape (M,)
        Problem of each cell.
    side : ndarray, shape (D, B)
        Edge lengths of the cells of each problem, solar radii.
    origin : ndarray, shape (D, B)
        Lower corner of each lattice along the axes, solar radii.
    axes : Axes
        Of each problem.
    """

    index: IntArray
    owner: IntArray
    side: FloatArray
    origin: FloatArray
    axes: Axes

    @property
    def centres(self) -> FloatArray:
        """Centres, shape (D, M), solar radii."""
        return self.place(self.index + 0.5, self.owner)

    def place(self, index: npt.NDArray[np.floating], owner: IntArray) -> FloatArray:
        """Positions, shape (D, *S), of coordinates in cells of the lattices of some problems, solar radii."""
        return self.axes.place(self.along(index, owner), owner)

    def along(self, index: npt.NDArray[np.floating], owner: IntArray) -> FloatArray:
        """The same along the axes of each lattice."""
        return np.asarray(self.origin.take(owner, axis=1) + index * self.side.take(owner, axis=1))


@dataclass(frozen=True)
class Cells(Lattice):
    """Final cells, ordered by problem, with the integrals at their centres.

    Attributes
    ----------
    local : Local
        Arrays of shape (K, M).
    speed : SpeedMoments
        Arrays of shape (K, M).
    """

    local: Local
    speed: SpeedMoments

    @property
    def log_density(self) -> FloatArray:
        """Log p(x, k | y) at the centres under the prior of the model, up to a constant of the problem, (K, M)."""
        return self.local.log_density + self.speed.log_factor


def divide(problems: Problems, *, tolerance: float = TOLERANCE, drop_nats: float = DROP_NATS) -> Cells:
    """Divide space until every problem's cells resolve its posterior.

    Cells are halved while they are far too large, and then divided in as many parts as it takes, so that the final ones
    are hardly smaller than they must be.

    Parameters
    ----------
    tolerance : float
        Longest edge of a final cell, in local standard deviations.
    drop_nats : float
        A cell is dropped when its bound is this far below the best density.

    Raises
    ------
    ConvergenceError
        If one problem needs more than `MAX_CELLS`, or several together more than `MAX_CELLS_TOGETHER`, or the arrival
        times are more precise than floating-point numbers resolve.
    """
    lattice = _first_lattice(problems)
    best = np.full(problems.count, -np.inf)
    done: list[tuple[Lattice, FloatArray]] = []
    while lattice.owner.size:
        value, bound, sharp, near = _level(lattice, problems)
        best = np.maximum(best, _highest(value, lattice.owner, problems.count))
        deficit = best[lattice.owner] - bound
        high = deficit < FINE_NATS
        high &= ~near | (best[lattice.owner] - value < FINE_NATS)
        parts = _parts(lattice, sharp, high, tolerance)
        final = (parts == 1).all(axis=0)[lattice.owner]
        done.append(_pick(lattice, value, final & (deficit < drop_nats)))
        lattice = _divided(lattice, (deficit < drop_nats) & ~final, parts)
        _check_budget(lattice, problems.components)
    return _gathered(done, drop_nats, problems)


def _level(lattice: Lattice, problems: Problems) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Log density of all components together at the centres, its bound in each cell, the sharpness, each (M,).

    And which cells are small, and near the Sun or a receiver.
    """
    along = lattice.along(lattice.index + 0.5, lattice.owner)
    value, sharp = np.empty(lattice.owner.size), np.empty_like(along)
    bound, near = np.empty_like(value), np.empty(value.shape, dtype=bool)
    axes, sides = lattice.axes, 0.5 * lattice.side
    sides[0] += axes.bulge(sides[1])
    for some, owner in blocks(lattice.owner):
        here, half_sides = problems.at(owner), sides[:, owner]
        points = axes.place(along[:, some], owner)
        lean = None if axes.curve is None else axes.bend(along[1, some], owner)[1]
        seen = survey(here, points, axes.turn[:, owner], lean)
        # farthest that a point of a cell is from its centre
        widest = half_sides[0] if lean is None else half_sides[0] + np.abs(lean) * half_sides[1]
        reach = np.sqrt(widest**2 + (half_sides[1:] ** 2).sum(axis=0))
        radius, nearest = _length(points), seen.distance.min(axis=0)
        # only a largest speed can change the density much against the bound
        value[some] = _whole_density(here, points) if here.priors.is_truncated else mixed(seen.log_density)
        near[some] = (np.minimum(radius, nearest) < NEAR_RSUN + reach) & (reach < NEAR_RSUN)
        bound[some] = _upper_bound(here, seen, half_sides, reach, radius, nearest)
        sharp[:, some] = np.sqrt(seen.sharpness**2 + here.priors.tau_rsun**-2.0)
    return value, bound, sharp, near


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt((vectors**2).sum(axis=0)))


def _whole_density(here: Problems, points: FloatArray) -> FloatArray:
    local = evaluate(here, points)
    return mixed(local.log_density + log_speed_factor(local, here.priors))


def _highest(values: FloatArray, owner: IntArray, count: int) -> FloatArray:
    """Largest value of each problem, -inf where it has no points; points are in the order of their problems."""
    first = np.searchsorted(owner, np.arange(count))
    last = np.searchsorted(owner, np.arange(count), side="right")
    highest = np.full(count, -np.inf)
    some = last > first
    highest[some] = np.maximum.reduceat(values, first[some])
    return highest


def _first_lattice(problems: Problems) -> Lattice:
    """Equal cells that cover the prior of every problem."""
    reach = problems.priors.tau_rsun * (2 * BOX_NATS) ** (1 / problems.priors.power)
    axes = axes_of(problems)
    low, high = axes.limits(reach, problems.dimensions)
    index = np.indices((FIRST_CELLS,) * problems.dimensions).reshape(problems.dimensions, -1)
    return Lattice(
        np.tile(index, problems.count),
        np.repeat(np.arange(problems.count), index.shape[1]),
        (high - low) / FIRST_CELLS,
        low,
        axes,
    )


def _upper_bound(  # noqa: PLR0913, PLR0917
    here: Problems, seen: Survey, half_sides: FloatArray, reach: FloatArray, radius: FloatArray, nearest: FloatArray
) -> FloatArray:
    """Bound of the log density anywhere in each cell, shape (M,).

    Parameters
    ----------
    seen : Survey
        Of the centres.
    half_sides : ndarray, shape (D, M)
        Farthest that a cell reaches from its centre along the axes there, solar radii.
    reach, radius, nearest : ndarray, shape (M,)
        How far the cell reaches in any direction; distances of its centre from the Sun and from the nearest receiver.
    """
    priors, delay = here.priors, here.delay
    inner = np.maximum(radius - reach, NEAREST_RSUN)
    outer = np.maximum(nearest - reach, NEAREST_RSUN)
    # directions turn by no more than the way over the distance, by half of that on average; a delay changes with them
    travel = np.minimum(0.5 * reach / outer, 2.0)
    late = here.rise_s.max(axis=0) * (1 / inner + 1 / outer)
    slowest = priors.slowness_mean + RANGE_SD * priors.slowness_sd
    largest_kappa = abs(delay.kappa) + RANGE_SD * delay.kappa_sd
    # no more than the whole way towards every receiver and the whole turn; or the slope, which itself changes by a turn
    anywhere = slowest * reach + largest_kappa * np.minimum(late * reach, 2 * here.rise_s.max(axis=0))
    bend = slowest * travel + largest_kappa * late * (travel + 0.5 * reach / inner)
    from_slope = (seen.sharpness * half_sides).sum(axis=0) + here.steepest * bend * reach
    from_slope = np.where(np.minimum(radius, nearest) < NEAR_RSUN, np.inf, from_slope)
    change = np.minimum(here.steepest * anywhere, from_slope)
    lowest = np.maximum(np.sqrt(np.maximum(seen.misfit, 0)) - change, 0) ** 2
    widened = here.steepest * ((priors.slowness_sd + delay.kappa_sd * late) * reach)
    root = np.maximum(np.sqrt(np.expm1(np.minimum(seen.log_det, MOST_LOG_DET))) - widened, 0)
    bound = mixed(here.log_norm - 0.5 * (lowest + np.log1p(root**2)))
    return bound + priors.log_position(np.maximum(radius - reach, 0.0) ** 2) + LOG_SLACK - priors.log_share_allowed


def _parts(lattice: Lattice, sharp: FloatArray, high: BoolArray, tolerance: float) -> IntArray:
    """In how many parts along each axis the cells of each problem are to be divided, shape (D, B); 1: final."""
    count, owner = lattice.side.shape[1], lattice.owner
    sharpest = np.stack([_highest(axis[high], owner[high], count) for axis in sharp])
    exact = np.ceil(np.where(np.isfinite(sharpest), sharpest, np.inf) * lattice.side / tolerance / OVERSIZE)
    parts = np.where(exact <= MOST_PARTS, exact, 2)
    parts = np.where(WAITS * exact < exact.max(axis=0), 1, parts)
    return np.where(np.bincount(owner, minlength=count) > 0, parts, 1).astype(np.intp)


def _divided(lattice: Lattice, chosen: BoolArray, parts: IntArray) -> Lattice:
    """Cells divided in the parts of their problem along each axis."""
    ways, way = np.unique(parts, axis=1, return_inverse=True)
    way = way.ravel()
    some = [_divided_in(lattice, chosen & (way[lattice.owner] == i), one) for i, one in enumerate(ways.T)]
    index, owner = (np.concatenate([pair[i] for pair in some], axis=-1) for i in (0, 1))
    order = np.argsort(owner, kind="stable") if len(some) > 1 else slice(None)
    return replace(lattice, index=index[:, order], owner=owner[order], side=lattice.side / parts)


def _divided_in(lattice: Lattice, chosen: BoolArray, parts: IntArray) -> tuple[IntArray, IntArray]:
    corner = np.indices(tuple(parts)).reshape(parts.size, -1)
    index = (parts[:, None, None] * lattice.index[:, chosen, None] + corner[:, None, :]).reshape(parts.size, -1)
    return index, np.repeat(lattice.owner[chosen], corner.shape[1])


def _check_budget(lattice: Lattice, components: int) -> None:
    alone = MAX_CELLS_IN_SPACE if lattice.index.shape[0] == 3 else MAX_CELLS
    most = alone if lattice.side.shape[1] == 1 else MAX_CELLS_TOGETHER
    if lattice.owner.size * components > most:
        raise ConvergenceError(
            f"the posterior needs more than {most} cells; give its arrival times larger sigma_s, or leave it out"
        )


def _pick(lattice: Lattice, value: FloatArray, chosen: BoolArray) -> tuple[Lattice, FloatArray]:
    return replace(lattice, index=lattice.index[:, chosen], owner=lattice.owner[chosen]), value[chosen]


def _gathered(done: list[tuple[Lattice, FloatArray]], drop_nats: float, problems: Problems) -> Cells:
    """Final cells in the order of their problems, without those far below the best of them.

    The last lattice knows the final size of every problem's.
    """
    last = done[-1][0]
    owner = np.concatenate([part.owner for part, _ in done])
    if np.bincount(owner, minlength=problems.count).min() == 0:
        raise ConvergenceError(
            "no position explains the arrival times within sigma_s; check them, give larger sigma_s, or leave it out"
        )
    order = np.argsort(owner, kind="stable")
    value = np.concatenate([value for _, value in done])[order]
    below = drop_nats - DROP_NATS + (BELOW_NATS if problems.components == 1 else BELOW_NATS_OF_MIXTURE)
    lowest = _highest(value, owner[order], problems.count) - below
    order = order[value > lowest[owner[order]]]
    index = np.concatenate([part.index for part, _ in done], axis=1)[:, order]
    lattice = replace(last, index=index, owner=owner[order])
    centres = lattice.centres
    parts = [evaluate(problems.at(one), centres[:, some]) for some, one in blocks(lattice.owner)]
    local = Local(
        **{name: np.concatenate([getattr(part, name) for part in parts], axis=1) for name in Local.__dataclass_fields__}
    )
    return Cells(**vars(lattice), local=local, speed=speed_moments(local, problems.priors))


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

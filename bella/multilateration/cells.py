"""Adaptive cells that hold the whole posterior of a position, none of its modes lost.

Space is divided into equal rectangles that are halved until the density changes little across one. They are turned so
that one side lies along the direction in which the posterior is sharpest: a long narrow one then takes long narrow
cells. A cell is dropped only when an upper bound of the density anywhere in it is far below the best value found: the
root of the misfit is Lipschitz in x, because distances change by no more than the source moves and delays by no more
than directions turn. All final cells of a problem have one size, so that the midpoint rule on them is accurate far
beyond its order. In space the rectangles are boxes, turned about the z axis.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bella.exceptions import ConvergenceError
from bella.multilateration.likelihood import (
    NEAR_RSUN,
    NEAREST_RSUN,
    RANGE_SD,
    Local,
    Survey,
    density,
    evaluate,
    slope_and_information,
    survey,
)
from bella.multilateration.problems import BoolArray, IntArray, Problems, blocks
from bella.multilateration.speed import SpeedMoments, log_speed_factor, speed_moments
from bella.units import FloatArray

BOX_NATS = 18.0
"""The first box reaches to where the prior of the position has fallen by so much."""
FIRST_CELLS = 12
"""Cells per axis at the start."""
TRIED_DIRECTIONS, TRIED_RSUN = 8, (20.0, 70.0, 150.0)
"""Places from which the top of the posterior is looked for: directions, and distances from the Sun."""
STEPS_TO_TOP, SHARES_OF_STEP = 4, (0.0, 0.1, 0.3, 1.0)
"""Gauss-Newton steps towards the top, and the shares of each that are tried: enough for the direction there."""
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
        Coordinates in cells, along the turned axes.
    owner : ndarray of int, shape (M,)
        Problem of each cell.
    side : ndarray, shape (D, B)
        Edge lengths of the cells of each problem, solar radii.
    origin : float
        Lower corner of the lattice, along every turned axis, solar radii.
    turn : ndarray, shape (2, B)
        Cosine and sine of the angle from the x axis to the first of the turned axes.
    """

    index: IntArray
    owner: IntArray
    side: FloatArray
    origin: float
    turn: FloatArray

    @property
    def centres(self) -> FloatArray:
        """Centres, shape (D, M), solar radii."""
        return self.place(self.index + 0.5, self.owner)

    def place(self, index: npt.NDArray[np.floating], owner: IntArray) -> FloatArray:
        """Positions, shape (D, *S), of coordinates in cells of the lattices of some problems, solar radii."""
        return turned(self.origin + index * self.side[:, owner], self.turn[:, owner])

    @property
    def half_diagonal(self) -> FloatArray:
        """Farthest that a point of a cell is from its centre, shape (B,), solar radii."""
        return np.asarray(0.5 * np.sqrt((self.side**2).sum(axis=0)))


def turned(along: FloatArray, turn: FloatArray) -> FloatArray:
    """Vectors by their coordinates along turned axes, shape (D, *S); `turn` is the cosine and sine of the angle."""
    return np.stack([turn[0] * along[0] - turn[1] * along[1], turn[1] * along[0] + turn[0] * along[1], *along[2:]])


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
    problems : Problems
    tolerance : float
        Longest edge of a final cell, in local standard deviations.
    drop_nats : float
        A cell is dropped when its bound is this far below the best density.

    Returns
    -------
    Cells

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
    centres, reach = lattice.centres, lattice.half_diagonal[lattice.owner]
    value, bound, sharp = np.empty_like(reach), np.empty_like(reach), np.empty_like(centres)
    near = np.empty(reach.shape, dtype=bool)
    for some, owner in blocks(lattice.owner):
        here, points = problems.at(owner), centres[:, some]
        seen = survey(here, points, lattice.turn[:, owner])
        # only a largest speed can change the density much against the bound
        value[some] = _whole_density(here, points) if here.priors.is_truncated else mixed(seen.log_density)
        nearest = np.minimum(np.sqrt((points**2).sum(axis=0)), seen.distance.min(axis=0))
        near[some] = (nearest < NEAR_RSUN + reach[some]) & (reach[some] < NEAR_RSUN)
        bound[some] = _upper_bound(here, points, 0.5 * lattice.side[:, owner], seen)
        sharp[:, some] = np.hypot(seen.sharpness, 1 / here.priors.tau_rsun)
    return value, bound, sharp, near


def _whole_density(here: Problems, points: FloatArray) -> FloatArray:
    local = evaluate(here, points)
    return mixed(local.log_density + log_speed_factor(local, here.priors))


def mixed(log_density: FloatArray) -> FloatArray:
    """Logarithm of the sum over the components of the noise: (K, *S) to S."""
    return log_density[0] if len(log_density) == 1 else np.asarray(np.logaddexp.reduce(log_density, axis=0))


def _highest(values: FloatArray, owner: IntArray, count: int) -> FloatArray:
    """Largest value of each problem, -inf where it has no points; points are in the order of their problems."""
    first = np.searchsorted(owner, np.arange(count))
    last = np.searchsorted(owner, np.arange(count), side="right")
    highest = np.full(count, -np.inf)
    some = last > first
    highest[some] = np.maximum.reduceat(values, first[some])
    return highest


def _first_lattice(problems: Problems) -> Lattice:
    origin = -problems.priors.tau_rsun * (2 * BOX_NATS) ** (1 / problems.priors.power)
    index = np.indices((FIRST_CELLS,) * problems.dimensions).reshape(problems.dimensions, -1)
    return Lattice(
        np.tile(index, problems.count),
        np.repeat(np.arange(problems.count), index.shape[1]),
        np.full((problems.dimensions, problems.count), -2 * origin / FIRST_CELLS),
        origin,
        _sharpest_direction(problems),
    )


def _sharpest_direction(problems: Problems) -> FloatArray:
    """Cosine and sine of the direction in which each posterior is sharpest near its top, shape (2, B).

    Gauss-Newton steps from the best of some places lead there. They need not succeed: cells in a poor direction are
    more, not worse.
    """
    angle = np.linspace(0, 2 * np.pi, TRIED_DIRECTIONS, endpoint=False)
    places = np.multiply.outer([np.cos(angle), np.sin(angle)], TRIED_RSUN).reshape(2, -1)
    tried = np.zeros((problems.dimensions, problems.count, places.shape[1]))
    tried[:2] = places[:, None]
    spread, rows = problems.spread(), np.arange(problems.count)
    for _ in range(STEPS_TO_TOP):
        top = tried[:, rows, mixed(density(spread, tried)).argmax(axis=1)]
        slope, information = (values[..., 0, :] for values in slope_and_information(problems, top))
        precision = np.moveaxis(information, -1, 0) + problems.priors.tau_rsun**-2.0 * np.eye(problems.dimensions)
        step = np.linalg.solve(precision, slope.T[..., None])[..., 0].T
        tried = top[..., None] + step[..., None] * np.array(SHARES_OF_STEP)
    angle = 0.5 * np.arctan2(2 * information[0, 1], information[0, 0] - information[1, 1])
    return np.stack([np.cos(angle), np.sin(angle)])


def _upper_bound(here: Problems, centres: FloatArray, half_sides: FloatArray, seen: Survey) -> FloatArray:
    """Bound of the log density anywhere in each cell, shape (M,); `half_sides` has shape (D, M)."""
    priors, delay = here.priors, here.delay
    reach = np.sqrt((half_sides**2).sum(axis=0))
    radius = np.sqrt((centres**2).sum(axis=0))
    inner = np.maximum(radius - reach, 0.0)
    travel, late = _largest_turns(here, reach, inner, seen)
    slowest = priors.slowness_mean + RANGE_SD * priors.slowness_sd
    largest_kappa = abs(delay.kappa) + RANGE_SD * delay.kappa_sd
    # no more than the whole way towards every receiver and the whole turn; or the slope, which itself changes by a turn
    anywhere = here.steepest * (slowest * reach + largest_kappa * np.minimum(late * reach, 2 * here.rise_s.max(axis=0)))
    bend = here.steepest * (
        slowest * travel + largest_kappa * late * (travel + reach / np.maximum(inner, NEAREST_RSUN))
    )
    from_slope = (seen.sharpness * half_sides).sum(axis=0) + bend * reach
    from_slope = np.where(np.minimum(radius, seen.distance.min(axis=0)) < NEAR_RSUN, np.inf, from_slope)
    change = np.minimum(anywhere, from_slope)
    lowest = np.maximum(np.sqrt(np.maximum(seen.misfit, 0)) - change, 0) ** 2
    widened = here.steepest * (priors.slowness_sd * reach + delay.kappa_sd * late * reach)
    root = np.maximum(np.sqrt(np.expm1(np.minimum(seen.log_det, MOST_LOG_DET))) - widened, 0)
    bound = mixed(here.log_norm - 0.5 * (lowest + np.log1p(root**2)))
    return bound + priors.log_position(inner**2) + LOG_SLACK - priors.log_share_allowed


def _largest_turns(here: Problems, reach: FloatArray, inner: FloatArray, seen: Survey) -> tuple[FloatArray, FloatArray]:
    """Largest turn of the direction to a receiver within each cell, and change of a delay per way, s per solar radius.

    Directions turn by no more than the way over the distance.
    """
    nearest = np.maximum(seen.distance.min(axis=0) - reach, NEAREST_RSUN)
    late = here.rise_s.max(axis=0) * (1 / np.maximum(inner, NEAREST_RSUN) + 1 / nearest)
    return np.minimum(reach / nearest, 2.0), late


def _parts(lattice: Lattice, sharp: FloatArray, high: BoolArray, tolerance: float) -> IntArray:
    """In how many parts along each axis the cells of each problem are to be divided, shape (D, B); 1: final."""
    count, owner = lattice.turn.shape[1], lattice.owner
    sharpest = np.stack([_highest(axis[high], owner[high], count) for axis in sharp])
    exact = np.ceil(np.where(np.isfinite(sharpest), sharpest, np.inf) * lattice.side / tolerance / OVERSIZE)
    parts = np.where(exact <= MOST_PARTS, exact, 2)
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
    most = alone if lattice.turn.shape[1] == 1 else MAX_CELLS_TOGETHER
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

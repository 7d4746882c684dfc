"""Adaptive cells that hold the whole posterior of a position, none of its modes lost.

Space is divided into equal rectangles that are halved until the density changes little across one. One side lies along
the direction in which the posterior is sharpest, the other follows its ridge (:mod:`bella.multilateration.axes`): a
long narrow one then takes long narrow cells. A cell is dropped only when an upper bound of the density anywhere in it
is far below the best value found: the root of the misfit falls by no more than its slope says, and the slope changes by
no more than directions turn. The bound looks for slowness and kappa within `RANGE_SD`.
All final cells of a problem have one size, so that the midpoint rule on them is accurate far beyond its order. In space
the rectangles are boxes, turned about the z axis.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bella.exceptions import ConvergenceError
from bella.multilateration.axes import APEX_RSUN, Axes, axes_of
from bella.multilateration.likelihood import (
    NEAR_RSUN,
    NEAREST_RSUN,
    RANGE_SD,
    Local,
    Survey,
    density,
    evaluate,
    mixed,
    survey,
)
from bella.multilateration.priors import Priors
from bella.multilateration.problems import BoolArray, IntArray, Problems, blocks, of_problem
from bella.multilateration.speed import SpeedMoments, log_speed_factor, speed_moments
from bella.units import FloatArray

BOX_NATS = 18.0
"""The first box reaches to where the prior of the position has fallen by so much."""
FIRST_CELLS = 6
"""Cells per axis at the start."""
DROP_NATS = 13.5
"""A cell is dropped when its bound is this far below the best density."""
BELOW_NATS, BELOW_NATS_OF_MIXTURE = 15.5, 17.0
"""A final cell is dropped when its density is this far below; noise with bad arrival times has longer tails. Standard
deviations then hold to 5e-4 against brute force."""
COARSE_SHARE = 1e-3
"""Cells may be larger than the tolerance where they hold no more than this of the posterior together."""
STEPS = np.concatenate([np.geomspace(1.0, 4.0, 30), 2.0 ** np.arange(3, 24)])
"""In how many parts cells are seen to need division."""
FAN_LEVEL, MANY_CELLS, FEWER = 2, 2_000, 0.4
"""From this division on, problems that take so many cells or more are looked at for fans, and divided in the best one
if it takes fewer by this factor. Earlier, or for less, bent axes that would do as well are given up."""
TOLERANCE = 1.2
"""Longest edge of a final cell, in local standard deviations. Moments hold to 1e-4 with edges half as long again; it is
the draws, spread evenly within a cell, that want smaller ones."""
MOST_LOG_DET = 700.0
"""Larger ones would overflow; the bound is then only less tight."""
MOST_PARTS = 3
"""In so many parts, at most, a cell is divided at once when that makes it final."""
STEADY = 0.5
"""Cells that reach less far than this part of the way to the Sun or a receiver tell how sharp the posterior is in the
final ones, which then are not surveyed themselves."""
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
        Where the indices of each lattice begin along the axes, solar radii.
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

    def along(self, index: npt.NDArray[np.floating], owner: slice | IntArray) -> FloatArray:
        """The same along the axes of each lattice."""
        return np.asarray(of_problem(self.origin, owner) + index * of_problem(self.side, owner))

    def pick(self, place: IntArray) -> "Lattice":
        """Some of the cells."""
        return replace(self, index=self.index.take(place, axis=1), owner=self.owner.take(place))

    def log_area(self, index: npt.NDArray[np.floating], owner: IntArray) -> FloatArray:
        """Logarithm of the area per unit of coordinates there, shape S; 0 but in fans."""
        return np.zeros(1) if self.axes.fan is None else self.axes.log_area(self.along(index, owner), owner)


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

    @property
    def log_mass(self) -> FloatArray:
        """Logarithm of what the cells hold, up to a constant of the problem, (K, M)."""
        return self.log_density + self.log_area(self.index + 0.5, self.owner)


def divide(problems: Problems, *, tolerance: float = TOLERANCE, drop_nats: float = DROP_NATS) -> Cells:
    """Divide space until every problem's cells resolve its posterior.

    Cells are halved while they are far too large, and then divided in as many parts as it takes, so that the final ones
    are hardly smaller than they must be. Problems that take far fewer cells in a fan are divided anew in one.

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
    fans = _Fans(problems) if problems.dimensions == 2 else None
    axes, top = axes_of(problems)
    best = _density_within_range(problems, top)
    done, last = _resolved(problems, _first_lattice(problems, axes), best, tolerance, drop_nats, fans)
    if fans is not None and fans.chosen.any():
        which = np.flatnonzero(fans.chosen)
        axes, low, high = fans.boxes(which)
        first = _covering(axes, low, high)
        again, fanned = _resolved(problems.at(which), first, best[which], tolerance, drop_nats)
        side, origin = last.side.copy(), last.origin.copy()
        side[:, which], origin[:, which] = fanned.side, fanned.origin
        last = replace(last, side=side, origin=origin, axes=last.axes.with_fans(which, axes))
        done += [replace(part, owner=which[part.owner]) for part in again]
    below = drop_nats - DROP_NATS + (BELOW_NATS if problems.components == 1 else BELOW_NATS_OF_MIXTURE)
    return _gathered(done, last, below, problems)


class _Fans:
    """Problems that are to be divided in fans: apices, places that these open towards, and cells that they cover."""

    def __init__(self, problems: Problems) -> None:
        self.problems = problems
        self.chosen = np.zeros(problems.count, dtype=bool)
        self.apex, self.towards = np.zeros((2, 2, problems.count))
        self.covered: list[tuple[FloatArray, FloatArray, IntArray]] = []

    def choose(self, seen: "_Seen", lattice: Lattice, need: FloatArray) -> BoolArray:
        """Problems that take far fewer cells in the best of some fans, shape (B,).

        Parameters
        ----------
        seen : _Seen
            Of the cells of a lattice, those alone that are not dropped.
        """
        count = self.problems.count
        number = np.bincount(lattice.owner, minlength=count)
        many = np.asarray(number * need.prod(axis=0) > MANY_CELLS)
        if not many.any():
            return np.zeros(count, dtype=bool)
        some = many.take(lattice.owner)
        owner = lattice.owner[some]
        points, sharp = lattice.axes.turned_back(seen.points[:, some], owner), seen.sharp[:, some]
        fewest, apex = np.full(count, np.inf), np.zeros((2, count))
        for place in (np.zeros((2, count)), *self.problems.receivers[:2].swapaxes(0, 1)):
            growth2 = 1 + ((points - place[:, owner]) ** 2).sum(axis=0) / APEX_RSUN**2
            wanted = summed(1 / growth2, owner, count)
            for axis in sharp:
                wanted[many] *= np.sqrt(_highest(axis**2 * growth2, owner, count)[many])
            better = many & (wanted < fewest)
            apex[:, better], fewest[better] = place[:, better], wanted[better]
        usual = number[many] * np.prod([_highest(axis, owner, count)[many] for axis in sharp], axis=0)
        chosen = np.zeros(count, dtype=bool)
        chosen[many] = fewest[many] < FEWER * usual
        number = np.maximum(number, 1)
        towards = np.stack([summed(axis, owner, count) for axis in points]) / number
        self.apex[:, chosen], self.towards[:, chosen] = apex[:, chosen], towards[:, chosen]
        self.chosen |= chosen
        left = chosen[owner]
        self.covered.append((points[:, left], seen.reach[some][left], owner[left]))
        return chosen

    def boxes(self, which: IntArray) -> tuple[Axes, FloatArray, FloatArray]:
        """Axes of the fans of some problems, and the lowest and highest coordinates of their cells, shape (2, B)."""
        axes = Axes.fanned(self.apex[:, which], self.towards[:, which])
        low, high = np.full((2, 2, which.size), np.inf)
        for points, reach, owner in self.covered:
            row = np.searchsorted(which, owner)
            least, most = axes.within(points, reach, row)
            low = np.minimum(low, [-_highest(-axis, row, which.size) for axis in least])
            high = np.minimum(high, [-_highest(axis, row, which.size) for axis in most])
        return axes, low, -high


def _resolved(  # noqa: PLR0913, PLR0917
    problems: Problems,
    lattice: Lattice,
    best: FloatArray,
    tolerance: float,
    drop_nats: float,
    fans: _Fans | None = None,
) -> tuple[list[Lattice], Lattice]:
    """Final cells of each problem, and a lattice with the sides of all.

    Parameters
    ----------
    lattice : Lattice
        To begin with.
    best : ndarray, shape (B,)
        A log density that each posterior has somewhere, the higher the better.
    fans : _Fans, optional
        Asked which problems take far fewer cells in a fan; these are left out.
    """
    done: list[Lattice] = []
    level, turned = 0, problems.turned(lattice.axes.turn)
    while lattice.owner.size:
        seen = _level(lattice, turned)
        best = np.maximum(best, _highest(seen.value, lattice.owner, problems.count))
        kept = np.flatnonzero(best.take(lattice.owner) - seen.bound < drop_nats)
        lattice, seen = lattice.pick(kept), seen.pick(kept)
        owner = lattice.owner
        need = _need(lattice, seen, best, tolerance)
        if fans is not None and level >= FAN_LEVEL:
            lattice = lattice.pick(np.flatnonzero(~fans.choose(seen, lattice, need).take(lattice.owner)))
        parts = _parts(lattice, need)
        lattice = _divided(lattice, parts)
        _check_budget(lattice, problems.components)
        unsteady = np.zeros(problems.count, dtype=bool)
        unsteady[owner[~seen.steady]] = True
        final = np.all(need <= 1, axis=0) | (np.all(parts >= need, axis=0) & ~unsteady & (problems.components == 1))
        final = final[lattice.owner]
        done.append(lattice.pick(np.flatnonzero(final)))
        lattice = lattice.pick(np.flatnonzero(~final))
        level += 1
    return done, lattice


@dataclass(frozen=True)
class _Seen:
    """What is seen of cells.

    Attributes
    ----------
    points : ndarray, shape (D, M)
        Their centres in the turned frame of their problem, solar radii.
    value, bound : ndarray, shape (M,)
        Log density of all components together at the centres, and its bound in each cell.
    sharp : ndarray, shape (D, M)
        Root of the information at the centres, per coordinate.
    near : ndarray of bool, shape (M,)
        Which are small, and near the Sun or a receiver: the bound says little of them.
    reach : ndarray, shape (M,)
        Farthest that a point of a cell is from its centre, solar radii.
    steady : ndarray of bool, shape (M,)
        Which are so small that the information hardly changes in them.
    """

    points: FloatArray
    value: FloatArray
    bound: FloatArray
    sharp: FloatArray
    near: BoolArray
    reach: FloatArray
    steady: BoolArray

    def pick(self, place: IntArray) -> "_Seen":
        """Some of the cells."""
        return _Seen(**{name: values.take(place, axis=-1) for name, values in vars(self).items()})


def _level(lattice: Lattice, problems: Problems) -> _Seen:
    """What is seen of the cells of a lattice, of problems turned as its axes are."""
    points, sharp = np.empty((2, *lattice.index.shape))
    value, bound, reach = np.empty((3, lattice.owner.size))
    near, steady = np.empty((2, *value.shape), dtype=bool)
    axes, sides = lattice.axes, 0.5 * lattice.side
    sides[0] += axes.bulge(sides[1])
    for some, owner in blocks(lattice.owner):
        along = lattice.along(lattice.index[:, some] + 0.5, owner)
        here, half_sides = problems.at(owner), axes.spread(along, of_problem(sides, owner), owner)
        points[:, some], lean = axes.shaped(along, owner)
        seen = survey(here, points[:, some], lean)
        widest = half_sides[0] if lean is None else half_sides[0] + np.abs(lean) * half_sides[1]
        reach[some] = np.sqrt(widest**2 + (half_sides[1:] ** 2).sum(axis=0))
        radius, nearest = _length(points[:, some]), seen.distance.min(axis=0)
        truncated = here.priors.is_truncated
        value[some] = _density(here, points[:, some]) if truncated else mixed(seen.log_density)
        near[some] = (np.minimum(radius, nearest) < NEAR_RSUN + reach[some]) & (reach[some] < NEAR_RSUN)
        turning = np.maximum(np.minimum(radius, nearest) if here.delay.is_free else nearest, NEAR_RSUN)
        steady[some] = reach[some] < STEADY * turning
        bound[some] = _upper_bound(here, seen, half_sides, reach[some], radius, nearest)
        sharp[:, some] = np.sqrt(seen.sharpness**2 + here.priors.tau_rsun**-2.0)
        if axes.fan is not None:
            sharp[:, some] *= np.exp(0.5 * axes.log_area(along, owner))
    return _Seen(points, value, bound, sharp, near, reach, steady)


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt((vectors**2).sum(axis=0)))


def _density(here: Problems, points: FloatArray) -> FloatArray:
    """Log density of all components together; only a largest speed can change it much against its bound."""
    return _value(evaluate(here, points), here.priors) if here.priors.is_truncated else mixed(density(here, points))


def _density_within_range(problems: Problems, points: FloatArray) -> FloatArray:
    """The same, -inf where slowness or kappa are beyond the range in which the bound looks for them."""
    local, priors, delay = evaluate(problems, points), problems.priors, problems.delay
    within = np.abs(local.slowness - priors.slowness_mean) <= RANGE_SD * priors.slowness_sd
    within &= np.abs(local.kappa - delay.kappa) <= RANGE_SD * delay.kappa_sd
    return _value(replace(local, log_density=np.where(within, local.log_density, -np.inf)), priors)


def _value(local: Local, priors: Priors) -> FloatArray:
    return mixed(local.log_density + log_speed_factor(local, priors) if priors.is_truncated else local.log_density)


def _highest(values: FloatArray, owner: IntArray, count: int) -> FloatArray:
    """Largest value of each problem, -inf where it has no points; points are in the order of their problems."""
    first = np.searchsorted(owner, np.arange(count))
    last = np.searchsorted(owner, np.arange(count), side="right")
    highest = np.full(count, -np.inf)
    some = last > first
    highest[some] = np.maximum.reduceat(values, first[some])
    return highest


def _first_lattice(problems: Problems, axes: Axes) -> Lattice:
    """Equal cells that cover the prior of every problem."""
    reach_rsun = float(problems.priors.tau_rsun * (2 * BOX_NATS) ** (1 / problems.priors.power))
    return _covering(axes, *axes.limits(reach_rsun, problems.dimensions))


def _covering(axes: Axes, low: FloatArray, high: FloatArray) -> Lattice:
    """Equal cells that cover boxes along the axes, from their lowest to their highest coordinates, shape (D, B).

    Indices are counted from the middle: of a symmetric problem all cells are, however they are divided.
    """
    dimensions, count = low.shape
    index = np.indices((FIRST_CELLS,) * dimensions).reshape(dimensions, -1) - FIRST_CELLS // 2
    owner = np.repeat(np.arange(count), index.shape[1])
    return Lattice(np.tile(index, count), owner, (high - low) / FIRST_CELLS, 0.5 * (low + high), axes)


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
    from_slope = (np.abs(seen.root_slope) * half_sides[:, None]).sum(axis=0) + here.steepest * bend * reach
    from_slope = np.where(np.minimum(radius, nearest) < NEAR_RSUN, np.inf, from_slope)
    change = np.minimum(here.steepest * anywhere, from_slope)
    lowest = np.maximum(np.sqrt(np.maximum(seen.misfit, 0)) - change, 0) ** 2
    widened = here.steepest * ((priors.slowness_sd + delay.kappa_sd * late) * reach)
    root = np.maximum(np.sqrt(np.expm1(np.minimum(seen.log_det, MOST_LOG_DET))) - widened, 0)
    bound = mixed(here.log_norm - 0.5 * (lowest + np.log1p(root**2)))
    return bound + priors.log_position(np.maximum(radius - reach, 0.0) ** 2) - priors.log_share_allowed


def _need(lattice: Lattice, seen: _Seen, best: FloatArray, tolerance: float) -> FloatArray:
    """In how many parts along each axis the cells of each problem have yet to be divided, one of `STEPS`, shape (D, B).

    Parameters
    ----------
    best : ndarray, shape (B,)
        Highest log density that was seen.
    """
    count, owner = lattice.side.shape[1], lattice.owner
    top = best[owner]
    weight = np.exp(np.minimum(np.where(seen.near, seen.value, seen.bound) - top, 0.0))
    least = COARSE_SHARE * summed(np.exp(seen.value - top), owner, count)
    need = np.ones(lattice.side.shape)
    for axis, side, one in zip(seen.sharp, lattice.side, need, strict=True):
        step = np.searchsorted(STEPS, axis * (side / (tolerance * OVERSIZE))[owner])
        held = np.bincount(owner * (STEPS.size + 1) + step, weight, minlength=count * (STEPS.size + 1))
        held = held.reshape(count, -1)[:, ::-1].cumsum(axis=1)[:, ::-1]  # by cells that need so many or more
        one[:] = STEPS[np.clip((held > least[:, None]).sum(axis=1) - 1, 0, STEPS.size - 1)]
    return need


def _parts(lattice: Lattice, need: FloatArray) -> FloatArray:
    """In how many parts along each axis the cells of each problem are to be divided now, shape (D, B); 1: final."""
    parts = np.where(need * OVERSIZE <= MOST_PARTS, need * OVERSIZE, 2.0)
    parts = np.where((need <= 1) | (WAITS * need < need.max(axis=0)), 1.0, parts)
    return np.where(np.bincount(lattice.owner, minlength=lattice.side.shape[1]) > 0, parts, 1.0)


def _divided(lattice: Lattice, parts: FloatArray) -> Lattice:
    """Cells divided in the parts of their problem along each axis: the smaller cells whose centres lie in them."""
    owner, index = lattice.owner, lattice.index
    along = parts.take(owner, axis=1)
    first = np.ceil(index * along - 0.5).astype(np.intp)
    number = np.ceil((index + 1) * along - 0.5).astype(np.intp) - first
    whole = number.prod(axis=0)
    place = np.arange(whole.sum()) - np.repeat(np.cumsum(whole) - whole, whole)
    divided = np.repeat(first, whole, axis=1)
    for axis in range(len(number) - 1, 0, -1):
        place, step = np.divmod(place, np.repeat(number[axis], whole))
        divided[axis] += step
    divided[0] += place
    return replace(lattice, index=divided, owner=np.repeat(owner, whole), side=lattice.side / parts)


def _check_budget(lattice: Lattice, components: int) -> None:
    alone = MAX_CELLS_IN_SPACE if lattice.index.shape[0] == 3 else MAX_CELLS
    most = alone if lattice.side.shape[1] == 1 else MAX_CELLS_TOGETHER
    if lattice.owner.size * components > most:
        raise ConvergenceError(
            f"the posterior needs more than {most} cells; give its arrival times larger sigma_s, or leave it out"
        )


def _gathered(done: list[Lattice], last: Lattice, below: float, problems: Problems) -> Cells:
    """Final cells in the order of their problems, without those so far below the best of them.

    The last lattice knows the final size of every problem's.
    """
    owner = np.concatenate([part.owner for part in done])
    if np.bincount(owner, minlength=problems.count).min() == 0:
        raise ConvergenceError(
            "no position explains the arrival times within sigma_s; check them, give larger sigma_s, or leave it out"
        )
    order = np.argsort(owner, kind="stable")
    index = np.concatenate([part.index for part in done], axis=1).take(order, axis=1)
    lattice = replace(last, index=index, owner=owner.take(order))
    seen = []
    for some, one in blocks(lattice.owner):
        seen.append(evaluate(problems.at(one), lattice.place(lattice.index[:, some] + 0.5, lattice.owner[some])))
    value = np.concatenate([_value(local, problems.priors) for local in seen])
    lowest = _highest(value, lattice.owner, problems.count) - below
    kept = value > lowest.take(lattice.owner)
    first, parts = 0, []
    for local in seen:
        place = np.flatnonzero(kept[first : first + local.misfit.shape[1]])
        parts.append({name: values.take(place, axis=1) for name, values in vars(local).items()})
        first += local.misfit.shape[1]
    local = Local(**{name: np.concatenate([part[name] for part in parts], axis=1) for name in parts[0]})
    return Cells(**vars(lattice.pick(np.flatnonzero(kept))), local=local, speed=speed_moments(local, problems.priors))


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

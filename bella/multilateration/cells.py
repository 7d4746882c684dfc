"""Adaptive cells that hold the whole posterior of a position, none of its modes lost.

Space is divided into equal squares that are halved until the density changes little across one. A cell is dropped only
when an upper bound of the density anywhere in it is far below the best value found: the root of the misfit is Lipschitz
in x with constant sqrt(W) u_max, because distances change by no more than the source moves. All final cells of a
problem have one size, so that the midpoint rule on them is accurate far beyond its order. In space the squares are
cubes.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bella.exceptions import ConvergenceError
from bella.multilateration.likelihood import IntArray, Local, Problems, evaluate, sharpness
from bella.multilateration.speed import SpeedMoments, log_speed_factor, speed_moments
from bella.units import FloatArray

BoolArray = npt.NDArray[np.bool_]

BOX_TAU = 6.0
"""Half width of the first box, in prior standard deviations."""
FIRST_CELLS = 16
"""Cells per axis at the start."""
DROP_NATS = 13.0
"""A cell is dropped when its bound is this far below the best density."""
FINE_NATS = 8.0
"""Cells whose bound is within this of the best density decide when to stop."""
TOLERANCE = 1.15
"""Longest edge of a final cell, in local standard deviations. Moments hold to 1e-4 with edges half as long again; it is
the draws, spread evenly within a cell, that want smaller ones."""
SLOWNESS_RANGE_SD = 4.0
"""The bound holds for slownesses within this many prior standard deviations."""
LOG_SLACK = 0.3
"""Allowance for the slow change of log P across a cell, nats."""
MAX_CELLS = 2_000_000
"""Most cells of one problem, times components of the noise; more is an error, never a silent cut."""
MAX_CELLS_TOGETHER = 300_000
"""Most cells of several problems; they are then to be divided in smaller groups, so that memory stays bounded."""


@dataclass(frozen=True)
class Lattice:
    """Cells of several problems in one flat list; those of one problem have one size.

    Attributes
    ----------
    index : ndarray of int, shape (D, M)
        Coordinates in cells; the centre is ``origin + (index + 1/2) side``.
    owner : ndarray of int, shape (M,)
        Problem of each cell.
    side : ndarray, shape (B,)
        Edge length of the cells of each problem, solar radii.
    origin : float
        Lower corner of the lattice, solar radii.
    """

    index: IntArray
    owner: IntArray
    side: FloatArray
    origin: float

    @property
    def centres(self) -> FloatArray:
        """Centres, shape (D, M), solar radii."""
        return np.asarray(self.origin + (self.index + 0.5) * self.side[self.owner])

    @property
    def half_diagonal(self) -> FloatArray:
        """Farthest that a point of a cell is from its centre, shape (B,), solar radii."""
        return np.asarray(0.5 * np.sqrt(self.index.shape[0]) * self.side)


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
    done: list[tuple[Lattice, Local]] = []
    while lattice.owner.size:
        here, centres = problems.at(lattice.owner), lattice.centres
        local = evaluate(here, centres)
        best = np.maximum(best, _highest(_density(local, problems), lattice.owner, problems.count))
        deficit = best[lattice.owner] - _upper_bound(here, centres, lattice.half_diagonal[lattice.owner], local)
        fine = _is_fine(problems, lattice, deficit < FINE_NATS, tolerance)[lattice.owner]
        kept = deficit < drop_nats
        done.append(_pick(lattice, local, kept & fine))
        lattice = _halved(lattice, kept & ~fine)
        _check_budget(lattice, problems.components)
    return _gathered(done, problems)


def _density(local: Local, problems: Problems) -> FloatArray:
    """Log density of all components together, (M,). Only a largest speed can change it much against the bound."""
    if problems.priors.is_truncated:
        return mixed(local.log_density + log_speed_factor(local, problems.priors))
    return mixed(local.log_density)


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
    origin = -BOX_TAU * problems.priors.tau_rsun
    index = np.indices((FIRST_CELLS,) * problems.dimensions).reshape(problems.dimensions, -1)
    return Lattice(
        np.tile(index, problems.count),
        np.repeat(np.arange(problems.count), index.shape[1]),
        np.full(problems.count, -2 * origin / FIRST_CELLS),
        origin,
    )


def _upper_bound(here: Problems, centres: FloatArray, reach: FloatArray, local: Local) -> FloatArray:
    """Bound of the log density anywhere in each cell, shape (M,); `reach` is the half diagonal of its cell."""
    priors = here.priors
    slowest = priors.slowness_mean + SLOWNESS_RANGE_SD * priors.slowness_sd
    change = np.sqrt(here.total_weight) * slowest * reach
    misfit = np.maximum(np.sqrt(np.maximum(local.misfit, 0)) - change, 0) ** 2
    radius = np.sqrt((centres**2).sum(axis=0))
    prior = (np.maximum(radius - reach, 0) / priors.tau_rsun) ** 2
    log_precision = -2 * np.log(local.slowness_sd / priors.slowness_sd)
    return mixed(here.log_norm - 0.5 * (misfit + prior + log_precision)) + LOG_SLACK - priors.log_share_allowed


def _is_fine(problems: Problems, lattice: Lattice, high: BoolArray, tolerance: float) -> BoolArray:
    """Which problems have cells that are small against the posterior they resolve, shape (B,)."""
    owner = lattice.owner[high]
    sharp = sharpness(problems.at(owner), lattice.centres[:, high])
    sharpest = np.maximum(_highest(sharp, owner, problems.count), 0)
    return np.asarray(sharpest * lattice.side <= tolerance)


def _halved(lattice: Lattice, chosen: BoolArray) -> Lattice:
    dimensions = lattice.index.shape[0]
    corner = np.indices((2,) * dimensions).reshape(dimensions, -1)
    index = (2 * lattice.index[:, chosen, None] + corner[:, None, :]).reshape(dimensions, -1)
    owner = np.repeat(lattice.owner[chosen], 2**dimensions)
    counts = np.bincount(owner, minlength=lattice.side.size)
    return Lattice(index, owner, np.where(counts > 0, lattice.side / 2, lattice.side), lattice.origin)


def _check_budget(lattice: Lattice, components: int) -> None:
    most = MAX_CELLS if lattice.side.size == 1 else MAX_CELLS_TOGETHER
    if lattice.owner.size * components > most:
        raise ConvergenceError(
            f"the posterior needs more than {most} cells; give its arrival times larger sigma_s, or leave it out"
        )


def _pick(lattice: Lattice, local: Local, chosen: BoolArray) -> tuple[Lattice, Local]:
    part = Lattice(lattice.index[:, chosen], lattice.owner[chosen], lattice.side, lattice.origin)
    return part, Local(**{name: getattr(local, name)[:, chosen] for name in Local.__dataclass_fields__})


def _gathered(done: list[tuple[Lattice, Local]], problems: Problems) -> Cells:
    """All final cells in the order of their problems; the last lattice knows the final size of every problem's."""
    last = done[-1][0]
    owner = np.concatenate([part.owner for part, _ in done])
    if np.bincount(owner, minlength=problems.count).min() == 0:
        raise ConvergenceError(
            "no position explains the arrival times within sigma_s; check them, give larger sigma_s, or leave it out"
        )
    order = np.argsort(owner, kind="stable")
    index = np.concatenate([part.index for part, _ in done], axis=1)[:, order]
    local = Local(
        **{
            name: np.concatenate([getattr(part, name) for _, part in done], axis=1)[:, order]
            for name in Local.__dataclass_fields__
        }
    )
    return Cells(index, owner[order], last.side, last.origin, local, speed_moments(local, problems.priors))

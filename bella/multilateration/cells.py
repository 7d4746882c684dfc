"""Adaptive cells that hold the whole posterior of a position, none of its modes lost.

Space is divided into equal squares that are halved until the density changes little across one. A cell is dropped only
when an upper bound of the density anywhere in it is far below the best value found: the root of the misfit is Lipschitz
in x with constant sqrt(W) u_max, because distances change by no more than the source moves. All final cells of a
problem have one size, so that the midpoint rule on them is accurate far beyond its order.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bella.exceptions import ConvergenceError
from bella.multilateration.likelihood import IntArray, Local, Problems, evaluate, sharpness
from bella.units import FloatArray

BoolArray = npt.NDArray[np.bool_]

BOX_TAU = 6.0
"""Half width of the first box, in prior standard deviations."""
FIRST_CELLS = 16
"""Cells per axis at the start."""
DROP_NATS = 16.0
"""A cell is dropped when its bound is this far below the best density."""
FINE_NATS = 8.0
"""Cells whose bound is within this of the best density decide when to stop."""
TOLERANCE = 0.7
"""Largest half diagonal of a final cell, in local standard deviations."""
SLOWNESS_RANGE_SD = 4.0
"""The bound holds for slownesses within this many prior standard deviations."""
LOG_SLACK = 0.3
"""Allowance for the slow change of log P across a cell, nats."""
MAX_CELLS = 1_000_000
"""Most cells of one problem; more is an error, never a silent cut."""
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
    """

    local: Local


def divide(problems: Problems, *, tolerance: float = TOLERANCE) -> Cells:
    """Divide space until every problem's cells resolve its posterior.

    Parameters
    ----------
    problems : Problems
    tolerance : float
        Largest half diagonal of a final cell, in local standard deviations.

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
    done: list[Cells] = []
    while lattice.owner.size:
        local = evaluate(problems, lattice.centres, lattice.owner)
        np.maximum.at(best, lattice.owner, local.log_density)
        deficit = best[lattice.owner] - _upper_bound(problems, lattice, local)
        fine = _is_fine(problems, lattice, deficit < FINE_NATS, tolerance)[lattice.owner]
        kept = deficit < DROP_NATS
        done.append(_pick(lattice, local, kept & fine))
        lattice = _halved(lattice, kept & ~fine)
    return _gathered(done, lattice)


def _first_lattice(problems: Problems) -> Lattice:
    origin = -BOX_TAU * problems.priors.tau_rsun
    index = np.indices((FIRST_CELLS,) * problems.dimensions).reshape(problems.dimensions, -1)
    return Lattice(
        np.tile(index, problems.count),
        np.repeat(np.arange(problems.count), index.shape[1]),
        np.full(problems.count, -2 * origin / FIRST_CELLS),
        origin,
    )


def _upper_bound(problems: Problems, lattice: Lattice, local: Local) -> FloatArray:
    """Bound of the log density anywhere in each cell, shape (M,)."""
    priors = problems.priors
    reach = lattice.half_diagonal[lattice.owner]
    slowest = priors.slowness_mean + SLOWNESS_RANGE_SD * priors.slowness_sd
    change = np.sqrt(problems.total_weight)[lattice.owner] * slowest * reach
    misfit = np.maximum(np.sqrt(np.maximum(local.misfit, 0)) - change, 0) ** 2
    radius = np.sqrt((lattice.centres**2).sum(axis=0))
    prior = (np.maximum(radius - reach, 0) / priors.tau_rsun) ** 2
    log_precision = -2 * np.log(local.slowness_sd / priors.slowness_sd)
    return np.asarray(-0.5 * (misfit + prior + log_precision) + LOG_SLACK)


def _is_fine(problems: Problems, lattice: Lattice, high: BoolArray, tolerance: float) -> BoolArray:
    """Which problems have cells that are small against the posterior they resolve, shape (B,)."""
    sharpest = np.zeros(problems.count)
    np.maximum.at(sharpest, lattice.owner[high], sharpness(problems, lattice.centres[:, high], lattice.owner[high]))
    return np.asarray(sharpest * lattice.half_diagonal <= tolerance)


def _halved(lattice: Lattice, chosen: BoolArray) -> Lattice:
    dimensions = lattice.index.shape[0]
    corner = np.indices((2,) * dimensions).reshape(dimensions, -1)
    index = (2 * lattice.index[:, chosen, None] + corner[:, None, :]).reshape(dimensions, -1)
    owner = np.repeat(lattice.owner[chosen], 2**dimensions)
    counts = np.bincount(owner, minlength=lattice.side.size)
    _check_budget(counts)
    return Lattice(index, owner, np.where(counts > 0, lattice.side / 2, lattice.side), lattice.origin)


def _check_budget(counts: IntArray) -> None:
    most = MAX_CELLS if counts.size == 1 else MAX_CELLS_TOGETHER
    if counts.sum() > most:
        raise ConvergenceError(
            f"the posterior needs more than {most} cells; give its arrival times larger sigma_s, or leave it out"
        )


def _pick(lattice: Lattice, local: Local, chosen: BoolArray) -> Cells:
    values = {name: getattr(local, name)[chosen] for name in Local.__dataclass_fields__}
    return Cells(lattice.index[:, chosen], lattice.owner[chosen], lattice.side, lattice.origin, Local(**values))


def _gathered(done: list[Cells], last: Lattice) -> Cells:
    owner = np.concatenate([part.owner for part in done])
    if np.bincount(owner, minlength=last.side.size).min() == 0:
        raise ConvergenceError(
            "no position explains the arrival times within sigma_s; check them, give larger sigma_s, or leave it out"
        )
    order = np.argsort(owner, kind="stable")
    index = np.concatenate([part.index for part in done], axis=1)[:, order]
    values = {
        name: np.concatenate([getattr(part.local, name) for part in done])[order] for name in Local.__dataclass_fields__
    }
    return Cells(index, owner[order], last.side, last.origin, Local(**values))

"""Covariance of the exact posterior at many nodes, each with the arrival times that a source there would cause."""

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from bella.arrivals import ArrivalGrid
from bella.exceptions import ConvergenceError
from bella.multilateration.cells import divide
from bella.multilateration.posterior import moments_of
from bella.multilateration.priors import Priors
from bella.multilateration.problems import problems_of
from bella.units import C_RSUN_S, FloatArray

MAP_TOLERANCE = 1.7
MAP_DROP_NATS = 10.0
"""Longest edge of a cell in local standard deviations, and how far below the best density cells are dropped: without
draws the standard deviations hold to a thousandth."""
BATCH = 25
"""Nodes treated together."""
NODES_PER_TASK = 100
"""Nodes handed to a process at a time; also the step of the progress."""
NODES_WORTH_A_POOL = 4000
"""Below this, starting processes takes longer than they save."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of the processes: each is one core's work."""


@dataclass(frozen=True)
class Receivers:
    """What hears the bursts.

    Attributes
    ----------
    observatories : tuple of str, length n
    position_rsun : ndarray, shape (n, 3)
        Solar radii, HEE.
    sigma_s : ndarray, shape (n,)
        Timing error, s.
    correlation : ndarray, shape (n, n), optional
        Of the timing errors; none if left out.
    """

    observatories: tuple[str, ...]
    position_rsun: FloatArray
    sigma_s: FloatArray
    correlation: FloatArray | None = None


def exact_covariance(
    points: FloatArray,
    receivers: Receivers,
    priors: Priors,
    *,
    processes: int | None = None,
    advance: Callable[[int], None] = lambda _: None,
) -> FloatArray:
    """Covariance of the exact posterior of noise-free arrival times, for sources at given points of the ecliptic plane.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        True positions, solar radii, HEE.
    receivers : Receivers
    priors : Priors
    processes : int, optional
        Most processes to use; all cores when left out. They are spawned: a script that asks for more than one keeps its
        own work under ``if __name__ == "__main__"``.
    advance : callable
        Told how many nodes are done since the last call.

    Returns
    -------
    ndarray, shape (N, 2, 2)
        Square solar radii.

    Raises
    ------
    ConvergenceError
        If the posterior of a node is too sharp for the cells that may be spent on it (names the node), or a process was
        ended from outside.
    """
    tasks = [(points[first : first + NODES_PER_TASK], receivers, priors) for first in _starts(len(points))]
    cores = processes if processes is not None else os.cpu_count() or 1
    alone = cores < 2 or len(points) < NODES_WORTH_A_POOL
    parts = []
    for part in map(_task, tasks) if alone else _in_processes(tasks, cores):
        parts.append(part)
        advance(len(part))
    return np.concatenate(parts) if parts else np.empty((0, 2, 2))


Task = tuple[FloatArray, Receivers, Priors]


def _starts(count: int) -> range:
    return range(0, count, NODES_PER_TASK)


def _in_processes(tasks: list[Task], cores: int) -> Iterator[FloatArray]:
    # spawned: a fork of a process with threads, such as a progress bar's, may inherit a lock that nobody opens
    context = multiprocessing.get_context("spawn")
    with _environment(ONE_THREAD), ProcessPoolExecutor(min(cores, len(tasks)), mp_context=context) as pool:
        try:
            yield from pool.map(_task, tasks)
        except BrokenProcessPool as error:
            raise ConvergenceError(
                "a process that computed the map was ended from outside, for want of memory perhaps; try again"
            ) from error
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Set variables for the processes that are started within; what the user has set stays."""
    added = {name: value for name, value in values.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)


def _task(task: Task) -> FloatArray:
    points, receivers, priors = task
    return np.concatenate(list(_batches(noise_free_arrivals(points, receivers), points, priors)))


def _batches(grid: ArrivalGrid, points: FloatArray, priors: Priors) -> Iterator[FloatArray]:
    """Covariances of `BATCH` nodes at a time, or of fewer once they need many cells."""
    problems = problems_of(grid, priors, 2)
    first, size = 0, BATCH
    while first < problems.count:
        some = problems.at(slice(first, first + size))
        try:
            cells = divide(some, tolerance=MAP_TOLERANCE, drop_nats=MAP_DROP_NATS)
        except ConvergenceError as error:
            if some.count == 1:
                x, y = points[first]
                raise ConvergenceError(
                    f"the exact posterior at node x = {x:g}, y = {y:g} Rsun is too sharp to compute; "
                    "give larger timing errors (--sigma)"
                ) from error
            size = some.count // 2
            continue
        yield moments_of(some, cells).covariance
        first += some.count


def noise_free_arrivals(points: FloatArray, receivers: Receivers) -> ArrivalGrid:
    """Arrival times of a source at each point that emits at 0 s, as if each were a frequency of one burst.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        True positions in the ecliptic plane, solar radii, HEE.
    receivers : Receivers

    Returns
    -------
    ArrivalGrid
        N frequencies that mean nothing.
    """
    shape = (len(points), len(receivers.observatories))
    sources = np.column_stack([points, np.zeros(len(points))])
    distances = np.linalg.norm(sources[:, None, :] - receivers.position_rsun, axis=2)
    measured = None
    if receivers.correlation is not None:
        measured = np.zeros((*shape, *shape))
        place = np.arange(shape[0])
        measured[place, :, place] = np.outer(receivers.sigma_s, receivers.sigma_s) * receivers.correlation
    return ArrivalGrid(
        frequency_mhz=np.arange(1.0, len(points) + 1),
        observatories=receivers.observatories,
        arrival_s=distances / C_RSUN_S,
        sigma_s=np.broadcast_to(receivers.sigma_s, shape),
        receiver_rsun=np.broadcast_to(receivers.position_rsun, (*shape, 3)),
        reference_utc=np.datetime64("2000-01-01", "ns"),
        edge="noise_free",
        measured_s2=measured,
    )

"""How well a fleet places a source, everywhere in the ecliptic plane: the uncertainty map.

The closed form draws half a million nodes a second but knows nothing of the curvature of the problem: beyond the
receivers, and for receivers nearly in line, it is off by a factor. So it is held against the exact posterior, on all
nodes or on a coarse lattice, and where the two differ by more than `Thresholds.closed_form_off` the map says so.
"""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

import bella
from bella.arrivals import FARTHEST_RECEIVER_RSUN, MIN_OBSERVATORIES, ArrivalGrid, check_covariance
from bella.exceptions import ConvergenceError, GeometryError, InputError
from bella.multilateration.cells import divide
from bella.multilateration.likelihood import slope_and_information
from bella.multilateration.posterior import moments_of
from bella.multilateration.priors import CADENCE_S, THRESHOLDS, Priors
from bella.multilateration.problems import BLOCK, problems_of
from bella.threads import ONE_THREAD
from bella.units import C_RSUN_S, FloatArray

MAP_TOLERANCE = 1.3
MAP_DROP_NATS = 10.5
"""Longest edge of a cell in local standard deviations, and how far below the best density cells are dropped: without
draws the standard deviations hold to a thousandth."""
NODES_TOGETHER = 100
"""Nodes treated together."""
NODES_PER_TASK = 100
"""Nodes handed to a process at a time; also the step of the progress."""
NODES_WORTH_A_POOL = 4000
"""Below this, starting processes takes longer than they save."""

SIZES = (2, 2000)
"""Fewest and most nodes per axis."""
HALF_WIDTH_RSUN = 310.0
"""Half width of the map of Canizares et al. (2024)."""
COARSE_SIZE = 41
"""Nodes per axis of the lattice on which a map without exact nodes is checked."""
SHORTEST_SIGMA_S = 0.1
"""Sharper timing is more than the exact posterior is made for."""
FORMAT_VERSION = 1

Advance = Callable[[int], None]


@dataclass(frozen=True)
class Receivers:
    """What hears the bursts.

    Attributes
    ----------
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


@dataclass(frozen=True)
class Square:
    """Nodes of a square map centred on the Sun: `size` per axis, the outermost on its edge."""

    size: int
    half_width_rsun: float

    @property
    def axis(self) -> FloatArray:
        """Coordinates along one axis, shape (size,), solar radii."""
        return np.linspace(-self.half_width_rsun, self.half_width_rsun, self.size)

    @property
    def points(self) -> FloatArray:
        """All nodes, shape (size^2, 2), row by row of constant y."""
        return np.stack(np.meshgrid(self.axis, self.axis), axis=-1).reshape(-1, 2)


def exact_nodes(size: int, *, exact: bool) -> int:
    """How many exact posteriors a map takes: what `advance` counts up to.

    Parameters
    ----------
    size : int
        Nodes per axis of the map.
    """
    return (size if exact else min(size, COARSE_SIZE)) ** 2


def timing_errors(observatories: tuple[str, ...], given: Mapping[str, float] | float | None) -> FloatArray:
    """Timing error of each observatory, where left out the cadence of its receiver.

    Parameters
    ----------
    observatories : tuple of str, length n
    given : mapping of str to float, or float, or None
        s; one number holds for all.

    Returns
    -------
    ndarray, shape (n,)
        s.

    Raises
    ------
    InputError
        If a number is not above 0, names no observatory of the map, or is missing for one whose cadence is not known.
    """
    own = dict(given or {}) if given is None or isinstance(given, Mapping) else dict.fromkeys(observatories, given)
    known, strange = CADENCE_S | own, set(own) - set(observatories)
    if strange:
        raise InputError(
            f"a timing error is given for {min(strange)}, which is not in the map; it has {', '.join(observatories)}"
        )
    unknown = [name for name in observatories if name not in known]
    if unknown:
        raise InputError(f"no timing error is known for {unknown[0]}; give one, as in --sigma {unknown[0]}=30")
    sigma_s = np.array([known[name] for name in observatories], dtype=np.float64)
    for name, value in zip(observatories, sigma_s, strict=True):
        if not SHORTEST_SIGMA_S <= value <= 86_400:
            raise InputError(f"a timing error of {value:g} s for {name} is not between {SHORTEST_SIGMA_S:g} and 86400")
    return sigma_s


def uncertainty_map(  # noqa: PLR0913
    receivers: Mapping[str, npt.ArrayLike],
    sigma_s: Mapping[str, float] | float | None,
    priors: Priors,
    *,
    size: int = 500,
    half_width_rsun: float = HALF_WIDTH_RSUN,
    exact: bool = False,
    correlation: npt.ArrayLike | None = None,
    epoch: np.datetime64 | None = None,
    processes: int | None = None,
    advance: Advance = lambda _: None,
) -> xr.Dataset:
    """Standard deviations of the position of a source at every node of a map, from noise-free arrival times.

    The quantity of Canizares et al. (2024, A&A, doi:10.1051/0004-6361/202347747), Fig. 4.

    Parameters
    ----------
    receivers : mapping of str to array_like, shape (3,)
        HEE position of each observatory, solar radii; three or more.
    sigma_s : mapping of str to float, or float, or None
        Timing errors, s; the cadence of the receiver where left out and known.
    priors : Priors
    size : int
        Nodes per axis.
    half_width_rsun : float
        Half width of the map, solar radii.
    exact : bool
        Compute the exact posterior at every node, beside the closed form. Without it the closed form is checked on
        `COARSE_SIZE` x `COARSE_SIZE` nodes and the ratio interpolated.
    correlation : array_like, shape (n, n), optional
        Of the timing errors between the observatories, in their order; none if left out.
    epoch : numpy.datetime64, optional
        UTC of the HEE axes, to be stored.
    processes : int, optional
        Most processes for an exact map; see :func:`exact_covariance`.
    advance : callable
        Told how many of the :func:`exact_nodes` are done since the last call.

    Returns
    -------
    xarray.Dataset
        Dims y, x; ``sd_x_rsun``, ``sd_y_rsun``, ``cov_xy_rsun2``, ``sd_largest_rsun`` (along the worst direction) in
        closed form, the same with ``exact_`` before where asked for, ``closed_form_over_exact`` and
        ``closed_form_off``; the receivers, and in the attributes frame, epoch, priors and versions.

    Raises
    ------
    InputError
        If positions, timing errors, size or half width cannot be used.
    GeometryError
        If all receivers are at one place.
    ConvergenceError
        If the exact posterior of a node is too sharp to compute.
    """
    square = _square(size, half_width_rsun)
    fleet = _fleet(receivers, sigma_s, correlation)
    closed = closed_form_covariance(square.points, fleet, priors)
    lattice = Square(size if exact else min(size, COARSE_SIZE), half_width_rsun)
    held_against = exact_covariance(lattice.points, fleet, priors, processes=processes, advance=advance)
    ratio = _ratio(lattice, held_against, fleet, priors)
    variables = _summary(closed, square, "", "closed form") | _check(_interpolated(ratio, lattice, square))
    if exact:
        variables |= _summary(held_against, square, "exact_", "exact posterior")
    attributes = _provenance(priors, lattice, exact=exact, epoch=epoch)
    return xr.Dataset(variables | _receiver_variables(fleet), _coordinates(square, fleet), attributes)


def _square(size: int, half_width_rsun: float) -> Square:
    low, high = SIZES
    if not low <= size <= high:
        raise InputError(f"a map of {size} nodes per axis cannot be made; ask for {low} to {high}")
    if not 0 < half_width_rsun <= FARTHEST_RECEIVER_RSUN:
        raise InputError(f"half width {half_width_rsun:g} Rsun is not above 0 and at most {FARTHEST_RECEIVER_RSUN:g}")
    return Square(size, half_width_rsun)


def _fleet(
    receivers: Mapping[str, npt.ArrayLike],
    sigma_s: Mapping[str, float] | float | None,
    correlation: npt.ArrayLike | None,
) -> Receivers:
    names = tuple(receivers)
    if len(names) < MIN_OBSERVATORIES:
        received = ", ".join(names) or "no spacecraft"
        raise InputError(f"only {received}; a map needs the positions of {MIN_OBSERVATORIES} or more spacecraft")
    for name in names:
        position = np.asarray(receivers[name], dtype=np.float64)
        if position.shape != (3,) or not (np.abs(position) <= FARTHEST_RECEIVER_RSUN).all():
            raise InputError(f"the position of {name} is not x, y, z in solar radii within 100 au; correct it")
    positions = np.array([receivers[name] for name in names], dtype=np.float64)
    if (positions == positions[0]).all():
        raise GeometryError("all spacecraft are at one place, and hear every source alike; give their own positions")
    if correlation is None:
        return Receivers(names, positions, timing_errors(names, sigma_s))
    matrix = np.asarray(correlation, dtype=np.float64)
    check_covariance(matrix, len(names), source="correlation")
    if not np.allclose(np.diag(matrix), 1):
        raise InputError("correlation: its diagonal is not 1; give correlations, and timing errors with --sigma")
    return Receivers(names, positions, timing_errors(names, sigma_s), matrix)


def _ratio(lattice: Square, exact: FloatArray, fleet: Receivers, priors: Priors) -> FloatArray:
    """Closed form over exact, by the larger of sd_x and sd_y, shape (size, size)."""
    closed = closed_form_covariance(lattice.points, fleet, priors)
    variances = [np.einsum("...ii->...i", covariance).max(axis=-1) for covariance in (closed, exact)]
    return np.asarray(np.sqrt(variances[0] / variances[1]).reshape(lattice.size, lattice.size))


def _interpolated(ratio: FloatArray, lattice: Square, square: Square) -> FloatArray:
    if lattice.size == square.size:
        return ratio
    # in the logarithm: the ratio is off by a factor, up or down
    smooth = RegularGridInterpolator((lattice.axis, lattice.axis), np.log(ratio))
    return np.asarray(np.exp(smooth(square.points[:, ::-1])).reshape(square.size, square.size))


Variable = tuple[tuple[str, ...], npt.NDArray[np.generic], dict[str, object]]


def _summary(covariance: FloatArray, square: Square, prefix: str, method: str) -> dict[str, Variable]:
    values = {
        "sd_x_rsun": (np.sqrt(covariance[:, 0, 0]), "Rsun", "standard deviation of the source along HEE X"),
        "sd_y_rsun": (np.sqrt(covariance[:, 1, 1]), "Rsun", "standard deviation of the source along HEE Y"),
        "cov_xy_rsun2": (covariance[:, 0, 1], "Rsun2", "covariance of the source along HEE X and Y"),
        "sd_largest_rsun": (largest_sd(covariance), "Rsun", "standard deviation of the source in its worst direction"),
    }
    return {
        prefix + name: _on_map(array.reshape(square.size, square.size), units, f"{words}, {method}")
        for name, (array, units, words) in values.items()
    }


def _check(ratio: FloatArray) -> dict[str, Variable]:
    off = np.maximum(ratio, 1 / ratio) > 1 + THRESHOLDS.closed_form_off
    limit = f"{THRESHOLDS.closed_form_off:.0%}"
    words = f"closed form and exact posterior differ by more than {limit} in the larger of sd_x and sd_y"
    return {
        "closed_form_over_exact": _on_map(ratio, "1", "closed form over exact, larger of sd_x and sd_y"),
        "closed_form_off": (("y", "x"), off, {"long_name": words, "flag_meanings": "closed_form_good closed_form_off"}),
    }


def _on_map(values: FloatArray, units: str, long_name: str) -> Variable:
    return ("y", "x"), values, {"units": units, "long_name": long_name}


def _receiver_variables(fleet: Receivers) -> dict[str, Variable]:
    where: dict[str, object] = {"units": "Rsun", "long_name": "HEE position of the receiver"}
    timing: dict[str, object] = {"units": "s", "long_name": "timing error of the receiver"}
    return {
        "receiver_rsun": (("observatory", "xyz"), fleet.position_rsun, where),
        "sigma_s": (("observatory",), fleet.sigma_s, timing),
    }


def _coordinates(square: Square, fleet: Receivers) -> dict[str, object]:
    return {
        "y": ("y", square.axis, {"units": "Rsun", "axis": "Y", "long_name": "true source, HEE Y"}),
        "x": ("x", square.axis, {"units": "Rsun", "axis": "X", "long_name": "true source, HEE X"}),
        "observatory": np.array(fleet.observatories, dtype=str),
        "xyz": np.array(["x", "y", "z"], dtype=str),
    }


def _provenance(
    priors: Priors, lattice: Square, *, exact: bool, epoch: np.datetime64 | None
) -> dict[str, str | float | int]:
    return {
        "Conventions": "CF-1.11",
        "title": "Uncertainty of the apparent source of a radio burst, by its true position in the ecliptic plane",
        "comment": "From noise-free arrival times; no scattering, refraction or error of the receivers' positions.",
        "frame": "HEE",
        "epoch": "not stated" if epoch is None else f"{np.datetime_as_string(epoch, unit='s')}Z",
        "method": "exact posterior and closed form" if exact else "closed form",
        "closed_form_checked_on": f"{lattice.size} x {lattice.size} nodes",
        "dimensions": 2,
        "tau_rsun": priors.tau_rsun,
        "v_prior_sd_over_c": priors.v_sd_c,
        "emission_half_width_s": priors.emission_half_width_s,
        "bella_version": bella.__version__,
        "format_version": FORMAT_VERSION,
    }


def closed_form_covariance(points: FloatArray, receivers: Receivers, priors: Priors) -> FloatArray:
    """Covariance of the position of sources at given points, by the information that data and priors carry there.

    It knows nothing of the curvature of the problem (Fisher information of the model of Canizares et al. 2024,
    doi:10.1051/0004-6361/202347747, as in :func:`bella.multilateration.likelihood.slope_and_information`).

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        True positions in the ecliptic plane, solar radii, HEE.
    priors : Priors
        That of the position counts as the Gaussian with its standard deviation.

    Returns
    -------
    ndarray, shape (N, 2, 2)
        Square solar radii. Finite everywhere, on a receiver too.
    """
    fleet = problems_of(noise_free_arrivals(points[:1], receivers), priors, 2)
    prior = np.eye(2) * priors.position_sd_rsun(2) ** -2.0
    parts = []
    for first in range(0, len(points), BLOCK):
        here = points[first : first + BLOCK].T
        (xx, xy), (_, yy) = slope_and_information(fleet, here)[1][:, :, 0] + prior[..., None]
        parts.append(np.array([[yy, -xy], [-xy, xx]]) / (xx * yy - xy * xy))
    return np.moveaxis(np.concatenate(parts, axis=-1), -1, 0)


def largest_sd(covariance: FloatArray) -> FloatArray:
    """Standard deviation along the direction in which it is largest.

    Parameters
    ----------
    covariance : ndarray, shape (..., 2, 2)
        Square solar radii.

    Returns
    -------
    ndarray, shape (...,)
        Root of the larger eigenvalue, solar radii.
    """
    xx, yy, xy = covariance[..., 0, 0], covariance[..., 1, 1], covariance[..., 0, 1]
    return np.asarray(np.sqrt((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)))


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
    """Covariances of `NODES_TOGETHER` nodes at a time, or of fewer once they need many cells."""
    problems = problems_of(grid, priors, 2)
    first, size = 0, NODES_TOGETHER
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

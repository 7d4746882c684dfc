"""Highest-density credible regions of a position: area, volume, outline and highest point.

A source in the ecliptic plane has regions in the plane. One in space has regions in space, of which the volume is
given; their area and outline are those of the regions of (x, y), whatever z is.
"""

from dataclasses import dataclass, replace

import contourpy
import numpy as np
from scipy import stats

from bella.multilateration.cells import Cells, mixed
from bella.multilateration.likelihood import IntArray, Problems, blocks, density, evaluate
from bella.multilateration.modes import Image, Modes, find_modes, highest
from bella.multilateration.moments import normalised, summed
from bella.multilateration.speed import log_speed_factor, speed_prior_is_gaussian
from bella.units import FloatArray

LEVELS = (0.68, 0.95)
FINER = 4
"""Each cell is divided this many times, at most, along x and y before regions are measured."""
POINTS, PIXELS = 8_000, 40_000
"""Points of a posterior, and of the square image around it, from which on its cells are divided less: a long ridge has
many cells, and the errors that its border makes in the area average out."""
RELEVANT_NATS = 6.0
"""Cells this far below the best are not divided: a Gaussian has its 95 % region within 3 nats in the plane, 4 in space.
What they hold counts in full."""
DRAWS_LATTICE = {2: 80, 3: 28}
"""Lattice points across a posterior that is known by draws only."""
MODE_BANDWIDTH = 0.5
"""Kernel width, in standard deviations, with which modes are counted among draws."""
HIGHEST_CONTOUR = 0.99
"""Share of the highest density above which no contour is drawn: at the very top there is none to draw."""


@dataclass(frozen=True)
class Region:
    """Where one posterior is.

    Attributes
    ----------
    area_rsun2 : tuple of float
        Area of the highest-density region of (x, y) of each of `LEVELS`, square solar radii.
    volume_rsun3 : tuple of float
        Volume of the highest-density region in space, cubic solar radii; NaN for a source in the plane.
    log_threshold : tuple of float
        Log density, as :func:`log_density` gives it, above which a position lies in the region of each of `LEVELS`.
    outlines : tuple of ndarray, each of shape (V, 2)
        Closed polygons around the regions of (x, y), separated by a row of NaN, solar radii.
    mode_rsun : ndarray, shape (D,)
        Position of the highest density.
    modes : Modes
    """

    area_rsun2: tuple[float, ...]
    volume_rsun3: tuple[float, ...]
    log_threshold: tuple[float, ...]
    outlines: tuple[FloatArray, ...]
    mode_rsun: FloatArray
    modes: Modes


@dataclass(frozen=True)
class _Ladder:
    """How many lattice points the region of each level holds, and the log density at its edge."""

    points: tuple[float, ...]
    log_threshold: tuple[float, ...]


def log_density(problems: Problems, points: FloatArray) -> FloatArray:
    """Log density of positions up to a constant of the problem, under the prior of the model.

    Parameters
    ----------
    problems : Problems
        With the trailing shape S of the points, or one that broadcasts against it.
    points : ndarray, shape (D, *S)
        Solar radii.

    Returns
    -------
    ndarray, shape S
    """
    if speed_prior_is_gaussian(problems.priors):
        return mixed(density(problems, points)[0])
    local = evaluate(problems, points)
    return mixed(local.log_density + log_speed_factor(local, problems.priors))


def regions_of(problems: Problems, cells: Cells) -> list[Region]:
    """Credible regions of each problem, from its density on cells divided further.

    Parameters
    ----------
    problems : Problems
    cells : Cells

    Returns
    -------
    list of Region
        One per problem.
    """
    coarse = mixed(cells.log_density)
    first = np.searchsorted(cells.owner, np.arange(problems.count))
    relevant = coarse > np.maximum.reduceat(coarse, first)[cells.owner] - RELEVANT_NATS
    share, _ = normalised(coarse[None], cells.owner, problems.count)
    held = summed(share[0] * relevant, cells.owner, problems.count)
    index, owner = cells.index[:, relevant], cells.owner[relevant]
    finer = _finer(index, np.searchsorted(owner, np.arange(problems.count)))
    parts = [_divided(index[:, owner == b], finer[b]) for b in range(problems.count)]
    pitch = np.tile(cells.side[:, None], (1, problems.dimensions))
    pitch[:, :2] /= finer[:, None]
    cuts = np.cumsum([0] + [part.shape[1] for part in parts])
    owner, index = np.repeat(np.arange(problems.count), np.diff(cuts)), np.concatenate(parts, axis=1)
    points = cells.origin + (index + 0.5) * pitch[owner].T
    fine = np.concatenate([log_density(problems.at(one), points[:, part]) for part, one in blocks(owner)])
    some = [slice(cuts[b], cuts[b + 1]) for b in range(problems.count)]
    return [
        _region(Image.of(index[:, part], fine[part], cells.origin, pitch[b]), fine[part], held[b])
        for b, part in enumerate(some)
    ]


def _finer(index: IntArray, first: IntArray) -> IntArray:
    """In how many parts along x and y the cells of each problem are divided, shape (B,)."""
    extent = [np.maximum.reduceat(axis, first) - np.minimum.reduceat(axis, first) + 3 for axis in index]
    cells = np.diff(first, append=index.shape[1])
    fewest = np.minimum(POINTS / cells, PIXELS / np.prod(extent, axis=0))
    return np.asarray(np.clip(np.sqrt(fewest), 1, FINER).astype(np.intp))


def _divided(index: IntArray, finer: int) -> IntArray:
    """Cells divided along x and y: that is where outlines are drawn; along z the cells are fine enough."""
    corner = np.indices([finer, finer, 1][: len(index)]).reshape(len(index), -1)
    factor = np.array([finer, finer, 1][: len(index)])[:, None, None]
    return np.asarray((factor * index[:, :, None] + corner[:, None, :]).reshape(len(index), -1))


def region_of_draws(positions: FloatArray) -> Region:
    """Credible regions of a posterior known by draws only, from their kernel density.

    The draws are drawn in towards their mean before the kernel widens them, so that the covariance stays what it was
    (West 1993, doi:10.1111/j.2517-6161.1993.tb01911.x). Modes are counted with a wider kernel: the noise of draws has
    many maxima.

    Parameters
    ----------
    positions : ndarray, shape (N, D)
        Solar radii.

    Returns
    -------
    Region
    """
    fine = _kernel_image(positions, len(positions) ** (-1 / (4 + positions.shape[1])))
    region = _region(fine, fine.log_density.ravel())
    return replace(region, modes=find_modes(_kernel_image(positions, MODE_BANDWIDTH)))


def _kernel_image(positions: FloatArray, bandwidth: float) -> Image:
    shrunk = positions.mean(axis=0) + (positions - positions.mean(axis=0)) / np.hypot(1, bandwidth)
    low, high = positions.min(axis=0), positions.max(axis=0)
    dimensions = positions.shape[1]
    pitch = (high - low) / DRAWS_LATTICE[dimensions]
    shape = (DRAWS_LATTICE[dimensions] + 5,) * dimensions
    corner = low - 2 * pitch
    points = corner[:, None] + np.indices(shape).reshape(dimensions, -1) * pitch[:, None]
    kernel = stats.gaussian_kde(shrunk.T, bw_method=bandwidth)
    return Image(kernel.logpdf(points).reshape(shape), corner, pitch)


def _region(image: Image, density: FloatArray, held: float = 1.0) -> Region:
    """Region of an image that holds a share of the whole probability, from its finite values."""
    ladder = _ladder(density, held)
    flat = _seen_from_north(image)
    seen = ladder if flat is image else _ladder(flat.log_density[np.isfinite(flat.log_density)], held)
    cell = np.nan if flat is image else float(np.prod(image.pitch))
    return Region(
        area_rsun2=tuple(points * float(np.prod(flat.pitch)) for points in seen.points),
        volume_rsun3=tuple(points * cell for points in ladder.points),
        log_threshold=ladder.log_threshold,
        outlines=_outlines(flat, seen.log_threshold),
        mode_rsun=highest(image),
        modes=find_modes(image),
    )


def _seen_from_north(image: Image) -> Image:
    """Density of (x, y), whatever z is."""
    if image.log_density.ndim == 2:
        return image
    with np.errstate(divide="ignore"):
        top = image.log_density.max()
        flat = top + np.log(np.exp(image.log_density - top).sum(axis=2))
    return Image(flat, image.corner[:2], image.pitch[:2])


def _ladder(density: FloatArray, held: float) -> _Ladder:
    """Number of the densest points that hold each level of the probability, of which all points hold a share."""
    falling = np.sort(density)[::-1]
    mass = np.exp(falling - falling[0])
    running = np.cumsum(mass)
    points, thresholds = [], []
    for level in LEVELS:
        wanted = min(level / held, 1.0) * running[-1]
        last = min(int(np.searchsorted(running, wanted)), running.size - 1)
        before = running[last - 1] if last else 0.0
        points.append(last + float((wanted - before) / mass[last]))
        thresholds.append(float(falling[last]))
    return _Ladder(tuple(points), tuple(thresholds))


def _outlines(image: Image, thresholds: tuple[float, ...]) -> tuple[FloatArray, ...]:
    """Contours of the density, drawn in the density itself: the logarithm has no value outside the cells."""
    top = image.log_density.max()
    generator = contourpy.contour_generator(z=np.exp(image.log_density - top).T)
    return tuple(
        image.place(_joined(generator.lines(min(float(np.exp(threshold - top)), HIGHEST_CONTOUR))))
        for threshold in thresholds
    )


def _joined(lines: list[FloatArray]) -> FloatArray:
    """One array of several lines, parted by NaN."""
    parted = [row for line in lines for row in (np.asarray(line), np.full((1, 2), np.nan))]
    return np.concatenate(parted[:-1]) if parted else np.empty((0, 2))

"""Highest-density credible regions of a position: area, volume, outline, highest point, and separate modes.

A source in the ecliptic plane has regions in the plane. One in space has regions in space, of which the volume is
given; their area and outline are those of the regions of (x, y), whatever z is.
"""

from dataclasses import dataclass, replace
from itertools import product

import contourpy
import numpy as np
from scipy import stats

from bella.exceptions import ConvergenceError
from bella.multilateration.axes import Axes
from bella.multilateration.cells import Cells, normalised, summed
from bella.multilateration.likelihood import density, evaluate, mixed
from bella.multilateration.priors import THRESHOLDS
from bella.multilateration.problems import IntArray, Problems, blocks
from bella.multilateration.speed import log_speed_factor, speed_prior_is_gaussian
from bella.units import FloatArray

LEVELS = (0.68, 0.95)
FINER = 6
"""Each cell is divided this many times, at most, along x and y before regions are measured."""
POINTS, PIXELS = 4_000, 40_000
"""Points of a posterior, and of the square image around it, from which on its cells are divided less: a long ridge has
many cells, and the errors that its border makes in the area average out."""
MOST_PIXELS = 30_000_000
"""Largest image, 240 MB: only a ridge with errors of microseconds needs more."""
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
class Image:
    """Log density on a regular lattice around one posterior; -inf where it is negligible, and along the border.

    Attributes
    ----------
    corner : ndarray, shape (D,)
        Place of the first lattice point along the axes of the lattice, solar radii.
    pitch : ndarray, shape (D,)
        Distance of lattice points along each axis, solar radii.
    axes : Axes
        Of the lattice, B = 1.
    """

    log_density: FloatArray
    corner: FloatArray
    pitch: FloatArray
    axes: Axes

    @classmethod
    def of(cls, index: IntArray, density: FloatArray, origin: FloatArray, pitch: FloatArray, axes: Axes) -> "Image":
        """Image of the points with some coordinates (D, M) on a lattice whose first cell begins at an origin."""
        low = index.min(axis=1) - 1
        shape = index.max(axis=1) - low + 2
        if np.prod(shape) > MOST_PIXELS:
            raise ConvergenceError("the posterior is too narrow to draw; give its arrival times larger sigma_s")
        lattice = np.full(shape, -np.inf)
        lattice[tuple(index - low[:, None])] = density
        return cls(lattice, origin + (low + 0.5) * pitch, pitch, axes)

    def place(self, index: FloatArray) -> FloatArray:
        """Position of lattice coordinates, solar radii."""
        along = np.atleast_2d(self.corner + index * self.pitch).T
        return self.axes.place(along, slice(0, 1)).T.reshape(np.shape(index))

    def size(self, index: IntArray) -> FloatArray:
        """Area, or volume, of lattice cells with some coordinates (N, D), square or cubic solar radii."""
        along = (self.corner + index * self.pitch).T
        return np.asarray(np.prod(self.pitch) * np.exp(self.axes.log_area(along, slice(0, 1))))


@dataclass(frozen=True)
class Modes:
    """Modes in the order of their weight.

    Attributes
    ----------
    mean_rsun : ndarray, shape (J, D)
        Mean position of each, solar radii.
    weight : ndarray, shape (J,)
        Share of the probability in the basin of each; they add up to one.
    """

    mean_rsun: FloatArray
    weight: FloatArray


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
    """

    area_rsun2: tuple[float, ...]
    volume_rsun3: tuple[float, ...]
    log_threshold: tuple[float, ...]
    outlines: tuple[FloatArray, ...]
    mode_rsun: FloatArray
    modes: Modes


@dataclass(frozen=True)
class _Ladder:
    """Area or volume of the region of each level, and the log density at its edge."""

    size: tuple[float, ...]
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
    return mixed(component_density(problems, points))


def component_density(problems: Problems, points: FloatArray) -> FloatArray:
    """Log density as from :func:`log_density`, of each component of the noise: shape (K, *S)."""
    if speed_prior_is_gaussian(problems.priors):
        return density(problems, points)
    local = evaluate(problems, points)
    return local.log_density + log_speed_factor(local, problems.priors)


def regions_of(problems: Problems, cells: Cells) -> list[Region]:
    """Credible regions of each problem, from its density on cells divided further.

    Returns
    -------
    list of Region
        One per problem.
    """
    coarse, mass = mixed(cells.log_density), mixed(cells.log_mass)
    first = np.searchsorted(cells.owner, np.arange(problems.count))
    relevant = coarse > np.maximum.reduceat(coarse, first)[cells.owner] - RELEVANT_NATS
    share, _ = normalised(mass[None], cells.owner, problems.count)
    held = summed(share[0] * relevant, cells.owner, problems.count)
    index, owner = cells.index[:, relevant], cells.owner[relevant]
    finer = _finer(index, np.searchsorted(owner, np.arange(problems.count)))
    parts = [_divided(index[:, owner == b], finer[b]) for b in range(problems.count)]
    pitch = cells.side.copy()
    pitch[:2] /= finer
    cuts = np.cumsum([0] + [part.shape[1] for part in parts])
    owner, index = np.repeat(np.arange(problems.count), np.diff(cuts)), np.concatenate(parts, axis=1)
    finer_lattice = replace(cells, side=pitch)
    points = finer_lattice.place(index + 0.5, owner)
    fine = np.concatenate([log_density(problems.at(one), points[:, part]) for part, one in blocks(owner)])
    some = [slice(cuts[b], cuts[b + 1]) for b in range(problems.count)]
    return [
        _region(Image.of(index[:, part], fine[part], cells.origin[:, b], pitch[:, b], cells.axes.one(b)), held[b])
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
    """
    region = _region(_kernel_image(positions, len(positions) ** (-1 / (4 + positions.shape[1]))))
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
    return Image(kernel.logpdf(points).reshape(shape), corner, pitch, Axes.straight(np.array([[1.0], [0.0]])))


def _region(image: Image, held: float = 1.0) -> Region:
    """Region of an image that holds a share of the whole probability."""
    ladder = _ladder(image, held)
    flat = _seen_from_north(image)
    seen = ladder if flat is image else _ladder(flat, held)
    return Region(
        area_rsun2=seen.size,
        volume_rsun3=(np.nan,) * len(LEVELS) if flat is image else ladder.size,
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
    return Image(flat, image.corner[:2], image.pitch[:2], image.axes)


def _ladder(image: Image, held: float) -> _Ladder:
    """Size of the densest region that holds each level of the probability, of which the image holds a share."""
    index = np.argwhere(np.isfinite(image.log_density))
    density = image.log_density[tuple(index.T)]
    order = np.argsort(-density)
    falling, size = density[order], image.size(index)[order]
    mass = np.exp(falling - falling[0]) * size
    running, covered = np.cumsum(mass), np.cumsum(size)
    sizes, thresholds = [], []
    for level in LEVELS:
        wanted = min(level / held, 1.0) * running[-1]
        last = min(int(np.searchsorted(running, wanted)), running.size - 1)
        sizes.append(float(covered[last] - (running[last] - wanted) / mass[last] * size[last]))
        thresholds.append(float(falling[last]))
    return _Ladder(tuple(sizes), tuple(thresholds))


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


def highest(image: Image) -> FloatArray:
    """Highest lattice point, moved to the top of the parabola through its neighbours along each axis, shape (D,)."""
    dimensions = image.log_density.ndim
    top = np.unravel_index(int(image.log_density.argmax()), image.log_density.shape)
    shift = np.zeros(dimensions)
    for axis in range(dimensions):
        step = np.eye(dimensions, dtype=int)[axis]
        below, above = (float(image.log_density[tuple(top + sign * step)]) for sign in (-1, 1))
        curvature = below + above - 2 * float(image.log_density[top])
        if np.isfinite(curvature) and curvature < 0:
            shift[axis] = np.clip(0.5 * (below - above) / curvature, -0.5, 0.5)
    return image.place(np.array(top) + shift)


def find_modes(image: Image) -> Modes:
    """Modes of a posterior and their weights.

    Every point belongs to the maximum that steepest ascent leads to. A narrow ridge across the lattice has many maxima
    that only the lattice makes: a maximum counts when every way to a higher one leads down by
    `Thresholds.mode_depth_nats`. One that does not count joins the basin across its highest saddle.
    """
    shape = image.log_density.shape
    inner = np.pad(image.log_density, 1, constant_values=-np.inf)
    flat = np.flatnonzero(np.isfinite(inner))
    value = inner.ravel()[flat]
    place = np.full(inner.size, value.size)
    place[flat] = np.arange(value.size)
    strides = np.cumprod((1, *inner.shape[:0:-1]))[::-1]
    steps = np.array([step for step in product((-1, 0, 1), repeat=len(shape)) if any(step)]) @ strides
    neighbours = place.take(flat + steps[:, None])
    around = np.append(value, -np.inf).take(neighbours)
    index = np.stack(np.unravel_index(flat, inner.shape), axis=-1) - 1
    place_rsun, mass = image.place(index.astype(np.float64)), np.exp(value - value.max()) * image.size(index)
    if np.count_nonzero(around.max(axis=0) <= value) == 1:
        return Modes((mass @ place_rsun / mass.sum())[None], np.ones(1))
    basin = _basins(value, neighbours, around)
    joined = _merged(value, neighbours, basin)
    return _of_basins(place_rsun, value, mass, joined[basin])


def _basins(value: FloatArray, neighbours: IntArray, around: FloatArray) -> IntArray:
    """Maximum, as a point, that steepest ascent from each point ends in."""
    best = around.argmax(axis=0)
    point = np.arange(value.size)
    upward = np.where(around[best, point] > value, neighbours[best, point], point)
    while not np.array_equal(upward[upward], upward):
        upward = upward[upward]
    return upward


def _merged(value: FloatArray, neighbours: IntArray, basin: IntArray) -> IntArray:
    """Point that stands for the mode of each maximum, shape (M,); saddles are taken from the highest down."""
    stands = np.arange(value.size)
    maxima = np.flatnonzero(basin == stands)
    if maxima.size == 1:
        return stands
    across = np.append(basin, -1)[neighbours]
    step, point = np.nonzero((across >= 0) & (across < basin))
    saddle = np.minimum(value[point], value[neighbours[step, point]])
    order = np.argsort(-saddle, kind="stable")
    one, other = basin[point[order]], across[step[order], point[order]]
    _, once = np.unique(one * value.size + other, return_index=True)
    for which in np.sort(once):
        low, high = sorted((_root(stands, int(one[which])), _root(stands, int(other[which]))), key=value.__getitem__)
        shallow = value[low] - saddle[order[which]] < THRESHOLDS.mode_depth_nats
        if shallow or value[low] < value.max() - THRESHOLDS.mode_nats:
            stands[low] = high
    stands[maxima] = [_root(stands, int(maximum)) for maximum in maxima]
    return stands


def _root(stands: IntArray, maximum: int) -> int:
    while stands[maximum] != maximum:
        maximum = int(stands[maximum])
    return maximum


def _of_basins(place_rsun: FloatArray, value: FloatArray, mass: FloatArray, mode: IntArray) -> Modes:
    """Mean and weight of each mode."""
    found, number = np.unique(mode, return_inverse=True)
    weight = np.bincount(number, mass)
    mean = np.stack([np.bincount(number, mass * axis) for axis in place_rsun.T], axis=1) / weight[:, None]
    order = np.argsort(-weight, kind="stable")
    kept = order[value[found[order]] >= value.max() - THRESHOLDS.mode_nats]
    return Modes(mean[kept], weight[kept] / weight[kept].sum())

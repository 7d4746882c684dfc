"""Highest-density credible regions of a position in the plane: their area, outline, mode, and number of modes."""

from dataclasses import dataclass, replace

import contourpy
import numpy as np
from scipy import ndimage, stats

from bella.multilateration.cells import Cells
from bella.multilateration.likelihood import IntArray, Problems, evaluate, log_speed_factor
from bella.multilateration.moments import normalised
from bella.units import FloatArray

LEVELS = (0.68, 0.95)
FINER = 3
"""Each cell is divided this many times along each axis before regions are measured."""
RELEVANT_NATS = 8.0
"""Cells this far below the best hold less than 4e-4 of a Gaussian posterior."""
DRAWS_LATTICE = 80
"""Lattice points across a posterior that is known by draws only."""
MODE_BANDWIDTH = 0.5
"""Kernel width, in standard deviations, with which modes are counted among draws."""
MODE_NATS = 6.0
"""Local maxima this far below the best are not counted as modes."""
MODE_DEPTH_NATS = 0.5
"""A maximum is a mode of its own when every way from it to a higher one leads this far down."""
MODE_STEP_NATS = 0.25
MODE_PIXELS = 40_000
HIGHEST_CONTOUR = 0.99
"""Share of the highest density above which no contour is drawn: at the very top there is none to draw."""
BLOCK = 250_000
"""Points whose density is evaluated at once."""


@dataclass(frozen=True)
class Region:
    """Where one posterior is.

    Attributes
    ----------
    area_rsun2 : tuple of float
        Area of the highest-density region of each of `LEVELS`, square solar radii.
    outlines : tuple of ndarray, each of shape (V, 2)
        Closed polygons of those regions, separated by a row of NaN, solar radii.
    mode_rsun : ndarray, shape (2,)
        Position of the highest density.
    modes : int
        Number of local maxima within `MODE_NATS` of the highest.
    """

    area_rsun2: tuple[float, ...]
    outlines: tuple[FloatArray, ...]
    mode_rsun: FloatArray
    modes: int


@dataclass(frozen=True)
class _Image:
    """Log density on a regular lattice around one posterior; -inf where it is negligible."""

    log_density: FloatArray
    corner: FloatArray
    pitch: float


def regions_of(problems: Problems, cells: Cells) -> list[Region]:
    """Credible regions of each problem, from its density on cells divided further.

    Parameters
    ----------
    problems : Problems
        In the plane.
    cells : Cells

    Returns
    -------
    list of Region
        One per problem.
    """
    coarse = cells.local.log_density + log_speed_factor(problems, cells.local)
    best = np.full(problems.count, -np.inf)
    np.maximum.at(best, cells.owner, coarse)
    relevant = coarse > best[cells.owner] - RELEVANT_NATS
    corner = np.stack(np.unravel_index(np.arange(FINER**2), (FINER, FINER)))
    index = (FINER * cells.index[:, relevant, None] + corner[:, None, :]).reshape(2, -1)
    owner = np.repeat(cells.owner[relevant], FINER**2)
    pitch = cells.side / FINER
    log_density = _log_density(problems, cells.origin + (index + 0.5) * pitch[owner], owner)
    share, _ = normalised(log_density, owner, problems.count)
    cuts = np.searchsorted(owner, np.arange(problems.count + 1))
    parts = [slice(cuts[b], cuts[b + 1]) for b in range(problems.count)]
    return [
        _region(_image(index[:, part], log_density[part], cells.origin, pitch[b]), share[part], log_density[part])
        for b, part in enumerate(parts)
    ]


def _log_density(problems: Problems, points: FloatArray, owner: IntArray) -> FloatArray:
    """Log density at many points, taken in blocks so that memory stays bounded."""
    parts = []
    for first in range(0, owner.size, BLOCK):
        some = slice(first, first + BLOCK)
        local = evaluate(problems, points[:, some], owner[some])
        parts.append(local.log_density + log_speed_factor(problems, local))
    return np.concatenate(parts)


def region_of_draws(positions: FloatArray) -> Region:
    """Credible regions of a posterior known by draws only, from their kernel density.

    The draws are drawn in towards their mean before the kernel widens them, so that the covariance stays what it was
    (West 1993, doi:10.1111/j.2517-6161.1993.tb01911.x). Modes are counted with a wider kernel: the noise of draws has
    many maxima.

    Parameters
    ----------
    positions : ndarray, shape (N, 2)
        Solar radii.

    Returns
    -------
    Region
    """
    fine = _kernel_image(positions, len(positions) ** (-1 / 6))
    share, _ = normalised(fine.log_density.ravel(), np.zeros(fine.log_density.size, dtype=np.intp), 1)
    region = _region(fine, share, fine.log_density.ravel())
    return replace(region, modes=_count_modes(_kernel_image(positions, MODE_BANDWIDTH)))


def _kernel_image(positions: FloatArray, bandwidth: float) -> _Image:
    shrunk = positions.mean(axis=0) + (positions - positions.mean(axis=0)) / np.hypot(1, bandwidth)
    low, high = positions.min(axis=0), positions.max(axis=0)
    pitch = float((high - low).max()) / DRAWS_LATTICE
    shape = np.ceil((high - low) / pitch).astype(int) + 5
    corner = low - 2 * pitch
    points = corner[:, None] + np.indices(shape).reshape(2, -1) * pitch
    kernel = stats.gaussian_kde(shrunk.T, bw_method=bandwidth)
    return _Image(kernel.logpdf(points).reshape(shape), corner, pitch)


def _image(index: np.ndarray, log_density: FloatArray, origin: float, pitch: float) -> _Image:
    low = index.min(axis=1) - 1
    shape = index.max(axis=1) - low + 2
    lattice = np.full(shape, -np.inf)
    lattice[tuple(index - low[:, None])] = log_density
    return _Image(lattice, origin + (low + 0.5) * pitch, pitch)


def _region(image: _Image, share: FloatArray, log_density: FloatArray) -> Region:
    order = np.argsort(-share)
    ladder = np.cumsum(share[order])
    areas, outlines = [], []
    for level in LEVELS:
        last = int(np.searchsorted(ladder, level))
        before = ladder[last - 1] if last else 0.0
        areas.append((last + (level - before) / share[order[last]]) * image.pitch**2)
        outlines.append(_outline(image, float(log_density[order[last]])))
    return Region(tuple(areas), tuple(outlines), _mode(image), _count_modes(image))


def _outline(image: _Image, threshold: float) -> FloatArray:
    """Contour of the density, drawn in the density itself: the logarithm has no value outside the cells."""
    density = np.exp(image.log_density - image.log_density.max())
    generator = contourpy.contour_generator(z=density.T)
    level = min(float(np.exp(threshold - image.log_density.max())), HIGHEST_CONTOUR)
    lines = generator.lines(level)
    parted = [row for line in lines for row in (np.asarray(line), np.full((1, 2), np.nan))]
    steps = np.concatenate(parted[:-1]) if parted else np.empty((0, 2))
    return np.asarray(image.corner + steps * image.pitch)


def _count_modes(image: _Image) -> int:
    """Number of local maxima that are deep enough apart.

    A narrow ridge across the lattice has many maxima that only the lattice makes: they count when the saddle to a
    higher one lies lower by `MODE_DEPTH_NATS`.
    """
    depth = image.log_density.max() - image.log_density
    peaks = depth == ndimage.minimum_filter(depth, size=3, mode="constant", cval=np.inf)
    around = np.ones((3, 3))
    if ndimage.label(peaks & (depth < MODE_NATS), structure=around)[1] == 1:
        return 1
    return _count_basins(_pooled(depth), around)


def _pooled(depth: FloatArray) -> FloatArray:
    """Least depth of square blocks, so few that a lattice of any size is flooded fast; no basin is cut by it."""
    step = int(np.ceil(np.sqrt(depth.size / MODE_PIXELS)))
    if step == 1:
        return depth
    padded = np.pad(depth, [(0, -length % step) for length in depth.shape], constant_values=np.inf)
    blocks = padded.reshape(padded.shape[0] // step, step, padded.shape[1] // step, step)
    return np.asarray(blocks.min(axis=(1, 3)))


def _count_basins(depth: FloatArray, around: FloatArray) -> int:
    """Number of basins of a depth, each at least `MODE_DEPTH_NATS` deep when the rising water joins it to another.

    The depth is flooded step by step; a pool counts when it has grown deep enough and holds none that was counted.
    """
    modes, counted = 0, np.zeros(depth.shape, dtype=bool)
    for level in np.arange(MODE_DEPTH_NATS, MODE_NATS + MODE_DEPTH_NATS, MODE_STEP_NATS):
        pools, number = ndimage.label(depth < level, structure=around)
        lowest = ndimage.minimum(depth, pools, np.arange(1, number + 1))
        held = ndimage.maximum(counted, pools, np.arange(1, number + 1))
        grown = np.flatnonzero((lowest <= level - MODE_DEPTH_NATS) & (held == 0)) + 1
        modes += grown.size
        counted |= np.isin(pools, grown)
    return modes


def _mode(image: _Image) -> FloatArray:
    """Highest lattice point, moved to the top of the parabola through its neighbours along each axis."""
    top = np.unravel_index(int(image.log_density.argmax()), image.log_density.shape)
    shift = np.zeros(2)
    for axis in range(2):
        step = np.eye(2, dtype=int)[axis]
        below, above = (float(image.log_density[tuple(top + sign * step)]) for sign in (-1, 1))
        curvature = below + above - 2 * float(image.log_density[top])
        if np.isfinite(curvature) and curvature < 0:
            shift[axis] = np.clip(0.5 * (below - above) / curvature, -0.5, 0.5)
    return np.asarray(image.corner + (np.array(top) + shift) * image.pitch)

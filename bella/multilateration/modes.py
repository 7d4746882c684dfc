"""Separate maxima of a posterior: how many, where, and how much of the probability each holds."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import ndimage

from bella.units import FloatArray

MODE_NATS = 6.0
"""Local maxima this far below the best are not counted as modes."""
MODE_DEPTH_NATS = 0.5
"""A maximum is a mode of its own when every way from it to a higher one leads this far down."""
MODE_STEP_NATS = 0.25
MODE_PIXELS = 40_000
DEPTH_LEVELS = 60_000
"""Steps in which depth is told to the watershed, a matter of its integers."""


@dataclass(frozen=True)
class Image:
    """Log density on a regular lattice around one posterior; -inf where it is negligible."""

    log_density: FloatArray
    corner: FloatArray
    pitch: FloatArray

    def place(self, index: FloatArray) -> FloatArray:
        """Position of lattice coordinates, solar radii."""
        return np.asarray(self.corner + index * self.pitch)


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

    A narrow ridge across the lattice has many maxima that only the lattice makes: a maximum counts when the saddle to
    a higher one lies lower by `MODE_DEPTH_NATS`. Every point belongs to the maximum that steepest ascent leads to; the
    maxima that do not count belong where rising water would carry them.

    Parameters
    ----------
    image : Image

    Returns
    -------
    Modes
    """
    depth = image.log_density.max() - image.log_density
    around = np.ones((3,) * depth.ndim)
    peaks = depth == ndimage.minimum_filter(depth, size=3, mode="constant", cval=np.inf)
    if ndimage.label(peaks & (depth < MODE_NATS), structure=around)[1] == 1:
        return _single(image)
    pooled, step = _pooled(depth)
    basins = _basins(pooled, _seeds(pooled, around), around)
    whole = np.kron(basins, np.ones((step,) * depth.ndim, dtype=basins.dtype)) if step > 1 else basins
    return _weighted(image, whole[tuple(slice(length) for length in depth.shape)])


def _single(image: Image) -> Modes:
    """All of the probability in one basin."""
    place = np.nonzero(np.isfinite(image.log_density))
    mass = np.exp(image.log_density[place] - image.log_density.max())
    index = np.stack([axis @ mass for axis in place]) / mass.sum()
    return Modes(image.place(index)[None], np.ones(1))


def _weighted(image: Image, basins: np.ndarray) -> Modes:
    """Mean and weight of each basin."""
    mass = np.exp(image.log_density - image.log_density.max())
    labels = np.arange(1, basins.max() + 1)
    weight = ndimage.sum_labels(mass, basins, labels)
    moments = [ndimage.sum_labels(mass * axis, basins, labels) for axis in np.indices(mass.shape, sparse=True)]
    order = np.argsort(-weight, kind="stable")
    index = np.stack([moment / weight for moment in moments], axis=1)
    return Modes(image.place(index)[order], weight[order] / weight.sum())


def _pooled(depth: FloatArray) -> tuple[FloatArray, int]:
    """Least depth of blocks, so few that a lattice of any size is flooded fast, and their size; no basin is cut."""
    step = int(np.ceil((depth.size / MODE_PIXELS) ** (1 / depth.ndim)))
    if step <= 1:
        return depth, 1
    padded = np.pad(depth, [(0, -length % step) for length in depth.shape], constant_values=np.inf)
    blocks = padded.reshape([part for length in padded.shape for part in (length // step, step)])
    return np.asarray(blocks.min(axis=tuple(range(1, 2 * depth.ndim, 2)))), step


def _seeds(depth: FloatArray, around: FloatArray) -> np.ndarray:
    """Mark the deepest place of every basin that is at least `MODE_DEPTH_NATS` deep when it joins another.

    The depth is flooded step by step; a pool counts when it has grown deep enough and holds none that was counted.
    """
    seeds, counted = np.zeros(depth.shape, dtype=np.int32), np.zeros(depth.shape, dtype=bool)
    for level in np.arange(MODE_DEPTH_NATS, MODE_NATS + MODE_DEPTH_NATS, MODE_STEP_NATS):
        pools, number = ndimage.label(depth < level, structure=around)
        labels = np.arange(1, number + 1)
        lowest = ndimage.minimum(depth, pools, labels)
        held = ndimage.maximum(counted, pools, labels)
        grown = np.flatnonzero((lowest <= level - MODE_DEPTH_NATS) & (held == 0)) + 1
        for place in ndimage.minimum_position(depth, pools, grown):
            seeds[place] = seeds.max() + 1
        counted |= np.isin(pools, grown)
    return seeds


def _basins(depth: FloatArray, seeds: np.ndarray, around: FloatArray) -> np.ndarray:
    """Label every lattice point with the seed whose basin it lies in."""
    finite = np.isfinite(depth)
    deepest = max(float(depth[finite].max()), 1.0)
    steps = np.where(finite, depth / deepest * DEPTH_LEVELS, np.iinfo(np.uint16).max).astype(np.uint16)
    flooded = ndimage.watershed_ift(steps, seeds, structure=around)
    return np.asarray(flooded.ravel()[_bottoms(depth)].reshape(depth.shape))


def _bottoms(depth: FloatArray) -> np.ndarray:
    """Flat index of the local minimum of depth that steepest descent from each point ends in, shape (points,)."""
    padded = np.pad(depth, 1, constant_values=np.inf)
    index = np.pad(np.arange(depth.size).reshape(depth.shape), 1)
    inner = tuple(slice(1, -1) for _ in depth.shape)
    lowest, next_point = depth.copy(), index[inner].copy()
    for shift in product((-1, 0, 1), repeat=depth.ndim):
        window = tuple(slice(1 + by, 1 + by + length) for by, length in zip(shift, depth.shape, strict=True))
        lower = padded[window] < lowest
        lowest[lower], next_point[lower] = padded[window][lower], index[window][lower]
    bottom = next_point.ravel()
    while not np.array_equal(bottom[bottom], bottom):
        bottom = bottom[bottom]
    return bottom

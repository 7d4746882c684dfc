"""Separate maxima of a posterior: how many, where, and how much of the probability each holds."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from bella.multilateration.likelihood import IntArray
from bella.units import FloatArray

MODE_NATS = 6.0
"""Local maxima this far below the best are not counted as modes."""
MODE_DEPTH_NATS = 0.5
"""A maximum is a mode of its own when every way from it to a higher one leads this far down."""


@dataclass(frozen=True)
class Image:
    """Log density on a regular lattice around one posterior; -inf where it is negligible, and along the border.

    Attributes
    ----------
    log_density : ndarray, shape (N, ...)
    corner : ndarray, shape (D,)
        Place of the first lattice point, solar radii.
    pitch : ndarray, shape (D,)
        Distance of lattice points along each axis, solar radii.
    """

    log_density: FloatArray
    corner: FloatArray
    pitch: FloatArray

    @classmethod
    def of(cls, index: IntArray, density: FloatArray, origin: float, pitch: FloatArray) -> "Image":
        """Image of the points with some coordinates (D, M) on a lattice whose first cell begins at an origin."""
        low = index.min(axis=1) - 1
        lattice = np.full(index.max(axis=1) - low + 2, -np.inf)
        lattice[tuple(index - low[:, None])] = density
        return cls(lattice, origin + (low + 0.5) * pitch, pitch)

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

    Every point belongs to the maximum that steepest ascent leads to. A narrow ridge across the lattice has many maxima
    that only the lattice makes: a maximum counts when every way to a higher one leads down by `MODE_DEPTH_NATS`. One
    that does not count joins the basin across its highest saddle.

    Parameters
    ----------
    image : Image

    Returns
    -------
    Modes
    """
    shape = image.log_density.shape
    inner = np.pad(image.log_density, 1, constant_values=-np.inf)
    flat = np.flatnonzero(np.isfinite(inner))
    value = inner.ravel()[flat]
    place = np.full(inner.size, value.size)
    place[flat] = np.arange(value.size)
    strides = np.cumprod((1, *inner.shape[:0:-1]))[::-1]
    steps = np.array([step for step in product((-1, 0, 1), repeat=len(shape)) if any(step)]) @ strides
    neighbours = place[flat + steps[:, None]]
    basin = _basins(value, neighbours)
    joined = _joined(value, neighbours, basin)
    return _weighted(image, np.stack(np.unravel_index(flat, inner.shape)) - 1, value, joined[basin])


def _basins(value: FloatArray, neighbours: IntArray) -> IntArray:
    """Maximum, as a point, that steepest ascent from each point ends in."""
    around = np.append(value, -np.inf)[neighbours]
    best = around.argmax(axis=0)
    point = np.arange(value.size)
    upward = np.where(around[best, point] > value, neighbours[best, point], point)
    while not np.array_equal(upward[upward], upward):
        upward = upward[upward]
    return upward


def _joined(value: FloatArray, neighbours: IntArray, basin: IntArray) -> IntArray:
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
        shallow = value[low] - saddle[order[which]] < MODE_DEPTH_NATS
        if shallow or value[low] < value.max() - MODE_NATS:
            stands[low] = high
    stands[maxima] = [_root(stands, int(maximum)) for maximum in maxima]
    return stands


def _root(stands: IntArray, maximum: int) -> int:
    while stands[maximum] != maximum:
        maximum = int(stands[maximum])
    return maximum


def _weighted(image: Image, index: IntArray, value: FloatArray, mode: IntArray) -> Modes:
    """Mean and weight of each mode."""
    mass = np.exp(value - value.max())
    found, number = np.unique(mode, return_inverse=True)
    weight = np.bincount(number, mass)
    mean = np.stack([np.bincount(number, mass * axis) for axis in index], axis=1) / weight[:, None]
    order = np.argsort(-weight, kind="stable")
    kept = order[value[found[order]] >= value.max() - MODE_NATS]
    return Modes(image.place(mean)[kept], weight[kept] / weight[kept].sum())

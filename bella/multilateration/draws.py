"""Posterior draws from cells: stratified over the cells, weighted to the exact density, resampled and shuffled."""

from dataclasses import dataclass

import numpy as np

from bella.multilateration.cells import Cells
from bella.multilateration.likelihood import (
    NARROW_SPEED_PRIOR,
    IntArray,
    Local,
    Problems,
    evaluate,
    log_speed_factor,
    prior_ratio,
)
from bella.multilateration.moments import normalised, summed
from bella.units import C_RSUN_S, FloatArray

SPEED_BINS = 48
SPEED_RANGE_SD = 4.5


@dataclass(frozen=True)
class Draws:
    """Equally weighted draws of B problems.

    Attributes
    ----------
    position : ndarray, shape (B, N, D)
        Solar radii.
    emission_s : ndarray, shape (B, N)
        After the reference time of the grid, s.
    v_over_c : ndarray, shape (B, N)
    effective : ndarray, shape (B,)
        Effective number of draws before resampling, (sum w)^2 / sum w^2.
    """

    position: FloatArray
    emission_s: FloatArray
    v_over_c: FloatArray
    effective: FloatArray


def draw(problems: Problems, cells: Cells, number: int, rng: np.random.Generator) -> Draws:
    """Draw positions, emission times and speeds from the posterior.

    Parameters
    ----------
    problems : Problems
    cells : Cells
        Of the same problems.
    number : int
        Draws N per problem.
    rng : numpy.random.Generator

    Returns
    -------
    Draws
    """
    points, owner, local, log_weight = _proposals(problems, cells, number, rng)
    weight, _ = normalised(log_weight, owner, problems.count)
    chosen = _systematic(weight, problems.count, number, rng)
    chosen = rng.permuted(chosen.reshape(problems.count, number), axis=1)
    slowness = _draw_slowness(problems, local, chosen, rng)
    jitter = rng.standard_normal(chosen.shape) / np.sqrt(problems.total_weight)[:, None]
    return Draws(
        position=np.moveaxis(points[:, chosen], 0, -1),
        emission_s=problems.mean_arrival_s[:, None] - slowness * local.mean_distance[chosen] + jitter,
        v_over_c=1 / (slowness * C_RSUN_S),
        effective=1 / summed(weight**2, owner, problems.count),
    )


def _proposals(
    problems: Problems, cells: Cells, number: int, rng: np.random.Generator
) -> tuple[FloatArray, IntArray, Local, FloatArray]:
    """Points spread evenly within cells taken in proportion to their mass, with log importance weights."""
    density = cells.local.log_density + log_speed_factor(problems, cells.local)
    mass, _ = normalised(density, cells.owner, problems.count)
    taken = _systematic(mass, problems.count, number, rng)
    owner = np.repeat(np.arange(problems.count), number)
    place = cells.index[:, taken] + rng.random((problems.dimensions, taken.size))
    points = cells.origin + place * cells.side[owner]
    local = evaluate(problems, points, owner)
    return points, owner, local, local.log_density + log_speed_factor(problems, local) - density[taken]


def _systematic(mass: FloatArray, count: int, number: int, rng: np.random.Generator) -> IntArray:
    """Indices of points taken in proportion to their mass, `number` for each problem, in order of problem.

    The masses of a problem add up to one, so problem b owns the stretch from b to b + 1 of their running sum.
    """
    comb = (np.arange(number) + rng.random((count, 1))) / number + np.arange(count)[:, None]
    ladder = np.cumsum(mass)
    return np.minimum(np.searchsorted(ladder, comb.ravel()), mass.size - 1)


def _draw_slowness(problems: Problems, local: Local, chosen: IntArray, rng: np.random.Generator) -> FloatArray:
    mean, sd = local.slowness[chosen], local.slowness_sd[chosen]
    if problems.priors.v_sd_c <= NARROW_SPEED_PRIOR:
        return np.asarray(mean + sd * rng.standard_normal(chosen.shape))
    return np.asarray(mean + sd * _draw_deviation(problems, mean, sd, rng))


def _draw_deviation(problems: Problems, mean: FloatArray, sd: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Standardised deviates of u | x by inversion of its distribution on equal bins."""
    edges = np.linspace(-SPEED_RANGE_SD, SPEED_RANGE_SD, SPEED_BINS + 1)
    z = 0.5 * (edges[1:] + edges[:-1])
    density = np.exp(-0.5 * z**2) * prior_ratio(mean[..., None] + sd[..., None] * z, problems.priors)
    ladder = np.cumsum(density, axis=-1)
    height = rng.random(mean.shape) * ladder[..., -1]
    taken = (ladder < height[..., None]).sum(axis=-1)
    return np.asarray(edges[taken] + rng.random(mean.shape) * (edges[1] - edges[0]))

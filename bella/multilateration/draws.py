"""Posterior draws from cells: stratified over the cells, weighted to the exact density, resampled and shuffled."""

from dataclasses import dataclass

import numpy as np

from bella.multilateration.cells import Cells
from bella.multilateration.likelihood import IntArray, Problems, evaluate
from bella.multilateration.moments import normalised
from bella.multilateration.speed import draw_slowness
from bella.units import C_RSUN_S, FloatArray


@dataclass(frozen=True)
class Draws:
    """Equally weighted draws of B problems.

    Attributes
    ----------
    position : ndarray, shape (B, N, D)
        Solar radii.
    emission_s : ndarray, shape (B, N)
        After the reference time of the grid, s.
    v_over_c, kappa : ndarray, shape (B, N)
    effective : ndarray, shape (B,)
        Effective number of draws before resampling, (sum w)^2 / sum w^2.
    """

    position: FloatArray
    emission_s: FloatArray
    v_over_c: FloatArray
    kappa: FloatArray
    effective: FloatArray


def draw(problems: Problems, cells: Cells, number: int, rng: np.random.Generator) -> Draws:
    """Draw positions, emission times, speeds and directional delays from the posterior.

    Cells are taken in proportion to their mass, together with a component of the noise; a point within each, a speed
    and an emission time follow. What the point and the speed miss of the exact density is made good by resampling
    with importance weights.

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
    count, components = problems.count, problems.components
    log_density = cells.log_density.T.ravel()
    mass, _ = normalised(cells.log_density, cells.owner, count)
    taken = _systematic(mass.T.ravel(), np.repeat(cells.owner, components), count, number, rng).reshape(count, number)
    cell, component = np.divmod(taken, components)
    points = (
        cells.origin + (cells.index[:, cell] + rng.random((problems.dimensions, count, number))) * cells.side[:, None]
    )
    here = problems.component(component)
    local = evaluate(here, points)
    slowness, log_weight = draw_slowness(local, problems.priors, rng)
    weight = _weights(local.log_density[0] + log_weight - log_density[taken])
    chosen = _resampled(weight, rng)

    def _of_chosen(values: FloatArray) -> FloatArray:
        return np.take_along_axis(values, chosen, axis=-1)

    kappa = local.kappa_given(slowness)[0] + local.kappa_sd[0] * rng.standard_normal(chosen.shape)
    late = here.mean_arrival_s[0] - slowness * local.mean_distance[0] - kappa * local.mean_delay_s[0]
    late = late + rng.standard_normal(chosen.shape) / np.sqrt(here.total_weight[0])
    return Draws(
        position=np.stack([_of_chosen(axis) for axis in points], axis=-1),
        emission_s=_of_chosen(late),
        v_over_c=1 / (_of_chosen(slowness) * C_RSUN_S),
        kappa=_of_chosen(kappa),
        effective=1 / (weight**2).sum(axis=1),
    )


def _weights(log_weight: FloatArray) -> FloatArray:
    """Weights that add up to one in each row."""
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def _resampled(weight: FloatArray, rng: np.random.Generator) -> IntArray:
    """Indices within each row in proportion to its weights, in random order."""
    count, number = weight.shape
    owner = np.repeat(np.arange(count), number)
    taken = _systematic(weight.ravel(), owner, count, number, rng).reshape(count, number)
    return rng.permuted(taken - number * np.arange(count)[:, None], axis=1)


def _systematic(mass: FloatArray, owner: IntArray, count: int, number: int, rng: np.random.Generator) -> IntArray:
    """Indices of points taken in proportion to their mass, `number` for each problem, in order of problem.

    The masses of a problem add up to one. A comb of `number` teeth with a random start is laid along their running
    sum; each point is taken as often as teeth fall on it.
    """
    ladder = np.cumsum(mass) - owner
    passed = np.ceil(ladder * number - rng.random(count)[owner])
    last = np.searchsorted(owner, np.arange(count), side="right") - 1
    passed[last] = number
    passed = np.clip(passed, 0, number).astype(np.intp) + owner * number
    return np.repeat(np.arange(mass.size), np.diff(passed, prepend=0))

"""The exact posterior of every frequency of a burst: milliseconds each, no sampler."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from bella.arrivals import ArrivalGrid
from bella.exceptions import ConvergenceError
from bella.multilateration.cells import Cells, divide
from bella.multilateration.draws import Draws, draw
from bella.multilateration.likelihood import Problems, problems_of
from bella.multilateration.moments import Moments, moments_of
from bella.multilateration.regions import regions_of
from bella.multilateration.solution import Recipe
from bella.multilateration.summary import Posterior
from bella.units import FloatArray

BATCH = {2: 25, 3: 1}
"""Frequencies treated together: enough to pay for the calls, few enough to stay in the processor's cache."""


def exact_posterior(grid: ArrivalGrid, recipe: Recipe, advance: Callable[[int], None]) -> Posterior:
    """Compute the posterior of each frequency on adaptive cells.

    Parameters
    ----------
    grid : ArrivalGrid
        With the timing errors to use.
    recipe : Recipe
    advance : callable
        Told how many frequencies are done since the last call.

    Returns
    -------
    Posterior

    Raises
    ------
    ConvergenceError
        If a posterior is too sharp for the cells that may be spent on it; names the frequency.
    """
    problems = problems_of(grid, recipe.preset.priors, recipe.dimensions, recipe.preset.noise, recipe.preset.delay)
    rng = np.random.default_rng(recipe.seed)
    parts = []
    for batch, cells in _divided(problems, grid.frequency_mhz):
        drawn = _in_single_precision(draw(batch, cells, recipe.draws, rng))
        parts.append((drawn, moments_of(batch, cells), regions_of(batch, cells)))
        advance(batch.count)
    draws, moments, regions = zip(*parts, strict=True)
    joined = {
        kind: kind(*(np.concatenate([getattr(part, name) for part in some]) for name in kind.__dataclass_fields__))
        for kind, some in ((Draws, draws), (Moments, moments))
    }
    return Posterior(joined[Draws], joined[Moments], [region for some in regions for region in some])  # type: ignore[arg-type]


def _in_single_precision(draws: Draws) -> Draws:
    """Draws as they are stored: the only part of the answer that grows much with the number of frequencies."""
    return replace(
        draws,
        position=draws.position.astype(np.float32),
        emission_s=draws.emission_s.astype(np.float32),
        v_over_c=draws.v_over_c.astype(np.float32),
        kappa=draws.kappa.astype(np.float32),
    )


def _divided(problems: Problems, frequency_mhz: FloatArray) -> Iterator[tuple[Problems, Cells]]:
    """Problems with their cells, `BATCH` together, or fewer where they need many cells."""
    step = BATCH[problems.dimensions]
    for first in range(0, problems.count, step):
        some = slice(first, first + step)
        yield from _halved(problems.at(some), frequency_mhz[some])


def _halved(problems: Problems, frequency_mhz: FloatArray) -> Iterator[tuple[Problems, Cells]]:
    try:
        cells = divide(problems)
    except ConvergenceError as error:
        if problems.count == 1:
            raise ConvergenceError(f"{frequency_mhz[0]:g} MHz: {error}") from error
    else:
        yield problems, cells
        return
    middle = problems.count // 2
    for half in (slice(0, middle), slice(middle, None)):
        yield from _halved(problems.at(half), frequency_mhz[half])

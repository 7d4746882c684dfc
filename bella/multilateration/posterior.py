"""The exact posterior of every frequency of a burst, held by cells: moments, evidence and draws.

Moments are sums over the cells (midpoint rule). Draws are stratified over the cells, weighted to the exact density,
resampled and shuffled.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from bella.arrivals import ArrivalGrid
from bella.exceptions import ConvergenceError
from bella.multilateration.cells import Cells, Lattice, divide, normalised, summed
from bella.multilateration.likelihood import evaluate
from bella.multilateration.priors import Preset, Priors
from bella.multilateration.problems import IntArray, LateClocks, Problems, log_constant, problems_of
from bella.multilateration.regions import Region, component_density, regions_of
from bella.multilateration.speed import draw_slowness
from bella.units import C_RSUN_S, FloatArray

BATCH = {2: 50, 3: 1}
"""Frequencies treated together: enough to pay for the calls, few enough for the memory."""
SHARE_OF_SIDE = 0.05
"""Step, in edges of a cell, over which the slope of the log density is taken."""
LEAST_CHANGE, MOST_CHANGE = 1e-4, 4.0
"""Limits of the change of the log density across half a cell: the equations divide by it, and raise e to it."""


AXES = "xyz"


@dataclass(frozen=True)
class Draws:
    """Equally weighted draws of B problems, in single precision: of the answer they alone grow with the frequencies.

    Attributes
    ----------
    position : ndarray, shape (B, N, D)
        Solar radii.
    emission_s : ndarray, shape (B, N)
        After the reference time of the grid, s.
    effective : ndarray, shape (B,)
        Effective number of draws before resampling, (sum w)^2 / sum w^2.
    """

    position: FloatArray
    emission_s: FloatArray
    v_over_c: FloatArray
    kappa: FloatArray
    effective: FloatArray

    def row(self, problem: int) -> "Draws":
        """Those of one problem, to be filled."""
        return Draws(**{name: values[problem : problem + 1] for name, values in vars(self).items()})


@dataclass(frozen=True)
class Moments:
    """Summary of each problem's posterior.

    Attributes
    ----------
    mean : ndarray, shape (B, D)
        Solar radii.
    covariance : ndarray, shape (B, D, D)
        Square solar radii.
    emission_s, emission_sd_s : ndarray, shape (B,)
        Emission time after the reference time of the grid, s.
    v_over_c, v_over_c_sd : ndarray, shape (B,)
        Propagation speed.
    above_c : ndarray, shape (B,)
        Probability that the speed is above that of light.
    prior_pull : ndarray, shape (B, D)
        How far the prior moves the mean, to first order, solar radii.
    bad_probability : ndarray, shape (B, n)
        Probability that an arrival time is bad; 0 where the noise is Gaussian.
    kappa, kappa_sd : ndarray, shape (B,)
        Of the directional delay, in half widths of the rise.
    """

    mean: FloatArray
    covariance: FloatArray
    emission_s: FloatArray
    emission_sd_s: FloatArray
    v_over_c: FloatArray
    v_over_c_sd: FloatArray
    log_evidence: FloatArray
    above_c: FloatArray
    prior_pull: FloatArray
    bad_probability: FloatArray
    kappa: FloatArray
    kappa_sd: FloatArray


@dataclass(frozen=True)
class Posterior:
    """What any method hands over for the frequencies of a grid.

    Attributes
    ----------
    remarks : sequence of str
        Flags that the method itself raises, one text per frequency, joined by semicolons; none if empty.
    """

    draws: Draws
    moments: Moments
    regions: Sequence[Region]
    remarks: Sequence[str] = ()


@dataclass(frozen=True)
class Recipe:
    """How a posterior was made."""

    method: str
    preset: Preset
    dimensions: int
    draws: int
    seed: int


def parameters(dimensions: int) -> tuple[str, ...]:
    """Names of the parameters of a draw, in order."""
    return (*(f"{axis}_rsun" for axis in AXES[:dimensions]), "emission_s", "v_over_c")


def exact_posterior(
    grid: ArrivalGrid, recipe: Recipe, advance: Callable[[int], None], clocks: LateClocks | None = None
) -> Posterior:
    """Compute the posterior of each frequency on adaptive cells.

    Parameters
    ----------
    grid : ArrivalGrid
        With the timing errors to use.
    advance : callable
        Told how many frequencies are done since the last call.
    clocks : LateClocks, optional
        In place of the noise of the preset.

    Raises
    ------
    ConvergenceError
        If a posterior is too sharp for the cells that may be spent on it; names the frequency.
    """
    preset = recipe.preset
    problems = problems_of(grid, preset.priors, recipe.dimensions, preset.noise, preset.delay, clocks)
    rng = np.random.default_rng(recipe.seed)
    parts = []
    for batch, cells in _divided(problems, grid.frequency_mhz):
        drawn = draw(batch, cells, recipe.draws, rng)
        parts.append((drawn, moments_of(batch, cells), regions_of(batch, cells)))
        advance(batch.count)
    draws, moments, regions = zip(*parts, strict=True)
    joined = {
        kind: kind(*(np.concatenate([getattr(part, name) for part in some]) for name in kind.__dataclass_fields__))
        for kind, some in ((Draws, draws), (Moments, moments))
    }
    return Posterior(joined[Draws], joined[Moments], [region for some in regions for region in some])  # type: ignore[arg-type]


def log_evidence(grid: ArrivalGrid, recipe: Recipe, late_s: FloatArray, late_sd_s: FloatArray) -> FloatArray:
    """Evidence of each frequency once the clocks of receivers are late by so much, shape (F,), as a logarithm.

    Parameters
    ----------
    late_s, late_sd_s : ndarray, shape (n,)

    Returns
    -------
    ndarray, shape (F,)
    """
    clocks = LateClocks(late_s[None], late_sd_s[None], np.zeros((1, grid.frequency_mhz.size)))
    preset = recipe.preset
    problems = problems_of(grid, preset.priors, recipe.dimensions, delay=preset.delay, clocks=clocks)
    parts = []
    for some, cells in _divided(problems, grid.frequency_mhz):
        _, log_sum = normalised(cells.log_mass, cells.owner, some.count)
        parts.append(_log_evidence(some, cells, log_sum))
    return np.concatenate(parts)


def _log_evidence(problems: Problems, cells: Cells, log_sum: FloatArray) -> FloatArray:
    """Logarithm of the evidence of each problem, shape (B,), from that of the sum over its cells."""
    return np.asarray(log_sum + np.log(cells.side).sum(axis=0) + log_constant(problems))


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


def moments_of(problems: Problems, cells: Cells) -> Moments:
    """Summary of the posterior held by cells (midpoint rule)."""
    count, owner, local, speed = problems.count, cells.owner, cells.local, cells.speed
    joint, log_sum = normalised(cells.log_mass, owner, count)

    def _mean(values: FloatArray) -> FloatArray:
        return summed((joint * values).sum(axis=0), owner, count)

    def _spread(values: FloatArray, within: FloatArray) -> FloatArray:
        return _mean((values - _mean(values)[owner]) ** 2 + within)

    here = problems.at(owner)
    kappa, kappa_variance = local.kappa_given(speed.u), local.kappa_slope**2 * speed.u_variance + local.kappa_sd**2
    emission = here.mean_arrival_s - problems.mean_arrival_s[0, owner] - local.mean_distance * speed.u
    emission = emission - local.mean_delay_s * kappa
    with_slowness = local.mean_distance + local.kappa_slope * local.mean_delay_s
    within = with_slowness**2 * speed.u_variance + (local.mean_delay_s * local.kappa_sd) ** 2 + 1 / here.total_weight
    emission_variance = _spread(emission, within)
    share = joint.sum(axis=0)
    position, covariance, prior_pull = _position_moments(share, cells, count, problems.priors)
    return Moments(
        mean=position,
        covariance=covariance,
        emission_s=problems.mean_arrival_s[0] + _mean(emission),
        emission_sd_s=np.sqrt(emission_variance),
        v_over_c=_mean(speed.v),
        v_over_c_sd=np.sqrt(_spread(speed.v, speed.v_variance)),
        log_evidence=_log_evidence(problems, cells, log_sum),
        above_c=_mean(speed.above_c),
        prior_pull=prior_pull,
        bad_probability=np.stack([summed(one, owner, count) for one in joint], axis=1) @ problems.bad,
        kappa=_mean(kappa),
        kappa_sd=np.sqrt(_spread(kappa, kappa_variance)),
    )


def _position_moments(
    share: FloatArray, cells: Cells, count: int, priors: Priors
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean, covariance, and the change of the mean with the power to which the prior is raised, at the power of one.

    The last is the covariance of position and log prior, an identity of exponential families.
    """
    centres = cells.centres
    mean = np.stack([summed(share * axis, cells.owner, count) for axis in centres], axis=1)
    deviation = centres - mean.T[:, cells.owner]
    weighted = share * deviation
    covariance = [[summed(a * b, cells.owner, count) for b in deviation] for a in weighted]
    log_prior = priors.log_position((centres**2).sum(axis=0))
    pull = np.stack([summed(a * log_prior, cells.owner, count) for a in weighted], axis=1)
    return mean, np.moveaxis(np.array(covariance), -1, 0), pull


def draw(problems: Problems, cells: Cells, number: int, rng: np.random.Generator) -> Draws:
    """Draw positions, emission times, speeds and directional delays from the posterior.

    Cells are taken in proportion to their mass, together with a component of the noise; a point within each follows, as
    if the log density were linear across the cell, then a speed, a kappa and an emission time. What that misses of the
    exact density is made good by resampling with importance weights.

    Parameters
    ----------
    cells : Cells
        Of the same problems.
    number : int
        Draws N per problem.
    """
    change = _change_across(problems, cells)
    widened = np.log(np.sinh(change) / change).sum(axis=0)
    held = cells.log_mass
    mass, _ = normalised(held + widened, cells.owner, problems.count)
    edges = np.searchsorted(cells.owner, np.arange(problems.count + 1))
    shape = problems.count, number
    values: dict[str, Any] = {name: np.empty(shape, np.float32) for name in ("emission_s", "v_over_c", "kappa")}
    position: Any = np.empty((*shape, problems.dimensions), np.float32)
    draws = Draws(position=position, effective=np.empty(problems.count), **values)
    for row, (first, last) in enumerate(pairwise(edges)):  # one at a time: its draws stay in the processor's cache
        some, one = slice(first, last), slice(row, row + 1)
        lattice = Lattice(
            cells.index[:, some], cells.owner[some], cells.side[:, one], cells.origin[:, one], cells.axes.one(row)
        )
        here = _Held(lattice, change[..., some], mass[:, some], held[:, some])
        _draw_one(problems.at(one), here, draws.row(row), rng)
    return draws


def _change_across(problems: Problems, cells: Cells) -> FloatArray:
    """Change of the log density in coordinates from the centre of each cell to its sides, shape (D, K, M)."""
    here, aside = problems.at(cells.owner), []
    for axis in np.eye(problems.dimensions):
        index = cells.index + 0.5 + SHARE_OF_SIDE * axis[:, None]
        density = component_density(here, cells.place(index, cells.owner))
        aside.append(density + cells.log_area(index, cells.owner))
    change = np.clip((np.stack(aside) - cells.log_mass) / (2 * SHARE_OF_SIDE), -MOST_CHANGE, MOST_CHANGE)
    return np.where(np.abs(change) < LEAST_CHANGE, LEAST_CHANGE, change)


@dataclass(frozen=True)
class _Held:
    """Cells of one problem: change of the log density across half of each (D, K, M), and what they hold (K, M)."""

    lattice: Lattice
    change: FloatArray
    mass: FloatArray
    log_mass: FloatArray


def _draw_one(problem: Problems, held: _Held, draws: Draws, rng: np.random.Generator) -> None:
    """Fill the draws of one problem."""
    number = draws.kappa.size
    taken = _systematic(held.mass.T.ravel(), number, rng)
    cell, component = np.divmod(taken, problem.components) if problem.components > 1 else (taken, 0 * taken)
    place = component * held.log_mass.shape[1] + cell
    twice = 2 * held.change.reshape(len(held.change), -1).take(place, axis=1)
    jitter = np.log1p(rng.random(twice.shape) * np.expm1(twice)) / twice - 0.5
    aside = held.lattice.index.take(cell, axis=1) + 0.5 + jitter
    alone = np.zeros(1, dtype=np.intp)
    points = held.lattice.place(aside, alone)[:, None]
    here = problem.component(component[None])
    local = evaluate(here, points)
    slowness, log_weight = draw_slowness(local, problem.priors, rng)
    log_drawn = held.log_mass.ravel().take(place) + (twice * jitter).sum(axis=0)
    log_weight = (local.log_density[0] + held.lattice.log_area(aside, alone) + log_weight - log_drawn)[0]
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    chosen = rng.permutation(_systematic(weight, number, rng))
    kappa = local.kappa_given(slowness)[0] + local.kappa_sd[0] * rng.standard_normal((1, number))
    emission = here.mean_arrival_s[0] - slowness * local.mean_distance[0] - kappa * local.mean_delay_s[0]
    emission = emission + rng.standard_normal((1, number)) / np.sqrt(here.total_weight[0])
    draws.position[...] = points.take(chosen, axis=2).transpose(1, 2, 0)
    draws.emission_s[...] = emission.take(chosen, axis=1)
    draws.v_over_c[...] = 1 / (slowness.take(chosen, axis=1) * C_RSUN_S)
    draws.kappa[...] = kappa.take(chosen, axis=1)
    draws.effective[...] = 1 / (weight**2).sum()


def _systematic(mass: FloatArray, number: int, rng: np.random.Generator) -> IntArray:
    """Indices of points taken in proportion to their mass, in order.

    The masses add up to one. A comb of `number` teeth with a random start is laid along their running sum; each point
    is taken as often as teeth fall on it.
    """
    passed = np.ceil(np.cumsum(mass) * number - rng.random())
    passed[-1] = number
    times = np.clip(passed, 0, number).astype(np.intp)
    times[1:] -= times[:-1].copy()
    return np.repeat(np.arange(mass.size), times)

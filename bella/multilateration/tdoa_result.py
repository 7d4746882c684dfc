"""Time differences of arrival behind the common interface: a Gaussian around the closed-form position.

The propagation speed is that of light and there is no prior, so the evidence is not defined, the speed has no
posterior, and where the delays leave a second position or a long bend the Gaussian knows nothing of it.
"""

from collections.abc import Callable

import numpy as np
from scipy.stats import chi2

from bella.arrivals import ArrivalGrid
from bella.exceptions import InputError
from bella.heliosphere.scattering import DirectionalDelay, one_minus_cosine
from bella.multilateration.likelihood import evaluate
from bella.multilateration.posterior import Draws, Moments, Posterior, Recipe
from bella.multilateration.priors import Priors
from bella.multilateration.problems import problems_of
from bella.multilateration.regions import LEVELS, Modes, Region
from bella.multilateration.tdoa import TdoaSolution, solve
from bella.units import FloatArray

AT_LIGHT_SPEED = Priors(v_sd_c=1e-9)
VERTICES = 73
DELAY_STEPS = 5
"""Positions are found so often, each time with the directional delay of the last: a step changes the next one by a
fifth."""


def tdoa_posterior(grid: ArrivalGrid, recipe: Recipe, advance: Callable[[int], None]) -> Posterior:
    """Localise each frequency by time differences of arrival.

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
        Its evidence is NaN: without a prior there is none.

    Raises
    ------
    GeometryError
        If the receivers lie on a line (a source in space: in a plane).
    InputError
        If there are too few receivers, or the preset allows bad arrival times.
    """
    if recipe.preset.noise.bad_probability:
        raise InputError(f"preset {recipe.preset.name!r} allows bad arrival times; use it with the method posterior")
    try:
        solved = _solved(grid, recipe)
    except InputError as error:
        raise type(error)(f"method tdoa, frequencies as rows from 0: {error}") from error
    advance(grid.frequency_mhz.size)
    return Posterior(
        draws=_draws(grid, solved, recipe),
        moments=_moments(grid, solved, recipe.preset.delay),
        regions=[_region(*one) for one in zip(solved.position, solved.covariance, strict=True)],
        remarks=[_remarks(*one) for one in zip(solved.two_roots, solved.inconsistent, strict=True)],
    )


def _solved(grid: ArrivalGrid, recipe: Recipe) -> TdoaSolution:
    """Positions, with the directional delay of the last ones taken off and its uncertainty added to the noise."""
    delay, late = recipe.preset.delay, np.zeros_like(grid.arrival_s)
    for _ in range(DELAY_STEPS if delay.is_free else 1):
        covariance = grid.covariances_s2() + delay.kappa_sd**2 * late[:, :, None] * late[:, None, :]
        sigma_s = np.sqrt(np.einsum("fii->fi", covariance))
        arrival_s = grid.arrival_s - grid.delay_s - delay.kappa * late
        correlation = covariance / (sigma_s[:, :, None] * sigma_s[:, None, :])
        solved = solve(grid.receiver_rsun, arrival_s, sigma_s, recipe.dimensions, correlation)
        source = np.pad(solved.position, ((0, 0), (0, 3 - recipe.dimensions)))
        late = np.nan_to_num(grid.rise_s * one_minus_cosine(source[:, None], grid.receiver_rsun))
    return solved


def _remarks(two_roots: bool, inconsistent: bool) -> str:
    raised = {"two_roots": two_roots, "no_exact_root": inconsistent}
    return ";".join(name for name in raised if raised[name])


def _moments(grid: ArrivalGrid, solved: TdoaSolution, delay: DirectionalDelay) -> Moments:
    none = np.zeros(len(solved.position))
    return Moments(
        mean=solved.position,
        covariance=solved.covariance,
        emission_s=solved.emission_s,
        emission_sd_s=solved.emission_sd_s,
        v_over_c=none + 1,
        v_over_c_sd=none,
        log_evidence=none * np.nan,
        above_c=none,
        prior_pull=np.zeros_like(solved.position),
        bad_probability=np.zeros_like(grid.arrival_s),
        kappa=none + delay.kappa,
        kappa_sd=none + delay.kappa_sd,
    )


def _draws(grid: ArrivalGrid, solved: TdoaSolution, recipe: Recipe) -> Draws:
    """Positions from the Gaussian, emission times from their exact density given the position."""
    rng = np.random.default_rng(recipe.seed)
    count, dimensions = solved.position.shape
    root = np.linalg.cholesky(solved.covariance)
    z = rng.standard_normal((count, recipe.draws, dimensions))
    position = solved.position[:, None] + np.einsum("bij,bnj->bni", root, z)
    problems = problems_of(grid, AT_LIGHT_SPEED, dimensions, delay=recipe.preset.delay).spread()
    local = evaluate(problems, np.moveaxis(position, -1, 0))
    kappa = local.kappa[0] + local.kappa_sd[0] * rng.standard_normal(local.kappa[0].shape)
    late = problems.mean_arrival_s[0] - AT_LIGHT_SPEED.slowness_mean * local.mean_distance[0]
    late = late - kappa * local.mean_delay_s[0]
    jitter = rng.standard_normal(late.shape) / np.sqrt(problems.total_weight[0])
    return Draws(position, late + jitter, np.ones(late.shape), kappa, np.full(count, float(recipe.draws)))


def _region(mean: FloatArray, covariance: FloatArray) -> Region:
    """Ellipses and ellipsoids of a Gaussian."""
    dimensions = len(mean)
    squared = [float(chi2.ppf(level, dimensions)) for level in LEVELS]
    seen = [float(chi2.ppf(level, 2)) for level in LEVELS]
    plane = covariance[:2, :2]
    volume = 4 / 3 * np.pi * np.sqrt(np.linalg.det(covariance)) if dimensions == 3 else np.nan
    return Region(
        area_rsun2=tuple(np.pi * one * float(np.sqrt(np.linalg.det(plane))) for one in seen),
        volume_rsun3=tuple(float(volume) * one**1.5 for one in squared),
        log_threshold=tuple(-0.5 * one for one in squared),
        outlines=tuple(_ellipse(mean[:2], plane, one) for one in seen),
        mode_rsun=mean,
        modes=Modes(mean[None], np.ones(1)),
    )


def _ellipse(centre: FloatArray, covariance: FloatArray, squared: float) -> FloatArray:
    angle = np.linspace(0, 2 * np.pi, VERTICES)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(centre + np.sqrt(squared) * (np.linalg.cholesky(covariance) @ circle).T)

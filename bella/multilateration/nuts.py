"""The same model sampled with PyMC: the reference that the exact posterior is held against.

The model is that of Canizares et al. (2024, A&A, doi:10.1051/0004-6361/202347747) in solar radii and seconds, in which
the sampler's unit scale is a good start; in metres it does not converge. Emission time, speed and directional delay are
parameters here, where the exact posterior has integrated them out. PyMC is imported when a model is built.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np

from bella.arrivals import ArrivalGrid
from bella.exceptions import ConvergenceError, require_extra
from bella.heliosphere.scattering import DirectionalDelay
from bella.multilateration.checks import predicted_arrivals
from bella.multilateration.posterior import AXES, Draws, Moments, Posterior, Recipe, parameters
from bella.multilateration.priors import THRESHOLDS, Noise, Priors
from bella.multilateration.regions import Region, region_of_draws
from bella.units import C_RSUN_S, FloatArray

CHAINS = 4
SCATTERED = ("x_scaled", "y_scaled", "z_scaled", "v_scaled", "kappa_scaled")
"""Where the chains start apart, by one prior standard deviation. The sampler refuses to start where a gradient is zero.
Scattered over its prior as well, the emission time starts so far off that a chain can end with a negative speed, from
where it does not come back."""
TUNE = 1000
GAUSSIAN_POWER = 2.0


def nuts_posterior(grid: ArrivalGrid, recipe: Recipe, advance: Callable[[int], None]) -> Posterior:
    """Sample the posterior of each frequency with the No-U-Turn sampler.

    Parameters
    ----------
    grid : ArrivalGrid
        With the timing errors to use.
    advance : callable
        Told how many frequencies are done since the last call.

    Returns
    -------
    Posterior
        Its evidence is NaN: the sampler does not give one.

    Raises
    ------
    ConvergenceError
        If the chains of a frequency disagree.
    """
    parts = []
    for row in range(grid.frequency_mhz.size):
        parts.append(sample_frequency(grid, row, recipe))
        advance(1)
    draws = Draws(*(np.stack([getattr(part, name) for part in parts]) for name in Draws.__dataclass_fields__))
    bad = _bad_probability(grid, draws, recipe.preset.noise)
    return Posterior(draws, _moments(draws, recipe.preset.priors, bad), _regions(draws))


def sample_frequency(grid: ArrivalGrid, row: int, recipe: Recipe) -> Draws:
    """Sample the posterior of one frequency.

    Parameters
    ----------
    grid : ArrivalGrid
        With the timing errors to use.
    row : int
        Which frequency of the grid.

    Returns
    -------
    Draws
        Without the leading axis.

    Raises
    ------
    ConvergenceError
        If the chains disagree.
    """
    received = np.isfinite(grid.arrival_s[row])
    shape = ModelShape(
        receivers=int(received.sum()),
        dimensions=recipe.dimensions,
        priors=recipe.preset.priors,
        noise=recipe.preset.noise,
        delay=recipe.preset.delay,
    )
    offset = float(grid.arrival_s[row, received].mean())
    trace = _run(_compiled(shape).with_data(**_inputs(grid, row, received, offset, shape)), recipe, row)
    names = parameters(recipe.dimensions)
    effective = _effective(trace, float(grid.frequency_mhz[row]), names)
    *position, emission, v = (trace.posterior[name].to_numpy().ravel()[-recipe.draws :] for name in names)
    kappa = np.full_like(v, shape.delay.kappa)
    if shape.delay.kappa_sd:
        kappa = trace.posterior["kappa"].to_numpy().ravel()[-recipe.draws :]
    return Draws(np.stack(position, axis=-1), emission + offset, v, kappa, np.asarray(effective))


@dataclass(frozen=True)
class ModelShape:
    """What a compiled model depends on; everything else is data that are put in later."""

    receivers: int
    dimensions: int
    priors: Priors
    noise: Noise
    delay: DirectionalDelay


def _inputs(grid: ArrivalGrid, row: int, received: Any, offset: float, shape: ModelShape) -> dict[str, FloatArray]:
    stated = grid.covariances_s2()[row][np.ix_(received, received)]
    sets = shape.noise.bad_sets(shape.receivers)
    root = np.linalg.cholesky(stated + sets[:, :, None] * shape.noise.bad_sd_s**2 * np.eye(shape.receivers))
    inputs = {
        "receiver_rsun": grid.receiver_rsun[row, received],
        "arrival_s": (grid.arrival_s - grid.delay_s)[row, received] - offset,
        "whitening": np.linalg.inv(root),
    }
    if shape.delay.is_free:
        inputs["rise_s"] = grid.rise_s[row, received]
    return inputs


@lru_cache(maxsize=16)
def _compiled(shape: ModelShape) -> Any:
    """Compiled model of a shape, paid once for all frequencies and bursts."""
    model = build_model(shape)
    scattered = {model[name] for name in SCATTERED if name in model.named_vars}
    return _library("nutpie").compile_pymc_model(model, jitter_rvs=scattered)


def build_model(shape: ModelShape) -> Any:
    """Model of one frequency with data to be put in.

    Parameters
    ----------
    shape : ModelShape
        With n receivers.

    Returns
    -------
    pymc.Model
        Data ``receiver_rsun`` (n, 3), ``arrival_s`` (n,) with known delays taken off, ``rise_s`` (n,), and
        ``whitening`` (K, n, n): the inverse Cholesky factor of the covariance of each component of the noise.
    """
    pm, priors, delay = _library("pymc"), shape.priors, shape.delay
    with pm.Model() as model:
        receiver = pm.Data("receiver_rsun", np.eye(shape.receivers, 3) * 200.0)
        arrival = pm.Data("arrival_s", np.zeros(shape.receivers))
        sets = shape.noise.bad_sets(shape.receivers)
        whitening = pm.Data("whitening", np.broadcast_to(np.eye(shape.receivers), (len(sets), *2 * [shape.receivers])))
        v = pm.Deterministic("v_over_c", 1.0 + priors.v_sd_c * _speed_scaled(pm, priors))
        half_width = priors.emission_half_width_s
        emission = pm.Uniform("emission_s", -half_width, half_width, initval=-500.0)
        source = _source(pm, shape)
        towards = [receiver[:, i] - source[i] for i in range(3)]
        distance = pm.math.sqrt(sum(axis**2 for axis in towards))
        expected = emission + distance / (v * C_RSUN_S)
        kappa = delay.kappa
        if delay.kappa_sd:
            kappa = pm.Deterministic("kappa", delay.kappa + delay.kappa_sd * pm.Normal("kappa_scaled"))
        if delay.is_free:
            rise = pm.Data("rise_s", np.ones(shape.receivers))
            radius = pm.math.sqrt(sum(axis**2 for axis in source))
            cosine = sum(source[i] * towards[i] for i in range(3)) / (radius * distance)
            expected = expected + kappa * rise * (1 - cosine)
        pm.Potential("arrival", _log_mixture(pm, shape, arrival - expected, whitening))
    return model


def _speed_scaled(pm: Any, priors: Priors) -> Any:
    if not priors.is_truncated:
        return pm.Normal("v_scaled")
    return pm.Truncated("v_scaled", pm.Normal.dist(), upper=(priors.v_max_c - 1) / priors.v_sd_c)


def _source(pm: Any, shape: ModelShape) -> list[Any]:
    """Coordinates of the source, which is at z = 0 where it has no third one."""
    priors, names = shape.priors, AXES[: shape.dimensions]
    if priors.power == GAUSSIAN_POWER:
        scaled = [pm.Normal(f"{axis}_scaled") for axis in names]
    else:
        scaled = [pm.Flat(f"{axis}_scaled", initval=0.3) for axis in names]
        pm.Potential("position_prior", -0.5 * sum(axis**2 for axis in scaled) ** (0.5 * priors.power))
    axes = [pm.Deterministic(f"{name}_rsun", priors.tau_rsun * axis) for name, axis in zip(names, scaled, strict=True)]
    return [*axes, *[0.0] * (3 - shape.dimensions)]


def _log_mixture(pm: Any, shape: ModelShape, residual: Any, whitening: Any) -> Any:
    """Log likelihood summed over the sets of bad arrival times that are possible."""
    sets = shape.noise.bad_sets(shape.receivers)
    components = []
    for k in range(len(sets)):
        white = pm.math.dot(whitening[k], residual)
        log_norm = sum(pm.math.log(whitening[k, i, i]) for i in range(shape.receivers))
        components.append(log_norm - 0.5 * (white**2).sum())
    if len(sets) == 1:
        return components[0]
    odds = np.log(shape.noise.bad_probability / (1 - shape.noise.bad_probability)) * sets.sum(axis=1)
    log_prior = odds - np.logaddexp.reduce(odds)
    return pm.math.logsumexp(pm.math.stack([one + log_prior[k] for k, one in enumerate(components)]))


def _run(model: Any, recipe: Recipe, row: int) -> Any:
    each = -(-recipe.draws // CHAINS)
    return _library("nutpie").sample(
        model,
        draws=each,
        tune=TUNE,
        chains=CHAINS,
        cores=2,
        seed=recipe.seed + row,
        target_accept=0.95,
        progress_bar=False,
    )


def _effective(trace: Any, frequency_mhz: float, names: tuple[str, ...]) -> float:
    """Smallest effective sample size of the parameters, after the chains were seen to agree."""
    az = _library("arviz")
    rhat = float(az.rhat(trace, var_names=list(names)).to_array().max())
    effective = float(az.ess(trace, var_names=list(names)).to_array().min())
    if rhat > THRESHOLDS.largest_rhat or effective < THRESHOLDS.fewest_sampled:
        raise ConvergenceError(
            f"{frequency_mhz:g} MHz: the chains do not agree (r-hat {rhat:.3f}, effective draws {effective:.0f}); "
            "use the method posterior, which needs no chains"
        )
    return effective


def _library(name: str) -> Any:
    """Import one of the sampler's libraries: seconds each, and only this method needs them."""
    require_extra(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # arviz announces its next version to every user
        return import_module(name)


def _moments(draws: Draws, priors: Priors, bad_probability: FloatArray) -> Moments:
    covariance = np.stack([np.cov(some.T) for some in draws.position])
    log_prior = priors.log_position((draws.position**2).sum(axis=2))
    pull = [np.cov(some.T, of_it)[:-1, -1] for some, of_it in zip(draws.position, log_prior, strict=True)]
    return Moments(
        mean=draws.position.mean(axis=1),
        covariance=covariance,
        emission_s=draws.emission_s.mean(axis=1),
        emission_sd_s=draws.emission_s.std(axis=1),
        v_over_c=draws.v_over_c.mean(axis=1),
        v_over_c_sd=draws.v_over_c.std(axis=1),
        log_evidence=np.full(len(covariance), np.nan),
        above_c=(draws.v_over_c > 1).mean(axis=1),
        prior_pull=np.stack(pull),
        bad_probability=bad_probability,
        kappa=draws.kappa.mean(axis=1),
        kappa_sd=draws.kappa.std(axis=1),
    )


def _bad_probability(grid: ArrivalGrid, draws: Draws, noise: Noise) -> FloatArray:
    """Probability that each arrival time is bad, (F, n): that of the sets of bad ones given a draw, over the draws."""
    sets = noise.bad_sets(len(grid.observatories))
    if len(sets) == 1:
        return np.zeros_like(grid.arrival_s)
    received = np.isfinite(grid.arrival_s)
    covariance = grid.covariances_s2()
    stated = np.where(np.isfinite(covariance), covariance, np.eye(received.shape[1]))[:, None]
    extra = (sets & received[:, None, :])[..., None] * noise.bad_sd_s**2 * np.eye(received.shape[1])
    residual = np.nan_to_num((grid.arrival_s - grid.delay_s)[:, None] - predicted_arrivals(grid, draws))
    square = np.einsum("fdi,fkij,fdj->fdk", residual, np.linalg.inv(stated + extra), residual, optimize=True)
    odds = np.log(noise.bad_probability / (1 - noise.bad_probability)) * sets.sum(axis=1)
    absent = (sets & ~received[:, None, :]).any(axis=2)
    log_weight = -0.5 * (square + np.linalg.slogdet(stated + extra)[1][:, None])
    log_weight = log_weight + np.where(absent, -np.inf, odds)[:, None]
    share = np.exp(log_weight - np.logaddexp.reduce(log_weight, axis=2)[..., None])
    return np.asarray(share.mean(axis=1) @ sets)


def _regions(draws: Draws) -> list[Region]:
    return [region_of_draws(_thinned(some)) for some in draws.position]


def _thinned(positions: FloatArray, most: int = 2000) -> FloatArray:
    return positions[:: max(1, len(positions) // most)]

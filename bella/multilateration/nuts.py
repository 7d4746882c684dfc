"""The same model sampled with PyMC: the reference that the exact posterior is held against.

The model is that of Canizares et al. (2024, A&A, doi:10.1051/0004-6361/202347747) in solar radii and seconds, in which
the sampler's unit scale is a good start; in metres it does not converge. Delays and offsets are parameters here, where
the exact posterior has integrated them out. PyMC is imported when a model is built.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np

from bella.arrivals import ArrivalGrid
from bella.exceptions import ConvergenceError
from bella.multilateration.draws import Draws
from bella.multilateration.moments import Moments
from bella.multilateration.predictive import predicted_arrivals
from bella.multilateration.priors import Noise, Priors
from bella.multilateration.regions import Region, region_of_draws
from bella.multilateration.solution import Recipe, parameters
from bella.multilateration.summary import AXES, Posterior
from bella.units import C_RSUN_S, FloatArray

CHAINS = 4
SCATTERED = ("x_scaled", "y_scaled", "z_scaled", "v_scaled", "delay_scaled", "offset_scaled")
"""Where the chains start apart, by one prior standard deviation. The sampler refuses to start where a gradient is zero,
as it is for a delay that is known to be none, so delays and offsets are among them. Scattered over its prior as well,
the emission time starts so far off that a chain can end with a negative speed, from where it does not come back."""
TUNE = 1000
LARGEST_RHAT = 1.05
MIN_EFFECTIVE = 100


def nuts_posterior(grid: ArrivalGrid, recipe: Recipe, advance: Callable[[int], None]) -> Posterior:
    """Sample the posterior of each frequency with the No-U-Turn sampler.

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
    return Posterior(draws, _moments(draws, recipe.preset.priors.tau_rsun, bad), _regions(draws))


def sample_frequency(grid: ArrivalGrid, row: int, recipe: Recipe) -> Draws:
    """Sample the posterior of one frequency.

    Parameters
    ----------
    grid : ArrivalGrid
        With the timing errors to use.
    row : int
        Which frequency of the grid.
    recipe : Recipe

    Returns
    -------
    Draws
        Without the leading axis.

    Raises
    ------
    ConvergenceError
        If the chains disagree.
    """
    heard = np.isfinite(grid.arrival_s[row])
    shape = ModelShape(
        receivers=int(heard.sum()),
        dimensions=recipe.dimensions,
        priors=recipe.preset.priors,
        noise=recipe.preset.noise,
        nuisances=bool(max(grid.delay_sd_s[row, heard].max(), grid.offset_sd_s[row, heard].max()) > 0),
    )
    offset = float(grid.arrival_s[row, heard].mean())
    trace = _run(_compiled(shape).with_data(**_inputs(grid, row, heard, offset, shape)), recipe, row)
    names = parameters(recipe.dimensions)
    effective = _effective(trace, float(grid.frequency_mhz[row]), names)
    *position, emission, v = (trace.posterior[name].to_numpy().ravel()[-recipe.draws :] for name in names)
    return Draws(np.stack(position, axis=-1), emission + offset, v, np.asarray(effective))


@dataclass(frozen=True)
class ModelShape:
    """What a compiled model depends on; everything else is data that are put in later.

    Attributes
    ----------
    receivers, dimensions : int
    priors : Priors
    noise : Noise
    nuisances : bool
        Whether delays or offsets are uncertain.
    """

    receivers: int
    dimensions: int
    priors: Priors
    noise: Noise
    nuisances: bool


def _inputs(grid: ArrivalGrid, row: int, heard: Any, offset: float, shape: ModelShape) -> dict[str, FloatArray]:
    inputs = {
        "receiver_rsun": grid.receiver_rsun[row, heard],
        "arrival_s": (grid.arrival_s - grid.delay_s)[row, heard] - offset,
        "sigma_s": grid.sigma_s[row, heard],
    }
    if shape.nuisances:
        inputs |= {name: getattr(grid, name)[row, heard] for name in ("delay_sd_s", "offset_sd_s")}
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
        Data ``receiver_rsun`` (n, 3), ``arrival_s`` (n,) with known delays taken off, ``sigma_s`` (n,) and, with
        nuisances, ``delay_sd_s`` and ``offset_sd_s`` (n,).
    """
    pm, priors = _library("pymc"), shape.priors
    with pm.Model() as model:
        receiver = pm.Data("receiver_rsun", np.eye(shape.receivers, 3) * 200.0)
        arrival = pm.Data("arrival_s", np.zeros(shape.receivers))
        sigma = pm.Data("sigma_s", np.ones(shape.receivers))
        v = pm.Deterministic("v_over_c", 1.0 + priors.v_sd_c * _speed_scaled(pm, priors))
        half_width = priors.emission_half_width_s
        emission = pm.Uniform("emission_s", -half_width, half_width, initval=-500.0)
        expected = emission + _distance(pm, shape, receiver) / (v * C_RSUN_S) + _nuisance(pm, shape)
        if shape.noise.bad_probability:
            pm.Potential("arrival", _log_mixture(pm, shape, arrival - expected, sigma))
        else:
            pm.Normal("arrival", expected, sigma, observed=arrival)
    return model


def _speed_scaled(pm: Any, priors: Priors) -> Any:
    if not priors.is_truncated:
        return pm.Normal("v_scaled")
    return pm.Truncated("v_scaled", pm.Normal.dist(), upper=(priors.v_max_c - 1) / priors.v_sd_c)


def _distance(pm: Any, shape: ModelShape, receiver: Any) -> Any:
    """Distance of the source from each receiver; the source is at z = 0 where it has no third coordinate."""
    tau = shape.priors.tau_rsun
    axes = [pm.Deterministic(f"{axis}_rsun", tau * pm.Normal(f"{axis}_scaled")) for axis in AXES[: shape.dimensions]]
    source = [*axes, *[0.0] * (3 - shape.dimensions)]
    return pm.math.sqrt(sum((source[i] - receiver[:, i]) ** 2 for i in range(3)))


def _nuisance(pm: Any, shape: ModelShape) -> Any:
    """Uncertain delay and offset of each arrival time."""
    if not shape.nuisances:
        return 0.0
    terms = []
    for name in ("delay", "offset"):
        sd = pm.Data(f"{name}_sd_s", np.zeros(shape.receivers))
        terms.append(sd * pm.Normal(f"{name}_scaled", shape=shape.receivers))
    return sum(terms)


def _log_mixture(pm: Any, shape: ModelShape, residual: Any, sigma: Any) -> Any:
    """Log likelihood summed over the sets of bad arrival times that are possible."""
    sets = shape.noise.bad_sets(shape.receivers)
    odds = np.log(shape.noise.bad_probability / (1 - shape.noise.bad_probability)) * sets.sum(axis=1)
    sd = pm.math.sqrt(sigma[None, :] ** 2 + sets * shape.noise.bad_sd_s**2)
    each = -0.5 * (residual[None, :] / sd) ** 2 - pm.math.log(sd)
    return pm.math.logsumexp(each.sum(axis=1) + odds - np.logaddexp.reduce(odds))


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
    if rhat > LARGEST_RHAT or effective < MIN_EFFECTIVE:
        raise ConvergenceError(
            f"{frequency_mhz:g} MHz: the chains do not agree (r-hat {rhat:.3f}, effective draws {effective:.0f}); "
            "use the method posterior, which needs no chains"
        )
    return effective


def _library(name: str) -> Any:
    """Import one of the sampler's libraries: seconds each, and only this method needs them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # arviz announces its next version to every user
        return import_module(name)


def _moments(draws: Draws, tau_rsun: float, bad_probability: FloatArray) -> Moments:
    covariance = np.stack([np.cov(some.T) for some in draws.position])
    radius = (draws.position**2).sum(axis=2)
    pull = [np.cov(some.T, of_it)[:-1, -1] for some, of_it in zip(draws.position, radius, strict=True)]
    return Moments(
        mean=draws.position.mean(axis=1),
        covariance=covariance,
        emission_s=draws.emission_s.mean(axis=1),
        emission_sd_s=draws.emission_s.std(axis=1),
        v_over_c=draws.v_over_c.mean(axis=1),
        v_over_c_sd=draws.v_over_c.std(axis=1),
        log_evidence=np.full(len(covariance), np.nan),
        above_c=(draws.v_over_c > 1).mean(axis=1),
        prior_pull=-0.5 * np.stack(pull) / tau_rsun**2,
        bad_probability=bad_probability,
    )


def _bad_probability(grid: ArrivalGrid, draws: Draws, noise: Noise) -> FloatArray:
    """Probability that each arrival time is bad, (F, n): that of the sets of bad ones given a draw, over the draws."""
    sets = noise.bad_sets(len(grid.observatories))
    if len(sets) == 1:
        return np.zeros_like(grid.arrival_s)
    predicted = predicted_arrivals(grid, draws.position, draws.emission_s, draws.v_over_c)
    residual = (grid.arrival_s - grid.delay_s)[:, None] - predicted
    stated = grid.sigma_s**2 + grid.delay_sd_s**2 + grid.offset_sd_s**2
    variance = stated[:, None, :] + sets * noise.bad_sd_s**2
    each = -0.5 * (residual[:, :, None, :] ** 2 / variance[:, None] + np.log(variance)[:, None])
    odds = np.log(noise.bad_probability / (1 - noise.bad_probability)) * sets.sum(axis=1)
    absent = (sets & ~np.isfinite(grid.arrival_s)[:, None, :]).any(axis=2)
    log_weight = np.nansum(each, axis=3) + np.where(absent, -np.inf, odds)[:, None]
    share = np.exp(log_weight - np.logaddexp.reduce(log_weight, axis=2)[..., None])
    return np.asarray(share.mean(axis=1) @ sets)


def _regions(draws: Draws) -> list[Region]:
    return [region_of_draws(_thinned(some)) for some in draws.position]


def _thinned(positions: FloatArray, most: int = 2000) -> FloatArray:
    return positions[:: max(1, len(positions) // most)]

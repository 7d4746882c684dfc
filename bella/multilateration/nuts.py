"""The same model sampled with PyMC: the reference that the exact posterior is held against.

The model is that of Canizares et al. (2024, A&A, doi:10.1051/0004-6361/202347747) in solar radii and seconds, in which
the sampler's unit scale is a good start; in metres it does not converge. PyMC is imported when a model is built.
"""

import warnings
from collections.abc import Callable
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np

from bella.arrivals import ArrivalGrid
from bella.exceptions import ConvergenceError
from bella.multilateration.draws import Draws
from bella.multilateration.moments import Moments
from bella.multilateration.priors import Priors
from bella.multilateration.regions import Region, region_of_draws
from bella.multilateration.solution import Posterior, Recipe
from bella.units import C_RSUN_S, FloatArray

CHAINS = 4
SCATTERED = ("x_scaled", "y_scaled", "v_scaled")
"""Where the chains start apart, by one prior standard deviation. Scattered over its prior as well, the emission time
starts so far off that a chain can end with a negative speed, from where it does not come back."""
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
    return Posterior(draws, _moments(draws), _regions(draws))


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
    compiled = _compiled(int(heard.sum()), recipe.preset.priors)
    offset = float(grid.arrival_s[row, heard].mean())
    trace = _run(
        compiled.with_data(
            receiver_rsun=grid.receiver_rsun[row, heard],
            arrival_s=grid.arrival_s[row, heard] - offset,
            sigma_s=grid.sigma_s[row, heard],
        ),
        recipe,
        row,
    )
    effective = _effective(trace, float(grid.frequency_mhz[row]))
    x, y, emission, v = (trace.posterior[name].to_numpy().ravel()[-recipe.draws :] for name in _NAMES)
    return Draws(np.stack([x, y], axis=-1), emission + offset, v, np.asarray(effective))


_NAMES = ("x_rsun", "y_rsun", "emission_s", "v_over_c")


@lru_cache(maxsize=8)
def _compiled(receivers: int, priors: Priors) -> Any:
    """Compiled model for a number of receivers; its data are put in later, so this is paid once."""
    model = build_model(receivers, priors)
    scattered = {model[name] for name in SCATTERED}
    return _library("nutpie").compile_pymc_model(model, jitter_rvs=scattered)


def build_model(receivers: int, priors: Priors) -> Any:
    """Model of one frequency with data to be put in.

    Parameters
    ----------
    receivers : int
        Number of receivers n.
    priors : Priors

    Returns
    -------
    pymc.Model
        Data ``receiver_rsun`` (n, 3), ``arrival_s`` (n,), ``sigma_s`` (n,).
    """
    pm = _library("pymc")
    with pm.Model() as model:
        receiver = pm.Data("receiver_rsun", np.eye(receivers, 3) * 200.0)
        arrival = pm.Data("arrival_s", np.zeros(receivers))
        sigma = pm.Data("sigma_s", np.ones(receivers))
        x, y = (pm.Deterministic(f"{axis}_rsun", priors.tau_rsun * pm.Normal(f"{axis}_scaled")) for axis in "xy")
        v = pm.Deterministic("v_over_c", 1.0 + priors.v_sd_c * pm.Normal("v_scaled"))
        half_width = priors.emission_half_width_s
        emission = pm.Uniform("emission_s", -half_width, half_width, initval=-500.0)
        distance = pm.math.sqrt((x - receiver[:, 0]) ** 2 + (y - receiver[:, 1]) ** 2 + receiver[:, 2] ** 2)
        pm.Normal("arrival", emission + distance / (v * C_RSUN_S), sigma, observed=arrival)
    return model


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


def _effective(trace: Any, frequency_mhz: float) -> float:
    """Smallest effective sample size of the parameters, after the chains were seen to agree."""
    az = _library("arviz")
    rhat = float(az.rhat(trace, var_names=list(_NAMES)).to_array().max())
    effective = float(az.ess(trace, var_names=list(_NAMES)).to_array().min())
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


def _moments(draws: Draws) -> Moments:
    covariance = np.stack([np.cov(some.T) for some in draws.position])
    return Moments(
        mean=draws.position.mean(axis=1),
        covariance=covariance,
        emission_s=draws.emission_s.mean(axis=1),
        emission_sd_s=draws.emission_s.std(axis=1),
        v_over_c=draws.v_over_c.mean(axis=1),
        v_over_c_sd=draws.v_over_c.std(axis=1),
        log_evidence=np.full(len(covariance), np.nan),
    )


def _regions(draws: Draws) -> list[Region]:
    return [region_of_draws(_thinned(some)) for some in draws.position]


def _thinned(positions: FloatArray, most: int = 2000) -> FloatArray:
    return positions[:: max(1, len(positions) // most)]

"""The joint model sampled with PyMC: the reference that importance sampling is held against.

The release time and the offsets of the clocks are parameters here, where importance sampling has integrated them out.
PyMC is imported when a model is built.
"""

import math
import warnings
from importlib import import_module
from typing import Any

import numpy as np

from bella.arrivals import ArrivalGrid
from bella.exceptions import ConvergenceError, InputError
from bella.heliosphere import angular_speed_rad_s
from bella.tracks.joint_fit import RELEASE
from bella.tracks.joint_likelihood import TimedChannels, timed_channels
from bella.tracks.joint_model import FASTEST_WIND_KM_S, PIVOT_MHZ, JointModel
from bella.units import C_RSUN_S, R_SUN_KM, FloatArray

CHAINS = 4
TUNE = 1000
LARGEST_RHAT = 1.02


def sample_joint_nuts(
    grid: ArrivalGrid,
    model: JointModel | None = None,
    *,
    common_sd_s: float | None = None,
    draws: int = 4000,
    seed: int = 0,
) -> dict[str, FloatArray]:
    """Sample the joint posterior with the No-U-Turn sampler.

    Parameters
    ----------
    grid : ArrivalGrid
        With the timing errors to use.
    model : JointModel, optional
        Without variants.
    common_sd_s : float or None
        As for :func:`bella.tracks.joint.fit_joint`.
    draws : int
        Of all chains together.
    seed : int

    Returns
    -------
    dict of str to ndarray, shape (N,)
        Draws of `model.parameters` and ``release_s``, as in :class:`bella.tracks.joint_fit.JointFit`, and
        ``effective``, the smallest effective number of draws of a parameter, shape (1,).

    Raises
    ------
    InputError
        If the model has a variant.
    ConvergenceError
        If the chains disagree.
    """
    chosen = model or JointModel()
    if chosen.deceleration or chosen.two_slope:
        raise InputError(f"model {chosen.name!r} is not sampled with PyMC; take the one without variants")
    built = build_joint_model(grid, chosen, common_sd_s)
    trace = _library("nutpie").sample(
        _library("nutpie").compile_pymc_model(built),
        draws=-(-draws // CHAINS),
        tune=TUNE,
        chains=CHAINS,
        cores=2,
        seed=seed,
        target_accept=0.95,
        progress_bar=False,
    )
    return _checked(trace, (*chosen.parameters, RELEASE))


def build_joint_model(grid: ArrivalGrid, model: JointModel, common_sd_s: float | None) -> Any:
    """Joint model of one burst.

    Parameters
    ----------
    grid : ArrivalGrid
    model : JointModel
        Without variants.
    common_sd_s : float or None

    Returns
    -------
    pymc.Model
    """
    pm, channels = _library("pymc"), timed_channels(grid, common_sd_s)
    heard = channels.precision > 0
    with pm.Model() as built:
        delay_s = _delay_s(pm, channels, model)
        middle_s = (delay_s * channels.precision).sum() / channels.precision.sum()
        # nearly independent of all else, which the release time itself is not
        centre = float((channels.arrival_s * channels.precision).sum() / channels.precision.sum())
        level = pm.Flat("level_s", initval=0.0) + centre
        pm.Deterministic(RELEASE, level - middle_s)
        expected = level - middle_s + delay_s + _offset_s(pm, grid, common_sd_s)
        pm.Normal(
            "arrival",
            expected[heard.nonzero()],
            1 / np.sqrt(channels.precision[heard]),
            observed=channels.arrival_s[heard],
        )
    return built


def _delay_s(pm: Any, channels: TimedChannels, model: JointModel) -> Any:
    """Delay after the release, (F, n); written out, since tensors do not pass through the physics of arrays."""
    p, math_ = model.priors, pm.math
    phi0_deg = pm.Deterministic("phi0_deg", p.phi0_deg + p.phi0_sd_deg * pm.Normal("phi0_z"))
    slowest = (p.v_sw_km_s / FASTEST_WIND_KM_S - 1) / p.slowness_sd
    slowness = pm.Truncated("slowness_z", pm.Normal.dist(), lower=slowest, initval=0.0)
    v_sw = pm.Deterministic("v_sw_km_s", p.v_sw_km_s / (1 + p.slowness_sd * slowness))
    a = pm.Deterministic("a_rsun", p.a_rsun * math_.exp(p.ln_a_sd * pm.Normal("ln_a_z")))
    b = pm.Deterministic("b", p.b + p.b_sd * pm.Normal("b_z"))
    fastest = -math.log(p.beam_speed_c) / p.ln_beam_sd
    ln_beam = pm.Truncated("ln_beam_z", pm.Normal.dist(), upper=fastest, initval=0.0)
    beam = pm.Deterministic("beam_speed_c", p.beam_speed_c * math_.exp(p.ln_beam_sd * ln_beam))
    r = a * math_.exp(b * np.log(channels.frequency_mhz / PIVOT_MHZ))
    k = angular_speed_rad_s(model.rotation_period_d) * R_SUN_KM / v_sw
    angle = phi0_deg * math.pi / 180 - k * (r - 1)
    x, y = (r * math_.cos(angle))[:, None], (r * math_.sin(angle))[:, None]
    s = channels.receiver_rsun
    light_s = math_.sqrt((x - s[..., 0]) ** 2 + (y - s[..., 1]) ** 2 + s[..., 2] ** 2) / C_RSUN_S
    return ((_arc(pm, r, k) - _arc(pm, 1.0, k)) / (beam * C_RSUN_S))[:, None] + light_s


def _arc(pm: Any, r: Any, k: Any) -> Any:
    return (r * pm.math.sqrt(1 + (k * r) ** 2) + pm.math.arcsinh(k * r) / k) / 2


def _offset_s(pm: Any, grid: ArrivalGrid, common_sd_s: float | None) -> Any:
    """Offset of each receiver, (n,)."""
    sd_s = grid.offset_sd_s.max(axis=0) if common_sd_s is None else np.full(len(grid.observatories), common_sd_s)
    if not sd_s.any():
        return 0.0
    return sd_s * pm.Normal("offset_z", shape=sd_s.size)


def _checked(trace: Any, names: tuple[str, ...]) -> dict[str, FloatArray]:
    az = _library("arviz")
    rhat = float(az.rhat(trace, var_names=list(names)).to_array().max())
    if rhat > LARGEST_RHAT:
        raise ConvergenceError(f"the chains do not agree (r-hat {rhat:.3f}); ask for more draws, or use fit_joint")
    effective = float(az.ess(trace, var_names=list(names)).to_array().min())
    drawn = {name: trace.posterior[name].to_numpy().ravel() for name in names}
    return drawn | {"effective": np.array([effective])}


def _library(name: str) -> Any:
    """Import one of the sampler's libraries: seconds each, and only this needs them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # arviz announces its next version to every user
        return import_module(name)

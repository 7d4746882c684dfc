"""The joint model sampled with PyMC: what importance sampling is held against, and what stands in where it fails.

The release time and the offsets of the clocks are parameters here, where importance sampling has integrated them out.
PyMC is imported when a model is built.
"""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np

from bella.arrivals import ArrivalGrid
from bella.exceptions import ConvergenceError
from bella.heliosphere import angular_speed_rad_s
from bella.heliosphere.beam import TRAVEL_NODES
from bella.tracks.joint_directions import DirectionTerms
from bella.tracks.joint_fit import RELEASE
from bella.tracks.joint_ingredients import JointOptions
from bella.tracks.joint_likelihood import TimedChannels, timed_channels
from bella.tracks.joint_model import FASTEST_WIND_KM_S, PIVOT_MHZ, JointModel
from bella.tracks.joint_observed import Observed
from bella.units import C_RSUN_S, R_SUN_KM, FloatArray

CHAINS = 4
TUNE = 1000
LARGEST_RHAT = 1.02
SMALLEST_SINE = 1e-9
"""Keeps the gradient of an angle finite where there is none."""


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
        If `draws` is below 100.
    ConvergenceError
        If the chains disagree.
    """
    observed = Observed(timed_channels(grid, common_sd_s))
    return _sampled(model or JointModel(), observed, JointOptions(draws, seed))


def try_nuts(model: JointModel, observed: Observed, options: JointOptions) -> dict[str, FloatArray] | None:
    """Sample the posterior of everything that was observed, if the chains agree.

    Parameters
    ----------
    model : JointModel
    observed : Observed
    options : JointOptions

    Returns
    -------
    dict of str to ndarray, or None
        As :func:`sample_joint_nuts` returns it; None where the chains disagree.
    """
    try:
        return _sampled(model, observed, options)
    except ConvergenceError:
        return None


def _sampled(model: JointModel, observed: Observed, options: JointOptions) -> dict[str, FloatArray]:
    trace = _library("nutpie").sample(
        _library("nutpie").compile_pymc_model(build_joint_model(observed, model)),
        draws=-(-options.draws // CHAINS),
        tune=TUNE,
        chains=CHAINS,
        cores=2,
        seed=options.seed,
        target_accept=0.95,
        progress_bar=False,
    )
    timed = () if observed.channels is None else (RELEASE,)
    return _checked(trace, (*model.parameters, *timed))


def build_joint_model(observed: Observed, model: JointModel) -> Any:
    """Joint model of one burst.

    Parameters
    ----------
    observed : Observed
    model : JointModel

    Returns
    -------
    pymc.Model
    """
    pm = _library("pymc")
    with pm.Model() as built:
        track = _track(pm, model, observed.frequency_mhz)
        if observed.channels is not None:
            _tell_arrivals(pm, track, observed.channels)
        if observed.directions is not None:
            terms = observed.directions
            pm.Potential("directions", -0.5 * (_angles(pm, track, terms) ** 2).sum())
        if observed.wind is not None:
            mean, relative_sd = observed.wind.v_sw_km_s, observed.wind.sd_km_s / observed.wind.v_sw_km_s
            slowness = sum(mean / wind for wind in track.winds) / len(track.winds)
            pm.Potential("wind", -0.5 * ((slowness - 1) / relative_sd) ** 2)
    return built


@dataclass(frozen=True)
class _Track:
    """Tensors of a track; written out, since tensors do not pass through the physics of arrays."""

    model: JointModel
    phi0: Any
    winds: list[Any]
    a: Any
    b: Any
    b2: Any
    beam: Any
    deceleration: Any

    def range_rsun(self, pm: Any, frequency_mhz: FloatArray) -> Any:
        """Distance at each frequency, solar radii, (F,)."""
        log_frequency = np.log(frequency_mhz / PIVOT_MHZ)
        below = np.minimum(log_frequency - math.log(self.model.break_mhz / PIVOT_MHZ), 0.0)
        return self.a * pm.math.exp(self.b * log_frequency + (self.b2 - self.b) * below)

    def along(self, pm: Any, r: Any, integral: Callable[[Any, Any], Any]) -> Any:
        """Integral over the distance from 1 solar radius, each segment with k of its wind."""
        knots, rate = self.model.knots_rsun, angular_speed_rad_s(self.model.rotation_period_d) * R_SUN_KM
        total = 0.0
        for wind, inner, outer in zip(self.winds, (1.0, *knots), (*knots, math.inf), strict=True):
            k, end = rate / wind, r if not knots else pm.math.minimum(r, outer)
            end = end if inner == 1.0 else pm.math.maximum(end, inner)
            total = total + integral(end, k) - integral(inner, k)
        return total

    def position(self, pm: Any, frequency_mhz: FloatArray) -> tuple[Any, Any, Any]:
        """Distance, x and y at each frequency."""
        r = self.range_rsun(pm, frequency_mhz)
        angle = self.phi0 - self.along(pm, r, lambda end, k: k * end)
        return r, r * pm.math.cos(angle), r * pm.math.sin(angle)


def _track(pm: Any, model: JointModel, frequency_mhz: FloatArray) -> _Track:
    p, exp = model.priors, pm.math.exp
    phi0_deg = pm.Deterministic("phi0_deg", p.phi0_deg + p.phi0_sd_deg * pm.Normal("phi0_z"))
    winds = [_wind(pm, model, name) for name in ("v_sw_km_s", *model.outer_winds)]
    a = pm.Deterministic("a_rsun", p.a_rsun * exp(p.ln_a_sd * pm.Normal("ln_a_z")))
    b = pm.Deterministic("b", p.b + p.b_sd * pm.Normal("b_z"))
    fastest = -math.log(p.beam_speed_c) / p.ln_beam_sd
    ln_beam = pm.Truncated("ln_beam_z", pm.Normal.dist(), upper=fastest, initval=0.0)
    beam = pm.Deterministic("beam_speed_c", p.beam_speed_c * exp(p.ln_beam_sd * ln_beam))
    b2 = pm.Deterministic("b2", p.b + p.b_sd * pm.Normal("b2_z")) if model.two_slope else b
    slowing = (
        pm.Deterministic("deceleration", p.deceleration_sd * pm.Normal("deceleration_z")) if model.deceleration else 0.0
    )
    track = _Track(model, phi0_deg * math.pi / 180, winds, a, b, b2, beam, slowing)
    if model.deceleration:
        farthest = track.range_rsun(pm, frequency_mhz[:1])[0]
        below_c = pm.math.log(beam) < slowing * pm.math.log(farthest)
        pm.Potential("below_c", pm.math.switch(below_c, 0.0, -np.inf))
    return track


def _wind(pm: Any, model: JointModel, name: str) -> Any:
    p = model.priors
    slowest = (p.v_sw_km_s / FASTEST_WIND_KM_S - 1) / p.slowness_sd
    label = name.replace("v_sw", "slowness").replace("_km_s", "") + "_z"
    slowness = pm.Truncated(label, pm.Normal.dist(), lower=slowest, initval=0.0)
    return pm.Deterministic(name, p.v_sw_km_s / (1 + p.slowness_sd * slowness))


def _tell_arrivals(pm: Any, track: _Track, channels: TimedChannels) -> None:
    heard = channels.precision > 0
    delay_s = _delay_s(pm, track, channels)
    middle_s = (delay_s * channels.precision).sum() / channels.precision.sum()
    # nearly independent of all else, which the release time itself is not
    centre = float((channels.arrival_s * channels.precision).sum() / channels.precision.sum())
    level = pm.Flat("level_s", initval=0.0) + centre
    pm.Deterministic(RELEASE, level - middle_s)
    expected = level - middle_s + delay_s + _offset_s(pm, channels.offset_sd_s)
    sigma_s = 1 / np.sqrt(channels.precision[heard])
    pm.Normal("arrival", expected[heard.nonzero()], sigma_s, observed=channels.arrival_s[heard])


def _delay_s(pm: Any, track: _Track, channels: TimedChannels) -> Any:
    """Delay after the release, (F, n)."""
    r, x, y = track.position(pm, channels.frequency_mhz)
    s = channels.receiver_rsun
    light_s = pm.math.sqrt((x[:, None] - s[..., 0]) ** 2 + (y[:, None] - s[..., 1]) ** 2 + s[..., 2] ** 2) / C_RSUN_S
    travel = partial(_slowed, pm, track.deceleration) if track.model.deceleration else partial(_arc, pm)
    return (track.along(pm, r, travel) / (track.beam * C_RSUN_S))[:, None] + light_s


def _slowed(pm: Any, deceleration: Any, r: Any, k: Any) -> Any:
    """Integral of sqrt(1 + k^2 r^2) r^d from 1, by Gauss-Legendre in ln r."""
    log_range, total = pm.math.log(r), 0.0
    for node, weight in zip(*np.polynomial.legendre.leggauss(TRAVEL_NODES), strict=True):
        at = 0.5 * (1 + float(node)) * log_range
        total = total + float(weight) * pm.math.exp((1 + deceleration) * at) * pm.math.sqrt(
            1 + (k * pm.math.exp(at)) ** 2
        )
    return 0.5 * log_range * total


def _angles(pm: Any, track: _Track, terms: DirectionTerms) -> Any:
    """Components of the angle between line of sight and direction over its error, independent, (K, 2)."""
    _, x, y = track.position(pm, terms.frequency_mhz)
    place, towards = terms.receiver_rsun, terms.towards
    sight = x - place[:, 0], y - place[:, 1], -place[:, 2]
    length = pm.math.sqrt(sum(part**2 for part in sight))
    cosine = sum(part * towards[:, axis] for axis, part in enumerate(sight)) / length
    across = [sum(part * side[:, axis] for axis, part in enumerate(sight)) / length for side in terms.sides]
    sine = pm.math.sqrt(across[0] ** 2 + across[1] ** 2 + SMALLEST_SINE**2)
    stretch = 2 * pm.math.arctan(sine / (1 + cosine)) / sine
    return terms.independent(pm.math.stack([one * stretch / np.radians(terms.sigma_deg) for one in across], axis=1))


def _arc(pm: Any, r: Any, k: Any) -> Any:
    return (r * pm.math.sqrt(1 + (k * r) ** 2) + pm.math.arcsinh(k * r) / k) / 2


def _offset_s(pm: Any, offset_sd_s: FloatArray) -> Any:
    """Offset of each receiver, (n,)."""
    return offset_sd_s * pm.Normal("offset_z", shape=offset_sd_s.size) if offset_sd_s.any() else 0.0


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

"""The result of a joint fit: its draws, what they say about each parameter, and how far to trust them."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bella.flags import NOT_CONSTRAINED
from bella.tracks.joint_model import TURN_DEG, JointModel, JointParameters
from bella.units import FloatArray

QUANTILES = {"q2_5": 0.025, "q16": 0.16, "q50": 0.5, "q84": 0.84, "q97_5": 0.975}
RELEASE = "release_s"
FAST_WIND_KM_S = 1500.0
RADIAL_PROBABILITY = 0.05
"""Of a wind above `FAST_WIND_KM_S`: the prior gives it 0.007."""
SECOND_TRACK = 0.05
MISFIT_PROBABILITY = 1e-4
IMPORTANCE, NUTS = "importance", "nuts"
"""Samplers."""


@dataclass(frozen=True)
class ParameterSummary:
    """What the posterior says about one parameter, in the unit of its name.

    Attributes
    ----------
    mean, sd : float
    q2_5, q16, q50, q84, q97_5 : float
        Quantiles.
    contraction : float
        Width of the posterior over that of the prior, in the form in which the prior is Gaussian; 0 for a flat one.
    """

    mean: float
    sd: float
    q2_5: float
    q16: float
    q50: float
    q84: float
    q97_5: float
    contraction: float


@dataclass(frozen=True)
class Quality:
    """How well the posterior was sampled, and how well the model explains the arrival times.

    Attributes
    ----------
    ess : float
        Effective number of the draws before they were resampled.
    ess_share : float
        The same over their number.
    log_evidence, log_evidence_se : float
        Logarithm of the evidence, up to the constant of the flat prior of the release time, and its standard error.
    misfit_p : float
        Probability of a larger misfit of data and prior together, were the model true.
    second_track : float
        Probability of all maxima but the first.
    """

    ess: float
    ess_share: float
    log_evidence: float
    log_evidence_se: float
    misfit_p: float
    second_track: float


@dataclass(frozen=True)
class Account:
    """What a fit took for granted, and what it did with its arrival times.

    Attributes
    ----------
    common_sd_s : dict of str to float
        Standard deviation of the offset that all channels of an observatory share, s, by observatory.
    common_assumed : tuple of str
        Observatories whose offset was not declared but assumed.
    down_weighted : tuple of (str, float, float)
        Observatory, frequency in MHz and weight of arrival times that were taken for bad.
    squares : dict of str to (float, int)
        Sum of squared residuals of each ingredient at the best track, and their number.
    sampler : str
        ``importance`` or ``nuts``.
    """

    common_sd_s: dict[str, float] = field(default_factory=dict)
    common_assumed: tuple[str, ...] = ()
    down_weighted: tuple[tuple[str, float, float], ...] = ()
    squares: dict[str, tuple[float, int]] = field(default_factory=dict)
    sampler: str = IMPORTANCE


@dataclass(frozen=True)
class JointFit:
    """Posterior of a spiral, a beam and a density law, from the arrival times of a burst.

    Attributes
    ----------
    model : JointModel
    reference_utc : numpy.datetime64
        What `release_s` counts from; also the epoch of the HEE axes.
    draws : dict of str to ndarray, shape (N,)
        Posterior draws of equal weight: `model.parameters` and ``release_s``. The longitude is not wrapped where the
        posterior lies across +-180 degrees. Empty where nothing was fitted.
    summary : dict of str to ParameterSummary
        Of the same; empty where nothing was fitted.
    quality : Quality or None
        None where nothing was fitted.
    flags : tuple of str
        Names of `bella.flags.TRACK_FLAGS`.
    account : Account
    """

    model: JointModel
    reference_utc: np.datetime64
    draws: dict[str, FloatArray]
    summary: dict[str, ParameterSummary]
    quality: Quality | None
    flags: tuple[str, ...]
    account: Account = field(default_factory=Account)

    @property
    def parameters(self) -> JointParameters:
        """The draws in the form the model takes."""
        return JointParameters(
            **{name: self.draws[name] for name in ("phi0_deg", "v_sw_km_s", "a_rsun", "b", "beam_speed_c")},
            deceleration=self.draws.get("deceleration", np.zeros(self.draws["b"].size)),
            b2=self.draws.get("b2", self.draws["b"]),
            outer_v_sw_km_s=np.stack([self.draws[name] for name in self.model.outer_winds], axis=1)
            if self.model.outer_winds
            else np.empty((self.draws["b"].size, 0)),
        )


def summarise(values: FloatArray, weight: FloatArray, contraction: float) -> ParameterSummary:
    """Moments and quantiles of weighted draws.

    Parameters
    ----------
    values, weight : ndarray, shape (N,)
        The weights add up to one.
    contraction : float

    Returns
    -------
    ParameterSummary
    """
    order = np.argsort(values)
    below = np.cumsum(weight[order]) - 0.5 * weight[order]
    quantiles = np.interp(list(QUANTILES.values()), below, values[order])
    mean = float(weight @ values)
    sd = math.sqrt(float(weight @ (values - mean) ** 2))
    named = dict(zip(QUANTILES, quantiles.tolist(), strict=True))
    return ParameterSummary(mean=mean, sd=sd, contraction=contraction, **named)


def beside_mean(longitude_deg: FloatArray, weight: FloatArray) -> FloatArray:
    """Longitudes within half a turn of their mean direction, whose mean lies in (-180, 180].

    Parameters
    ----------
    longitude_deg, weight : ndarray, shape (N,)

    Returns
    -------
    ndarray, shape (N,)
        Degrees.
    """
    direction = math.degrees(float(np.angle(weight @ np.exp(1j * np.radians(longitude_deg)))))
    close = direction + (longitude_deg - direction + 180) % TURN_DEG - 180
    mean = float(weight @ close)
    return np.asarray(close - mean + 180 - (180 - mean) % TURN_DEG)


def raised(summary: dict[str, ParameterSummary], quality: Quality, fast_wind: float, good_share: float) -> list[str]:
    """Flags of a fit.

    Parameters
    ----------
    summary : dict of str to ParameterSummary
    quality : Quality
    fast_wind : float
        Probability of a wind above `FAST_WIND_KM_S`.
    good_share : float
        Share of effective draws that is good enough.

    Returns
    -------
    list of str
        Names of `bella.flags.TRACK_FLAGS`.
    """
    applies = {
        "v_sw_not_constrained": any(
            one.contraction > NOT_CONSTRAINED for name, one in summary.items() if name.startswith("v_sw")
        ),
        "phi0_not_constrained": summary["phi0_deg"].contraction > NOT_CONSTRAINED,
        "not_a_spiral": fast_wind > RADIAL_PROBABILITY,
        "several_tracks": quality.second_track > SECOND_TRACK,
        "poor_fit": quality.misfit_p < MISFIT_PROBABILITY,
        "poor_weights": quality.ess_share < good_share,
    }
    return [name for name, on in applies.items() if on]


def joint_json(fit: JointFit) -> dict[str, Any]:
    """Fit as it is stored and served.

    Parameters
    ----------
    fit : JointFit

    Returns
    -------
    dict
        Ready for JSON: each parameter with mean, sd, quantiles and contraction, all None where nothing was fitted.
        ``release_utc`` has times for numbers, and its sd in s.
    """
    names = (*fit.model.parameters, RELEASE)
    empty = dict.fromkeys(ParameterSummary.__annotations__)
    parameters = {name: vars(fit.summary[name]) if name in fit.summary else empty for name in names}
    release = parameters.pop(RELEASE)
    timed = {name: _stamp(fit, value) for name, value in release.items() if name not in {"sd", "contraction"}}
    quality = fit.quality
    return {
        "model": fit.model.name,
        **parameters,
        "release_utc": {**release, **timed},
        "rotation_period_d": fit.model.rotation_period_d,
        "epoch_utc": _stamp(fit, 0.0),
        "ess": quality and quality.ess,
        "log_evidence": quality and quality.log_evidence,
        "log_evidence_se": quality and quality.log_evidence_se,
        "misfit_p": quality and quality.misfit_p,
        "sampler": fit.account.sampler,
        **_taken_for_granted(fit.account),
        **wind_segments(fit),
        "flags": list(fit.flags),
    }


def _taken_for_granted(account: Account) -> dict[str, Any]:
    names = ("observatory", "frequency_mhz", "weight")
    return {
        "common_sd_s": account.common_sd_s,
        "common_sd_assumed": list(account.common_assumed),
        "down_weighted": [dict(zip(names, one, strict=True)) for one in account.down_weighted],
    }


def wind_segments(fit: JointFit) -> dict[str, Any]:
    """Speed of the wind between the knots, where there are any."""
    knots = fit.model.knots_rsun
    if not (knots and fit.summary):
        return {}
    winds = ("v_sw_km_s", *fit.model.outer_winds)
    limits = zip((1.0, *knots), (*knots, None), winds, strict=True)
    return {
        "segments": [
            {"from_rsun": low, "to_rsun": high, "v_sw_km_s": vars(fit.summary[name])} for low, high, name in limits
        ]
    }


def _stamp(fit: JointFit, seconds: float | None) -> str | None:
    if seconds is None:
        return None
    moment = fit.reference_utc.astype("datetime64[ms]") + np.timedelta64(round(seconds * 1e3), "ms")
    return f"{moment}Z"

"""One fit to the arrival times of all frequencies and receivers of a burst: spiral, beam and density law together.

Fitting a line through positions that were found one by one takes them as independent, which they are not; fitted
jointly, the errors of the speed of the wind and of the longitude are what they say.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, logsumexp

from bella.arrivals import ArrivalGrid
from bella.exceptions import InputError
from bella.tracks.joint_fit import (
    FAST_WIND_KM_S,
    MISFIT_PROBABILITY,
    RELEASE,
    JointFit,
    ParameterSummary,
    Quality,
    beside_mean,
    raised,
    summarise,
)
from bella.tracks.joint_likelihood import TimedChannels, timed_channels
from bella.tracks.joint_model import PHI0, JointModel
from bella.tracks.joint_modes import Modes, find_modes
from bella.tracks.joint_posterior import GOOD_SHARE, WeightedDraws, mode_weights, sample_posterior
from bella.units import FloatArray

MIN_FREQUENCIES = 4
MIN_EFFECTIVE = 50
"""Effective draws below which a posterior was not found, and no numbers are given."""
DRAWS = 4000


@dataclass(frozen=True)
class ModelEvidence:
    """How one of several models stands.

    Attributes
    ----------
    fit : JointFit
    log_bayes_factor : float
        Logarithm of its evidence over that of the best.
    probability : float
        With equal prior probability of all.
    """

    fit: JointFit
    log_bayes_factor: float
    probability: float


def fit_joint(
    grid: ArrivalGrid,
    model: JointModel | None = None,
    *,
    common_sd_s: float | None = None,
    draws: int = DRAWS,
    seed: int = 0,
) -> JointFit:
    """Fit spiral, beam and density law to the arrival times of a burst.

    Parameters
    ----------
    grid : ArrivalGrid
        With the timing errors to use; frequencies heard by one or two receivers count too.
    model : JointModel, optional
    common_sd_s : float or None
        Standard deviation of the offset that all channels of a receiver share, s; None: that of the grid.
    draws : int
    seed : int

    Returns
    -------
    JointFit
        Without numbers, and with a flag, where there are fewer than four frequencies or too few arrival times, and
        where fewer than 50 draws count.

    Raises
    ------
    InputError
        If `draws` is below 100, or `common_sd_s` below 0.
    """
    if draws < 100 or (common_sd_s is not None and not 0 <= common_sd_s < np.inf):
        raise InputError(f"draws {draws}, common offset {common_sd_s} s: give 100 draws or more and 0 s or more")
    chosen = model or JointModel()
    channels = timed_channels(grid, common_sd_s)
    if grid.frequency_mhz.size < MIN_FREQUENCIES or channels.size <= len(chosen.parameters) + 1:
        return JointFit(chosen, grid.reference_utc, {}, {}, None, ("too_few_frequencies",))
    rng = np.random.default_rng(seed)
    modes = find_modes(chosen, channels)
    sampled, proposal = sample_posterior(chosen, channels, modes, draws, rng)
    quality = _quality(sampled, channels, modes, mode_weights(chosen, proposal, sampled))
    if quality.ess < MIN_EFFECTIVE:
        flags = ("poor_fit", "poor_weights") if quality.misfit_p < MISFIT_PROBABILITY else ("poor_weights",)
        return JointFit(chosen, grid.reference_utc, {}, {}, None, flags)
    return _fitted(chosen, grid.reference_utc, channels, (sampled, quality), rng)


def compare_models(
    grid: ArrivalGrid, models: Iterable[JointModel], *, common_sd_s: float | None = None, seed: int = 0
) -> list[ModelEvidence]:
    """Fit several models and weigh them by their evidence (Kass & Raftery 1995, doi:10.2307/2291091).

    Parameters
    ----------
    grid : ArrivalGrid
    models : iterable of JointModel
    common_sd_s : float or None
        As for :func:`fit_joint`.
    seed : int

    Returns
    -------
    list of ModelEvidence
        The best first.

    Raises
    ------
    InputError
        If there is no model, or one that cannot be fitted.
    """
    fits = [fit_joint(grid, model, common_sd_s=common_sd_s, seed=seed) for model in models]
    log_evidence = np.array([fit.quality.log_evidence for fit in fits if fit.quality is not None])
    if not 0 < len(log_evidence) == len(fits):
        raise InputError(
            "models cannot be compared: give one or more, and more arrival times, that one of them explains"
        )
    share = np.exp(log_evidence - logsumexp(log_evidence))
    best = float(log_evidence.max())
    return [ModelEvidence(fits[i], float(log_evidence[i]) - best, float(share[i])) for i in np.argsort(-log_evidence)]


def track_positions(fit: JointFit, frequency_mhz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Posterior of the position of the source at each frequency.

    Parameters
    ----------
    fit : JointFit
    frequency_mhz : ndarray, shape (F,)

    Returns
    -------
    tuple of ndarray
        Mean, shape (F, 2), HEE x and y in solar radii, and covariance, shape (F, 2, 2).

    Raises
    ------
    InputError
        If nothing was fitted.
    """
    if not fit.draws:
        raise InputError(f"there is no track: {', '.join(fit.flags)}; add frequencies")
    range_rsun = fit.model.range_rsun(fit.parameters, np.asarray(frequency_mhz, dtype=np.float64))
    position = fit.model.position_rsun(fit.parameters, range_rsun)[..., :2]
    mean = position.mean(axis=0)
    away = position - mean
    return mean, np.einsum("nfi,nfj->fij", away, away) / (len(away) - 1)


def _fitted(
    model: JointModel,
    reference_utc: np.datetime64,
    channels: TimedChannels,
    found: tuple[WeightedDraws, Quality],
    rng: np.random.Generator,
) -> JointFit:
    sampled, quality = found
    scatter_s = rng.standard_normal(sampled.weight.size) / np.sqrt(channels.release_precision)
    values = _values(model, sampled, scatter_s)
    summary = _summary(model, sampled, values)
    fast_wind = float(sampled.weight[values["v_sw_km_s"] > FAST_WIND_KM_S].sum())
    taken = _resampled(sampled.weight, rng)
    equal = {name: value[taken] for name, value in values.items()}
    flags = tuple(raised(summary, quality, fast_wind, GOOD_SHARE))
    return JointFit(model, reference_utc, equal, summary, quality, flags)


def _values(model: JointModel, sampled: WeightedDraws, scatter_s: FloatArray) -> dict[str, FloatArray]:
    """Draws in natural units by name, still weighted."""
    natural = model.natural(sampled.z)
    values = {name: np.asarray(getattr(natural, name)) for name in model.parameters}
    values["phi0_deg"] = beside_mean(natural.phi0_deg, sampled.weight)
    return values | {RELEASE: sampled.release_s + scatter_s}


def _summary(model: JointModel, sampled: WeightedDraws, values: dict[str, FloatArray]) -> dict[str, ParameterSummary]:
    z = sampled.z.copy()
    z[:, PHI0] = values["phi0_deg"] / model.priors.phi0_sd_deg
    spread = np.sqrt(sampled.weight @ (z - sampled.weight @ z) ** 2)
    contraction = dict(zip(model.parameters, spread.tolist(), strict=True)) | {RELEASE: 0.0}
    return {name: summarise(value, sampled.weight, contraction[name]) for name, value in values.items()}


def _quality(sampled: WeightedDraws, channels: TimedChannels, modes: Modes, share: FloatArray) -> Quality:
    return Quality(
        ess=sampled.effective_share * sampled.weight.size,
        ess_share=sampled.effective_share,
        log_evidence=sampled.log_evidence,
        log_evidence_se=sampled.log_evidence_se,
        misfit_p=float(chdtrc(channels.size - 1, modes.misfit)),
        second_track=max(float(1 - share.max()), 0.0),
    )


def _resampled(weight: FloatArray, rng: np.random.Generator) -> np.ndarray:
    """Places of draws of equal weight: systematic resampling, in random order."""
    place = (np.arange(weight.size) + rng.uniform()) / weight.size
    return rng.permutation(np.minimum(np.searchsorted(np.cumsum(weight), place), weight.size - 1))

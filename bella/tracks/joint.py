"""One fit to the arrival times of all frequencies and receivers of a burst: spiral, beam and density law together.

Fitting a line through positions that were found one by one takes them as independent, which they are not; fitted
jointly, the errors of the speed of the wind and of the longitude are what they say.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, logsumexp

from bella.arrivals import ArrivalGrid
from bella.exceptions import InputError
from bella.tracks.joint_fit import (
    FAST_WIND_KM_S,
    MISFIT_PROBABILITY,
    NUTS,
    RELEASE,
    Account,
    JointFit,
    Quality,
    beside_mean,
    raised,
    summarise,
)
from bella.tracks.joint_ingredients import DRAWS, Ingredients, JointOptions
from bella.tracks.joint_likelihood import common_offset_s
from bella.tracks.joint_model import JointModel
from bella.tracks.joint_modes import Modes, climb, find_modes
from bella.tracks.joint_nuts import try_nuts
from bella.tracks.joint_observed import Observed
from bella.tracks.joint_posterior import GOOD_SHARE, WeightedDraws, mode_weights, sample_posterior
from bella.tracks.joint_robust import DOWN_WEIGHTED, robust_modes
from bella.units import FloatArray

MIN_FREQUENCIES = 4
NUTS_EFFECTIVE = 400
"""Effective draws of PyMC that are enough: 100 for each of four chains (Vehtari et al. 2021, doi:10.1214/20-BA1221)."""
BLIND_RECEIVERS = 3
"""So many receivers cannot show an offset."""
MIN_EFFECTIVE = 50
"""Effective draws below which a posterior was not found, and no numbers are given."""


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
        As for :class:`bella.tracks.joint_ingredients.Ingredients`.
    draws : int
    seed : int

    Returns
    -------
    JointFit
        As :func:`fit_ingredients` returns it.

    Raises
    ------
    InputError
        If `draws` is below 100, or `common_sd_s` below 0.
    """
    return fit_ingredients(Ingredients(grid, common_sd_s), model, JointOptions(draws, seed))


def fit_ingredients(
    known: Ingredients, model: JointModel | None = None, options: JointOptions | None = None
) -> JointFit:
    """Fit spiral, beam and density law to all that is known of a burst.

    Parameters
    ----------
    known : Ingredients
    model : JointModel, optional
    options : JointOptions, optional

    Returns
    -------
    JointFit
        Without numbers, and with a flag, where there are fewer than four frequencies or too few arrival times, and
        where fewer than 50 draws count.
    """
    chosen, options = model or JointModel(), options or JointOptions()
    observed, account = known.observed(), _account(known)
    if _too_few(known, chosen, observed):
        return JointFit(chosen, known.arrivals.reference_utc, {}, {}, None, ("too_few_frequencies",), account)
    rng = np.random.default_rng(options.seed)
    modes, observed, account = _found(chosen, known, (observed, account), options)
    sampled, proposal = sample_posterior(chosen, observed, modes, options.draws, rng)
    account = replace(account, squares=observed.squares(chosen, modes.z[0]))
    freedom = max(observed.freedom - len(account.down_weighted), 1)
    misfit = _least_misfit(chosen, (known, observed), modes)
    quality = _quality(sampled, freedom, misfit, mode_weights(chosen, proposal, sampled))
    if options.fallback and _worth_sampling(chosen, quality):
        drawn = try_nuts(chosen, observed, options)
        if drawn is not None:
            return _from_nuts(chosen, known.arrivals.reference_utc, drawn, (quality, account))
    if quality.ess < MIN_EFFECTIVE:
        flags = ("poor_fit", "poor_weights") if quality.misfit_p < MISFIT_PROBABILITY else ("poor_weights",)
        return JointFit(chosen, known.arrivals.reference_utc, {}, {}, None, flags, account)
    values = _values(chosen, sampled, observed, rng)
    return _fitted(chosen, known.arrivals.reference_utc, (values, sampled.weight), (quality, account), rng)


def compare_models(
    known: ArrivalGrid | Ingredients, models: Iterable[JointModel], options: JointOptions | None = None
) -> list[ModelEvidence]:
    """Fit several models and weigh them by their evidence (Kass & Raftery 1995, doi:10.2307/2291091).

    Parameters
    ----------
    known : ArrivalGrid or Ingredients
    models : iterable of JointModel
    options : JointOptions, optional
        Bad arrival times are weighted down as the first of the models has it, so that all explain the same.

    Returns
    -------
    list of ModelEvidence
        The best first; models whose posterior was not found are left out.

    Raises
    ------
    InputError
        If there is no model, or none that can be fitted.
    """
    ingredients = known if isinstance(known, Ingredients) else Ingredients(known)
    options, models = options or JointOptions(), list(models)
    if models and options.robust:
        ingredients, options = _weighted_down(ingredients, models[0]), replace(options, robust=False)
    if models:  # those of the first are near those of its variants
        found = find_modes(models[0], ingredients.observed())
        options = replace(options, near=dict(zip(models[0].parameters, found.z.T, strict=True)))
    fits = [fit for model in models if (fit := fit_ingredients(ingredients, model, options)).quality is not None]
    log_evidence = np.array([fit.quality.log_evidence for fit in fits if fit.quality is not None])
    if not fits:
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


def wind_knots(fit: JointFit, frequency_mhz: FloatArray, number: int) -> tuple[float, ...]:
    """Distances that divide the sources of a fit into parts of equal number of frequencies.

    Parameters
    ----------
    fit : JointFit
    frequency_mhz : ndarray, shape (F,)
    number : int
        Of knots.

    Returns
    -------
    tuple of float
        Ascending, whole solar radii; one is at the median distance.

    Raises
    ------
    InputError
        If nothing was fitted.
    """
    if not fit.draws:
        raise InputError(f"there is no track: {', '.join(fit.flags)}; add frequencies")
    range_rsun = np.median(fit.model.range_rsun(fit.parameters, np.asarray(frequency_mhz, dtype=np.float64)), axis=0)
    places = np.quantile(range_rsun, np.arange(1, number + 1) / (number + 1))
    return tuple(np.unique(np.maximum(np.round(places), 2.0)).tolist())


def _account(known: Ingredients) -> Account:
    if known.without_arrivals:
        return Account()
    names = known.arrivals.observatories
    offset_s, assumed = common_offset_s(known.arrivals, known.common_sd_s)
    shared = dict(zip(names, offset_s.tolist(), strict=True))
    return Account(shared, tuple(name for name, one in zip(names, assumed, strict=True) if one))


def _too_few(known: Ingredients, model: JointModel, observed: Observed) -> bool:
    if known.without_arrivals:
        return observed.freedom == 0
    return known.arrivals.frequency_mhz.size < MIN_FREQUENCIES or observed.freedom <= len(model.parameters)


def _found(
    model: JointModel, known: Ingredients, begun: tuple[Observed, Account], options: JointOptions
) -> tuple[Modes, Observed, Account]:
    """Maxima, what they are the maxima of, and the arrival times that were weighted down."""
    observed, account = begun
    if not options.robust or known.without_arrivals:
        return find_modes(model, observed, options.near), observed, account
    modes, weighted, weight = robust_modes(model, observed)
    grid = known.arrivals
    bad = tuple(
        (grid.observatories[column], float(grid.frequency_mhz[row]), float(weight[row, column]))
        for row, column in np.argwhere(weight < DOWN_WEIGHTED)
    )
    return modes, weighted, replace(account, down_weighted=bad)


def _weighted_down(known: Ingredients, model: JointModel) -> Ingredients:
    """The same with the timing errors of bad arrival times as large as they must be."""
    weight = robust_modes(model, known.observed())[2]
    if known.without_arrivals or (weight == 1).all():
        return known
    grid = known.arrivals
    variance = (grid.sigma_s**2 + grid.delay_sd_s**2) / weight - grid.delay_sd_s**2
    # offsets are settled by the errors as they were stated
    offset_s = np.broadcast_to(common_offset_s(grid, known.common_sd_s)[0], grid.arrival_s.shape)
    return replace(known, arrivals=replace(grid, sigma_s=np.sqrt(variance), offset_sd_s=offset_s))


def _least_misfit(model: JointModel, seen: tuple[Ingredients, Observed], modes: Modes) -> float:
    """Squared residuals at the best track, without offsets that are only assumed where they could show none.

    Three receivers follow any offset by moving the source: residuals that an assumed one takes up are the model's.
    """
    (known, observed), channels = seen, seen[1].channels
    if channels is None or len(known.arrivals.observatories) > BLIND_RECEIVERS:
        return modes.misfit
    assumed = common_offset_s(known.arrivals, known.common_sd_s)[1]
    if not assumed.any():
        return modes.misfit
    bare = replace(observed, channels=replace(channels, offset_sd_s=np.where(assumed, 0.0, channels.offset_sd_s)))
    return 2 * float(climb(model, bare, modes.z)[1].min())


def _worth_sampling(model: JointModel, quality: Quality) -> bool:
    """Too few draws count, and neither because nothing explains the arrival times nor where PyMC takes minutes."""
    hopeless = quality.ess < MIN_EFFECTIVE and quality.misfit_p < MISFIT_PROBABILITY
    return quality.ess_share < GOOD_SHARE and not hopeless and not model.deceleration


def _from_nuts(
    model: JointModel,
    reference_utc: np.datetime64,
    drawn: dict[str, FloatArray],
    found: tuple[Quality, Account],
) -> JointFit:
    quality, account = found
    effective, number = float(drawn["effective"][0]), drawn["b"].size
    values = {name: value for name, value in drawn.items() if name != "effective"}
    weight = np.full(number, 1 / number)
    values["phi0_deg"] = beside_mean(values["phi0_deg"], weight)
    quality = replace(quality, ess=effective, ess_share=effective / number)
    rng = np.random.default_rng(0)
    return _fitted(model, reference_utc, (values, weight), (quality, replace(account, sampler=NUTS)), rng)


def _fitted(
    model: JointModel,
    reference_utc: np.datetime64,
    weighted: tuple[dict[str, FloatArray], FloatArray],
    found: tuple[Quality, Account],
    rng: np.random.Generator,
) -> JointFit:
    (values, weight), (quality, account) = weighted, found
    summary = {
        name: summarise(value, weight, _contraction(model, name, value, weight)) for name, value in values.items()
    }
    winds = [values[name] for name in ("v_sw_km_s", *model.outer_winds)]
    fast_wind = max(float(weight[wind > FAST_WIND_KM_S].sum()) for wind in winds)
    taken = _resampled(weight, rng)
    equal = {name: value[taken] for name, value in values.items()}
    flags = raised(summary, quality, fast_wind, GOOD_SHARE if account.sampler != NUTS else NUTS_EFFECTIVE / weight.size)
    if account.down_weighted:
        flags.append("arrivals_down_weighted")
    return JointFit(model, reference_utc, equal, summary, quality, tuple(flags), account)


def _values(
    model: JointModel, sampled: WeightedDraws, observed: Observed, rng: np.random.Generator
) -> dict[str, FloatArray]:
    """Draws in natural units by name, still weighted."""
    natural = model.natural(sampled.z)
    values = {name: np.asarray(getattr(natural, name)) for name in model.parameters if name not in model.outer_winds}
    values |= dict(zip(model.outer_winds, natural.outer_v_sw_km_s.T, strict=True))
    values["phi0_deg"] = beside_mean(natural.phi0_deg, sampled.weight)
    if observed.channels is None:
        return values
    scatter_s = rng.standard_normal(sampled.weight.size) / np.sqrt(observed.channels.release_precision)
    return values | {RELEASE: sampled.release_s + scatter_s}


def _contraction(model: JointModel, name: str, value: FloatArray, weight: FloatArray) -> float:
    """Width of weighted draws over that of the prior, in the form in which the prior is Gaussian."""
    if name == RELEASE:
        return 0.0
    standard = model.standard(name, value)
    return float(np.sqrt(weight @ (standard - weight @ standard) ** 2))


def _quality(sampled: WeightedDraws, freedom: int, misfit: float, share: FloatArray) -> Quality:
    return Quality(
        ess=sampled.effective_share * sampled.weight.size,
        ess_share=sampled.effective_share,
        log_evidence=sampled.log_evidence,
        log_evidence_se=sampled.log_evidence_se,
        misfit_p=float(chdtrc(freedom, misfit)),
        second_track=max(float(1 - share.max()), 0.0),
    )


def _resampled(weight: FloatArray, rng: np.random.Generator) -> np.ndarray:
    """Places of draws of equal weight: systematic resampling, in random order."""
    place = (np.arange(weight.size) + rng.uniform()) / weight.size
    return rng.permutation(np.minimum(np.searchsorted(np.cumsum(weight), place), weight.size - 1))

"""What else a burst says of its track: models with laws against the one without, and what further data add to it."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import logsumexp

from bella.answer import no_track
from bella.arrivals import ArrivalGrid
from bella.exceptions import InputError, NoDataError
from bella.flags import DISAGREE_SD
from bella.records import Parameter
from bella.tracks.directions import DirectionTerms
from bella.tracks.fit import TrackFit, refit, summary
from bella.tracks.likelihood import Likelihood
from bella.tracks.model import Distance, Emission, Track, TrackModel, WindPrior
from bella.units import FloatArray, within_half_turn_deg

COMPARED: tuple[tuple[Distance, Emission], ...] = (
    ("free", "free"),
    ("free", "constant"),
    ("free", "slowing"),
    ("power", "constant"),
    ("power", "slowing"),
)
"""Laws of distance and emission that are compared: the headline, and beams that have one."""

DRAWS = 1000
"""Of each model: its evidence is good to 0.05 with as many."""

MOST_TENSION = 37.0
"""Where its probability cannot be written any more."""

LEAST_GAIN = 0.3
"""Share of the standard deviation that further data count as having gained at least: posteriors are not Gaussian, and a
shift over next to nothing would count as a contradiction."""


@dataclass(frozen=True)
class ModelEvidence:
    """How one of several models stands.

    Attributes
    ----------
    log_bayes_factor : float
        Logarithm of its evidence over that of the best.
    probability : float
        With equal prior probability of all.
    """

    fit: TrackFit
    log_bayes_factor: float
    probability: float


def models_of(fit: TrackFit, frequency_mhz: FloatArray) -> list[TrackModel]:
    """Models to compare with that of a fit: laws for distance and beam, and a wind that changes halfway.

    Parameters
    ----------
    frequency_mhz : ndarray, shape (F,)

    Returns
    -------
    list of TrackModel
    """
    model = fit.track.model
    laws = [one for one in COMPARED if one != (model.distance, model.emission)]
    others = [replace(model, distance=distance, emission=emission) for distance, emission in laws]
    knot = float(np.round(np.median(fit.range_rsun(frequency_mhz))))
    return [*others, replace(model, knots_rsun=(max(knot, 2.0),))]


def compare_models(fit: TrackFit, grid: ArrivalGrid, seed: int = 0) -> list[ModelEvidence]:
    """Weigh models by their evidence (Kass & Raftery 1995, doi:10.2307/2291091), all with the noise of one fit.

    Parameters
    ----------
    grid : ArrivalGrid
        That it was fitted to.

    Returns
    -------
    list of ModelEvidence
        The most probable first.

    Raises
    ------
    NoDataError
        If nothing was fitted.
    """
    if not fit.draws:
        raise NoDataError(f"{no_track(fit.record.flags)}: add frequencies")
    fits = [fit]
    for model in models_of(fit, grid.frequency_mhz):
        likelihood = replace(fit.likelihood, track=Track(model, fit.track.band_mhz))
        fits.append(refit(fit, grid, likelihood, draws=DRAWS, seed=seed))
    log_evidence = np.array([one.record.log_evidence for one in fits], dtype=np.float64)
    share = np.exp(log_evidence - logsumexp(log_evidence))
    best = float(log_evidence.max())
    return [ModelEvidence(fits[i], float(log_evidence[i]) - best, float(share[i])) for i in np.argsort(-log_evidence)]


def models_companion(fit: TrackFit, grid: ArrivalGrid, seed: int = 0) -> dict[str, Any]:
    """Models by their evidence, and the longitude averaged over them (Hoeting et al. 1999, doi:10.1214/ss/1009212519).

    Returns
    -------
    dict
        Ready for JSON: ``rows`` with model, logarithm of the evidence over that of the best, probability, longitude and
        wind, the best first; ``phi0_deg`` averaged; and flags.

    Raises
    ------
    NoDataError
        If nothing was fitted.
    """
    ranked = compare_models(fit, grid, seed)
    return {
        "model": f"{len(ranked)} models, equally probable beforehand, by their evidence",
        "rows": [_row(one) for one in ranked],
        "phi0_deg": _averaged(ranked).model_dump(exclude={"contraction"}),
        "flags": [],
    }


def _row(one: ModelEvidence) -> dict[str, Any]:
    record = one.fit.record
    return {
        "name": record.model,
        "log_bayes_factor": one.log_bayes_factor,
        "probability": one.probability,
        "flags": list(record.flags),
        "phi0_deg": record.phi0_deg.model_dump(),
        "v_sw_km_s": record.v_sw_km_s.model_dump(),
        "beam_speed_c": record.beam_speed_c.model_dump(),
        "winds": [part.model_dump() for part in record.winds],
    }


def _averaged(ranked: list[ModelEvidence]) -> Parameter:
    """Longitude of the mixture of all posteriors."""
    longitude = np.concatenate([one.fit.draws["phi0_deg"] for one in ranked])
    weight = np.concatenate([np.full(len(one.fit.z), one.probability / len(one.fit.z)) for one in ranked])
    middle = np.degrees(np.angle(weight @ np.exp(1j * np.radians(longitude))))
    return summary(middle + within_half_turn_deg(longitude - middle), weight, None)


def fused_companion(
    fit: TrackFit, grid: ArrivalGrid, directions: DirectionTerms | None, wind: WindPrior | None, seed: int = 0
) -> dict[str, Any]:
    """One fit to arrival times, wave directions and a measured wind, and what each of the two adds.

    Parameters
    ----------
    fit : TrackFit
        To the arrival times.
    wind : WindPrior or None
        Of the apparent spiral; takes the place of the broad prior.

    Returns
    -------
    dict
        Ready for JSON: the record of the fit to all, and ``ingredients`` with name, ``sd_ratio`` (width of the interval
        with it over that without it, by parameter) and ``tension`` (by how many standard deviations it moves them).

    Raises
    ------
    InputError
        If there are arrival times alone.
    NoDataError
        If nothing was fitted.
    """
    inside = None if directions is None else directions.within(*fit.track.band_mhz)
    known = {"wave_directions": inside, "wind_prior": wind}
    there = [name for name, one in known.items() if one is not None]
    if not there:
        raise InputError("there are neither wave directions nor a measured wind: the joint fit has the arrival times")
    if not fit.draws:
        raise NoDataError(f"{no_track(fit.record.flags)}: add frequencies")
    everything = refit(fit, grid, _with(fit.likelihood, inside, wind), seed=seed)
    ingredients = []
    for name in there:
        left = {**known, name: None}
        others = fit
        if any(one is not None for one in left.values()):
            others = refit(fit, grid, _with(fit.likelihood, left["wave_directions"], left["wind_prior"]), seed=seed)  # type: ignore[arg-type]
        ingredients.append(_weight(name, everything, others))
    record = everything.record.model_dump(mode="json")
    if max(one["tension"] for one in ingredients) > DISAGREE_SD:
        record["flags"] = [*record["flags"], "ingredients_disagree"]
    return record | {"ingredients": ingredients}


def _with(likelihood: Likelihood, directions: DirectionTerms | None, wind: WindPrior | None) -> Likelihood:
    track = likelihood.track
    model = track.model if wind is None else replace(track.model, wind=wind)
    return replace(likelihood, track=Track(model, track.band_mhz), directions=directions)


def _weight(name: str, everything: TrackFit, others: TrackFit) -> dict[str, Any]:
    """What one ingredient adds: how much narrower parameters become, and how far it moves them.

    The difference of two means of which one holds the data of the other has the difference of their variances.
    """
    ratio, tension = {}, 0.0
    for parameter in ("phi0_deg", "v_sw_km_s"):
        with_it, without = (getattr(one.record, parameter) for one in (everything, others))
        ratio[parameter] = (with_it.q84 - with_it.q16) / (without.q84 - without.q16)
        gained = max(without.sd**2 - with_it.sd**2, (LEAST_GAIN * without.sd) ** 2)
        moved = with_it.q50 - without.q50
        if parameter == "phi0_deg":
            moved = float(within_half_turn_deg(moved))
        tension = max(tension, abs(moved) / gained**0.5)
    return {"name": name, "sd_ratio": ratio, "tension": min(tension, MOST_TENSION)}

"""Importance sampling of the joint posterior.

Draws come from a mixture of Student's t around the maxima and carry weights (Geweke 1989, Econometrica 57, 1317,
doi:10.2307/1913710). Where too few of them count, the mixture is fitted to the weighted draws and drawn from again
(adaptive mixtures: Cappe et al. 2008, Stat. Comput. 18, 447, doi:10.1007/s11222-008-9059-x).
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln, logsumexp

from bella.tracks.joint_likelihood import log_likelihood
from bella.tracks.joint_model import JointModel
from bella.tracks.joint_modes import Modes, wrapped
from bella.tracks.joint_observed import Observed
from bella.units import FloatArray

FREEDOM = 8.0
"""Degrees of freedom of Student's t."""
GOOD_SHARE = 0.3
"""Effective draws of all: below this they are too few."""
WANTED_SHARES = (0.8, 0.8, 0.5, 0.5, 0.5)
"""Below this the proposal is adapted, first, second, ... time. Well below 0.8 single draws in a tail weigh so much that
a standard deviation is off by 7 % rms, more than the number of effective draws says."""
EXPECTATIONS = 3
"""Rounds of responsibilities and moments per adaptation."""
SPLIT_STEPS = (-1.2, 0.0, 1.2)
"""Places of the parts of a component, in standard deviations along its longest axis."""
LEAST_WEIGHT = 0.02
"""Share of the draws that any component gets."""
CAUTION = 10.0
"""Effective draws with which the old covariance counts against that of the draws."""


@dataclass(frozen=True)
class Proposal:
    """Mixture of Student's t with `FREEDOM` degrees of freedom.

    Attributes
    ----------
    mean : ndarray, shape (M, P)
    scale : ndarray, shape (M, P, P)
    weight : ndarray, shape (M,)
    mode : ndarray of int, shape (M,)
        The maximum that each belongs to.
    """

    mean: FloatArray
    scale: FloatArray
    weight: FloatArray
    mode: npt.NDArray[np.intp]


@dataclass(frozen=True)
class WeightedDraws:
    """Draws of z with their weights.

    Attributes
    ----------
    z : ndarray, shape (N, P)
    release_s : ndarray, shape (N,)
        Best release time given z, s.
    weight : ndarray, shape (N,)
        They add up to one.
    log_evidence, log_evidence_se : float
    """

    z: FloatArray
    release_s: FloatArray
    weight: FloatArray
    log_evidence: float
    log_evidence_se: float

    @property
    def effective_share(self) -> float:
        """Effective number of draws over their number (Kish)."""
        return float(1 / (self.weight**2).sum() / self.weight.size)


def sample_posterior(
    model: JointModel, observed: Observed, modes: Modes, draws: int, rng: np.random.Generator
) -> tuple[WeightedDraws, Proposal]:
    """Draw from the joint posterior.

    Parameters
    ----------
    model : JointModel
    observed : Observed
    modes : Modes
    draws : int
    rng : numpy.random.Generator

    Returns
    -------
    tuple of WeightedDraws and Proposal
        The draws, and what they were drawn from.
    """
    proposal = Proposal(modes.z, modes.covariance, _floored(modes.weight), np.arange(len(modes.z)))
    latest = best = _weigh(model, observed, proposal, draws, rng)
    chosen = proposal
    for adaptation, wanted in enumerate(WANTED_SHARES):
        if best.effective_share >= wanted:
            break
        proposal = _refit(model, proposal, latest) if adaptation else _split(_refit(model, proposal, latest))
        latest = _weigh(model, observed, proposal, draws, rng)
        if latest.effective_share > best.effective_share:
            best, chosen = latest, proposal
    return best, chosen


def mode_weights(model: JointModel, proposal: Proposal, draws: WeightedDraws) -> FloatArray:
    """Share of the posterior around each maximum.

    Parameters
    ----------
    model : JointModel
    proposal : Proposal
    draws : WeightedDraws

    Returns
    -------
    ndarray, shape (number of maxima,)
    """
    return np.asarray(np.bincount(proposal.mode, _responsible(model, proposal, draws).sum(axis=0)), dtype=np.float64)


def _weigh(
    model: JointModel, observed: Observed, proposal: Proposal, draws: int, rng: np.random.Generator
) -> WeightedDraws:
    z = wrapped(model, _drawn(proposal, draws, rng))
    log_prior = model.log_prior(z, observed.frequency_mhz)
    log_fit, release_s = log_likelihood(model, observed, z)
    log_weight = log_prior + log_fit - logsumexp(_log_components(model, proposal, z), axis=1)
    total = float(logsumexp(log_weight))
    weight = np.exp(log_weight - total)
    spread = math.sqrt(max(float((weight**2).sum()) - 1 / draws, 0.0))
    return WeightedDraws(z, release_s, weight, total - math.log(draws), spread)


def _drawn(proposal: Proposal, draws: int, rng: np.random.Generator) -> FloatArray:
    """Draws of the mixture, each component by its share to within one draw, shape (N, P)."""
    place = (np.arange(draws) + rng.uniform()) / draws
    component = np.minimum(np.searchsorted(np.cumsum(proposal.weight), place), len(proposal.weight) - 1)
    normal = rng.standard_normal((draws, proposal.mean.shape[1]))
    normal /= np.sqrt(rng.chisquare(FREEDOM, draws) / FREEDOM)[:, None]
    root = np.linalg.cholesky(proposal.scale)
    return np.asarray(proposal.mean[component] + np.einsum("npq,nq->np", root[component], normal))


def _log_components(model: JointModel, proposal: Proposal, z: FloatArray) -> FloatArray:
    """Log of weight times density of each component, the longitude on a circle, shape (N, M)."""
    number = z.shape[1]
    root = np.linalg.cholesky(proposal.scale)
    norm = gammaln((FREEDOM + number) / 2) - gammaln(FREEDOM / 2) - 0.5 * number * math.log(FREEDOM * math.pi)
    columns = []
    for mean, lower, weight in zip(proposal.mean, root, proposal.weight, strict=True):
        inverse = np.linalg.inv(lower)
        scaled, turn = wrapped(model, z - mean) @ inverse.T, model.turn * inverse[:, 0]
        squared = np.stack([((scaled + winding * turn) ** 2).sum(axis=1) for winding in (-1, 0, 1)])
        log_density = logsumexp(-0.5 * (FREEDOM + number) * np.log1p(squared / FREEDOM), axis=0)
        columns.append(log_density + norm - np.log(np.diag(lower)).sum() + math.log(weight))
    return np.stack(columns, axis=1)


def _refit(model: JointModel, proposal: Proposal, draws: WeightedDraws) -> Proposal:
    """Proposal moved to the weighted draws, each component to those it is responsible for."""
    for _ in range(EXPECTATIONS):
        share = _responsible(model, proposal, draws)
        parts = [
            _moved(model, mean, scale, draws.z, one)
            for mean, scale, one in zip(proposal.mean, proposal.scale, share.T, strict=True)
        ]
        mean, scale = (np.stack(part) for part in zip(*parts, strict=True))
        proposal = Proposal(wrapped(model, mean), scale, _floored(share.sum(axis=0)), proposal.mode)
    return proposal


def _split(proposal: Proposal) -> Proposal:
    """Three components for each along its longest axis, so that together they can follow a bend."""
    variance, axes = np.linalg.eigh(proposal.scale)
    longest = axes[:, :, -1] * np.sqrt(variance[:, -1, None])
    mean = [proposal.mean + step * longest for step in SPLIT_STEPS]
    weight = [proposal.weight / len(SPLIT_STEPS)] * len(SPLIT_STEPS)
    copies = len(SPLIT_STEPS)
    return Proposal(
        np.concatenate(mean),
        np.tile(proposal.scale, (copies, 1, 1)),
        np.concatenate(weight),
        np.tile(proposal.mode, copies),
    )


def _responsible(model: JointModel, proposal: Proposal, draws: WeightedDraws) -> FloatArray:
    """Weight of each draw, divided among the components it can be from, shape (N, M)."""
    log_component = _log_components(model, proposal, draws.z)
    share = np.exp(log_component - logsumexp(log_component, axis=1, keepdims=True))
    return np.asarray(share * draws.weight[:, None])


def _moved(
    model: JointModel, mean: FloatArray, scale: FloatArray, z: FloatArray, share: FloatArray
) -> tuple[FloatArray, FloatArray]:
    total = max(float(share.sum()), 1e-300)
    effective = total**2 / max(float((share**2).sum()), 1e-300) if total > 1e-300 else 0.0
    away, share = wrapped(model, z - mean), share / total
    trust = effective / (effective + CAUTION)
    shift = trust * (share @ away)
    centred = away - shift
    return mean + shift, trust * (centred.T * share) @ centred + (1 - trust) * scale


def _floored(weight: FloatArray) -> FloatArray:
    floored = np.maximum(weight, LEAST_WEIGHT)
    return np.asarray(floored / floored.sum())

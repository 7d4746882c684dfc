"""Arrival times that are bad: which, and how much they may still say.

Each arrival time is bad with a small probability, and then its error is larger by far (the mixture of Box & Tiao 1968,
doi:10.1093/biomet/55.1.119, as for single frequencies in :mod:`bella.multilateration`). The probability is found at the
best track by expectation and maximisation; the time then counts with the probability that it is good.
"""

import numpy as np
from scipy.special import expit

from bella.tracks.joint_likelihood import TimedChannels
from bella.tracks.joint_model import JointModel
from bella.tracks.joint_modes import Modes, climb, find_modes
from bella.tracks.joint_observed import Observed
from bella.units import FloatArray

BAD_PROBABILITY = 0.02
"""Prior probability that an arrival time is bad."""
BAD_SIGMAS = 20.0
"""Standard deviation that a bad one has, in units of its stated error."""
DOWN_WEIGHTED = 0.5
"""Arrival times of a smaller weight are called bad; where there is none, all keep their full weight."""
LEAST_WEIGHT = 1e-6
"""Of a time that is bad for certain: hours then hardly move anything."""
MOST_BAD = 0.05
"""Where a larger share of the arrival times (and more than one) would be bad, the model is, and all keep their full
weight: the prior gives it 0.01 for a hundred, and with a fifth a beam that slows passed for twelve bad times."""
ROUNDS, CLIMBS = 4, 15
SETTLED = 0.01


def robust_modes(model: JointModel, observed: Observed) -> tuple[Modes, Observed, FloatArray]:
    """Maxima of the posterior with bad arrival times weighted down.

    Parameters
    ----------
    model : JointModel
    observed : Observed

    Returns
    -------
    tuple of Modes, Observed, and ndarray, shape (F, n)
        The maxima, what they are the maxima of, and the weight of each arrival time, 1 for those that are missing.
    """
    modes, weight = find_modes(model, observed), np.ones(0)
    channels = observed.channels
    if channels is None:
        return modes, observed, weight
    weighted, weight = observed, np.ones_like(channels.precision)
    for _ in range(ROUNDS):
        found = _settled(model, (observed, weighted), modes.z[:1], weight)
        if np.abs(found - weight).max() < SETTLED:
            break
        weight, weighted = found, _with(observed, channels.weighted(found))
        modes = find_modes(model, weighted)
    # only now: a first track that a bad time has pulled away makes others look bad as well
    if (weight < DOWN_WEIGHTED).sum() > max(1.0, MOST_BAD * channels.size):
        return find_modes(model, observed), observed, np.ones_like(weight)
    return modes, weighted, weight


def _settled(model: JointModel, observed: tuple[Observed, Observed], z: FloatArray, weight: FloatArray) -> FloatArray:
    """Weights that agree with the maximum that they lead to from z."""
    plain, weighted = observed
    if plain.channels is None:
        return weight
    for _ in range(CLIMBS):
        found = _weights(model, weighted, plain.channels, z)
        if (found > DOWN_WEIGHTED).all():
            return np.ones_like(weight)
        if np.abs(found - weight).max() < SETTLED:
            break
        weight, weighted = found, _with(plain, plain.channels.weighted(found))
        z = climb(model, weighted, z)[0]
    return weight


def _weights(model: JointModel, weighted: Observed, channels: TimedChannels, z: FloatArray) -> FloatArray:
    """Probability that each time is good, (F, n), given residuals at the best release and offsets."""
    now = weighted.channels
    if now is None:
        return np.ones_like(channels.precision)
    heard = channels.precision > 0
    away_s = now.weigh(now.residual(model, z))[0] / np.where(heard, now.precision, 1.0)
    squares = away_s**2 * channels.precision
    log_odds = np.log(BAD_PROBABILITY / (1 - BAD_PROBABILITY) / BAD_SIGMAS) + 0.5 * squares * (1 - 1 / BAD_SIGMAS**2)
    return np.where(heard, np.maximum(expit(-log_odds), LEAST_WEIGHT), 1.0)


def _with(observed: Observed, channels: TimedChannels) -> Observed:
    return Observed(channels, observed.directions, observed.wind)

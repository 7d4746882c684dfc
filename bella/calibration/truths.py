"""Sources and their arrival times, drawn from the model of a stratum, or departing from it as its misfit says."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import truncnorm

from bella.arrivals import ArrivalGrid
from bella.calibration.strata import Misfit, Stratum
from bella.heliosphere import spiral_longitude_deg
from bella.multilateration.priors import Priors
from bella.units import C_RSUN_S, FloatArray

EMISSION_HALF_WIDTH_S = 3000.0
"""Emission times are drawn within this of the reference time. The model is the same at every time, so any range will do
as long as the posterior stays far from the ends of the day that the prior allows."""
SPIRAL_RSUN = (10.0, 150.0)
SPIRAL_SPEED_KM_S = 400.0
EPOCH = np.datetime64("2012-06-07T19:00:00", "ns")
AS_DECLARED = Misfit("")
DELAY_RISE_S = 60.0
"""Half width of the rise in the strata with a directional delay: that of a burst at 0.5 MHz."""


@dataclass(frozen=True)
class Truths:
    """True parameters of B sources.

    Attributes
    ----------
    emission_s : ndarray, shape (B,)
        After the reference time, s.
    """

    position_rsun: FloatArray
    emission_s: FloatArray
    v_over_c: FloatArray


def draw_truths(stratum: Stratum, number: int, rng: np.random.Generator) -> Truths:
    """Draw sources from the prior of a stratum, or on Parker spirals at any longitude."""
    priors = stratum.priors
    on_spiral = stratum.misfit is not None and stratum.misfit.on_spiral
    z = truncnorm.rvs(-np.inf, (priors.v_max_c - 1) / priors.v_sd_c, size=number, random_state=rng)
    return Truths(
        position_rsun=_on_spirals(number, rng) if on_spiral else _from_prior(priors, number, stratum.dimensions, rng),
        emission_s=rng.uniform(-EMISSION_HALF_WIDTH_S, EMISSION_HALF_WIDTH_S, number),
        v_over_c=1 + priors.v_sd_c * z,
    )


def _from_prior(priors: Priors, number: int, dimensions: int, rng: np.random.Generator) -> FloatArray:
    """Positions whose density is exp(-(r / tau)^power / 2): in any direction, with r^power a gamma variate."""
    direction = rng.standard_normal((number, dimensions))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    radius = priors.tau_rsun * (2 * rng.gamma(dimensions / priors.power, size=number)) ** (1 / priors.power)
    return np.asarray(radius[:, None] * direction)


def _on_spirals(number: int, rng: np.random.Generator) -> FloatArray:
    range_rsun = rng.uniform(*SPIRAL_RSUN, number)
    longitude = np.radians(spiral_longitude_deg(range_rsun, 0.0, SPIRAL_SPEED_KM_S) + rng.uniform(0, 360, number))
    return np.stack([range_rsun * np.cos(longitude), range_rsun * np.sin(longitude)], axis=1)


def arrival_grid(stratum: Stratum, truths: Truths, rng: np.random.Generator) -> ArrivalGrid:
    """Arrival times of sources, each on a row of its own as if it were a frequency.

    Returns
    -------
    ArrivalGrid
        Its timing errors and offsets are those that the stratum states.
    """
    number, receivers = truths.emission_s.size, stratum.receiver_rsun
    shape = (number, len(receivers))
    source = np.pad(truths.position_rsun, ((0, 0), (0, 3 - stratum.dimensions)))
    toward = receivers - source[:, None, :]
    distance = np.linalg.norm(toward, axis=2)
    travel_s = distance / (truths.v_over_c[:, None] * C_RSUN_S)
    grid = ArrivalGrid(
        frequency_mhz=np.arange(1.0, number + 1),
        observatories=tuple(f"R{i}" for i in range(shape[1])),
        arrival_s=truths.emission_s[:, None] + travel_s,
        sigma_s=np.full(shape, stratum.sigma_s),
        receiver_rsun=np.broadcast_to(receivers, (*shape, 3)).copy(),
        reference_utc=EPOCH,
        edge="calibration",
        offset_sd_s=np.full(shape, stratum.offset_sd_s),
        rise_s=np.full(shape, DELAY_RISE_S),
    )
    misfit = stratum.misfit or AS_DECLARED
    delay = stratum.delay
    kappa = delay.kappa + delay.kappa_sd * rng.standard_normal((number, 1)) if delay.is_free else 0.0
    grid.arrival_s[:] += kappa * DELAY_RISE_S * (1 - _cosine(source, toward))
    grid.arrival_s[:] += misfit.error_factor * _errors(grid, stratum, rng) + _lateness(misfit, source, toward, rng)
    return grid


def _errors(grid: ArrivalGrid, stratum: Stratum, rng: np.random.Generator) -> FloatArray:
    """Errors as the model states them: noise, offsets, and bad arrival times with their probability, s."""
    bad = stratum.noise.bad_sets(grid.sigma_s.shape[1])
    # the probability of a set of bad ones is the model's own, cut off at the largest set it knows
    log_probability = _log_probability(stratum, bad.sum(axis=1))
    chosen = bad[rng.choice(len(bad), grid.frequency_mhz.size, p=np.exp(log_probability))]
    variance = grid.sigma_s**2 + chosen * stratum.noise.bad_sd_s**2
    offset = grid.offset_sd_s * rng.standard_normal(variance.shape)
    return np.asarray(np.sqrt(variance) * rng.standard_normal(variance.shape) + offset)


def _log_probability(stratum: Stratum, bad: FloatArray) -> FloatArray:
    p = stratum.noise.bad_probability
    if not p:
        return np.zeros(1)
    log_probability = bad * np.log(p) + (stratum.receivers - bad) * np.log1p(-p)
    return np.asarray(log_probability - np.logaddexp.reduce(log_probability))


def _cosine(source: FloatArray, toward: FloatArray) -> FloatArray:
    """Cosine of the angle at each source between the direction away from the Sun and that to a receiver, (B, n)."""
    cosine = np.einsum("bd,bnd->bn", source, toward)
    return np.asarray(cosine / (np.linalg.norm(source, axis=1)[:, None] * np.linalg.norm(toward, axis=2)))


def _lateness(misfit: Misfit, source: FloatArray, toward: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Delays that the model is not told of, shape (B, n), s.

    That of a receiver grows with the angle a at the source between the direction away from the Sun and the one to the
    receiver, as (1 - cos a)/2.
    """
    cosine = _cosine(source, toward)
    delay = misfit.least_delay_s + (misfit.most_delay_s - misfit.least_delay_s) * (1 - cosine) / 2
    late = rng.integers(toward.shape[1], size=len(toward))
    return np.asarray(delay + misfit.late_s * (np.arange(toward.shape[1]) == late[:, None]))

"""Maxima of the joint posterior, and the Gaussian that stands for each.

The posterior can have several: the near and the far side of the Sun, as seen from the receivers, can explain the same
delays. All starts climb together, by the Gauss-Newton method damped after Marquardt (1963, J. SIAM 11, 431,
doi:10.1137/0111030), with the Jacobian from finite differences in one call.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bella.tracks.joint_model import PHI0, JointModel
from bella.tracks.joint_observed import Observed
from bella.units import FloatArray

STARTS_DEG = (-150.0, -100.0, -50.0, 0.0, 50.0, 100.0, 150.0, 180.0)
"""Longitudes to start from, relative to the centre of their prior."""
FEW_STARTS_DEG = (-90.0, 0.0, 90.0, 180.0)
"""The same, beside places that are known."""
START_LN_A = (-0.8, 0.8, 2.5)
"""Distances to start from, in prior standard deviations of ln a."""
STEPS = 60
LONGEST_STEP, FARTHEST = 1.0, 8.0
"""Limits of a step and of the place it leads to, in prior standard deviations: far out nothing can be computed."""
FIRST_DAMPING = 1e-2
DIFFERENCE = 1e-4
CONVERGED = 1e-5
SAME_MODE = 1.0
"""Maxima closer than this, in standard deviations of the higher one, are one."""
NEGLIGIBLE_NATS = 12.0
MOST_MODES = 4


@dataclass(frozen=True)
class Modes:
    """Maxima of the joint posterior, the one of the largest evidence first.

    Attributes
    ----------
    z : ndarray, shape (M, P)
        Where they are.
    covariance : ndarray, shape (M, P, P)
        Inverse of the curvature.
    weight : ndarray, shape (M,)
        Share of each in the posterior, by the approximation of Laplace.
    misfit : float
        Squared residuals of data and prior at the highest one.
    """

    z: FloatArray
    covariance: FloatArray
    weight: FloatArray
    misfit: float


def find_modes(model: JointModel, observed: Observed, near: Mapping[str, FloatArray] | None = None) -> Modes:
    """Climb from several longitudes and distances to the maxima of the joint posterior.

    Parameters
    ----------
    model : JointModel
    observed : Observed
    near : mapping of str to ndarray, optional
        Standard parameters by name, of places to climb from, such as the maxima of a simpler model; parameters that it
        does not have begin where they change nothing. Then only a few others are tried beside them.

    Returns
    -------
    Modes
    """
    z, cost = climb(model, observed, _starts(model) if near is None else _starts_near(model, near))
    curvature = _slope_and_curvature(model, observed, z)[1]
    log_evidence = -cost - 0.5 * np.linalg.slogdet(curvature)[1]
    kept = _distinct(model, z, curvature, log_evidence)
    weight = np.exp(log_evidence[kept] - log_evidence[kept[0]])
    return Modes(z[kept], _inverse(curvature[kept]), weight / weight.sum(), 2 * float(cost.min()))


def _inverse(curvature: FloatArray) -> FloatArray:
    """Inverse curvature, (M, P, P), which no rounding makes wider than the prior."""
    value, axes = np.linalg.eigh(curvature)
    return np.asarray(axes / np.maximum(value, 1.0)[:, None] @ axes.transpose(0, 2, 1))


def wrapped(model: JointModel, z: FloatArray) -> FloatArray:
    """Bring longitudes to within half a turn of zero.

    Parameters
    ----------
    model : JointModel
    z : ndarray, shape (..., P)

    Returns
    -------
    ndarray, shape (..., P)
        A copy.
    """
    inside = z.copy()
    inside[..., PHI0] -= model.turn * np.round(z[..., PHI0] / model.turn)
    return inside


def _starts(model: JointModel) -> FloatArray:
    starts = np.zeros((len(START_LN_A), len(STARTS_DEG), len(model.parameters)))
    starts[..., PHI0] = np.array(STARTS_DEG) / model.priors.phi0_sd_deg
    starts[..., 2] = np.array(START_LN_A)[:, None]
    return starts.reshape(-1, len(model.parameters))


def _starts_near(model: JointModel, near: Mapping[str, FloatArray]) -> FloatArray:
    unknown = np.zeros_like(near["phi0_deg"])
    known = dict.fromkeys(model.outer_winds, near["v_sw_km_s"]) | dict(near)
    beside = np.zeros((len(FEW_STARTS_DEG), len(model.parameters)))
    beside[:, PHI0], beside[:, 2] = np.array(FEW_STARTS_DEG) / model.priors.phi0_sd_deg, START_LN_A[1]
    return np.concatenate([np.stack([known.get(name, unknown) for name in model.parameters], axis=1), beside])


def climb(model: JointModel, observed: Observed, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Climb from each start to a maximum.

    Parameters
    ----------
    model : JointModel
    observed : Observed
    z : ndarray, shape (S, P)

    Returns
    -------
    tuple of ndarray
        Where each start ends, shape (S, P), and minus the log posterior there up to a constant, shape (S,).
    """
    z, cost, damping = z.copy(), _cost(model, observed, z), np.full(len(z), FIRST_DAMPING)
    moving = np.arange(len(z))
    for _ in range(STEPS):
        step = _step(model, observed, z[moving], damping[moving])
        trial = np.clip(z[moving] + step, -FARTHEST, FARTHEST)
        trial_cost = _cost(model, observed, trial)
        better = trial_cost < cost[moving]
        z[moving[better]], cost[moving[better]] = trial[better], trial_cost[better]
        damping[moving] *= np.where(better, 1 / 6, 4.0)
        moving = moving[np.abs(step).max(axis=1) >= CONVERGED]
        if not moving.size:
            break
    return wrapped(model, z), cost


def _step(model: JointModel, observed: Observed, z: FloatArray, damping: FloatArray) -> FloatArray:
    """Damped step of each start, (S, P)."""
    slope, curvature = _slope_and_curvature(model, observed, z)
    damped = curvature + damping[:, None, None] * np.eye(z.shape[1]) * np.einsum("spp->sp", curvature)[:, None]
    return np.clip(-np.linalg.solve(damped, slope[..., None])[..., 0], -LONGEST_STEP, LONGEST_STEP)


def _cost(model: JointModel, observed: Observed, z: FloatArray) -> FloatArray:
    """Minus the log posterior up to a constant, (S,); infinite outside the limits of wind and beam."""
    squares = observed.misfit(observed.residual(model, z))[0] + (z**2).sum(axis=1)
    return np.where(model.allowed(z, observed.frequency_mhz), 0.5 * squares, np.inf)


def _slope_and_curvature(model: JointModel, observed: Observed, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gradient (S, P) and Gauss-Newton curvature (S, P, P) of minus the log posterior."""
    starts, number = z.shape
    beside = np.concatenate([z[:, None], z[:, None] + DIFFERENCE * np.eye(number)], axis=1)
    residual = observed.residual(model, beside.reshape(-1, number)).reshape(starts, number + 1, -1)
    jacobian = (residual[:, 1:] - residual[:, :1]) / DIFFERENCE
    weighed = observed.weigh(jacobian)
    slope = (weighed @ residual[:, 0, :, None])[..., 0] + z
    return slope, weighed @ jacobian.transpose(0, 2, 1) + np.eye(number)


def _distinct(model: JointModel, z: FloatArray, curvature: FloatArray, log_evidence: FloatArray) -> list[int]:
    """Places of the maxima that differ and matter, the largest evidence first."""
    kept: list[int] = []
    order = np.argsort(-log_evidence)
    for one in order[log_evidence[order] > log_evidence[order[0]] - NEGLIGIBLE_NATS]:
        away = [wrapped(model, z[one] - z[other]) for other in kept]
        if all(math.sqrt(d @ curvature[other] @ d) > SAME_MODE for d, other in zip(away, kept, strict=True)):
            kept.append(int(one))
    return kept[:MOST_MODES]

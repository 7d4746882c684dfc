r"""Covariance of the source position in closed form: the information that data and priors carry at the true source.

With g_i = (x - s_i)/(d_i c) the gradient of the flight time to receiver i, k_i = d_i/c its derivative with respect to
the relative slowness, weights w_i = 1/sigma_i^2, and weighted means taken off (g~, k~) for the free emission time,

    F = sum w g~ g~^T + I/tau^2 - q q^T / (sum w k~^2 + 1/rel^2),   q = sum w g~ k~,   cov = F^-1,

and for errors with a covariance C between the receivers sum w a~ b~ stands for a^T (C^-1 - C^-1 1 1^T C^-1 / W) b. Here
rel is the prior standard deviation of the speed over c (Fisher information of the model of Canizares et al. 2024,
doi:10.1051/0004-6361/202347747, emission time and speed eliminated by their Schur complement). It knows nothing of the
curvature of the problem: :mod:`bella.multilateration.uncertainty_map` says where that matters.
"""

import numpy as np

from bella.multilateration.priors import Priors
from bella.units import C_RSUN_S, FloatArray

CHUNK = 20_000
"""Points treated together, so that the arrays stay in the processor's cache."""
NEAREST_RSUN = 1e-9
"""A source closer to a receiver than this has no direction from it, and is given none."""


def closed_form_covariance(
    points: FloatArray,
    receivers_rsun: FloatArray,
    sigma_s: FloatArray,
    priors: Priors,
    correlation: FloatArray | None = None,
) -> FloatArray:
    """Covariance of the position of sources at given points, by the information there.

    Parameters
    ----------
    points : ndarray, shape (N, D)
        True positions, solar radii, HEE. D = 2: the source is known to be in the ecliptic plane; D = 3: it is not.
    receivers_rsun : ndarray, shape (n, 3)
        Solar radii, HEE.
    sigma_s : ndarray, shape (n,)
        Timing error of each receiver, s.
    priors : Priors
        That of the position counts as the Gaussian with its standard deviation.
    correlation : ndarray, shape (n, n), optional
        Of the timing errors.

    Returns
    -------
    ndarray, shape (N, D, D)
        Square solar radii. Finite everywhere, on a receiver too.
    """
    sigma_s = np.asarray(sigma_s, dtype=np.float64)
    covariance = np.outer(sigma_s, sigma_s) * (np.eye(sigma_s.size) if correlation is None else correlation)
    precision = np.linalg.inv(covariance)
    of_mean = precision.sum(axis=0)
    root = np.linalg.cholesky(precision)
    centred = root.T - np.outer(root.T.sum(axis=1), of_mean / of_mean.sum())
    starts = range(0, len(points), CHUNK)
    parts = [_covariance(points[first : first + CHUNK].T, receivers_rsun, centred, priors) for first in starts]
    return np.concatenate(parts) if parts else np.empty((0, points.shape[1], points.shape[1]))


def _covariance(points: FloatArray, receivers: FloatArray, whitening: FloatArray, priors: Priors) -> FloatArray:
    """Points by column, shape (D, M); `whitening` (n, n) makes errors independent and a shared part 0."""
    dimensions = points.shape[0]
    offsets = points[:, None, :] - receivers.T[:dimensions, :, None]
    distances = np.sqrt((offsets**2).sum(axis=0) + (receivers[:, dimensions:] ** 2).sum(axis=1)[:, None])
    gradients = [whitening @ (offset / np.maximum(distances, NEAREST_RSUN) / C_RSUN_S) for offset in offsets]
    slowness = whitening @ (distances / C_RSUN_S)
    speed_information = (slowness**2).sum(axis=0) + priors.v_sd_c**-2
    shared = [(gradient * slowness).sum(axis=0) for gradient in gradients]
    prior = priors.position_sd_rsun(dimensions) ** -2
    information = np.empty((points.shape[1], dimensions, dimensions))
    for i in range(dimensions):
        for j in range(i, dimensions):
            term = (gradients[i] * gradients[j]).sum(axis=0) - shared[i] * shared[j] / speed_information
            information[:, i, j] = information[:, j, i] = term + (i == j) * prior
    return _inverse(information)


def _inverse(matrices: FloatArray) -> FloatArray:
    """Inverse of symmetric matrices, shape (M, D, D); written out for D = 2, where it would be most of the work."""
    if matrices.shape[1] != 2:
        return np.asarray(np.linalg.inv(matrices), dtype=np.float64)
    (a, b), (_, d) = np.moveaxis(matrices, 0, -1)
    adjugate = np.array([[d, -b], [-b, a]])
    return np.moveaxis(adjugate / (a * d - b * b), -1, 0)


def largest_sd(covariance: FloatArray) -> FloatArray:
    """Standard deviation along the direction in which it is largest.

    Parameters
    ----------
    covariance : ndarray, shape (..., 2, 2)
        Square solar radii.

    Returns
    -------
    ndarray, shape (...,)
        Root of the larger eigenvalue, solar radii.
    """
    xx, yy, xy = covariance[..., 0, 0], covariance[..., 1, 1], covariance[..., 0, 1]
    return np.asarray(np.sqrt((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)))

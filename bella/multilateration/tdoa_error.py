r"""What timing errors do to a position and an emission time found from them.

With the emission time eliminated the information on the position is (J~^T W J~), J~_i = -(e_i - e-bar)/c. The sum over
receivers of the centred products equals a sum over pairs,

    J~^T W J~ = sum_{i<j} w_i w_j / W (e_i - e_j)(e_i - e_j)^T / c^2,      W = sum w,

with -Q_ij in place of w_i w_j / W where errors are correlated. It takes no difference of nearly equal numbers when one
receiver is far more precise than the rest. The emission time t0 = y-bar - d-bar/c then has the variance 1/W + e-bar^T C
e-bar / c^2 (Torrieri 1984, IEEE Trans. AES-20:183; the same as the t0 element of the inverse of the full normal
matrix).
"""

from typing import NamedTuple

import numpy as np

from bella.exceptions import GeometryError
from bella.multilateration.tdoa_fit import BoolArray, Timing, directions, reject_rows, timing_of
from bella.units import C_RSUN_S, FloatArray

SINGULAR = 1e-12
"""Ratio of the eigenvalues of the normal matrix below which floating-point numbers do not tell it from singular."""


class Emission(NamedTuple):
    """When the signal left its source.

    Attributes
    ----------
    time_s, sd_s : ndarray, shape (B,)
        On the clock of the arrival times, and its standard deviation, s.
    """

    time_s: FloatArray
    sd_s: FloatArray


def covariance(points: FloatArray, receivers: FloatArray, sigma_s: FloatArray) -> FloatArray:
    """Covariance of a position found from arrival times, the module's equation.

    No arrival time enters: at the points of a map it is the dilution of precision.

    Parameters
    ----------
    points : ndarray, shape (B, D)
        Solar radii; D = 2 keeps the source in the plane z = 0.
    receivers : ndarray, shape (B, n, 3)
        Solar radii.
    sigma_s : ndarray, shape (B, n)
        Standard deviation of the arrival times, s; NaN where a receiver is missing.

    Returns
    -------
    ndarray, shape (B, D, D)
        Square solar radii.

    Raises
    ------
    InputError
        As :func:`bella.multilateration.tdoa_fit.timing_of`.
    GeometryError
        Where the normal matrix is singular: the arrival times do not fix a position there.
    """
    points = np.asarray(points, dtype=np.float64)
    silent = np.where(np.isnan(sigma_s), np.nan, 0.0)
    timing = timing_of(receivers, silent, sigma_s, points.shape[1])
    normal = information(timing, points)
    reject_rows(
        is_singular(normal), "has receivers that do not fix a position; use the method posterior", GeometryError
    )
    return inverse(normal)


def information(timing: Timing, points: FloatArray) -> FloatArray:
    """Inverse of the covariance, J~^T W J~ of the module's equation.

    Parameters
    ----------
    timing : Timing
    points : ndarray, shape (B, D)
        Solar radii.

    Returns
    -------
    ndarray, shape (B, D, D)
        Per square solar radius.
    """
    _, unit = directions(timing, points)
    first, second = np.triu_indices(unit.shape[1], k=1)
    weight = -timing.precision[:, first, second] * timing.total_weight[:, None] / C_RSUN_S**2
    pairs = unit[:, first] - unit[:, second]
    return np.asarray((weight[..., None] * pairs).swapaxes(1, 2) @ pairs)


def is_singular(normal: FloatArray) -> BoolArray:
    """Which matrices cannot be inverted in floating-point numbers.

    Parameters
    ----------
    normal : ndarray, shape (B, D, D)
        Symmetric.

    Returns
    -------
    ndarray of bool, shape (B,)
    """
    values = np.linalg.eigvalsh(normal)
    return np.asarray(~(values[:, 0] > SINGULAR * values[:, -1]))


def inverse(normal: FloatArray) -> FloatArray:
    """Inverse of symmetric matrices, exactly symmetric.

    Parameters
    ----------
    normal : ndarray, shape (B, D, D)

    Returns
    -------
    ndarray, shape (B, D, D)
    """
    inverted = np.linalg.inv(normal)
    return np.asarray(0.5 * (inverted + inverted.swapaxes(1, 2)))


def limited_inverse(normal: FloatArray, limit_rsun: float) -> FloatArray:
    """Inverse of the information with that of a Gaussian prior of the position added, so that it always exists.

    Parameters
    ----------
    normal : ndarray, shape (B, D, D)
        Symmetric; eigenvalues that rounding does not tell from 0 count as 0.
    limit_rsun : float
        Standard deviation of the prior, solar radii: none of the result is larger.

    Returns
    -------
    ndarray, shape (B, D, D)
        Square solar radii.
    """
    values, axes = np.linalg.eigh(normal)
    told = np.where(values > SINGULAR * values[:, -1:], values, 0.0)
    variance = 1 / (told + limit_rsun**-2.0)
    return np.asarray((axes * variance[:, None, :]) @ axes.swapaxes(1, 2))


def emission(timing: Timing, points: FloatArray, position_covariance: FloatArray) -> Emission:
    """Emission time, and its error when the position is as uncertain as stated.

    Parameters
    ----------
    timing : Timing
    points : ndarray, shape (B, D)
        Solar radii.
    position_covariance : ndarray, shape (B, D, D)
        Square solar radii.

    Returns
    -------
    Emission
    """
    distance, unit = directions(timing, points)
    since_first = (timing.share * (timing.delay_s - distance / C_RSUN_S)).sum(axis=1)
    direction = np.einsum("bn,bnd->bd", timing.share, unit) / C_RSUN_S
    of_position = np.einsum("bd,bde,be->b", direction, position_covariance, direction)
    return Emission(timing.first_s + since_first, np.sqrt(1 / timing.total_weight + of_position))

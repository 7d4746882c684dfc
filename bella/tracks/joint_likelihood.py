"""Likelihood of the arrival times of a burst with the release time and the offsets of the clocks integrated out.

Arrival times scatter independently by `sigma_s` (and the uncertainty of known delays), and all channels of a receiver
share an offset. With the offsets integrated out the covariance of a receiver is diagonal plus a constant, whose inverse
is that of Sherman & Morrison (1950, doi:10.1214/aoms/1177729893); the release time has a flat prior and is integrated
out as a linear parameter is (Lindley & Smith 1972, J. R. Stat. Soc. B 34, 1, doi:10.1111/j.2517-6161.1972.tb00885.x).
"""

import math
from dataclasses import dataclass

import numpy as np

from bella.arrivals import ArrivalGrid
from bella.tracks.joint_model import JointModel
from bella.units import FloatArray

LEAST_SIGMA_S = 1e-3
"""Smaller errors are taken as this: light goes 300 km in it, and nothing in the model is known so well."""
BLOCK_ELEMENTS = 200_000
"""Numbers treated together, so that they stay in the cache and memory stays bounded."""


@dataclass(frozen=True)
class TimedChannels:
    """Arrival times of a burst as the likelihood needs them, on frequencies x receivers.

    Attributes
    ----------
    frequency_mhz : ndarray, shape (F,)
        Ascending.
    receiver_rsun : ndarray, shape (F, n, 3)
        HEE, solar radii; 0 where there is no arrival time.
    arrival_s : ndarray, shape (F, n)
        With known delays taken off, relative to the reference time, s; 0 where there is none.
    precision : ndarray, shape (F, n)
        Inverse variance without the offset, s^-2; 0 where there is no arrival time.
    shrinkage : ndarray, shape (n,)
        o^2 / (1 + o^2 S) for an offset of standard deviation o and the summed precision S of a receiver, s^2.
    """

    frequency_mhz: FloatArray
    receiver_rsun: FloatArray
    arrival_s: FloatArray
    precision: FloatArray
    shrinkage: FloatArray

    @property
    def size(self) -> int:
        """Number of arrival times."""
        return int((self.precision > 0).sum())

    @property
    def _share(self) -> FloatArray:
        """What integrating out the offset leaves of the sums of a receiver, shape (n,)."""
        return np.asarray(1 - self.shrinkage * self.precision.sum(axis=0))

    @property
    def release_precision(self) -> float:
        """Inverse variance of the release time when all else is known, s^-2."""
        return float(self.precision.sum(axis=0) @ self._share)

    def weigh(self, times_s: FloatArray) -> FloatArray:
        """Apply the inverse covariance with offsets and release time integrated out.

        Parameters
        ----------
        times_s : ndarray, shape (..., F, n)

        Returns
        -------
        ndarray, shape (..., F, n)
            1/s.
        """
        weighed = self.precision * times_s
        weighed = weighed - self.precision * self.shrinkage * weighed.sum(axis=-2, keepdims=True)
        total = weighed.sum(axis=(-2, -1), keepdims=True)
        return np.asarray(weighed - self.precision * self._share * (total / self.release_precision))

    def misfit(self, residual_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Sum of squares of residuals, and the release time that makes it smallest.

        Parameters
        ----------
        residual_s : ndarray, shape (N, F, n)
            Arrival time less the delay after the release, s.

        Returns
        -------
        tuple of two ndarray, shape (N,)
            Misfit (dimensionless) and release time, s.
        """
        squares = np.einsum("ifj,ifj,fj->i", residual_s, residual_s, self.precision)
        sums = np.einsum("ifj,fj->ij", residual_s, self.precision)
        release_s = sums @ self._share / self.release_precision
        return squares - sums**2 @ self.shrinkage - release_s**2 * self.release_precision, release_s

    @property
    def log_norm(self) -> float:
        """Logarithm of the factor before the exponential of the likelihood."""
        log_determinant = -np.log(self.precision[self.precision > 0]).sum() - np.log(self._share).sum()
        return -0.5 * float(
            log_determinant + math.log(self.release_precision) + (self.size - 1) * math.log(2 * math.pi)
        )


def timed_channels(grid: ArrivalGrid, common_sd_s: float | None = None) -> TimedChannels:
    """Arrival times of a grid as the likelihood needs them.

    Parameters
    ----------
    grid : ArrivalGrid
    common_sd_s : float or None
        Standard deviation of the offset that all channels of a receiver share, s; None: that of the grid.

    Returns
    -------
    TimedChannels
    """
    heard = np.isfinite(grid.arrival_s)
    sigma_s = np.maximum(grid.sigma_s, LEAST_SIGMA_S)
    variance = np.where(heard, sigma_s**2 + grid.delay_sd_s**2, np.inf)
    offset_sd_s = grid.offset_sd_s.max(axis=0) if common_sd_s is None else np.full(heard.shape[1], common_sd_s)
    precision = 1 / variance
    return TimedChannels(
        frequency_mhz=grid.frequency_mhz,
        receiver_rsun=np.where(heard[..., None], grid.receiver_rsun, 0.0),
        arrival_s=np.where(heard, grid.arrival_s - grid.delay_s, 0.0),
        precision=precision,
        shrinkage=offset_sd_s**2 / (1 + offset_sd_s**2 * precision.sum(axis=0)),
    )


def log_likelihood(model: JointModel, channels: TimedChannels, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Logarithm of the likelihood, and the best release time.

    Parameters
    ----------
    model : JointModel
    channels : TimedChannels
    z : ndarray, shape (N, P)

    Returns
    -------
    tuple of two ndarray, shape (N,)
        Log likelihood, and release time after the reference time, s.
    """
    block = max(1, BLOCK_ELEMENTS // channels.precision.size)
    parts = [channels.misfit(residual_s(model, channels, z[i : i + block])) for i in range(0, len(z), block)]
    misfit, release_s = (np.concatenate(part) for part in zip(*parts, strict=True))
    return channels.log_norm - 0.5 * misfit, release_s


def residual_s(model: JointModel, channels: TimedChannels, z: FloatArray) -> FloatArray:
    """Arrival times less their delays after the release.

    Parameters
    ----------
    model : JointModel
    channels : TimedChannels
    z : ndarray, shape (N, P)

    Returns
    -------
    ndarray, shape (N, F, n)
        s.
    """
    return channels.arrival_s - model.delay_s(z, channels.frequency_mhz, channels.receiver_rsun)

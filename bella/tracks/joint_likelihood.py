"""Likelihood of the arrival times of a burst with the release time and the offsets of the clocks integrated out.

Arrival times scatter independently by `sigma_s` (and the uncertainty of known delays), and all channels of a receiver
share an offset. With the offsets integrated out the covariance of a receiver is diagonal plus a constant, whose inverse
is that of Sherman & Morrison (1950, doi:10.1214/aoms/1177729893); the release time has a flat prior and is integrated
out as a linear parameter is (Lindley & Smith 1972, J. R. Stat. Soc. B 34, 1, doi:10.1111/j.2517-6161.1972.tb00885.x).
"""

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from bella.arrivals import ArrivalGrid
from bella.tracks.joint_model import JointModel
from bella.units import FloatArray

LEAST_SIGMA_S = 1e-3
"""Smaller errors are taken as this: light goes 300 km in it, and nothing in the model is known so well."""
BLOCK = 1500
"""Parameter sets treated together, so that they stay in the cache and memory stays bounded."""
LEAST_OFFSET_S = 2.0
"""Offset assumed of a receiver that declares none: so far do the biases of half-rise edges differ up to 1 MHz."""
OFFSET_SHARE = 0.3
"""The same, of its median timing error: of a record it is what a time stamp at an unknown place in it leaves, rms."""


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
    offset_sd_s : ndarray, shape (n,)
        Standard deviation of the offset that all channels of a receiver share, s.
    """

    frequency_mhz: FloatArray
    receiver_rsun: FloatArray
    arrival_s: FloatArray
    precision: FloatArray
    offset_sd_s: FloatArray

    @property
    def shrinkage(self) -> FloatArray:
        """o^2 / (1 + o^2 S) for an offset of deviation o and the summed precision S of a receiver, s^2, shape (n,)."""
        return np.asarray(self.offset_sd_s**2 / (1 + self.offset_sd_s**2 * self.precision.sum(axis=0)))

    def weighted(self, weight: FloatArray) -> "TimedChannels":
        """The same arrival times with their inverse variances multiplied.

        Parameters
        ----------
        weight : ndarray, shape (F, n)
            Above 0.

        Returns
        -------
        TimedChannels
        """
        return replace(self, precision=self.precision * weight)

    def residual(self, model: JointModel, z: FloatArray) -> FloatArray:
        """Residuals as :func:`residual_s` has them, shape (N, F, n)."""
        return residual_s(model, self, z)

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
    return TimedChannels(
        frequency_mhz=grid.frequency_mhz,
        receiver_rsun=np.where(heard[..., None], grid.receiver_rsun, 0.0),
        arrival_s=np.where(heard, grid.arrival_s - grid.delay_s, 0.0),
        precision=1 / variance,
        offset_sd_s=common_offset_s(grid, common_sd_s)[0],
    )


def common_offset_s(grid: ArrivalGrid, common_sd_s: float | None = None) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Size of the offset that all channels of a receiver share, and whether it is only assumed.

    Parameters
    ----------
    grid : ArrivalGrid
    common_sd_s : float or None
        Of all receivers, s; None: what the grid declares, and where it declares none, the larger of `LEAST_OFFSET_S`
        and `OFFSET_SHARE` of the median timing error of the receiver.

    Returns
    -------
    tuple of ndarray, shape (n,)
        s; and bool.
    """
    receivers = len(grid.observatories)
    if common_sd_s is not None:
        return np.full(receivers, float(common_sd_s)), np.zeros(receivers, dtype=bool)
    declared = grid.offset_sd_s.max(axis=0)
    middle_s = np.array(
        [np.median(known) if (known := column[np.isfinite(column)]).size else 0.0 for column in grid.sigma_s.T]
    )
    undeclared = declared == 0
    return np.where(undeclared, np.maximum(LEAST_OFFSET_S, OFFSET_SHARE * middle_s), declared), undeclared


class Likelihood(Protocol):
    """Data whose likelihood is Gaussian in residuals; the release time and offsets are integrated out."""

    @property
    def log_norm(self) -> float:
        """Logarithm of the factor before the exponential."""

    def residual(self, model: JointModel, z: FloatArray) -> FloatArray:
        """Residuals of parameters z, shape (N, ...)."""

    def misfit(self, residual: FloatArray, /) -> tuple[FloatArray, FloatArray]:
        """Sum of squares of residuals, and the best release time, shape (N,) each."""


def log_likelihood(model: JointModel, observed: Likelihood, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Logarithm of the likelihood, and the best release time.

    Parameters
    ----------
    model : JointModel
    observed : Likelihood
    z : ndarray, shape (N, P)

    Returns
    -------
    tuple of two ndarray, shape (N,)
        Log likelihood, and release time after the reference time, s.
    """
    parts = [observed.misfit(observed.residual(model, z[i : i + BLOCK])) for i in range(0, len(z), BLOCK)]
    misfit, release_s = (np.concatenate(part) for part in zip(*parts, strict=True))
    return observed.log_norm - 0.5 * misfit, release_s


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

"""How the arrival time of a burst depends on frequency: t(f) = a2/f^2 + a1/f + a0."""

from typing import NamedTuple

import numpy as np

from bella.exceptions import InputError
from bella.units import FloatArray


class TimeEvolution(NamedTuple):
    """Arrival time as a function of frequency.

    Notes
    -----
    The form is that of Canizares et al. 2024, A&A 684, A182, doi:10.1051/0004-6361/202347747. It misses simulated beams
    by 2 s rms (11 s at most) between 0.2 and 10 MHz.
    """

    coefficients: FloatArray
    """a2 (s MHz^2), a1 (s MHz), a0 (s), shape (3,)."""
    covariance: FloatArray
    """Of the coefficients in that order, shape (3, 3); NaN where unknown."""

    def arrival_s(self, frequency_mhz: FloatArray) -> FloatArray:
        """Arrival times.

        Parameters
        ----------
        frequency_mhz : numpy.ndarray
            MHz, above zero, shape (F,).

        Returns
        -------
        numpy.ndarray
            s on the axis of the coefficients, shape (F,).
        """
        return np.asarray(_terms(frequency_mhz) @ self.coefficients, dtype=np.float64)


def _terms(frequency_mhz: FloatArray) -> FloatArray:
    inverse = 1.0 / np.asarray(frequency_mhz, dtype=np.float64)
    return np.stack([inverse**2, inverse, np.ones_like(inverse)], axis=-1)


def fit_time_evolution(frequency_mhz: FloatArray, arrival_s: FloatArray, sigma_s: FloatArray) -> TimeEvolution:
    """Weighted least-squares fit of a2/f^2 + a1/f + a0.

    Parameters
    ----------
    frequency_mhz, arrival_s, sigma_s : numpy.ndarray
        MHz; s; standard deviation, s; shape (N,), N at least three. Rows with NaN are left out.

    Returns
    -------
    TimeEvolution
        With the covariance that the given sigmas imply, not rescaled by the residuals.

    Raises
    ------
    InputError
        If fewer than three different frequencies remain, or a sigma is not above zero.
    """
    known = np.isfinite(frequency_mhz) & np.isfinite(arrival_s) & np.isfinite(sigma_s)
    frequency_mhz, arrival_s, sigma_s = frequency_mhz[known], arrival_s[known], sigma_s[known]
    channels = np.unique(frequency_mhz).size
    if channels < 3:
        raise InputError(f"t(f) needs edges at three frequencies, not {channels}: widen the frequency range")
    if not (sigma_s > 0.0).all():
        raise InputError("a timing sigma is not above zero: give the standard deviation of every arrival in seconds")
    weighted = _terms(frequency_mhz) / sigma_s[:, np.newaxis]
    orthonormal, triangle = np.linalg.qr(weighted)
    inverse = np.linalg.inv(triangle)
    return TimeEvolution(inverse @ (orthonormal.T @ (arrival_s / sigma_s)), inverse @ inverse.T)

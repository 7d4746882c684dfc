"""Likelihood of a track: residuals of arrival times with the time of emission integrated out, and wave directions.

With y the arrival times, m(phi0, z) what a track predicts without its time of emission, C the covariance of the noise
and B that of the time of emission, the residuals y - m are Gaussian with covariance C + B. So the time of emission is
never fitted: W = (C + B)^-1 does without it, and its posterior is B W (y - m).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from bella.arrivals import ArrivalGrid
from bella.tracks.directions import DirectionTerms
from bella.tracks.model import Rows, Track
from bella.units import FloatArray

LEAST_S = 0.1
"""Independent error that every arrival time has at least: the covariance of times along a smooth curve is singular."""


@dataclass(frozen=True)
class Evidence:
    """Arrival times of a burst as a track sees them.

    Attributes
    ----------
    arrival_s : ndarray, shape (N,)
        Known delays taken off.
    noise_s2 : ndarray, shape (N, N)
        C.
    observatory : ndarray of int, shape (N,)
        Column of the grid.
    """

    rows: Rows
    arrival_s: FloatArray
    noise_s2: FloatArray
    observatory: np.ndarray
    observatories: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of arrival times N."""
        return int(self.arrival_s.size)

    def without(self, place: int) -> "Evidence":
        """The same without one arrival time."""
        keep = np.arange(self.size) != place
        rows = Rows(*(getattr(self.rows, name)[keep] for name in ("frequency_mhz", "rise_s", "receiver_rsun")))
        return replace(
            self,
            rows=rows,
            arrival_s=self.arrival_s[keep],
            noise_s2=self.noise_s2[np.ix_(keep, keep)],
            observatory=self.observatory[keep],
        )


def evidence_of(grid: ArrivalGrid) -> Evidence:
    """Arrival times of a grid, one after the other.

    Parameters
    ----------
    grid : ArrivalGrid
        Frequencies received by one or two receivers count too.
    """
    row, column = np.nonzero(np.isfinite(grid.arrival_s))
    assert grid.rise_s is not None  # noqa: S101 - the grid fills it in
    rows = Rows(grid.frequency_mhz[row], grid.rise_s[row, column], grid.receiver_rsun[row, column])
    arrival_s = (grid.arrival_s - grid.delay_s)[row, column]
    noise_s2 = grid.covariance_s2() + LEAST_S**2 * np.eye(row.size)
    return Evidence(rows, arrival_s, noise_s2, column, grid.observatories)


@dataclass(frozen=True)
class Likelihood:
    """Log density of a track given the arrival times of a burst.

    Attributes
    ----------
    directions : DirectionTerms or None
        Wave directions of the burst, within the band of the track.
    """

    track: Track
    seen: Evidence
    directions: DirectionTerms | None = None

    @cached_property
    def emission_s2(self) -> FloatArray:
        """Prior covariance B of the time of emission at the arrival times, shape (N, N)."""
        frequency = self.seen.rows.frequency_mhz
        return self.track.emission_s2(frequency, frequency)

    @cached_property
    def _factor(self) -> tuple[FloatArray, bool]:
        factor: tuple[FloatArray, bool] = cho_factor(self.seen.noise_s2 + self.emission_s2, lower=True)
        return factor

    @cached_property
    def weight(self) -> FloatArray:
        """W, shape (N, N), s^-2."""
        return np.asarray(cho_solve(self._factor, np.eye(self.seen.size)))

    @cached_property
    def log_norm(self) -> float:
        """Logarithm of the factor before the exponential."""
        return -float(np.log(np.diag(self._factor[0])).sum()) - 0.5 * self.seen.size * float(np.log(2 * np.pi))

    def residual_s(self, phi0_rad: FloatArray, z: FloatArray) -> FloatArray:
        """Arrival times less what tracks predict, shape (B, N)."""
        return np.asarray(self.seen.arrival_s - self.track.arrival_s(phi0_rad, z, self.seen.rows))

    def chi2(self, residual_s: FloatArray) -> FloatArray:
        """Misfit of residuals, shape (B,)."""
        return np.asarray(np.einsum("bn,bn->b", residual_s @ self.weight, residual_s))

    def turned(self, phi0_rad: FloatArray, z: FloatArray) -> FloatArray:
        """Residuals of the wave directions in units of their errors, shape (B, 2 K); none without directions."""
        if self.directions is None:
            return np.zeros((len(z), 0))
        range_rsun = self.track.range_rsun(z, self.track.basis(self.directions.frequency_mhz))
        return self.directions.residual(self.track.position_rsun(phi0_rad, z, range_rsun))

    def log_density(self, phi0_rad: FloatArray, z: FloatArray) -> FloatArray:
        """Log of likelihood times prior, up to the normalisation of the prior of z and phi0, shape (B,)."""
        return self.log_density_of(self.residual_s(phi0_rad, z), phi0_rad, z)

    def log_density_of(self, residual_s: FloatArray, phi0_rad: FloatArray, z: FloatArray) -> FloatArray:
        """The same, where the residuals are known."""
        angles = 0.0 if self.directions is None else (self.turned(phi0_rad, z) ** 2).sum(axis=-1)
        norm = self.log_norm + (0.5 * self.directions.log_norm if self.directions is not None else 0.0)
        return np.asarray(norm - 0.5 * (self.chi2(residual_s) + angles + (self.track.free(z) ** 2).sum(axis=-1)))

    def normal_equations(
        self, residual_s: FloatArray, phi0_rad: FloatArray, z: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Gauss-Newton's matrix, shape (B, P, P), and the gradient of the log density, shape (B, P)."""
        slope = self.track.slopes_s(phi0_rad, z, self.seen.rows)[:, :-1]
        weighed = (slope.reshape(-1, slope.shape[-1]) @ self.weight).reshape(slope.shape)
        matrix = weighed @ slope.transpose(0, 2, 1) + np.eye(z.shape[1])
        gradient = np.einsum("bpn,bn->bp", weighed, residual_s) - self.track.free(z)
        if self.directions is None:
            return matrix, gradient
        basis = self.track.basis(self.directions.frequency_mhz)
        range_rsun = self.track.range_rsun(z, basis)
        outward = self.track.position_rsun(phi0_rad, z, range_rsun)
        aside = outward[..., [1, 0, 2]] * [-1, 1, 0]
        now, *moved = self.directions.angles(outward, outward, aside)
        pair = (one.reshape(len(z), -1) for one in moved)  # each direction has two components
        slope = self.track.chained(z, range_rsun.repeat(2, axis=1), basis.repeat(2, axis=0), *pair)
        turn = self.directions.independent(slope.reshape(*slope.shape[:2], *now.shape[1:])).reshape(slope.shape)
        away = self.directions.independent(now).reshape(len(z), -1)
        return matrix + turn @ turn.transpose(0, 2, 1), gradient - np.einsum("bpk,bk->bp", turn, away)

    def emission(self, residual_s: FloatArray, frequency_mhz: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Posterior of the marginalised part of the time of emission, given tracks.

        Parameters
        ----------
        residual_s : ndarray, shape (B, N)
        frequency_mhz : ndarray, shape (F,)

        Returns
        -------
        tuple of ndarray
            Mean, s, shape (B, F), and covariance, s^2, shape (F, F).
        """
        across = self.track.emission_s2(frequency_mhz, self.seen.rows.frequency_mhz)
        prior = self.track.emission_s2(frequency_mhz, frequency_mhz)
        return residual_s @ self.weight @ across.T, prior - across @ self.weight @ across.T

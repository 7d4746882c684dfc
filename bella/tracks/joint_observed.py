"""Everything that was observed of a burst as one likelihood: arrival times, wave directions, and the wind.

The three are independent, so that their residuals stand one after the other and their logarithms add up.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bella.exceptions import InputError
from bella.tracks.joint_directions import DirectionTerms
from bella.tracks.joint_likelihood import TimedChannels
from bella.tracks.joint_model import JointModel
from bella.units import FloatArray

ARRIVAL_TIMES, WAVE_DIRECTIONS, WIND = "arrival_times", "wave_directions", "wind_prior"


@dataclass(frozen=True)
class WindPrior:
    """Speed of the wind along the track as known from elsewhere, Gaussian in 1 / v_sw.

    It is told of the mean of 1 / v_sw over the segments of the wind, and counts beside the broad prior of the model.

    Attributes
    ----------
    v_sw_km_s, sd_km_s : float
        Speed and its standard deviation, km/s; 1 / v_sw is taken with the standard deviation sd / v_sw^2.
    """

    v_sw_km_s: float
    sd_km_s: float

    def __post_init__(self) -> None:
        if not (100 <= self.v_sw_km_s <= 3000 and 0 < self.sd_km_s <= self.v_sw_km_s):
            raise InputError(
                f"wind prior {self.v_sw_km_s:g} ± {self.sd_km_s:g} km/s: give a speed between 100 and 3000 "
                "and a deviation between 0 and the speed"
            )

    def residual(self, model: JointModel, z: FloatArray) -> FloatArray:
        """Mean of 1 / v_sw less that of the prior, in standard deviations of the prior, shape (N,)."""
        slowness = model.slowness(z).mean(axis=1) * self.v_sw_km_s / model.priors.v_sw_km_s
        return np.asarray((slowness - 1) * self.v_sw_km_s / self.sd_km_s)


@dataclass(frozen=True)
class Observed:
    """What was observed of a burst; each part may be missing.

    Attributes
    ----------
    channels : TimedChannels or None
    directions : DirectionTerms or None
    wind : WindPrior or None
    """

    channels: TimedChannels | None
    directions: DirectionTerms | None = None
    wind: WindPrior | None = None

    def split(self, name: str) -> tuple["Observed", "Observed"]:
        """All but one part, and that part alone.

        Parameters
        ----------
        name : str
            Of a part, as in `squares`.

        Returns
        -------
        tuple of Observed
        """
        field = {ARRIVAL_TIMES: "channels", WAVE_DIRECTIONS: "directions", WIND: "wind"}[name]
        alone: Observed = replace(Observed(None), **{field: getattr(self, field)})
        return replace(self, **{field: None}), alone

    @cached_property
    def frequency_mhz(self) -> FloatArray:
        """Frequencies of all parts, ascending, shape (F,)."""
        heard = [one.frequency_mhz for one in (self.channels, self.directions) if one is not None]
        return np.unique(np.concatenate(heard)) if heard else np.ones(1)

    @property
    def freedom(self) -> int:
        """Degrees of freedom: the number of residuals, less one for the release time."""
        timed = self.channels.size - 1 if self.channels is not None else 0
        return timed + (self.directions.size if self.directions is not None else 0) + (self.wind is not None)

    def residual(self, model: JointModel, z: FloatArray) -> FloatArray:
        """Residuals of all parts one after the other.

        Parameters
        ----------
        model : JointModel
        z : ndarray, shape (N, P)

        Returns
        -------
        ndarray, shape (N, D)
            Arrival times in s, angles in units of their errors, the wind in standard deviations.
        """
        parts = [one.residual(model, z).reshape(len(z), -1) for one in self._parts]
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def weigh(self, residual: FloatArray) -> FloatArray:
        """Apply the inverse covariance.

        Parameters
        ----------
        residual : ndarray, shape (..., D)

        Returns
        -------
        ndarray, shape (..., D)
        """
        if self.channels is None:
            return residual
        shape, timed = self.channels.precision.shape, self.channels.precision.size
        weighed = residual.copy()
        times_s = residual[..., :timed].reshape(*residual.shape[:-1], *shape)
        weighed[..., :timed] = self.channels.weigh(times_s).reshape(*residual.shape[:-1], timed)
        return weighed

    def misfit(self, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Sum of squares of residuals, and the best release time.

        Parameters
        ----------
        residual : ndarray, shape (N, D)

        Returns
        -------
        tuple of two ndarray, shape (N,)
            Misfit (dimensionless) and release time, s; 0 where there are no arrival times.
        """
        if self.channels is None:
            return np.einsum("nd,nd->n", residual, residual), np.zeros(len(residual))
        shape, timed = self.channels.precision.shape, self.channels.precision.size
        squares, release_s = self.channels.misfit(residual[:, :timed].reshape(-1, *shape))
        if residual.shape[1] > timed:
            squares = squares + np.einsum("nd,nd->n", residual[:, timed:], residual[:, timed:])
        return squares, release_s

    def squares(self, model: JointModel, z: FloatArray) -> dict[str, tuple[float, int]]:
        """Sum of squares of each part and the number of its residuals, at one point.

        Parameters
        ----------
        model : JointModel
        z : ndarray, shape (P,)

        Returns
        -------
        dict of str to tuple
        """
        found = {}
        if self.channels is not None:
            timed = self.channels.misfit(self.channels.residual(model, z[None]))[0]
            found[ARRIVAL_TIMES] = float(timed[0]), self.channels.size
        if self.directions is not None:
            found[WAVE_DIRECTIONS] = float((self.directions.residual(model, z[None]) ** 2).sum()), self.directions.size
        if self.wind is not None:
            found[WIND] = float(self.wind.residual(model, z[None])[0] ** 2), 1
        return found

    @property
    def log_norm(self) -> float:
        """Logarithm of the factor before the exponential of the likelihood."""
        total = self.channels.log_norm if self.channels is not None else 0.0
        total += self.directions.log_norm if self.directions is not None else 0.0
        wind = self.wind
        return total - (0.5 * math.log(2 * math.pi) + math.log(wind.sd_km_s / wind.v_sw_km_s) if wind else 0.0)

    @property
    def _parts(self) -> list[TimedChannels | DirectionTerms | WindPrior]:
        return [one for one in (self.channels, self.directions, self.wind) if one is not None]

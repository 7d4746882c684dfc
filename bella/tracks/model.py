"""What a track is made of: a Parker spiral, a distance and a time of emission for every frequency, and their priors.

The headline model borrows no law: distance and time of emission are smooth functions of frequency. The other models,
with a power law for the density and beams that keep their speed or slow down, are there to be compared with it.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.interpolate import BSpline

from bella.exceptions import InputError
from bella.heliosphere import SIDEREAL_ROTATION_D, angular_speed_rad_s, slowing_travel_s, spiral_path_rsun
from bella.heliosphere.scattering import LITERATURE_DELAY, DirectionalDelay
from bella.units import C_RSUN_S, R_SUN_KM, FloatArray

Distance = Literal["free", "power"]
Emission = Literal["free", "constant", "slowing"]

WIND_KM_S, SLOWNESS_SD = 400.0, 0.3
"""Prior of the wind: 400 km/s over its speed is 1 +- 0.3, so that 68 % lie between 308 and 571 km/s, as in the slow and
the fast wind of the ecliptic (Larrodera & Cid 2020, A&A 635, A44, doi:10.1051/0004-6361/201937307)."""

LN_RANGE = (0.0, 7.0)
"""Limits of ln r: 1 to 1100 solar radii."""

NEAREST_RSUN = 0.3
"""Added in quadrature to distances from sources to receivers: at a receiver, directions have no derivative."""

STEP = 1e-4
"""Step of numerical derivatives, in standard deviations of the prior."""

SLOWEST, FASTEST = 0.1, 3.0
"""Limits of 400 km/s over the speed of the wind: 133 to 4000 km/s."""

LEVEL_MHZ, LEVEL_RSUN, LEVEL_SD = 0.55, 40.0, 0.7
"""Prior of the distance, in ln r: 40 solar radii at 0.55 MHz, within a factor of 2; holds the density models of the
literature, fundamental and harmonic, and twice as dense."""

SLOPE, SLOPE_SD = -0.95, 0.25
"""Prior of d ln r / d ln f: -0.93 +- 0.11 for the density models, -0.71 for the burst of 2012-06-07."""

BEND_SD, BEND_LENGTH = 0.15, 1.0
"""Departure of ln r from a power law of frequency, and its correlation length in ln f."""

COEFFICIENTS = 6
"""Of the cubic spline ln r(ln f); ten gave the same tracks."""

BEAM_SPEED_C, BEAM_LN_SD = 0.15, 0.5
"""Prior of the speed of the beam at 1 solar radius where a model has one: 0.06 to 0.4 c in 95 %."""

SLOWING, SLOWING_SD = 0.3, 0.15
"""Prior of d in v = v(1) r^-d: 0.37 Krupar et al. 2015, doi:10.1051/0004-6361/201425308; 0.3 Azzollini & Kontar 2025,
arXiv:2504.18312."""

EMISSION_FLAT_S: tuple[float, ...] = (1e3, 500.0, 60.0)
"""Standard deviations of the terms 1, 1/f, 1/f^2 (f in MHz) of a free time of emission, s: as good as flat for beams,
which take 340 s / f."""

EMISSION_SMOOTH_S, EMISSION_LENGTHS = 60.0, ((1.0, 1.2), (0.6, 0.4), (0.3, 0.2))
"""Departure of the time of emission from these terms: 60 s (0.55 MHz / f), a tenth of the travel time of a beam, with
its shares and their correlation lengths in ln f. A wave of 4 % in the distance is one of 25 s in the time of emission:
with shares of 1 and 0.1 half of the bursts in wavy densities were called badly fitted, and their longitude was off by
1.8 deg instead of 1.0 (24 simulated bursts)."""

BEAM_DEPARTURE = 0.05
"""The same of a beam that has a law, as a share of 60 s (0.55 MHz / f)."""


@dataclass(frozen=True)
class WindPrior:
    """Prior of the wind along the apparent track, Gaussian in 400 km/s over its speed."""

    slowness: float = 1.0
    slowness_sd: float = SLOWNESS_SD


def measured_wind(v_sw_km_s: float, sd_km_s: float, ratio: float = 1.0, ratio_sd: float = 0.0) -> WindPrior:
    """Prior of the apparent spiral from a wind measured in situ, which takes the place of the broad one.

    Scattering moves sources outward, so that the spiral through the apparent ones is that of a faster wind.

    Parameters
    ----------
    v_sw_km_s, sd_km_s : float
        Speed of the wind and its standard deviation, km/s.
    ratio, ratio_sd : float
        Apparent over true distance.

    Returns
    -------
    WindPrior

    Raises
    ------
    InputError
        If a number is no speed, or no deviation.
    """
    if not (100 <= v_sw_km_s <= 3000 and 0 < sd_km_s <= v_sw_km_s and ratio > 0 <= ratio_sd):
        raise InputError(
            f"wind {v_sw_km_s:g} ± {sd_km_s:g} km/s: give a speed between 100 and 3000 and a deviation below it"
        )
    slowness = WIND_KM_S / (v_sw_km_s * ratio)
    return WindPrior(slowness, slowness * math.hypot(sd_km_s / v_sw_km_s, ratio_sd / ratio))


@dataclass(frozen=True)
class TrackModel:
    """Which laws a track follows, and its priors.

    Attributes
    ----------
    distance : {"free", "power"}
        ln r is a spline in ln f, or a straight line.
    emission : {"free", "constant", "slowing"}
        The time of emission is a free function of frequency, or that of a beam along the spiral.
    knots_rsun : tuple of float
        Distances at which the speed of the wind changes.
    wind : WindPrior
    delay : DirectionalDelay
    rotation_period_d : float
    """

    distance: Distance = "free"
    emission: Emission = "free"
    knots_rsun: tuple[float, ...] = ()
    wind: WindPrior = field(default_factory=WindPrior)
    delay: DirectionalDelay = LITERATURE_DELAY
    rotation_period_d: float = SIDEREAL_ROTATION_D

    @property
    def name(self) -> str:
        """The model in words."""
        distance = {"free": "free distance", "power": "distance a power of frequency"}[self.distance]
        emission = {
            "free": "free time of emission",
            "constant": "beam of constant speed",
            "slowing": "beam that slows down",
        }[self.emission]
        knots = "".join(f", wind changes at {knot:g} R_sun" for knot in self.knots_rsun)
        return f"{distance}, {emission}{knots}"

    @property
    def turn_per_rsun(self) -> float:
        """Radians by which the spiral falls back per solar radius in a wind of 400 km/s."""
        return angular_speed_rad_s(self.rotation_period_d) * R_SUN_KM / WIND_KM_S


@dataclass(frozen=True)
class Rows:
    """Where and when a burst was seen: one entry per arrival time.

    Attributes
    ----------
    receiver_rsun : ndarray, shape (N, 3)
        HEE.
    """

    frequency_mhz: FloatArray
    rise_s: FloatArray
    receiver_rsun: FloatArray


@dataclass(frozen=True)
class _Sight:
    """Lines from sources in the ecliptic plane to receivers: length, cosine and sine of the angle to outward."""

    distance_rsun: FloatArray
    cosine: FloatArray
    range_rsun: FloatArray
    sine: FloatArray

    @classmethod
    def of(cls, range_rsun: FloatArray, longitude_rad: FloatArray, receiver_rsun: FloatArray) -> "_Sight":
        """Of sources at (range, longitude), shape (B, N), and receivers, shape (N, 3)."""
        cosine, sine = np.cos(longitude_rad), np.sin(longitude_rad)
        x, y = receiver_rsun[:, 0], receiver_rsun[:, 1]
        above = x * cosine + y * sine - range_rsun  # of the receiver over the source, along the direction from the Sun
        aside = y * cosine - x * sine
        distance = np.sqrt(above**2 + aside**2 + receiver_rsun[:, 2] ** 2 + NEAREST_RSUN**2)
        return cls(distance, above / distance, range_rsun, aside / distance)

    @property
    def by_range(self) -> tuple[FloatArray, FloatArray]:
        """Derivatives of length and cosine."""
        return -self.cosine, (self.cosine**2 - 1) / self.distance_rsun

    @property
    def by_longitude(self) -> tuple[FloatArray, FloatArray]:
        """Derivatives of length and cosine, per radian."""
        turn_rsun = self.range_rsun * self.sine
        return -turn_rsun, self.sine + self.cosine * turn_rsun / self.distance_rsun


@dataclass(frozen=True)
class Track:
    """A model on the frequency band of a burst; its parameters z are standard normal before the data.

    Attributes
    ----------
    band_mhz : (float, float)
        Lowest and highest frequency.
    holds_delay : bool
        Whether the directional delay stays as it is given in z: then it has no prior, and nothing changes with it.
    """

    model: TrackModel
    band_mhz: tuple[float, float]
    holds_delay: bool = False

    @property
    def winds(self) -> int:
        """Number of parts with a wind of their own."""
        return 1 + len(self.model.knots_rsun)

    @cached_property
    def _knots(self) -> FloatArray:
        low, high = np.log(self.band_mhz)
        inner = np.linspace(low, high, COEFFICIENTS - 2)
        return np.concatenate([[low] * 3, inner, [high] * 3])

    @cached_property
    def _ln_range(self) -> tuple[FloatArray, FloatArray]:
        """Prior of the coefficients: mean, and a root of the covariance."""
        greville = np.array([self._knots[i + 1 : i + 4].mean() for i in range(COEFFICIENTS)])
        away = greville - math.log(LEVEL_MHZ)
        mean = math.log(LEVEL_RSUN) + SLOPE * away
        straight = np.stack([np.full(away.size, LEVEL_SD), SLOPE_SD * away], axis=1)
        if self.model.distance == "power":
            return mean, straight
        apart = np.subtract.outer(greville, greville) / BEND_LENGTH
        bend = BEND_SD**2 * np.exp(-0.5 * apart**2) + 1e-9 * np.eye(away.size)
        return mean, np.linalg.cholesky(straight @ straight.T + bend)

    @property
    def size(self) -> int:
        """Number of parameters P: wind, delay, distance, beam."""
        beam = {"free": 0, "constant": 1, "slowing": 2}[self.model.emission]
        return self.winds + 1 + int(self._ln_range[1].shape[1]) + beam

    def nearest(self, other: "Track", z: FloatArray) -> FloatArray:
        """Parameters nearest to those of another model on the same band, shape (..., P); beams are as before the data.

        Parameters
        ----------
        z : ndarray, shape (..., its P)
        """
        root, its_root = self._ln_range[1], other._ln_range[1]
        level, its_level = self.winds + 1, other.winds + 1
        found = np.zeros((*z.shape[:-1], self.size))
        wind = (other.slowness(z)[..., :1] - self.model.wind.slowness) / self.model.wind.slowness_sd
        found[..., : self.winds] = np.clip(wind, -2, 2)
        found[..., self.winds] = z[..., other.winds]
        coefficients = z[..., its_level : its_level + its_root.shape[1]] @ its_root.T
        found[..., level : level + root.shape[1]] = coefficients @ np.linalg.pinv(root).T
        return found

    def free(self, z: FloatArray) -> FloatArray:
        """Parameters with 0 in place of a delay that is held, shape (..., P)."""
        return z if not self.holds_delay else np.where(np.arange(self.size) == self.winds, 0.0, z)

    def slowness(self, z: FloatArray) -> FloatArray:
        """400 km/s over the speed of the wind in each part, shape (..., winds), within its limits."""
        prior = self.model.wind
        return np.clip(prior.slowness + prior.slowness_sd * z[..., : self.winds], SLOWEST, FASTEST)

    def kappa(self, z: FloatArray) -> FloatArray:
        """Delay of a receiver that the source does not point to, over the half width of the rise, shape (...)."""
        return np.asarray(self.model.delay.kappa + self.model.delay.kappa_sd * z[..., self.winds])

    @cached_property
    def _bases(self) -> dict[bytes, FloatArray]:
        """Values of the splines by the frequencies that they were computed for: a fit asks for the same ones again."""
        return {}

    def basis(self, frequency_mhz: FloatArray) -> FloatArray:
        """Values of the splines at frequencies, shape (F, coefficients)."""
        name = frequency_mhz.tobytes()
        if name not in self._bases:
            matrix = BSpline.design_matrix(np.log(frequency_mhz), self._knots, 3, extrapolate=True)
            self._bases[name] = np.asarray(matrix.toarray())
        return self._bases[name]

    def range_rsun(self, z: FloatArray, basis: FloatArray) -> FloatArray:
        """Distance of the source from the Sun, solar radii.

        Parameters
        ----------
        z : ndarray, shape (..., P)
        basis : ndarray, shape (F, coefficients)
            As :meth:`basis` gives it for the frequencies.

        Returns
        -------
        ndarray, shape (..., F)
        """
        mean, root = self._ln_range
        own = z[..., self.winds + 1 : self.winds + 1 + root.shape[1]]
        return np.exp(np.clip((mean + own @ root.T) @ basis.T, *LN_RANGE))

    def turns(self, range_rsun: FloatArray) -> FloatArray:
        """Solar radii that the spiral crosses in each part of the wind, shape (winds, ..., F)."""
        limits = (1.0, *self.model.knots_rsun, np.inf)
        parts = pairwise(limits)
        return np.stack([np.clip(range_rsun - inner, 0.0, outer - inner) for inner, outer in parts])

    def longitude_rad(self, phi0_rad: FloatArray, z: FloatArray, range_rsun: FloatArray) -> FloatArray:
        """Longitude of the spiral, HEE, west positive.

        Parameters
        ----------
        phi0_rad : ndarray, shape (...)
            At 1 solar radius.
        z : ndarray, shape (..., P)
        range_rsun : ndarray, shape (..., F)

        Returns
        -------
        ndarray, shape (..., F)
        """
        turned = (np.moveaxis(self.slowness(z), -1, 0)[..., None] * self.turns(range_rsun)).sum(axis=0)
        return np.asarray(np.asarray(phi0_rad)[..., None] - self.model.turn_per_rsun * turned)

    def beam_s(self, z: FloatArray, range_rsun: FloatArray) -> FloatArray:
        """Travel time of a beam that has a law, s; 0 for a free time of emission. Shapes as `range_rsun`."""
        if self.model.emission == "free":
            return np.zeros_like(range_rsun)
        first = self.winds + 1 + self._ln_range[1].shape[1]
        speed_c = BEAM_SPEED_C * np.exp(BEAM_LN_SD * z[..., first, None])
        wind_km_s = WIND_KM_S / self.slowness(z).mean(axis=-1)[..., None]
        if self.model.emission == "constant":
            return spiral_path_rsun(range_rsun, wind_km_s, self.model.rotation_period_d) / (speed_c * C_RSUN_S)
        slowing = SLOWING + SLOWING_SD * z[..., first + 1, None]
        return slowing_travel_s(range_rsun, speed_c, slowing, wind_km_s, self.model.rotation_period_d)

    def arrival_s(self, phi0_rad: FloatArray, z: FloatArray, rows: Rows) -> FloatArray:
        """Arrival times without what is marginalised: light travel, directional delay and, if it has a law, the beam.

        Parameters
        ----------
        phi0_rad : ndarray, shape (B,)
        z : ndarray, shape (B, P)

        Returns
        -------
        ndarray, shape (B, N)
            s.
        """
        range_rsun = self.range_rsun(z, self.basis(rows.frequency_mhz))
        sight = _Sight.of(range_rsun, self.longitude_rad(phi0_rad, z, range_rsun), rows.receiver_rsun)
        delay_s = self.kappa(z)[:, None] * rows.rise_s * (1 - sight.cosine)
        return np.asarray(sight.distance_rsun / C_RSUN_S + delay_s + self.beam_s(z, range_rsun))

    def slopes_s(self, phi0_rad: FloatArray, z: FloatArray, rows: Rows) -> FloatArray:
        """Derivatives of the arrival times with respect to z and, last, phi0 in radians, shape (B, P + 1, N)."""
        basis = self.basis(rows.frequency_mhz)
        range_rsun = self.range_rsun(z, basis)
        sight = _Sight.of(range_rsun, self.longitude_rad(phi0_rad, z, range_rsun), rows.receiver_rsun)
        delay_s = self.kappa(z)[:, None] * rows.rise_s
        by_range, by_turn = (
            distance / C_RSUN_S - delay_s * cosine for distance, cosine in (sight.by_range, sight.by_longitude)
        )
        of_place = self.chained(z, range_rsun, basis, range_rsun * by_range, by_turn)
        slopes = np.concatenate([of_place, by_turn[:, None]], axis=1)
        if not self.holds_delay:
            slopes[:, self.winds] = self.model.delay.kappa_sd * rows.rise_s * (1 - sight.cosine)
        if self.model.emission != "free":
            self._add_beam(slopes, z, range_rsun, basis @ self._ln_range[1])
        return slopes

    def chained(
        self, z: FloatArray, range_rsun: FloatArray, basis: FloatArray, by_log_range: FloatArray, by_turn: FloatArray
    ) -> FloatArray:
        """Derivatives with respect to z of what is a function of the place of the source.

        Parameters
        ----------
        by_log_range, by_turn : ndarray, shape (B, N)
            Its derivatives by ln r and by the longitude.

        Returns
        -------
        ndarray, shape (B, P, N)
        """
        turns = self.turns(range_rsun)
        limits = np.array([1.0, *self.model.knots_rsun, np.inf])
        part = np.clip(np.searchsorted(limits, range_rsun) - 1, 0, self.winds - 1)
        local = np.take_along_axis(self.slowness(z), part.reshape(len(z), -1), axis=1).reshape(part.shape)
        along = by_log_range - self.model.turn_per_rsun * local * range_rsun * by_turn
        root = self._ln_range[1]
        slopes = np.zeros((len(z), self.size, by_turn.shape[1]))
        wind_sd = self.model.wind.slowness_sd * self.model.turn_per_rsun
        slopes[:, : self.winds] = -wind_sd * np.moveaxis(turns, 0, 1) * by_turn[:, None]
        slopes[:, self.winds + 1 : self.winds + 1 + root.shape[1]] = along[:, None] * (basis @ root).T
        return slopes

    def _add_beam(self, slopes: FloatArray, z: FloatArray, range_rsun: FloatArray, spline: FloatArray) -> None:
        """Add the derivatives of the travel of the beam; only that by its slowing is a difference.

        Of t(r) = Int_1^r x^d sqrt(1 + k^2 x^2) dx / v the derivative by ln r is g(r) = r^(1+d) sqrt(1 + k^2 r^2) / v,
        and that by k is (g(r) - g(1) - (1 + d) t) / k, by parts.
        """
        now, end = self.beam_s(z, range_rsun), self.winds + 1 + spline.shape[1]
        speed_c = BEAM_SPEED_C * np.exp(BEAM_LN_SD * z[:, end, None])
        winding = self.model.turn_per_rsun * self.slowness(z).mean(axis=-1)[:, None]
        exponent = np.ones((len(z), 1))
        if self.model.emission == "slowing":
            exponent = 1 + SLOWING + SLOWING_SD * z[:, end + 1, None]
            moved = z.copy()
            moved[:, end + 1] += STEP
            slopes[:, end + 1] = (self.beam_s(moved, range_rsun) - now) / STEP
        by_log_range, at_the_sun = (
            r**exponent * np.sqrt(1 + (winding * r) ** 2) / (speed_c * C_RSUN_S) for r in (range_rsun, 1.0)
        )
        by_winding = (by_log_range - at_the_sun - exponent * now) / winding
        by_wind = self.model.turn_per_rsun * self.model.wind.slowness_sd / self.winds * by_winding
        slopes[:, : self.winds] += by_wind[:, None]
        slopes[:, self.winds + 1 : end] += by_log_range[:, None] * spline.T
        slopes[:, end] = -BEAM_LN_SD * now

    def position_rsun(self, phi0_rad: FloatArray, z: FloatArray, range_rsun: FloatArray) -> FloatArray:
        """Position of the source, HEE, shape (..., F, 3)."""
        longitude = self.longitude_rad(phi0_rad, z, range_rsun)
        flat = np.zeros_like(longitude)
        return np.stack([range_rsun * np.cos(longitude), range_rsun * np.sin(longitude), flat], axis=-1)

    def emission_s2(self, one_mhz: FloatArray, other_mhz: FloatArray) -> FloatArray:
        """Prior covariance of the part of the time of emission that is marginalised.

        Parameters
        ----------
        one_mhz, other_mhz : ndarray, shape (N,) and (M,)

        Returns
        -------
        ndarray, shape (N, M)
            s^2.
        """
        if self.model.emission == "free":
            flat_s, share = EMISSION_FLAT_S, 1.0
        else:
            flat_s, share = EMISSION_FLAT_S[:1], BEAM_DEPARTURE
        flat = sum(sd**2 * np.outer(one_mhz**-p, other_mhz**-p) for p, sd in enumerate(flat_s))
        size = np.outer(*(EMISSION_SMOOTH_S * LEVEL_MHZ / f for f in (one_mhz, other_mhz)))
        apart = np.subtract.outer(np.log(one_mhz), np.log(other_mhz))
        smooth = sum(part**2 * np.exp(-0.5 * (apart / length) ** 2) for part, length in EMISSION_LENGTHS)
        return np.asarray(flat + share**2 * size * smooth)

    @property
    def wind_width_km_s(self) -> float:
        """Width of the 68 % interval of the prior of the wind, km/s."""
        prior = self.model.wind
        slow, fast = (np.clip(prior.slowness + side * prior.slowness_sd, SLOWEST, FASTEST) for side in (1, -1))
        return float(WIND_KM_S / fast - WIND_KM_S / slow)

"""The joint model of a burst: a beam on a Parker spiral, and when each receiver hears each frequency.

    t_ij = t_start + T(r_j) + |x_j - s_i| / c

T is the travel of the beam from 1 solar radius along the spiral (Parker 1958, ApJ 128, 664, doi:10.1086/146579) to the
distance r_j = a (f_j / 0.55 MHz)^b at which it emits f_j; x_j lies on the spiral in the ecliptic plane, s_i anywhere.
Which harmonic is heard is absorbed in a: without a density from elsewhere it cannot be told.

Parameters are handled as z, standard normal under the prior. The speed of the wind enters as 1 / v_sw, in which the
longitude of the spiral is linear.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp, ndtr
from scipy.stats import norm

from bella.heliosphere import SIDEREAL_ROTATION_D, beam_travel_s, slowing_travel_s
from bella.tracks.joint_wind import along_field_line, field_line_position_rsun
from bella.units import C_RSUN_S, FloatArray

PIVOT_MHZ = 0.55
"""Frequency at which the distance is `a`."""
PHI0 = 0
"""Place of the longitude among the parameters."""
TURN_DEG = 360.0
FASTEST_WIND_KM_S = 4000.0
"""No wind is faster: keeps 1 / v_sw positive, and the mean of v_sw finite."""
NORMALISATION_DRAWS = 100_000


@dataclass(frozen=True)
class JointPriors:
    """Priors of the joint model; each parameter is Gaussian as it is written here.

    Attributes
    ----------
    phi0_deg, phi0_sd_deg : float
        HEE longitude at 1 solar radius, wrapped on the circle, degrees.
    v_sw_km_s, slowness_sd : float
        Speed of the wind at the mean of 1 / v_sw, km/s, and the standard deviation of 1 / v_sw in units of that mean.
    a_rsun, ln_a_sd : float
        Distance at 0.55 MHz, solar radii, at the mean of ln a, and the standard deviation of ln a.
    b, b_sd : float
        Exponent of distance on frequency.
    beam_speed_c, ln_beam_sd : float
        Speed of the beam in units of c, at the mean of its logarithm, and the standard deviation of that.
    deceleration_sd : float
        Exponent of speed on distance: mean 0, and this standard deviation.
    """

    phi0_deg: float = 0.0
    phi0_sd_deg: float = 60.0
    v_sw_km_s: float = 400.0
    slowness_sd: float = 0.3
    a_rsun: float = 40.0
    ln_a_sd: float = 0.7
    b: float = -1.0
    b_sd: float = 0.15
    beam_speed_c: float = 0.15
    ln_beam_sd: float = 0.5
    deceleration_sd: float = 0.3


@dataclass(frozen=True)
class JointParameters:
    """Parameters in natural units, each of shape (N,).

    Attributes
    ----------
    phi0_deg, v_sw_km_s, a_rsun, b, beam_speed_c : ndarray
        As in `JointPriors`.
    deceleration : ndarray
        Exponent d of v(r) = v(1) r^-d; `beam_speed_c` is then the speed at 1 solar radius.
    b2 : ndarray
        Exponent of distance on frequency below the break.
    outer_v_sw_km_s : ndarray, shape (N, K)
        Speed of the wind beyond each knot; K is 0 for one wind all the way.
    """

    phi0_deg: FloatArray
    v_sw_km_s: FloatArray
    a_rsun: FloatArray
    b: FloatArray
    beam_speed_c: FloatArray
    deceleration: FloatArray
    b2: FloatArray
    outer_v_sw_km_s: FloatArray

    @property
    def winds_km_s(self) -> tuple[FloatArray, ...]:
        """Speed of the wind in each segment from the Sun outwards, shape (N, 1) each."""
        return (self.v_sw_km_s[:, None], *(wind[:, None] for wind in self.outer_v_sw_km_s.T))


@dataclass(frozen=True)
class JointModel:
    """What a joint fit assumes.

    Attributes
    ----------
    priors : JointPriors
    rotation_period_d : float
        Rotation period of the Sun, days; v_sw is proportional to its inverse.
    deceleration : bool
        The speed of the beam falls as a power of the distance.
    two_slope : bool
        Below `break_mhz` the distance follows another power of the frequency.
    break_mhz : float
    knots_rsun : tuple of float
        Distances at which the speed of the wind changes, ascending, solar radii; beyond each 1 / v_sw is a parameter of
        its own, with the prior of the first.
    """

    priors: JointPriors = JointPriors()
    rotation_period_d: float = SIDEREAL_ROTATION_D
    deceleration: bool = False
    two_slope: bool = False
    break_mhz: float = PIVOT_MHZ
    knots_rsun: tuple[float, ...] = ()

    @property
    def name(self) -> str:
        """The model in words, to be stored with every fit."""
        winds = len(self.knots_rsun) + 1
        words = {"slowing beam": self.deceleration, "two slopes": self.two_slope, f"{winds} winds": winds > 1}
        return ", ".join(["joint spiral", *(word for word, on in words.items() if on)])

    @property
    def variants(self) -> tuple["JointModel", ...]:
        """Itself, and the models with another beam or density law."""
        switches = [(slow, two) for slow in (False, True) for two in (False, True)]
        every = [replace(self, deceleration=slow, two_slope=two) for slow, two in switches]
        return self, *(one for one in every if one != self)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of z."""
        extra = [name for name, on in (("deceleration", self.deceleration), ("b2", self.two_slope)) if on]
        return ("phi0_deg", "v_sw_km_s", "a_rsun", "b", "beam_speed_c", *extra, *self.outer_winds)

    @property
    def outer_winds(self) -> tuple[str, ...]:
        """Names of the speeds of the wind beyond each knot."""
        return tuple(f"v_sw_{place}_km_s" for place in range(2, len(self.knots_rsun) + 2))

    def slowness(self, z: FloatArray) -> FloatArray:
        """1 / v_sw of each segment of the wind, in units of the mean of its prior.

        Parameters
        ----------
        z : ndarray, shape (N, P)

        Returns
        -------
        ndarray, shape (N, K + 1)
            Not limited: 0 or less where no wind has it.
        """
        first = len(self.parameters) - len(self.knots_rsun)
        return np.asarray(1 + self.priors.slowness_sd * z[:, [1, *range(first, len(self.parameters))]])

    @property
    def turn(self) -> float:
        """One turn of the longitude in units of its prior standard deviation."""
        return TURN_DEG / self.priors.phi0_sd_deg

    def natural(self, z: FloatArray) -> JointParameters:
        """Turn standard normal parameters into those of the field.

        Parameters
        ----------
        z : ndarray, shape (N, P)
            In the order of `parameters`; outside the limits of wind and beam they are moved to the limit.

        Returns
        -------
        JointParameters
        """
        p = self.priors
        b = p.b + p.b_sd * z[:, 3]
        v_sw_km_s = p.v_sw_km_s / np.maximum(self.slowness(z), p.v_sw_km_s / FASTEST_WIND_KM_S)
        return JointParameters(
            phi0_deg=p.phi0_deg + p.phi0_sd_deg * z[:, PHI0],
            v_sw_km_s=v_sw_km_s[:, 0],
            a_rsun=p.a_rsun * np.exp(p.ln_a_sd * z[:, 2]),
            b=b,
            beam_speed_c=np.minimum(p.beam_speed_c * np.exp(p.ln_beam_sd * z[:, 4]), 1.0),
            deceleration=p.deceleration_sd * z[:, 5] if self.deceleration else np.zeros_like(b),
            b2=p.b + p.b_sd * z[:, 5 + self.deceleration] if self.two_slope else b,
            outer_v_sw_km_s=v_sw_km_s[:, 1:],
        )

    def standard(self, name: str, value: FloatArray) -> FloatArray:
        """Turn one parameter into what is standard normal under its prior.

        Parameters
        ----------
        name : str
            One of `parameters`.
        value : ndarray, shape (N,)
            In natural units.

        Returns
        -------
        ndarray, shape (N,)
        """
        p = self.priors
        if name == "v_sw_km_s" or name in self.outer_winds:
            return np.asarray((p.v_sw_km_s / value - 1) / p.slowness_sd)
        if name in {"a_rsun", "beam_speed_c"}:
            centre, sd = (p.a_rsun, p.ln_a_sd) if name == "a_rsun" else (p.beam_speed_c, p.ln_beam_sd)
            return np.asarray(np.log(value / centre) / sd)
        linear = {"phi0_deg": (p.phi0_deg, p.phi0_sd_deg), "deceleration": (0.0, p.deceleration_sd)}
        centre, sd = linear.get(name, (p.b, p.b_sd))
        return np.asarray((value - centre) / sd)

    def range_rsun(self, parameters: JointParameters, frequency_mhz: FloatArray) -> FloatArray:
        """Distance from the Sun at which each frequency is emitted.

        Parameters
        ----------
        parameters : JointParameters
        frequency_mhz : ndarray, shape (F,)

        Returns
        -------
        ndarray, shape (N, F)
            Solar radii.
        """
        log_frequency, log_break = np.log(frequency_mhz / PIVOT_MHZ), math.log(self.break_mhz / PIVOT_MHZ)
        exponent = parameters.b[:, None] * log_frequency
        if self.two_slope:
            exponent += (parameters.b2 - parameters.b)[:, None] * np.minimum(log_frequency - log_break, 0.0)
        return np.asarray(parameters.a_rsun[:, None] * np.exp(exponent))

    def position_rsun(self, parameters: JointParameters, range_rsun: FloatArray) -> FloatArray:
        """Positions on the spirals.

        Parameters
        ----------
        parameters : JointParameters
        range_rsun : ndarray, shape (N, F)
            Solar radii.

        Returns
        -------
        ndarray, shape (N, F, 3)
            HEE, solar radii.
        """
        phi0_deg, winds = parameters.phi0_deg[:, None], parameters.winds_km_s
        return field_line_position_rsun(range_rsun, phi0_deg, winds, self.knots_rsun, self.rotation_period_d)

    def delay_s(self, z: FloatArray, frequency_mhz: FloatArray, receiver_rsun: FloatArray) -> FloatArray:
        """Time from the release of the beam to the arrival at each receiver.

        Parameters
        ----------
        z : ndarray, shape (N, P)
        frequency_mhz : ndarray, shape (F,)
        receiver_rsun : ndarray, shape (F, n, 3)
            HEE, solar radii.

        Returns
        -------
        ndarray, shape (N, F, n)
            s.
        """
        parameters = self.natural(z)
        range_rsun = self.range_rsun(parameters, frequency_mhz)
        source = self.position_rsun(parameters, range_rsun)
        squared = (receiver_rsun**2).sum(axis=-1) + (range_rsun**2)[..., None]
        for axis in range(2):
            squared -= 2 * source[..., axis, None] * receiver_rsun[..., axis]
        light_s = np.sqrt(np.maximum(squared, 0.0, out=squared), out=squared) / C_RSUN_S
        return np.asarray(self._travel_s(parameters, range_rsun)[..., None] + light_s)

    def _travel_s(self, parameters: JointParameters, range_rsun: FloatArray) -> FloatArray:
        rotation_d, speed_c = self.rotation_period_d, parameters.beam_speed_c[:, None]
        slowing = parameters.deceleration[:, None]

        def _travel(r: FloatArray, wind: FloatArray) -> FloatArray:
            if not self.deceleration:
                return beam_travel_s(r, speed_c, wind, rotation_d)
            return slowing_travel_s(r, speed_c, slowing, wind, rotation_d)

        return along_field_line(range_rsun, parameters.winds_km_s, self.knots_rsun, _travel)

    def allowed(self, z: FloatArray, frequency_mhz: FloatArray) -> npt.NDArray[np.bool_]:
        """Whether the wind is one and the beam is slower than light at every frequency.

        Parameters
        ----------
        z : ndarray, shape (N, P)
        frequency_mhz : ndarray, shape (F,)

        Returns
        -------
        ndarray of bool, shape (N,)
        """
        p = self.priors
        ln_speed = math.log(p.beam_speed_c) + p.ln_beam_sd * z[:, 4]
        wind = (self.slowness(z) > p.v_sw_km_s / FASTEST_WIND_KM_S).all(axis=1)
        if not self.deceleration:
            return np.asarray(wind & (ln_speed < 0))
        farthest = self.range_rsun(self.natural(z), frequency_mhz[:1])[:, 0]
        return np.asarray(wind & (ln_speed < 0) & (ln_speed < p.deceleration_sd * z[:, 5] * np.log(farthest)))

    def log_prior(self, z: FloatArray, frequency_mhz: FloatArray) -> FloatArray:
        """Logarithm of the prior density of z, the longitude on a circle.

        Parameters
        ----------
        z : ndarray, shape (N, P)
            The first, the longitude, within half a turn of the centre of its prior.
        frequency_mhz : ndarray, shape (F,)
            Ascending.

        Returns
        -------
        ndarray, shape (N,)
            Minus infinity outside the limits.
        """
        around = norm.logpdf(z[:, PHI0, None] + self.turn * np.arange(-1, 2))
        log_density = logsumexp(around, axis=1) + norm.logpdf(z[:, 1:]).sum(axis=1)
        share = math.log(self.share_allowed(frequency_mhz))
        return np.asarray(np.where(self.allowed(z, frequency_mhz), log_density - share, -np.inf))

    def share_allowed(self, frequency_mhz: FloatArray) -> float:
        """Share of the Gaussian priors that lies within the limits of wind and beam.

        Parameters
        ----------
        frequency_mhz : ndarray, shape (F,)
            Ascending.

        Returns
        -------
        float
        """
        if self.deceleration:
            z = np.random.default_rng(0).standard_normal((NORMALISATION_DRAWS, len(self.parameters)))
            return float(self.allowed(z, frequency_mhz).mean())
        p = self.priors
        wind = ndtr((1 - p.v_sw_km_s / FASTEST_WIND_KM_S) / p.slowness_sd) ** (len(self.knots_rsun) + 1)
        return float(wind * ndtr(-math.log(p.beam_speed_c) / p.ln_beam_sd))

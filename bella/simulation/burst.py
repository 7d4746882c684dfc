"""A beam that leaves the Sun along a Parker spiral, and when, how brightly and for how long each spacecraft hears it.

The arrival time of an edge is defined by what is received: the moment when the true light curve of a channel, all its
components together and without noise, has first risen to half of its maximum. With a single pulse that is the light
travel from the source plus a delay that grows with the angle from the direction in which the source points.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy import constants
from scipy.special import lambertw

from bella.arrivals import check_arrivals
from bella.exceptions import InputError
from bella.heliosphere import (
    DENSITY_MODELS,
    SIDEREAL_ROTATION_D,
    DensityModel,
    emission_frequency_mhz,
    spiral_longitude_deg,
    spiral_path_rsun,
)
from bella.simulation.light_curves import PulseLaw, Pulses, pulses
from bella.spacecraft import position_hee
from bella.units import AU_RSUN, C_RSUN_S, R_SUN_KM, FloatArray

Instants = npt.NDArray[np.datetime64]

TRUE_EDGE = "half_rise"
"""Edge of simulated arrival times: where the true light curve has risen to half of its maximum."""

LIGHT_TIME_STEPS = 2
RANGES_RSUN, RANGE_NODES = (1.0, 400.0), 6000
"""Where a frequency is looked for, and at how many distances: a range is good to one part in a million."""

TRAVEL_NODES = 400
"""Nodes of the travel integral in ln r: the time is good to 1 ms at 1 au."""

EDGE_STEPS, EDGE_BEFORE, EDGE_AFTER = 1200, 2.0, 4.0
"""Where several pulses overlap, the light curve is looked at in so many steps, from 2 half widths of the rise before
the first to 4 after the last."""

SUN_KM3_S2 = 1.32712440018e11
"""Gravity of the Sun, G M, km^3/s^2."""

MANN_K, MANN_WEIGHT, MANN_PER_S = 1.0e6, 0.6, 6.3e34
"""Temperature, mean molecular weight, and electrons that flow out per second and steradian."""

USUAL_PULSE = PulseLaw()
LEVELLING_RSUN = 35.0
"""Over this distance a levelling beam comes down to the speed that it keeps."""


def _mann(range_rsun: FloatArray) -> FloatArray:
    """Isothermal wind of Parker at 1 MK: w - ln w = 4 ln(r/r_c) + 4 r_c/r - 3 with w = (v/c)^2; N = F / (r^2 v)."""
    critical_km_s = math.sqrt(constants.k * MANN_K / (MANN_WEIGHT * constants.m_p)) * 1e-3
    critical_rsun = SUN_KM3_S2 / (2.0 * critical_km_s**2) / R_SUN_KM
    x = np.asarray(range_rsun, dtype=np.float64) / critical_rsun
    right = np.maximum(4.0 * np.log(x) + 4.0 / x - 3.0, 1.0)
    squared = -np.where(x < 1.0, lambertw(-np.exp(-right), 0).real, lambertw(-np.exp(-right), -1).real)
    return np.asarray(MANN_PER_S / ((range_rsun * R_SUN_KM * 1e5) ** 2 * critical_km_s * 1e5 * np.sqrt(squared)))


def _newkirk_and_wind(range_rsun: FloatArray) -> FloatArray:
    return np.asarray(
        4.2e4 * (10.0 ** (4.32 / range_rsun) - 1.0) * range_rsun**-1.5 + 6.0 * (AU_RSUN / range_rsun) ** 2
    )


def _wavy(range_rsun: FloatArray) -> FloatArray:
    wave = 0.22 * np.sin(2.0 * np.pi * np.log(range_rsun) / np.log(4.0))
    return np.asarray(DENSITY_MODELS["saito"].density_cm3(range_rsun) * np.exp(wave))


DENSITIES: dict[str, DensityModel] = {
    **{name: DENSITY_MODELS[name] for name in ("leblanc", "saito", "parker")},
    "mann_wind": DensityModel("mann_wind", "Mann et al. 1999, A&A 348, 614: Parker's isothermal wind at 1 MK", _mann),
    "newkirk_wind": DensityModel(
        "newkirk_wind",
        "the corona of Newkirk 1961, ApJ 133, 983, let fall by r^-1.5 more, in a wind of 6 cm^-3 at 1 au",
        _newkirk_and_wind,
    ),
    "wavy": DensityModel("wavy", "Saito's model with a wave of 22 % in ln r, as streams leave it; no power law", _wavy),
}
"""Density models that bursts are drawn from, by name."""

SpeedLaw = Callable[[FloatArray, float], FloatArray]


def _constant(range_rsun: FloatArray, slowing: float) -> FloatArray:  # noqa: ARG001 - one signature for all laws
    return np.ones_like(range_rsun)


def _power(range_rsun: FloatArray, slowing: float) -> FloatArray:
    return np.asarray(range_rsun**-slowing)


def _levelling(range_rsun: FloatArray, slowing: float) -> FloatArray:
    return np.asarray((1.0 + slowing * np.exp(-range_rsun / LEVELLING_RSUN)) / (1.0 + slowing))


SPEED_LAWS: dict[str, SpeedLaw] = {"constant": _constant, "power": _power, "levelling": _levelling}
"""Speed of a beam over its speed at the Sun, for a distance in solar radii and a measure of its slowing.

Beams slow down: Krupar et al. 2015, A&A 580, A137, doi:10.1051/0004-6361/201425308.
"""


@dataclass(frozen=True)
class Companion:
    """The other component of a burst, received at the same frequencies: the fundamental beside the harmonic.

    Attributes
    ----------
    harmonic : int
        1 or 2.
    height : float
        Its peak over that of the main component, where both are seen from where they point to.
    rise_factor : float
        By how much it rises and decays more slowly than the main component at the same frequency.
    directivity : float
        Width of its beam pattern.
    """

    harmonic: int = 1
    height: float = 1.0
    rise_factor: float = 0.8
    directivity: float = 0.3


@dataclass(frozen=True)
class Aspect:
    """How a burst looks to one spacecraft, beyond what geometry makes of it.

    Attributes
    ----------
    height, companion_height, rise, decay : float
        Factors.
    lag, lag_phase : float
        The burst is late by lag times the half width of the rise times sin(2 ln f + phase): an error of the times that
        is smooth along frequency, as real bursts show it after every correction.
    """

    height: float = 1.0
    companion_height: float = 1.0
    rise: float = 1.0
    decay: float = 1.0
    lag: float = 0.0
    lag_phase: float = 0.0


@dataclass(frozen=True)
class SimulatedBurst:
    """One burst and the beam behind it.

    Attributes
    ----------
    release_utc : numpy.datetime64
        When the beam passes 1 solar radius; also the epoch of the HEE axes.
    phi0_deg : float
        HEE longitude of the spiral at 1 solar radius, degrees.
    v_sw_km_s : float
        Solar wind speed, km/s.
    beam_speed_c : float
        Speed of the beam along the field at 1 solar radius, in units of c.
    speed_law : str
        A name of `SPEED_LAWS`.
    slowing : float
        Of that law.
    density : str
        A name of `DENSITIES`.
    density_factor : float
        By how much the wind is denser than the model.
    harmonic : int
        1 or 2.
    companion : Companion, optional
        The other component.
    latitude_deg : float
        Of the spiral, HEE.
    f_low_mhz, f_high_mhz : float
        Ends of the burst, MHz.
    contrast : float
        Peak over background in power, where the burst is brightest and seen from where its source points to.
    pulse : PulseLaw
        Its light curves.
    width_factor : float
        By how much rise and decay are longer than that.
    taper : float
        Over how much of ln f the burst fades at either end of its band; 0 for sharp ends.
    directivity : float
        Width of the beam pattern; infinite for a source that is as bright from every side.
    kappa : float
        Delay of a receiver at an angle from the direction away from the Sun, at the source: kappa times the half width
        of the rise times (1 - cos).
    widening : float
        Share by which rise and decay are longer for a receiver opposite to that direction.
    second_s, second_height : float
        When a second pulse follows, s, and its height over the first; 0 for none.
    aspects : mapping of str to Aspect
        By observatory.
    stratum : str
        Which it was drawn from, for what is counted by strata.
    """

    release_utc: np.datetime64
    phi0_deg: float = 30.0
    v_sw_km_s: float = 400.0
    beam_speed_c: float = 0.15
    speed_law: str = "constant"
    slowing: float = 0.0
    density: str = "leblanc"
    density_factor: float = 1.0
    harmonic: int = 2
    companion: Companion | None = None
    latitude_deg: float = 0.0
    f_low_mhz: float = 0.1
    f_high_mhz: float = 14.0
    contrast: float = 30.0
    rotation_period_d: float = SIDEREAL_ROTATION_D
    pulse: PulseLaw = USUAL_PULSE
    width_factor: float = 1.0
    taper: float = 0.0
    directivity: float = np.inf
    kappa: float = 0.0
    widening: float = 0.0
    second_s: float = 0.0
    second_height: float = 0.0
    aspects: Mapping[str, Aspect] = field(default_factory=dict)
    stratum: str = ""

    def __post_init__(self) -> None:
        for name, known in (("density", DENSITIES), ("speed_law", SPEED_LAWS)):
            if getattr(self, name) not in known:
                raise InputError(f"{name} {getattr(self, name)!r} is not known; choose one of {', '.join(known)}")
        if not 0 < self.beam_speed_c < 1:
            raise InputError(f"a beam of {self.beam_speed_c:g} c is not one; give a speed between 0 and 1 c")
        if not 0 < self.width_factor < np.inf:
            raise InputError(f"width_factor is {self.width_factor:g}; give a number above zero")


class Received(NamedTuple):
    """Pulses that a spacecraft receives at each of C frequencies: components by repetitions, P together."""

    arrival_s: FloatArray
    """Half-rise of each pulse on its own, seconds after the release, shape (C, P)."""
    height: FloatArray
    """Peak over background, shape (C, P)."""
    rise_s: FloatArray
    """Half width of the rise, shape (C, P)."""
    decay_s: FloatArray
    """Shape (C, P)."""

    def curves(self, family: str) -> Pulses:
        """Their light curves, the pulses of one frequency after one another."""
        return pulses(family, self.rise_s.ravel(), self.decay_s.ravel())


def source_range_rsun(burst: SimulatedBurst, frequency_mhz: FloatArray, harmonic: int | None = None) -> FloatArray:
    """Distance of the source from the Sun at each frequency.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray, shape (N,)
    harmonic : int, optional
        1 or 2; that of the main component if none is given.

    Returns
    -------
    numpy.ndarray, shape (N,)
        Solar radii.

    Raises
    ------
    InputError
        If the density model does not reach a frequency.
    """
    plasma_mhz = np.asarray(frequency_mhz, dtype=np.float64) / (harmonic or burst.harmonic)
    at_factor_one = np.log(plasma_mhz / math.sqrt(burst.density_factor))
    log_range, log_mhz = _plasma_levels(burst.density)
    outside = ~((at_factor_one >= log_mhz[0]) & (at_factor_one <= log_mhz[-1]))
    if outside.any():
        raise InputError(
            f"the density model {burst.density!r} has no {np.asarray(frequency_mhz)[outside].flat[0]:g} MHz between "
            f"{RANGES_RSUN[0]:g} and {RANGES_RSUN[1]:g} solar radii; leave that frequency out"
        )
    return np.asarray(np.exp(np.interp(at_factor_one, log_mhz, log_range)))


@lru_cache(maxsize=16)
def _plasma_levels(density: str) -> tuple[FloatArray, FloatArray]:
    """Logarithms of distances from far to near and of the plasma frequencies there, ascending."""
    log_range = np.linspace(math.log(RANGES_RSUN[1]), math.log(RANGES_RSUN[0]), RANGE_NODES)
    return log_range, np.log(emission_frequency_mhz(np.exp(log_range), DENSITIES[density]))


def source_position_rsun(burst: SimulatedBurst, frequency_mhz: FloatArray, harmonic: int | None = None) -> FloatArray:
    """Position of the source at each frequency.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray, shape (N,)
    harmonic : int, optional
        1 or 2; that of the main component if none is given.

    Returns
    -------
    numpy.ndarray, shape (N, 3)
        HEE at the release, solar radii.
    """
    return _position_rsun(burst, source_range_rsun(burst, frequency_mhz, harmonic))


def _position_rsun(burst: SimulatedBurst, range_rsun: FloatArray) -> FloatArray:
    turned = spiral_longitude_deg(range_rsun, burst.phi0_deg, burst.v_sw_km_s, burst.rotation_period_d)
    longitude, latitude = np.radians(turned), math.radians(burst.latitude_deg)
    flat = range_rsun * math.cos(latitude)
    away = [flat * np.cos(longitude), flat * np.sin(longitude), range_rsun * math.sin(latitude)]
    return np.stack(away, axis=-1)


def travel_s(burst: SimulatedBurst, range_rsun: FloatArray) -> FloatArray:
    """Time that the beam takes from 1 solar radius to a distance from the Sun, along its spiral.

    Parameters
    ----------
    range_rsun : numpy.ndarray
        At least 1 solar radius.

    Returns
    -------
    numpy.ndarray
        s, the same shape.
    """
    farthest = max(float(np.max(range_rsun)), 2.0)
    nodes = np.geomspace(1.0, farthest * (1 + 1e-9), TRAVEL_NODES)
    middle = np.sqrt(nodes[1:] * nodes[:-1])
    path = spiral_path_rsun(nodes, burst.v_sw_km_s, burst.rotation_period_d)
    speed_c = burst.beam_speed_c * SPEED_LAWS[burst.speed_law](middle, burst.slowing)
    taken = np.concatenate([[0.0], np.cumsum(np.diff(path) / (speed_c * C_RSUN_S))])
    # between nodes the time is linear in the path, as the speed is constant there
    return np.asarray(np.interp(spiral_path_rsun(range_rsun, burst.v_sw_km_s, burst.rotation_period_d), path, taken))


def mean_beam_speed_c(burst: SimulatedBurst, frequency_mhz: FloatArray) -> float:
    """Mean speed of the beam along its spiral between the highest and the lowest of some frequencies, in units of c.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray
        At least two.
    """
    ends = source_range_rsun(burst, np.array([np.max(frequency_mhz), np.min(frequency_mhz)]))
    path = np.diff(spiral_path_rsun(ends, burst.v_sw_km_s, burst.rotation_period_d))
    return float(path[0] / np.diff(travel_s(burst, ends))[0] / C_RSUN_S)


def light_arrival_s(
    burst: SimulatedBurst, frequency_mhz: FloatArray, observatory: str, harmonic: int | None = None
) -> FloatArray:
    """When light of the source reaches a spacecraft: beam travel along the spiral, then light, and nothing else.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray, shape (N,)
    harmonic : int, optional
        1 or 2; that of the main component if none is given.

    Returns
    -------
    numpy.ndarray, shape (N,)
        Seconds after the release.

    Raises
    ------
    NoDataError
        If the ephemeris does not have the spacecraft then.
    """
    return _geometry(burst, frequency_mhz, observatory, harmonic).arrival_s


class _Geometry(NamedTuple):
    arrival_s: FloatArray
    """Of light, seconds after the release."""
    turned: FloatArray
    """1 - cos of the angle at the source between the direction from the Sun and that to the spacecraft."""
    cosine: FloatArray
    """Of the angle between source and spacecraft as seen from the Sun."""


def _geometry(
    burst: SimulatedBurst, frequency_mhz: FloatArray, observatory: str, harmonic: int | None = None
) -> _Geometry:
    range_rsun = source_range_rsun(burst, frequency_mhz, harmonic)
    source = _position_rsun(burst, range_rsun)
    emitted = travel_s(burst, range_rsun)
    received = emitted
    for _ in range(LIGHT_TIME_STEPS):  # the receiver moves while the light is under way
        receiver = position_hee(observatory, _at(burst, received), burst.release_utc)
        towards = receiver - source
        away_rsun = np.linalg.norm(towards, axis=1)
        received = emitted + away_rsun / C_RSUN_S
    outward = source / range_rsun[:, None]
    seen = (outward * receiver).sum(axis=1) / np.linalg.norm(receiver, axis=1)
    return _Geometry(received, 1.0 - (outward * towards).sum(axis=1) / away_rsun, seen)


def received(burst: SimulatedBurst, frequency_mhz: FloatArray, observatory: str) -> Received:
    """Pulses of a burst that a spacecraft receives at each frequency, those outside its band with height 0.

    The beam pattern is exp((cos(angle) - 1) / width), the angle being that between spacecraft and source as seen from
    the Sun (Musset et al. 2021, A&A 656, A34, doi:10.1051/0004-6361/202140998).

    Parameters
    ----------
    frequency_mhz : numpy.ndarray, shape (C,)
        All within reach of the density model.

    Raises
    ------
    NoDataError
        If the ephemeris does not have the spacecraft then.
    """
    frequency = np.asarray(frequency_mhz, dtype=np.float64)
    aspect = burst.aspects.get(observatory, Aspect())
    parts = [(burst.harmonic, aspect.height, 1.0, burst.directivity)]
    if burst.companion is not None:
        one = burst.companion
        parts.append((one.harmonic, one.height * aspect.companion_height, one.rise_factor, one.directivity))
    followed = [(0.0, 1.0), (burst.second_s, burst.second_height)] if burst.second_height > 0 else [(0.0, 1.0)]
    rise_s = burst.width_factor * burst.pulse.rises_s(frequency)
    decay_s = burst.width_factor * burst.pulse.decays_s(frequency)
    lag = aspect.lag * np.sin(2.0 * np.log(frequency) + aspect.lag_phase)
    columns = []
    for harmonic, height, slower, directivity in parts:
        seen = _geometry(burst, frequency, observatory, harmonic)
        wider = slower * (1.0 + 0.5 * burst.widening * seen.turned)
        peak = height * burst.contrast * _in_band(burst, frequency) * np.exp((seen.cosine - 1.0) / directivity)
        arrived = seen.arrival_s + slower * rise_s * (burst.kappa * seen.turned + lag)
        columns += [
            (arrived + later_s, share * peak, aspect.rise * wider * rise_s, aspect.decay * wider * decay_s)
            for later_s, share in followed
        ]
    return Received(*(np.stack(values, axis=1) for values in zip(*columns, strict=True)))


def _in_band(burst: SimulatedBurst, frequency_mhz: FloatArray) -> FloatArray:
    """Share of the contrast at each frequency: 0 outside the band, fading towards its ends."""
    depth = np.minimum(np.log(frequency_mhz / burst.f_low_mhz), np.log(burst.f_high_mhz / frequency_mhz))
    fade = np.sin(0.5 * np.pi * np.clip(depth / burst.taper, 0.0, 1.0)) ** 2 if burst.taper > 0 else 1.0
    return np.where(depth >= 0, fade, 0.0)


def arrival_s(burst: SimulatedBurst, frequency_mhz: FloatArray, observatory: str) -> FloatArray:
    """When the true light curve at a spacecraft has first risen to half of its maximum.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray, shape (N,)
        All within reach of the density model; outside the band of the burst, where it would have been.

    Returns
    -------
    numpy.ndarray, shape (N,)
        Seconds after the release.

    Raises
    ------
    NoDataError
        If the ephemeris does not have the spacecraft then.
    """
    what = received(burst, frequency_mhz, observatory)
    if what.arrival_s.shape[1] == 1:
        return np.asarray(what.arrival_s[:, 0])
    first = (what.arrival_s - EDGE_BEFORE * what.rise_s).min(axis=1)
    last = (what.arrival_s + EDGE_AFTER * what.rise_s).max(axis=1)
    time_s = first[:, None] + np.linspace(0.0, 1.0, EDGE_STEPS) * (last - first)[:, None]
    curve = np.zeros(time_s.shape)
    curves, count = what.curves(burst.pulse.family), what.arrival_s.shape[1]
    outside = ~(what.height > 0).any(axis=1)
    for one in range(count):
        which = np.broadcast_to((np.arange(len(time_s)) * count + one)[:, None], time_s.shape)
        height = np.where(outside, float(one == 0), what.height[:, one])
        curve += height[:, None] * curves.at(which, time_s - what.arrival_s[:, one, None])
    half = 0.5 * curve.max(axis=1)
    after = np.maximum((curve >= half[:, None]).argmax(axis=1), 1)
    row = np.arange(len(time_s))
    low, high = curve[row, after - 1], curve[row, after]
    share = np.clip((half - low) / (high - low), 0.0, 1.0)
    return np.asarray(time_s[row, after - 1] + share * (time_s[row, after] - time_s[row, after - 1]))


def contrast_at(burst: SimulatedBurst, frequency_mhz: FloatArray, observatory: str) -> FloatArray:
    """Peak over background that a spacecraft sees at each frequency, of the brightest pulse.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray, shape (N,)

    Returns
    -------
    numpy.ndarray, shape (N,)
        Zero outside the band of the burst.

    Raises
    ------
    NoDataError
        If the ephemeris does not have the spacecraft then.
    """
    frequency = np.asarray(frequency_mhz, dtype=np.float64)
    inside = (frequency >= burst.f_low_mhz) & (frequency <= burst.f_high_mhz)
    contrast = np.zeros(frequency.shape)
    if inside.any():
        contrast[inside] = received(burst, frequency[inside], observatory).height.max(axis=1)
    return contrast


def _at(burst: SimulatedBurst, seconds: FloatArray) -> Instants:
    return np.asarray(burst.release_utc.astype("datetime64[ns]") + np.rint(seconds * 1e9).astype("timedelta64[ns]"))


def true_arrivals(
    burst: SimulatedBurst, frequency_mhz: FloatArray, observatories: tuple[str, ...], sigma_s: float
) -> pd.DataFrame:
    """Arrival table of a burst without noise.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray, shape (N,)
    observatories : tuple of str
        Known to the ephemeris.
    sigma_s : float
        Timing error to state, s.

    Returns
    -------
    pandas.DataFrame
        As :func:`bella.arrivals.check_arrivals` returns it, of two or more observatories.
    """
    parts = [
        pd.DataFrame(
            {
                "observatory": name,
                "frequency_mhz": frequency_mhz,
                "arrival_utc": _at(burst, arrival_s(burst, frequency_mhz, name)),
                "sigma_s": sigma_s,
                "edge": TRUE_EDGE,
                "rise_s": burst.width_factor * burst.pulse.rises_s(frequency_mhz),
            }
        )
        for name in observatories
    ]
    return check_arrivals(pd.concat(parts, ignore_index=True), source="simulated burst", received_by=2)

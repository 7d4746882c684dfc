"""A beam that leaves the Sun along a Parker spiral, and when each spacecraft hears it at each frequency."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from bella.arrivals import check_arrivals
from bella.exceptions import InputError
from bella.heliosphere import (
    DENSITY_MODELS,
    SIDEREAL_ROTATION_D,
    beam_travel_s,
    emission_range_rsun,
    spiral_position_rsun,
)
from bella.simulation.light_curve import GAMMA_SHAPE
from bella.spacecraft import position_hee
from bella.units import C_RSUN_S, FloatArray

TRUE_EDGE = "half_rise"
"""Edge of simulated arrival times: where the light curve has risen to half of its maximum."""
LIGHT_TIME_STEPS = 2


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
        Speed of the beam along the field, in units of c.
    density : str
        A name of `bella.heliosphere.DENSITY_MODELS`.
    density_factor : float
        By how much the wind is denser than the model.
    harmonic : int
        1 or 2.
    f_low_mhz, f_high_mhz : float
        Ends of the burst, MHz.
    contrast : float
        Peak over background in power, where the burst is brightest and seen from where its source points to.
    rotation_period_d : float
    width_factor : float
        By how much rise and decay are longer than the published laws have them.
    taper : float
        Over how much of ln f the burst fades at either end of its band; 0 for sharp ends.
    directivity : float
        Width of the beam pattern; infinite for a source that is as bright from every side.
    decay_factor : float
        By how much the decay is longer still.
    gamma_shape : float
        Shape of the kernel that smears the rise; 1 is an exponential decay.
    """

    release_utc: np.datetime64
    phi0_deg: float = 30.0
    v_sw_km_s: float = 400.0
    beam_speed_c: float = 0.15
    density: str = "leblanc"
    density_factor: float = 1.0
    harmonic: int = 2
    f_low_mhz: float = 0.1
    f_high_mhz: float = 14.0
    contrast: float = 30.0
    rotation_period_d: float = SIDEREAL_ROTATION_D
    width_factor: float = 1.0
    taper: float = 0.0
    directivity: float = np.inf
    decay_factor: float = 1.0
    gamma_shape: float = GAMMA_SHAPE

    def __post_init__(self) -> None:
        if self.density not in DENSITY_MODELS:
            raise InputError(f"density model {self.density!r} is not known; choose one of {', '.join(DENSITY_MODELS)}")
        if not 0 < self.beam_speed_c < 1:
            raise InputError(f"a beam of {self.beam_speed_c:g} c is not one; give a speed between 0 and 1 c")
        for name in ("width_factor", "decay_factor", "gamma_shape"):
            if not 0 < getattr(self, name) < np.inf:
                raise InputError(f"{name} is {getattr(self, name):g}; give a number above zero")


def source_range_rsun(burst: SimulatedBurst, frequency_mhz: FloatArray) -> FloatArray:
    """Distance of the source from the Sun at each frequency.

    Parameters
    ----------
    burst : SimulatedBurst
    frequency_mhz : numpy.ndarray, shape (N,)

    Returns
    -------
    numpy.ndarray, shape (N,)
        Solar radii.

    Raises
    ------
    InputError
        If the density model does not reach a frequency.
    """
    at_factor_one = np.asarray(frequency_mhz, dtype=np.float64) / np.sqrt(burst.density_factor)
    return emission_range_rsun(at_factor_one, DENSITY_MODELS[burst.density], burst.harmonic)


def source_position_rsun(burst: SimulatedBurst, frequency_mhz: FloatArray) -> FloatArray:
    """Position of the source at each frequency.

    Parameters
    ----------
    burst : SimulatedBurst
    frequency_mhz : numpy.ndarray, shape (N,)

    Returns
    -------
    numpy.ndarray, shape (N, 3)
        HEE at the release, solar radii.
    """
    range_rsun = source_range_rsun(burst, frequency_mhz)
    return spiral_position_rsun(range_rsun, burst.phi0_deg, burst.v_sw_km_s, burst.rotation_period_d)


def arrival_s(burst: SimulatedBurst, frequency_mhz: FloatArray, observatory: str) -> FloatArray:
    """When a spacecraft hears each frequency: beam travel along the spiral, then light.

    Parameters
    ----------
    burst : SimulatedBurst
    frequency_mhz : numpy.ndarray, shape (N,)
    observatory : str

    Returns
    -------
    numpy.ndarray, shape (N,)
        Seconds after the release.

    Raises
    ------
    NoDataError
        If the ephemeris does not have the spacecraft then.
    """
    range_rsun, source = source_range_rsun(burst, frequency_mhz), source_position_rsun(burst, frequency_mhz)
    emitted = beam_travel_s(range_rsun, burst.beam_speed_c, burst.v_sw_km_s, burst.rotation_period_d)
    heard = emitted
    for _ in range(LIGHT_TIME_STEPS):  # the receiver moves while the light is under way
        receiver = position_hee(observatory, _at(burst, heard), burst.release_utc)
        heard = emitted + np.linalg.norm(source - receiver, axis=1) / C_RSUN_S
    return np.asarray(heard)


def contrast_at(burst: SimulatedBurst, frequency_mhz: FloatArray, observatory: str) -> FloatArray:
    """Peak over background that a spacecraft sees at each frequency.

    The beam pattern is exp((cos(angle) - 1) / width), the angle being that between spacecraft and source as seen from
    the Sun (Musset et al. 2021, A&A 656, A34, doi:10.1051/0004-6361/202140998).

    Parameters
    ----------
    burst : SimulatedBurst
    frequency_mhz : numpy.ndarray, shape (N,)
    observatory : str

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
    if not inside.any():
        return contrast
    depth = np.minimum(np.log(frequency[inside] / burst.f_low_mhz), np.log(burst.f_high_mhz / frequency[inside]))
    fade = np.sin(0.5 * np.pi * np.clip(depth / burst.taper, 0.0, 1.0)) ** 2 if burst.taper > 0 else 1.0
    contrast[inside] = burst.contrast * fade * _beam_pattern(burst, frequency[inside], observatory)
    return contrast


def _beam_pattern(burst: SimulatedBurst, frequency_mhz: FloatArray, observatory: str) -> FloatArray:
    if not np.isfinite(burst.directivity):
        return np.ones(frequency_mhz.shape)
    receiver = position_hee(observatory, np.array([burst.release_utc]), burst.release_utc)[0]
    source = source_position_rsun(burst, frequency_mhz)
    cosine = source @ receiver / np.linalg.norm(source, axis=1) / np.linalg.norm(receiver)
    return np.asarray(np.exp((cosine - 1.0) / burst.directivity))


def _at(burst: SimulatedBurst, seconds: FloatArray) -> npt.NDArray[np.datetime64]:
    return np.asarray(burst.release_utc.astype("datetime64[ns]") + np.rint(seconds * 1e9).astype("timedelta64[ns]"))


def true_arrivals(
    burst: SimulatedBurst, frequency_mhz: FloatArray, observatories: tuple[str, ...], sigma_s: float
) -> pd.DataFrame:
    """Arrival table of a burst without noise.

    Parameters
    ----------
    burst : SimulatedBurst
    frequency_mhz : numpy.ndarray, shape (N,)
    observatories : tuple of str
        Known to the ephemeris.
    sigma_s : float
        Timing error to state, s.

    Returns
    -------
    pandas.DataFrame
        As :func:`bella.arrivals.check_arrivals` returns it.
    """
    parts = [
        pd.DataFrame(
            {
                "observatory": name,
                "frequency_mhz": frequency_mhz,
                "arrival_utc": _at(burst, arrival_s(burst, frequency_mhz, name)),
                "sigma_s": sigma_s,
                "edge": TRUE_EDGE,
            }
        )
        for name in observatories
    ]
    return check_arrivals(pd.concat(parts, ignore_index=True), source="simulated burst")

"""SEMP: one exciter on one Parker spiral, fitted to the arrival times of all spacecraft (Zhang et al. 2019).

Sol. Phys. 294, 62, doi:10.1007/s11207-019-1448-0. The published fit searches release time, longitude and beam speed
with a swarm. For a given longitude the arrival time is linear in the release time and in the inverse of the beam
speed, so both are solved for exactly here and only the longitude is scanned: the minimum found is the global one.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from bella.exceptions import InputError
from bella.heliosphere import spiral_path_rsun, spiral_position_rsun
from bella.units import C_KM_S, DAY_S, R_SUN_KM, FloatArray, within_half_turn_deg

SEMP_ROTATION_D = 2 * np.pi / 2.662e-6 / DAY_S
"""Rotation period of the published model, days (27.32; synodic)."""

SCAN_DEG = 1.0
FEWEST_TIMES = 4

NO_BEAM = "beam_speed_not_positive"
"""The best fit has lower frequencies leave first: these times are not those of a beam on this spiral."""


@dataclass(frozen=True)
class SempTimes:
    """Arrival times of one burst, and where the model puts each frequency.

    Attributes
    ----------
    arrival_s : ndarray, shape (N,)
        Seconds after any epoch.
    range_rsun : ndarray, shape (N,)
        Distance from the Sun at which the density model emits each frequency.
    receiver_rsun : ndarray, shape (N, 3)
        Position of the spacecraft of each time, HEE.
    weight : ndarray, shape (N,)
    """

    arrival_s: FloatArray
    range_rsun: FloatArray
    receiver_rsun: FloatArray
    weight: FloatArray

    def __post_init__(self) -> None:
        rows = len(self.arrival_s)
        if rows < FEWEST_TIMES:
            raise InputError(f"{rows} arrival times do not settle three unknowns: give at least {FEWEST_TIMES}")
        columns = (self.arrival_s, self.range_rsun, self.receiver_rsun, self.weight)
        if any(len(column) != rows or not np.isfinite(column).all() for column in columns):
            raise InputError("a time, range, position or weight is missing: leave that row out")
        if not (self.weight > 0).all() or np.ptp(self.range_rsun) == 0:
            raise InputError("weights must be above 0, and the times of more than one frequency are needed")


@dataclass(frozen=True)
class SempFit:
    """Best exciter.

    Attributes
    ----------
    release_s : float
        When the exciter passes 1 solar radius, on the time axis of the input.
    phi0_deg : float
        HEE longitude of the spiral at 1 solar radius, degrees, -180 to 180.
    beam_speed_c : float
        In units of c; NaN with the flag ``beam_speed_not_positive``.
    rms_s : float
        Weighted root mean square residual, s.
    profile_phi0_deg, profile_rms_s : ndarray
        Smallest residual that any release time and speed leave at each longitude.
    flags : tuple of str
    """

    release_s: float
    phi0_deg: float
    beam_speed_c: float
    rms_s: float
    profile_phi0_deg: FloatArray
    profile_rms_s: FloatArray
    flags: tuple[str, ...]


def semp_residual_s(
    times: SempTimes,
    phi0_deg: float,
    v_sw_km_s: float,
    light_km_s: float = C_KM_S,
    rotation_period_d: float = SEMP_ROTATION_D,
) -> tuple[FloatArray, FloatArray]:
    """Residuals at a longitude, and the release time and slowness that leave the least of them.

    Parameters
    ----------
    times : SempTimes
    phi0_deg : float
        HEE longitude of the spiral at 1 solar radius, degrees.
    v_sw_km_s : float
        Solar wind speed, km/s.
    light_km_s : float
        Speed of light; the published code rounds it to 300 000 km/s.
    rotation_period_d : float
        Days.

    Returns
    -------
    residual_s : numpy.ndarray, shape (N,)
    solution : numpy.ndarray, shape (2,)
        Release at 1 solar radius, s, and inverse of the beam speed, s per solar radius.
    """
    source = spiral_position_rsun(times.range_rsun, phi0_deg, v_sw_km_s, rotation_period_d)
    light_s = np.linalg.norm(source - times.receiver_rsun, axis=1) * (R_SUN_KM / light_km_s)
    path = spiral_path_rsun(times.range_rsun, v_sw_km_s, rotation_period_d)
    design, root = np.column_stack([np.ones_like(path), path]), np.sqrt(times.weight)
    emitted_s = times.arrival_s - light_s
    solution = np.linalg.lstsq(design * root[:, None], emitted_s * root, rcond=None)[0]
    return emitted_s - design @ solution, solution


def fit_semp(
    times: SempTimes, v_sw_km_s: float, light_km_s: float = C_KM_S, rotation_period_d: float = SEMP_ROTATION_D
) -> SempFit:
    """Exciter with the least weighted square residual.

    Parameters
    ----------
    times : SempTimes
    v_sw_km_s : float
        Solar wind speed, km/s; the times hardly constrain it.
    light_km_s : float
        Speed of light, km/s.
    rotation_period_d : float
        Days.

    Returns
    -------
    SempFit

    Raises
    ------
    InputError
        If the solar wind speed is not above 0.
    """
    if not v_sw_km_s > 0:
        raise InputError(f"a solar wind of {v_sw_km_s:g} km/s is not one: give a speed above 0")

    def _rms_s(phi0_deg: float) -> float:
        residual = semp_residual_s(times, phi0_deg, v_sw_km_s, light_km_s, rotation_period_d)[0]
        return float(np.sqrt(np.average(residual**2, weights=times.weight)))

    scanned = np.arange(-180.0, 180.0, SCAN_DEG)
    profile = np.array([_rms_s(phi0) for phi0 in scanned])
    start = scanned[profile.argmin()]
    best = minimize_scalar(
        _rms_s, bounds=(start - SCAN_DEG, start + SCAN_DEG), method="bounded", options={"xatol": 1e-9}
    )
    release_s, slowness = semp_residual_s(times, best.x, v_sw_km_s, light_km_s, rotation_period_d)[1]
    speed = R_SUN_KM / slowness / light_km_s if slowness > 0 else float("nan")
    flags = () if slowness > 0 else (NO_BEAM,)
    phi0_deg = within_half_turn_deg(float(best.x))
    return SempFit(float(release_s), phi0_deg, float(speed), float(best.fun), scanned, profile, flags)

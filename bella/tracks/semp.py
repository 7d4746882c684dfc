"""SEMP: one exciter on one Parker spiral, fitted to the arrival times of all spacecraft (Zhang et al. 2019).

Sol. Phys. 294, 62, doi:10.1007/s11207-019-1448-0. The published fit searches release time, longitude and beam speed
with a swarm. For a given longitude the arrival time is linear in the release time and in the inverse of the beam
speed, so both are solved for exactly here and only the longitude is scanned: the minimum found is the global one.

It stands beside the joint fit: distances come from a density model, and the wind is assumed.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from bella.arrivals import ArrivalGrid
from bella.exceptions import InputError
from bella.flags import OPEN_PROFILE
from bella.heliosphere import DENSITY_MODELS, emission_range_rsun, spiral_path_rsun, spiral_position_rsun
from bella.records import Moment, Parameter
from bella.units import C_KM_S, DAY_S, R_SUN_KM, FloatArray, within_half_turn_deg

SEMP_ROTATION_D = 2 * np.pi / 2.662e-6 / DAY_S
"""Rotation period of the published model, days (27.32; synodic)."""

MODEL = DENSITY_MODELS["leblanc"]
DENSER = 2.0
"""By how much the wind is denser than the model in the published fits."""

ASSUMED_WIND_KM_S = 400.0
"""Middle of the winds 300 to 600 km/s of the published fits; it changes the longitude of 2019-04-09 by 1 degree."""

UNKNOWNS, FEWEST_TIMES = 3, 4
"""Release, longitude and speed; and fewest times that settle them with one to spare."""

GROWTH = (1.0, 3.841)
"""Growth of chi-squared within which one parameter lies with a probability of 68 and of 95 per cent."""

SCAN_DEG, PROFILE_STEP_DEG, SLOPE_STEP_DEG = 1.0, 1.0, 0.05
"""Steps in longitude: of the search, of the ends of an interval, and of a derivative."""

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
    weight : ndarray, shape (N,) or (N, N)
        Inverse squares of the timing errors, or the inverse of their covariance.
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
        if not (self.own_weight > 0).all() or np.ptp(self.range_rsun) == 0:
            raise InputError("weights must be above 0, and the times of more than one frequency are needed")

    @property
    def own_weight(self) -> FloatArray:
        """Weight of each time, shape (N,)."""
        return self.weight if self.weight.ndim == 1 else np.diag(self.weight)

    @cached_property
    def _root(self) -> FloatArray:
        return np.asarray(np.linalg.cholesky(self.weight).T)

    def whitened(self, values: FloatArray) -> FloatArray:
        """Values per time, shape (N, ...), in units of independent errors."""
        if self.weight.ndim == 2:
            return np.asarray(self._root @ values)
        return np.asarray(np.sqrt(self.weight).reshape(-1, *[1] * (values.ndim - 1)) * values)

    def chi2(self, residual_s: FloatArray) -> FloatArray:
        """Misfit of residuals of shape (..., N), shape (...)."""
        return np.asarray((self.whitened(residual_s.T) ** 2).sum(axis=0))


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
    """

    release_s: float
    phi0_deg: float
    beam_speed_c: float
    rms_s: float
    chi2: float
    flags: tuple[str, ...]


def semp_residual_s(
    times: SempTimes,
    phi0_deg: float | FloatArray,
    v_sw_km_s: float,
    light_km_s: float = C_KM_S,
    rotation_period_d: float = SEMP_ROTATION_D,
) -> tuple[FloatArray, FloatArray]:
    """Residuals at longitudes, and the release time and slowness that leave the least of them.

    Parameters
    ----------
    phi0_deg : float or numpy.ndarray, shape (L,)
        HEE longitude of the spiral at 1 solar radius, degrees.
    v_sw_km_s : float
        Solar wind speed, km/s.
    light_km_s : float
        Speed of light; the published code rounds it to 300 000 km/s.
    rotation_period_d : float
        Days.

    Returns
    -------
    residual_s : numpy.ndarray, shape (N,) or (L, N)
    solution : numpy.ndarray, shape (2,) or (L, 2)
        Release at 1 solar radius, s, and inverse of the beam speed, s per solar radius.
    """
    longitude_deg = np.asarray(phi0_deg, dtype=np.float64)[..., None]
    source = spiral_position_rsun(times.range_rsun, longitude_deg, v_sw_km_s, rotation_period_d)
    light_s = np.linalg.norm(source - times.receiver_rsun, axis=-1) * (R_SUN_KM / light_km_s)
    path = spiral_path_rsun(times.range_rsun, v_sw_km_s, rotation_period_d)
    design = np.column_stack([np.ones_like(path), path])
    emitted_s = times.arrival_s - light_s
    solution = np.linalg.lstsq(times.whitened(design), times.whitened(emitted_s.T), rcond=None)[0].T
    return np.asarray(emitted_s - solution @ design.T), np.asarray(solution, dtype=np.float64)


def fit_semp(
    times: SempTimes, v_sw_km_s: float, light_km_s: float = C_KM_S, rotation_period_d: float = SEMP_ROTATION_D
) -> SempFit:
    """Exciter with the least weighted square residual.

    Parameters
    ----------
    v_sw_km_s : float
        Solar wind speed, km/s; the times hardly constrain it.
    light_km_s : float
        Speed of light, km/s.
    rotation_period_d : float
        Days.

    Raises
    ------
    InputError
        If the solar wind speed is not above 0.
    """
    if not v_sw_km_s > 0:
        raise InputError(f"a solar wind of {v_sw_km_s:g} km/s is not one: give a speed above 0")
    total = times.own_weight.sum()

    def _cost_s(phi0_deg: float | FloatArray) -> FloatArray:
        residual_s = semp_residual_s(times, phi0_deg, v_sw_km_s, light_km_s, rotation_period_d)[0]
        return np.asarray(np.sqrt(times.chi2(residual_s) / total))

    scanned = np.arange(-180.0, 180.0, SCAN_DEG)
    start = float(scanned[_cost_s(scanned).argmin()])
    best = minimize_scalar(
        lambda phi0_deg: float(_cost_s(phi0_deg)),
        bounds=(start - SCAN_DEG, start + SCAN_DEG),
        method="bounded",
        options={"xatol": 1e-9},
    )
    residual_s, (release_s, slowness) = semp_residual_s(times, best.x, v_sw_km_s, light_km_s, rotation_period_d)
    return SempFit(
        release_s=float(release_s),
        phi0_deg=within_half_turn_deg(float(best.x)),
        beam_speed_c=float(R_SUN_KM / slowness / light_km_s) if slowness > 0 else math.nan,
        rms_s=float(np.sqrt(np.average(residual_s**2, weights=times.own_weight))),
        chi2=float(times.chi2(residual_s)),
        flags=() if slowness > 0 else (NO_BEAM,),
    )


def semp_companion(grid: ArrivalGrid, v_sw_km_s: float = ASSUMED_WIND_KM_S) -> dict[str, Any]:
    """SEMP fit to the arrival times of a burst (Zhang et al. 2019, doi:10.1007/s11207-019-1448-0).

    Parameters
    ----------
    v_sw_km_s : float
        Speed of the wind, which the fit assumes, km/s.

    Returns
    -------
    dict
        Ready for JSON: longitude with the intervals of its profile (its sd is half of the 68 per cent one), release
        time and beam speed with errors to first order, residual, model and flags. All errors grow with the misfit,
        where that is larger than they explain.

    Raises
    ------
    InputError
        If there are fewer than four arrival times, or one frequency only.
    """
    times = semp_times(grid)
    fit = fit_semp(times, v_sw_km_s)
    scale = max(1.0, fit.chi2 / max(len(times.arrival_s) - UNKNOWNS, 1))
    within, almost = (profile_interval_deg(times, fit, v_sw_km_s, scale * growth) for growth in GROWTH)
    low, high = within or (None, None)
    lowest, highest = almost or (None, None)
    phi0_sd = None if low is None or high is None else 0.5 * (high - low)
    phi0 = Parameter(mean=fit.phi0_deg, q50=fit.phi0_deg, sd=phi0_sd, q2_5=lowest, q16=low, q84=high, q97_5=highest)
    release_sd, beam_sd = _standard_errors(times, fit, v_sw_km_s, scale, phi0_sd or 0.0)
    return {
        "model": f"one beam, distances by {MODEL.name} x {DENSER:g}, fundamental, wind {v_sw_km_s:g} km/s assumed",
        "phi0_deg": phi0.model_dump(),
        "beam_speed_c": Parameter.gaussian(fit.beam_speed_c, beam_sd).model_dump(),
        "release_utc": Moment.after(grid.reference_utc, Parameter.gaussian(fit.release_s, release_sd)).model_dump(),
        "v_sw_km_s": v_sw_km_s,
        "rms_s": fit.rms_s,
        "error_scale": math.sqrt(scale),
        "points": len(times.arrival_s),
        "rotation_period_d": SEMP_ROTATION_D,
        "flags": [*fit.flags, *([OPEN_PROFILE] if almost is None else [])],
    }


def semp_times(grid: ArrivalGrid) -> SempTimes:
    """Arrival times of a burst in the form that SEMP takes, with the covariance of their errors.

    Raises
    ------
    InputError
        If there are fewer than four arrival times, one frequency only, or errors of 0.
    """
    row, column = np.nonzero(np.isfinite(grid.arrival_s))
    try:
        weight = np.asarray(np.linalg.inv(grid.covariance_s2()), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise InputError("arrival times have errors of 0: give each an error above 0") from error
    return SempTimes(
        (grid.arrival_s - grid.delay_s)[row, column],
        emission_range_rsun(grid.frequency_mhz / math.sqrt(DENSER), MODEL)[row],
        grid.receiver_rsun[row, column],
        weight,
    )


def profile_interval_deg(times: SempTimes, fit: SempFit, v_sw_km_s: float, growth: float) -> tuple[float, float] | None:
    """Longitudes between which the least chi-squared of any release and speed stays within `growth` of its minimum.

    Returns
    -------
    tuple of float or None
        Degrees, about the best longitude; None where half a turn to a side does not reach that growth.
    """

    def _above(apart_deg: float | FloatArray) -> FloatArray:
        residual_s = semp_residual_s(times, fit.phi0_deg + apart_deg, v_sw_km_s)[0]
        return times.chi2(residual_s) - fit.chi2 - growth

    apart_deg = np.arange(PROFILE_STEP_DEG, 180.0, PROFILE_STEP_DEG)
    ends = []
    for side in (-1.0, 1.0):
        beyond = np.flatnonzero(_above(side * apart_deg) > 0)
        if not beyond.size:
            return None
        end = side * apart_deg[beyond[0]]
        ends.append(fit.phi0_deg + brentq(lambda apart: float(_above(apart)), end - side * PROFILE_STEP_DEG, end))
    return ends[0], ends[1]


def _standard_errors(
    times: SempTimes, fit: SempFit, v_sw_km_s: float, scale: float, phi0_sd_deg: float
) -> tuple[float, float]:
    """Errors of release time (s) and beam speed (c), to first order, that of the longitude included."""
    ahead, behind = (semp_residual_s(times, fit.phi0_deg + d, v_sw_km_s)[1] for d in (SLOPE_STEP_DEG, -SLOPE_STEP_DEG))
    drift = (ahead - behind) / (2 * SLOPE_STEP_DEG)
    path = spiral_path_rsun(times.range_rsun, v_sw_km_s, SEMP_ROTATION_D)
    design = times.whitened(np.column_stack([np.ones_like(path), path]))
    conditional = scale * np.linalg.inv(design.T @ design)
    release_sd, slowness_sd = np.sqrt(np.diag(conditional) + (drift * phi0_sd_deg) ** 2)
    return float(release_sd), fit.beam_speed_c**2 * C_KM_S / R_SUN_KM * float(slowness_sd)

"""The two-step fit of the paper: first a position per frequency, then a Parker spiral through the positions.

In polar coordinates the spiral is a line, r = (v_sw / Omega) (phi0 - phi) + r0 with phi positive to the west (Canizares
et al. 2024, A&A 684, A182, doi:10.1051/0004-6361/202347747; there without the sign). It is kept for comparison: its
formal errors take the positions as independent, which positions on a smooth t(f) are not.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
import xarray as xr

from bella.exceptions import GeometryError
from bella.heliosphere.parker import (
    PAPER_FIGURES_ROTATION_D,
    SIDEREAL_ROTATION_D,
    SPIRAL_ORIGIN_RSUN,
    angular_speed_rad_s,
)
from bella.units import R_SUN_KM, FloatArray, within_half_turn_deg

MIN_POINTS = 3
STRAIGHT_DEG_PER_RSUN = 1e-6
"""A slope below this is a radial track: it stands for a wind faster than light."""
QUANTILES = {"q2_5": 0.025, "q16": 0.16, "q50": 0.5, "q84": 0.84, "q97_5": 0.975}


@dataclass(frozen=True)
class SpiralLine:
    """A Parker spiral as a line of longitude on distance.

    Attributes
    ----------
    phi0_deg, phi0_sd_deg : float
        HEE longitude at 1 solar radius, in (-180, 180], and its formal error, degrees.
    v_sw_km_s, v_sw_sd_km_s : float
        Apparent solar wind speed and its formal error, km/s; negative where the longitude grows with distance.
    slope_deg_per_rsun, slope_sd_deg_per_rsun : float
        Slope of longitude on distance, degrees per solar radius.
    rms_deg : float
        Scatter of the longitudes about the line, degrees.
    points : int
    rotation_period_d : float
        Rotation period that turned the slope into a speed, days.
    """

    phi0_deg: float
    phi0_sd_deg: float
    v_sw_km_s: float
    v_sw_sd_km_s: float
    slope_deg_per_rsun: float
    slope_sd_deg_per_rsun: float
    rms_deg: float
    points: int
    rotation_period_d: float

    @property
    def flags(self) -> tuple[str, ...]:
        """Names of `bella.flags.TRACK_FLAGS` that apply to the line."""
        if math.isnan(self.slope_deg_per_rsun):
            return ("too_few_positions",)
        bends = -self.slope_deg_per_rsun > max(2 * self.slope_sd_deg_per_rsun, STRAIGHT_DEG_PER_RSUN)
        return ("formal_errors",) if bends else ("formal_errors", "not_a_spiral")


def fit_spiral_line(range_rsun: FloatArray, longitude_deg: FloatArray, rotation_period_d: float) -> SpiralLine:
    """Fit a Parker spiral through positions, each of the same weight.

    The longitude is regressed on the distance: the distances span a far wider range than their errors, the longitudes
    do not, and a regression the other way round is biased to low speeds by exactly that.

    Parameters
    ----------
    range_rsun : ndarray, shape (F,)
        Heliocentric distances, solar radii.
    longitude_deg : ndarray, shape (F,)
        HEE longitudes, degrees, any winding.
    rotation_period_d : float
        Rotation period of the Sun, days; the speed is inversely proportional to it.

    Returns
    -------
    SpiralLine

    Raises
    ------
    GeometryError
        If there are fewer than three positions, or all are at one distance.
    """
    if range_rsun.size < MIN_POINTS or not np.ptp(range_rsun) > 1e-6 * range_rsun.max():
        raise GeometryError(
            f"a spiral needs {MIN_POINTS} positions at different distances, not {range_rsun.size} over "
            f"{np.ptp(range_rsun) if range_rsun.size else 0:.3g} solar radii; add frequencies"
        )
    order = np.argsort(range_rsun)
    height = range_rsun[order] - SPIRAL_ORIGIN_RSUN
    longitude = np.unwrap(longitude_deg[order], period=360.0)
    design = np.stack([np.ones_like(height), height], axis=1)
    (phi0, slope), *_ = np.linalg.lstsq(design, longitude, rcond=None)
    residual = longitude - design @ np.array([phi0, slope])
    variance = float(residual @ residual) / max(height.size - 2, 1)
    phi0_sd, slope_sd = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))
    speed = spiral_speed_km_s(float(slope), rotation_period_d)
    return SpiralLine(
        phi0_deg=within_half_turn_deg(float(phi0)),
        phi0_sd_deg=float(phi0_sd),
        v_sw_km_s=speed,
        v_sw_sd_km_s=abs(speed) * float(slope_sd) / max(abs(float(slope)), 1e-12),
        slope_deg_per_rsun=float(slope),
        slope_sd_deg_per_rsun=float(slope_sd),
        rms_deg=math.sqrt(variance),
        points=height.size,
        rotation_period_d=rotation_period_d,
    )


def spiral_speed_km_s(slope_deg_per_rsun: float, rotation_period_d: float) -> float:
    """Solar wind speed of a slope of longitude on distance: v_sw = -Omega dr/dphi.

    Parameters
    ----------
    slope_deg_per_rsun : float
        Degrees per solar radius.
    rotation_period_d : float
        Rotation period of the Sun, days.

    Returns
    -------
    float
        km/s; infinite for a radial track, negative for one that bends forward.
    """
    slope_rad_per_km = math.radians(slope_deg_per_rsun) / R_SUN_KM
    return -angular_speed_rad_s(rotation_period_d) / slope_rad_per_km if slope_rad_per_km else math.inf


def track_fit(
    posterior: xr.Dataset,
    *,
    rotation_period_d: float = PAPER_FIGURES_ROTATION_D,
    other_rotations_d: tuple[float, ...] = (SIDEREAL_ROTATION_D,),
) -> dict[str, Any]:
    """Two-step fit of a solution, as it is stored and served.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.
    rotation_period_d : float
        Rotation period of the Sun, days.
    other_rotations_d : tuple of float
        Further rotation periods to give the result for.

    Returns
    -------
    dict
        Ready for JSON: frame, rotation period, and the fit with mean, sd and quantiles of each parameter; all None,
        with a flag, where the positions do not allow a fit.
    """
    x, y = posterior["x_rsun"].to_numpy(), posterior["y_rsun"].to_numpy()
    range_rsun, longitude_deg = np.hypot(x, y), np.degrees(np.arctan2(y, x))

    def _fitted(period_d: float) -> dict[str, Any]:
        try:
            line = fit_spiral_line(range_rsun, longitude_deg, period_d)
        except GeometryError:
            nan = math.nan
            line = SpiralLine(nan, nan, nan, nan, nan, nan, nan, range_rsun.size, period_d)
        return _as_json(line)

    return {
        "frame": posterior.attrs["frame"],
        "rotation_period_d": rotation_period_d,
        "two_step": _fitted(rotation_period_d),
        "two_step_other_rotations": {f"{period_d:g}": _fitted(period_d) for period_d in other_rotations_d},
    }


def _as_json(line: SpiralLine) -> dict[str, Any]:
    return {
        "model": "longitude on distance, unweighted line through posterior means",
        "phi0_deg": gaussian_parameter(line.phi0_deg, line.phi0_sd_deg),
        "v_sw_km_s": gaussian_parameter(line.v_sw_km_s, line.v_sw_sd_km_s),
        "slope_deg_per_rsun": gaussian_parameter(line.slope_deg_per_rsun, line.slope_sd_deg_per_rsun),
        "r0_rsun": SPIRAL_ORIGIN_RSUN,
        "rms_deg": line.rms_deg if math.isfinite(line.rms_deg) else None,
        "points": line.points,
        "rotation_period_d": line.rotation_period_d,
        "flags": list(line.flags),
    }


def gaussian_parameter(mean: float, sd: float) -> Mapping[str, float | None]:
    """Mean, formal error and the quantiles of the Gaussian they stand for.

    Parameters
    ----------
    mean, sd : float

    Returns
    -------
    mapping of str to float or None
        All None where mean or sd is not finite.
    """
    if not (math.isfinite(mean) and math.isfinite(sd)):
        return dict.fromkeys(("mean", "sd", *QUANTILES))
    normal = NormalDist()
    return {"mean": mean, "sd": sd} | {name: mean + sd * normal.inv_cdf(p) for name, p in QUANTILES.items()}

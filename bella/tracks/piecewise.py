"""The spiral and the broken spiral of the paper, through positions whose errors are known in both directions.

In polar coordinates a spiral is a line, and a wind that changes speed with distance is a broken one (Canizares et al.
2024, A&A 684, A182, doi:10.1051/0004-6361/202347747). Distance and longitude of a position share the errors of its x
and y, so both fits are the best lines of York et al. 2004; how many knots a broken line has is left to the Bayesian
information criterion. Errors remain formal: they take positions of different frequencies as independent.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from bella.exceptions import GeometryError
from bella.heliosphere import PAPER_FIGURES_ROTATION_D, SIDEREAL_ROTATION_D
from bella.heliosphere.parker import SPIRAL_ORIGIN_RSUN
from bella.heliosphere.polar import has_longitude, polar_covariance
from bella.tracks.errors_in_both import BrokenLine, Points, fit_broken_line
from bella.tracks.two_step import MIN_POINTS, STRAIGHT_DEG_PER_RSUN, gaussian_parameter, spiral_speed_km_s
from bella.units import FloatArray, within_half_turn_deg

MOST_KNOTS = 3


@dataclass(frozen=True)
class SpiralSegment:
    """A part of a track with one solar wind speed.

    Attributes
    ----------
    from_rsun, to_rsun : float
        Distances it spans, solar radii.
    slope_deg_per_rsun, slope_sd_deg_per_rsun : float
        Slope of longitude on distance and its formal error, degrees per solar radius.
    v_sw_km_s, v_sw_sd_km_s : float
        Apparent solar wind speed, -Omega / slope, and its formal error; negative where the longitude grows.
    """

    from_rsun: float
    to_rsun: float
    slope_deg_per_rsun: float
    slope_sd_deg_per_rsun: float
    v_sw_km_s: float
    v_sw_sd_km_s: float

    @property
    def flags(self) -> tuple[str, ...]:
        """Names of `bella.flags.TRACK_FLAGS` that apply to the segment."""
        bends = -self.slope_deg_per_rsun > max(2 * self.slope_sd_deg_per_rsun, STRAIGHT_DEG_PER_RSUN)
        return ("formal_errors",) if bends else ("formal_errors", "not_a_spiral")


@dataclass(frozen=True)
class PiecewiseSpiral:
    """A track as spirals of one or several speeds, joined at knots.

    Attributes
    ----------
    phi0_deg, phi0_sd_deg : float
        HEE longitude of the innermost spiral at 1 solar radius, in (-180, 180], and its formal error, degrees.
    segments : tuple of SpiralSegment
        Outward.
    chi2 : float
        Sum of the squared distances of the positions from the line, each in the metric of its covariance.
    bic : tuple of float
        Bayesian information criterion with 0, 1, ... knots; infinite where there are too few positions for so many.
    points, masked : int
        Positions that were fitted, and those left out as too near to the Sun.
    rotation_period_d : float
        Rotation period that turned slopes into speeds, days.
    """

    phi0_deg: float
    phi0_sd_deg: float
    segments: tuple[SpiralSegment, ...]
    chi2: float
    bic: tuple[float, ...]
    points: int
    masked: int
    rotation_period_d: float

    @property
    def knots_rsun(self) -> tuple[float, ...]:
        """Distances at which the speed changes, solar radii."""
        return tuple(segment.from_rsun for segment in self.segments[1:])


def polar_points(position_rsun: FloatArray, covariance_rsun2: FloatArray) -> Points:
    """Distance and longitude of positions with the covariance of the two, in ascending distance and without jumps.

    Parameters
    ----------
    position_rsun : numpy.ndarray, shape (N, 2)
        HEE x and y, solar radii.
    covariance_rsun2 : numpy.ndarray, shape (N, 2, 2)
        Of x and y.

    Returns
    -------
    Points
        x is the distance in solar radii, y the longitude in degrees; covariances to first order, without positions
        nearer to the Sun than three of their errors, or not finite.

    Raises
    ------
    InputError
        If a covariance is not positive definite.
    """
    finite = np.isfinite(position_rsun).all(axis=1) & np.isfinite(covariance_rsun2).all(axis=(1, 2))
    place, covariance = polar_covariance(position_rsun[finite], covariance_rsun2[finite])
    far = np.flatnonzero(has_longitude(place[:, 0], covariance[:, 0, 0]))
    kept = far[np.argsort(place[far, 0], kind="stable")]
    return Points(place[kept, 0], np.unwrap(place[kept, 1], period=360.0), covariance[kept])


def fit_piecewise_spiral(
    position_rsun: FloatArray,
    covariance_rsun2: FloatArray,
    most_knots: int = MOST_KNOTS,
    rotation_period_d: float = SIDEREAL_ROTATION_D,
) -> PiecewiseSpiral:
    """Fit spirals of as many speeds as the positions ask for.

    Parameters
    ----------
    position_rsun : numpy.ndarray, shape (N, 2)
        HEE x and y, solar radii.
    covariance_rsun2 : numpy.ndarray, shape (N, 2, 2)
        Of x and y.
    most_knots : int
        0 for one spiral through all positions.
    rotation_period_d : float
        Rotation period of the Sun, days.

    Returns
    -------
    PiecewiseSpiral

    Raises
    ------
    GeometryError
        If fewer than three positions are far enough from the Sun, or all are at one distance within their errors.
    InputError
        If a covariance is not positive definite.
    """
    points = polar_points(position_rsun, covariance_rsun2)
    _check_spread(points)
    lines = [fit_broken_line(points, knots, SPIRAL_ORIGIN_RSUN) for knots in range(most_knots + 1)]
    bic = tuple(math.inf if line is None else line.bic for line in lines)
    best = min((line for line in lines if line is not None), key=lambda line: line.bic)
    return PiecewiseSpiral(
        phi0_deg=within_half_turn_deg(best.value),
        phi0_sd_deg=best.value_sd,
        segments=_segments(points, best, rotation_period_d),
        chi2=best.chi2,
        bic=bic,
        points=points.x.size,
        masked=len(position_rsun) - points.x.size,
        rotation_period_d=rotation_period_d,
    )


def _check_spread(points: Points) -> None:
    """Without a span of distances wider than their errors any slope would do."""
    span = float(np.ptp(points.x)) if points.x.size else 0.0
    error = float(np.sqrt(np.median(points.covariance[:, 0, 0]))) if points.x.size else 0.0
    if points.x.size < MIN_POINTS or not span > 2.0 * error:
        raise GeometryError(
            f"a spiral needs {MIN_POINTS} positions at different distances, not {points.x.size} over {span:.3g} solar "
            f"radii with errors of {error:.3g}; add frequencies"
        )


def _segments(points: Points, line: BrokenLine, rotation_period_d: float) -> tuple[SpiralSegment, ...]:
    edges = np.concatenate([points.x[:1], line.knot, points.x[-1:]])
    segments = []
    for index, (slope, sd) in enumerate(zip(line.slope, line.slope_sd, strict=True)):
        speed = spiral_speed_km_s(float(slope), rotation_period_d)
        speed_sd = abs(speed) * float(sd) / max(abs(float(slope)), 1e-12)
        segments.append(
            SpiralSegment(float(edges[index]), float(edges[index + 1]), float(slope), float(sd), speed, speed_sd)
        )
    return tuple(segments)


def piecewise_fit(
    posterior: xr.Dataset, *, most_knots: int = MOST_KNOTS, rotation_period_d: float = PAPER_FIGURES_ROTATION_D
) -> dict[str, Any]:
    """Weighted spiral and broken spiral of a solution, as they are stored and served.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.
    most_knots : int
    rotation_period_d : float
        Rotation period of the Sun, days.

    Returns
    -------
    dict
        Ready for JSON: ``weighted`` and ``piecewise``; without parameters, but with a flag, where there is no fit.
    """
    position = np.stack([posterior["x_rsun"].to_numpy(), posterior["y_rsun"].to_numpy()], axis=-1)
    xx, xy, yy = (posterior[f"cov_{pair}_rsun2"].to_numpy() for pair in ("xx", "xy", "yy"))
    covariance = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    try:
        spiral = fit_piecewise_spiral(position, covariance, most_knots, rotation_period_d)
        straight = fit_piecewise_spiral(position, covariance, 0, rotation_period_d)
    except GeometryError:
        nothing = {"flags": ["too_few_positions"], "points": len(position)}
        return {"weighted": nothing, "piecewise": nothing | {"segments": []}}
    weighted = _as_json(straight)
    return {"weighted": weighted | weighted.pop("segments")[0], "piecewise": _as_json(spiral)}


def _as_json(spiral: PiecewiseSpiral) -> dict[str, Any]:
    knots, most = len(spiral.knots_rsun), len(spiral.bic) - 1
    return {
        "model": f"longitude on distance, errors in both, {knots} knots of at most {most}",
        "phi0_deg": gaussian_parameter(spiral.phi0_deg, spiral.phi0_sd_deg),
        "r0_rsun": SPIRAL_ORIGIN_RSUN,
        "segments": [_segment_as_json(segment) for segment in spiral.segments],
        "chi2": spiral.chi2,
        "bic": [value if math.isfinite(value) else None for value in spiral.bic],
        "points": spiral.points,
        "masked": spiral.masked,
        "rotation_period_d": spiral.rotation_period_d,
        "flags": sorted({flag for segment in spiral.segments for flag in segment.flags}),
    }


def _segment_as_json(segment: SpiralSegment) -> dict[str, Any]:
    return {
        "from_rsun": segment.from_rsun,
        "to_rsun": segment.to_rsun,
        "v_sw_km_s": gaussian_parameter(segment.v_sw_km_s, segment.v_sw_sd_km_s),
        "slope_deg_per_rsun": gaussian_parameter(segment.slope_deg_per_rsun, segment.slope_sd_deg_per_rsun),
        "flags": list(segment.flags),
    }

"""Parker spirals through positions: the line of the paper, and lines with errors in both coordinates.

In polar coordinates a spiral is a line, r = (v_sw / Omega) (phi0 - phi) + r0 with phi positive to the west, and a wind
that changes speed with distance is a broken one (Canizares et al. 2024, A&A 684, A182, doi:10.1051/0004-6361/202347747;
there without the sign). Distance and longitude of a position share the errors of its x and y, so the best line is that
of York et al. 2004, Am. J. Phys. 72, 367, doi:10.1119/1.1632486: the sum of the squared distances, each in the metric
of its point's covariance, is least. The line of the paper is the same fit where every longitude has the same error.

All errors are formal: they take positions of different frequencies as independent, which positions on a smooth t(f) are
not. So these fits stand beside the joint fit for comparison.
"""

import math
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import xarray as xr
from scipy.optimize import least_squares

from bella.exceptions import GeometryError, InputError
from bella.heliosphere import PAPER_FIGURES_ROTATION_D, SIDEREAL_ROTATION_D, angular_speed_rad_s
from bella.heliosphere.parker import SPIRAL_ORIGIN_RSUN
from bella.heliosphere.polar import has_longitude, planar_positions, polar_covariance
from bella.records import QUANTILES, Parameter, finite
from bella.units import R_SUN_KM, FloatArray, within_half_turn_deg

MIN_POINTS = 3
"""Positions of a spiral, and of each part of a broken one: two lie on any line."""

MOST_KNOTS = 3
"""Knots of a broken spiral at most: the paper has one."""

BENDS_SIGMAS = 2.0
"""A track is a spiral where its longitude falls with distance by so many errors of the slope: 98 % of a Gaussian."""

STRAIGHT_DEG_PER_RSUN = 1e-6
"""A slope below this is a radial track: it stands for a wind faster than light."""

SPAN_SIGMAS = 2.0
"""Distances have to span so many of their own errors; any slope would do otherwise."""

EXACT_RSUN = 1e-6
"""Error of the distances in the line of the paper, which has none; a covariance needs one above 0."""

CANDIDATES, REFINED = 12, 2
"""Distances at which knots are tried before they move freely, and how many of the best placements then do."""

TOLERANCE, EVALUATIONS = 1e-10, 200


@dataclass(frozen=True)
class Points:
    """Points with correlated errors.

    Attributes
    ----------
    x, y : ndarray, shape (N,)
        Ascending in x.
    covariance : ndarray, shape (N, 2, 2)
        Of x and y.
    """

    x: FloatArray
    y: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        if self.y.shape != self.x.shape or self.covariance.shape != (self.x.size, 2, 2):
            raise InputError(
                f"{self.x.size} points need as many values and 2 x 2 covariances: leave out what lacks them"
            )
        with np.errstate(invalid="ignore"):
            positive = (self.covariance[:, 0, 0] > 0) & (np.linalg.det(self.covariance) > 0)
        if not (positive.all() and np.isfinite(self.x).all() and np.isfinite(self.y).all()):
            raise InputError("a point is missing or its covariance is not positive definite: leave that point out")

    def variance_about(self, slope: FloatArray) -> FloatArray:
        """Variance of y - slope x, for slopes that broadcast to (..., N)."""
        xx, xy, yy = self.covariance[:, 0, 0], self.covariance[:, 0, 1], self.covariance[:, 1, 1]
        return np.asarray(yy - 2 * slope * xy + slope**2 * xx)


@dataclass(frozen=True)
class BrokenLine:
    """A continuous line, straight between knots.

    Attributes
    ----------
    value, value_sd : float
        Of the first segment, continued to the origin that was asked for.
    slope, slope_sd : ndarray, shape (K + 1,)
        Of each segment.
    chi2 : float
        Sum of the squared distances.
    """

    value: float
    value_sd: float
    slope: FloatArray
    slope_sd: FloatArray
    knot: FloatArray
    chi2: float
    points: int

    @property
    def bic(self) -> float:
        """Bayesian information criterion (Schwarz 1978, Ann. Stat. 6, 461, doi:10.1214/aos/1176344136)."""
        parameters = 2 + 2 * self.knot.size
        return self.chi2 + parameters * float(np.log(self.points))


@dataclass(frozen=True)
class Segment:
    """A part of a track with one speed of the wind.

    Attributes
    ----------
    from_rsun, to_rsun : float
        Distances it spans.
    slope_deg_per_rsun, slope_sd_deg_per_rsun : float
        Slope of longitude on distance, and its formal error.
    """

    from_rsun: float
    to_rsun: float
    slope_deg_per_rsun: float
    slope_sd_deg_per_rsun: float

    @property
    def bends(self) -> bool:
        """Whether the longitude falls with distance by more than its error allows."""
        least = max(BENDS_SIGMAS * self.slope_sd_deg_per_rsun, STRAIGHT_DEG_PER_RSUN)
        return -self.slope_deg_per_rsun > least

    @property
    def flags(self) -> tuple[str, ...]:
        """Names of `bella.flags.TRACK_FLAGS` that apply to the segment."""
        return ("formal_errors",) if self.bends else ("formal_errors", "not_a_spiral")

    @property
    def slope(self) -> Parameter:
        """Slope of longitude on distance, degrees per solar radius."""
        return Parameter.gaussian(self.slope_deg_per_rsun, self.slope_sd_deg_per_rsun)

    def v_sw_km_s(self, rotation_period_d: float) -> Parameter:
        """Apparent speed of the wind, v_sw = -Omega dr/dphi; empty where the longitude does not fall with distance.

        Parameters
        ----------
        rotation_period_d : float
            Rotation period of the Sun, days; the speed is inversely proportional to it.

        Returns
        -------
        Parameter
            km/s. The quantiles are those of the slope; mean and sd are to first order.
        """
        if not self.bends:
            return Parameter()
        turn_km_s = math.degrees(angular_speed_rad_s(rotation_period_d)) * R_SUN_KM
        slope = self.slope.model_dump(exclude_none=True)
        speed = -turn_km_s / self.slope_deg_per_rsun
        sd = speed * self.slope_sd_deg_per_rsun / abs(self.slope_deg_per_rsun)
        return Parameter(mean=speed, sd=sd, **{name: -turn_km_s / slope[name] for name in QUANTILES})


@dataclass(frozen=True)
class Spiral:
    """A track as spirals of one or several speeds, joined at knots.

    Attributes
    ----------
    phi0_deg, phi0_sd_deg : float
        HEE longitude of the innermost spiral at 1 solar radius, in (-180, 180], and its formal error.
    segments : tuple of Segment
        Outward.
    chi2 : float
        Sum of the squared distances of the positions from the line; of residuals in degrees without covariances.
    bic : tuple of float
        Bayesian information criterion with 0, 1, ... knots; infinite where there are too few positions for so many.
    points, masked : int
        Positions that were fitted, and those left out: not finite, or too near to the Sun.
    """

    phi0_deg: float
    phi0_sd_deg: float
    segments: tuple[Segment, ...]
    chi2: float
    bic: tuple[float, ...]
    points: int
    masked: int

    @property
    def phi0(self) -> Parameter:
        """Longitude at 1 solar radius, degrees."""
        return Parameter.gaussian(self.phi0_deg, self.phi0_sd_deg)

    @property
    def knots_rsun(self) -> tuple[float, ...]:
        """Distances at which the speed changes."""
        return tuple(segment.from_rsun for segment in self.segments[1:])

    @property
    def rms_deg(self) -> float:
        """Scatter of the longitudes about a line that was fitted without covariances, per degree of freedom."""
        return math.sqrt(self.chi2 / max(self.points - 2, 1))


def polar_points(position_rsun: FloatArray, covariance_rsun2: FloatArray | None = None) -> Points:
    """Distance and longitude of positions with the covariance of the two, in ascending distance and without jumps.

    Parameters
    ----------
    position_rsun : numpy.ndarray, shape (N, 2)
        HEE x and y.
    covariance_rsun2 : numpy.ndarray, shape (N, 2, 2), optional
        Of x and y; without it the longitudes have errors of 1 degree and the distances none.

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
    alike = np.broadcast_to(np.diag([EXACT_RSUN**2, 1.0]), (len(position_rsun), 2, 2))
    given = alike if covariance_rsun2 is None else covariance_rsun2
    finite = np.isfinite(position_rsun).all(axis=1) & np.isfinite(given).all(axis=(1, 2))
    place, covariance = polar_covariance(position_rsun[finite], given[finite])
    if covariance_rsun2 is None:
        covariance = given[finite]
    far = np.flatnonzero(has_longitude(place[:, 0], covariance[:, 0, 0]))
    kept = far[np.argsort(place[far, 0], kind="stable")]
    return Points(place[kept, 0], np.unwrap(place[kept, 1], period=360.0), covariance[kept])


def fit_spiral(position_rsun: FloatArray, covariance_rsun2: FloatArray | None = None, most_knots: int = 0) -> Spiral:
    """Fit spirals of as many speeds as the positions ask for.

    Longitudes are fitted against distances: the distances span far more than their errors, the longitudes do not, and a
    regression of distance on longitude is biased to low speeds by that.

    Parameters
    ----------
    position_rsun : numpy.ndarray, shape (N, 2)
        HEE x and y.
    covariance_rsun2 : numpy.ndarray, shape (N, 2, 2), optional
        Of x and y; without it all longitudes weigh alike, and the errors follow from their scatter.
    most_knots : int
        0 for one spiral through all positions.

    Raises
    ------
    GeometryError
        If fewer than three positions are far enough from the Sun, or all are at one distance within their errors.
    InputError
        If a covariance is not positive definite, or knots are asked for without covariances.
    """
    if most_knots and covariance_rsun2 is None:
        raise InputError("knots need positions with covariances: give these, or no knots")
    points = polar_points(position_rsun, covariance_rsun2)
    _check_spread(points)
    lines = [fit_broken_line(points, knots, SPIRAL_ORIGIN_RSUN) for knots in range(most_knots + 1)]
    best = min((line for line in lines if line is not None), key=lambda line: line.bic)
    scatter = 1.0 if covariance_rsun2 is not None else math.sqrt(best.chi2 / max(points.x.size - 2, 1))
    edges = np.concatenate([points.x[:1], best.knot, points.x[-1:]]).tolist()
    slopes = zip(best.slope.tolist(), (scatter * best.slope_sd).tolist(), strict=True)
    segments = [Segment(*ends, *slope) for ends, slope in zip(pairwise(edges), slopes, strict=True)]
    return Spiral(
        phi0_deg=within_half_turn_deg(best.value),
        phi0_sd_deg=scatter * best.value_sd,
        segments=tuple(segments),
        chi2=best.chi2,
        bic=tuple(math.inf if line is None else line.bic for line in lines),
        points=points.x.size,
        masked=len(position_rsun) - points.x.size,
    )


def _check_spread(points: Points) -> None:
    """Without a span of distances wider than their errors any slope would do."""
    span = float(np.ptp(points.x)) if points.x.size else 0.0
    error = float(np.sqrt(np.median(points.covariance[:, 0, 0]))) if points.x.size else 0.0
    if points.x.size < MIN_POINTS or not span > SPAN_SIGMAS * error:
        raise GeometryError(
            f"a spiral needs {MIN_POINTS} positions at different distances, not {points.x.size} over {span:.3g} solar "
            f"radii with errors of {error:.3g}; add frequencies"
        )


def fit_broken_line(points: Points, knots: int, origin: float = 0.0) -> BrokenLine | None:
    """Best line with a number of knots, wherever they are.

    Parameters
    ----------
    knots : int
        0 for a straight line.
    origin : float
        Where the value of the line is given.

    Returns
    -------
    BrokenLine or None
        None where there are too few points for so many segments.

    Notes
    -----
    The errors are those of York et al. 2004, from the adjusted points, and take the knots as known.
    """
    none = np.empty(0)
    flat, _ = _weighted(points, none, np.zeros(1), origin)
    straight = _refined(points, _weighted(points, none, flat[1:2], origin)[0], none, origin)
    if not knots:
        return straight
    placements = _placements(points, straight, knots, origin)
    fits = [_refined(points, start, knot, origin) for start, knot in placements]
    good = [fit for fit in fits if _enough_in_each(points.x, fit.knot)]
    return min(good, key=lambda fit: fit.chi2) if good else None


def _enough_in_each(x: FloatArray, knot: FloatArray) -> bool:
    counts = np.diff([0, *np.searchsorted(x, knot), x.size])
    return bool((counts >= MIN_POINTS).all())


def _design(x: FloatArray, knot: FloatArray, origin: float) -> FloatArray:
    """Columns of value, first slope, and change of slope at each knot, shape (N, 2 + K)."""
    return np.column_stack([np.ones_like(x), x - origin, *(np.maximum(x - k, 0.0) for k in knot)])


def _weighted(points: Points, knot: FloatArray, slope: FloatArray, origin: float) -> tuple[FloatArray, float]:
    """Line by linear least squares, with the weights that a slope gives, and its chi2."""
    root = 1.0 / np.sqrt(points.variance_about(slope))
    design, target = _design(points.x, knot, origin) * root[:, None], points.y * root
    solution = np.linalg.lstsq(design, target, rcond=None)[0]
    return np.asarray(solution), float(np.sum((target - design @ solution) ** 2))


def _placements(points: Points, straight: BrokenLine, knots: int, origin: float) -> list[tuple[FloatArray, FloatArray]]:
    """The most promising knots, each with the line through them: first all knots of a coarse grid are tried."""
    inside = points.x[MIN_POINTS - 1 : 1 - MIN_POINTS]
    if inside.size < 2:
        return []
    candidates = np.unique(np.quantile(inside, np.linspace(0.0, 1.0, CANDIDATES + 2)[1:-1]))
    tried = []
    for chosen in combinations(candidates, knots):
        knot = np.array(chosen)
        if _enough_in_each(points.x, knot):
            solution, chi2 = _weighted(points, knot, straight.slope, origin)
            tried.append((chi2, solution, knot))
    tried.sort(key=lambda trial: trial[0])
    return [(solution, knot) for _, solution, knot in tried[:REFINED]]


def _refined(points: Points, start: FloatArray, knot: FloatArray, origin: float) -> BrokenLine:
    """Least sum of squared distances, knots moving between the midpoints to their neighbours."""
    lines = start.size
    edges = np.concatenate([points.x[:1], 0.5 * (knot[:-1] + knot[1:]), points.x[-1:]])
    free = np.full(lines, np.inf)
    found = least_squares(
        lambda theta: _distances(points, theta[:lines], theta[lines:], origin)[0],
        np.concatenate([start, knot]),
        bounds=(np.concatenate([-free, edges[: knot.size]]), np.concatenate([free, edges[1 : knot.size + 1]])),
        x_scale="jac",
        xtol=TOLERANCE,
        ftol=TOLERANCE,
        gtol=TOLERANCE,
        max_nfev=EVALUATIONS,
    )
    return _with_errors(points, found.x[:lines], found.x[lines:], origin)


def _distances(
    points: Points, line: FloatArray, knot: FloatArray, origin: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Signed distance of each point from the line in its own metric, its nearest place x, and the segment of that."""
    slope = np.cumsum(line[1:])[:, None]
    off = points.y - _design(points.x, knot, origin) @ line
    # lines of the segments, continued over all x
    bounds = np.concatenate([[-np.inf], knot, [np.inf]])
    at = np.concatenate([points.x[:1], knot])[:, None]
    height = (_design(at[:, 0], knot, origin) @ line)[:, None]
    apart = points.y - height - slope * (points.x - at)
    xx, xy = points.covariance[:, 0, 0], points.covariance[:, 0, 1]
    nearest = points.x - (xy - slope * xx) / points.variance_about(slope) * apart
    nearest = np.clip(nearest, bounds[:-1, None], bounds[1:, None])
    miss = np.stack([points.x - nearest, points.y - height - slope * (nearest - at)], axis=-1)
    chi2 = np.einsum("snj,njk,snk->sn", miss, np.linalg.inv(points.covariance), miss)
    segment = chi2.argmin(axis=0)
    every = np.arange(points.x.size)
    return np.copysign(np.sqrt(chi2[segment, every]), off), nearest[segment, every], segment


def _with_errors(points: Points, line: FloatArray, knot: FloatArray, origin: float) -> BrokenLine:
    distance, nearest, segment = _distances(points, line, knot, origin)
    slope = np.cumsum(line[1:])
    root = 1.0 / np.sqrt(points.variance_about(slope[segment]))
    weighted = _design(nearest, knot, origin) * root[:, None]
    covariance = np.linalg.pinv(weighted.T @ weighted)
    sums = np.tril(np.ones((slope.size, slope.size)))
    return BrokenLine(
        value=float(line[0]),
        value_sd=float(np.sqrt(covariance[0, 0])),
        slope=slope,
        slope_sd=np.sqrt(np.diag(sums @ covariance[1:, 1:] @ sums.T)),
        knot=knot,
        chi2=float(distance @ distance),
        points=points.x.size,
    )


def track_fit(
    posterior: xr.Dataset,
    *,
    rotation_period_d: float = PAPER_FIGURES_ROTATION_D,
    other_rotations_d: tuple[float, ...] = (SIDEREAL_ROTATION_D,),
) -> dict[str, Any]:
    """Two-step fit of the paper: a spiral through the means of the positions, all of the same weight.

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
        Ready for JSON: frame, rotation period, and the fit; with a flag and without numbers where the positions do not
        allow one.
    """
    position = np.stack([posterior["x_rsun"].to_numpy(), posterior["y_rsun"].to_numpy()], axis=-1)
    try:
        spiral = fit_spiral(position)
        flags = spiral.segments[0].flags
    except GeometryError:
        nowhere = Segment(math.nan, math.nan, math.nan, math.nan)
        spiral = Spiral(math.nan, math.nan, (nowhere,), math.nan, (), len(position), 0)
        flags = ("too_few_positions",)

    def line(period_d: float) -> dict[str, Any]:
        """The fit with a rotation period."""
        return {
            "model": "longitude on distance, unweighted line through posterior means",
            "phi0_deg": spiral.phi0.model_dump(),
            "v_sw_km_s": spiral.segments[0].v_sw_km_s(period_d).model_dump(),
            "slope_deg_per_rsun": spiral.segments[0].slope.model_dump(),
            "r0_rsun": SPIRAL_ORIGIN_RSUN,
            "rms_deg": finite(spiral.rms_deg),
            "points": spiral.points,
            "rotation_period_d": period_d,
            "flags": list(flags),
        }

    return {
        "frame": posterior.attrs["frame"],
        "rotation_period_d": rotation_period_d,
        "two_step": line(rotation_period_d),
        "two_step_other_rotations": {f"{period_d:g}": line(period_d) for period_d in other_rotations_d},
    }


def piecewise_fit(
    posterior: xr.Dataset, *, most_knots: int = MOST_KNOTS, rotation_period_d: float = PAPER_FIGURES_ROTATION_D
) -> dict[str, Any]:
    """Spiral, and broken spiral, through the positions of a solution with their errors in both directions.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.
    rotation_period_d : float
        Rotation period of the Sun, days.

    Returns
    -------
    dict
        Ready for JSON: ``weighted`` and ``piecewise``; without parameters, but with a flag, where there is no fit.
    """
    position, covariance = planar_positions(posterior)
    try:
        broken, straight = (fit_spiral(position, covariance, knots) for knots in (most_knots, 0))
    except GeometryError:
        nothing = {"flags": ["too_few_positions"], "points": len(position)}
        return {"weighted": nothing, "piecewise": nothing | {"segments": []}}
    weighted = _as_json(straight, rotation_period_d)
    return {
        "weighted": weighted | weighted.pop("segments")[0],
        "piecewise": _as_json(broken, rotation_period_d),
    }


def _as_json(spiral: Spiral, rotation_period_d: float) -> dict[str, Any]:
    knots, most = len(spiral.knots_rsun), len(spiral.bic) - 1
    segments = [
        {
            "from_rsun": segment.from_rsun,
            "to_rsun": segment.to_rsun,
            "v_sw_km_s": segment.v_sw_km_s(rotation_period_d).model_dump(),
            "slope_deg_per_rsun": segment.slope.model_dump(),
            "flags": list(segment.flags),
        }
        for segment in spiral.segments
    ]
    return {
        "model": f"longitude on distance, errors in both, {knots} knots of at most {most}",
        "phi0_deg": spiral.phi0.model_dump(),
        "r0_rsun": SPIRAL_ORIGIN_RSUN,
        "segments": segments,
        "chi2": spiral.chi2,
        "bic": [finite(value) for value in spiral.bic],
        "points": spiral.points,
        "masked": spiral.masked,
        "rotation_period_d": rotation_period_d,
        "flags": sorted({flag for segment in spiral.segments for flag in segment.flags}),
    }

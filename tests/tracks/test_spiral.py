"""Spirals through positions: published numbers, simulated tracks, and tracks that are none."""

import json
import math

import numpy as np
import pytest
import xarray as xr
from scipy.optimize import minimize

from bella.arrivals import check_arrivals
from bella.bursts import published_arrivals
from bella.exceptions import GeometryError, InputError
from bella.flags import TRACK_FLAGS
from bella.heliosphere import PAPER_FIGURES_ROTATION_D, SIDEREAL_ROTATION_D, spiral_longitude_deg
from bella.multilateration import localise
from bella.tracks.spiral import (
    BrokenLine,
    Points,
    Segment,
    Spiral,
    fit_broken_line,
    fit_spiral,
    piecewise_fit,
    polar_points,
    track_fit,
)
from tests.plotting.synthetic import synthetic_posterior

RANGE_RSUN = np.geomspace(15.0, 152.0, 40)

PEARSON_X = np.array([0.0, 0.9, 1.8, 2.6, 3.3, 4.4, 5.2, 6.1, 6.5, 7.4])
PEARSON_Y = np.array([5.9, 5.4, 4.4, 4.6, 3.5, 3.7, 2.8, 2.8, 2.4, 1.5])
YORK_X_WEIGHT = np.array([1000.0, 1000.0, 500.0, 800.0, 200.0, 80.0, 60.0, 20.0, 1.8, 1.0])
YORK_Y_WEIGHT = np.array([1.0, 1.8, 4.0, 8.0, 20.0, 20.0, 70.0, 70.0, 100.0, 500.0])


def diagonal(x_variance: np.ndarray, y_variance: np.ndarray) -> np.ndarray:
    return np.stack([np.diag(pair) for pair in zip(x_variance, y_variance, strict=True)])


def scattered(true_x: np.ndarray, true_y: np.ndarray, covariance: np.ndarray, rng: np.random.Generator) -> Points:
    """Points about a curve, as measured."""
    noise = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.standard_normal((true_x.size, 2)))
    x, y = true_x + noise[:, 0], true_y + noise[:, 1]
    order = np.argsort(x)
    return Points(x[order], y[order], covariance[order])


def fitted(points: Points, knots: int = 0, origin: float = 0.0) -> BrokenLine:
    line = fit_broken_line(points, knots, origin)
    assert line is not None
    return line


def positions(range_rsun: np.ndarray, longitude_deg: np.ndarray) -> np.ndarray:
    angle = np.radians(longitude_deg)
    return np.stack([range_rsun * np.cos(angle), range_rsun * np.sin(angle)], axis=-1)


def solution(range_rsun: np.ndarray, longitude_deg: np.ndarray) -> xr.Dataset:
    x, y = positions(range_rsun, longitude_deg).T
    return xr.Dataset({"x_rsun": ("frequency", x), "y_rsun": ("frequency", y)}, attrs={"frame": "HEE"})


def errors(position: np.ndarray) -> np.ndarray:
    """Covariances that grow outward and are longer along the line of sight than across, as with three receivers."""
    scale = 0.5 + 0.01 * np.linalg.norm(position, axis=1)
    return scale[:, None, None] ** 2 * np.array([[2.0, 0.5], [0.5, 1.0]])


def measured(position: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    root = np.linalg.cholesky(errors(position))
    return position + np.einsum("nij,nj->ni", root, rng.standard_normal(position.shape))


def speed_km_s(spiral: Spiral, rotation_period_d: float = SIDEREAL_ROTATION_D) -> float:
    mean = spiral.segments[0].v_sw_km_s(rotation_period_d).mean
    return math.nan if mean is None else mean


def test_pearsons_points_with_yorks_weights() -> None:
    """York 1966, Can. J. Phys. 44, 1079, doi:10.1139/p66-090; errors and chi2: York et al. 2004, table II."""
    line = fitted(Points(PEARSON_X, PEARSON_Y, diagonal(1 / YORK_X_WEIGHT, 1 / YORK_Y_WEIGHT)))

    assert line.slope[0] == pytest.approx(-0.480533, abs=5e-7)
    assert line.value == pytest.approx(5.47991, abs=5e-6)
    assert line.slope_sd[0] == pytest.approx(0.0580, abs=5e-5)
    assert line.value_sd == pytest.approx(0.2950, abs=5e-5)
    assert line.chi2 / 8 == pytest.approx(1.4833, abs=5e-5)


def test_value_is_given_at_the_origin() -> None:
    points = Points(PEARSON_X, PEARSON_Y, diagonal(1 / YORK_X_WEIGHT, 1 / YORK_Y_WEIGHT))
    there, here = fitted(points, 0, 4.0), fitted(points)

    assert there.value == pytest.approx(here.value + 4.0 * here.slope[0], rel=1e-7)
    assert there.value_sd < here.value_sd


def test_correlated_errors_against_a_brute_minimum() -> None:
    rng = np.random.default_rng(5)
    root = rng.normal(0, 1, (12, 2, 2)) + 1.5 * np.eye(2)
    covariance = np.einsum("nij,nkj->nik", root, root)
    x = np.linspace(0.0, 40.0, 12)
    points = scattered(x, 3.0 - 0.5 * x, covariance, rng)

    def badness(theta: np.ndarray) -> float:
        """Over value, slope and every true x."""
        miss = np.stack([points.x - theta[2:], points.y - theta[0] - theta[1] * theta[2:]], axis=-1)
        return float(np.einsum("ni,nij,nj->", miss, np.linalg.inv(points.covariance), miss))

    brute = minimize(badness, np.concatenate([[3.0, -0.5], points.x]), method="BFGS", options={"gtol": 1e-7})
    line = fitted(points)

    assert [line.value, line.slope[0]] == pytest.approx(brute.x[:2], rel=1e-4)
    assert line.chi2 == pytest.approx(brute.fun, rel=1e-6)


def test_errors_in_x_do_not_flatten_the_slope() -> None:
    """Where least squares of y on x loses a quarter of it."""
    rng, x = np.random.default_rng(6), np.linspace(0.0, 20.0, 40)
    covariance = diagonal(np.full(40, 12.0), np.full(40, 1.0))
    samples = [scattered(x, -0.5 * x, covariance, rng) for _ in range(200)]
    lines = [fitted(points) for points in samples]
    slopes = np.array([line.slope[0] for line in lines])

    assert np.mean([np.polyfit(points.x, points.y, 1)[0] for points in samples]) > -0.4
    assert np.mean(slopes) == pytest.approx(-0.5, abs=0.01)
    assert np.mean([line.slope_sd[0] for line in lines]) == pytest.approx(slopes.std(), rel=0.15)
    assert np.mean([line.chi2 for line in lines]) == pytest.approx(38.0, abs=1.5)


def test_knot_and_slopes_of_a_broken_line_are_found() -> None:
    rng, x = np.random.default_rng(7), np.geomspace(12.0, 150.0, 80)
    covariance = np.broadcast_to(np.array([[1.0, 0.3], [0.3, 1.0]]), (80, 2, 2)).copy()
    points = scattered(x, 30 - 0.6 * np.minimum(x, 60) - 0.2 * np.maximum(x - 60, 0), covariance, rng)

    fits = [fitted(points, knots) for knots in range(4)]

    assert np.argmin([fit.bic for fit in fits]) == 1
    assert fits[1].knot[0] == pytest.approx(60.0, abs=3.0)
    pull = (fits[1].slope - np.array([-0.6, -0.2])) / fits[1].slope_sd
    assert np.abs(pull).max() < 3
    assert fits[1].chi2 == pytest.approx(76.0, abs=3 * np.sqrt(2 * 76.0))
    assert fits[1].bic - fits[1].chi2 == pytest.approx(4 * np.log(80))


def test_too_few_points_for_so_many_segments() -> None:
    points = Points(PEARSON_X[:5], PEARSON_Y[:5], diagonal(np.full(5, 0.1), np.full(5, 0.1)))
    assert fit_broken_line(points, 1) is None
    assert fit_broken_line(points, 3) is None


@pytest.mark.parametrize(
    ("covariance", "y"),
    [
        (np.zeros((10, 2, 2)), PEARSON_Y),
        (np.full((10, 2, 2), 1.0), PEARSON_Y),
        (np.full((10, 2, 2), np.nan), PEARSON_Y),
        (np.broadcast_to(np.eye(2), (10, 2, 2)), np.full(10, np.nan)),
        (np.broadcast_to(np.eye(2), (10, 2, 2)), PEARSON_Y[:9]),
    ],
)
def test_unusable_points_are_refused(covariance: np.ndarray, y: np.ndarray) -> None:
    with pytest.raises(InputError, match="leave"):
        Points(PEARSON_X, y, covariance)


@pytest.mark.parametrize("phi0_deg", [30.0, -179.0, 180.0, 0.0, 95.0, -90.0])
@pytest.mark.parametrize("v_sw_km_s", [250.0, 400.0, 900.0])
@pytest.mark.parametrize("weighted", [False, True])
def test_exact_spirals_are_recovered(phi0_deg: float, v_sw_km_s: float, weighted: bool) -> None:
    place = positions(RANGE_RSUN, spiral_longitude_deg(RANGE_RSUN, phi0_deg, v_sw_km_s, 27.2753))

    spiral = fit_spiral(place, errors(place), 3) if weighted else fit_spiral(place)

    assert spiral.knots_rsun == ()
    assert speed_km_s(spiral, 27.2753) == pytest.approx(v_sw_km_s, rel=1e-6 if weighted else 1e-9)
    assert (spiral.phi0_deg - phi0_deg + 180) % 360 - 180 == pytest.approx(0, abs=1e-5 if weighted else 1e-9)
    assert -180 <= spiral.phi0_deg <= 180
    assert spiral.segments[0].flags == ("formal_errors",)
    assert (spiral.points, spiral.masked) == (40, 0)
    assert spiral.chi2 == pytest.approx(0, abs=1e-9)


def test_the_speed_scales_with_the_rotation_alone() -> None:
    longitude = spiral_longitude_deg(RANGE_RSUN, 30.0, 400.0, 24.47)
    spiral = fit_spiral(positions(RANGE_RSUN, longitude))

    assert speed_km_s(spiral, 24.47) == pytest.approx(400.0, rel=1e-9)
    assert speed_km_s(spiral, 25.38) == pytest.approx(385.7, abs=0.05)


def test_a_slow_wind_winds_past_180_degrees() -> None:
    far = np.linspace(5.0, 1000.0, 200)
    longitude = spiral_longitude_deg(far, -100.0, 300.0)
    assert longitude.min() < -460

    spiral = fit_spiral(positions(far, longitude))
    assert speed_km_s(spiral) == pytest.approx(300.0, rel=1e-9)
    assert spiral.phi0_deg == pytest.approx(-100.0, abs=1e-9)


@pytest.mark.parametrize("weighted", [False, True])
def test_the_order_of_the_points_does_not_matter(weighted: bool) -> None:
    place = positions(RANGE_RSUN, spiral_longitude_deg(RANGE_RSUN, 170.0, 350.0))
    order = np.random.default_rng(1).permutation(RANGE_RSUN.size)
    here, there = (fit_spiral(one, errors(one) if weighted else None) for one in (place, place[order]))
    assert here == there


def test_without_covariances_it_is_the_regression_of_longitude_on_distance() -> None:
    """Slope and errors of numpy.polyfit, which scales them by the scatter."""
    noise = np.random.default_rng(3).normal(0, 1.5, RANGE_RSUN.size)
    longitude = spiral_longitude_deg(RANGE_RSUN, 30.0, 400.0) + noise

    spiral = fit_spiral(positions(RANGE_RSUN, longitude))

    (slope, phi0), covariance = np.polyfit(RANGE_RSUN - 1.0, longitude, 1, cov=True)
    assert spiral.phi0_deg == pytest.approx(phi0, rel=1e-8)
    assert spiral.segments[0].slope_deg_per_rsun == pytest.approx(slope, rel=1e-8)
    assert spiral.segments[0].slope_sd_deg_per_rsun == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-6)
    assert spiral.phi0_sd_deg == pytest.approx(np.sqrt(covariance[1, 1]), rel=1e-6)
    residual = longitude - np.polyval([slope, phi0], RANGE_RSUN - 1.0)
    assert spiral.rms_deg == pytest.approx(np.sqrt((residual**2).sum() / 38), rel=1e-8)


def test_with_even_errors_the_weighted_line_is_the_unweighted_one() -> None:
    """Small errors in distance, alike ones in longitude."""
    rng = np.random.default_rng(12)
    longitude = spiral_longitude_deg(RANGE_RSUN, 30.0, 400.0) + rng.normal(0, 1, RANGE_RSUN.size)
    place, angle = positions(RANGE_RSUN, longitude), np.radians(longitude)
    out = np.stack([np.cos(angle), np.sin(angle)], -1)
    across = np.stack([-np.sin(angle), np.cos(angle)], -1) * (np.radians(1.0) * RANGE_RSUN)[:, None]
    covariance = 1e-8 * out[:, :, None] * out[:, None] + across[:, :, None] * across[:, None]

    weighted, plain = fit_spiral(place, covariance), fit_spiral(place)

    assert speed_km_s(weighted) == pytest.approx(speed_km_s(plain), rel=1e-5)
    assert weighted.phi0_deg == pytest.approx(plain.phi0_deg, rel=1e-5)


def test_errors_cover_simulated_spirals_and_the_speed_is_not_biased() -> None:
    rng = np.random.default_rng(8)
    truth = positions(RANGE_RSUN, spiral_longitude_deg(RANGE_RSUN, 30.0, 400.0))
    fits = [fit_spiral(measured(truth, rng), errors(truth)) for _ in range(150)]
    speeds = [fit.segments[0].v_sw_km_s(SIDEREAL_ROTATION_D) for fit in fits]
    phi0_pull = np.array([(fit.phi0_deg - 30.0) / fit.phi0_sd_deg for fit in fits])

    assert np.median([speed.q50 for speed in speeds]) == pytest.approx(400.0, abs=5.0)
    assert np.mean([speed.q2_5 < 400.0 < speed.q97_5 for speed in speeds]) == pytest.approx(0.95, abs=0.05)
    assert np.mean([speed.q16 < 400.0 < speed.q84 for speed in speeds]) == pytest.approx(0.68, abs=0.1)
    assert np.std(phi0_pull) == pytest.approx(1.0, abs=0.2)


def test_speeds_on_both_sides_of_a_knot_are_found() -> None:
    rng = np.random.default_rng(9)
    inner = spiral_longitude_deg(np.array([70.0]), 20.0, 300.0)[0]
    fine = np.geomspace(15.0, 152.0, 120)
    longitude = np.where(
        fine < 70, spiral_longitude_deg(fine, 20.0, 300.0), inner + spiral_longitude_deg(fine - 69.0, 0.0, 900.0)
    )
    truth = positions(fine, longitude)

    spiral = fit_spiral(measured(truth, rng), errors(truth), 3)

    assert int(np.argmin(spiral.bic)) == 1
    assert spiral.knots_rsun[0] == pytest.approx(70.0, abs=8.0)
    for segment, true_km_s in zip(spiral.segments, (300.0, 900.0), strict=True):
        speed = segment.v_sw_km_s(SIDEREAL_ROTATION_D)
        assert abs(speed.mean - true_km_s) < 3 * speed.sd
        assert segment.flags == ("formal_errors",)
    assert spiral.segments[0].to_rsun == spiral.segments[1].from_rsun
    assert len(spiral.bic) == 4


def test_one_speed_asks_for_no_knot() -> None:
    rng = np.random.default_rng(10)
    truth = positions(RANGE_RSUN, spiral_longitude_deg(RANGE_RSUN, 30.0, 400.0))
    knots = [len(fit_spiral(measured(truth, rng), errors(truth), 2).knots_rsun) for _ in range(4)]
    assert knots.count(0) >= 3


def test_only_the_retrograde_part_is_flagged() -> None:
    longitude = np.where(RANGE_RSUN < 60, 30.0 - 0.5 * RANGE_RSUN, 0.4 * (RANGE_RSUN - 60.0))
    truth = positions(RANGE_RSUN, longitude)

    spiral = fit_spiral(truth, 0.2 * errors(truth), 3)

    assert spiral.segments[0].flags == ("formal_errors",)
    assert spiral.segments[-1].flags == ("formal_errors", "not_a_spiral")
    assert spiral.segments[0].v_sw_km_s(25.38).mean > 0
    assert spiral.segments[-1].v_sw_km_s(25.38).mean is None


@pytest.mark.parametrize(
    ("slope", "sd", "bends"),
    [
        (-0.5, 0.24, True),
        (-0.5, 0.26, False),  # 1.9 errors
        (-0.5, 0.4, False),
        (0.5, 0.1, False),
        (-1e-7, 0.0, False),
        (-1e-5, 0.0, True),
    ],
)
def test_a_speed_is_given_where_the_longitude_falls_by_two_errors(slope: float, sd: float, bends: bool) -> None:
    segment = Segment(10.0, 100.0, slope, sd)

    speed = segment.v_sw_km_s(25.38).model_dump(exclude_none=True)

    assert ("not_a_spiral" in segment.flags) is not bends
    assert bool(speed) is bends
    if bends:
        assert 0 < speed["q2_5"] <= speed["q16"] <= speed["q50"] <= speed["q84"] <= speed["q97_5"]


def test_quantiles_of_the_speed_are_those_of_the_slope() -> None:
    """0.3 +- 0.1 degrees per solar radius; Omega of 25.38 days times a solar radius is 114.23 km/s per degree."""
    speed = Segment(10.0, 100.0, -0.3, 0.1).v_sw_km_s(25.38)
    turn = 360 / 25.38 / 86400 * 695_700

    assert speed.q50 == speed.mean == pytest.approx(turn / 0.3)
    assert speed.q16 == pytest.approx(turn / (0.3 + 0.0994458), rel=1e-6)
    assert speed.q84 == pytest.approx(turn / (0.3 - 0.0994458), rel=1e-6)
    assert speed.q2_5 == pytest.approx(turn / (0.3 + 0.1959964), rel=1e-6)
    assert speed.q97_5 == pytest.approx(turn / (0.3 - 0.1959964), rel=1e-6)
    assert speed.sd == pytest.approx(speed.mean / 3)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_positions(count: int) -> None:
    place = positions(RANGE_RSUN[:count], np.zeros(count))
    for covariance in (None, errors(place)):
        with pytest.raises(GeometryError, match="a spiral needs 3 positions") as caught:
            fit_spiral(place, covariance)
        assert len(str(caught.value).splitlines()) == 1


def test_three_positions_are_one_spiral() -> None:
    far = np.array([20.0, 60.0, 120.0])
    place = positions(far, spiral_longitude_deg(far, 30.0, 400.0))
    spiral = fit_spiral(place, errors(place), 3)
    assert speed_km_s(spiral) == pytest.approx(400.0, rel=1e-6)
    assert spiral.bic[1:] == (np.inf, np.inf, np.inf)


@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_positions_at_one_distance_within_errors(spread: float) -> None:
    place = positions(20.0 + spread * np.linspace(-1, 1, 12), np.linspace(-20.0, 20.0, 12))
    with pytest.raises(GeometryError, match="add frequencies"):
        fit_spiral(place, errors(place))


def test_positions_at_the_sun_are_left_out() -> None:
    place = positions(RANGE_RSUN, spiral_longitude_deg(RANGE_RSUN, 30.0, 400.0))
    covariance = errors(place)
    inside = np.array([[0.0, 0.0], [0.5, -0.5], [np.nan, 1.0]])

    spiral = fit_spiral(
        np.concatenate([inside, place]), np.concatenate([np.broadcast_to(np.eye(2), (3, 2, 2)), covariance])
    )

    assert spiral.masked == 3
    assert spiral.points == RANGE_RSUN.size
    assert speed_km_s(spiral) == pytest.approx(400.0, rel=1e-6)


@pytest.mark.parametrize(("range_rsun", "kept"), [(2.0, 0), (2.9, 0), (3.1, 1), (30.0, 1)])
def test_a_longitude_takes_three_errors_of_distance(range_rsun: float, kept: int) -> None:
    assert polar_points(np.array([[range_rsun, 0.0]]), np.eye(2)[None]).x.size == kept


def test_covariance_of_distance_and_longitude_is_that_of_draws() -> None:
    rng, covariance = np.random.default_rng(11), np.array([[3.0, 1.5], [1.5, 2.0]])
    drawn = rng.multivariate_normal([80.0, -10.0], covariance, 200_000)
    polar = np.stack([np.linalg.norm(drawn, axis=1), np.degrees(np.arctan2(drawn[:, 1], drawn[:, 0]))])

    points = polar_points(np.array([[80.0, -10.0]]), covariance[None])

    np.testing.assert_allclose(points.covariance[0], np.cov(polar), rtol=0.02)


def test_covariances_that_are_none_are_refused() -> None:
    place = positions(RANGE_RSUN, np.zeros(RANGE_RSUN.size))
    with pytest.raises(InputError, match="positive definite"):
        fit_spiral(place, np.zeros((RANGE_RSUN.size, 2, 2)))
    with pytest.raises(InputError, match="give these, or no knots"):
        fit_spiral(place, most_knots=1)


@pytest.mark.parametrize(
    "longitude",
    [
        np.full(RANGE_RSUN.size, 20.0),
        np.zeros(RANGE_RSUN.size),
        20.0 + 0.3 * RANGE_RSUN,
        20.0 + np.where(np.arange(RANGE_RSUN.size) % 2, 30.0, -30.0),
    ],
    ids=["radial", "radial to Earth", "retrograde", "scatter"],
)
def test_a_track_that_is_no_spiral_is_flagged_and_has_no_speed(longitude: np.ndarray) -> None:
    fit = track_fit(solution(RANGE_RSUN, longitude))

    assert set(fit["two_step"]["flags"]) == {"formal_errors", "not_a_spiral"} < set(TRACK_FLAGS)
    assert "not_a_spiral" in fit["two_step_other_rotations"]["25.38"]["flags"]
    assert set(fit["two_step"]["v_sw_km_s"].values()) == {None}
    assert fit["two_step"]["phi0_deg"]["q50"] is not None
    assert json.loads(json.dumps(fit, allow_nan=False)) == fit


@pytest.mark.parametrize(
    "range_rsun", [np.empty(0), np.array([20.0]), np.array([20.0, 30.0]), np.full(5, 20.0), np.full(4, np.nan)]
)
def test_too_little_for_a_line_is_a_solution_without_a_spiral(range_rsun: np.ndarray) -> None:
    fit = track_fit(solution(range_rsun, np.zeros(range_rsun.size)))
    assert fit["two_step"]["flags"] == ["too_few_positions"]
    assert fit["two_step"]["points"] == range_rsun.size
    for name in ("phi0_deg", "v_sw_km_s", "slope_deg_per_rsun"):
        assert set(fit["two_step"][name].values()) == {None}
    assert json.loads(json.dumps(fit, allow_nan=False)) == fit


@pytest.fixture(scope="module")
def event() -> xr.Dataset:
    return localise(check_arrivals(published_arrivals()), preset="bella-2024", draws=20)


def test_the_published_burst(event: xr.Dataset) -> None:
    fit = track_fit(event)
    radii = np.hypot(event["x_rsun"], event["y_rsun"]).to_numpy()

    assert fit["rotation_period_d"] == PAPER_FIGURES_ROTATION_D == 24.47
    assert event.sizes["frequency"] == 200
    assert radii[0] == pytest.approx(152, abs=2)
    assert radii[-1] == pytest.approx(12, abs=1)
    assert (np.diff(radii) < 0).all()
    assert fit["two_step"]["phi0_deg"]["mean"] == pytest.approx(29.9, abs=0.1)
    assert fit["two_step"]["v_sw_km_s"]["q50"] == pytest.approx(399.4, abs=0.5)
    assert fit["two_step"]["r0_rsun"] == 1.0
    sidereal = fit["two_step_other_rotations"]["25.38"]
    assert sidereal["v_sw_km_s"]["mean"] == pytest.approx(399.4 * 24.47 / 25.38, abs=0.5)
    assert sidereal["rotation_period_d"] == 25.38
    assert json.loads(json.dumps(fit, allow_nan=False)) == fit


def test_the_published_burst_carries_the_flags_it_must(event: xr.Dataset) -> None:
    assert event["flags"].str.contains("speed_not_constrained").all()
    assert not event["flags"].str.contains("multimodal|arrivals_inconsistent|position_not_constrained").any()
    assert (event["modes"] == 1).all()


def test_a_solution_gets_both_weighted_fits_as_json() -> None:
    fit = piecewise_fit(synthetic_posterior())

    assert json.loads(json.dumps(fit, allow_nan=False)) == fit
    assert fit["weighted"]["v_sw_km_s"]["mean"] == pytest.approx(400.0, rel=0.01)
    assert fit["weighted"]["phi0_deg"]["mean"] == pytest.approx(30.0, abs=0.3)
    assert fit["piecewise"]["bic"][0] == min(fit["piecewise"]["bic"])
    assert len(fit["piecewise"]["segments"]) == 1


def test_a_solution_without_a_track_is_json_too() -> None:
    fit = piecewise_fit(synthetic_posterior().isel(frequency=slice(0, 2)))
    assert fit["weighted"]["flags"] == fit["piecewise"]["flags"] == ["too_few_positions"]
    assert fit["piecewise"]["segments"] == []

"""Weighted and broken spirals: recovery of simulated tracks, and honesty about tracks that are none."""

import json

import numpy as np
import pytest

from bella.exceptions import GeometryError, InputError
from bella.flags import TRACK_FLAGS
from bella.heliosphere import spiral_longitude_deg
from bella.tracks import fit_piecewise_spiral, fit_spiral_line, piecewise_fit
from bella.tracks.piecewise import polar_points
from tests.plotting.synthetic import synthetic_posterior

RANGE_RSUN = np.geomspace(15.0, 152.0, 40)


def positions(range_rsun: np.ndarray, longitude_deg: np.ndarray) -> np.ndarray:
    angle = np.radians(longitude_deg)
    return np.stack([range_rsun * np.cos(angle), range_rsun * np.sin(angle)], axis=-1)


def errors(position: np.ndarray) -> np.ndarray:
    """Covariances that grow outward and are longer along the line of sight than across, as with three receivers."""
    scale = 0.5 + 0.01 * np.linalg.norm(position, axis=1)
    return scale[:, None, None] ** 2 * np.array([[2.0, 0.5], [0.5, 1.0]])


def measured(position: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    root = np.linalg.cholesky(errors(position))
    return position + np.einsum("nij,nj->ni", root, rng.standard_normal(position.shape))


@pytest.mark.parametrize("phi0_deg", [30.0, -179.0, 180.0, 95.0])
@pytest.mark.parametrize("v_sw_km_s", [250.0, 400.0, 900.0])
def test_exact_spirals_are_recovered(phi0_deg: float, v_sw_km_s: float) -> None:
    place = positions(RANGE_RSUN, spiral_longitude_deg(RANGE_RSUN, phi0_deg, v_sw_km_s))

    spiral = fit_piecewise_spiral(place, errors(place))

    assert spiral.knots_rsun == ()
    assert spiral.segments[0].v_sw_km_s == pytest.approx(v_sw_km_s, rel=1e-6)
    assert (spiral.phi0_deg - phi0_deg + 180) % 360 - 180 == pytest.approx(0, abs=1e-5)
    assert spiral.segments[0].flags == ("formal_errors",)
    assert spiral.chi2 == pytest.approx(0, abs=1e-9)


def test_errors_cover_simulated_spirals_and_the_speed_is_not_biased() -> None:
    rng = np.random.default_rng(8)
    truth = positions(RANGE_RSUN, spiral_longitude_deg(RANGE_RSUN, 30.0, 400.0))
    fits = [fit_piecewise_spiral(measured(truth, rng), errors(truth), most_knots=0) for _ in range(150)]
    speed = np.array([fit.segments[0].v_sw_km_s for fit in fits])
    sd = np.array([fit.segments[0].v_sw_sd_km_s for fit in fits])
    phi0_pull = np.array([(fit.phi0_deg - 30.0) / fit.phi0_sd_deg for fit in fits])

    assert np.median(speed) == pytest.approx(400.0, abs=5.0)
    assert np.mean(np.abs(speed - 400.0) < 2 * sd) == pytest.approx(0.95, abs=0.05)
    assert np.std(phi0_pull) == pytest.approx(1.0, abs=0.2)


def test_speeds_on_both_sides_of_a_knot_are_found() -> None:
    rng = np.random.default_rng(9)
    inner = spiral_longitude_deg(np.array([70.0]), 20.0, 300.0)[0]
    fine = np.geomspace(15.0, 152.0, 120)
    longitude = np.where(
        fine < 70, spiral_longitude_deg(fine, 20.0, 300.0), inner + spiral_longitude_deg(fine - 69.0, 0.0, 900.0)
    )
    truth = positions(fine, longitude)

    spiral = fit_piecewise_spiral(measured(truth, rng), errors(truth))

    assert int(np.argmin(spiral.bic)) == 1
    assert spiral.knots_rsun[0] == pytest.approx(70.0, abs=8.0)
    for segment, true_km_s in zip(spiral.segments, (300.0, 900.0), strict=True):
        assert abs(segment.v_sw_km_s - true_km_s) < 3 * segment.v_sw_sd_km_s
        assert segment.flags == ("formal_errors",)
    assert spiral.segments[0].to_rsun == spiral.segments[1].from_rsun
    assert len(spiral.bic) == 4


def test_one_speed_asks_for_no_knot() -> None:
    rng = np.random.default_rng(10)
    truth = positions(RANGE_RSUN, spiral_longitude_deg(RANGE_RSUN, 30.0, 400.0))
    knots = [len(fit_piecewise_spiral(measured(truth, rng), errors(truth), 2).knots_rsun) for _ in range(8)]
    assert knots.count(0) >= 6


def test_only_the_retrograde_part_is_flagged() -> None:
    longitude = np.where(RANGE_RSUN < 60, 30.0 - 0.5 * RANGE_RSUN, 0.4 * (RANGE_RSUN - 60.0))
    truth = positions(RANGE_RSUN, longitude)

    spiral = fit_piecewise_spiral(truth, 0.2 * errors(truth))

    assert spiral.segments[0].flags == ("formal_errors",)
    assert spiral.segments[-1].flags == ("formal_errors", "not_a_spiral")
    assert spiral.segments[-1].v_sw_km_s < 0 < spiral.segments[0].v_sw_km_s


@pytest.mark.parametrize("slope", [0.0, 0.3], ids=["radial", "retrograde"])
def test_a_track_that_is_no_spiral_is_flagged(slope: float) -> None:
    place = positions(RANGE_RSUN, 20.0 + slope * RANGE_RSUN)
    spiral = fit_piecewise_spiral(place, errors(place))
    assert {flag for segment in spiral.segments for flag in segment.flags} == {"formal_errors", "not_a_spiral"}
    assert {"formal_errors", "not_a_spiral"} < set(TRACK_FLAGS)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_positions(count: int) -> None:
    place = positions(RANGE_RSUN[:count], np.zeros(count))
    with pytest.raises(GeometryError, match="a spiral needs 3 positions") as caught:
        fit_piecewise_spiral(place, errors(place))
    assert len(str(caught.value).splitlines()) == 1


def test_three_positions_are_one_spiral() -> None:
    far = np.array([20.0, 60.0, 120.0])
    place = positions(far, spiral_longitude_deg(far, 30.0, 400.0))
    spiral = fit_piecewise_spiral(place, errors(place))
    assert spiral.segments[0].v_sw_km_s == pytest.approx(400.0, rel=1e-6)
    assert spiral.bic[1:] == (np.inf, np.inf, np.inf)


@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_positions_at_one_distance_within_errors(spread: float) -> None:
    place = positions(20.0 + spread * np.linspace(-1, 1, 12), np.linspace(-20.0, 20.0, 12))
    with pytest.raises(GeometryError, match="add frequencies"):
        fit_piecewise_spiral(place, errors(place))


def test_positions_at_the_sun_are_left_out() -> None:
    place = positions(RANGE_RSUN, spiral_longitude_deg(RANGE_RSUN, 30.0, 400.0))
    covariance = errors(place)
    inside = np.array([[0.0, 0.0], [0.5, -0.5], [np.nan, 1.0]])

    spiral = fit_piecewise_spiral(
        np.concatenate([inside, place]), np.concatenate([np.broadcast_to(np.eye(2), (3, 2, 2)), covariance])
    )

    assert spiral.masked == 3
    assert spiral.points == RANGE_RSUN.size
    assert spiral.segments[0].v_sw_km_s == pytest.approx(400.0, rel=1e-6)


def test_covariance_of_distance_and_longitude_is_that_of_draws() -> None:
    rng, covariance = np.random.default_rng(11), np.array([[3.0, 1.5], [1.5, 2.0]])
    drawn = rng.multivariate_normal([80.0, -10.0], covariance, 200_000)
    polar = np.stack([np.linalg.norm(drawn, axis=1), np.degrees(np.arctan2(drawn[:, 1], drawn[:, 0]))])

    points = polar_points(np.array([[80.0, -10.0]]), covariance[None])

    np.testing.assert_allclose(points.covariance[0], np.cov(polar), rtol=0.02)


def test_with_even_errors_the_line_is_the_unweighted_one() -> None:
    """Small errors in distance, alike ones in longitude: regression of longitude on distance."""
    rng = np.random.default_rng(12)
    longitude = spiral_longitude_deg(RANGE_RSUN, 30.0, 400.0) + rng.normal(0, 1, RANGE_RSUN.size)
    place, angle = positions(RANGE_RSUN, longitude), np.radians(longitude)
    out = np.stack([np.cos(angle), np.sin(angle)], -1)
    across = np.stack([-np.sin(angle), np.cos(angle)], -1) * (np.radians(1.0) * RANGE_RSUN)[:, None]
    covariance = 1e-8 * out[:, :, None] * out[:, None] + across[:, :, None] * across[:, None]

    spiral = fit_piecewise_spiral(place, covariance, 0, 25.38)

    expected = fit_spiral_line(RANGE_RSUN, longitude, 25.38)
    assert spiral.segments[0].v_sw_km_s == pytest.approx(expected.v_sw_km_s, rel=1e-5)
    assert spiral.phi0_deg == pytest.approx(expected.phi0_deg, rel=1e-5)


def test_covariance_that_is_none_is_refused() -> None:
    place = positions(RANGE_RSUN, np.zeros(RANGE_RSUN.size))
    with pytest.raises(InputError, match="positive definite"):
        fit_piecewise_spiral(place, np.zeros((RANGE_RSUN.size, 2, 2)))


def test_a_solution_gets_both_fits_as_json() -> None:
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

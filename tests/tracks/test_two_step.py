"""The two-step spiral: exact on exact spirals, honest about tracks that are none."""

import json

import numpy as np
import pytest
import xarray as xr

from bella.arrivals import check_arrivals
from bella.bursts import published_arrivals
from bella.exceptions import GeometryError
from bella.flags import TRACK_FLAGS
from bella.heliosphere import spiral_longitude_deg
from bella.heliosphere.parker import PAPER_FIGURES_ROTATION_D, SIDEREAL_ROTATION_D
from bella.multilateration import localise
from bella.tracks import fit_spiral_line, track_fit

RANGE_RSUN = np.geomspace(12.0, 152.0, 40)


@pytest.fixture(scope="module")
def event() -> xr.Dataset:
    return localise(check_arrivals(published_arrivals()), preset="bella-2024", draws=20)


def positions(range_rsun: np.ndarray, longitude_deg: np.ndarray) -> xr.Dataset:
    angle = np.radians(longitude_deg)
    return xr.Dataset(
        {"x_rsun": ("frequency", range_rsun * np.cos(angle)), "y_rsun": ("frequency", range_rsun * np.sin(angle))},
        attrs={"frame": "HEE"},
    )


@pytest.mark.parametrize("phi0_deg", [30.0, -179.0, 180.0, 0.0, 95.0, -90.0])
@pytest.mark.parametrize("v_sw_km_s", [250.0, 400.0, 900.0])
@pytest.mark.parametrize("period_d", [PAPER_FIGURES_ROTATION_D, SIDEREAL_ROTATION_D, 27.2753])
def test_spirals_are_recovered(phi0_deg, v_sw_km_s, period_d) -> None:
    track = positions(RANGE_RSUN, spiral_longitude_deg(RANGE_RSUN, phi0_deg, v_sw_km_s, period_d))
    fit = track_fit(track, rotation_period_d=period_d)["two_step"]

    assert fit["v_sw_km_s"]["mean"] == pytest.approx(v_sw_km_s, rel=1e-9)
    assert (fit["phi0_deg"]["mean"] - phi0_deg + 180) % 360 - 180 == pytest.approx(0, abs=1e-9)
    assert -180 <= fit["phi0_deg"]["mean"] <= 180
    assert fit["rms_deg"] == pytest.approx(0, abs=1e-9)
    assert fit["points"] == RANGE_RSUN.size
    assert fit["flags"] == ["formal_errors"]


def test_the_speed_scales_with_the_rotation_alone() -> None:
    longitude = spiral_longitude_deg(RANGE_RSUN, 30.0, 400.0, 24.47)
    fits = [fit_spiral_line(RANGE_RSUN, longitude, period_d) for period_d in (24.47, 25.38)]

    assert fits[0].v_sw_km_s == pytest.approx(400.0, rel=1e-9)
    assert fits[1].v_sw_km_s == pytest.approx(385.7, abs=0.05)
    assert fits[0].phi0_deg == fits[1].phi0_deg
    assert fits[0].slope_deg_per_rsun == fits[1].slope_deg_per_rsun


def test_a_slow_wind_winds_past_180_degrees() -> None:
    far = np.linspace(5.0, 1000.0, 200)
    longitude = spiral_longitude_deg(far, -100.0, 300.0, 25.38)
    assert longitude.min() < -460

    wrapped = (longitude + 180) % 360 - 180
    fit = fit_spiral_line(far, wrapped, 25.38)
    assert fit.v_sw_km_s == pytest.approx(300.0, rel=1e-9)
    assert fit.phi0_deg == pytest.approx(-100.0, abs=1e-9)


def test_the_order_of_the_points_does_not_matter() -> None:
    longitude = spiral_longitude_deg(RANGE_RSUN, 170.0, 350.0, 25.38)
    order = np.random.default_rng(1).permutation(RANGE_RSUN.size)

    assert fit_spiral_line(RANGE_RSUN[order], longitude[order], 25.38) == fit_spiral_line(RANGE_RSUN, longitude, 25.38)


def test_the_formal_error_is_that_of_a_line() -> None:
    """Against the spread of 2000 fits to spirals with independent noise."""
    rng = np.random.default_rng(3)
    true = spiral_longitude_deg(RANGE_RSUN, 30.0, 400.0, 25.38)
    fits = [fit_spiral_line(RANGE_RSUN, true + rng.normal(0, 1.5, RANGE_RSUN.size), 25.38) for _ in range(2000)]

    for value, sd in (("phi0_deg", "phi0_sd_deg"), ("v_sw_km_s", "v_sw_sd_km_s")):
        scatter = np.std([getattr(fit, value) for fit in fits])
        assert np.mean([getattr(fit, sd) for fit in fits]) == pytest.approx(scatter, rel=0.06)
    assert np.mean([fit.rms_deg for fit in fits]) == pytest.approx(1.5, rel=0.02)


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
def test_a_track_that_is_no_spiral_is_flagged_and_is_json(longitude) -> None:
    fit = track_fit(positions(RANGE_RSUN, longitude))

    assert set(fit["two_step"]["flags"]) == {"formal_errors", "not_a_spiral"} < set(TRACK_FLAGS)
    assert "not_a_spiral" in fit["two_step_other_rotations"]["25.38"]["flags"]
    assert json.loads(json.dumps(fit, allow_nan=False)) == fit


@pytest.mark.parametrize(
    "range_rsun",
    [np.array([]), np.array([20.0]), np.array([20.0, 30.0]), np.full(5, 20.0), np.zeros(4), np.full(4, np.nan)],
)
def test_too_little_for_a_line_is_a_geometry_error(range_rsun) -> None:
    with pytest.raises(GeometryError, match="a spiral needs 3 positions") as caught:
        fit_spiral_line(range_rsun, np.zeros(range_rsun.size), 25.38)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("range_rsun", [np.array([20.0]), np.array([20.0, 30.0]), np.full(5, 20.0)])
def test_too_little_for_a_line_is_a_solution_without_a_spiral(range_rsun) -> None:
    fit = track_fit(positions(range_rsun, np.zeros(range_rsun.size)))
    assert fit["two_step"]["flags"] == ["too_few_positions"]
    assert fit["two_step"]["points"] == range_rsun.size
    assert set(fit["two_step"]["phi0_deg"].values()) == {None}
    assert json.loads(json.dumps(fit, allow_nan=False)) == fit


def test_quantiles_belong_to_mean_and_sd() -> None:
    noise = np.random.default_rng(4).normal(0, 2, RANGE_RSUN.size)
    longitude = spiral_longitude_deg(RANGE_RSUN, 30.0, 400.0, 25.38) + noise
    fit = track_fit(positions(RANGE_RSUN, longitude))["two_step"]

    for name in ("phi0_deg", "v_sw_km_s", "slope_deg_per_rsun"):
        values = fit[name]
        assert values["q50"] == pytest.approx(values["mean"])
        assert values["q97_5"] - values["q2_5"] == pytest.approx(2 * 1.959964 * values["sd"], rel=1e-6)
        assert values["q84"] - values["q16"] == pytest.approx(2 * 0.994458 * values["sd"], rel=1e-6)
    assert set(fit["flags"]) <= set(TRACK_FLAGS)


def test_the_published_burst(event) -> None:
    fit = track_fit(event)
    radii = np.hypot(event["x_rsun"], event["y_rsun"]).to_numpy()

    assert fit["rotation_period_d"] == 24.47
    assert event.sizes["frequency"] == 200
    assert radii[0] == pytest.approx(152, abs=2)
    assert radii[-1] == pytest.approx(12, abs=1)
    assert (np.diff(radii) < 0).all()
    assert fit["two_step"]["phi0_deg"]["mean"] == pytest.approx(29.9, abs=0.1)
    assert fit["two_step"]["v_sw_km_s"]["mean"] == pytest.approx(399.4, abs=0.5)
    assert fit["two_step"]["r0_rsun"] == 1.0
    sidereal = fit["two_step_other_rotations"]["25.38"]
    assert sidereal["v_sw_km_s"]["mean"] == pytest.approx(399.4 * 24.47 / 25.38, abs=0.5)
    assert sidereal["rotation_period_d"] == 25.38
    assert json.loads(json.dumps(fit, allow_nan=False)) == fit


def test_the_published_burst_carries_the_flags_it_must(event) -> None:
    assert event["flags"].str.contains("speed_not_constrained").all()
    assert not event["flags"].str.contains("multimodal|arrivals_inconsistent|position_not_constrained").any()
    assert (event["modes"] == 1).all()

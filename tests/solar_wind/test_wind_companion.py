"""The wind beside a track: the published burst, and winds whose answer is known."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bella.solar_wind import WindAssimilation, assimilate_wind, steady_wind
from bella.solar_wind.assimilation import drawn_winds
from bella.solar_wind.connection import footpoint_companion
from bella.solar_wind.folder import InSitu
from bella.solar_wind.wind_companion import TrackSpiral, longitude_at_sun_deg, wind_companion
from tests.solar_wind.in_situ import AROUND, FLEET, lists_of

SPIRAL = TrackSpiral(30.0, 400.0, 25.38, np.linspace(12.0, 152.0, 50), AROUND)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory, reference_files: Path) -> tuple[WindAssimilation, InSitu]:
    speeds = lists_of(tmp_path_factory.mktemp("lists"), reference_files)
    return assimilate_wind(speeds, AROUND), InSitu(speeds, (), ())


@cache
def constant(speed_km_s: float) -> tuple[WindAssimilation, InSitu]:
    """A wind of one speed at its inner boundary, as Earth alone measured it."""
    index = pd.DatetimeIndex(AROUND + np.arange(-24 * 14, 24 * 14) * np.timedelta64(1, "h"))
    speeds = {"WIND": pd.Series(1.15 * speed_km_s, index=index)}
    found = assimilate_wind(speeds, AROUND)
    flat = np.full(found.boundary_km_s.size, speed_km_s)
    return replace(found, boundary_km_s=flat, wind=steady_wind(flat)), InSitu(speeds, (), ())


def test_published_burst(measured: tuple[WindAssimilation, InSitu]) -> None:
    found = wind_companion(*measured, SPIRAL)

    by_name = {one["observatory"]: one for one in found["observatories"]}
    assert [by_name[name]["measured_km_s"] for name in FLEET] == [649, 352, 342]
    for name, most in zip(FLEET, (55, 115, 100), strict=True):
        assert by_name[name]["rmse_km_s"] <= min(most, by_name[name]["prior_rmse_km_s"])
    assert [one["range_rsun"] for one in found["along_track"]] == [30, 50, 75, 100, 125, 150]
    for step in found["along_track"]:
        assert 330 < step["v_sw_km_s"]["mean"] < 470
        assert 3 < step["v_sw_km_s"]["sd"] < 40
    assert abs(found["field_line"]["apart_deg"]) < 8
    assert found["flags"] == []
    assert len(json.dumps(found)) < 5000


@pytest.mark.parametrize("phi0_deg", [-179.0, -30.0, 0.0, 178.0])
def test_line_of_a_wind_of_one_speed_is_the_spiral_of_that_speed(phi0_deg: float) -> None:
    found, in_situ = constant(400.0)
    # 400 km/s at 30 solar radii grows by some 5 % to the middle of a track that ends at 70
    spiral = replace(SPIRAL, phi0_deg=phi0_deg, range_rsun=np.linspace(30.0, 70.0, 41))

    line = wind_companion(found, in_situ, spiral)["field_line"]

    assert line["through_rsun"] == 50.0
    assert 0 < -line["apart_deg"] < 0.6
    assert line["rms_deg"] < 0.6
    assert -180 <= line["phi0_deg"]["mean"] <= 180


def test_the_error_of_a_line_behind_the_sun_is_that_of_one_before_it() -> None:
    found, in_situ = constant(400.0)
    # lines of the drawn winds meet the inner boundary on either side of 180 degrees
    line = wind_companion(found, in_situ, replace(SPIRAL, phi0_deg=-170.0))["field_line"]
    assert 1 < line["phi0_deg"]["sd"] < 5


def test_a_slower_wind_starts_further_west() -> None:
    slow, fast = (longitude_at_sun_deg(constant(speed)[0].wind, SPIRAL, 25.38) for speed in (320.0, 500.0))
    assert slow > fast + 5


def test_drawn_winds_scatter_as_their_posterior(measured: tuple[WindAssimilation, InSitu]) -> None:
    found, _ = measured
    inner = np.array([wind.speed_km_s[0] for wind in drawn_winds(found, 400, seed=2)])
    np.testing.assert_allclose(inner.std(axis=0), found.boundary_sd_km_s, rtol=0.2)
    np.testing.assert_allclose(inner.mean(axis=0), found.boundary_km_s, atol=8.0)


def test_without_a_track_in_the_wind_there_is_still_a_wind() -> None:
    near = replace(SPIRAL, range_rsun=np.linspace(3.0, 12.0, 10))
    for spiral, reason in ((near, "no source is between 30 and 240"), (None, "no joint fit")):
        found = wind_companion(*constant(400.0), spiral)
        assert found["along_track"] == []
        assert reason in found["field_line"]["reason"]
        assert found["observatories"][0]["v_sw_km_s"]["mean"] == pytest.approx(460, abs=5)


def test_connections_take_the_measured_speed_where_there_is_one() -> None:
    draws = 30.0 + np.random.default_rng(1).standard_normal(500)
    wind, ahead = footpoint_companion(draws, AROUND, ("WIND", "STEREO-A"), {"WIND": 649.0})["connections"]
    assert (wind["v_sw_km_s"], wind["measured"]) == (649.0, True)
    assert (ahead["v_sw_km_s"], ahead["measured"]) == (400.0, False)
    assert wind["connection_angle_deg"]["mean"] < wind["at_600_km_s_deg"]

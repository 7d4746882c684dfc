"""Footpoint and connections as they are stored."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bella.solar_wind import connection_angles, footpoint, footpoint_companion

BURST = np.datetime64("2012-06-07T19:30", "ns")
SCATTER = np.random.default_rng(1).standard_normal(4000)


def test_intervals_are_those_of_the_draws_in_both_systems() -> None:
    found = footpoint_companion(30.0 + 4.0 * SCATTER, BURST, ("WIND",))
    for name in ("stonyhurst", "carrington"):
        place = found[name]
        assert place["sd"] == pytest.approx(4.0, rel=0.03)
        assert place["q84"] - place["q16"] == pytest.approx(2 * 0.994 * 4.0, rel=0.05)
        assert place["q97_5"] - place["q2_5"] == pytest.approx(2 * 1.96 * 4.0, rel=0.05)
    apart = found["carrington"]["mean"] - found["stonyhurst"]["mean"]
    assert apart == pytest.approx(182.6, abs=0.2), "Carrington longitude of the central meridian at that time"


@given(st.floats(-180.0, 180.0))
def test_intervals_do_not_jump(phi0_deg: float) -> None:
    found = footpoint_companion(phi0_deg + 4.0 * SCATTER, BURST, ())
    for name in ("stonyhurst", "carrington"):
        ladder = [found[name][end] for end in ("q2_5", "q16", "q50", "q84", "q97_5")]
        assert ladder == sorted(ladder)
        assert ladder[0] < found[name]["mean"] < ladder[-1]
        assert ladder[-1] - ladder[0] < 20.0


def test_a_slow_wind_connects_further_west_and_agrees_with_the_table() -> None:
    draws = 30.0 + 4.0 * SCATTER
    (one,) = footpoint_companion(draws, BURST, ("WIND",))["connections"]
    table = connection_angles(footpoint(draws, BURST), {"WIND": 400.0})
    assert one["connection_angle_deg"]["mean"] == table["connection_angle_deg"][0]
    assert one["connection_angle_deg"]["sd"] == table["connection_angle_sd_deg"][0]
    assert one["at_600_km_s_deg"] < one["connection_angle_deg"]["mean"] < one["at_300_km_s_deg"]


def test_an_unknown_spacecraft_takes_nothing_from_the_others() -> None:
    known, unknown = footpoint_companion(30.0 + SCATTER, BURST, ("STEREO-A", "VOYAGER"))["connections"]
    assert known["flags"] == []
    assert unknown["flags"] == ["not_computed"]
    assert "VOYAGER" in unknown["reason"]


def test_connections_take_the_measured_speed_where_there_is_one() -> None:
    wind, ahead = footpoint_companion(30.0 + SCATTER, BURST, ("WIND", "STEREO-A"), {"WIND": 649.0})["connections"]
    assert (wind["v_sw_km_s"], wind["measured"]) == (649.0, True)
    assert (ahead["v_sw_km_s"], ahead["measured"]) == (400.0, False)
    assert wind["connection_angle_deg"]["mean"] < wind["at_600_km_s_deg"]

"""The paragraph that says where a burst was, and how sure that is."""

from typing import Any

import pytest

from api.summary_section import RESTS_ON, summary_words

PHI0 = {"mean": -28.6, "sd": 6.6, "q16": -35.2, "q50": -28.7, "q84": -21.8, "q2_5": -41.3, "q97_5": -15.3}
WIND = {"mean": 440.3, "sd": 93.1, "q16": 350.0, "q50": 430.2, "q84": 540.0, "q2_5": 309.6, "q97_5": 673.0}
FUSED = {
    "phi0_deg": {"mean": -29.6, "sd": 5.5},
    "v_sw_km_s": {"mean": 420.0, "sd": 64.6},
    "flags": [],
    "ingredients": [{"name": "arrival_times"}, {"name": "wave_directions"}, {"name": "wind_prior"}],
}


def track(**more: Any) -> dict[str, Any]:
    """Track with a joint fit, and what stands beside it."""
    return {"joint": {"phi0_deg": PHI0, "v_sw_km_s": WIND, "flags": more.pop("flags", [])}, "companions": more}


def row(frequency_mhz: float, range_rsun: float | None, sd: float | None) -> dict[str, Any]:
    """Distance at a frequency."""
    return {"frequency_mhz": frequency_mhz, "range_rsun": range_rsun, "range_sd_rsun": sd}


def test_distances_are_those_of_the_highest_and_lowest_frequency_that_have_one() -> None:
    rows = [row(0.15, 150.6, 11.2), row(0.5, 36.0, 10.0), row(1.0, 20.4, 10.6), row(2.0, 60.0, 61.0)]
    words = summary_words("Half-rise edge", track(density_excess={"rows": rows}))
    assert words.startswith(
        "Timed by its half-rise edge, the burst appears 20 (10 to 31) R☉ from the Sun at 1 MHz and 151 ("
    )
    assert "appears" not in summary_words("Half-rise edge", track(density_excess={"rows": [row(2.0, None, None)]}))


def test_longitude_and_wind_have_their_errors_and_what_they_rest_on() -> None:
    words = summary_words("Gauss-Hermite edge", track(fused=FUSED))
    minus = "\N{MINUS SIGN}"
    assert f"at {minus}29° (68 %: {minus}35 to {minus}22°, 95 %: {minus}41 to {minus}15°), in a wind of 430 (" in words
    assert (
        f"With wave directions and the wind measured in situ: {minus}30°, in a wind of 420 (355 to 485) km/s." in words
    )
    assert words.endswith(RESTS_ON)


@pytest.mark.parametrize("flag", ["several_tracks", "poor_fit"])
def test_errors_that_do_not_hold_are_not_said_to_hold(flag: str) -> None:
    assert RESTS_ON not in summary_words("Half-rise edge", track(flags=[flag]))


def test_no_wind_is_given_where_there_is_no_spiral() -> None:
    words = summary_words("Half-rise edge", track(flags=["not_a_spiral"]))
    assert "km/s" not in words
    assert "no speed of the wind follows" in words


def test_nothing_is_said_without_a_joint_fit() -> None:
    unfitted = {"joint": {"phi0_deg": {"mean": None}, "flags": ["too_few_frequencies"]}}
    assert summary_words("Half-rise edge", {}) == summary_words("Half-rise edge", unfitted) == ""

"""Wave directions and the fused fit in words, on the page where there are any."""

from collections.abc import Callable
from typing import Any

import pytest

from api.direction_section import crossing_words, fused_words
from api.track_section import fits_of

ROW = {
    "frequency_mhz": 0.375,
    "observatories": ["STEREO-A", "STEREO-B"],
    "range_rsun": 48.4,
    "range_sd_rsun": 20.3,
    "longitude_deg": -73.8,
    "flags": [],
}
ADDED = {"chi2": 18.8, "number": 130, "sd_ratio": {"phi0_deg": 0.98, "v_sw_km_s": 0.99}, "tension": 0.3}


def test_sources_are_read_as_distance_and_longitude() -> None:
    hidden = ROW | {"range_rsun": None, "flags": ["parallel_lines"]}
    words = crossing_words({"triangulation": {"rows": [ROW, hidden, ROW | {"flags": ["behind_spacecraft"]}]}})
    assert "STEREO-A, STEREO-B" in words
    assert "0.38 MHz at 48 ± 20 R☉, \N{MINUS SIGN}74°" in words
    assert words.count("MHz") == 2
    assert "(behind a spacecraft)" in words


@pytest.mark.parametrize("words", [crossing_words, fused_words])
def test_nothing_is_said_where_nothing_is_known(words: Callable[[dict[str, Any]], str]) -> None:
    reason = {"flags": ["not_computed"], "reason": "no directions"}
    assert words({}) == words({"triangulation": reason, "fused": reason}) == ""


def test_each_ingredient_says_what_it_adds_and_whether_it_contradicts() -> None:
    times = ADDED | {"name": "arrival_times", "sd_ratio": {}}
    words = fused_words({"fused": {"ingredients": [times, ADDED | {"name": "wave_directions", "tension": 4.2}]}})
    assert "Arrival times: χ² 19 of 130; without them there is no track." in words
    assert "Wave directions: χ² 19 of 130, errors over those without: longitude 0.98, wind 0.99" in words
    assert words.count("contradict") == 1


def test_the_column_of_the_fused_fit_is_there_where_there_is_one() -> None:
    track = {"joint": {"phi0_deg": 1}, "companions": {"fused": {"flags": ["not_computed"]}, "semp": {"flags": []}}}
    assert list(fits_of(track)) == ["joint", "semp"]
    track["companions"]["fused"] = {"phi0_deg": {"mean": 1.0}}
    assert list(fits_of(track)) == ["joint", "fused", "semp"]

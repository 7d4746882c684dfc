"""Wave directions, the fused fit and other models in words, on the page where there are any."""

from collections.abc import Callable
from typing import Any

import pytest

from api.direction_section import crossing_words, fused_words
from api.model_section import PLAIN, model_words
from api.track_section import fits_of
from bella.tracks import TrackModel

ROW = {
    "frequency_mhz": 0.375,
    "observatories": ["STEREO-A", "STEREO-B"],
    "range_rsun": 48.4,
    "range_sd_rsun": 20.3,
    "longitude_deg": -73.8,
    "flags": [],
}
ADDED = {"name": "wave_directions", "sd_ratio": {"phi0_deg": 0.98, "v_sw_km_s": 0.99}, "tension": 0.3}


def test_sources_are_read_as_distance_and_longitude() -> None:
    hidden = ROW | {"range_rsun": None, "flags": ["parallel_lines"]}
    words = crossing_words({"triangulation": {"rows": [ROW, hidden, ROW | {"flags": ["behind_spacecraft"]}]}})
    assert "STEREO-A, STEREO-B" in words
    assert "0.38 MHz at 48 (28 to 69) R☉, \N{MINUS SIGN}74°" in words
    assert words.count("MHz") == 2
    assert "(behind a spacecraft)" in words


@pytest.mark.parametrize("words", [crossing_words, fused_words, model_words])
def test_nothing_is_said_where_nothing_is_known(words: Callable[[dict[str, Any]], str]) -> None:
    reason = {"flags": ["not_computed"], "reason": "no directions"}
    assert words({}) == words({"triangulation": reason, "fused": reason, "models": reason}) == ""


def test_each_ingredient_says_what_it_adds_and_whether_it_contradicts() -> None:
    wind = {"name": "wind_prior", "sd_ratio": {"phi0_deg": 0.61, "v_sw_km_s": 0.27}, "tension": 4.2}
    words = fused_words({"fused": {"ingredients": [ADDED, wind]}})
    directions, measured = words.split(" With the ")
    assert "wave directions the 68 % interval of the longitude is 0.98 times and that of the wind 0.99" in directions
    assert directions.endswith("by 0.3 standard deviations.")
    assert "measured wind the 68 % interval of the longitude is 0.61 times and that of the wind 0.27" in measured
    assert measured.endswith("by 4.2 standard deviations. They contradict the others.")


def test_the_column_of_the_fused_fit_is_there_where_there_is_one() -> None:
    track = {"joint": {"phi0_deg": 1}, "companions": {"fused": {"flags": ["not_computed"]}, "semp": {"flags": []}}}
    assert list(fits_of(track)) == ["joint", "semp"]
    track["companions"]["fused"] = {"phi0_deg": {"mean": 1.0}}
    assert list(fits_of(track)) == ["joint", "fused", "semp"]


def test_models_that_the_times_ask_for_are_named_and_averaged() -> None:
    speed = {"mean": 410.0, "sd": 80.0}
    numbers = {"phi0_deg": {"mean": 30.0, "sd": 5.0}, "v_sw_km_s": speed, "flags": [], "winds": []}
    parts = [
        {"from_rsun": 1.0, "to_rsun": 31.0, "v_sw_km_s": speed},
        {"from_rsun": 31.0, "to_rsun": None, "v_sw_km_s": {"mean": 600.0, "sd": 50.0}},
    ]
    headline = "free distance, free time of emission"
    rows = [
        {"name": "free distance, beam that slows down", "probability": 0.5} | numbers,
        {"name": headline, "probability": 0.25} | numbers | {"flags": ["v_sw_not_constrained"]},
        {"name": f"{headline}, wind changes at 31 R_sun", "probability": 0.2} | numbers | {"winds": parts},
        {"name": "distance a power of frequency, beam of constant speed", "probability": 0.05} | numbers,
    ]
    words = model_words({"models": {"rows": rows, "phi0_deg": {"mean": 29.0, "sd": 6.0}}})
    assert "beam that slows down 50%, 30.0 (25.0 to 35.0)°, 410 (330 to 490) km/s; as the joint fit has it 25%" in words
    assert "as the joint fit has it 25%, 30.0 (25.0 to 35.0)°, not measured; wind changes" in words
    assert (
        "wind changes at 31 R_sun 20%, 30.0 (25.0 to 35.0)°, 410 (330 to 490) km/s, "
        "then 600 (550 to 650) km/s beyond 31 R☉."
    ) in words
    assert "power of frequency" not in words
    assert words.endswith("the longitude is 29.0 (23.0 to 35.0)°.")


def test_the_name_of_the_headline_is_that_of_the_fit() -> None:
    assert TrackModel().name == PLAIN

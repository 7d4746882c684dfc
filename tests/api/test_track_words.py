"""What the page of a burst says of a track follows from the numbers it is about."""

import re
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from api.pages.track import PLAIN_MODEL, facts_of, fits_of
from api.rendering import DASH, environment
from bella.catalogue import Catalogue
from bella.plotting.svg import figure as drawn
from bella.tracks import TrackModel
from tests.api.published import published, settings_of
from tests.plotting.synthetic import BURST_ID, synthetic_track_fit

MINUS = "\N{MINUS SIGN}"
RESTS_ON = "The errors hold if one beam on one spiral is what happened, and if its waves came straight."
PHI0 = {"mean": -28.6, "sd": 6.6, "q16": -35.2, "q50": -28.7, "q84": -21.8, "q2_5": -41.3, "q97_5": -15.3}
WIND_SPEED = {"mean": 440.3, "sd": 93.1, "q16": 350.0, "q50": 430.2, "q84": 540.0, "q2_5": 309.6, "q97_5": 673.0}
FUSED = {
    "phi0_deg": {"mean": -29.6, "sd": 5.5},
    "v_sw_km_s": {"mean": 420.0, "sd": 64.6},
    "flags": [],
    "ingredients": [
        {"name": "arrival_times"},
        {"name": "wave_directions", "sd_ratio": {"phi0_deg": 0.98, "v_sw_km_s": 0.99}, "tension": 0.3},
        {"name": "wind_prior", "sd_ratio": {"phi0_deg": 0.61, "v_sw_km_s": 0.27}, "tension": 4.2},
    ],
}
WIND = {
    "days": 27.3,
    "boundary": {"range_rsun": 30.0, "v_sw_km_s": [350.0] * 8, "sd_km_s": [20.0] * 8},
    "observatories": [
        {
            "observatory": "WIND",
            "measured_km_s": 649.0,
            "v_sw_km_s": {"mean": 594.3, "sd": 8.6},
            "prior_rmse_km_s": 107.6,
            "rmse_km_s": 34.6,
        },
        {
            "observatory": "PSP",
            "measured_km_s": None,
            "v_sw_km_s": {"mean": None, "sd": None},
            "prior_rmse_km_s": 107.6,
            "rmse_km_s": 34.6,
        },
    ],
    "along_track": [
        {"range_rsun": distance, "v_sw_km_s": {"mean": 300.0 + distance, "sd": 10.0}}
        for distance in (30.0, 100.0, 150.0)
    ],
    "field_line": {"through_rsun": 61.4, "phi0_deg": {"mean": 31.8, "sd": 0.8}, "apart_deg": 2.9, "flags": []},
    "left_out": ["left out: sta.lst cannot be read"],
    "flags": [],
}
REGIONS = {
    "rows": [
        {"kind": "coronal hole", "name": "CH1", "longitude_deg": 33.9, "probability": 0.986, "matches": True},
        {"kind": "active region", "name": "11494", "longitude_deg": -15.5, "probability": 0.014, "matches": False},
    ],
    "left_out": [],
    "flags": [],
}
ROW = {
    "frequency_mhz": 0.375,
    "observatories": ["STEREO-A", "STEREO-B"],
    "range_rsun": 48.4,
    "range_sd_rsun": 20.3,
    "longitude_deg": -73.8,
    "flags": [],
}


def said(name: str, *values: Any) -> str:
    """What a macro of the template says, in one line of plain text."""
    html = str(getattr(environment().get_template("track_words.html").module, name)(*values))
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html)).strip()


def track(**more: Any) -> dict[str, Any]:
    """Track with a joint fit, and what stands beside it."""
    return {"joint": {"phi0_deg": PHI0, "v_sw_km_s": WIND_SPEED, "flags": more.pop("flags", [])}, "companions": more}


def summary(edge: str, one: dict[str, Any]) -> str:
    return said("summary", edge, one, facts_of(one))


def row(frequency_mhz: float, range_rsun: float | None, sd: float | None) -> dict[str, Any]:
    return {"frequency_mhz": frequency_mhz, "range_rsun": range_rsun, "range_sd_rsun": sd}


def test_distances_are_those_of_the_highest_and_lowest_frequency_that_have_one() -> None:
    rows = [row(0.15, 150.6, 11.2), row(0.5, 36.0, 10.0), row(1.0, 20.4, 10.6), row(2.0, 60.0, 61.0)]
    words = summary("Half-rise edge", track(density_excess={"rows": rows}))
    assert words.startswith(
        "Timed by its half-rise edge, the burst appears 20 (10 to 31) R☉ from the Sun at 1 MHz and 151 ("
    )
    assert "appears" not in summary("Half-rise edge", track(density_excess={"rows": [row(2.0, None, None)]}))


def test_longitude_and_wind_have_their_errors_and_what_they_rest_on() -> None:
    words = summary("Gauss-Hermite edge", track(fused=FUSED))
    assert f"at {MINUS}29° (68 %: {MINUS}35 to {MINUS}22°, 95 %: {MINUS}41 to {MINUS}15°), in a wind of 430 (" in words
    assert (
        f"With wave directions and the wind measured in situ: {MINUS}30°, in a wind of 420 (355 to 485) km/s." in words
    )
    assert words.endswith(RESTS_ON)


@pytest.mark.parametrize("flag", ["several_tracks", "poor_fit"])
def test_errors_that_do_not_hold_are_not_said_to_hold(flag: str) -> None:
    assert RESTS_ON not in summary("Half-rise edge", track(flags=[flag]))


def test_no_wind_is_given_where_there_is_no_spiral() -> None:
    words = summary("Half-rise edge", track(flags=["not_a_spiral"]))
    assert "km/s" not in words
    assert "no speed of the wind follows" in words


def test_nothing_is_said_where_nothing_is_known() -> None:
    unfitted = {"joint": {"phi0_deg": {"mean": None}, "flags": ["too_few_frequencies"]}}
    assert summary("Half-rise edge", {}) == summary("Half-rise edge", unfitted) == ""
    reason = {"flags": ["not_computed"], "reason": "no directions"}
    empty = track(triangulation=reason, fused=reason, models=reason)
    for one in (track(), empty):
        facts = facts_of(one)
        assert said("crossings", facts) == said("ingredients", one, facts) == said("models", one, facts) == ""
        assert said("measured_wind", one, facts) == ""


def test_crossings_are_read_as_distance_and_longitude() -> None:
    hidden = ROW | {"range_rsun": None, "flags": ["parallel_lines"]}
    rows = [ROW, hidden, ROW | {"flags": ["behind_spacecraft"]}]
    words = said("crossings", facts_of(track(triangulation={"rows": rows})))
    assert "STEREO-A, STEREO-B" in words
    assert f"0.38 MHz at 48 (28 to 69) R☉, {MINUS}74°" in words
    assert words.count("MHz") == 2
    assert "(behind a spacecraft)" in words


def test_each_ingredient_says_what_it_adds_and_whether_it_contradicts() -> None:
    one = track(fused=FUSED)
    directions, measured = said("ingredients", one, facts_of(one)).split(" With the ")
    assert "wave directions the 68 % interval of the longitude is 0.98 times and that of the wind 0.99" in directions
    assert directions.endswith("by 0.3 standard deviations.")
    assert "measured wind the 68 % interval of the longitude is 0.61 times and that of the wind 0.27" in measured
    assert measured.endswith("by 4.2 standard deviations. They contradict the others.")


def test_the_column_of_the_fused_fit_is_there_where_there_is_one() -> None:
    one = {"joint": {"phi0_deg": 1}, "companions": {"fused": {"flags": ["not_computed"]}, "semp": {"flags": ["x"]}}}
    assert list(fits_of(one)) == ["joint", "semp"]
    one["companions"]["fused"] = {"phi0_deg": {"mean": 1.0}}
    assert list(fits_of(one)) == ["joint", "fused", "semp"]


def test_models_that_the_times_ask_for_are_named_and_averaged() -> None:
    speed = {"mean": 410.0, "sd": 80.0}
    numbers = {"phi0_deg": {"mean": 30.0, "sd": 5.0}, "v_sw_km_s": speed, "flags": [], "winds": []}
    parts = [
        {"from_rsun": 1.0, "to_rsun": 31.0, "v_sw_km_s": speed},
        {"from_rsun": 31.0, "to_rsun": None, "v_sw_km_s": {"mean": 600.0, "sd": 50.0}},
    ]
    rows = [
        {"name": "free distance, beam that slows down", "probability": 0.5} | numbers,
        {"name": PLAIN_MODEL, "probability": 0.25} | numbers | {"flags": ["v_sw_not_constrained"]},
        {"name": f"{PLAIN_MODEL}, wind changes at 31 R_sun", "probability": 0.2} | numbers | {"winds": parts},
        {"name": "distance a power of frequency, beam of constant speed", "probability": 0.05} | numbers,
    ]
    one = track(models={"rows": rows, "phi0_deg": {"mean": 29.0, "sd": 6.0}})
    words = said("models", one, facts_of(one))
    assert "beam that slows down 50 %, 30.0 (25.0 to 35.0)°, 410 (330 to 490) km/s; as the joint fit has it 25" in words
    assert "as the joint fit has it 25 %, 30.0 (25.0 to 35.0)°, not measured; wind changes" in words
    assert (
        "wind changes at 31 R_sun 20 %, 30.0 (25.0 to 35.0)°, 410 (330 to 490) km/s, "
        "then 600 (550 to 650) km/s beyond 31 R☉."
    ) in words
    assert "power of frequency" not in words
    assert words.endswith("the longitude is 29.0 (23.0 to 35.0)°.")


def test_the_name_of_the_headline_is_that_of_the_fit() -> None:
    assert TrackModel().name == PLAIN_MODEL


@pytest.mark.parametrize(
    ("apart", "verdict"), [(2.9, "3° west of the spiral, within"), (-20.0, "20° east of the spiral, more than")]
)
def test_field_line_is_compared_with_the_errors(apart: float, verdict: str) -> None:
    line = WIND["field_line"] | {"apart_deg": apart}  # type: ignore[operator]
    one = track(wind=WIND | {"field_line": line})
    assert verdict in said("measured_wind", one, facts_of(one))


def test_track_inside_the_wind_has_no_field_line() -> None:
    line = {"flags": ["not_computed"], "reason": "no source is between 30 and 240 solar radii"}
    one = track(wind=WIND | {"along_track": [], "field_line": line})
    words = said("measured_wind", one, facts_of(one))
    assert words == "No field line: no source is between 30 and 240 solar radii."


def test_footpoint_names_the_wind_of_each_connection_and_the_regions_near_it() -> None:
    foot = synthetic_track_fit("gauss_hermite")["companions"]["footpoint"]
    foot["connections"][0] |= {"v_sw_km_s": 649.0, "measured": True}
    words = said("footpoint", foot | {"regions": REGIONS})
    assert "WIND 33 649 km/s, measured 12 53" in words
    assert "VOYAGER not known" in words
    assert f"coronal hole CH1 at 34°, 0.99; active region 11494 at {MINUS}16°, 0.01, outside the 95 % interval" in words
    assert said("footpoint", {"reason": "no longitude"}) == "Not computed: no longitude."
    assert "coronal hole" not in said("footpoint", foot)


def test_page_and_api_show_the_wind(tmp_path: Path) -> None:
    settings, fit = settings_of(tmp_path / "home"), synthetic_track_fit("gauss_hermite")
    fit["companions"]["wind"] = WIND
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        solution = published(settings, catalogue, edge="gauss_hermite", track_fit=fit)
    figure = settings.solution_figure(solution.burst_id, solution.solution_id, "wind")
    figure.parent.mkdir(parents=True)
    figure.write_text(drawn("wind-map", (10, 10), "drawing of the wind"))
    with TestClient(create_app(settings), raise_server_exceptions=False) as client:
        text = client.get(f"/bursts/{BURST_ID}", headers={"accept": "text/html"}).text
        for words in (
            "330 (320 to 340) km/s at 30 R☉, 400 (390 to 410) km/s at 100 R☉, 450 (440 to 460) km/s at 150 R☉",
            "meets the Sun at 32°, 3° west of the spiral, within what their errors allow",
            "Left out: sta.lst cannot be read.",
        ):
            assert words in text, words
        rows = {
            name: re.findall(r">([^<]+)</td>", cells)
            for name, cells in re.findall(r'<th scope="row">(WIND|PSP)</th>(<td.*?)</tr>', text)
        }
        assert rows["WIND"] == ["649", "594 (586 to 603)", "108 → 35"]
        assert rows["PSP"][:2] == [DASH] * 2
        (address,) = re.findall(r'href="(/api/v1/solutions/[^"]+/figures/wind.svg)"', text)
        assert "drawing of the wind" in text
        assert "the field line of this wind" in client.get(address).text.replace("</text>", " ")
        track = client.get(f"/api/v1/bursts/{BURST_ID}/track").json()["track_fit"]
        assert track["companions"]["wind"] == WIND
    assert said("in_situ", {"reason": "set BELLA_IN_SITU"}) == "Not computed: set BELLA_IN_SITU."

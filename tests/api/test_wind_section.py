"""Measured wind and regions on the burst page and in the API."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from api.wind_section import footpoint_words, track_wind_words, wind_table
from bella.catalogue import Catalogue
from tests.api.published import published, settings_of
from tests.plotting.synthetic import BURST_ID, synthetic_track_fit

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


def track_with(**companions: Any) -> dict[str, Any]:
    """Synthetic track with more beside it; what stands there already is added to."""
    track = synthetic_track_fit("gauss_hermite")
    for name, one in companions.items():
        track["companions"][name] = track["companions"].get(name, {}) | one
    return track


@pytest.fixture
def page_of(tmp_path: Path) -> Callable[[dict[str, Any]], tuple[str, TestClient]]:
    """Page, and its application, of a burst with one solution that has this track and a map of the wind."""

    def _page(track: dict[str, Any]) -> tuple[str, TestClient]:
        settings = settings_of(tmp_path / "home")
        with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
            solution = published(settings, catalogue, edge="gauss_hermite", track_fit=track)
        figure = settings.fit_figure(solution.burst_id, solution.solution_id, "wind")
        figure.parent.mkdir(parents=True)
        figure.write_bytes(b"\x89PNG\r\n\x1a\n")
        client = TestClient(create_app(settings), raise_server_exceptions=False)
        return client.get(f"/bursts/{BURST_ID}", headers={"accept": "text/html"}).text, client

    return _page


def test_page_and_api_show_the_wind(page_of: Callable[[dict[str, Any]], tuple[str, TestClient]]) -> None:
    text, client = page_of(track_with(wind=WIND, footpoint={"regions": REGIONS}))
    for words in (
        "330 (320 to 340) km/s at 30 R☉, 400 (390 to 410) km/s at 100 R☉, 450 (440 to 460) km/s at 150 R☉",
        "meets the Sun at 32°, 3° west of the spiral, within what their errors allow",
        "coronal hole CH1 at 34°, 0.99; active region 11494 at −16°, 0.01, outside the 95 % interval",  # noqa: RUF001
        '<tr><th scope="row">WIND</th><td class="value">649</td><td class="value">594 (586 to 603)</td>',
        '<td class="value">108 → 35</td>',
        '<tr><th scope="row">PSP</th><td class="value">–</td><td class="value">–</td>',  # noqa: RUF001
        "Left out: sta.lst cannot be read.",
    ):
        assert words in text, words
    (address,) = re.findall(r'<img src="(/api/[^"]+/figures/wind)"', text)
    assert client.get(address).headers["content-type"] == "image/png"
    track = client.get(f"/api/v1/bursts/{BURST_ID}/track").json()["track_fit"]
    assert track["companions"]["wind"] == WIND


def test_page_says_why_there_is_no_wind(page_of: Callable[[dict[str, Any]], tuple[str, TestClient]]) -> None:
    text, _ = page_of(track_with(wind={"flags": ["not_computed"], "reason": "set BELLA_IN_SITU"}))
    assert "Not computed: set BELLA_IN_SITU." in text
    assert "Measured wind</strong>" not in text


def test_solution_from_before_there_was_a_wind_says_nothing_of_it() -> None:
    track = synthetic_track_fit("gauss_hermite")
    assert wind_table([track]) is None
    assert track_wind_words(track) == ""
    assert "400 km/s, assumed" in footpoint_words(track["companions"]["footpoint"])


@pytest.mark.parametrize(
    ("apart", "verdict"), [(2.9, "3° west of the spiral, within"), (-20.0, "20° east of the spiral, more than")]
)
def test_field_line_is_held_against_the_errors(apart: float, verdict: str) -> None:
    line = WIND["field_line"] | {"apart_deg": apart}  # type: ignore[operator]
    assert verdict in track_wind_words(track_with(wind=WIND | {"field_line": line}))


def test_track_inside_the_wind_has_no_field_line() -> None:
    line = {"flags": ["not_computed"], "reason": "no source is between 30 and 240 solar radii"}
    said = track_wind_words(track_with(wind=WIND | {"along_track": [], "field_line": line}))
    assert said == "No field line: no source is between 30 and 240 solar radii."


def test_measured_speed_is_named_with_its_connection() -> None:
    foot = synthetic_track_fit("gauss_hermite")["companions"]["footpoint"]
    foot["connections"][0] |= {"v_sw_km_s": 649.0, "measured": True}
    assert "WIND 33° by 649 km/s, measured (12 to 53°)" in footpoint_words(foot)

"""The constellation says what the posterior says."""

import json
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from bella.plotting import TrackView, constellation_figure, selected_regions
from bella.units import AU_RSUN
from tests.plotting.synthetic import FREQUENCIES_MHZ, synthetic_posterior, synthetic_track_fit

EDGES = ("gauss_hermite", "half_maximum")


@pytest.fixture(scope="module")
def tracks() -> list[TrackView]:
    return [TrackView(f"{edge} edge", synthetic_posterior(edge), synthetic_track_fit(edge)) for edge in EDGES]


@pytest.fixture(scope="module")
def figure(tracks: list[TrackView]) -> dict[str, Any]:
    return constellation_figure(tracks)


def traces(figure: dict[str, Any], role: str, edge: str | None = None) -> list[dict[str, Any]]:
    members = [trace for trace in figure["data"] if trace["meta"]["role"] == role]
    return members if edge is None else [trace for trace in members if trace["meta"]["edge"] == edge]


def test_it_is_a_plotly_figure_that_any_json_reader_takes(figure: dict[str, Any]) -> None:
    text = json.dumps(figure, allow_nan=False)
    assert len(text) < 200_000
    assert len(go.Figure(json.loads(text)).data) == len(figure["data"])


def test_earth_is_to_the_right_and_both_axes_have_one_scale(figure: dict[str, Any]) -> None:
    layout = figure["layout"]
    assert layout["yaxis"]["scaleanchor"] == "x"
    assert layout["xaxis"]["range"] == layout["yaxis"]["range"]
    assert layout["xaxis"]["range"][0] < layout["xaxis"]["range"][1]
    (spacecraft,) = traces(figure, "spacecraft")
    where = {name: (x, y) for name, x, y in zip(spacecraft["text"], spacecraft["x"], spacecraft["y"], strict=True)}
    assert where["WIND"] == (216.0, 0.0)
    assert where["STEREO-A"][1] > 0 > where["STEREO-B"][1]


def test_every_spacecraft_and_ring_is_inside_the_view(figure: dict[str, Any]) -> None:
    reach = figure["layout"]["xaxis"]["range"][1]
    for trace in (*traces(figure, "spacecraft"), *traces(figure, "ring")):
        assert np.abs([*trace["x"], *trace["y"]]).max() < reach
    assert max(traces(figure, "ring")[-1]["x"]) == pytest.approx(AU_RSUN, abs=0.1)


def test_each_track_has_all_its_points_in_place(figure: dict[str, Any], tracks: list[TrackView]) -> None:
    for track in tracks:
        (points,) = traces(figure, "track", track.edge)
        np.testing.assert_allclose(points["x"], track.posterior["x_rsun"], atol=0.051)
        np.testing.assert_allclose(points["y"], track.posterior["y_rsun"], atol=0.051)


def test_tracks_differ_in_colour_and_in_marker(figure: dict[str, Any]) -> None:
    looks = [(trace["marker"]["color"], trace["marker"]["symbol"]) for trace in traces(figure, "legend")]
    assert len(looks) == 2
    assert len({colour for colour, _ in looks}) == 2
    assert len({symbol for _, symbol in looks}) == 2


def test_an_edge_looks_the_same_whatever_is_drawn_with_it(figure: dict[str, Any], tracks: list[TrackView]) -> None:
    alone = constellation_figure(tracks[1:])
    both = traces(figure, "legend", "half_maximum")[0]["marker"]
    assert traces(alone, "legend", "half_maximum")[0]["marker"] == both


def test_hover_says_frequency_place_errors_area_and_that_the_speed_is_not_measured(figure: dict[str, Any]) -> None:
    (points,) = traces(figure, "track", "gauss_hermite")
    nearest = points["text"][-1]
    assert nearest.startswith("2 MHz<br>12.0 (2.5 to 21.5) R☉")
    assert "longitude" in nearest
    assert "68 % area" in nearest
    assert nearest.endswith("speed not constrained (contraction 0.99)")


def test_regions_of_both_levels_lie_on_a_few_channels_and_around_their_points(figure: dict[str, Any]) -> None:
    for edge in EDGES:
        inner = [trace for trace in traces(figure, "region", edge) if trace["meta"]["percent"] == 68]
        outer = [trace for trace in traces(figure, "region", edge) if trace["meta"]["percent"] == 95]
        assert 4 <= len(inner) == len(outer) <= 8
        for small, large in zip(inner, outer, strict=True):
            assert small["meta"]["frequency_mhz"] == large["meta"]["frequency_mhz"]
            assert np.ptp(np.array(small["x"], dtype=float)) < np.ptp(np.array(large["x"], dtype=float))


def test_spiral_goes_through_the_track_it_was_fitted_to(figure: dict[str, Any]) -> None:
    for edge in EDGES:
        (spiral,) = traces(figure, "spiral", edge)
        (points,) = traces(figure, "track", edge)
        line = np.column_stack([spiral["x"], spiral["y"]])
        for point in np.column_stack([points["x"], points["y"]]):
            assert np.hypot(*(line - point).T).min() < 2.0


def test_a_track_without_a_fit_is_drawn_without_a_spiral() -> None:
    empty = {"phi0_deg": {"mean": None, "sd": None}, "v_sw_km_s": {"mean": None, "sd": None}}
    for fit in ({}, {"rotation_period_d": 25.38, "two_step": None}, {"rotation_period_d": 25.38, "two_step": empty}):
        figure = constellation_figure([TrackView("x", synthetic_posterior(), fit)])
        assert traces(figure, "spiral") == []
        assert len(traces(figure, "track")) == 1


def test_a_spiral_that_bends_the_wrong_way_claims_no_wind_speed() -> None:
    fit = {"rotation_period_d": 25.38, "two_step": {"phi0_deg": {"mean": 5.0}, "v_sw_km_s": {"mean": -900.0}}}
    (spiral,) = traces(constellation_figure([TrackView("x", synthetic_posterior(), fit)]), "spiral")
    assert "no solar wind speed" in spiral["hovertemplate"]
    assert "900" not in spiral["hovertemplate"]


def test_without_tracks_the_sun_stands_alone() -> None:
    figure = constellation_figure([])
    assert traces(figure, "track") == []
    assert len(traces(figure, "sun")) == 1
    go.Figure(figure)


def test_missing_numbers_become_none() -> None:
    posterior = synthetic_posterior().copy(deep=True)
    posterior["x_rsun"][3] = np.nan
    posterior["area68_rsun2"][3] = np.nan
    posterior["receiver_rsun"][5] = np.nan
    figure = constellation_figure([TrackView("x", posterior, synthetic_track_fit())])
    json.dumps(figure, allow_nan=False)
    assert traces(figure, "track")[0]["x"][3] is None


def test_one_frequency_makes_a_figure() -> None:
    figure = constellation_figure([TrackView("x", synthetic_posterior(frequencies=np.array([1.0])), {})])
    assert len(traces(figure, "region")) == 2


def test_selected_regions_are_those_of_the_nearest_channel() -> None:
    posterior = synthetic_posterior()
    chosen = selected_regions(posterior, 0.5)
    index = int(np.abs(np.log(FREQUENCIES_MHZ / 0.5)).argmin())
    assert chosen["frequency_mhz"] == pytest.approx(FREQUENCIES_MHZ[index], rel=1e-4)
    assert chosen["range_rsun"] == pytest.approx(
        float(np.hypot(posterior["x_rsun"], posterior["y_rsun"])[index]), abs=0.01
    )
    assert chosen["area95_rsun2"] > chosen["area68_rsun2"]
    assert None not in chosen["region68"]["x"]
    assert chosen["region95"]["x"][0] == chosen["region95"]["x"][-1]


def test_polygons_of_one_region_stay_apart() -> None:
    posterior = synthetic_posterior().copy(deep=True)
    outline = posterior["region68"][0].to_numpy().copy()
    outline[30] = np.nan
    posterior["region68"][0] = outline
    chosen = selected_regions(posterior, 0.01)
    assert chosen["region68"]["x"].count(None) == 1
    assert chosen["region68"]["x"][30] is None

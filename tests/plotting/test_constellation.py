"""The constellation says what the posterior says."""

import numpy as np
import pytest

from bella.heliosphere import spiral_longitude_deg
from bella.plotting import MapView, TrackView, constellation_figure, selected_regions, thumbnail
from bella.plotting.constellation import SCALE_ROOM, SIZE
from bella.records import Interval
from bella.spacecraft import hee_to, position
from bella.units import AU_RSUN
from tests.plotting.reading import of_class, parsed, points, texts
from tests.plotting.synthetic import FREQUENCIES_MHZ, RECEIVERS, synthetic_posterior, synthetic_track_fit

EDGES = ("gauss_hermite", "half_maximum")
UTC = np.datetime64("2012-06-07T19:29:00", "ns")
FLEET = MapView(view="fleet")


@pytest.fixture(scope="module")
def tracks() -> list[TrackView]:
    return [TrackView(f"{edge} edge", synthetic_posterior(edge), synthetic_track_fit(edge)) for edge in EDGES]


def to_hee(root, places: np.ndarray) -> np.ndarray:
    """Solar radii of places on a map, by what the map says of itself."""
    centre = np.array([float(one) for one in root.get("data-centre").split(",")])
    width, height = (float(one) for one in root.get("viewBox").split()[2:])
    return centre + (places - [width / 2, height / 2]) * [1, -1] / float(root.get("data-per-rsun"))


def test_earth_is_to_the_right_and_the_spacecraft_where_they_were(tracks: list[TrackView]) -> None:
    root = parsed(constellation_figure(tracks, UTC, FLEET))
    (earth,) = of_class(root, "earth")
    where = to_hee(root, np.array([[float(earth.get("cx")), float(earth.get("cy"))]]))[0]
    np.testing.assert_allclose(where, position("EARTH", UTC)[0][:2], atol=0.3)
    crafts = to_hee(root, np.array([points(one).mean(axis=0) for one in of_class(root, "craft")]))
    for name in ("STEREO-A", "STEREO-B"):
        reach, angle = RECEIVERS[name]
        wanted = reach * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        assert np.hypot(*(crafts - wanted).T).min() < 1.5
    assert texts(root, "craft-label") == ["Earth, WIND", "STEREO-A", "STEREO-B"]


def test_the_first_view_is_what_the_track_needs_and_the_sun(tracks: list[TrackView]) -> None:
    near, far = (parsed(constellation_figure(tracks[:1], UTC, look)) for look in (MapView(), FLEET))
    assert float(near.get("data-per-rsun")) > 1.5 * float(far.get("data-per-rsun"))
    width, height = (float(one) for one in near.get("viewBox").split()[2:])
    inner = [points(one) for one in of_class(near, "region p68")]
    (sun,) = of_class(near, "sun")
    for x, y in [*np.vstack(inner), (float(sun.get("cx")), float(sun.get("cy")))]:
        assert 0 <= x <= width
        assert 0 <= y <= height


def test_a_single_channel_far_out_does_not_decide_the_view(tracks: list[TrackView]) -> None:
    posterior = synthetic_posterior().copy(deep=True)
    posterior["x_rsun"][0] = 900.0
    posterior["region68"][0] = posterior["region68"][0] + 900.0
    fit = synthetic_track_fit()
    fit["joint"] = {**fit["joint"], "profile": [{"frequency_mhz": 0.2, "range_rsun": {"q84": 150.0}}]}
    wild = parsed(constellation_figure([TrackView("x", posterior, fit)], UTC, MapView()))
    calm = parsed(constellation_figure([TrackView("x", synthetic_posterior(), fit)], UTC, MapView()))
    assert float(wild.get("data-per-rsun")) == pytest.approx(float(calm.get("data-per-rsun")), rel=0.1)


def test_each_channel_has_its_dot_in_place_and_says_its_numbers(tracks: list[TrackView]) -> None:
    root = parsed(constellation_figure(tracks[:1], UTC, MapView()))
    dots = [one for one in root.iter() if one.get("data-mhz")]
    frequencies = [float(one.get("data-mhz")) for one in dots]
    np.testing.assert_allclose(frequencies, FREQUENCIES_MHZ, rtol=1e-4)
    where = to_hee(root, np.array([[float(one.get("cx")), float(one.get("cy"))] for one in dots]))
    np.testing.assert_allclose(where[:, 0], tracks[0].posterior["x_rsun"], atol=0.1)
    np.testing.assert_allclose(where[:, 1], tracks[0].posterior["y_rsun"], atol=0.1)
    said = "".join(dots[-1].itertext())
    assert said.startswith("2 MHz: 12.0 (2.5 to 21.5) R☉, ")
    assert "68 % area" in said
    assert len({one.get("fill") for one in dots}) > 50


def test_regions_of_both_levels_lie_around_a_few_channels_and_the_chosen_one_stands_out(
    tracks: list[TrackView],
) -> None:
    root = parsed(constellation_figure(tracks[:1], UTC, MapView(frequency_mhz=0.5)))
    inner, outer = (of_class(root, f"region p{percent}") for percent in (68, 95))
    assert 4 <= len(inner) == len(outer) <= 8
    for small, large in zip(inner, outer, strict=True):
        assert np.ptp(points(small)[:, 0]) < np.ptp(points(large)[:, 0])
    (chosen,) = of_class(root, "selected p68")
    wanted = selected_regions(tracks[0].posterior, 0.5)["region68"]
    np.testing.assert_allclose(to_hee(root, points(chosen))[:, 0], wanted["x"], atol=0.1)
    plain = parsed(constellation_figure(tracks[:1], UTC, MapView()))
    assert [points(one).size for one in of_class(plain, "selected")] == [0, 0]


def test_other_answers_are_lines_in_the_colour_of_their_edge(tracks: list[TrackView]) -> None:
    root = parsed(constellation_figure(tracks, UTC, MapView()))
    (other,) = of_class(root, "track other")
    assert "edge-half_maximum" in other.get("class")
    assert len(of_class(root, "region edge-half_maximum")) == 0
    assert "Half-maximum" in texts(root, "other-label")


def test_the_grid_has_the_longitudes_of_the_frame_that_is_asked_for(tracks: list[TrackView]) -> None:
    for frame, label in (("hee", "30°W"), ("heeq", "30°W"), ("carrington", "210°")):
        root = parsed(constellation_figure(tracks, UTC, MapView(view="fleet", frame=frame)))
        (place,) = [one for one in of_class(root, "spoke-label") if one.text == label]
        x, y = to_hee(root, np.array([[float(place.get("x")), float(place.get("y")) - 4]]))[0]
        turned = hee_to(frame, np.array([[x, y, 0.0]]), UTC)[0]
        longitude = np.degrees(np.arctan2(turned[1], turned[0])) % 360
        assert longitude == pytest.approx(float(label.rstrip("°W")), abs=3.0)


def test_a_spiral_of_the_nominal_wind_goes_through_each_spacecraft(tracks: list[TrackView]) -> None:
    root = parsed(constellation_figure(tracks, UTC, FLEET))
    for one in of_class(root, "nominal"):
        line = to_hee(root, points(one))
        reach, angle = RECEIVERS[one.get("data-name")]
        assert np.hypot(*line[-1]) == pytest.approx(reach, abs=0.5)
        assert np.degrees(np.arctan2(line[-1, 1], line[-1, 0])) == pytest.approx(angle, abs=0.5)
        bent = np.degrees(np.arctan2(line[0, 1], line[0, 0])) - angle
        expected = -spiral_longitude_deg(np.array([reach]), 0.0, 400.0, 25.38)[0]
        assert bent % 360 == pytest.approx(expected % 360, abs=15.0)  # the first point is 3 pixels from the Sun


def test_longitudes_that_stay_open_are_sectors() -> None:
    look = MapView(view="fleet", sectors=[Interval(low=20.0, high=50.0, probability=0.4)])
    root = parsed(constellation_figure([], UTC, look))
    (sector,) = of_class(root, "sector")
    corners = to_hee(root, points(sector))
    angles = np.degrees(np.arctan2(corners[1:, 1], corners[1:, 0]))
    assert (angles.min(), angles.max()) == (pytest.approx(20.0, abs=0.3), pytest.approx(50.0, abs=0.3))
    assert np.hypot(*corners[1:].T) == pytest.approx(AU_RSUN, abs=0.5)


@pytest.mark.parametrize("fit", [{}, {"rotation_period_d": 25.38, "two_step": None, "joint": None}])
def test_a_track_without_a_fit_is_drawn_without_a_spiral(fit: dict) -> None:
    root = parsed(constellation_figure([TrackView("x", synthetic_posterior(), fit)], UTC, MapView()))
    assert of_class(root, "spiral") == []
    assert len(of_class(root, "track")) == 1


def test_what_is_not_known_is_not_drawn() -> None:
    posterior = synthetic_posterior().copy(deep=True)
    posterior["x_rsun"][3] = np.nan
    figure = constellation_figure([TrackView("x", posterior, synthetic_track_fit())], UTC, MapView())
    assert "nan" not in figure
    assert len([one for one in parsed(figure).iter() if one.get("data-mhz")]) == len(FREQUENCIES_MHZ) - 1


def test_one_frequency_and_no_track_make_figures() -> None:
    one = TrackView("x", synthetic_posterior(frequencies=np.array([1.0])), {})
    assert len(of_class(parsed(constellation_figure([one], UTC, MapView())), "region")) == 2
    assert len(of_class(parsed(constellation_figure([], UTC, MapView())), "sun")) == 1


def test_names_in_a_figure_are_text_and_no_markup() -> None:
    look = MapView(view="fleet", receivers={"<script>&": np.array([10.0, 100.0, 0.0])})
    assert "<script>&" in texts(parsed(constellation_figure([], UTC, look)), "craft-label")


def test_no_longitude_is_written_where_the_colours_of_the_frequencies_are(tracks: list[TrackView]) -> None:
    root = parsed(constellation_figure(tracks, UTC, MapView()))
    corner = next(iter(of_class(root, "sky under")))
    right, top = float(corner.get("x")) + float(corner.get("width")), float(corner.get("y"))
    assert top >= SIZE[1] - SCALE_ROOM[1]
    places = [(float(one.get("x")), float(one.get("y"))) for one in of_class(root, "spoke-label")]
    assert len(places) > 3
    assert [place for place in places if place[0] < right and place[1] > top] == []


def test_the_small_picture_shows_track_interval_and_receivers() -> None:
    track = np.array([[10.0, 0.0], [0.5 * AU_RSUN, 0.5 * AU_RSUN]])
    root = parsed(thumbnail(track, (20.0, 40.0), {"STEREO-A": np.array([0.0, AU_RSUN, 0.0])}, "said"))
    assert root.get("aria-label") == "said"
    (line,) = of_class(root, "track")
    assert points(line)[1] == pytest.approx([36 + 15.5, 36 - 15.5], abs=0.1)
    (craft,) = of_class(root, "craft")
    assert float(craft.get("cy")) == pytest.approx(5.0, abs=0.1)
    corners = points(*of_class(root, "sector"))
    assert corners[:, 1].max() <= 36.0  # north of the Sun: west


def test_selected_regions_are_those_of_the_nearest_channel() -> None:
    posterior = synthetic_posterior()
    chosen = selected_regions(posterior, 0.5)
    index = int(np.abs(np.log(FREQUENCIES_MHZ / 0.5)).argmin())
    assert chosen["frequency_mhz"] == pytest.approx(FREQUENCIES_MHZ[index], rel=1e-4)
    distance = float(np.hypot(posterior["x_rsun"], posterior["y_rsun"])[index])
    assert chosen["range_rsun"] == pytest.approx(distance, abs=0.01)
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


def test_names_of_bodies_in_one_direction_beyond_the_map_do_not_cover_one_another() -> None:
    far = {"WIND": np.array([AU_RSUN, 0.0, 0.0]), "SOLO": np.array([0.9 * AU_RSUN, 9.0, 0.0])}
    posterior = synthetic_posterior(frequencies=np.array([1.5, 2.0]))
    near = posterior.assign(receiver_rsun=posterior["receiver_rsun"] * 0 + far["SOLO"])
    root = parsed(constellation_figure([TrackView("edge", near, {})], UTC, MapView()))
    heights = [float(one.get("y")) for one in of_class(root, "craft-label")]
    assert len(heights) == 4
    assert np.diff(np.sort(heights)).min() >= 14.9

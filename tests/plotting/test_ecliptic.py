"""Maps of the ecliptic: shades, streams and contours where they belong."""

import numpy as np
import pytest
import xarray as xr

from bella.heliosphere import spiral_longitude_deg, spiral_position_rsun
from bella.plotting import (
    WindScene,
    coverage_caption,
    coverage_figure,
    planning_caption,
    planning_figure,
    wind_map_figure,
)
from bella.plotting.constellation import SIZE
from bella.plotting.ecliptic import PIXELS, UNCERTAINTY, contour_lines, share_class, wind_on_grid
from bella.plotting.svg import colour_at
from bella.solar_wind import FieldLine, SteadyWind
from bella.spacecraft import position
from bella.units import AU_RSUN
from tests.plotting.reading import SVG, image, of_class, parsed, points, texts

UTC = np.datetime64("2013-05-13T12:00")
RECEIVERS = {"STEREO-A": np.array([-150.0, 150.0, 0.0]), "WIND": np.array([213.0, 0.0, 0.0])}
LONGITUDES = (-180.0, -90.0, 0.0, 90.0)


@pytest.mark.parametrize(
    ("radius", "shade"), [(1.0, 0), (4.99, 0), (5.01, 1), (12.6, 2), (26.0, 3), (49.9, 3), (51.0, 4), (None, 4)]
)
def test_shades_are_shares_of_the_distance(radius: float | None, shade: int) -> None:
    assert share_class(radius, 50.0) == shade


def test_each_cell_is_in_its_direction_and_says_its_numbers() -> None:
    radii = {20.0: (1.0, 8.0, 15.0, None), 50.0: (3.0, 3.0, 3.0, 40.0)}
    root = parsed(planning_figure(UTC, RECEIVERS, LONGITUDES, radii, ("0.5 MHz", 30.0)))
    cells = [one for one in root.findall(f"{SVG}g") if one.find(f"{SVG}path") is not None]
    assert [one.find(f"{SVG}title").text for one in cells[:4]] == [
        "20 R☉, 180°: ±1 R☉, 5 % of its distance",
        "20 R☉, 90° E: ±8 R☉, 40 % of its distance",
        "20 R☉, 0°: ±15 R☉, 75 % of its distance",
        "20 R☉, 90° W: not known",
    ]
    assert [one.find(f"{SVG}path").get("class") for one in cells[:4]] == [f"cell share-{n}" for n in (0, 2, 3, 4)]
    per_rsun = SIZE[1] / (2.2 * AU_RSUN)
    for cell, longitude in zip(cells, [*LONGITUDES, *LONGITUDES], strict=True):
        outline = (points(cell.find(f"{SVG}path")) - np.array(SIZE) / 2) * (1, -1)
        middle = outline.mean(axis=0)
        assert np.cos(np.arctan2(middle[1], middle[0]) - np.radians(longitude)) == pytest.approx(1.0, abs=1e-3)
    inner = np.hypot(*((points(cells[4].find(f"{SVG}path")) - np.array(SIZE) / 2).T)) / per_rsun
    assert inner.min() == pytest.approx(np.sqrt(20.0 * 50.0), rel=0.03)
    assert 50.0 < inner.max() < 60.0
    (ring,) = of_class(root, "marked-ring")
    assert float(ring.get("r")) == pytest.approx(30.0 * per_rsun, abs=0.3)
    assert "0.5 MHz" in texts(root, "other-label")
    assert len(texts(root, "legend")) == 5


def test_a_fleet_that_locates_nothing_is_drawn_without_shades() -> None:
    root = parsed(planning_figure(UTC, RECEIVERS, LONGITUDES, {}, ("0.5 MHz", 30.0)))
    assert of_class(root, "cell") == []
    assert of_class(root, "marked-ring") == []
    assert texts(root, "legend") == []
    assert set(texts(root, "craft-label")) == {"Earth", "WIND", "STEREO-A"}


def test_the_caption_names_fleet_day_and_errors() -> None:
    said = planning_caption("2013-05-13", ["WIND", "PSP"], 15.0)
    assert all(word in said for word in ("WIND, PSP", "2013-05-13", "15 s", "68 %"))


BURST = np.datetime64("2012-06-07T19:30", "ns")
DISTANCE, CARRINGTON = np.arange(30.0, 241.0), (np.arange(128) + 0.5) * 360 / 128
FLEET = np.array([[216.0, 0, 0], [-93.0, 184, 0], [-96.0, -192, 0]])


def wind_with_a_stream(name: str) -> SteadyWind:
    """Fast at every distance at the Carrington longitude of a spacecraft."""
    x, y, _ = position(name, [BURST], "carrington")[0]
    apart = (CARRINGTON - np.degrees(np.arctan2(y, x)) + 180) % 360 - 180
    speed = np.tile(300 + 400 * np.exp(-0.5 * (apart / 10) ** 2), (DISTANCE.size, 1))
    return SteadyWind(DISTANCE, CARRINGTON, speed)


@pytest.mark.parametrize("name", ["EARTH", "STEREO-A", "STEREO-B"])
def test_a_stream_is_where_the_spacecraft_in_it_is(name: str) -> None:
    nodes = np.linspace(-240.0, 240.0, 241)
    found = wind_on_grid(wind_with_a_stream(name), nodes, BURST)
    x, y, _ = position(name, [BURST], "hee")[0]
    row, column = (int(np.abs(nodes - one).argmin()) for one in (y, x))
    assert found[row, column] > 690.0
    opposite = found[240 - row, 240 - column]
    assert opposite == pytest.approx(300.0, abs=1.0)
    assert np.isnan(found[120, 120])
    assert np.isnan(found[0, 0])
    assert np.isfinite(found[120, 240])


def test_the_map_of_the_wind_shows_fast_streams_dark_and_has_north_up() -> None:
    source = spiral_position_rsun(np.linspace(12.0, 150.0, 30), 30.0, 400.0)
    scene = WindScene(
        BURST,
        source,
        FieldLine(DISTANCE, spiral_longitude_deg(DISTANCE, 30.0, 400.0), np.empty((0, DISTANCE.size))),
        {name: position(name, [BURST], "hee")[0] for name in ("WIND", "STEREO-A", "STEREO-B")},
        along_km_s=np.where(np.arange(30) < 5, np.nan, 400.0),
        along_sd_km_s=np.full(30, 50.0),
    )
    root = parsed(wind_map_figure(wind_with_a_stream("STEREO-A"), scene))
    shown = image(root.find(f"{SVG}image"))
    assert shown.shape[:2] == (PIXELS, PIXELS)
    x, y, _ = position("STEREO-A", [BURST], "hee")[0]
    half = 240.0
    row, column = int((half - y) / (2 * half) * PIXELS), int((half + x) / (2 * half) * PIXELS)
    assert shown[row, column, :3].sum() < 250
    assert shown[PIXELS - row, column, :3].sum() > 600
    assert len(of_class(root, "track edge-gauss_hermite")) == 1
    assert len(of_class(root, "field-line")) == 1
    assert of_class(root, "fitted-spiral") == []
    assert {"STEREO-A", "STEREO-B", "Earth, WIND"} <= set(texts(root, "craft-label"))
    low, high = np.sort(points(of_class(root, "band")[0])[:, 1])[[0, -1]]
    (middle,) = set(points(of_class(root, "curve")[0])[:, 1].tolist())
    assert middle == pytest.approx((low + high) / 2, abs=0.2)
    labels = {one.text: float(one.get("y")) - 4 for one in of_class(root, "tick") if float(one.get("x")) < 60}
    per_km_s = (labels["350"] - labels["450"]) / 100.0
    assert (high - low) / per_km_s == pytest.approx(2 * 50.0, rel=0.02)
    assert "Wind along the track (km/s)" in texts(root, "axis-name")
    assert {"300", "400", "500"} <= set(texts(root, "tick"))


def test_without_a_burst_only_the_wind_is_drawn() -> None:
    root = parsed(wind_map_figure(wind_with_a_stream("EARTH"), WindScene(BURST)))
    assert [of_class(root, name) for name in ("track", "field-line", "band", "curve")] == [[], [], [], []]
    assert texts(root, "axis-name") == ["Solar wind speed (km/s)"]


def invented_map(*, exact: bool = False, flat: bool = False, off_beyond: float = 200.0) -> xr.Dataset:
    """Standard deviations that grow from 5 at the Sun to 70 solar radii in the corners."""
    axis = np.linspace(-310, 310, 32)
    radius = np.hypot(axis[:, None], axis[None, :])
    sd = np.full_like(radius, 40.0) if flat else 5 + 65 * radius / radius.max()
    variables = {
        "sd_largest_rsun": (("y", "x"), sd),
        "closed_form_off": (("y", "x"), radius > off_beyond),
        "receiver_rsun": (("observatory", "xyz"), FLEET),
        "sigma_s": (("observatory",), [60.0, 38.05, 38.05]),
    }
    if exact:
        variables["exact_sd_largest_rsun"] = (("y", "x"), 0.9 * sd)
    coordinates = {"x": axis, "y": axis, "observatory": ["WIND", "STEREO-A", "STEREO-B"], "xyz": ["x", "y", "z"]}
    return xr.Dataset(variables, coordinates, {"epoch": "2012-06-07T19:30:00Z"})


def test_the_map_of_the_uncertainty_has_its_fleet_contours_and_scale() -> None:
    root = parsed(coverage_figure(invented_map()))
    assert set(texts(root, "craft-label")) == {"Earth, WIND", "STEREO-A", "STEREO-B"}
    assert {"10", "15", "25", "50"} <= set(texts(root, "grid-label"))
    assert {"10", "20", "60"} <= set(texts(root, "tick"))
    shown = image(root.find(f"{SVG}image"))
    assert shown.shape[:2] == (32, 32)
    corner, centre = shown[0, 0, :3], shown[16, 16, :3]
    assert np.abs(corner - np.array([0x08, 0x1D, 0x58])).max() < 8
    assert centre.sum() > corner.sum()
    assert colour_at(1.0, UNCERTAINTY) == "#081d58"
    said = coverage_caption(invented_map())
    assert "2012-06-07 19:30 UTC" in said
    assert "WIND 60 s, STEREO-A 38.05 s" in said


def test_a_contour_is_where_the_map_has_its_level() -> None:
    axis = np.linspace(-310.0, 310.0, 63)
    radius = np.hypot(axis[:, None], axis[None, :])
    (one,) = contour_lines(axis, axis, radius, 100.0)
    np.testing.assert_allclose(np.hypot(*one.T), 100.0, atol=0.5)


def test_the_closed_form_is_hatched_where_it_is_off_and_an_exact_map_is_not() -> None:
    hatched = parsed(coverage_figure(invented_map()))
    ends = [[float(one.get(name)) for name in ("x1", "x2", "y1")] for one in of_class(hatched, "off-hatch")]
    per_rsun = SIZE[1] / 620.0
    for x1, x2, y in ends:
        middle = np.array([(x1 + x2) / 2, y]) - np.array(SIZE) / 2
        assert np.hypot(*middle) / per_rsun > 195.0
    assert len(of_class(hatched, "off-border")) == 1
    exact = parsed(coverage_figure(invented_map(exact=True)))
    assert of_class(exact, "off-hatch") == []
    assert len(of_class(exact, "off-border")) == 1
    assert "exact posterior" in coverage_caption(invented_map(exact=True))
    assert "closed form" in coverage_caption(invented_map())
    assert of_class(parsed(coverage_figure(invented_map(off_beyond=1000.0))), "off-hatch") == []


def test_exact_values_are_drawn_where_the_map_has_them() -> None:
    closed, exact = (parsed(coverage_figure(invented_map(exact=one))) for one in (False, True))
    assert "5" not in texts(closed, "tick") or "5" in texts(exact, "tick")
    assert max(float(one) for one in texts(exact, "tick")) <= 0.9 * 70.0


@pytest.mark.parametrize("off_beyond", [-1.0, 1000.0], ids=["off everywhere", "off nowhere"])
def test_flat_maps_are_drawn_too(off_beyond: float) -> None:
    root = parsed(coverage_figure(invented_map(flat=True, off_beyond=off_beyond)))
    assert texts(root, "tick") == ["40"]

"""The uncertainty map as a picture shows what the map holds."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import xarray as xr
from matplotlib.axes import Axes

from bella.plotting import coverage, write_coverage_png

NAMES = ("WIND", "STEREO-A", "STEREO-B")
POSITIONS = np.array([[216.0, 0, 0], [-93.0, 184, 0], [-96.0, -192, 0]])


def invented_map(*, exact: bool = False, flat: bool = False, off_beyond: float = 200.0) -> xr.Dataset:
    """Standard deviations that grow from 5 at the Sun to 70 solar radii in the corners."""
    axis = np.linspace(-310, 310, 32)
    radius = np.hypot(axis[:, None], axis[None, :])
    sd = np.full_like(radius, 40.0) if flat else 5 + 65 * radius / radius.max()
    variables = {
        "sd_largest_rsun": (("y", "x"), sd),
        "closed_form_off": (("y", "x"), radius > off_beyond),
        "receiver_rsun": (("observatory", "xyz"), POSITIONS),
        "sigma_s": (("observatory",), [60.0, 38.05, 38.05]),
    }
    if exact:
        variables["exact_sd_largest_rsun"] = (("y", "x"), 0.9 * sd)
    coordinates = {"x": axis, "y": axis, "observatory": list(NAMES), "xyz": ["x", "y", "z"]}
    return xr.Dataset(variables, coordinates, {"epoch": "2012-06-07T19:30:00Z"})


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Draws a map and hands over the axes instead of throwing them away."""

    def draw(uncertainty: xr.Dataset) -> Axes:
        figures = []
        monkeypatch.setattr(coverage, "save_png", lambda figure, path: figures.append(figure))
        coverage.write_coverage_png(tmp_path / "map.png", uncertainty)
        return figures[0].axes[0]

    return draw


def texts(axes: Axes) -> set[str]:
    return {text.get_text() for text in axes.texts}


def test_it_is_a_whole_picture_and_nothing_is_left_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "new" / "map.png"
    write_coverage_png(path, invented_map())
    picture = matplotlib.image.imread(path)
    assert min(picture.shape[:2]) > 800
    assert picture[..., :3].std() > 0.1
    assert [entry.name for entry in path.parent.iterdir()] == ["map.png"]


def test_axes_fleet_and_contours_are_labelled(drawn) -> None:
    axes = drawn(invented_map())
    assert "HEE X" in axes.get_xlabel()
    assert "HEE Y" in axes.get_ylabel()
    assert set(NAMES) <= texts(axes)
    (contours,) = [part for part in axes.collections if len(getattr(part, "levels", [])) > 2]
    np.testing.assert_array_equal(contours.levels, [10, 15, 25, 50])
    assert {"15", "25", "50"} <= texts(axes)
    assert "2012-06-07 19:30 UTC" in axes.get_title(loc="left")
    assert "WIND 60 s, STEREO-A 38.05 s" in axes.get_title(loc="left")
    (markers,) = [line for line in axes.lines if line.get_marker() == "^"]
    np.testing.assert_array_equal(np.transpose(markers.get_data()), POSITIONS[:, :2])


@pytest.mark.parametrize("y", [6.0, -6.0])
def test_names_of_close_spacecraft_are_on_either_side(drawn, y: float) -> None:
    close = invented_map()
    close["receiver_rsun"].data = np.array([[216.0, 0, 0], [212.0, y, 0], [-96.0, -192, 0]])
    sides = {text.get_text(): text.get_verticalalignment() for text in drawn(close).texts}
    assert sides["WIND"] != sides["STEREO-A"]


def hatched(axes: Axes) -> list[str]:
    return [hatch for part in axes.collections for hatch in getattr(part, "hatches", []) if hatch]


def test_closed_form_is_hatched_where_it_is_off_and_exact_map_is_not(drawn) -> None:
    assert hatched(drawn(invented_map()))
    assert not hatched(drawn(invented_map(exact=True)))
    assert not hatched(drawn(invented_map(off_beyond=1000.0)))


def test_exact_values_are_drawn_where_the_map_has_them(drawn) -> None:
    closed, exact = (drawn(invented_map(exact=exact)) for exact in (False, True))
    values = [np.asarray(axes.collections[0].get_array()) for axes in (closed, exact)]
    np.testing.assert_allclose(values[1], 0.9 * values[0])
    assert "closed form" in closed.get_title(loc="left")
    assert "exact posterior" in exact.get_title(loc="left")


@pytest.mark.parametrize("off_beyond", [-1.0, 1000.0], ids=["off everywhere", "off nowhere"])
def test_flat_maps_are_drawn_too(tmp_path: Path, off_beyond: float) -> None:
    write_coverage_png(tmp_path / "flat.png", invented_map(flat=True, off_beyond=off_beyond))
    assert (tmp_path / "flat.png").stat().st_size > 10_000

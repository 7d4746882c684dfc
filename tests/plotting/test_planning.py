"""The map of a prediction: shades where they belong."""

import numpy as np
import pytest

from bella.plotting import planning_caption, planning_figure
from bella.plotting.ecliptic import SIZE
from bella.plotting.planning import share_class
from bella.units import AU_RSUN
from tests.plotting.reading import SVG, of_class, parsed, points, texts

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

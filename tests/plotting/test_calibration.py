"""The P-P figure: a panel for each stratum, its curves against the band."""

import numpy as np
import pytest

from bella.calibration.ranks import simultaneous_band
from bella.plotting import calibration_figure
from bella.plotting.calibration import CURVES, PANEL_HEIGHT, POINTS, TOP, Panel
from tests.plotting.reading import of_class, parsed, points, texts

PROBABILITY = np.arange(1, POINTS + 1) / POINTS
BAND = simultaneous_band(200, POINTS)
MIDDLE = TOP + PANEL_HEIGHT / 2


def panel(title: str, *names: str, declared: bool = True) -> Panel:
    curves = {name: PROBABILITY ** (1 + 0.1 * i) for i, name in enumerate(names)}
    return Panel(title, curves, BAND, declared)


def test_a_panel_shows_its_curves_less_the_diagonal() -> None:
    root = parsed(calibration_figure([panel("wide", "x", "density")]))
    level, below = (points(of_class(root, f"pp {name}")[0]) for name in ("x", "density"))
    np.testing.assert_allclose(level[:, 1], MIDDLE, atol=0.1)
    lowest = int(np.argmin(PROBABILITY**1.1 - PROBABILITY))
    assert np.argmax(below[:, 1]) == pytest.approx(lowest, abs=8)
    assert below[:, 1].min() >= MIDDLE - 0.1
    band = points(of_class(root, "pp-band")[0])
    low, high = band[:, 1].max(), band[:, 1].min()
    assert low - MIDDLE == pytest.approx(MIDDLE - high, rel=0.1)
    share = (MIDDLE - high) / (below[:, 1].max() - MIDDLE)
    expected = float((BAND[1] - PROBABILITY).max()) / float((PROBABILITY - PROBABILITY**1.1).max())
    assert share == pytest.approx(expected, rel=0.05)
    assert texts(root, "tick")[-2:] == ["x", "density"]


def test_every_stratum_has_a_panel_and_departures_another_colour() -> None:
    panels = [panel(f"case {i}", *CURVES, declared=i < 5) for i in range(7)]
    root = parsed(calibration_figure(panels))
    assert texts(root, "panel-name") == [one.title for one in panels]
    assert texts(root, "panel-name misfit") == ["case 5", "case 6"]
    assert len(of_class(root, "pp-band")) == 7
    places = [(float(one.get("x")), float(one.get("y"))) for one in of_class(root, "panel-name")]
    assert places[5][0] == places[0][0]
    assert places[5][1] > places[0][1]


def test_a_case_that_the_model_does_not_know_has_room_for_its_departure() -> None:
    off = Panel("off", {"x": PROBABILITY**4}, BAND, declared=False)
    curve = points(of_class(parsed(calibration_figure([off])), "pp x")[0])
    assert curve[:, 1].min() > TOP
    assert curve[:, 1].max() < TOP + PANEL_HEIGHT

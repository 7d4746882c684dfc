"""The P-P figure: a panel for each stratum, its curves against the band, and a file small enough to keep."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bella.calibration.ranks import simultaneous_band
from bella.plotting import calibration, write_calibration_png
from bella.plotting.calibration import CURVES, POINTS, Panel

PROBABILITY = np.arange(1, POINTS + 1) / POINTS
BAND = simultaneous_band(200, POINTS)


def panel(title: str, *names: str, declared: bool = True) -> Panel:
    curves = {name: PROBABILITY ** (1 + 0.1 * i) for i, name in enumerate(names)}
    return Panel(title, curves, BAND, declared)


def drawn(monkeypatch: pytest.MonkeyPatch, path: Path, *panels: Panel) -> list[Axes]:
    kept: list[Figure] = []
    save = calibration.save_png

    def _keep(figure: Figure, path: Path, *, colours: int) -> None:
        kept.append(figure)
        save(figure, path, colours=colours)

    monkeypatch.setattr(calibration, "save_png", _keep)
    write_calibration_png(path, panels)
    return kept[0].axes


def test_a_panel_shows_its_curves_less_the_diagonal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    axes = drawn(monkeypatch, tmp_path / "one.png", panel("wide", "x", "density"))[0]
    lines = {str(line.get_label()): line for line in axes.get_lines()}
    assert list(lines) == ["x", "density"]
    assert np.allclose(np.asarray(lines["x"].get_ydata()), 0)
    assert np.allclose(np.asarray(lines["density"].get_ydata()), PROBABILITY**1.1 - PROBABILITY)
    low, high = axes.get_ylim()
    assert low == pytest.approx(-high)


def test_every_stratum_has_a_panel_and_departures_another_colour(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    panels = [panel(f"case {i}", *CURVES, declared=i < 5) for i in range(7)]
    axes = drawn(monkeypatch, tmp_path / "seven.png", *panels)
    assert [one.get_title() for one in axes if one.axison] == [one.title for one in panels]
    assert axes[0].title.get_color() != axes[6].title.get_color()
    image = matplotlib.image.imread(tmp_path / "seven.png")
    assert len(np.unique(image.reshape(-1, image.shape[-1]), axis=0)) <= calibration.COLOURS
    assert (tmp_path / "seven.png").stat().st_size < 200_000

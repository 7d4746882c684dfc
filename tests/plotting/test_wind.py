"""The map of the wind: streams where they are, seen from Earth."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from bella.heliosphere import spiral_longitude_deg, spiral_position_rsun
from bella.plotting import WindScene, write_wind_map_png
from bella.plotting.wind import _draw_wind
from bella.solar_wind import FieldLine, SteadyWind
from bella.spacecraft import position

BURST = np.datetime64("2012-06-07T19:30", "ns")
DISTANCE, LONGITUDE = np.arange(30.0, 241.0), (np.arange(128) + 0.5) * 360 / 128


def wind_with_a_stream(name: str) -> SteadyWind:
    """Fast at every distance at the Carrington longitude of a spacecraft."""
    x, y, _ = position(name, [BURST], "carrington")[0]
    apart = (LONGITUDE - np.degrees(np.arctan2(y, x)) + 180) % 360 - 180
    return SteadyWind(DISTANCE, LONGITUDE, np.tile(300 + 400 * np.exp(-0.5 * (apart / 10) ** 2), (DISTANCE.size, 1)))


@pytest.mark.parametrize("name", ["EARTH", "STEREO-A", "STEREO-B"])
def test_a_stream_is_drawn_where_the_spacecraft_in_it_is(name: str) -> None:
    figure = Figure()
    axes = figure.add_subplot()
    _draw_wind(figure, axes, wind_with_a_stream(name), BURST)

    mesh = axes.collections[0]
    row, column = np.unravel_index(np.argmax(mesh.get_array()[150:151]), (1, 128))
    corners = mesh.get_coordinates()[150 + row : 152 + row, column : column + 2].reshape(-1, 2)
    x, y, _ = position(name, [BURST], "hee")[0]
    off = np.arctan2(*corners.mean(axis=0)[::-1]) - np.arctan2(y, x)
    assert np.degrees((off + np.pi) % (2 * np.pi) - np.pi) == pytest.approx(0.0, abs=2.0)


def test_map_is_written_with_everything_in_it_and_with_nothing(tmp_path: Path) -> None:
    wind = wind_with_a_stream("EARTH")
    source = spiral_position_rsun(np.linspace(12.0, 150.0, 30), 30.0, 400.0)
    scene = WindScene(
        BURST,
        source,
        FieldLine(DISTANCE, spiral_longitude_deg(DISTANCE, 30.0, 400.0), np.empty((0, DISTANCE.size))),
        {name: position(name, [BURST], "hee")[0] for name in ("WIND", "STEREO-A", "STEREO-B")},
        along_km_s=np.where(np.arange(30) < 5, np.nan, 400.0),
        along_sd_km_s=np.full(30, 50.0),
    )
    write_wind_map_png(tmp_path / "new" / "full.png", wind, scene)
    write_wind_map_png(tmp_path / "new" / "empty.png", wind, WindScene(BURST))

    full, empty = (tmp_path / "new" / f"{name}.png" for name in ("full", "empty"))
    assert sorted(entry.name for entry in full.parent.iterdir()) == ["empty.png", "full.png"]
    assert full.stat().st_size > empty.stat().st_size > 10_000

"""The picture of one spacecraft's spectrum."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

from bella.exceptions import InputError
from bella.plotting import write_spectrum_png
from bella.plotting.day import _cells, _channel_limits, _record_limits, draw_intensity, intensity_bar
from bella.plotting.palette import BRIGHTNESS_SCALE
from bella.spectra import over_background
from tests.spectra.real_day import stereo, wind

GREY = np.array([0xAA, 0xB3, 0xBB]) / 255.0


def day(**changes: object) -> xr.Dataset:
    """Four hours of noise with a burst at 01:00 and a gap from 02:00 to 03:00."""
    minutes = np.delete(np.arange(240), slice(120, 180))
    level = np.random.default_rng(5).normal(0.0, 0.3, (180, 30))
    level[60:75] += 15.0
    attributes = {"observatory": "SOLO", "receiver": "HFR", "quantity": "psd_v2_hz", "integration_s": 60.0}
    return xr.Dataset(
        {"intensity": (("time", "frequency"), (1e-17 * 10.0 ** (level / 10.0)).astype(np.float32))},
        coords={
            "time": np.datetime64("2022-03-01", "ns") + minutes * np.timedelta64(60, "s"),
            "frequency": np.geomspace(0.4, 16.0, 30),
        },
        attrs=attributes | {"source_files": "none", **changes},
    )


def share(path: Path, chosen: object) -> float:
    picture = matplotlib.image.imread(path)[..., :3]
    return float(chosen(picture).mean())  # type: ignore[operator]


def test_the_burst_is_bright_and_the_gap_is_grey(tmp_path: Path) -> None:
    write_spectrum_png(tmp_path / "new" / "day.png", day())

    path = tmp_path / "new" / "day.png"
    assert [entry.name for entry in path.parent.iterdir()] == ["day.png"]
    assert 0.1 < share(path, lambda picture: (np.abs(picture - GREY) < 0.01).all(axis=-1)) < 0.25
    assert share(path, lambda picture: (picture[..., 0] > 0.9) & (picture[..., 2] < 0.85)) > 0.02


def test_channels_that_were_not_measured_are_left_out(tmp_path: Path) -> None:
    spectrum = day().assign(interpolated=("frequency", np.arange(30) % 10 != 0))

    write_spectrum_png(tmp_path / "day.png", spectrum)

    assert share(tmp_path / "day.png", lambda picture: (np.abs(picture - GREY) < 0.01).all(axis=-1)) > 0.3


@pytest.mark.parametrize("records", [2, 9000])
def test_short_and_long_spectra_are_drawn(tmp_path: Path, records: int) -> None:
    time = np.datetime64("2022-03-01", "ns") + np.arange(records) * np.timedelta64(7, "s")
    long = xr.Dataset(
        {"intensity": (("time", "frequency"), np.ones((records, 1), dtype=np.float32))},
        coords={"time": time, "frequency": [1.0]},
        attrs=day().attrs,
    )

    write_spectrum_png(tmp_path / "day.png", long)

    assert (tmp_path / "day.png").stat().st_size < 1_000_000


def test_a_spectrum_without_any_data_is_an_empty_picture(tmp_path: Path) -> None:
    empty = day()
    empty["intensity"][:] = np.nan

    write_spectrum_png(tmp_path / "day.png", empty)

    assert share(tmp_path / "day.png", lambda picture: (np.abs(picture - GREY) < 0.01).all(axis=-1)) > 0.5


def test_an_unknown_quantity_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="counts"):
        write_spectrum_png(tmp_path / "day.png", day(quantity="counts"))
    assert list(tmp_path.iterdir()) == []


def test_cells_touch_where_there_is_no_gap_and_leave_it_empty_where_there_is() -> None:
    edges, values = _cells(*_record_limits(day()["time"].to_numpy()), np.ones((180, 1)))
    assert len(edges) - 1 == len(values) == 181
    assert np.flatnonzero(np.isnan(values[:, 0])).tolist() == [120]

    edges, values = _cells(*_channel_limits(np.array([0.1, 0.11, 1.0])), np.ones((3, 1)))
    assert np.flatnonzero(np.isnan(values[:, 0])).tolist() == [2]
    assert (np.diff(edges) > 0.0).all()
    assert edges[0] == pytest.approx(0.1 / np.sqrt(1.1))


def test_real_days_are_drawn(reference_files: Path, tmp_path: Path) -> None:
    for name, spectrum in (("b", stereo(reference_files, "behind")), ("rad1", wind(reference_files, "RAD1"))):
        write_spectrum_png(tmp_path / f"{name}.png", spectrum)
        assert share(tmp_path / f"{name}.png", lambda picture: picture[..., 0] - picture[..., 2] > 0.1) > 0.005


def test_the_colour_bar_names_no_level_above_its_end() -> None:
    figure = Figure()
    axes = figure.add_subplot()
    mesh = draw_intensity(axes, over_background(day()), BRIGHTNESS_SCALE)
    for highest in (8.3, 12.4, 3.0):
        mesh.set_clim(0.0, highest)
        ticks = intensity_bar(figure, axes, mesh, aspect=14.0).get_ticks()
        assert ticks[0] == 0.0
        assert ticks[-1] <= highest
        assert len(ticks) > 2

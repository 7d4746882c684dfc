"""The figures of a track: what is drawn, and where."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bella.exceptions import InputError
from bella.plotting import write_density_png, write_polar_fit_png
from bella.plotting.geometry import polar_track
from bella.plotting.track import _draw_ellipses, _draw_fits, _draw_models, _without_jumps
from bella.tracks.scattering import scattering_models
from bella.tracks.spiral import piecewise_fit, track_fit
from tests.plotting.synthetic import synthetic_posterior

ORANGE = np.array([0xD9, 0x5F, 0x02]) / 255.0


def broken_track(middle_deg: float) -> xr.Dataset:
    """Two speeds, joined at 60 solar radii, at any longitude."""
    posterior = synthetic_posterior(frequencies=np.geomspace(0.15, 2.0, 40))
    distance = np.geomspace(150.0, 15.0, 40)
    angle = np.radians(middle_deg - np.where(distance < 60, 0.1, 0.55) * (distance - 60))
    moved = {"x_rsun": distance * np.cos(angle), "y_rsun": distance * np.sin(angle)}
    moved |= {"cov_xx_rsun2": (0.5 + 0.03 * distance) ** 2, "cov_yy_rsun2": (0.5 + 0.03 * distance) ** 2}
    moved |= {"cov_xy_rsun2": 0 * distance}
    return posterior.assign({name: ("frequency", values) for name, values in moved.items()})


def axes() -> Axes:
    return Figure().add_subplot()


def test_spirals_are_drawn_over_the_positions_with_their_speeds() -> None:
    posterior = synthetic_posterior()
    track, drawn = polar_track(posterior), axes()
    _draw_fits(drawn, track_fit(posterior) | piecewise_fit(posterior), track.range_rsun, _without_jumps(track))

    two_step, weighted = (str(line.get_label()) for line in drawn.lines)
    assert two_step.startswith("two-step: 400 (")
    assert weighted.startswith("errors in both: 40")
    for line in drawn.lines:
        np.testing.assert_allclose(line.get_ydata(), track.longitude_deg, atol=0.5)


@pytest.mark.parametrize("middle_deg", [0.0, 175.0, -175.0])
def test_broken_spiral_and_ellipses_stay_with_a_track_across_the_far_side(middle_deg: float) -> None:
    posterior = broken_track(middle_deg)
    track, drawn = polar_track(posterior), axes()
    longitude = _without_jumps(track)
    _draw_ellipses(drawn, posterior, longitude)
    _draw_fits(drawn, piecewise_fit(posterior), track.range_rsun, longitude)

    order = np.argsort(track.range_rsun)
    for x, y in (drawn.lines[1].get_data(), drawn.collections[0].get_offsets().T):
        np.testing.assert_allclose(y, np.interp(x, track.range_rsun[order], longitude[order]), atol=4.0)
    words = str(drawn.lines[1].get_label()).removeprefix("broken: ").removesuffix(" km/s").split(", ")
    assert float(words[0].partition(" ")[0]) > 900
    assert 190 < float(words[-1].partition(" ")[0]) < 240


def test_only_models_that_reach_the_burst_are_named() -> None:
    drawn = axes()
    _draw_models(drawn, polar_track(synthetic_posterior()))

    names = [line.get_label() for line in drawn.lines if not str(line.get_label()).startswith("_")]
    assert names == ["Leblanc", "Saito", "Parker"]
    assert len(drawn.lines) == 6


@pytest.mark.parametrize("fits", [{}, {"two_step": {"phi0_deg": {"mean": None}}, "piecewise": {"segments": []}}])
def test_polar_figure_is_written_with_and_without_fits(tmp_path: Path, fits: dict) -> None:
    path = tmp_path / "new" / "polar.png"
    write_polar_fit_png(path, synthetic_posterior(), fits)
    assert [entry.name for entry in path.parent.iterdir()] == ["polar.png"]
    assert matplotlib.image.imread(path).shape[0] > 500


def test_polar_figure_of_a_track_too_near_for_a_fit(tmp_path: Path) -> None:
    near = synthetic_posterior().isel(frequency=slice(198, 200))
    write_polar_fit_png(tmp_path / "near.png", near, track_fit(near) | piecewise_fit(near))
    assert (tmp_path / "near.png").exists()


def test_density_figure_is_written(tmp_path: Path) -> None:
    posterior = synthetic_posterior()
    track, model = polar_track(posterior), scattering_models()["harmonic"]
    corrected_rsun = track.range_rsun / model.radius_factor(track.frequency_mhz)

    write_density_png(tmp_path / "apparent.png", posterior)
    write_density_png(tmp_path / "corrected.png", posterior, {model.name: corrected_rsun})

    orange = [
        int((np.abs(matplotlib.image.imread(tmp_path / name)[..., :3] - ORANGE).max(axis=-1) < 0.02).sum())
        for name in ("apparent.png", "corrected.png")
    ]
    assert orange[0] == 0
    assert orange[1] > 500


@pytest.mark.parametrize(
    ("corrected", "reason"),
    [
        ({"a": np.ones(200), "b": np.ones(200), "c": np.ones(200)}, "at most two"),
        ({"a": np.ones(3)}, "the whole track"),
    ],
)
def test_density_figure_refuses_what_it_cannot_draw(tmp_path: Path, corrected: dict, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        write_density_png(tmp_path / "density.png", synthetic_posterior(), corrected)
    assert list(tmp_path.iterdir()) == []

"""The band of the joint spiral: as often about the truth as it says, narrower with better times, whole across +-180."""

import numpy as np
import pytest
import xarray as xr

from bella.heliosphere import spiral_longitude_deg
from bella.plotting import evolution_figure
from bella.plotting.constellation import MapView, constellation_figure
from bella.plotting.geometry import PERCENTS, SpiralBand, TrackView, band_outline, spiral_band
from bella.tracks import fit_track, with_joint_draws
from tests.plotting.reading import of_class, parsed, points
from tests.plotting.synthetic import synthetic_posterior, synthetic_track_fit
from tests.tracks.foreign import Burst

OUTWARD = np.linspace(1.0, 215.0, 60)
PERIOD_D = 25.38


def drawn(phi0_deg: np.ndarray, v_sw_km_s: np.ndarray, onto: xr.Dataset | None = None) -> xr.Dataset:
    """A solution with the draws of a joint fit."""
    values = np.column_stack([phi0_deg, v_sw_km_s]).astype(np.float32)
    joint = (("joint_draw", "joint_parameter"), values, {"rotation_period_d": PERIOD_D})
    solution = xr.Dataset() if onto is None else onto
    return solution.assign(joint_draws=joint).assign_coords(joint_parameter=["phi0_deg", "v_sw_km_s"])


def gaussian(phi0_deg: float, sd_deg: float, draws: int = 4000) -> xr.Dataset:
    rng = np.random.default_rng(5)
    return drawn(phi0_deg + sd_deg * rng.standard_normal(draws), 400 + 50 * rng.standard_normal(draws))


def band_of(posterior: xr.Dataset) -> SpiralBand:
    band = spiral_band(posterior, OUTWARD)
    assert band is not None
    return band


def burst_band(seed: int, scale: float) -> SpiralBand:
    """Band of a simulated burst from 30 degrees with a wind of 400 km/s."""
    grid = Burst(phi0_deg=30.0, v_sw_km_s=400.0).arrivals(np.random.default_rng(seed), sigma_s=4.0 * scale)
    return band_of(with_joint_draws(xr.Dataset(), fit_track(grid, draws=1000, seed=seed)))


@pytest.mark.acceptance  # thirty fits
def test_bands_of_simulated_bursts_hold_the_true_spiral_as_often_as_they_say() -> None:
    truth = spiral_longitude_deg(OUTWARD, 30.0, 400.0, PERIOD_D)
    held = dict.fromkeys(PERCENTS, 0.0)
    for seed in range(30):
        band = burst_band(seed, 0.5)
        for percent in PERCENTS:
            inside = (band.low_deg[percent] <= truth) & (truth <= band.high_deg[percent])
            held[percent] += float(inside.mean()) / 30
    assert 0.55 < held[68] < 0.9
    assert held[95] > 0.88


def test_better_times_make_a_narrower_band_and_68_lies_within_95() -> None:
    good, bad = burst_band(1, 0.25), burst_band(1, 4.0)
    for band in (good, bad):
        assert (band.low_deg[95] < band.low_deg[68]).all()
        assert (band.low_deg[68] < band.median_deg).all()
        assert (band.median_deg < band.high_deg[68]).all()
        assert (band.high_deg[68] < band.high_deg[95]).all()
    for percent in PERCENTS:
        width = [np.mean(band.high_deg[percent] - band.low_deg[percent]) for band in (good, bad)]
        assert width[0] < 0.8 * width[1]


@pytest.mark.parametrize("phi0_deg", [180.0, -180.0, 175.0, -10.0])
def test_a_band_is_the_same_wherever_on_the_circle_and_however_it_was_wrapped(phi0_deg: float) -> None:
    straight = gaussian(0.0, 8.0)
    turned = (straight["joint_draws"].sel(joint_parameter="phi0_deg") + phi0_deg + 180) % 360 - 180
    wrapped = drawn(turned.to_numpy(), straight["joint_draws"].sel(joint_parameter="v_sw_km_s").to_numpy())
    one, other = band_of(straight), band_of(wrapped)
    shift = other.median_deg - one.median_deg
    np.testing.assert_allclose(shift, shift[0], atol=1e-3)
    assert (shift[0] - phi0_deg + 180) % 360 - 180 == pytest.approx(0.0, abs=1e-3)
    for percent in PERCENTS:
        width = one.high_deg[percent] - one.low_deg[percent]
        np.testing.assert_allclose(other.high_deg[percent] - other.low_deg[percent], width, atol=1e-3)
        assert width[0] == pytest.approx({68: 2 * 0.9945, 95: 2 * 1.96}[percent] * 8.0, rel=0.06)


def test_ends_of_a_band_do_not_depend_on_the_number_of_draws() -> None:
    few, many = band_of(gaussian(20.0, 5.0, 1000)), band_of(gaussian(20.0, 5.0, 16_000))
    for percent in PERCENTS:
        np.testing.assert_allclose(few.low_deg[percent], many.low_deg[percent], atol=2.5)


def test_an_outline_is_closed_and_ends_on_the_arc() -> None:
    band = band_of(gaussian(20.0, 5.0))
    outline = band_outline(band, 95)
    np.testing.assert_array_equal(outline[0], outline[-1])
    distance = np.hypot(*outline.T)
    assert distance.max() == pytest.approx(215.0)
    assert (np.isclose(distance, 215.0)).sum() > 20
    sides = np.radians([band.low_deg[95][-1], band.high_deg[95][-1]])
    for side in sides:
        end = 215.0 * np.array([np.cos(side), np.sin(side)])
        assert np.linalg.norm(outline - end, axis=1).min() < 1e-9


def test_without_a_joint_fit_there_is_no_band_and_with_one_it_is_in_both_figures() -> None:
    assert spiral_band(synthetic_posterior(), OUTWARD) is None
    rng = np.random.default_rng(3)
    joint = drawn(29 + 4 * rng.standard_normal(500), 420 + 60 * rng.standard_normal(500), synthetic_posterior())
    utc = np.datetime64("2012-06-07T19:29", "ns")
    for one, bands in ((synthetic_posterior(), 0), (joint, 2)):
        chart = constellation_figure([TrackView("edge", one, synthetic_track_fit())], utc, MapView())
        for figure in (chart, evolution_figure(one, synthetic_track_fit())):
            assert len(of_class(parsed(figure), "spiral-band")) == bands


@pytest.mark.parametrize("turn_deg", [0.0, 360.0, -360.0])
def test_a_band_is_drawn_around_the_track_on_whatever_turn(turn_deg: float) -> None:
    rng = np.random.default_rng(3)
    phi0 = 29 + turn_deg + 4 * rng.standard_normal(500)
    joint = drawn(phi0, 420 + 60 * rng.standard_normal(500), synthetic_posterior())
    root = parsed(evolution_figure(joint, {}))
    outline = points(of_class(root, "spiral-band p68")[0])
    ends = outline[: len(outline) // 2], outline[len(outline) // 2 :][::-1]
    for place in of_class(root, "place")[::8]:
        x, y = float(place.get("cx")), float(place.get("cy"))
        lower, upper = (np.interp(x, one[:, 0], one[:, 1]) for one in ends)
        assert upper < y < lower

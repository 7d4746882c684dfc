"""Distance and speed against frequency, longitude against distance, residuals."""

import numpy as np
import pytest
import xarray as xr

from bella.heliosphere import DENSITY_MODELS, emission_range_rsun
from bella.plotting import evolution_figure, polar_track, residual_figure
from bella.plotting.evolution import HEIGHT, ellipses, spiral_lines
from bella.tracks.spiral import piecewise_fit, track_fit
from tests.plotting.reading import SVG, of_class, parsed, points, texts
from tests.plotting.synthetic import synthetic_posterior, synthetic_track_fit


def broken_track(middle_deg: float) -> xr.Dataset:
    """Two speeds, joined at 60 solar radii, at any longitude."""
    posterior = synthetic_posterior(frequencies=np.geomspace(0.15, 2.0, 40))
    distance = np.geomspace(150.0, 15.0, 40)
    angle = np.radians(middle_deg - np.where(distance < 60, 0.1, 0.55) * (distance - 60))
    moved = {"x_rsun": distance * np.cos(angle), "y_rsun": distance * np.sin(angle)}
    moved |= {"cov_xx_rsun2": (0.5 + 0.03 * distance) ** 2, "cov_yy_rsun2": (0.5 + 0.03 * distance) ** 2}
    moved |= {"cov_xy_rsun2": 0 * distance}
    return posterior.assign({name: ("frequency", values) for name, values in moved.items()})


def quantity(middle: float, sd: float) -> dict[str, float]:
    return {"q16": middle - sd, "q50": middle, "q84": middle + sd}


def test_positions_have_their_errors_and_the_joint_fit_its_bands() -> None:
    profile = [
        {"frequency_mhz": f, "range_rsun": quantity(30 / f, 3.0), "beam_speed_c": quantity(0.3, 0.1)}
        for f in (0.2, 0.5, 1.0)
    ]
    fit = synthetic_track_fit() | {"joint": {"profile": profile}}
    root = parsed(evolution_figure(synthetic_posterior(), fit))
    errors, dots = of_class(root, "error"), of_class(root, "dot")
    assert len(errors) == len(dots) == 40
    for bar, dot in zip(errors, dots, strict=True):
        assert float(bar.get("y2")) <= float(dot.get("cy")) <= float(bar.get("y1")) or bar.get("y1") == bar.get("y2")
    heights = [float(one.get("cy")) for one in dots]
    assert heights == sorted(heights)  # farther out at lower frequencies: up is far
    distance, speed = (points(one) for one in of_class(root, "band"))
    assert distance[0, 0] < speed[0, 0]
    lower, upper = speed[:3, 1], speed[3:, 1]
    assert (upper < lower).all()
    assert "not fitted" not in "".join(root.itertext())


def test_without_a_joint_fit_the_speed_is_said_not_to_be_fitted() -> None:
    root = parsed(evolution_figure(synthetic_posterior(), {}))
    assert of_class(root, "band") == []
    assert "not fitted" in texts(root, "tick")


def test_residuals_stand_above_and_below_zero_by_spacecraft() -> None:
    posterior = synthetic_posterior(frequencies=np.array([0.2, 0.5, 1.0]))
    values = np.array([[5.0, -5.0, np.nan], [1.0, -1.0, 0.0], [2.0, -2.0, 0.0]])
    root = parsed(residual_figure(posterior.assign(residual_s=(("frequency", "observatory"), values))))
    marks = of_class(root, "series s0")[0]
    heights = [float(one.get("cy")) for one in marks]
    middle = (24.0 + HEIGHT - 44.0) / 2
    assert heights[0] < heights[2] < heights[1] < middle
    below = of_class(root, "series s1")[0]
    assert all(points(one)[:, 1].mean() > middle for one in below)
    assert len(of_class(root, "series s2")[0]) == 2
    assert heights[0] - middle == pytest.approx(-(points(below[0])[:, 1].mean() - middle), abs=0.5)


def longitudes(posterior: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Distance and longitude without jumps, by distance."""
    track = polar_track(posterior)
    order = np.argsort(track.range_rsun)
    return track.range_rsun[order], np.unwrap(track.longitude_deg[order], period=360.0)


def test_spirals_are_drawn_over_the_positions_with_their_speeds() -> None:
    posterior = synthetic_posterior()
    distance, longitude = longitudes(posterior)
    fits = track_fit(posterior) | piecewise_fit(posterior)
    found = {kind: (said, line) for kind, said, line in spiral_lines(fits, distance, float(np.median(longitude)))}
    assert set(found) == {"two_step", "weighted"}
    assert found["two_step"][0].startswith("two-step: 400 (")
    assert found["weighted"][0].startswith("errors in both: 40")
    for _, line in found.values():
        np.testing.assert_allclose(line[:, 1], longitude, atol=0.5)


@pytest.mark.parametrize("middle_deg", [0.0, 175.0, -175.0])
def test_broken_spiral_and_ellipses_stay_with_a_track_across_the_far_side(middle_deg: float) -> None:
    posterior = broken_track(middle_deg)
    distance, longitude = longitudes(posterior)
    track = polar_track(posterior)
    given = np.interp(track.range_rsun, distance, longitude)
    lines = {kind: (said, line) for kind, said, line in spiral_lines(piecewise_fit(posterior), distance, 0.0)}
    said, broken = next(
        (said, line)
        for kind, said, line in spiral_lines(piecewise_fit(posterior), distance, float(np.median(longitude)))
        if kind == "broken"
    )
    assert set(lines) == {"weighted", "broken"}
    drawn = list(ellipses(posterior, given))
    centres = np.array([outline[:-1].mean(axis=0) for outline in drawn])
    for points_of in (broken, centres):
        np.testing.assert_allclose(points_of[:, 1], np.interp(points_of[:, 0], distance, longitude), atol=4.0)
    speeds = said.removeprefix("broken: ").removesuffix(" km/s").split(", ")
    assert float(speeds[0].partition(" ")[0]) > 900
    assert 190 < float(speeds[-1].partition(" ")[0]) < 240


def test_an_ellipse_is_one_standard_deviation_wide() -> None:
    posterior = broken_track(0.0)
    track = polar_track(posterior)
    for outline in ellipses(posterior, track.longitude_deg):
        index = int(np.abs(track.range_rsun - outline[:-1, 0].mean()).argmin())
        assert np.ptp(outline[:, 0]) / 2 == pytest.approx(track.range_sd_rsun[index], rel=0.01)
        assert np.ptp(outline[:, 1]) / 2 == pytest.approx(track.longitude_sd_deg[index], rel=0.01)


@pytest.mark.parametrize("fits", [{}, {"two_step": {"phi0_deg": {"mean": None}}, "piecewise": {"segments": []}}])
def test_the_panel_of_longitudes_is_drawn_with_and_without_fits(fits: dict) -> None:
    root = parsed(evolution_figure(synthetic_posterior(), fits))
    assert of_class(root, "fit") == []
    places = [(float(one.get("cx")), float(one.get("cy"))) for one in of_class(root, "place")]
    assert len(places) == 80
    assert all(HEIGHT < y < 2 * HEIGHT for _, y in places)
    by_distance = sorted(places)
    assert by_distance[0][1] < by_distance[-1][1]  # the west is up, and the spiral turns to the east


def test_a_track_too_near_for_a_fit_is_drawn() -> None:
    near = synthetic_posterior().isel(frequency=slice(198, 200))
    root = parsed(evolution_figure(near, track_fit(near) | {"companions": piecewise_fit(near)}))
    assert of_class(root, "fit") == []


def test_only_models_that_reach_the_burst_are_drawn_the_leading_one_thick() -> None:
    root = parsed(evolution_figure(synthetic_posterior(), {}))
    said = [one.find(f"{SVG}title").text for one in root.findall(f"{SVG}g") if one.find(f"{SVG}path") is not None]
    names = ("Leblanc", "Saito", "Parker")
    assert said[:6] == [f"{name} density, {one}" for name in names for one in ("fundamental", "harmonic")]
    assert len(of_class(root, "model")) == 6
    assert len(of_class(root, "model thin")) == 4
    fundamental, harmonic = (points(one)[::-1] for one in of_class(root, "model")[:2])
    at = np.interp(200.0, fundamental[:, 0], fundamental[:, 1]), np.interp(200.0, harmonic[:, 0], harmonic[:, 1])
    assert at[1] < at[0]  # the harmonic is emitted farther out, which is up
    ticks = [(str(one.text), float(one.get("x")), float(one.get("y"))) for one in of_class(root, "tick")]
    heights = {said: y - 4 for said, x, y in ticks if x < 60 and y < 300}
    places = {said: x for said, x, y in ticks if x < 300 < y < 310}
    height = np.interp(places["0.5"], fundamental[:, 0], fundamental[:, 1])
    share = (height - heights["10"]) / (heights["100"] - heights["10"])
    expected = float(emission_range_rsun(np.array([0.5]), DENSITY_MODELS["leblanc"])[0])
    assert 10.0 * 10.0**share == pytest.approx(expected, rel=0.02)


def test_corrected_distances_are_marked_where_they_are_known() -> None:
    root = parsed(evolution_figure(synthetic_posterior(), synthetic_track_fit()))
    down, up = (points(one.find(f"{SVG}path")) for one in of_class(root, "corrected"))
    assert down[2, 1] > down[0, 1]
    assert up[2, 1] < up[0, 1]
    assert up[:, 1].mean() < down[:, 1].mean()  # 61 against 40 solar radii

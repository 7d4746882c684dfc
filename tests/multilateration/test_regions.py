"""Highest-density regions: area, outline, mode and the number of modes."""

import numpy as np
import pytest

from bella.multilateration.cells import divide
from bella.multilateration.posterior import draw
from bella.multilateration.problems import problems_of
from bella.multilateration.regions import LEVELS, region_of_draws, regions_of
from tests.multilateration.geometry import (
    CADENCE_S,
    EVENT,
    FIVE,
    NARROW,
    WIDE,
    grid_of,
    inside,
    log_joint,
    moments,
    on_spiral,
    polygon_area,
    regions,
    speed_grid,
    spread,
)

ON_ONE_LINE = np.array([[216.0, 0.0, 0.0], [100.0, 0.0, 0.0], [-206.0, 0.0, 0.0]])
CASES = {
    "event": (on_spiral(75), EVENT, CADENCE_S, NARROW),
    "event, free speed": (on_spiral(150), EVENT, CADENCE_S, WIDE),
    "five receivers, free speed": (on_spiral(100), FIVE, 7.0, WIDE),
    "two branches": ((186.0, -45.0, 0.0), spread(40), 7.0, NARROW),
    "mirror": ((60.0, 60.0, 0.0), ON_ONE_LINE, 7.0, NARROW),
    "wide": ((-30.0, -100.0, 0.0), spread(10), 60.0, NARROW),
}


@pytest.mark.parametrize("receivers_sigma", [(FIVE, 7.0), (EVENT, 7.0), (EVENT, 0.5)])
def test_areas_of_a_gaussian_posterior(receivers_sigma) -> None:
    receivers, sigma_s = receivers_sigma
    grid = grid_of(on_spiral(40), receivers, sigma_s)
    determinant = np.linalg.det(moments(grid).covariance[0])
    (region,) = regions(grid)

    for level, area in zip(LEVELS, region.area_rsun2, strict=True):
        assert area == pytest.approx(-2 * np.pi * np.sqrt(determinant) * np.log(1 - level), rel=0.03)


@pytest.mark.parametrize("name", CASES)
def test_outlines_hold_the_draws_they_promise(name) -> None:
    source, receivers, sigma_s, priors = CASES[name]
    problems = problems_of(grid_of(source, receivers, sigma_s), priors, 2)
    cells = divide(problems)
    (region,) = regions_of(problems, cells)
    positions = draw(problems, cells, 4000, np.random.default_rng(8)).position[0]

    for level, area, outline in zip(LEVELS, region.area_rsun2, region.outlines, strict=True):
        assert polygon_area(outline) == pytest.approx(area, rel=0.02)
        share = inside(outline, positions).mean()
        assert share == pytest.approx(level, abs=4 * np.sqrt(level * (1 - level) / 3600) + 0.003)
    assert inside(region.outlines[0], region.mode_rsun[None]).all()
    assert region.area_rsun2[0] < region.area_rsun2[1]


@pytest.mark.parametrize("name", CASES)
def test_polygons_are_closed(name) -> None:
    source, receivers, sigma_s, priors = CASES[name]
    for outline in regions(grid_of(source, receivers, sigma_s), priors)[0].outlines:
        gaps = np.flatnonzero(np.isnan(outline[:, 0]))
        starts, stops = np.r_[0, gaps + 1], np.r_[gaps, len(outline)] - 1
        np.testing.assert_allclose(outline[starts], outline[stops], atol=1e-9)
        assert (stops - starts >= 3).all()


@pytest.mark.parametrize("source", [(75.0, 40.0), (60.0, 60.0), (0.0, 80.0)])
def test_receivers_on_one_line_leave_the_mirror_image(source) -> None:
    (region,) = regions(grid_of((*source, 0.0), ON_ONE_LINE, 7.0))

    assert region.modes.weight.size == 2
    np.testing.assert_allclose(region.modes.weight, 0.5, atol=1e-3)
    np.testing.assert_allclose(sorted(region.modes.mean_rsun[:, 1]), [-source[1], source[1]], atol=6)
    assert region.modes.mean_rsun[:, 1].sum() == pytest.approx(0, abs=0.1)
    assert abs(region.mode_rsun[1]) == pytest.approx(source[1], abs=4)


def test_well_placed_receivers_leave_one_mode_at_the_source() -> None:
    for sigma_s in (CADENCE_S, 7.0, 1.0):
        solved = regions(grid_of([on_spiral(r) for r in (10, 50, 100, 150)], EVENT, sigma_s))
        assert [region.modes.weight.size for region in solved] == [1, 1, 1, 1]
    sharp = regions(grid_of(on_spiral(75), FIVE, 0.5))[0]
    np.testing.assert_allclose(sharp.mode_rsun, on_spiral(75)[:2], atol=0.1)


@pytest.mark.parametrize(("separation_deg", "sigma_s"), [(116, 1.0), (140, 2.0), (90, 7.0), (40, 7.0)])
def test_narrow_ridges_are_not_cut_in_many_modes(separation_deg, sigma_s) -> None:
    """With the speed free, three receivers leave a long and thin posterior: the lattice must not break it up."""
    rng = np.random.default_rng(1)
    sources = np.c_[rng.normal(0, 60, (6, 2)), np.zeros(6)]
    grid = grid_of(sources, spread(separation_deg), sigma_s, noise=rng.standard_normal((6, 3)))

    for row in range(6):
        assert regions(grid.take(np.array([row])), WIDE)[0].modes.weight.size <= 2


def test_the_mode_is_the_highest_point() -> None:
    problems = problems_of(grid_of(on_spiral(150), EVENT, CADENCE_S), WIDE, 2)
    (region,) = regions_of(problems, divide(problems))
    grid = grid_of(on_spiral(150), EVENT, CADENCE_S)
    speeds, log_prior = speed_grid(WIDE, grid.sigma_s[0])
    step = np.stack(np.meshgrid(np.arange(-30, 30.1, 0.5), np.arange(-30, 30.1, 0.5))).reshape(2, -1)
    points = region.mode_rsun[:, None] + step
    joint = log_joint(points, grid, WIDE, speeds) + log_prior
    best = points[:, np.logaddexp.reduce(joint, axis=1).argmax()]

    np.testing.assert_allclose(region.mode_rsun, best, atol=1.0)


def test_regions_of_draws_agree_with_those_of_cells() -> None:
    problems = problems_of(grid_of(on_spiral(75), EVENT, CADENCE_S), NARROW, 2)
    cells = divide(problems)
    (exact,) = regions_of(problems, cells)
    estimated = region_of_draws(draw(problems, cells, 2000, np.random.default_rng(1)).position[0])

    assert estimated.modes.weight.tolist() == exact.modes.weight.tolist() == [1.0]
    for some, others in zip(estimated.area_rsun2, exact.area_rsun2, strict=True):
        assert some == pytest.approx(others, rel=0.1)
    np.testing.assert_allclose(estimated.mode_rsun, exact.mode_rsun, atol=6)

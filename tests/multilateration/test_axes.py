"""Bent axes: they follow the ridge, keep areas, and no cell along them is dropped that holds something."""

from dataclasses import replace

import numpy as np
import pytest

from bella.heliosphere.scattering import LITERATURE_DELAY, NO_DELAY
from bella.multilateration.axes import Axes, axes_of
from bella.multilateration.cells import DROP_NATS, Lattice, _first_lattice, _level, divide
from bella.multilateration.priors import PRESETS
from bella.multilateration.problems import Problems, problems_of
from bella.multilateration.regions import log_density, regions_of
from tests.multilateration.geometry import EVENT, NARROW, grid_of, on_spiral

POOR_S = (5.0, 120.0, 5.0)
BROAD = PRESETS["default"].priors


def one_poor_clock(range_rsun: float = 60.0, delay=NO_DELAY, priors=NARROW) -> Problems:
    grid = grid_of(on_spiral(range_rsun), EVENT, POOR_S)
    return problems_of(grid, priors, 2, delay=delay)


@pytest.mark.parametrize("range_rsun", [20.0, 60.0, 100.0])
def test_the_second_axis_follows_the_hyperbola_of_the_good_clocks(range_rsun) -> None:
    axes = axes_of(one_poor_clock(range_rsun))
    ahead = axes.start[0] + axes.step[0] * np.linspace(2, 8, 25)
    across = np.linspace(-200, 200, 801)
    places = axes.place(np.stack(np.broadcast_arrays(across[:, None], ahead)), slice(0, 1))

    def apart(points: np.ndarray) -> np.ndarray:
        of_first, of_last = (np.hypot(points[0] - EVENT[which, 0], points[1] - EVENT[which, 1]) for which in (0, 2))
        return of_first - of_last

    off = np.abs(apart(places) - apart(on_spiral(range_rsun))).max(axis=1).min()
    straight = Axes.straight(axes.turn).place(np.stack(np.broadcast_arrays(across[:, None], ahead)), slice(0, 1))
    assert off < 3.0
    assert np.abs(apart(straight) - apart(on_spiral(range_rsun))).max(axis=1).min() > 4 * off


def test_good_clocks_keep_straight_axes() -> None:
    assert axes_of(problems_of(grid_of(on_spiral(60), EVENT, 5.0), NARROW, 2)).curve is None


def test_displacement_keeps_areas_and_its_slope_is_its_derivative() -> None:
    axes = axes_of(one_poor_clock())
    ahead = np.linspace(-700, 700, 301)
    here = np.stack([np.linspace(-50, 80, 301), ahead])
    step = 1e-4
    across, along = (
        (axes.place(here + step * axis[:, None], slice(0, 1)) - axes.place(here - step * axis[:, None], slice(0, 1)))
        / (2 * step)
        for axis in np.eye(2)
    )
    h, lean = axes.bend(ahead, slice(0, 1))

    np.testing.assert_allclose(across[0] * along[1] - across[1] * along[0], 1.0, atol=1e-6)
    np.testing.assert_allclose(lean, np.gradient(h, ahead), atol=0.03)
    assert np.ptp(h) > 50


@pytest.mark.parametrize("range_rsun", [20.0, 60.0])
@pytest.mark.parametrize("sigma_s", [POOR_S, (5.0, 5.0, 120.0), (120.0, 5.0, 5.0)], ids=["middle", "last", "first"])
def test_the_first_lattice_covers_the_disc_of_the_prior(range_rsun, sigma_s) -> None:
    problems = problems_of(grid_of(on_spiral(range_rsun), EVENT, sigma_s), BROAD, 2)
    lattice = _first_lattice(problems)
    angle = np.linspace(0, 2 * np.pi, 200)
    x, y = 730.0 * np.cos(angle), 730.0 * np.sin(angle)
    cosine, sine = lattice.axes.turn[:, 0]
    ahead = cosine * y - sine * x
    across = cosine * x + sine * y - lattice.axes.bend(ahead, slice(0, 1))[0]
    low, high = lattice.origin[:, 0], lattice.origin[:, 0] + 12 * lattice.side[:, 0]

    assert (across >= low[0]).all()
    assert (across <= high[0]).all()
    assert (np.abs(ahead) <= high[1]).all()


def parabola(turn: np.ndarray) -> Axes:
    """Axes with h = 0.004 s^2 within 300 solar radii, straight beyond: steeper than any that are followed."""
    curve = np.array([[360.0, 360.0, 360.0], [-1440.0, -1440.0, 1440.0], [0.0, 1440.0, 0.0], [0.0, 0.0, 0.0]])
    return Axes(turn, curve[..., None], np.array([-300.0]), np.array([600.0]))


@pytest.mark.parametrize("axes", [parabola(np.array([[1.0], [0.0]])), axes_of(one_poor_clock())], ids=["steep", "own"])
@pytest.mark.parametrize("half_side", [5.0, 30.0, 200.0])
def test_the_bulge_is_the_farthest_from_a_straight_line(axes: Axes, half_side: float) -> None:
    middle, off = np.linspace(-500, 500, 101), np.linspace(-half_side, half_side, 21)[:, None]
    h, lean = axes.bend(middle, slice(0, 1))
    away = np.abs(axes.bend(middle + off, slice(0, 1))[0] - h - lean * off).max()

    assert 0.1 * axes.bulge(np.array([half_side]))[0] < away <= axes.bulge(np.array([half_side]))[0] * (1 + 1e-9)


@pytest.mark.parametrize(("sign", "low_rsun", "high_rsun"), [(1.0, -141.4, 100.0), (-1.0, -100.0, 141.4)])
def test_limits_reach_as_far_as_bent_axes_have_to(sign: float, low_rsun: float, high_rsun: float) -> None:
    # h = |s| or -|s|
    curve = sign * np.array([[0.0, 0.0, 1.0], [-1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])[..., None]
    axes = Axes(np.array([[1.0], [0.0]]), curve, np.zeros(1), np.ones(1))
    low, high = axes.limits(100.0, 2)

    np.testing.assert_allclose([low[0, 0], high[0, 0]], [low_rsun, high_rsun], atol=1.0)
    np.testing.assert_allclose([low[1, 0], high[1, 0]], [-100.0, 100.0])


@pytest.mark.parametrize("sigma_s", [POOR_S, (120.0, 5.0, 5.0), (4.0, 4.0, 4.0)], ids=["middle", "first", "none"])
@pytest.mark.parametrize("finer", [1, 3, 8])
@pytest.mark.parametrize("is_steep", [False, True], ids=["own axes", "steep axes"])
def test_no_cell_is_dropped_that_holds_something(finer, sigma_s, is_steep) -> None:
    rng = np.random.default_rng(3)
    for range_rsun in (15.0, 60.0, 150.0):
        grid = replace(grid_of(on_spiral(range_rsun), EVENT, sigma_s), rise_s=np.full((1, 3), 60.0))
        problems = problems_of(grid, BROAD, 2, delay=LITERATURE_DELAY)
        lowest = divide(problems).log_density.max() - DROP_NATS
        axes = parabola(axes_of(problems).turn) if is_steep else axes_of(problems)
        low, high = axes.limits(735.0, 2)
        corner = np.indices((12 * finer, 12 * finer)).reshape(2, -1)
        lattice = Lattice(corner, np.zeros(corner.shape[1], dtype=np.intp), (high - low) / 12 / finer, low, axes)
        _, bound, _, _ = _level(lattice, problems)
        inside = rng.uniform(0, 1, (2, 40, corner.shape[1]))
        where = np.concatenate([inside, np.round(inside)], axis=1)  # corners too
        points = lattice.place((corner[:, None, :] + where).reshape(2, -1), np.zeros(1, dtype=np.intp))
        highest = log_density(problems, points).reshape(80, -1).max(axis=0)
        assert (highest[bound < lowest] < lowest).all()
        assert (bound < lowest).any() or finer == 1


def test_outline_and_mode_lie_on_the_ridge() -> None:
    problems = one_poor_clock()
    cells = divide(problems)
    (region,) = regions_of(problems, cells)
    outline = region.outlines[1][np.isfinite(region.outlines[1]).all(axis=1)]

    np.testing.assert_allclose(log_density(problems, outline.T), region.log_threshold[1], atol=0.35)
    assert log_density(problems, region.mode_rsun[:, None])[0] >= cells.log_density.max() - 1e-3
    share = np.exp(cells.log_density[0] - cells.log_density.max())
    np.testing.assert_allclose(region.modes.mean_rsun[0], cells.centres @ share / share.sum(), atol=0.3)

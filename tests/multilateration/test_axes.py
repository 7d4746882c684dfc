"""Bent axes: they follow the ridge, keep areas, and no cell along them is dropped that holds something."""

from dataclasses import replace

import numpy as np
import pytest

from bella.heliosphere.scattering import LITERATURE_DELAY, NO_DELAY
from bella.multilateration.axes import Axes, axes_of
from bella.multilateration.cells import DROP_NATS, Cells, Lattice, _first_lattice, _level, divide
from bella.multilateration.posterior import draw, moments_of
from bella.multilateration.priors import PRESETS
from bella.multilateration.problems import Problems, problems_of
from bella.multilateration.regions import log_density, regions_of
from bella.units import C_RSUN_S
from tests.multilateration.geometry import EVENT, NARROW, grid_of, on_spiral

POOR_S = (5.0, 120.0, 5.0)
BROAD = PRESETS["default"].priors


def one_poor_clock(range_rsun: float = 60.0, delay=NO_DELAY, priors=NARROW) -> Problems:
    grid = grid_of(on_spiral(range_rsun), EVENT, POOR_S)
    return problems_of(grid, priors, 2, delay=delay)


@pytest.mark.parametrize("range_rsun", [20.0, 60.0, 100.0])
def test_the_second_axis_follows_the_hyperbola_of_the_good_clocks(range_rsun) -> None:
    axes = axes_of(one_poor_clock(range_rsun))[0]
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
    assert axes_of(problems_of(grid_of(on_spiral(60), EVENT, 5.0), NARROW, 2))[0].curve is None


def test_displacement_keeps_areas_and_its_slope_is_its_derivative() -> None:
    axes = axes_of(one_poor_clock())[0]
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
    lattice = _first_lattice(problems, axes_of(problems)[0])
    angle = np.linspace(0, 2 * np.pi, 200)
    x, y = 730.0 * np.cos(angle), 730.0 * np.sin(angle)
    cosine, sine = lattice.axes.turn[:, 0]
    ahead = cosine * y - sine * x
    across = cosine * x + sine * y - lattice.axes.bend(ahead, slice(0, 1))[0]
    low, high = (lattice.origin[:, 0] + way * 6 * lattice.side[:, 0] for way in (-1, 1))

    assert (across >= low[0]).all()
    assert (across <= high[0]).all()
    assert (np.abs(ahead) <= high[1]).all()


def parabola(turn: np.ndarray) -> Axes:
    """Axes with h = 0.004 s^2 within 300 solar radii, straight beyond: steeper than any that are followed."""
    curve = np.array([[360.0, 360.0, 360.0], [-1440.0, -1440.0, 1440.0], [0.0, 1440.0, 0.0], [0.0, 0.0, 0.0]])
    return Axes(turn, curve[..., None], np.array([-300.0]), np.array([600.0]))


STEEP, OWN = parabola(np.array([[1.0], [0.0]])), axes_of(one_poor_clock())[0]


@pytest.mark.parametrize("axes", [STEEP, OWN], ids=["steep", "own"])
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
@pytest.mark.parametrize("kind", ["own", "steep", "fan"])
def test_no_cell_is_dropped_that_holds_something(finer, sigma_s, kind) -> None:
    rng = np.random.default_rng(3)
    for range_rsun in (15.0, 60.0, 150.0):
        grid = replace(grid_of(on_spiral(range_rsun), EVENT, sigma_s), rise_s=np.full((1, 3), 60.0))
        problems = problems_of(grid, BROAD, 2, delay=LITERATURE_DELAY)
        lowest = divide(problems).log_density.max() - DROP_NATS
        own = axes_of(problems)[0]
        axes = {"own": own, "steep": parabola(own.turn), "fan": fan()}[kind]
        low, high = np.array([[[-80.0], [-110.0]], [[80.0], [110.0]]]) if kind == "fan" else axes.limits(735.0, 2)
        corner = np.indices((12 * finer, 12 * finer)).reshape(2, -1)
        lattice = Lattice(corner, np.zeros(corner.shape[1], dtype=np.intp), (high - low) / 12 / finer, low, axes)
        bound = _level(lattice, problems.turned(axes.turn)).bound
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


NEAR_SUN = np.array([[16.0, 8.0, 0.1], [204.0, 2.0, -2.0], [210.0, 0.0, 0.0]])
FAR_SIDE = np.array([-95.0, 84.0, 0.0])


def near_the_sun() -> Problems:
    """A spacecraft near the Sun, from which the posterior opens as a fan."""
    grid = grid_of(FAR_SIDE, NEAR_SUN, (3.0, 5.0, 5.0))
    return problems_of(replace(grid, rise_s=np.full((1, 3), 120.0)), BROAD, 2, delay=LITERATURE_DELAY)


def fan() -> Axes:
    return Axes.fanned(np.array([[16.0], [8.0]]), np.array([[-60.0], [70.0]]))


def test_a_fan_is_as_its_equations_say() -> None:
    axes = fan()
    rng = np.random.default_rng(1)
    here = np.stack([rng.uniform(-60, 60, 200), rng.uniform(-100, 100, 200)])
    step = 1e-4
    across, along = (
        (axes.place(here + step * axis[:, None], slice(0, 1)) - axes.place(here - step * axis[:, None], slice(0, 1)))
        / (2 * step)
        for axis in np.eye(2)
    )
    area = across[0] * along[1] - across[1] * along[0]
    cosine, sine = axes.turn[:, 0]

    np.testing.assert_allclose(axes.place(np.zeros((2, 1)), slice(0, 1))[:, 0], [16.0, 8.0], atol=1e-12)
    np.testing.assert_allclose(axes.log_area(here, slice(0, 1)), np.log(area), atol=1e-6)
    ahead, aside = cosine * along[1] - sine * along[0], cosine * along[0] + sine * along[1]
    np.testing.assert_allclose(axes.shaped(here, slice(0, 1))[1], aside / ahead, atol=1e-6)
    far = axes.place(np.array([[0.0], [90.0]]), slice(0, 1))[:, 0] - [16.0, 8.0]
    np.testing.assert_allclose(far, 30 * np.sinh(3.0) * np.array([-76.0, 62.0]) / np.hypot(76, 62))


@pytest.mark.parametrize("half", [(2.0, 2.0), (30.0, 10.0), (10.0, 60.0)])
def test_no_place_of_a_cell_of_a_fan_is_farther_than_it_reaches(half) -> None:
    axes, rng = fan(), np.random.default_rng(2)
    centre = np.stack([rng.uniform(-60, 60, 50), rng.uniform(-100, 100, 50)])
    half_sides = np.array(half)[:, None] + np.zeros_like(centre)
    where = rng.choice([-1.0, -0.5, 0.0, 0.7, 1.0], (2, 60, 50))
    moved = axes.place(centre[:, None] + where * half_sides[:, None], slice(0, 1))
    moved -= axes.place(centre, slice(0, 1))[:, None]
    cosine, sine = axes.turn[:, 0]
    ahead = cosine * moved[1] - sine * moved[0]
    across = cosine * moved[0] + sine * moved[1] - axes.shaped(centre, slice(0, 1))[1] * ahead
    most = axes.spread(centre, half_sides, slice(0, 1))

    assert (np.abs(np.stack([across, ahead])).max(axis=1) <= most * (1 + 1e-9)).all()
    assert (np.abs(ahead).max(axis=0) > 0.3 * most[1]).all()


def test_coordinates_of_a_fan_cover_every_place_within_reach() -> None:
    axes, rng = fan(), np.random.default_rng(4)
    points, reach = rng.uniform(-300, 300, (2, 80)), rng.uniform(1, 90, 80)
    low, high = axes.within(points, reach, np.zeros(80, dtype=np.intp))
    along = rng.uniform(-700, 700, 40_000), rng.uniform(-110, 110, 40_000)
    place = axes.place(np.array(along), slice(0, 1))
    for i in range(80):
        inside = np.hypot(*(place - points[:, i : i + 1])) < reach[i]
        for axis in range(2):
            assert (along[axis][inside] >= low[axis, i]).all()
            assert (along[axis][inside] <= high[axis, i]).all()


def in_fans(problems: Problems) -> Cells:
    cells = divide(problems)
    assert cells.axes.fan is not None
    return cells


def test_a_fan_takes_few_cells_and_gives_what_straight_cells_give(monkeypatch) -> None:
    problems = near_the_sun()
    cells = in_fans(problems)
    (region,) = regions_of(problems, cells)
    here = moments_of(problems, cells)
    drawn = draw(problems, cells, 4000, np.random.default_rng(5))
    monkeypatch.setattr("bella.multilateration.cells.MANY_CELLS", np.inf)
    straight = divide(problems)
    there, (same,) = moments_of(problems, straight), regions_of(problems, straight)
    sd = np.sqrt(np.einsum("bii->bi", there.covariance))

    assert straight.axes.fan is None
    assert cells.owner.size < 0.3 * straight.owner.size
    np.testing.assert_allclose(here.mean / sd, there.mean / sd, atol=5e-3)
    np.testing.assert_allclose(np.sqrt(np.einsum("bii->bi", here.covariance)), sd, rtol=5e-3)
    np.testing.assert_allclose(here.log_evidence, there.log_evidence, atol=3e-3)
    np.testing.assert_allclose([here.kappa, here.emission_sd_s], [there.kappa, there.emission_sd_s], rtol=5e-3)
    np.testing.assert_allclose(region.area_rsun2, same.area_rsun2, rtol=0.02)
    np.testing.assert_allclose(region.modes.weight[0], same.modes.weight[0], atol=0.01)
    assert drawn.effective[0] > 3600
    np.testing.assert_allclose(drawn.position[0].mean(axis=0) / sd[0], here.mean[0] / sd[0], atol=0.06)
    np.testing.assert_allclose(drawn.position[0].std(axis=0), sd[0], rtol=0.05)


def test_problems_in_fans_and_bent_ones_stand_beside_one_another() -> None:
    sources, receivers = np.stack([FAR_SIDE, on_spiral(60.0), FAR_SIDE]), np.stack([NEAR_SUN, EVENT, NEAR_SUN])
    distance = np.linalg.norm(sources[:, None] - receivers, axis=2)
    grid = replace(
        grid_of(sources, NEAR_SUN, np.array([(3.0, 5.0, 5.0), POOR_S, (3.0, 6.0, 5.0)])),
        arrival_s=distance / C_RSUN_S,
        receiver_rsun=receivers,
        rise_s=np.array([[120.0], [0.0], [120.0]]) + np.zeros((3, 3)),
    )
    problems = problems_of(grid, BROAD, 2, delay=LITERATURE_DELAY)
    together = in_fans(problems)
    scale = together.axes.fan[2]
    assert scale[1] > 1e6 > scale[0] == scale[2]
    assert together.axes.curve is not None
    assert together.axes.curve[..., 1].any()
    moments, regions = moments_of(problems, together), regions_of(problems, together)
    for row in range(3):
        one = problems.at(slice(row, row + 1))
        cells = divide(one)
        alone, (region,) = moments_of(one, cells), regions_of(one, cells)
        np.testing.assert_allclose(moments.mean[row], alone.mean[0], rtol=1e-9)
        np.testing.assert_allclose(moments.log_evidence[row], alone.log_evidence[0], rtol=1e-9)
        np.testing.assert_allclose(regions[row].area_rsun2, region.area_rsun2, rtol=1e-9)

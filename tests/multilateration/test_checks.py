"""Every flag is raised beyond its limit and not before it, and modes count from theirs."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from bella.multilateration import localise
from bella.multilateration.axes import Axes
from bella.multilateration.checks import flags_of
from bella.multilateration.regions import Image, find_modes
from tests.multilateration.geometry import EVENT, FOUR, PLAIN, grid_of, on_spiral, table_of


@pytest.fixture(scope="module")
def solved():
    return localise(table_of(grid_of(on_spiral(75), FOUR, 5.0)), preset=PLAIN, draws=100)


@pytest.mark.parametrize(
    ("name", "limit", "flag"),
    [
        ("misfit", stats.chi2.isf(1e-4, 3), "arrivals_inconsistent"),
        ("above_c_probability", 0.95, "speed_above_c"),
        ("bad_probability", 0.5, "bad_arrival"),
    ],
)
def test_a_flag_is_raised_above_its_limit(solved, name, limit, flag) -> None:
    below, above = (flags_of(solved.assign({name: solved[name] * 0 + limit * share}))[0] for share in (0.97, 1.03))
    assert flag not in below.split(";")
    assert flag in above.split(";")


@pytest.mark.parametrize(("share", "raised"), [(0.48, True), (0.52, False)])
def test_half_of_the_draws_are_few(solved, share, raised) -> None:
    moved = solved.assign(draw_ess=solved["draw_ess"] * 0 + 100 * share)
    assert ("few_effective_draws" in flags_of(moved)[0]) == raised


def two_bumps(lower_nats: float, saddle_nats: float) -> Image:
    """A ridge with two tops, of which the second is lower, and the saddle between lower again than that."""
    profile = np.interp(np.arange(21), [0, 5, 10, 15, 20], [-20, 0, -lower_nats - saddle_nats, -lower_nats, -20])
    across = -0.5 * (np.arange(-3, 4) / 1.5) ** 2
    return Image(profile[:, None] + across, np.zeros(2), np.ones(2), Axes.straight(np.array([[1.0], [0.0]])))


@pytest.mark.parametrize(
    ("lower_nats", "saddle_nats", "modes"), [(5.5, 2.0, 2), (6.5, 2.0, 1), (1.0, 0.6, 2), (1.0, 0.4, 1)]
)
def test_a_mode_is_not_far_below_and_stands_by_itself(lower_nats, saddle_nats, modes) -> None:
    assert find_modes(two_bumps(lower_nats, saddle_nats)).weight.size == modes


def test_a_turned_image_has_its_modes_where_the_lattice_lies() -> None:
    turn = np.array([np.cos(0.7), np.sin(0.7)])
    image = two_bumps(1.0, 2.0)
    straight, turned = find_modes(image), find_modes(replace(image, axes=Axes.straight(turn[:, None])))
    matrix = np.array([[turn[0], -turn[1]], [turn[1], turn[0]]])

    np.testing.assert_allclose(turned.mean_rsun, straight.mean_rsun @ matrix.T, atol=1e-9)


def test_three_receivers_have_one_degree_of_freedom_less() -> None:
    three = localise(table_of(grid_of(on_spiral(75), EVENT, 5.0)), preset=PLAIN, draws=100)
    between = 0.5 * (stats.chi2.isf(1e-4, 2) + stats.chi2.isf(1e-4, 3))
    assert "arrivals_inconsistent" in flags_of(three.assign(misfit=three["misfit"] * 0 + between))[0]

"""Cells are few, and hold the posterior all the same: each constant of the division is seen in one or the other."""

import numpy as np
import pytest

from bella.arrivals import ArrivalGrid
from bella.multilateration import cells as cells_module
from bella.multilateration.cells import divide
from bella.multilateration.likelihood import survey
from bella.multilateration.posterior import draw, moments_of
from bella.multilateration.priors import PRESETS
from bella.multilateration.problems import Problems, problems_of
from bella.units import C_RSUN_S
from tests.multilateration.geometry import EVENT, FOUR, NARROW, REFERENCE_UTC, ROBUST, grid_of, on_spiral, sd_of


def burst(source: np.ndarray, receivers: np.ndarray, sigma_s: np.ndarray, rise_s: float, noise: np.ndarray) -> Problems:
    """One frequency with a directional delay and the default prior."""
    distance = np.linalg.norm(source - receivers, axis=1)
    grid = ArrivalGrid(
        frequency_mhz=np.ones(1),
        observatories=("A", "B", "C"),
        arrival_s=(distance / C_RSUN_S + noise * sigma_s)[None],
        sigma_s=sigma_s[None],
        receiver_rsun=receivers[None],
        reference_utc=REFERENCE_UTC,
        edge="none",
        rise_s=np.full((1, 3), rise_s),
    )
    preset = PRESETS["default"]
    return problems_of(grid, preset.priors, 2, preset.noise, preset.delay)


def place(range_rsun, longitude_rad, z_rsun=0.0) -> np.ndarray:
    return np.stack(
        np.broadcast_arrays(range_rsun * np.cos(longitude_rad), range_rsun * np.sin(longitude_rad), z_rsun), axis=-1
    )


def near_the_sun(seed: int) -> Problems:
    """Two spacecraft near 1 au and one between 22 and 40 solar radii from the Sun."""
    rng = np.random.default_rng(seed)
    ranges = np.array([215.0, 206.0, rng.uniform(22, 40)])
    angle = np.radians([0.0, rng.uniform(20, 120), rng.uniform(-180, 180)])
    receivers = place(ranges, angle, rng.normal(0, 1, 3))
    range_rsun = rng.uniform(4, 60)
    source = place(range_rsun, rng.uniform(-np.pi, np.pi))
    sigma_s = np.array([5.0, 5.0, 2.0]) * rng.choice([0.4, 1, 2])
    return burst(source, receivers, sigma_s, 33 / (12 / range_rsun) ** 1.05, rng.standard_normal(3))


def one_poor_clock(seed: int) -> Problems:
    """The spacecraft of the event, one of them with an error of 120 s."""
    rng = np.random.default_rng(1000 + seed)
    source = place(rng.uniform(10, 130), rng.uniform(-np.pi, np.pi))
    return burst(source, EVENT, rng.permutation([4.0, 5.0, 120.0]), 40.0, rng.standard_normal(3))


CASES = {"near the Sun": near_the_sun, "one poor clock": one_poor_clock}


@pytest.mark.parametrize("seed", [10, 12, 37])
def test_steep_cells_near_the_sun_do_not_ruin_the_draws(seed) -> None:
    problems = near_the_sun(seed)
    drawn = draw(problems, divide(problems), 4000, np.random.default_rng(1))

    assert drawn.effective[0] > 3900


@pytest.mark.parametrize(
    ("kind", "seed", "usual"),
    [
        ("near the Sun", 2, 1891),
        ("near the Sun", 6, 1143),
        ("near the Sun", 9, 4639),
        ("near the Sun", 10, 3832),
        ("near the Sun", 12, 1284),
        ("one poor clock", 1, 423),
        ("one poor clock", 3, 377),
        ("one poor clock", 6, 376),
    ],
)
def test_cells_are_few(kind, seed, usual) -> None:
    assert divide(CASES[kind](seed)).owner.size < 1.15 * usual


@pytest.mark.parametrize(
    ("kind", "seed", "within"),
    [
        ("near the Sun", 0, 5e-4),
        ("near the Sun", 4, 5e-4),
        ("near the Sun", 6, 5e-4),
        ("one poor clock", 0, 5e-4),
        ("one poor clock", 9, 4e-3),  # its ridge leads across the Sun
    ],
)
def test_finer_and_farther_cells_change_nothing(kind, seed, within, monkeypatch) -> None:
    problems = CASES[kind](seed)
    usual = moments_of(problems, divide(problems))
    monkeypatch.setattr(cells_module, "BELOW_NATS", 22.0)
    monkeypatch.setattr(cells_module, "COARSE_SHARE", 1e-6)
    whole = moments_of(problems, divide(problems, tolerance=0.8, drop_nats=20.0))

    np.testing.assert_allclose(usual.mean / sd_of(whole), whole.mean / sd_of(whole), atol=within)
    np.testing.assert_allclose(sd_of(usual), sd_of(whole), rtol=within)
    np.testing.assert_allclose(usual.log_evidence, whole.log_evidence, atol=within)


def test_tails_of_bad_arrival_times_are_held(monkeypatch) -> None:
    problems = problems_of(grid_of(on_spiral(60), FOUR, 9.0), NARROW, 2, ROBUST.noise)
    usual = moments_of(problems, divide(problems))
    monkeypatch.setattr(cells_module, "BELOW_NATS_OF_MIXTURE", 25.0)
    whole = moments_of(problems, divide(problems, drop_nats=25.0))

    np.testing.assert_allclose(usual.mean / sd_of(whole), whole.mean / sd_of(whole), atol=5e-4)
    np.testing.assert_allclose(sd_of(usual), sd_of(whole), rtol=5e-4)


def test_the_root_of_the_misfit_changes_as_stated_next_to_its_least_too() -> None:
    problem = one_poor_clock(3)
    axis = np.linspace(-130, 130, 600)
    points = np.stack(np.meshgrid(axis, axis)).reshape(2, -1)
    points = points[:, np.argsort(survey(problem, points, None).misfit[0])[:30]]
    stated = survey(problem, points, None)
    assert stated.misfit.max() < 0.1
    for along, step in enumerate(1e-3 * np.eye(2)[:, :, None]):
        after, before = (np.sqrt(survey(problem, points + sign * step, None).misfit) for sign in (1, -1))
        np.testing.assert_allclose(stated.root_slope[along], (after - before) / 2e-3, atol=1e-5)

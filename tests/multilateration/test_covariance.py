"""Errors that are correlated between receivers, and a directional delay, against sums over grids and dense algebra."""

from dataclasses import replace

import numpy as np
import pytest

from bella.arrivals import ArrivalGrid, check_arrivals
from bella.exceptions import InputError
from bella.heliosphere.scattering import DirectionalDelay
from bella.multilateration import PRESETS, localise, uncertainty_map
from bella.multilateration.cells import divide
from bella.multilateration.checks import flags_of, predictive_check
from bella.multilateration.posterior import draw, moments_of
from bella.multilateration.priors import Preset, Priors
from bella.multilateration.problems import problems_of
from tests.multilateration.geometry import EVENT, FOUR, NARROW, PLAIN, WIDE, grid_of, on_spiral, polar, sd_of, table_of

LIGHT_RSUN_S = 299_792.458 / 695_700.0
DELAY = DirectionalDelay(0.15, 0.12)
BROAD = PRESETS["default"].priors


def correlated(grid: ArrivalGrid, seed: int = 4) -> ArrivalGrid:
    """The same with a random covariance whose variances are those of the grid."""
    count, number = grid.arrival_s.shape
    root = np.random.default_rng(seed).normal(size=(number, number)) + 0.7
    matrix = root @ root.T
    matrix /= np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    measured = np.zeros((count, number, count, number))
    for row in range(count):
        measured[row, :, row] = matrix * np.outer(grid.sigma_s[row], grid.sigma_s[row])
    return replace(grid, measured_s2=measured)


def late_for_one(points: np.ndarray, receiver: np.ndarray) -> np.ndarray:
    """1 - cos of the angle at points (2, M) between outward and the direction to a receiver."""
    outward = np.arctan2(points[1], points[0])
    towards = np.arctan2(receiver[1] - points[1], receiver[0] - points[0])
    return 1 - np.cos(outward - towards)


def brute(grid: ArrivalGrid, priors: Priors, delay: DirectionalDelay, half_width: float, pitch: float):
    """Mean, sd, evidence, kappa and emission time by a sum over positions, speeds and kappas, and dense algebra."""
    axis = np.arange(-half_width, half_width, pitch) + pitch / 2
    x, y = on_spiral(60)[:2]
    points = np.stack(np.meshgrid(axis + x, axis + y)).reshape(2, -1)
    n = len(grid.observatories)
    covariance = np.diag(grid.sigma_s[0] ** 2) if grid.measured_s2 is None else grid.measured_s2[0, :, 0]
    weight = np.linalg.inv(covariance)
    total = weight.sum()
    projected = weight - np.outer(weight.sum(axis=0), weight.sum(axis=0)) / total
    distance = np.stack([np.hypot(points[0] - r[0], points[1] - r[1]) for r in grid.receiver_rsun[0]])
    lateness = np.stack([grid.rise_s[0, i] * late_for_one(points, r) for i, r in enumerate(grid.receiver_rsun[0])])
    z = np.linspace(-5, 5, 25)
    parts = []
    for speed in z if priors.v_sd_c > 0.01 else (0.0,):
        v = (1 + priors.v_sd_c * speed) * LIGHT_RSUN_S
        for k in z if delay.kappa_sd else (0.0,):
            kappa = delay.kappa + delay.kappa_sd * k
            r = grid.arrival_s[0][:, None] - distance / v - kappa * lateness
            log = -0.5 * np.einsum("im,ij,jm->m", r, projected, r) - 0.5 * (speed**2 + k**2)
            mean_emission = weight.sum(axis=0) @ r / total
            parts.append((log, np.full(log.size, kappa), mean_emission))
    log, kappa, emission = (np.concatenate([part[i] for part in parts]) for i in range(3))
    radius = np.tile(np.hypot(*points), len(parts))
    log = log - 0.5 * (radius / priors.tau_rsun) ** priors.power
    mass = np.exp(log - log.max())
    steps = (z[1] - z[0]) / np.sqrt(2 * np.pi)
    norm = steps ** ((priors.v_sd_c > 0.01) + bool(delay.kappa_sd)) * pitch**2
    fine = np.linspace(0, 8 * priors.tau_rsun, 400_001)
    volume = np.trapezoid(2 * np.pi * fine * np.exp(-0.5 * (fine / priors.tau_rsun) ** priors.power), fine)
    evidence = log.max() + np.log(mass.sum() * norm) - np.log(volume) - np.log(2 * priors.emission_half_width_s)
    evidence += -0.5 * np.linalg.slogdet(covariance)[1] - 0.5 * np.log(total) - 0.5 * (n - 1) * np.log(2 * np.pi)
    mass /= mass.sum()
    where = np.tile(points, len(parts))
    mean = where @ mass
    sd = np.sqrt((where - mean[:, None]) ** 2 @ mass)
    k_mean, t_mean = kappa @ mass, emission @ mass
    t_sd = np.sqrt((emission - t_mean) ** 2 @ mass + 1 / total)
    return mean, sd, evidence, (k_mean, np.sqrt((kappa - k_mean) ** 2 @ mass)), (t_mean, t_sd)


NOISE = np.array([0.6, -0.9, 0.4, 0.8])
CASES = {
    "correlated": (EVENT, 12.0, NARROW, DirectionalDelay(0.0, 0.0), True),
    "correlated, broad prior, delay": (EVENT, 12.0, BROAD, DELAY, True),
    "delay": (FOUR, 8.0, NARROW, DELAY, False),
    "delay and speed, correlated": (FOUR, 25.0, WIDE, DELAY, True),
    "fixed delay": (EVENT, 10.0, NARROW, DirectionalDelay(0.2, 0.0), False),
}


@pytest.mark.parametrize("name", CASES)
def test_agrees_with_a_sum_over_positions_speeds_and_delays(name) -> None:
    receivers, sigma_s, priors, delay, dense = CASES[name]
    sigma = sigma_s * np.array([1.0, 1.4, 0.7, 1.1])[: len(receivers)]
    grid = grid_of(on_spiral(60), receivers, sigma, noise=NOISE[: len(receivers)])
    grid = replace(grid, rise_s=np.full((1, len(receivers)), 70.0) * np.array([1.0, 1.2, 0.8, 1.1])[: len(receivers)])
    grid = correlated(grid) if dense else grid
    half_width, pitch = (110.0, 2.5) if priors.v_sd_c > 0.01 else (110.0, 1.2)
    mean, sd, evidence, kappa, emission = brute(grid, priors, delay, half_width, pitch)
    problems = problems_of(grid, priors, 2, delay=delay)
    cells = divide(problems)
    solved, drawn = moments_of(problems, cells), draw(problems, cells, 8000, np.random.default_rng(2))

    np.testing.assert_allclose((solved.mean[0] - mean) / sd, 0, atol=3e-3)
    np.testing.assert_allclose(sd_of(solved)[0], sd, rtol=3e-3)
    assert solved.log_evidence[0] == pytest.approx(evidence, abs=3e-3)
    assert solved.kappa[0] == pytest.approx(kappa[0], abs=2e-3 * max(kappa[1], 0.01))
    assert solved.kappa_sd[0] == pytest.approx(kappa[1], rel=3e-3, abs=1e-9)
    assert solved.emission_s[0] == pytest.approx(emission[0], abs=5e-3 * emission[1])
    assert solved.emission_sd_s[0] == pytest.approx(emission[1], rel=4e-3)
    margin = 4.5 / np.sqrt(0.85 * 8000)
    np.testing.assert_allclose((drawn.position[0].mean(axis=0) - mean) / sd, 0, atol=margin)
    np.testing.assert_allclose(drawn.position[0].std(axis=0) / sd, 1, atol=margin)
    if delay.kappa_sd:
        assert (drawn.kappa[0].mean() - kappa[0]) / kappa[1] == pytest.approx(0, abs=margin)
        assert drawn.kappa[0].std() / kappa[1] == pytest.approx(1, abs=margin)
    assert (drawn.emission_s[0].mean() - emission[0]) / emission[1] == pytest.approx(0, abs=margin)
    assert drawn.emission_s[0].std() / emission[1] == pytest.approx(1, abs=margin)


def test_a_covariance_given_to_the_door_is_the_one_of_the_grid() -> None:
    grid = correlated(grid_of([on_spiral(75), on_spiral(40)], FOUR, 9.0, noise=NOISE))
    whole = np.zeros((8, 8))
    for row in range(2):
        whole[4 * row : 4 * row + 4, 4 * row : 4 * row + 4] = grid.measured_s2[row, :, row]
    solved = localise(table_of(grid), preset=PLAIN, covariance_s2=whole, draws=10)
    problems = problems_of(grid, NARROW, 2)

    np.testing.assert_allclose(solved["x_rsun"], moments_of(problems, divide(problems)).mean[:, 0], atol=1e-4)
    plain = localise(table_of(grid), preset=PLAIN, draws=10)
    assert float(abs(solved["x_rsun"] - plain["x_rsun"]).max()) > 0.2
    constant = localise(table_of(grid), preset="bella-2024", covariance_s2=whole, draws=10)
    assert (constant["cov_xx_rsun2"] == localise(table_of(grid), preset="bella-2024", draws=10)["cov_xx_rsun2"]).all()


@pytest.mark.parametrize("method", [pytest.param("nuts", marks=pytest.mark.acceptance), "tdoa"])
def test_the_other_methods_take_covariance_and_delay(method) -> None:
    grid = correlated(grid_of(on_spiral(60), FOUR, 4.0 if method == "tdoa" else 25.0, noise=NOISE))
    whole = grid.measured_s2[0, :, 0]
    wide = Priors(tau_rsun=3000.0, v_sd_c=1e-6) if method == "tdoa" else NARROW
    at_c = Preset("case", wide, "table", delay=DirectionalDelay(0.15, 0.05))
    table = table_of(grid).assign(rise_s=60.0)
    other = localise(table, preset=at_c, covariance_s2=whole, method=method, draws=6000, seed=2)
    exact = localise(table, preset=at_c, covariance_s2=whole, draws=6000)

    for axis in "xy":
        sd = float(np.sqrt(exact[f"cov_{axis}{axis}_rsun2"].item()))
        assert other[f"{axis}_rsun"].item() == pytest.approx(exact[f"{axis}_rsun"].item(), abs=0.12 * sd)
        assert other[f"cov_{axis}{axis}_rsun2"].item() == pytest.approx(sd**2, rel=0.12)
    assert other["emission_sd_s"].item() == pytest.approx(exact["emission_sd_s"].item(), rel=0.08)
    emission = other["draws"].sel(parameter="emission_s")
    assert float(emission.std()) == pytest.approx(exact["emission_sd_s"].item(), rel=0.1)


def test_a_delay_of_zero_is_no_delay_and_the_option_goes_before_the_preset() -> None:
    table = check_arrivals(table_of(grid_of([on_spiral(75), on_spiral(40)], EVENT, 9.0)))
    none, tiny = (localise(table, delay=DirectionalDelay(0.0, sd), draws=10) for sd in (0.0, 1e-7))
    default = localise(table, draws=10)

    np.testing.assert_allclose(tiny["x_rsun"], none["x_rsun"], atol=1e-3)
    assert (none["contraction_kappa"] == 1).all()
    assert (default["area68_rsun2"] > none["area68_rsun2"]).all()
    assert float(default["area68_rsun2"][0]) > 1.1 * float(none["area68_rsun2"][0])
    assert float(default["contraction_kappa"].min()) > 0.9


@pytest.mark.parametrize(
    ("covariance", "reason"),
    [
        (np.eye(5), r"covariance_s2 is \(5, 5\), the table has 3 rows"),
        (np.diag([1.0, 1.0, -1.0]), "no eigenvalue may be below 0"),
        (np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]]), "is not symmetric and finite"),
    ],
)
def test_a_matrix_that_is_no_covariance_is_refused(covariance, reason) -> None:
    with pytest.raises(InputError, match=reason):
        localise(table_of(grid_of(on_spiral(75), EVENT, 9.0)), covariance_s2=covariance)


def test_predictive_check_takes_covariance_and_delay() -> None:
    """For good times with strongly correlated errors the p-value is neither small nor near 1."""
    grid = grid_of(np.tile(on_spiral(60), (40, 1)), FOUR, 20.0)
    grid = correlated(grid)
    root = np.linalg.cholesky(grid.measured_s2[0, :, 0])
    rng = np.random.default_rng(5)
    rise = 50.0
    late = np.array([late_for_one(on_spiral(60)[:2, None], receiver)[0] for receiver in FOUR])
    noisy = replace(
        grid,
        arrival_s=grid.arrival_s + rng.standard_normal((40, 4)) @ root.T + 0.15 * rise * late,
        rise_s=np.full((40, 4), rise),
    )
    problems = problems_of(noisy, NARROW, 2, delay=DELAY)
    drawn = draw(problems, divide(problems), 400, rng)
    check = predictive_check(noisy, drawn, np.zeros((40, 4)))

    # four times, of which three parameters take most
    assert 0.5 < check.burst_p.mean() < 0.85
    np.testing.assert_allclose(check.residual_s.mean(axis=0), 0, atol=6)


def test_the_prior_decides_far_out_and_that_is_flagged() -> None:
    far = grid_of(polar(150.0, 60.0), EVENT, 60.0)
    none = DirectionalDelay(0.0, 0.0)
    paper, broad = (
        localise(table_of(far), preset=preset, delay=none, draws=10)
        for preset in (PLAIN, Preset("broad", BROAD, "table"))
    )

    assert "prior_dominated" in paper["flags"].item()
    assert "prior_dominated" not in broad["flags"].item()
    # towards the Sun, by more than half a standard deviation with the prior of the paper
    assert paper["prior_pull_x_rsun"].item() < 2 * broad["prior_pull_x_rsun"].item() < 0
    near = localise(table_of(grid_of(on_spiral(75), EVENT, 5.0)), preset=PLAIN, draws=10)
    assert "prior_dominated" not in near["flags"].item()


@pytest.mark.parametrize(("pull_sd", "flagged"), [(0.45, False), (0.55, True)])
def test_half_a_standard_deviation_is_the_limit(pull_sd, flagged) -> None:
    solved = localise(table_of(grid_of(on_spiral(75), EVENT, 5.0)), preset=PLAIN, draws=10)
    names = ("cov_xx_rsun2", "cov_xy_rsun2", "cov_yy_rsun2")
    xx, xy, yy = (solved[name].item() for name in names)
    covariance = np.array([[xx, xy], [xy, yy]])
    pull = pull_sd * np.linalg.cholesky(covariance)[:, 0]
    moved = solved.assign(
        prior_pull_x_rsun=solved["prior_pull_x_rsun"] * 0 + pull[0],
        prior_pull_y_rsun=solved["prior_pull_y_rsun"] * 0 + pull[1],
    )

    assert ("prior_dominated" in flags_of(moved)[0]) == flagged


@pytest.mark.parametrize("correlation", [0.0, 0.7, -0.3])
def test_maps_take_correlated_errors(correlation) -> None:
    """Closed form and exact posterior agree where timing is sharp, and with the inverse of the dense information."""
    matrix = np.full((4, 4), correlation) + (1 - correlation) * np.eye(4)
    fleet = {f"R{i}": receiver for i, receiver in enumerate(FOUR)}
    solved = uncertainty_map(fleet, 2.0, NARROW, size=3, half_width_rsun=40.0, exact=True, correlation=matrix)
    source = np.array([40.0, -40.0])
    offset = np.append(source, 0.0) - FOUR
    unit = offset[:, :2] / np.linalg.norm(offset, axis=1)[:, None] / LIGHT_RSUN_S
    design = np.c_[np.ones(4), unit]
    expected = np.linalg.inv(design.T @ np.linalg.inv(4.0 * matrix) @ design)[1:, 1:]
    there = solved.sel(x=40.0, y=-40.0)

    assert float(there["sd_x_rsun"]) == pytest.approx(np.sqrt(expected[0, 0]), rel=0.02)
    assert float(there["exact_sd_x_rsun"]) == pytest.approx(np.sqrt(expected[0, 0]), rel=0.02)
    assert float(there["cov_xy_rsun2"]) == pytest.approx(expected[0, 1], rel=0.02, abs=0.02)

"""A source anywhere in space: against a brute-force sum, its mirror image, and what is only prior."""

import numpy as np
import pytest

from bella.exceptions import InputError
from bella.multilateration.cells import divide
from bella.multilateration.posterior import draw, moments_of
from bella.multilateration.priors import Preset, Priors
from bella.multilateration.problems import problems_of
from bella.units import AU_RSUN, C_RSUN_S
from tests.multilateration.geometry import CADENCE_S, EVENT, FIVE, NARROW, WIDE, first, grid_of, moments, regions, sd_of

ABOVE = np.vstack([EVENT, AU_RSUN * np.array([0.33, 0.28, 0.25])])
SOURCE = (73.8, 13.5, 30.0)
SPREAD = np.vstack([ABOVE, AU_RSUN * np.array([-0.2, -0.5, -0.4])])


def brute_force(grid, pitch: float = 5.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, covariance and volumes of the 68 and 95 % regions, at the speed of light."""
    axis = np.arange(-402.5, 403, pitch)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij")).reshape(3, -1)
    w = grid.sigma_s[0] ** -2.0
    d = np.stack([np.sqrt(((points.T - receiver) ** 2).sum(axis=1)) for receiver in grid.receiver_rsun[0]])
    r = grid.arrival_s[0][:, None] - d / C_RSUN_S
    misfit = (w[:, None] * (r - w @ r / w.sum()) ** 2).sum(axis=0)
    log_density = -0.5 * misfit - 0.5 * (points**2).sum(axis=0) / NARROW.tau_rsun**2
    mass = np.exp(log_density - log_density.max())
    mass /= mass.sum()
    mean = points @ mass
    running = np.cumsum(np.sort(mass)[::-1])
    volumes = pitch**3 * np.searchsorted(running, (0.68, 0.95))
    return mean, (points - mean[:, None]) * mass @ (points - mean[:, None]).T, volumes


@pytest.mark.parametrize("receivers", [ABOVE, SPREAD], ids=["four", "five"])
def test_agrees_with_a_brute_force_sum(receivers) -> None:
    grid = grid_of(SOURCE, receivers, 40.0, noise=np.array([0.4, -0.9, 0.2, 0.7, -0.3])[: len(receivers)])
    mean, covariance, volumes = brute_force(grid)
    solved, (region,) = moments(grid, dimensions=3), regions(grid, dimensions=3)

    np.testing.assert_allclose(solved.mean[0], mean, atol=0.02)
    np.testing.assert_allclose(solved.covariance[0], covariance, rtol=2e-3, atol=1.0)
    np.testing.assert_allclose(region.volume_rsun3, volumes, rtol=0.03)
    assert region.area_rsun2[0] < region.area_rsun2[1]


@pytest.mark.parametrize("priors", [NARROW, WIDE], ids=["narrow", "wide"])
def test_draws_agree_with_moments_and_finer_cells_change_nothing(priors) -> None:
    grid = grid_of(SOURCE, SPREAD, 20.0)
    problems = problems_of(grid, priors, 3)
    cells = divide(problems)
    solved, drawn = moments_of(problems, cells), draw(problems, cells, 8000, np.random.default_rng(2))

    assert drawn.effective[0] > 0.9 * 8000
    error = (drawn.position[0].mean(axis=0) - solved.mean[0]) / sd_of(solved)[0]
    assert np.abs(error).max() < 4.5 / np.sqrt(7200)
    np.testing.assert_allclose(np.cov(drawn.position[0].T) / solved.covariance[0], 1, atol=0.5)
    fine = moments(grid, priors, 0.7, dimensions=3)
    np.testing.assert_allclose((fine.mean - solved.mean) / sd_of(fine), 0, atol=1e-3)
    np.testing.assert_allclose(sd_of(fine), sd_of(solved), rtol=1e-3)


def test_receivers_in_one_plane_leave_the_mirror_image() -> None:
    (region,) = regions(grid_of((40.0, 20.0, 70.0), FIVE, 7.0), dimensions=3)

    assert region.modes.weight.size == 2
    np.testing.assert_allclose(region.modes.weight, 0.5, atol=1e-6)
    np.testing.assert_allclose(sorted(region.modes.mean_rsun[:, 2]), [-66, 66], atol=12)
    assert abs(moments(grid_of((40.0, 20.0, 70.0), FIVE, 7.0), dimensions=3).mean[0, 2]) < 1e-6


def test_a_receiver_above_the_plane_tells_the_source_from_its_image() -> None:
    solved = moments(grid_of((40.0, 20.0, 70.0), SPREAD, 3.0), dimensions=3)

    np.testing.assert_allclose(solved.mean[0], (40.0, 20.0, 70.0), atol=3)
    assert (sd_of(solved)[0] < 6).all()


def test_three_receivers_say_nothing_of_the_third_coordinate_and_that_is_said() -> None:
    solved = first(grid_of(SOURCE, EVENT, CADENCE_S), dimensions=3, draws=200)

    assert "z_not_constrained" in solved["flags"].item()
    assert "x_not_constrained" not in solved["flags"].item()
    assert float(solved["contraction_z"]) > 0.9
    assert solved["draws"].shape == (200, 5)
    assert solved["parameter"].to_numpy().tolist() == ["x_rsun", "y_rsun", "z_rsun", "emission_s", "v_over_c"]
    for name in ("cov_xz_rsun2", "cov_yz_rsun2", "cov_zz_rsun2", "volume68_rsun3", "volume95_rsun3", "mode_z_rsun"):
        assert np.isfinite(solved[name]).all(), name
    assert solved.attrs["dimensions"] == 3


def test_a_source_held_in_the_plane_has_no_third_coordinate() -> None:
    solved = first(grid_of((75.0, 10.0, 0.0), EVENT, CADENCE_S))

    assert float(solved["z_rsun"]) == 0
    assert not {"cov_zz_rsun2", "volume68_rsun3", "contraction_z"} & set(solved.data_vars)


def test_time_differences_agree_with_the_posterior_where_it_is_narrow() -> None:
    grid = grid_of((30.0, 20.0, 10.0), SPREAD, 1.0)
    at_c = Preset("at c", Priors(v_sd_c=1e-6), "table")
    tdoa, exact = (first(grid, preset=at_c, dimensions=3, method=name, draws=4000) for name in ("tdoa", "posterior"))

    for axis in "xyz":
        sd = np.sqrt(float(exact[f"cov_{axis}{axis}_rsun2"]))
        assert float(tdoa[f"{axis}_rsun"]) == pytest.approx(float(exact[f"{axis}_rsun"]), abs=0.05 * sd)
        assert float(tdoa[f"cov_{axis}{axis}_rsun2"]) == pytest.approx(sd**2, rel=0.05)
    assert float(tdoa["volume68_rsun3"]) == pytest.approx(float(exact["volume68_rsun3"]), rel=0.06)
    assert float(tdoa["emission_sd_s"]) == pytest.approx(float(exact["emission_sd_s"]), rel=0.05)
    assert float(tdoa["draws"].sel(parameter="emission_s").std()) == pytest.approx(
        float(exact["emission_sd_s"]), rel=0.05
    )


def test_time_differences_in_space_need_four_receivers_and_say_so() -> None:
    with pytest.raises(InputError, match=r"method tdoa, .* fewer than 4 receivers"):
        first(grid_of(SOURCE, EVENT, CADENCE_S), dimensions=3, method="tdoa")

"""Uncertainty maps: the closed form against the exact posterior, both against published and measured numbers."""

from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bella.exceptions import ConvergenceError, GeometryError, InputError
from bella.multilateration import cells as cells_module
from bella.multilateration import uncertainty_map
from bella.multilateration.likelihood import slope_and_information
from bella.multilateration.priors import Priors
from bella.multilateration.problems import problems_of
from bella.multilateration.uncertainty_map import (
    Receivers,
    closed_form_covariance,
    exact_covariance,
    exact_nodes,
    largest_sd,
    timing_errors,
)
from bella.units import AU_RSUN, C_RSUN_S
from tests.multilateration.geometry import EVENT, FIVE, NARROW, WIDE, grid_of, moments, on_spiral, sd_of, spread

uncertainty_map_module = import_module("bella.multilateration.uncertainty_map")
SPIRAL = np.array([on_spiral(r)[:2] for r in np.linspace(10, 150, 15)])


def receivers_of(positions: np.ndarray, sigma_s: float) -> Receivers:
    return Receivers(tuple(f"R{i}" for i in range(len(positions))), positions, np.full(len(positions), sigma_s))


def named(positions: np.ndarray) -> dict[str, np.ndarray]:
    return {f"R{i}": position for i, position in enumerate(positions)}


def turned(degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def sds(covariance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("...ii->...i", covariance))


def annulus(low: float, high: float, count: int = 150) -> np.ndarray:
    rng = np.random.default_rng(3)
    radius, angle = np.sqrt(rng.uniform(low**2, high**2, count)), rng.uniform(0, 2 * np.pi, count)
    return np.c_[radius * np.cos(angle), radius * np.sin(angle)]


# Medians of 10 000 nodes, measured with an independent implementation of both methods
RATIOS = [
    (116, 38.0, 0, 50, 0.99),
    (116, 38.0, 50, 100, 0.99),
    (116, 38.0, 100, 150, 1.00),
    (116, 38.0, 150, 210, 1.07),
    (170, 60.0, 0, 50, 0.90),
    (170, 60.0, 50, 100, 0.94),
    (10, 60.0, 0, 50, 1.04),
    (10, 60.0, 100, 150, 1.00),
]


@pytest.mark.parametrize(("separation", "sigma_s", "low", "high", "median"), RATIOS)
def test_closed_form_over_exact_is_what_was_measured(separation, sigma_s, low, high, median) -> None:
    points, fleet = annulus(low, high), receivers_of(spread(separation), sigma_s)
    closed = sds(closed_form_covariance(points, fleet, NARROW)).max(axis=1)
    exact = sds(exact_covariance(points, fleet, NARROW)).max(axis=1)

    assert np.median(closed / exact) == pytest.approx(median, abs=0.025)


# Mean sd_x and sd_y along the spiral of the paper, exact, by separation and timing error
PAPER = [
    (60, 10, 77, 69),
    (60, 60, 44, 19),
    (60, 116, 20, 24),
    (60, 150, 18, 44),
    (60, 165, 18, 64),
    (30, 45, 35, 11),
    (30, 116, 10, 12),
    (30, 160, 9, 34),
    (15, 116, 5, 6),
]


@pytest.mark.parametrize(("sigma_s", "separation", "sd_x", "sd_y"), PAPER)
def test_separations_of_the_paper(sigma_s, separation, sd_x, sd_y) -> None:
    mean = sds(exact_covariance(SPIRAL, receivers_of(spread(separation), sigma_s), NARROW)).mean(axis=0)
    np.testing.assert_allclose(mean, (sd_x, sd_y), atol=1.1)


@pytest.mark.parametrize("sigma_s", [15.0, 30.0, 60.0])
def test_spacecraft_in_line_leave_y_to_the_prior(sigma_s) -> None:
    sd_x, sd_y = sds(exact_covariance(SPIRAL, receivers_of(spread(180), sigma_s), NARROW)).mean(axis=0)
    assert sd_y == pytest.approx(NARROW.tau_rsun, rel=0.05)
    assert sd_x < 20


@pytest.mark.parametrize("priors", [NARROW, WIDE], ids=["speed known", "speed free"])
def test_sharp_timing_makes_both_the_same(priors) -> None:
    points = annulus(0, 100, 20)
    fleet = receivers_of(FIVE, 2.0)
    closed = closed_form_covariance(points, fleet, priors)
    np.testing.assert_allclose(closed, exact_covariance(points, fleet, priors), rtol=0.03, atol=0.01)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_closed_form_is_the_information_of_all_parameters_with_nothing_eliminated_by_hand(dimensions: int) -> None:
    rng = np.random.default_rng(8)
    receivers = FIVE + np.column_stack([np.zeros((5, 2)), rng.normal(0, 60, 5)])
    priors = Priors(v_sd_c=0.01)  # so narrow that a Gaussian in the speed is one in the slowness
    sigma, at = np.array([60, 38, 20, 16, 9.0]), np.array([40.0, -25.0, 12.0])[:dimensions]

    def arrival(parameters: np.ndarray) -> np.ndarray:
        place = np.pad(parameters[:dimensions], (0, 3 - dimensions))
        return parameters[-1] + parameters[-2] * np.linalg.norm(place - receivers, axis=1) / C_RSUN_S

    truth, step = np.array([*at, 1.0, 0.0]), 1e-4
    moved = step * np.eye(len(truth))
    jacobian = np.stack([(arrival(truth + h) - arrival(truth - h)) / (2 * step) for h in moved], axis=1)
    prior = np.diag([*[priors.tau_rsun**-2] * dimensions, priors.v_sd_c**-2, 0.0])
    covariance = np.linalg.inv((jacobian / sigma[:, None] ** 2).T @ jacobian + prior)

    problem = problems_of(grid_of(np.pad(at, (0, 3 - dimensions)), receivers, sigma), priors, dimensions)
    information = slope_and_information(problem, at[:, None])[1][..., 0, 0] + np.eye(dimensions) * priors.tau_rsun**-2
    closed = np.linalg.inv(information)
    np.testing.assert_allclose(closed, covariance[:dimensions, :dimensions], rtol=1e-3, atol=1e-3)


def test_exact_nodes_are_those_of_a_localisation() -> None:
    points = SPIRAL[::5]
    sources = np.column_stack([points, np.zeros(len(points))])
    fine = moments(grid_of(sources, EVENT, 38.0), tolerance=0.35)
    np.testing.assert_allclose(sds(exact_covariance(points, receivers_of(EVENT, 38.0), NARROW)), sd_of(fine), rtol=2e-3)


def test_turning_fleet_and_sources_turns_the_answer() -> None:
    turn, points = turned(77.0), annulus(0, 250, 25)
    flat = turn[:2, :2]
    fleet, fleet_turned = (Receivers(("a", "b", "c"), at, np.array([60, 38, 38.0])) for at in (EVENT, EVENT @ turn.T))
    closed = closed_form_covariance(points, fleet, NARROW)
    closed_turned = closed_form_covariance(points @ flat.T, fleet_turned, NARROW)
    exact = exact_covariance(points, fleet, NARROW)
    exact_turned = exact_covariance(points @ flat.T, fleet_turned, NARROW)

    np.testing.assert_allclose(closed_turned, flat @ closed @ flat.T, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(largest_sd(exact_turned), largest_sd(exact), rtol=2e-3)


def test_largest_sd_is_the_root_of_the_larger_eigenvalue() -> None:
    covariance = np.array([[[9.0, 5.0], [5.0, 4.0]], [[2.0, 0.0], [0.0, 7.0]]])
    np.testing.assert_allclose(largest_sd(covariance), np.sqrt(np.linalg.eigvalsh(covariance)[:, 1]))


@pytest.fixture(scope="module")
def fleet_map() -> xr.Dataset:
    return uncertainty_map(
        named(spread(116)), 38.0, NARROW, size=41, exact=True, epoch=np.datetime64("2012-06-07T19:30", "ns")
    )


def test_map_of_a_symmetric_fleet_is_symmetric(fleet_map) -> None:
    for name in ("sd_x_rsun", "sd_y_rsun", "sd_largest_rsun", "exact_sd_x_rsun", "exact_sd_y_rsun"):
        values = fleet_map[name].to_numpy()
        np.testing.assert_allclose(values, values[::-1], rtol=2e-3)
        assert np.abs(values - values[:, ::-1]).max() > 5


def test_axes_are_not_mixed_up() -> None:
    line = np.array([[150.0, 0, 0], [-150.0, 0, 0], [100.0, 0, 0]])
    sky = uncertainty_map(named(line), 20.0, NARROW, size=11).sel(x=0, y=62, method="nearest")
    (node,) = exact_covariance(np.array([[0.0, 62.0]]), receivers_of(line, 20.0), NARROW)
    ratio = np.sqrt(max(sky["sd_x_rsun"].item(), sky["sd_y_rsun"].item()) ** 2 / np.diag(node).max())
    assert (float(sky["x"]), float(sky["y"])) == (0.0, 62.0)
    assert sky["closed_form_over_exact"].item() == pytest.approx(ratio, rel=1e-6)


def test_flag_marks_where_closed_form_and_exact_differ(fleet_map) -> None:
    larger = np.maximum(fleet_map["sd_x_rsun"], fleet_map["sd_y_rsun"])
    exact = np.maximum(fleet_map["exact_sd_x_rsun"], fleet_map["exact_sd_y_rsun"])
    ratio = larger / exact
    xr.testing.assert_allclose(fleet_map["closed_form_over_exact"].astype(float), ratio.astype(float))
    off = fleet_map["closed_form_off"]
    np.testing.assert_array_equal(off, (ratio > 1.1) | (ratio < 1 / 1.1))
    radius = np.hypot(fleet_map["x"], fleet_map["y"])
    assert not off.where(radius < 100, False).any()
    assert off.where(radius > 230, True).all()


def test_coarse_check_finds_nearly_the_border_of_the_exact_map(fleet_map, monkeypatch) -> None:
    # every second node is on the coarse lattice, the others are interpolated
    monkeypatch.setattr(uncertainty_map_module, "COARSE_SIZE", 21)
    coarse = uncertainty_map(named(spread(116)), 38.0, NARROW, size=41)
    ratio, exact = coarse["closed_form_over_exact"].to_numpy(), fleet_map["closed_form_over_exact"].to_numpy()
    np.testing.assert_allclose(ratio[::2, ::2], exact[::2, ::2], rtol=1e-3)
    assert np.quantile(np.abs(ratio / exact - 1), 0.9) < 0.05
    differ = coarse["closed_form_off"].to_numpy() != fleet_map["closed_form_off"].to_numpy()
    assert differ.mean() < 0.03


@pytest.mark.parametrize("exact", [False, True])
def test_nodes_on_receivers_are_finite(exact) -> None:
    on_nodes = {"A": (100.0, 0.0, 0.0), "B": (-100.0, 50.0, 0.0), "C": (-50.0, -100.0, 0.0), "D": (-50.0, -100.0, 0.0)}
    sky = uncertainty_map(on_nodes, 16.0, WIDE, size=9, half_width_rsun=200.0, exact=exact)
    for name, values in sky.data_vars.items():
        assert np.isfinite(values).all(), name
    assert {100.0, -50.0} <= set(sky["x"].to_numpy())


def test_map_survives_netcdf(fleet_map, tmp_path: Path) -> None:
    fleet_map.to_netcdf(tmp_path / "map.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "map.nc", engine="h5netcdf") as back:
        xr.testing.assert_identical(back.load(), fleet_map)
        assert back["closed_form_off"].dtype == bool
        assert (back.attrs["frame"], back.attrs["epoch"]) == ("HEE", "2012-06-07T19:30:00Z")
        assert back["receiver_rsun"].sel(observatory="R0", xyz="x").item() == pytest.approx(AU_RSUN)
        assert back.attrs["tau_rsun"] == NARROW.tau_rsun
        for name in back.data_vars:
            assert {"long_name"} <= set(back[name].attrs), name


def test_progress_counts_every_exact_node(monkeypatch) -> None:
    monkeypatch.setattr(uncertainty_map_module, "NODES_PER_TASK", 30)
    steps: list[int] = []
    uncertainty_map(named(EVENT), 60.0, NARROW, size=9, advance=steps.append)
    assert sum(steps) == exact_nodes(9, exact=False) == 81
    assert steps == [30, 30, 21]
    assert (exact_nodes(500, exact=False), exact_nodes(500, exact=True)) == (1681, 250_000)


def test_processes_change_nothing(monkeypatch) -> None:
    points, fleet = annulus(0, 300, 90), receivers_of(EVENT, 60.0)
    alone = exact_covariance(points, fleet, NARROW)
    monkeypatch.setattr(uncertainty_map_module, "NODES_WORTH_A_POOL", 0)
    monkeypatch.setattr(uncertainty_map_module, "NODES_PER_TASK", 45)
    np.testing.assert_array_equal(exact_covariance(points, fleet, NARROW, processes=2), alone)


def test_nodes_that_need_many_cells_are_taken_fewer_at_a_time(monkeypatch) -> None:
    points, fleet = annulus(0, 200, 10), receivers_of(spread(170), 30.0)
    together = exact_covariance(points, fleet, NARROW)
    monkeypatch.setattr(cells_module, "MAX_CELLS_TOGETHER", 1_000)
    np.testing.assert_allclose(exact_covariance(points, fleet, NARROW), together, rtol=1e-9)


def test_a_node_that_cannot_be_computed_is_named(monkeypatch) -> None:
    monkeypatch.setattr(cells_module, "MAX_CELLS_TOGETHER", 20)
    monkeypatch.setattr(cells_module, "MAX_CELLS", 20)
    with pytest.raises(ConvergenceError, match=r"at node x = 3, y = -4 Rsun is too sharp to compute; give larger"):
        exact_covariance(np.array([[3.0, -4.0], [5.0, 0.0]]), receivers_of(EVENT, 60.0), NARROW)


def test_a_process_that_dies_is_an_error_of_one_line(monkeypatch) -> None:
    class Dying:
        def __init__(self, *_, **__) -> None: ...

        def __enter__(self):
            return self

        def __exit__(self, *_) -> None: ...

        def map(self, *_):
            raise BrokenProcessPool

        def shutdown(self, **_) -> None: ...

    monkeypatch.setattr(uncertainty_map_module, "NODES_WORTH_A_POOL", 0)
    monkeypatch.setattr(uncertainty_map_module, "ProcessPoolExecutor", Dying)
    with pytest.raises(ConvergenceError, match="ended from outside"):
        exact_covariance(annulus(0, 100, 4), receivers_of(EVENT, 60.0), NARROW, processes=2)


def test_timing_errors_default_to_the_cadence() -> None:
    names = ("WIND", "STEREO-A", "PSP")
    np.testing.assert_array_equal(timing_errors(names, {"PSP": 7.0}), [60.0, 38.05, 7.0])
    np.testing.assert_array_equal(timing_errors(names, {"PSP": 7.0, "WIND": 20.0}), [20.0, 38.05, 7.0])
    np.testing.assert_array_equal(timing_errors(names, 16.0), [16.0, 16.0, 16.0])


GOOD = {"WIND": EVENT[0], "STEREO-A": EVENT[1], "STEREO-B": EVENT[2]}
BAD = {
    "two receivers": ({"receivers": {"WIND": EVENT[0], "STEREO-A": EVENT[1]}}, "3 or more"),
    "no receivers": ({"receivers": {}}, "no spacecraft"),
    "all at one place": ({"receivers": dict.fromkeys(GOOD, EVENT[0])}, "one place"),
    "missing coordinate": ({"receivers": GOOD | {"WIND": EVENT[0][:2]}}, "position of WIND"),
    "NaN": ({"receivers": GOOD | {"WIND": (np.nan, 0, 0)}}, "position of WIND"),
    "kilometres": ({"receivers": GOOD | {"WIND": (1.5e8, 0, 0)}}, "within 100 au"),
    "sigma 0": ({"sigma_s": 0.0}, "0 s for WIND"),
    "sigma negative": ({"sigma_s": {"STEREO-A": -1.0}}, "-1 s for STEREO-A"),
    "sigma NaN": ({"sigma_s": np.nan}, "nan s for WIND"),
    "sigma of a stranger": ({"sigma_s": {"SOLO": 7.0}}, "SOLO, which is not in the map"),
    "sigma not known": ({"receivers": GOOD | {"JUICE": (50.0, 60.0, 0.0)}}, "--sigma JUICE="),
    "size 1": ({"size": 1}, "2 to 2000"),
    "size 2001": ({"size": 2001}, "2 to 2000"),
    "half width 0": ({"half_width_rsun": 0.0}, "half width"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused_with_a_reason(name) -> None:
    change, reason = BAD[name]
    arguments = {"receivers": GOOD, "sigma_s": None, "size": 3} | change
    with pytest.raises(GeometryError if name == "all at one place" else InputError, match=reason) as caught:
        uncertainty_map(arguments.pop("receivers"), arguments.pop("sigma_s"), NARROW, **arguments)
    assert "\n" not in str(caught.value)


def test_a_wider_prior_widens_what_the_data_leave_open() -> None:
    points = np.array([[0.0, 250.0]])
    narrow, wide = (
        exact_covariance(points, receivers_of(spread(10), 60.0), replace(NARROW, tau_rsun=tau)) for tau in (80.0, 160.0)
    )
    assert largest_sd(wide)[0] > 1.5 * largest_sd(narrow)[0]

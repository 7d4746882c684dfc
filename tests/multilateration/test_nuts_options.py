"""Every option of the model in PyMC says what the exact posterior says."""

from dataclasses import replace

import numpy as np
import pytest

from bella.multilateration import PRESETS, localise
from bella.multilateration.nuts import _compiled
from bella.multilateration.priors import Noise, Preset, Priors
from tests.multilateration.geometry import FIVE, FOUR, grid_of, on_spiral, table_of
from tests.multilateration.test_space import SPREAD

NOISE = np.array([[0.5, -0.8, 0.3, 0.9, -0.4], [-1.0, 0.4, 0.9, -0.2, 0.6]])


def late(grid, receiver: int, late_s: float):
    arrival = grid.arrival_s.copy()
    arrival[:, receiver] += late_s
    return replace(grid, arrival_s=arrival)


SOURCES = [on_spiral(90), on_spiral(60)]
UNSURE = {
    "delay_s": np.full((1, 4), 7.0),
    "delay_sd_s": np.array([[19.0, 0.0, 14.0, 2.0]]),
    "offset_sd_s": np.array([[20.0, 30.0, 0.0, 5.0]]),
}
ROBUST = Preset("robust, wide", Priors(), "table", noise=Noise(0.1, 120.0))
CASES = {
    "nuisances": (replace(grid_of(SOURCES, FOUR, 30.0, noise=NOISE[:, :4]), **UNSURE), PRESETS["default"], 2),
    "largest speed": (grid_of(SOURCES, FIVE, 30.0, noise=NOISE), PRESETS["subluminal"], 2),
    "bad arrivals": (late(grid_of(SOURCES, FIVE, 40.0, noise=NOISE), 1, 120.0), ROBUST, 2),
    "space": (grid_of([(70, 10, 40), (40, -30, -20)], SPREAD, 40.0, noise=NOISE), PRESETS["default"], 3),
}


@pytest.mark.parametrize("name", CASES)
def test_sampled_and_exact_agree(name) -> None:
    grid, preset, dimensions = CASES[name]
    table = table_of(grid)
    sampled = localise(table, preset=preset, method="nuts", dimensions=dimensions, draws=4_000, seed=3)
    exact = localise(table, preset=preset, dimensions=dimensions, draws=10)

    share = 0.03 + 4 / np.sqrt(float(sampled["draw_ess"].min()))  # sampling error of a standard deviation

    for axis in "xyz"[:dimensions]:
        sd = np.sqrt(exact[f"cov_{axis}{axis}_rsun2"])
        margin = 5 * sd / np.sqrt(sampled["draw_ess"]) + 0.005 * sd
        assert (abs(sampled[f"{axis}_rsun"] - exact[f"{axis}_rsun"]) <= margin).all(), axis
        np.testing.assert_allclose(np.sqrt(sampled[f"cov_{axis}{axis}_rsun2"]), sd, rtol=share)
    np.testing.assert_allclose(sampled["v_over_c"], exact["v_over_c"], atol=0.08 * float(exact["v_over_c_sd"].max()))
    np.testing.assert_allclose(sampled["v_over_c_sd"], exact["v_over_c_sd"], rtol=share)
    np.testing.assert_allclose(sampled["emission_sd_s"], exact["emission_sd_s"], rtol=share)
    np.testing.assert_allclose(sampled["above_c_probability"], exact["above_c_probability"], atol=0.04)
    np.testing.assert_allclose(sampled["bad_probability"], exact["bad_probability"], atol=0.04)


def test_a_model_is_compiled_once_for_all_frequencies_and_bursts() -> None:
    grid, preset, _ = CASES["nuisances"]
    before = _compiled.cache_info()
    localise(table_of(grid), preset=preset, method="nuts", draws=2000)
    localise(table_of(grid.take(np.array([1]))), preset=preset, method="nuts", draws=2000)
    after = _compiled.cache_info()

    assert after.misses - before.misses <= 1
    assert after.hits - before.hits >= 2

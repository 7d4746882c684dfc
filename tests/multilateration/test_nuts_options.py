"""Every option of the model in PyMC says what the exact posterior says; each of them is compiled anew."""

from dataclasses import replace

import numpy as np
import pytest

from bella.multilateration import PRESETS, localise
from bella.multilateration.priors import Noise, Preset, Priors
from tests.multilateration.geometry import FIVE, grid_of, on_spiral, table_of
from tests.multilateration.test_space import SPREAD

pytestmark = pytest.mark.acceptance

NOISE = np.array([[0.5, -0.8, 0.3, 0.9, -0.4], [-1.0, 0.4, 0.9, -0.2, 0.6]])


def late(grid, receiver: int, late_s: float):
    arrival = grid.arrival_s.copy()
    arrival[:, receiver] += late_s
    return replace(grid, arrival_s=arrival)


SOURCES = [on_spiral(90), on_spiral(60)]
UNSURE = {
    "delay_s": np.full((1, 5), 7.0),
    "delay_sd_s": np.array([[19.0, 0.0, 14.0, 2.0, 6.0]]),
    "offset_sd_s": np.array([[20.0, 30.0, 0.0, 5.0, 9.0]]),
}
ROBUST_BELOW_C = Preset("robust, below c", Priors(v_sd_c=0.1, v_max_c=1.0), "table", noise=Noise(0.1, 120.0))
"""Options that share no term stand in one case each: every case is compiled anew."""
IN_SPACE = grid_of([(70, 10, 40), (40, -30, -20)], SPREAD, 40.0, noise=NOISE)
CASES = {
    "nuisances, in space": (replace(IN_SPACE, **UNSURE), PRESETS["default"], 3),
    "bad arrivals, largest speed": (
        late(grid_of(SOURCES[0], FIVE, 40.0, noise=NOISE[:1]), 1, 120.0),
        ROBUST_BELOW_C,
        2,
    ),
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

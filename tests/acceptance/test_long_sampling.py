"""The exact posterior against sampling so long that its own error is below what is asked: where there is one mode."""

import numpy as np
import pytest

from bella.multilateration import localise
from tests.multilateration.geometry import EVENT, FIVE, grid_of, spread, table_of

pytestmark = pytest.mark.acceptance

CASES = {
    "event": (EVENT, "default"),
    "event, free speed": (EVENT, "free-speed"),
    "five receivers, free speed": (FIVE, "free-speed"),
    "90 deg": (spread(90), "default"),
}


@pytest.mark.parametrize("name", CASES)
def test_mean_within_three_hundredths_and_width_within_two_hundredths(name) -> None:
    receivers, preset = CASES[name]
    rng = np.random.default_rng(11)
    sources = np.c_[rng.normal(0, 60, (4, 2)), np.zeros(4)]
    table = table_of(grid_of(sources, receivers, 40.0, noise=rng.standard_normal((4, len(receivers)))))
    exact = localise(table, preset=preset, draws=10)
    sampled = localise(table, preset=preset, method="nuts", draws=80_000, seed=5)

    assert (exact["modes"] == 1).all()
    assert (sampled["draw_ess"] > 10_000).all()
    for axis in "xy":
        sd = np.sqrt(exact[f"cov_{axis}{axis}_rsun2"])
        assert float(abs((sampled[f"{axis}_rsun"] - exact[f"{axis}_rsun"]) / sd).max()) <= 0.03
        assert float(abs(np.sqrt(sampled[f"cov_{axis}{axis}_rsun2"]) / sd - 1).max()) <= 0.02

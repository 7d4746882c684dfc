"""A clock that is off is found where receivers are redundant, and what it would do is stated where they are not."""

from dataclasses import replace

import numpy as np
import pytest

from bella.multilateration import localise
from bella.multilateration.checks import SHIFT_S
from tests.multilateration.geometry import EVENT, FIVE, PLAIN, grid_of, on_spiral, table_of

RANGES = np.linspace(15, 120, 12)


def burst(receivers, seed: int, late_s=None):
    noise = np.random.default_rng(seed).standard_normal((RANGES.size, len(receivers)))
    grid = grid_of([on_spiral(r) for r in RANGES], receivers, 5.0, noise=noise)
    return grid if late_s is None else replace(grid, arrival_s=grid.arrival_s + late_s)


def solved(grid):
    return localise(table_of(grid), preset=PLAIN, draws=50)


@pytest.mark.parametrize("receiver", range(5))
def test_a_late_clock_among_five_is_named_with_its_offset(receiver) -> None:
    late = np.where(np.arange(5) == receiver, 20.0, 0.0)
    solution = solved(burst(FIVE, 3, late))

    assert solution.attrs["clock_offset"].removeprefix("one of these: ").startswith(f"R{receiver} is late by")
    assert solution["flags"].str.contains("clock_offset").all()
    off = (solution["clock_offset_s"][receiver] - 20.0) / solution["clock_offset_sd_s"][receiver]
    assert abs(float(off)) < 3


def test_terrestrial_time_is_named() -> None:
    grid = burst(FIVE, 4, np.array([0, 0, 67.184, 0, 0]))  # 7 June 2012: TAI - UTC was 34 s, and TT is 32.184 s more
    grid = replace(grid, arrival_s=np.where(np.arange(5) == 2, burst(FIVE, 4).arrival_s + 66.184, grid.arrival_s))

    assert "R2 is late by 6" in solved(grid).attrs["clock_offset"]
    assert "Terrestrial Time taken for UTC (66.184 s)" in solved(grid).attrs["clock_offset"]


def test_good_clocks_are_rarely_flagged_and_their_errors_hold() -> None:
    pulls = []
    for seed in range(12):
        solution = solved(burst(FIVE, 100 + seed))
        assert not solution["flags"].str.contains("clock_offset").any()
        pulls.append(solution["clock_offset_s"] / solution["clock_offset_sd_s"])
    assert 0.6 < float(np.sqrt(np.mean(np.square(pulls)))) < 1.4


def test_three_receivers_tell_no_offset_but_what_it_would_do() -> None:
    grid = burst(EVENT, 5)
    late = np.array([0.0, 0.0, SHIFT_S])
    solution, moved = solved(grid), solved(replace(grid, arrival_s=grid.arrival_s + late))

    assert np.isnan(solution["clock_offset_s"]).all()
    assert not solution.attrs["clock_offset"]
    for axis in "xy":
        stated = solution[f"clock_shift_{axis}_rsun"].isel(observatory=2)
        np.testing.assert_allclose(moved[f"{axis}_rsun"] - solution[f"{axis}_rsun"], stated, atol=0.4)
    common = sum(solution[f"clock_shift_{axis}_rsun"].sum("observatory") ** 2 for axis in "xy")
    np.testing.assert_allclose(common, 0, atol=1e-3)  # all clocks late together move only the emission time

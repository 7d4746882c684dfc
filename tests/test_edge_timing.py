"""The page about the timing of edges says what the simulations find."""

import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.edges import METHODS, Case, simulated, timing

PAGE = (Path(__file__).parents[1] / "docs" / "edge-timing.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| ([\d.]+) \| (\d+) \| (yes|no) \| (.+) \|$", PAGE, flags=re.MULTILINE)
SEEDS = range(1000, 1200)


def test_every_case_is_on_the_page() -> None:
    assert len(ROWS) == 4 * 4 * 2


@pytest.mark.parametrize("row", ROWS[::9], ids=lambda row: "-".join(row[:3]))
def test_numbers_on_the_page(row: tuple[str, ...]) -> None:
    case = Case(float(row[0]), float(row[1]), row[2] == "yes")
    curves = simulated(case, SEEDS)
    for method, cell in zip(("flank", "half_maximum"), row[3].split(" | "), strict=False):
        bias, scatter, pull, outliers = (float(number) for number in cell.removesuffix(" %").split(" / "))
        found = timing(METHODS[method](curves, case))
        np.testing.assert_allclose((found.bias_s, found.scatter_s, found.pull), (bias, scatter, pull), atol=0.06)
        assert 100 * found.outliers == pytest.approx(outliers, abs=0.06)

"""The page about the simulation study says what the study finds."""

import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks import separation_study as study

PAGE = (Path(__file__).parents[1] / "docs" / "simulation-study.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("column", "sigma_s"), list(enumerate(study.SIGMAS_S)))
def test_standard_deviations_on_the_page(column: int, sigma_s: float) -> None:
    rows = re.findall(r"^\| (\d+)° \| ([\d.]+) / ([\d.]+) \| ([\d.]+) / ([\d.]+) \|$", PAGE, flags=re.MULTILINE)
    numbers = np.array(rows, dtype=float)
    assert tuple(numbers[:, 0]) == study.SHOWN_DEG
    found = study.sweep(sigma_s, numbers[:, 0])
    np.testing.assert_allclose(found, numbers[:, 1 + 2 * column : 3 + 2 * column], atol=0.06)


def test_coverage_on_the_page() -> None:
    cells = re.findall(r"^\| [^|]+ \| [^|]+ \| ([01]\.\d{3}) \| ([01]\.\d{3}) \|$", PAGE, flags=re.MULTILINE)
    simulated = study.noises()
    assert len(cells) == len(simulated)
    for written, (name, assumed, noise) in list(zip(cells, simulated, strict=True))[1::2]:
        found = tuple(study.coverage(assumed, noise).values())
        np.testing.assert_allclose(found, np.array(written, dtype=float), atol=0.0021, err_msg=name)


def test_bands_are_interpolated_between_separations() -> None:
    worst = np.interp(study.SEPARATIONS_DEG, [10, 90, 100, 180], [80, 20, 20, 60])
    sds = np.stack([worst, worst - 1], axis=1)
    assert study.band(sds, 35.0) == pytest.approx((70.0, 130.0))
    assert np.isnan(study.band(sds, 5.0)).all()
    assert study.implied_threshold(sds) == pytest.approx(53.75)

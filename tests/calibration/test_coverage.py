"""Coverage: its interval, and what passes."""

import pytest

from bella.calibration.coverage import Coverage


def test_interval_is_that_of_clopper_and_pearson() -> None:
    # Clopper & Pearson for 10 of 100, 95 %: 0.0490 to 0.1762 (Brown, Cai & DasGupta 2001, and any table)
    assert Coverage(0.68, 10, 100).interval == pytest.approx((0.0490, 0.1762), abs=1e-4)


def test_interval_of_none_and_of_all_is_closed_at_its_end() -> None:
    # 1 - (0.025)^(1/n): the "rule of three" with two sides
    assert Coverage(0.95, 0, 50).interval == pytest.approx((0.0, 1 - 0.025**0.02))
    assert Coverage(0.95, 50, 50).interval == pytest.approx((0.025**0.02, 1.0))


@pytest.mark.parametrize(("level", "target"), [(0.68, (0.64, 0.72)), (0.95, (0.93, 0.97))])
def test_with_many_sources_the_target_decides(level: float, target: tuple[float, float]) -> None:
    assert Coverage(level, 0, 20_000).accepted == target


@pytest.mark.parametrize(("level", "sd"), [(0.68, 0.01475), (0.95, 0.00689)])
def test_with_a_thousand_sources_binomial_noise_decides(level: float, sd: float) -> None:
    low, high = Coverage(level, 0, 1000).accepted
    # 3.89 standard deviations leave 1e-4
    assert (high - low) / 2 == pytest.approx(3.89 * sd, rel=0.05)


def test_what_passes() -> None:
    assert Coverage(0.68, 680, 1000).passes
    assert not Coverage(0.68, 600, 1000).passes
    assert not Coverage(0.68, 760, 1000).passes
    assert not Coverage(0.95, 900, 1000).passes

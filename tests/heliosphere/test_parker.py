import numpy as np
import pytest

from bella.heliosphere import (
    PAPER_FIGURES_ROTATION_D,
    SIDEREAL_ROTATION_D,
    SYNODIC_ROTATION_D,
    angular_speed_rad_s,
    spiral_longitude_deg,
)


@pytest.mark.parametrize(
    ("rotation_period_d", "degrees_per_100_rsun"),
    [(PAPER_FIGURES_ROTATION_D, 29.615), (SIDEREAL_ROTATION_D, 28.553), (SYNODIC_ROTATION_D, 26.569)],
)
def test_the_slope_at_400_km_s_depends_on_the_rotation(rotation_period_d: float, degrees_per_100_rsun: float) -> None:
    near, far = spiral_longitude_deg(np.array([30.0, 130.0]), 0.0, 400.0, rotation_period_d)

    assert near - far == pytest.approx(degrees_per_100_rsun, abs=6e-4)


def test_the_track_of_the_published_burst() -> None:
    ranges = np.array([25.0, 50.0, 75.0, 100.0, 125.0, 150.0])

    longitudes = spiral_longitude_deg(ranges, 30.0, 400.0, PAPER_FIGURES_ROTATION_D)

    np.testing.assert_allclose(longitudes, [22.9, 15.5, 8.1, 0.7, -6.7, -14.1], atol=0.05)


def test_the_spiral_starts_at_one_solar_radius() -> None:
    assert spiral_longitude_deg(np.array([1.0]), 30.0, 400.0)[0] == 30.0


def test_angular_speeds_of_the_published_codes() -> None:
    assert angular_speed_rad_s(PAPER_FIGURES_ROTATION_D) == pytest.approx(2.97189e-6, rel=2e-6)
    assert angular_speed_rad_s(SIDEREAL_ROTATION_D) == pytest.approx(2.86533e-6, rel=2e-6)


def test_twice_the_wind_winds_half_as_much() -> None:
    ranges = np.linspace(1.0, 215.0, 7)

    slow, fast = (spiral_longitude_deg(ranges, 0.0, speed) for speed in (300.0, 600.0))

    np.testing.assert_allclose(slow, 2.0 * fast)

"""Path of a beam along the spiral against numerical integration and a straight line."""

import numpy as np
import pytest

from bella.heliosphere.beam import beam_travel_s, slowing_travel_s, spiral_path_rsun, spiral_position_rsun
from bella.units import AU_RSUN, C_RSUN_S

RANGE = np.array([2.0, 30.0, 100.0, AU_RSUN])


def test_path_is_the_length_of_the_curve() -> None:
    fine = np.linspace(1.0, AU_RSUN, 20_001)
    curve = spiral_position_rsun(fine, 30.0, 400.0)
    length = np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()

    assert spiral_path_rsun(np.array([AU_RSUN]), 400.0)[0] == pytest.approx(length, rel=1e-6)


def test_spiral_at_1_au_is_longer_than_the_way_straight_out() -> None:
    """400 km/s: about 1.16 au to 1 au, as is commonly said."""
    assert spiral_path_rsun(np.array([AU_RSUN]), 400.0)[0] / AU_RSUN == pytest.approx(1.16, abs=0.02)


def test_a_fast_wind_leaves_a_straight_line() -> None:
    np.testing.assert_allclose(spiral_path_rsun(RANGE, 1e7), RANGE - 1, rtol=1e-6)
    np.testing.assert_allclose(beam_travel_s(RANGE, 0.2, 1e7), (RANGE - 1) / (0.2 * C_RSUN_S), rtol=1e-6)


def test_positions_lie_at_their_distance_and_turn_east_outwards() -> None:
    position = spiral_position_rsun(RANGE, 30.0, 400.0, 24.47)

    np.testing.assert_allclose(np.linalg.norm(position, axis=1), RANGE)
    longitude = np.degrees(np.arctan2(position[:, 1], position[:, 0]))
    assert (np.diff(longitude) < 0).all()
    # 29.615 degrees in 100 solar radii at 400 km/s and 24.47 d
    assert longitude[1] - longitude[2] == pytest.approx(0.70 * 29.615, abs=0.01)


def test_a_beam_that_does_not_slow_down_travels_as_one_of_constant_speed() -> None:
    np.testing.assert_allclose(slowing_travel_s(RANGE, 0.2, 0.0, 300.0), beam_travel_s(RANGE, 0.2, 300.0), rtol=1e-6)


@pytest.mark.parametrize("exponent", [-0.4, 0.3, 0.9])
def test_travel_of_a_slowing_beam_is_the_sum_of_its_steps(exponent: float) -> None:
    fine = np.geomspace(1.0, AU_RSUN, 40_001)
    middle = np.sqrt(fine[1:] * fine[:-1])
    steps = np.diff(spiral_path_rsun(fine, 400.0)) / (0.2 * C_RSUN_S * middle**-exponent)

    assert slowing_travel_s(np.array([AU_RSUN]), 0.2, exponent, 400.0)[0] == pytest.approx(steps.sum(), rel=2e-6)

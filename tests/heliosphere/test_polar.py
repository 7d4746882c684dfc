import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bella.heliosphere.polar import has_longitude, polar_covariance


@given(
    st.floats(5.0, 200.0),
    st.floats(-179.0, 179.0),
    st.floats(0.1, 0.3),
    st.floats(0.1, 0.3),
    st.floats(-0.9, 0.9),
)
def test_distance_and_longitude_scatter_as_the_draws_do(
    range_rsun: float, longitude_deg: float, sd_x: float, sd_y: float, correlation: float
) -> None:
    turn = np.radians(longitude_deg)
    position = range_rsun * np.array([np.cos(turn), np.sin(turn)])
    cross = correlation * sd_x * sd_y
    covariance = np.array([[sd_x**2, cross], [cross, sd_y**2]]) * 1e-4

    polar, spread = polar_covariance(position[np.newaxis], covariance[np.newaxis])

    draws = np.random.default_rng(3).multivariate_normal(position, covariance, 20_000)
    turned = draws @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    around = np.degrees(np.arctan2(turned[:, 1], turned[:, 0]))
    np.testing.assert_allclose(polar[0], [range_rsun, longitude_deg], rtol=1e-9)
    empirical = np.cov(np.linalg.norm(draws, axis=1), around)
    scale = np.sqrt(np.outer(np.diag(empirical), np.diag(empirical)))
    np.testing.assert_allclose(spread[0] / scale, empirical / scale, atol=0.06)


def test_the_centre_of_the_sun_has_no_longitude() -> None:
    _, covariance = polar_covariance(np.zeros((1, 2)), np.eye(2)[np.newaxis])

    assert np.isnan(covariance).all()


@pytest.mark.parametrize(("range_rsun", "expected"), [(6.1, True), (5.9, False), (np.nan, False)])
def test_a_longitude_needs_three_errors_of_distance(range_rsun: float, expected: bool) -> None:
    assert has_longitude(np.array([range_rsun]), np.array([4.0]))[0] == expected

"""Numbers behind the figures."""

import numpy as np
import pytest
import xarray as xr

from bella.plotting import polar_track, speed_remark
from bella.plotting.geometry import (
    nearest_index,
    receiver_positions,
    region_outline,
    spread_indices,
)
from tests.plotting.synthetic import synthetic_posterior


def one_point(x: float, y: float, xx: float, xy: float, yy: float) -> xr.Dataset:
    values = {"x_rsun": x, "y_rsun": y, "cov_xx_rsun2": xx, "cov_xy_rsun2": xy, "cov_yy_rsun2": yy}
    return xr.Dataset({name: ("frequency", [value]) for name, value in values.items()}, {"frequency": [1.0]})


def test_errors_are_projected_on_distance_and_longitude() -> None:
    track = polar_track(one_point(0.0, 50.0, 4.0, 0.0, 9.0))
    assert track.range_rsun[0] == 50.0
    assert track.longitude_deg[0] == 90.0
    assert track.range_sd_rsun[0] == pytest.approx(3.0)
    assert track.longitude_sd_deg[0] == pytest.approx(np.degrees(2.0 / 50.0))


def test_correlation_counts_in_the_projection() -> None:
    rng = np.random.default_rng(1)
    covariance = np.array([[9.0, 5.0], [5.0, 16.0]])
    draws = rng.multivariate_normal([0.0, 0.0], covariance, 200_000)
    track = polar_track(one_point(30.0, 40.0, *covariance[0], covariance[1, 1]))
    assert track.range_sd_rsun[0] == pytest.approx((draws @ [0.6, 0.8]).std(), rel=0.01)
    assert track.longitude_sd_deg[0] == pytest.approx(np.degrees((draws @ [-0.8, 0.6]).std() / 50.0), rel=0.01)


def test_a_source_at_the_sun_has_any_longitude() -> None:
    assert polar_track(one_point(0.0, 0.0, 4.0, 0.0, 4.0)).longitude_sd_deg[0] == 180.0


def test_channels_are_spread_in_distance_with_both_ends() -> None:
    track = polar_track(synthetic_posterior())
    chosen = spread_indices(track, 6)
    assert {0, 199} <= set(chosen)
    steps = np.diff(track.range_rsun[chosen])
    np.testing.assert_allclose(steps, steps.mean(), rtol=0.06)


def test_nearest_channel_is_nearest_in_log_frequency() -> None:
    assert nearest_index(np.array([0.1, 1.0, 10.0]), 3.0) == 1
    assert nearest_index(np.array([0.1, 1.0, 10.0]), 3.3) == 2
    assert nearest_index(np.array([0.1, 1.0, 10.0]), 1e-9) == 0


def test_receivers_are_averaged_over_the_channels_that_heard_the_burst() -> None:
    posterior = synthetic_posterior().copy(deep=True)
    posterior["receiver_rsun"][:50, 1] = np.nan
    positions = receiver_positions(posterior)
    assert list(positions) == ["WIND", "STEREO-A", "STEREO-B"]
    assert np.hypot(*positions["STEREO-A"][:2]) == pytest.approx(206.0)


def test_padding_is_no_part_of_an_outline() -> None:
    outline = region_outline(synthetic_posterior(), 10, 95)
    assert np.isfinite(outline).all()
    assert len(outline) == 73


def test_an_empty_region_has_no_outline() -> None:
    posterior = synthetic_posterior().copy(deep=True)
    posterior["region68"][0] = np.nan
    assert region_outline(posterior, 0, 68).shape == (0, 2)


@pytest.mark.parametrize(
    ("contraction", "words"),
    [
        (0.99, "speed not constrained (contraction 0.99)"),
        (0.4, "speed constrained (contraction 0.40)"),
        (np.nan, "speed: no statement"),
    ],
)
def test_the_remark_on_the_speed(contraction: float, words: str) -> None:
    assert speed_remark(contraction) == words

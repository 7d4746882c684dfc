"""The joint fit as it is published: no more frequencies than say something, its draws beside those of the positions."""

import numpy as np
import pytest
import xarray as xr

from bella.arrivals import arrival_grid, locate_receivers
from bella.bursts import published_arrivals
from bella.tracks import JointModel
from bella.tracks.published import MOST_FREQUENCIES, joint_track, thinned, with_joint_draws
from tests.tracks.bursts import simulated, standard

GRID = simulated(standard(JointModel(), 30.0, 400.0), JointModel(), np.random.default_rng(1))


def test_reading_a_curve_at_more_frequencies_does_not_make_the_errors_smaller() -> None:
    def wind_sd(count: int) -> float:
        located = locate_receivers(published_arrivals(np.geomspace(0.15, 2.0, count)))
        joint, _ = joint_track(arrival_grid(located, heard_by=1), 24.47, 2000, 1)
        assert joint["frequencies"] == 40
        assert joint["of_frequencies"] == count
        return float(joint["v_sw_km_s"]["sd"])

    assert wind_sd(400) == pytest.approx(wind_sd(40), rel=0.15)


def test_thinning_keeps_both_ends_and_spreads_the_rest_in_logarithm() -> None:
    few = thinned(GRID, 10)
    assert few.frequency_mhz.size == 10
    assert (few.frequency_mhz[0], few.frequency_mhz[-1]) == (GRID.frequency_mhz[0], GRID.frequency_mhz[-1])
    assert np.ptp(np.diff(np.log(few.frequency_mhz))) < 0.08
    assert thinned(GRID, MOST_FREQUENCIES) is GRID


def test_draws_are_those_that_the_summary_sums_up() -> None:
    joint, fit = joint_track(GRID, 25.38, 1000, 1)
    posterior = with_joint_draws(xr.Dataset(attrs={"frame": "HEE"}), fit)
    drawn = posterior["joint_draws"]
    assert drawn.dims == ("joint_draw", "joint_parameter")
    assert drawn.sizes["joint_draw"] == 1000
    for name in ("phi0_deg", "v_sw_km_s", "a_rsun", "b", "beam_speed_c"):
        values = drawn.sel(joint_parameter=name)
        assert float(values.mean()) == pytest.approx(joint[name]["mean"], abs=0.2 * joint[name]["sd"])
    assert drawn.attrs["rotation_period_d"] == 25.38
    assert drawn.attrs["reference_time"] == joint["epoch_utc"]
    release = float(drawn.sel(joint_parameter="release_s").mean())
    stamp = np.datetime64(joint["release_utc"]["mean"].removesuffix("Z"))
    assert (stamp - GRID.reference_utc) / np.timedelta64(1, "s") == pytest.approx(release, abs=3.0)


def test_where_nothing_was_fitted_there_are_no_draws() -> None:
    joint, fit = joint_track(GRID.take(np.array([0, 1])), 25.38)
    assert joint["flags"] == ["too_few_frequencies"]
    assert joint["phi0_deg"]["mean"] is None
    assert "joint_draws" not in with_joint_draws(xr.Dataset(), fit)

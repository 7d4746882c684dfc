"""The joint fit as it is published: no more frequencies than say something, its draws beside those of the positions."""

from dataclasses import replace

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


def test_edges_of_channels_are_all_taken_each_with_its_own_frequency() -> None:
    alone = np.where(np.arange(3) == np.arange(40)[:, None] % 3, 1.0, np.nan)
    shared_s = np.full((40, 3), 0.1)
    channels = replace(GRID, arrival_s=GRID.arrival_s * alone, sigma_s=GRID.sigma_s * alone, offset_sd_s=shared_s)
    both = replace(
        channels,
        **{name: np.concatenate([getattr(channels, name)] * 2) for name in ("arrival_s", "sigma_s", "receiver_rsun")},
        frequency_mhz=np.concatenate([channels.frequency_mhz, channels.frequency_mhz * 1.0001]),
        **{name: np.zeros((80, 3)) for name in ("delay_s", "delay_sd_s")},
        offset_sd_s=np.full((80, 3), 0.1),
    )
    once, _ = joint_track(channels, 25.38, 2000, 1, from_curve=False)
    twice, _ = joint_track(both, 25.38, 2000, 1, from_curve=False)
    assert (once["times"], once["frequencies"], twice["frequencies"]) == ("channel edges", 40, 80)
    for name in ("phi0_deg", "a_rsun"):
        assert twice[name]["sd"] == pytest.approx(once[name]["sd"] / np.sqrt(2), rel=0.15)


@pytest.mark.parametrize("times_too_small", [3.0, 40.0])
def test_errors_that_do_not_explain_the_edges_are_widened_by_the_misfit(times_too_small: float) -> None:
    small = replace(GRID, sigma_s=GRID.sigma_s / times_too_small)
    joint, fit = joint_track(small, 25.38, 1000, 1, from_curve=False)
    honest, _ = joint_track(GRID, 25.38, 1000, 1, from_curve=False)
    careless, _ = joint_track(small, 25.38, 1000, 1)
    assert joint["error_scale"] == pytest.approx(times_too_small, rel=0.25)
    assert "poor_fit" in joint["flags"]
    assert list(fit.flags) == joint["flags"]
    assert joint["phi0_deg"]["sd"] == pytest.approx(honest["phi0_deg"]["sd"], rel=0.35)
    assert (honest["error_scale"], careless["error_scale"]) == (1.0, 1.0)
    assert "poor_fit" not in honest["flags"]
    assert "poor_fit" in careless["flags"]


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

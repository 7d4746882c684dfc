"""What stands beside the joint fit: right where its own assumptions hold, and open where the times say nothing."""

import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from bella.arrivals import ArrivalGrid
from bella.exceptions import InputError
from bella.heliosphere import emission_range_rsun, spiral_path_rsun, spiral_position_rsun
from bella.tracks import JointModel
from bella.tracks.companions import MODEL, SEMP_DENSER, density_companion, semp_companion
from bella.tracks.semp import SEMP_ROTATION_D
from bella.units import C_RSUN_S
from tests.tracks.bursts import FREQUENCY_MHZ, LONGITUDES_DEG, RELEASE_S, simulated, standard

PHI0_DEG, BEAM_C, SIGMA_S = 25.0, 0.15, 30.0


def semp_burst(seed: int | None, phi0_deg: float = PHI0_DEG) -> ArrivalGrid:
    """Arrival times of a beam that is as SEMP assumes it."""
    grid = simulated(standard(JointModel(), 0.0, 400.0), JointModel(), None)
    distance = emission_range_rsun(FREQUENCY_MHZ / math.sqrt(SEMP_DENSER), MODEL)
    source = spiral_position_rsun(distance, phi0_deg, 400.0, SEMP_ROTATION_D)
    light_s = np.linalg.norm(source[:, None] - grid.receiver_rsun, axis=2) / C_RSUN_S
    travel_s = spiral_path_rsun(distance, 400.0, SEMP_ROTATION_D) / (BEAM_C * C_RSUN_S)
    noise = 0.0 if seed is None else SIGMA_S * np.random.default_rng(seed).standard_normal(light_s.shape)
    times = RELEASE_S + travel_s[:, None] + light_s + noise
    return replace(grid, arrival_s=times, sigma_s=np.full(times.shape, SIGMA_S))


def test_a_beam_as_semp_assumes_it_is_found_within_its_errors() -> None:
    found = semp_companion(semp_burst(3))
    assert abs(found["phi0_deg"]["mean"] - PHI0_DEG) < 3 * found["phi0_deg"]["sd"]
    assert abs(found["beam_speed_c"]["mean"] - BEAM_C) < 3 * found["beam_speed_c"]["sd"]
    released = np.datetime64(found["release_utc"]["mean"].removesuffix("Z")) - np.datetime64("2012-06-07T19:00")
    assert abs(released / np.timedelta64(1, "s") - RELEASE_S) < 3 * found["release_utc"]["sd"]
    assert found["error_scale"] == pytest.approx(1.0, abs=0.15)
    assert found["flags"] == []


def test_stated_errors_are_the_scatter_of_many_bursts() -> None:
    found = [semp_companion(semp_burst(seed)) for seed in range(40)]
    for name in ("phi0_deg", "beam_speed_c"):
        scatter = np.std([one[name]["mean"] for one in found])
        assert 0.7 < scatter / np.mean([one[name]["sd"] for one in found]) < 1.35, name
    held = [one["phi0_deg"]["q2_5"] < PHI0_DEG < one["phi0_deg"]["q97_5"] for one in found]
    assert sum(held) >= 34


@given(st.floats(-180.0, 180.0))
def test_an_interval_lies_about_its_longitude_wherever_that_is(phi0_deg: float) -> None:
    angle = semp_companion(semp_burst(None, phi0_deg))["phi0_deg"]
    assert angle["q2_5"] < angle["q16"] < angle["mean"] < angle["q84"] < angle["q97_5"]
    assert (angle["mean"] - phi0_deg + 180) % 360 - 180 == pytest.approx(0.0, abs=0.01)


def test_times_without_a_longitude_have_no_interval() -> None:
    grid = semp_burst(None)
    found = semp_companion(replace(grid, sigma_s=np.full_like(grid.sigma_s, 1e4)))
    assert found["flags"] == ["open_profile"]
    assert found["phi0_deg"]["q2_5"] is found["phi0_deg"]["sd"] is None
    assert found["phi0_deg"]["mean"] == pytest.approx(PHI0_DEG, abs=0.1)


def test_a_misfit_widens_the_errors() -> None:
    grid = semp_burst(3)
    honest, careless = semp_companion(grid), semp_companion(replace(grid, sigma_s=grid.sigma_s / 10))
    assert careless["error_scale"] == pytest.approx(10 * honest["error_scale"], rel=0.2)
    assert careless["phi0_deg"]["sd"] == pytest.approx(honest["phi0_deg"]["sd"], rel=0.2)


def test_one_frequency_is_refused_in_words() -> None:
    with pytest.raises(InputError, match=r"more than one frequency|at least 4"):
        semp_companion(semp_burst(None).take(np.array([3])))


def positions(range_rsun: np.ndarray, frequency_mhz: np.ndarray) -> xr.Dataset:
    angle = np.radians(LONGITUDES_DEG[1])
    columns = {"x_rsun": range_rsun * np.cos(angle), "y_rsun": range_rsun * np.sin(angle)}
    for pair, value in (("xx", 4.0), ("xy", 0.0), ("yy", 4.0)):
        columns[f"cov_{pair}_rsun2"] = np.full(range_rsun.shape, value)
    return xr.Dataset({name: ("frequency", values) for name, values in columns.items()}, {"frequency": frequency_mhz})


def test_density_excess_is_one_where_the_model_puts_the_source() -> None:
    distance = emission_range_rsun(FREQUENCY_MHZ, MODEL)
    rows = density_companion(positions(distance, FREQUENCY_MHZ))["rows"]
    assert len(rows) == 5
    assert (rows[0]["frequency_mhz"], rows[-1]["frequency_mhz"]) == (0.15, 2.0)
    for row in rows:
        assert row["range_sd_rsun"] == pytest.approx(2.0)
        assert row["fundamental"]["mean"] == pytest.approx(1.0, rel=1e-6)
        assert row["harmonic"]["mean"] == pytest.approx(0.25, rel=1e-6)
    assert rows[0]["fundamental"]["q16"] < 1 < rows[0]["fundamental"]["q84"]


def test_a_source_inside_the_sun_has_no_density() -> None:
    (row,) = density_companion(positions(np.array([0.5]), np.array([1.0])))["rows"]
    assert row["fundamental"]["mean"] is None

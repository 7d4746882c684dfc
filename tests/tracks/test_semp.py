"""SEMP: the published minima, exact bursts, and errors that are the scatter of many."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bella.arrivals import ArrivalGrid
from bella.exceptions import InputError
from bella.heliosphere import (
    DENSITY_MODELS,
    beam_travel_s,
    emission_range_rsun,
    plasma_frequency_mhz,
    spiral_path_rsun,
    spiral_position_rsun,
)
from bella.tracks.semp import (
    DENSER,
    MODEL,
    SEMP_ROTATION_D,
    SempTimes,
    fit_semp,
    semp_companion,
    semp_residual_s,
    semp_times,
)
from bella.units import AU_RSUN, C_RSUN_S, R_SUN_KM

PHI0_DEG, BEAM_C, SIGMA_S, RELEASE_S = 25.0, 0.15, 30.0, 500.0
FREQUENCY_MHZ = np.geomspace(0.15, 2.0, 40)
EPOCH = np.datetime64("2012-06-07T19:00", "ns")
PUBLISHED_LIGHT_KM_S = 3e5
PUBLISHED_COEFFICIENT, PUBLISHED_FACTOR = 8.93e-3, 2.0
"""MHz for one electron per cm^3, and by how much the wind is denser than the model."""


def published_times(folder: Path, event: str) -> SempTimes:
    rows = pd.read_csv(folder / f"semp_{event.replace('-', '')}_arrivals.csv")
    events = pd.read_csv(folder / "semp_events.csv").query("event == @event").set_index("spacecraft")
    place = events.loc[rows["spacecraft"]]
    angle, distance = np.radians(place["lon_hee_deg"].to_numpy()), place["r_au"].to_numpy() * AU_RSUN
    receiver = np.column_stack([distance * np.cos(angle), distance * np.sin(angle), np.zeros(len(rows))])
    frequency = rows["frequency_khz"].to_numpy() / 1e3
    coefficient = plasma_frequency_mhz(np.array(1.0))
    same_density = frequency * coefficient / PUBLISHED_COEFFICIENT / np.sqrt(PUBLISHED_FACTOR)
    return SempTimes(
        rows.iloc[:, 2].to_numpy(),
        emission_range_rsun(same_density, DENSITY_MODELS["leblanc"]),
        receiver,
        place["weight"].to_numpy(dtype=np.float64),
    )


@pytest.mark.parametrize(
    ("event", "v_sw", "rms_s", "beam_km_s", "phi0_deg"),
    [
        ("2019-04-09", 300, 18.451049679, 35087.18, np.degrees(4.58272239)),
        ("2019-04-09", 400, 18.461087183, 35010.91, np.degrees(4.57356622)),
        ("2019-04-09", 500, 18.466562952, 34967.78, np.degrees(4.56822274)),
        ("2019-04-09", 600, 18.469972557, 34940.35, np.degrees(4.56465367)),
        ("2020-07-21", 300, 31.963833455, 45610.41, np.degrees(3.2109914)),
    ],
)
def test_global_minima_of_the_published_events(  # noqa: PLR0917
    reference_files: Path, event: str, v_sw: float, rms_s: float, beam_km_s: float, phi0_deg: float
) -> None:
    times = published_times(reference_files / "semp", event)

    fit = fit_semp(times, v_sw, PUBLISHED_LIGHT_KM_S)

    assert fit.rms_s == pytest.approx(rms_s, abs=1e-6)
    assert fit.beam_speed_c * PUBLISHED_LIGHT_KM_S == pytest.approx(beam_km_s, abs=2)
    assert fit.phi0_deg % 360 == pytest.approx(phi0_deg, abs=0.02)


@pytest.mark.parametrize(("event", "v_sw"), [("2019-04-09", 400.0), ("2020-07-21", 300.0)])
def test_costs_printed_with_the_published_solutions(reference_files: Path, event: str, v_sw: float) -> None:
    folder = reference_files / "semp"
    times = published_times(folder, event)
    printed = pd.read_csv(folder / "semp_results.csv").query("event == @event and source == 'printed'")
    assert len(printed) == {"2019-04-09": 2, "2020-07-21": 1}[event]
    path = spiral_path_rsun(times.range_rsun, v_sw, SEMP_ROTATION_D)
    origin = spiral_path_rsun(np.array(0.0), v_sw, SEMP_ROTATION_D)  # the published path begins at the centre
    for row in printed.itertuples():
        phi0 = np.degrees(float(row.theta0_rad))
        least, (release_s, slowness) = semp_residual_s(times, phi0, v_sw, PUBLISHED_LIGHT_KM_S)
        emitted_s = least + release_s + slowness * path

        residual = emitted_s - float(row.t0_s) - (path - origin) * R_SUN_KM / float(row.vs_km_s)

        cost = np.sqrt(np.average(residual**2, weights=times.weight))
        assert cost == pytest.approx(float(row.rms_s), abs=1e-6)
        assert np.average(least**2, weights=times.weight) <= cost**2


@given(phi0=st.floats(-179, 179), speed=st.floats(0.03, 0.6), release=st.floats(-1e4, 1e4))
def test_an_exact_burst_is_found_again(phi0: float, speed: float, release: float) -> None:
    fit = fit_semp(exact_times(phi0, speed, release), 400.0)

    assert fit.rms_s < 1e-4
    assert fit.phi0_deg == pytest.approx(phi0, abs=1e-2)
    assert fit.beam_speed_c == pytest.approx(speed, rel=1e-3)
    assert fit.release_s == pytest.approx(release, abs=0.1)


def exact_times(phi0_deg: float, speed_c: float, release_s: float) -> SempTimes:
    range_rsun = np.tile(np.geomspace(5, 150, 12), 3)
    angle = np.radians(np.repeat([0.0, 117.0, -117.0], 12))
    receiver = AU_RSUN * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(36)])
    source = spiral_position_rsun(range_rsun, phi0_deg, 400.0, SEMP_ROTATION_D)
    light_s = np.linalg.norm(source - receiver, axis=1) / C_RSUN_S
    arrival = release_s + beam_travel_s(range_rsun, speed_c, 400.0, SEMP_ROTATION_D) + light_s
    return SempTimes(arrival, range_rsun, receiver, np.ones(36))


def test_times_that_run_backwards_have_no_beam_speed() -> None:
    forward = exact_times(30.0, 0.1, 0.0)
    backward = SempTimes(-5 * forward.arrival_s, forward.range_rsun, forward.receiver_rsun, forward.weight)

    fit = fit_semp(backward, 400.0)

    assert fit.flags == ("beam_speed_not_positive",)
    assert np.isnan(fit.beam_speed_c)


@pytest.mark.parametrize(
    ("rows", "change", "reason"),
    [
        (slice(0, 3), {}, "at least 4"),
        (slice(None), {"arrival_s": np.full(36, np.nan)}, "is missing"),
        (slice(None), {"range_rsun": np.full(36, 20.0)}, "more than one frequency"),
        (slice(None), {"weight": np.zeros(36)}, "above 0"),
    ],
)
def test_bad_times_are_refused(rows: slice, change: dict[str, np.ndarray], reason: str) -> None:
    good = exact_times(30.0, 0.1, 0.0)
    columns = {name: getattr(good, name)[rows] for name in ("arrival_s", "range_rsun", "receiver_rsun", "weight")}
    with pytest.raises(InputError, match=reason):
        SempTimes(**(columns | change))


def test_wind_that_stands_still_is_refused() -> None:
    with pytest.raises(InputError, match="give a speed above 0"):
        fit_semp(exact_times(30.0, 0.1, 0.0), 0.0)


def semp_burst(seed: int | None, phi0_deg: float = PHI0_DEG, shape_sd_s: float = 0.0) -> ArrivalGrid:
    """Arrival times of a beam that is as SEMP assumes it, at three spacecraft at 1 au."""
    angle = np.radians([0.0, 116.8, -116.8])
    place = AU_RSUN * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    receiver = np.tile(place, (FREQUENCY_MHZ.size, 1, 1))
    distance = emission_range_rsun(FREQUENCY_MHZ / math.sqrt(DENSER), MODEL)
    source = spiral_position_rsun(distance, phi0_deg, 400.0, SEMP_ROTATION_D)
    light_s = np.linalg.norm(source[:, None] - receiver, axis=2) / C_RSUN_S
    travel_s = spiral_path_rsun(distance, 400.0, SEMP_ROTATION_D) / (BEAM_C * C_RSUN_S)
    times = RELEASE_S + travel_s[:, None] + light_s
    size = np.full(times.shape, SIGMA_S)
    if seed is not None:
        rng = np.random.default_rng(seed)
        apart = np.subtract.outer(*2 * [np.log(FREQUENCY_MHZ)]) / 0.5
        smooth = np.linalg.cholesky(np.exp(-0.5 * apart**2) + 1e-9 * np.eye(FREQUENCY_MHZ.size))
        noise_s = SIGMA_S * rng.standard_normal(times.shape)
        times += noise_s + shape_sd_s * smooth @ rng.standard_normal(times.shape)
    grid = ArrivalGrid(FREQUENCY_MHZ, ("A", "B", "C"), times, size, receiver, EPOCH, "none")
    return replace(grid, shape_sd_s=np.full(times.shape, shape_sd_s))


def test_a_beam_as_semp_assumes_it_is_found_within_its_errors() -> None:
    found = semp_companion(semp_burst(3))
    assert abs(found["phi0_deg"]["mean"] - PHI0_DEG) < 3 * found["phi0_deg"]["sd"]
    assert abs(found["beam_speed_c"]["mean"] - BEAM_C) < 3 * found["beam_speed_c"]["sd"]
    released = np.datetime64(found["release_utc"]["mean"].removesuffix("Z")) - np.datetime64("2012-06-07T19:00")
    assert abs(released / np.timedelta64(1, "s") - RELEASE_S) < 3 * found["release_utc"]["sd"]
    assert found["error_scale"] == pytest.approx(1.0, abs=0.15)
    assert found["flags"] == []


@pytest.mark.parametrize("shape_sd_s", [0.0, 20.0], ids=["independent", "smooth"])
def test_stated_errors_are_the_scatter_of_many_bursts(shape_sd_s: float) -> None:
    found = [semp_companion(semp_burst(seed, shape_sd_s=shape_sd_s)) for seed in range(40)]
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


def test_quantiles_of_time_and_longitude_are_in_order() -> None:
    found = semp_companion(semp_burst(3))
    for name in ("phi0_deg", "beam_speed_c", "release_utc"):
        values = [found[name][q] for q in ("q2_5", "q16", "q50", "q84", "q97_5")]
        assert values == sorted(values)
        assert found[name]["q50"] == found[name]["mean"]
    assert found["release_utc"]["mean"].endswith("Z")


def test_known_delays_are_taken_off() -> None:
    grid = semp_burst(3)
    later = replace(grid, arrival_s=grid.arrival_s + 40.0, delay_s=np.full(grid.arrival_s.shape, 40.0))
    np.testing.assert_allclose(semp_times(later).arrival_s, semp_times(grid).arrival_s)


def test_errors_of_zero_are_refused_in_words() -> None:
    grid = semp_burst(None)
    with pytest.raises(InputError, match="above 0"):
        semp_companion(replace(grid, sigma_s=np.zeros_like(grid.sigma_s)))


def test_weights_and_a_diagonal_covariance_are_the_same() -> None:
    times = exact_times(30.0, 0.1, 0.0)
    noisy = replace(times, arrival_s=times.arrival_s + np.random.default_rng(2).normal(0, 20, 36))
    weight = np.linspace(1.0, 3.0, 36)
    one, other = (fit_semp(replace(noisy, weight=w), 400.0) for w in (weight, np.diag(weight)))
    assert one.phi0_deg == pytest.approx(other.phi0_deg, abs=1e-6)
    assert (one.rms_s, one.chi2) == pytest.approx((other.rms_s, other.chi2))


def test_one_frequency_is_refused_in_words() -> None:
    with pytest.raises(InputError, match=r"more than one frequency|at least 4"):
        semp_companion(semp_burst(None).take(np.array([3])))


def test_errors_of_release_and_speed_hold_that_of_the_longitude() -> None:
    angle = np.radians([-60.0, 0.0, 80.0])
    place = AU_RSUN * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    receiver = np.tile(place, (FREQUENCY_MHZ.size, 1, 1))
    distance = emission_range_rsun(FREQUENCY_MHZ / math.sqrt(DENSER), MODEL)
    path_rsun = spiral_path_rsun(distance, 400.0, SEMP_ROTATION_D)

    def times_s(release_s: float, slowness_s_rsun: float, phi0_deg: float) -> np.ndarray:
        source = spiral_position_rsun(distance, phi0_deg, 400.0, SEMP_ROTATION_D)
        light_s = np.linalg.norm(source[:, None] - receiver, axis=2) / C_RSUN_S
        return release_s + slowness_s_rsun * path_rsun[:, None] + light_s

    true = np.array([RELEASE_S, 1 / (BEAM_C * C_RSUN_S), 130.0])
    grid = ArrivalGrid(
        FREQUENCY_MHZ, ("A", "B", "C"), times_s(*true), np.full(receiver.shape[:2], SIGMA_S), receiver, EPOCH, "none"
    )
    steps = np.diag([1.0, 1e-3, 0.01])
    slopes = [(times_s(*(true + one)) - times_s(*(true - one))).ravel() / (2 * one.max()) / SIGMA_S for one in steps]
    release_sd, slowness_sd, _ = np.sqrt(np.diag(np.linalg.inv(np.array(slopes) @ np.array(slopes).T)))
    found = semp_companion(grid)

    assert found["release_utc"]["sd"] == pytest.approx(release_sd, rel=0.05)
    assert found["beam_speed_c"]["sd"] == pytest.approx(BEAM_C**2 * C_RSUN_S * slowness_sd, rel=0.05)

"""The wind through time: against the published speed, the steady wind, a scheme written out in loops, and parcels."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bella.exceptions import InputError
from bella.heliosphere import SIDEREAL_ROTATION_D
from bella.solar_wind import InnerBoundary, accelerated_speed_km_s, steady_wind, upwind_wind
from bella.solar_wind.steady import ACCELERATION
from bella.solar_wind.upwind import _marched
from bella.units import DAY_S, R_SUN_KM

START = np.datetime64("2012-06-05T00:00", "ns")
LONGITUDE = (np.arange(128) + 0.5) * 360 / 128
DAY = np.timedelta64(1, "D")


def one_map(speed_km_s: np.ndarray, **changes: float) -> InnerBoundary:
    return InnerBoundary(speed_km_s[None], np.array([START]), **changes)


def test_undisturbed_wind_reaches_the_published_speed_at_earth() -> None:
    history = upwind_wind(one_map(np.full(128, 350.0)), START, 1.0)

    assert history.at(START, np.array([215.0]), np.array([77.0]))[0] == pytest.approx(401.202, rel=1e-3)
    assert np.ptp(history.speed_km_s, axis=(0, 2)).max() < 1e-9


@pytest.mark.parametrize("later", [0.0, 0.3, 1.77, 3.0])
def test_steady_boundary_makes_the_steady_wind_at_every_time(later: float) -> None:
    boundary = 400 + 60 * np.sin(np.radians(LONGITUDE))
    history, steady = upwind_wind(one_map(boundary), START, 3.0), steady_wind(boundary)
    points = [values.ravel() for values in np.meshgrid(history.range_rsun, LONGITUDE)]

    off = history.at(START + np.timedelta64(round(later * 86_400), "s"), *points) - steady.at(*points)

    # a turn by one bin would leave 2.3 km/s
    assert np.sqrt(np.mean(off**2)) < 0.7


def test_a_stream_runs_past_a_fixed_direction_at_the_sidereal_rate() -> None:
    boundary = np.full(128, 350.0)
    boundary[40:60] = 352.0  # too weak to steepen
    history = upwind_wind(one_map(boundary), START, 10.0)

    def crest_deg(index: int) -> float:
        weight = history.speed_km_s[index, -1] - history.speed_km_s[index, -1].min()
        return math.degrees(np.angle(np.sum(weight * np.exp(1j * np.radians(LONGITUDE)))))

    turned = (crest_deg(-1) - crest_deg(0)) % 360.0
    days = (history.utc[-1] - history.utc[0]) / DAY
    assert days == pytest.approx(10.0)
    assert turned == pytest.approx(360.0 * days / SIDEREAL_ROTATION_D, abs=0.05)


def test_the_march_is_the_published_scheme() -> None:
    """Written out for every cell, with the acceleration as Owens et al. 2020 print it."""
    random = np.random.default_rng(2)
    inflow, grid, step_s = random.uniform(300, 600, (12, 5)), 30.0 + 1.5 * np.arange(9), 900.0
    gain = [1 + ACCELERATION * (1 - math.exp(-(r - 30) / 50)) for r in grid]
    v = [[inflow[0, k] * g / gain[0] for k in range(5)] for g in gain]
    for row in inflow[1:]:
        before = [list(values) for values in v]
        for i in range(1, 9):
            for k in range(5):
                here, inner = before[i][k], before[i - 1][k]
                fade = [math.exp(-(grid[j] - 30) / 50) for j in (i - 1, i)]
                pushed = inner**2 * ACCELERATION * (fade[0] - fade[1]) / (1 + ACCELERATION * (1 - fade[0]))
                v[i][k] = here + step_s / (1.5 * R_SUN_KM) * (pushed - here * (here - inner))
        v[0] = list(row)

    states = _marched(inflow, grid, step_s, 0, 11)

    np.testing.assert_allclose(states[-1], v, rtol=1e-12)
    np.testing.assert_allclose(states[0, 0], inflow[0])


def test_a_change_of_the_boundary_travels_at_the_speed_of_its_parcels() -> None:
    change = START + 2 * DAY
    maps = InnerBoundary(
        np.stack([np.full(16, 400.0), np.full(16, 401.0)]), np.array([change, change + np.timedelta64(1, "s")])
    )
    history = upwind_wind(maps, START, 7.0)
    speed = history.speed_km_s[:, -1, 0]
    half = np.interp(0.5, (speed - speed[0]) / (speed[-1] - speed[0]), (history.utc - change) / DAY)

    between = accelerated_speed_km_s(np.array(400.5), np.linspace(30.0, 240.0, 1001))
    travel_d = 210.0 * R_SUN_KM * np.mean(1 / between) / DAY_S
    assert half == pytest.approx(travel_d, abs=0.05)


@given(low=st.floats(250, 400), high=st.floats(400, 800), width=st.integers(1, 15))
def test_the_wind_stays_between_its_slowest_and_fastest_parcels(low: float, high: float, width: int) -> None:
    boundary = np.full(16, low)
    boundary[:width] = high

    speed = upwind_wind(one_map(boundary), START, 0.5, outer_rsun=90.0).speed_km_s

    assert speed.min() >= low - 1e-9
    assert speed.max() <= high * (1 + ACCELERATION) + 1e-9


@pytest.mark.parametrize(("inner_rsun", "expected"), [(21.5, 350.0), (30.0, 350.0), (1.0, 350.0)])
def test_the_boundary_is_where_it_is_put(inner_rsun: float, expected: float) -> None:
    history = upwind_wind(one_map(np.full(16, 350.0), range_rsun=inner_rsun), START, 0.2, outer_rsun=100.0)

    assert history.at(START, np.array([inner_rsun]), np.zeros(1))[0] == pytest.approx(expected)
    assert np.isnan(history.at(START, np.array([inner_rsun - 0.1, 120.0]), np.zeros(2))).all()


@pytest.mark.parametrize("utc", [START - DAY, START + 2 * DAY, np.datetime64("NaT", "ns")])
def test_no_wind_outside_the_time_of_the_run(utc: np.datetime64) -> None:
    history = upwind_wind(one_map(np.full(16, 350.0)), START, 1.0, outer_rsun=60.0)
    with pytest.raises(InputError, match="run the wind over that time"):
        history.snapshot(utc)


@pytest.mark.parametrize(
    ("speed", "utc", "reason"),
    [
        (np.full(16, 350.0), [START], "give one map for a time"),
        (np.full((2, 16), 350.0), [START], "give one map for a time"),
        (np.full((2, 16), 350.0), [START, START], "do not ascend"),
        (np.full((1, 16), np.nan), [START], "between 150 and 3000"),
        (np.full((1, 3), 350.0), [START], "at least 8"),
        (np.full((0, 16), 350.0), [], "give one map for a time"),
    ],
)
def test_bad_maps_are_refused(speed: np.ndarray, utc: list[np.datetime64], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        InnerBoundary(speed, np.array(utc, dtype="datetime64[ns]"))


@pytest.mark.parametrize(("days", "outer_rsun"), [(0.0, 90.0), (np.nan, 90.0), (np.inf, 90.0), (1.0, 20.0)])
def test_bad_spans_are_refused(days: float, outer_rsun: float) -> None:
    with pytest.raises(InputError, match=r"no span of time|not in order"):
        upwind_wind(one_map(np.full(16, 350.0)), START, days, outer_rsun)

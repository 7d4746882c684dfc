import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bella.exceptions import InputError
from bella.heliosphere import spiral_longitude_deg
from bella.solar_wind import accelerated_speed_km_s, field_lines_deg, steady_wind
from bella.solar_wind.steady import ACCELERATION, SteadyWind


def test_undisturbed_wind_reaches_the_published_speed_at_earth() -> None:
    wind = steady_wind(np.full(128, 350.0))

    assert wind.at(np.array([215.0]), np.array([77.0]))[0] == pytest.approx(401.202, abs=5e-4)
    assert accelerated_speed_km_s(np.array(350.0), np.array(215.0)) == pytest.approx(401.202, abs=5e-4)


@given(turn=st.integers(1, 127))
@settings(max_examples=12)
def test_turning_the_boundary_turns_the_wind(turn: int) -> None:
    boundary = 400 + 100 * np.sin(np.radians(np.arange(128) * 360 / 128))

    turned = steady_wind(np.roll(boundary, turn)).speed_km_s

    np.testing.assert_allclose(turned, np.roll(steady_wind(boundary).speed_km_s, turn, axis=1))


def test_a_fast_stream_meets_slow_wind_where_theory_puts_it() -> None:
    # ballistic: a parcel of 350 km/s drifts in longitude by Omega r / v relative to the frame of the Sun
    boundary = np.full(720, 350.0)
    boundary[180:190] = 352.0  # too weak to steepen

    wind = steady_wind(boundary, outer_rsun=130.0)

    crest = wind.longitude_deg[wind.speed_km_s[-1].argmax()]
    mean_km_s = np.mean(accelerated_speed_km_s(np.array(350.0), wind.range_rsun))
    expected = 92.5 + spiral_longitude_deg(np.array([101.0]), 0.0, float(mean_km_s))[0]
    assert crest == pytest.approx(expected, abs=1.5)


@given(low=st.floats(250, 400), high=st.floats(400, 800), width=st.integers(1, 100))
def test_the_wind_stays_between_its_slowest_and_fastest_parcels(low: float, high: float, width: int) -> None:
    boundary = np.full(128, low)
    boundary[:width] = high

    speed = steady_wind(boundary).speed_km_s

    assert speed.min() >= low - 1e-9
    assert speed.max() <= high * (1 + ACCELERATION) + 1e-9


def test_field_line_of_one_speed_is_parkers_spiral() -> None:
    grid = np.arange(30.0, 241.0)
    wind = SteadyWind(grid, (np.arange(128) + 0.5) * 360 / 128, np.full((grid.size, 128), 400.0))

    (line,) = field_lines_deg(wind, 150.3, np.array([20.0]))

    expected = spiral_longitude_deg(grid, 0.0, 400.0) - spiral_longitude_deg(np.array([150.3]), 0.0, 400.0) + 20.0
    np.testing.assert_allclose(line, expected, atol=1e-9)


def test_field_line_of_a_speed_that_grows_with_distance_is_a_logarithm() -> None:
    """dphi/dr = -Omega / (v0 r / r0): the steps of Euler's rule would be a third of a degree off."""
    grid = np.arange(30.0, 241.0)
    speed = np.repeat(4.0 * grid[:, None], 128, axis=1)
    wind = SteadyWind(grid, (np.arange(128) + 0.5) * 360 / 128, speed)

    lines = field_lines_deg(wind, 100.0, np.array([20.0, -40.0]))

    per_rsun_deg = 360.0 * 695_700.0 / (25.38 * 86_400.0) / 4.0
    expected = -per_rsun_deg * np.log(grid / 100.0)
    np.testing.assert_allclose(lines, expected + np.array([[20.0], [-40.0]]), atol=0.004)


def test_field_line_of_a_speed_that_grows_with_longitude_is_a_parabola() -> None:
    """(A + B phi) dphi = -Omega dr; a midpoint without its half step in longitude would be 0.02 degrees off."""
    grid, longitude = np.arange(30.0, 241.0), (np.arange(128) + 0.5) * 360 / 128
    wind = SteadyWind(grid, longitude, np.tile(100.0 + 4.0 * longitude, (grid.size, 1)))

    (line,) = field_lines_deg(wind, 30.0, np.array([100.0]))

    per_rsun = 360.0 * 695_700.0 / (25.38 * 86_400.0)
    total = 100.0 * 100.0 + 2.0 * 100.0**2 - per_rsun * (grid - 30.0)
    np.testing.assert_allclose(line, (-100.0 + np.sqrt(100.0**2 + 8.0 * total)) / 4.0, atol=0.002)


def test_a_factor_on_the_speed_divides_the_bend_of_its_own_line() -> None:
    grid = np.arange(30.0, 241.0)
    wind = SteadyWind(grid, (np.arange(128) + 0.5) * 360 / 128, np.full((grid.size, 128), 400.0))
    factor = np.vstack([np.ones(grid.size), np.full(grid.size, 1.25)])

    one, faster = field_lines_deg(wind, 30.0, np.zeros(2), speed_factor=factor)

    np.testing.assert_allclose(one, 1.25 * faster, atol=1e-9)
    assert one[-1] == pytest.approx(float(spiral_longitude_deg(np.array(211.0), 0.0, 400.0)), abs=1e-6)


@pytest.mark.parametrize("range_rsun", [29.0, 241.0, np.nan])
def test_point_outside_the_wind_has_no_field_line(range_rsun: float) -> None:
    with pytest.raises(InputError, match="choose a source between them"):
        field_lines_deg(steady_wind(np.full(128, 350.0)), range_rsun, np.zeros(1))


@pytest.mark.parametrize(
    ("boundary", "reason"),
    [
        (np.full(128, np.nan), "between 150 and 3000"),
        (np.full(128, 20.0), "between 150 and 3000"),
        (np.full(3, 400.0), "at least 8"),
        (np.full((8, 8), 400.0), "at least 8"),
    ],
)
def test_bad_boundary_is_refused(boundary: np.ndarray, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        steady_wind(boundary)


def test_outside_the_grid_is_not_a_number() -> None:
    assert np.isnan(steady_wind(np.full(128, 350.0)).at(np.array([10.0, 300.0]), np.zeros(2))).all()

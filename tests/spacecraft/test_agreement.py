"""Positions inside files against the ephemeris, and the light time to a point."""

import numpy as np
import pytest

from bella.exceptions import InputError, NoDataError
from bella.spacecraft import (
    largest_difference_km,
    light_time_s,
    position,
    position_hee,
    prefer_given,
    require_agreement,
)
from bella.spacecraft.agreement import DISAGREEMENT_FLAG
from bella.units import AU_RSUN, R_SUN_KM

TIMES = np.arange("2012-06-07T00", "2012-06-08T00", dtype="datetime64[h]").astype("datetime64[ns]")


def given_km(observatory: str = "STEREO-A", frame: str = "hci", off_km: float = 0.0) -> np.ndarray:
    return position(observatory, TIMES, frame) * R_SUN_KM + [0.0, off_km, 0.0]


@pytest.mark.parametrize("frame", ["hee", "heeq", "hci"])
def test_the_difference_is_the_largest_of_all_instants(frame: str) -> None:
    positions = given_km(frame=frame)
    positions[7, 2] += 1234.0
    positions[3] = np.nan

    assert largest_difference_km("STEREO-A", TIMES, positions, frame) == pytest.approx(1234.0, abs=1e-3)


def test_positions_of_the_file_win_when_they_agree() -> None:
    placed = prefer_given("STEREO-A", TIMES, given_km(off_km=900.0), "HCI")

    assert (placed.source, placed.flag) == ("file", "")
    assert placed.largest_difference_km == pytest.approx(900.0, abs=1e-3)
    np.testing.assert_allclose(placed.position_rsun * R_SUN_KM, given_km(off_km=900.0))


def test_positions_that_disagree_are_flagged_and_the_ephemeris_is_used() -> None:
    placed = prefer_given("STEREO-A", TIMES, given_km(off_km=60_000.0), "hci")

    assert (placed.source, placed.flag) == ("ephemeris", DISAGREEMENT_FLAG)
    np.testing.assert_allclose(placed.position_rsun * R_SUN_KM, given_km())


def test_a_frame_that_is_not_what_it_says_is_refused() -> None:
    require_agreement("STEREO-A", TIMES, given_km(frame="heeq"), "heeq")
    with pytest.raises(InputError, match=r"up to \d+ km from the ephemeris, more than 50000: check .* HEEQ"):
        require_agreement("STEREO-A", TIMES, given_km(frame="hee"), "heeq")


def test_the_tolerance_can_be_stated() -> None:
    assert prefer_given("STEREO-A", TIMES, given_km(off_km=900.0), "hci", tolerance_km=800.0).flag == DISAGREEMENT_FLAG


@pytest.mark.parametrize("missing", [None, np.full((24, 3), np.nan)])
def test_without_positions_in_the_file_the_ephemeris_is_used(missing: np.ndarray | None) -> None:
    placed = prefer_given("STEREO-A", TIMES, missing, "hee")

    assert (placed.source, placed.flag) == ("ephemeris", "")
    assert np.isnan(placed.largest_difference_km)


def test_a_file_with_gaps_is_not_preferred() -> None:
    positions = given_km()
    positions[3] = np.nan

    assert prefer_given("STEREO-A", TIMES, positions, "hci").source == "ephemeris"


def test_wind_may_be_anywhere_on_its_orbit_about_l1() -> None:
    orbit = given_km("WIND", "hee", off_km=650_000.0)

    assert prefer_given("WIND", TIMES, orbit, "hee").source == "file"


def test_shapes_that_do_not_match_and_nothing_finite_are_refused() -> None:
    with pytest.raises(InputError, match=r"24 instants go with positions of shape \(23, 3\)"):
        largest_difference_km("STEREO-A", TIMES, given_km()[1:], "hci")
    with pytest.raises(InputError, match="none of the given positions"):
        largest_difference_km("STEREO-A", TIMES, given_km() * np.nan, "hci")
    with pytest.raises(NoDataError, match="STEREO-B"):
        prefer_given("STEREO-B", TIMES + np.timedelta64(1000, "D"), given_km(), "hci")


def test_light_from_the_sun_takes_eight_minutes_to_earth() -> None:
    assert light_time_s("EARTH", np.datetime64("2012-06-07T19:30"), [0, 0, 0])[0] == pytest.approx(
        1.0150 * 499.005, abs=0.1
    )


def test_light_time_is_a_distance_over_c() -> None:
    point = np.array([20.0, 10.0, -3.0])
    distance_rsun = np.linalg.norm(position_hee("STEREO-A", TIMES, TIMES[0]) - point, axis=1)

    np.testing.assert_allclose(light_time_s("STEREO-A", TIMES, point), distance_rsun / AU_RSUN * 499.00478, rtol=1e-6)


def test_light_time_to_what_is_no_point_is_refused() -> None:
    for point in ([1.0, 2.0], [1.0, 2.0, np.nan], np.zeros((5, 3))):
        with pytest.raises(InputError, match="x, y, z in solar radii"):
            light_time_s("WIND", TIMES, point)

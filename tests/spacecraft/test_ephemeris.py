import sys
from subprocess import run

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import CartesianRepresentation, HeliocentricMeanEcliptic, SkyCoord, get_body_barycentric
from astropy.time import Time
from hypothesis import given, settings
from hypothesis import strategies as st
from sunpy.coordinates import HeliocentricEarthEcliptic

from bella.exceptions import InputError, NoDataError
from bella.spacecraft import BODIES, OBSERVATORIES, coverage, fleet, missing_from_fleet, position, position_hee
from bella.spacecraft.ephemeris import _ecliptic_km
from bella.units import AU_RSUN, R_SUN_KM
from tests.waiting import PATIENCE_S

BURST = np.datetime64("2012-06-07T19:30", "ns")
RANGE_AU = {
    "EARTH": (0.983, 1.017),
    "ACE": (0.97, 1.01),
    "STEREO-A": (0.95, 0.98),
    "STEREO-B": (0.97, 1.09),
    "PSP": (0.045, 1.02),
    "SOLO": (0.27, 1.03),
}


def longitude_deg(position: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(position[1], position[0])))


@pytest.mark.parametrize(
    ("observatory", "longitude", "range_au"), [("STEREO-A", 116.81, 0.9596), ("STEREO-B", -116.65, 1.0015)]
)
def test_where_the_stereos_were_at_the_burst(observatory: str, longitude: float, range_au: float) -> None:
    position = position_hee(observatory, BURST, BURST)[0]

    assert longitude_deg(position) == pytest.approx(longitude, abs=0.006)
    assert np.linalg.norm(position) / AU_RSUN == pytest.approx(range_au, abs=6e-5)


@pytest.mark.parametrize(
    "date", ["2006-06-01", "2009-01-01T12:00", "2012-06-07T19:30", "2017-03-20T05:17", "2024-09-30", "2028-02-29"]
)
def test_earth_agrees_with_an_independent_ephemeris(date: str) -> None:
    utc = Time(date, scale="utc")
    earth = get_body_barycentric("earth", utc, ephemeris="builtin") - get_body_barycentric(
        "sun", utc, ephemeris="builtin"
    )

    obliquity = np.radians(84381.448 / 3600.0)
    x, y, z = earth.xyz.to_value(u.km)
    expected = [x, np.cos(obliquity) * y + np.sin(obliquity) * z, np.cos(obliquity) * z - np.sin(obliquity) * y]
    found = _ecliptic_km("EARTH", np.array([date], dtype="datetime64[ns]"))[0]

    assert np.linalg.norm(found - expected) < 60.0


@pytest.mark.parametrize("date", ["2007-03-01", "2012-06-07T19:30", "2014-09-01", "2020-07-21", "2026-01-01"])
def test_the_frame_is_that_of_sunpy(date: str) -> None:
    moment = np.array([date], dtype="datetime64[ns]")
    for body in ("EARTH", "STEREO-A", *(["PSP"] if date > "2019" else [])):
        inertial = CartesianRepresentation(*_ecliptic_km(body, moment)[0] * u.km)
        frame = HeliocentricMeanEcliptic(inertial, equinox="J2000", obstime=Time(date))
        expected = (
            SkyCoord(frame).transform_to(HeliocentricEarthEcliptic(obstime=Time(date))).cartesian.xyz.to_value(u.km)
        )

        residual_km = np.linalg.norm(position_hee(body, moment, moment[0])[0] * R_SUN_KM - expected)

        assert residual_km < 40.0, body


def test_earth_is_on_the_x_axis_of_its_own_frame_and_leaves_it_by_a_degree_a_day() -> None:
    today, tomorrow = position_hee("EARTH", BURST + np.array([0, 1], "timedelta64[D]"), BURST)

    np.testing.assert_allclose(today[1:], 0.0, atol=1e-9)
    assert longitude_deg(tomorrow) == pytest.approx(0.957, abs=0.003)


def test_the_frame_of_another_epoch_keeps_distances_and_separations() -> None:
    early, late = (
        np.concatenate([position_hee(name, BURST, epoch) for name in ("WIND", "STEREO-A", "STEREO-B")])
        for epoch in (BURST, BURST + np.timedelta64(100, "D"))
    )

    np.testing.assert_allclose(early @ early.T, late @ late.T, rtol=1e-12)


def test_wind_is_near_a_real_spacecraft_at_the_lagrange_point() -> None:
    months = np.arange("2006-08", "2026-07", dtype="datetime64[M]").astype("datetime64[ns]")
    separation = [np.linalg.norm(position_hee("WIND", t, t)[0] - position_hee("ACE", t, t)[0]) for t in months]

    assert max(separation) < 1.0


@pytest.mark.parametrize("body", BODIES)
@given(fraction=st.floats(0.0, 1.0), seconds=st.floats(0.001, 3600.0))
@settings(max_examples=60, deadline=None)
def test_a_body_moves_steadily_within_its_range_of_distances(body: str, fraction: float, seconds: float) -> None:
    start, stop = coverage(body)
    step = np.timedelta64(int(seconds * 1e9), "ns")
    first = min(start + np.timedelta64(int(fraction * ((stop - start) / np.timedelta64(1, "ns"))), "ns"), stop - step)

    before, after = _ecliptic_km(body, np.array([first, first + step]))

    nearest, farthest = RANGE_AU[body]
    assert nearest < np.linalg.norm(before) / R_SUN_KM / AU_RSUN < farthest
    assert np.linalg.norm(after - before) < 200.0 * seconds + 1e-3


def test_the_fleet_is_who_existed_then() -> None:
    assert fleet(BURST)["observatory"].tolist() == ["WIND", "STEREO-A", "STEREO-B"]
    assert fleet(np.datetime64("2021-06-07"))["observatory"].tolist() == ["WIND", "STEREO-A", "PSP", "SOLO"]


def test_the_fleet_in_polar_coordinates() -> None:
    stereo_a = fleet(BURST).set_index("observatory").loc["STEREO-A"]

    assert stereo_a["range_rsun"] == pytest.approx(0.9596 * AU_RSUN, abs=0.02)
    assert stereo_a["longitude_deg"] == pytest.approx(116.81, abs=0.006)
    assert abs(stereo_a["latitude_deg"]) < 0.2


@pytest.mark.parametrize("name", OBSERVATORIES)
def test_both_ends_of_the_coverage_are_inside(name: str) -> None:
    start, stop = coverage(name)

    assert np.isfinite(_ecliptic_km(name, np.array([start, stop]))).all()
    with pytest.raises(NoDataError, match=name):
        _ecliptic_km(name, np.array([stop + np.timedelta64(1, "s")]))


def test_stereo_b_is_refused_after_contact_was_lost() -> None:
    with pytest.raises(NoDataError, match=r"STEREO-B from 2007-01-01T00:00:00Z to 2014-.*not at 2014-10-02.*x_rsun"):
        position_hee("STEREO-B", np.array(["2012-01-01", "2014-10-02"], "datetime64[ns]"), BURST)


def test_an_epoch_without_earth_is_refused() -> None:
    with pytest.raises(NoDataError, match="EARTH"):
        position_hee("STEREO-A", BURST, np.datetime64("1999-01-01"))
    with pytest.raises(NoDataError, match="1999"):
        fleet(np.datetime64("1999-01-01"))


def test_an_unknown_observatory_is_told_what_to_give() -> None:
    with pytest.raises(InputError, match=r"'JUICE' \(known: WIND, STEREO-A.*x_rsun, y_rsun, z_rsun"):
        position_hee("JUICE", BURST, BURST)


def test_a_missing_instant_is_refused() -> None:
    with pytest.raises(InputError, match="NaT"):
        position_hee("WIND", np.array(["NaT"], "datetime64[ns]"), BURST)


def test_no_instants_give_no_positions() -> None:
    assert position_hee("WIND", np.array([], "datetime64[ns]"), BURST).shape == (0, 3)


def test_a_position_does_not_cost_the_import_of_sunpy() -> None:
    code = "import sys, bella.spacecraft as s; s.fleet('2012-06-07'); sys.exit('sunpy' in sys.modules)"

    assert run([sys.executable, "-c", code], check=False, timeout=PATIENCE_S).returncode == 0


def test_advice_after_the_end_of_a_table_is_what_can_be_done() -> None:
    late = np.datetime64("2035-01-01", "ns")
    assert "update-ephemeris" in missing_from_fleet(late)["STEREO-A"]
    assert "contact was lost" in missing_from_fleet(late)["STEREO-B"]
    assert missing_from_fleet(np.datetime64("2012-06-07", "ns")) == {}
    for name, advised in (("STEREO-A", True), ("STEREO-B", False)):
        with pytest.raises(NoDataError) as after:
            position(name, late)
        assert ("update-ephemeris" in str(after.value)) is advised
        with pytest.raises(NoDataError) as before:
            position(name, np.datetime64("1990-01-01", "ns"))
        assert "update-ephemeris" not in str(before.value), "it brings later positions only"

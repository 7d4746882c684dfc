"""HEEQ, Carrington and HCI against sunpy, and against angles that were published."""

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import CartesianRepresentation, HeliocentricMeanEcliptic, SkyCoord
from astropy.time import Time
from sunpy.coordinates import HeliocentricInertial, HeliographicStonyhurst
from sunpy.coordinates.sun import L0

from bella.exceptions import InputError
from bella.spacecraft import FRAMES, fleet, position
from bella.spacecraft.ephemeris import _ecliptic_km
from bella.spacecraft.frames import frame_axes, heeq_axes, solar_pole
from bella.units import AU_RSUN, R_SUN_KM

BURST = np.datetime64("2012-06-07T19:30", "ns")
DATES = ["2007-03-01", "2010-01-17", "2012-06-07T19:30", "2014-09-01", "2020-07-21", "2024-12-24T11:00", "2028-06-01"]
TOLERANCE_DEG = 0.01


def angles_deg(position_rsun: np.ndarray) -> tuple[float, float]:
    x, y, z = position_rsun
    return float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arctan2(z, np.hypot(x, y))))


def of_sunpy(body: str, date: str, frame: type) -> np.ndarray:
    inertial = CartesianRepresentation(*_ecliptic_km(body, np.array([date], "datetime64[ns]"))[0] * u.km)
    ecliptic = SkyCoord(HeliocentricMeanEcliptic(inertial, equinox="J2000", obstime=Time(date)))
    return np.asarray(ecliptic.transform_to(frame(obstime=Time(date))).cartesian.xyz.to_value(u.km)) / R_SUN_KM


def bodies(date: str) -> list[str]:
    return ["EARTH", *(["PSP", "SOLO"] if date > "2020-03" else []), *(["STEREO-A"] if date < "2026" else [])]


@pytest.mark.parametrize("date", DATES)
@pytest.mark.parametrize(("frame", "theirs"), [("heeq", HeliographicStonyhurst), ("hci", HeliocentricInertial)])
def test_directions_are_those_of_sunpy(date: str, frame: str, theirs: type) -> None:
    for body in bodies(date):
        expected, found = of_sunpy(body, date, theirs), position(body, np.datetime64(date), frame)[0]
        separation = np.arctan2(np.linalg.norm(np.cross(expected, found)), expected @ found)

        assert np.degrees(separation) < TOLERANCE_DEG, body


@pytest.mark.parametrize("date", DATES)
def test_carrington_longitude_is_that_of_sunpy_without_light_time(date: str) -> None:
    meridian = L0(Time(date), light_travel_time_correction=False, nearest_point=False).deg
    for body in bodies(date):
        stonyhurst, _ = angles_deg(of_sunpy(body, date, HeliographicStonyhurst))
        found, _ = angles_deg(position(body, np.datetime64(date), "carrington")[0])

        assert abs((found - stonyhurst - meridian + 180.0) % 360.0 - 180.0) < TOLERANCE_DEG, body


@pytest.mark.parametrize(
    ("observatory", "longitude", "latitude", "range_au"),
    [("STEREO-A", 117.02, 6.42, 0.9596), ("STEREO-B", -116.81, -6.48, 1.0015)],
)
def test_the_stereos_at_the_burst_of_2012(observatory: str, longitude: float, latitude: float, range_au: float) -> None:
    found = position(observatory, BURST, "heeq")[0]

    assert angles_deg(found) == pytest.approx((longitude, latitude), abs=0.01)
    assert np.linalg.norm(found) / AU_RSUN == pytest.approx(range_au, abs=6e-5)


@pytest.mark.parametrize(("observatory", "longitude"), [("STEREO-A", -67.013), ("PSP", 21.177), ("SOLO", 117.396)])
def test_the_longitudes_typed_into_semp(observatory: str, longitude: float) -> None:
    day = np.arange("2020-07-21T00", "2020-07-22T00", dtype="datetime64[h]")
    found = [angles_deg(one)[0] for one in position(observatory, day, "heeq")]

    assert min(abs(np.array(found) - longitude)) < 0.02


@pytest.mark.parametrize("frame", FRAMES)
def test_axes_are_a_rotation(frame: str) -> None:
    axes = frame_axes(frame, _ecliptic_km("EARTH", np.array([BURST]))[0], BURST)

    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)


def test_earth_has_no_stonyhurst_longitude_and_is_south_of_the_solar_equator_in_march() -> None:
    longitude, latitude = angles_deg(position("EARTH", np.datetime64("2012-03-06"), "heeq")[0])

    assert longitude == pytest.approx(0.0, abs=1e-9)
    assert latitude == pytest.approx(-7.25, abs=0.02)


def test_the_sun_turns_once_in_a_synodic_rotation() -> None:
    start, stop = (np.datetime64(t, "ns") for t in ("2012-06-07T19:30", "2012-06-08T19:30"))
    (before, _), (after, _) = (angles_deg(position("EARTH", t, "carrington")[0]) for t in (start, stop))

    assert (before - after) % 360.0 == pytest.approx(14.1844 - 0.957, abs=0.02)


def test_the_solar_axis_is_that_of_the_iau() -> None:
    right_ascension, declination, tilt = np.radians([286.13, 63.87, 84381.448 / 3600.0])
    x, y, z = (
        np.cos(declination) * np.cos(right_ascension),
        np.cos(declination) * np.sin(right_ascension),
        np.sin(declination),
    )
    iau = np.array([x, np.cos(tilt) * y + np.sin(tilt) * z, np.cos(tilt) * z - np.sin(tilt) * y])

    assert np.degrees(np.arccos(min(1.0, iau @ solar_pole()))) < TOLERANCE_DEG


def test_the_fleet_in_every_frame_is_at_the_same_distances() -> None:
    tables = {frame: fleet(BURST, frame) for frame in FRAMES}

    for frame, table in tables.items():
        assert table.attrs["frame"] == frame
        np.testing.assert_allclose(table["range_rsun"], tables["hee"]["range_rsun"], rtol=1e-12)
    assert tables["carrington"]["longitude_deg"].between(0.0, 360.0, inclusive="left").all()


def test_an_unknown_frame_and_an_earth_without_a_place_are_refused() -> None:
    with pytest.raises(InputError, match="'GSE' is not known: use one of hee, heeq"):
        position("WIND", BURST, "GSE")
    with pytest.raises(InputError, match="longer than zero"):
        heeq_axes(np.zeros(3))

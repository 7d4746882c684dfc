"""The wind that explains speeds in situ: real speeds with one spacecraft left out, and winds of other laws."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bella.exceptions import InputError, NoDataError
from bella.solar_wind import Places, Speeds, WindAssimilation, assimilate_wind, hourly_speeds
from bella.spacecraft import polar, position
from tests.solar_wind.in_situ import AROUND, FLEET, lists_of

HOURS = AROUND + np.arange(-24 * 13, 24 * 13) * np.timedelta64(1, "h")


def places_of(name: str, utc: np.ndarray) -> Places:
    range_rsun, longitude_deg, _ = polar(position(name, utc, "carrington"))
    return Places(range_rsun, longitude_deg, utc)


def left_out(speeds: dict[str, pd.Series], name: str, around: np.datetime64 = AROUND) -> tuple[np.ndarray, Speeds]:
    """Measured speeds of a spacecraft every six hours, and those of the wind that the others explain."""
    found = assimilate_wind({one: series for one, series in speeds.items() if one != name}, around)
    utc = around + np.arange(-13 * 4, 13 * 4) * np.timedelta64(6, "h")
    # hours of speeds are their beginnings
    measured = speeds[name].reindex(pd.DatetimeIndex(utc.astype("datetime64[h]"))).to_numpy()
    known = np.isfinite(measured)
    return measured[known], found.speeds(places_of(name, utc[known]))


def test_errors_hold_for_a_real_spacecraft_that_was_left_out(tmp_path: Path, reference_files: Path) -> None:
    """2012-05-25 to 2012-06-21, which no number of the model was chosen on; independent errors gave 4 to 14."""
    speeds = lists_of(tmp_path, reference_files)
    pulls = []
    for name in FLEET:
        measured, predicted = left_out(speeds, name)
        pulls.append((measured - predicted.mean_km_s) / predicted.sd_km_s)
    each = [float(np.sqrt(np.mean(one**2))) for one in pulls]
    assert 0.8 < np.sqrt(np.mean(np.concatenate(pulls) ** 2)) < 1.25
    # one rotation has some ten independent speeds of a spacecraft
    assert each == pytest.approx([0.59, 1.33, 1.19], abs=0.06)


def test_numbers_of_the_rotation_of_2012(tmp_path: Path, reference_files: Path) -> None:
    """Pinned: each constant of the model error moves at least one of them."""
    speeds = lists_of(tmp_path, reference_files)
    at = pd.Timestamp("2012-06-07T19:00")
    assert [speeds[name][at] for name in FLEET] == [649, 352, 342]

    found = assimilate_wind(speeds, AROUND)

    tests = [found.left_out[name] for name in FLEET]
    assert [one.climate_rmse_km_s for one in tests] == pytest.approx(PINNED_CLIMATE, rel=0.01)
    assert [one.rmse_km_s for one in tests] == pytest.approx(PINNED_RMSE, rel=0.01)
    assert [one.z_rms for one in tests] == pytest.approx(PINNED_Z, rel=0.01)
    boundary = found.boundary()
    assert boundary.sd_km_s.min() == pytest.approx(PINNED_SD[0], rel=0.01)
    assert boundary.sd_km_s.max() == pytest.approx(PINNED_SD[1], rel=0.01)
    near_sun = found.speeds(Places(np.array([40.0, 200.0]), np.full(2, 180.0), np.full(2, AROUND)))
    assert near_sun.sd_km_s == pytest.approx(PINNED_SD[2:], rel=0.01)


PINNED_CLIMATE = [105.8, 146.3, 156.7]
PINNED_RMSE = [64.3, 127.5, 123.9]
PINNED_Z = [0.596, 1.450, 1.251]
PINNED_SD = [31.9, 121.8, 43.7, 46.3]


def ballistic_wind(seed: int) -> dict[str, pd.Series]:
    """Speeds of a wind of other laws: parcels that keep the speed of their source, which jumps and drifts in days.

    Streams are top hats of random width and speed on a slow wind, whose edges each drift by degrees per day.
    """
    random = np.random.default_rng(seed)
    number = int(random.integers(2, 6))
    west, width = random.uniform(0, 360, number), random.uniform(15, 60, number)
    speed, drift = random.uniform(430, 680, number), 2.5 * random.standard_normal((2, number))
    speeds = {}
    for name in FLEET:
        places = places_of(name, HOURS)
        day = (HOURS - AROUND) / np.timedelta64(1, "D")
        slow = 330.0 + random.normal(0, 25)
        seen = np.full(HOURS.size, slow)
        for _ in range(20):  # the source longitude depends on the speed of the parcel itself
            travel_d = (places.range_rsun - 20.0) * 695_700.0 / seen / 86_400.0
            source, left = places.longitude_deg + travel_d * 14.18, day - travel_d
            now = np.full(HOURS.size, slow)
            for i in range(number):
                low, high = west[i] + drift[0, i] * left, west[i] + width[i] + drift[1, i] * left
                inside = (source - low) % 360.0 < (high - low)
                now = np.where(inside, np.maximum(now, speed[i]), now)
            seen = 0.5 * (seen + now)
        smooth = pd.Series(seen).rolling(12, center=True, min_periods=1).mean().to_numpy()
        speeds[name] = pd.Series(smooth + 15.0 * random.standard_normal(HOURS.size), index=pd.DatetimeIndex(HOURS))
    return speeds


def test_errors_hold_for_a_wind_of_other_laws() -> None:
    pulls = []
    for seed in range(300, 312):
        speeds = ballistic_wind(seed)
        name = FLEET[seed % 3]
        found = assimilate_wind({one: series for one, series in speeds.items() if one != name}, AROUND)
        predicted = found.speeds(places_of(name, HOURS[12::48]))
        pulls.append((speeds[name].to_numpy()[12::48] - predicted.mean_km_s) / predicted.sd_km_s)
    pull = np.concatenate(pulls)
    assert 0.7 < np.sqrt(np.mean(pull**2)) < 1.3
    assert 0.6 < np.mean(np.abs(pull) < 1) < 0.85


def test_a_mean_over_days_is_as_uncertain_as_its_correlation_makes_it() -> None:
    speeds = ballistic_wind(7)
    found = assimilate_wind({name: speeds[name] for name in FLEET[:2]}, AROUND)
    predicted = found.speeds(places_of("STEREO-B", HOURS[:72:6]))
    sd = np.sqrt(np.diag(predicted.covariance))
    mean_sd = np.sqrt(predicted.covariance.mean())
    assert 0.6 * sd.mean() < mean_sd < 0.99 * sd.mean(), "errors of three days are nearly one error"
    correlation = predicted.covariance[0] / (sd[0] * sd)
    assert (np.diff(correlation[1:]) < 0).all()


@pytest.fixture(scope="module")
def one_week() -> WindAssimilation:
    index = pd.DatetimeIndex(AROUND + np.arange(-72, 72) * np.timedelta64(1, "h"))
    return assimilate_wind({"WIND": pd.Series(560.0, index=index)}, AROUND)


def test_where_nothing_is_measured_the_climate_stays(one_week: WindAssimilation) -> None:
    boundary = one_week.boundary()
    far = np.diag(boundary.covariance).argmax()
    # 340 km/s with relative errors of 0.17, 0.20, 0.07 and 0.06; speeds at 1 au narrow the acceleration alone
    relative = np.sqrt(0.17**2 + 0.20**2 + 0.07**2 + 0.06**2)
    assert np.sqrt(boundary.covariance[far, far]) == pytest.approx(relative, rel=0.01)
    assert np.exp(boundary.ln_km_s[far]) == pytest.approx(340, rel=0.02)


def test_a_measured_speed_is_found_where_and_when_it_was_measured(one_week: WindAssimilation) -> None:
    here = one_week.speeds(places_of("WIND", np.array([AROUND])))
    assert here.mean_km_s[0] == pytest.approx(560, rel=0.03)
    assert here.sd_km_s[0] < 45
    later = one_week.speeds(places_of("WIND", np.array([AROUND + np.timedelta64(13, "D")])))
    assert later.sd_km_s[0] > 2 * here.sd_km_s[0]


def test_the_map_is_that_of_its_time(one_week: WindAssimilation) -> None:
    place = places_of("WIND", np.array([AROUND]))
    now = one_week.map_at(AROUND).at(place.range_rsun, place.longitude_deg)
    median = np.exp(one_week.speeds(place).ln_km_s)
    assert now == pytest.approx(median, rel=0.02)
    # the parcel at that place 20 days later left the Sun another time
    later = one_week.map_at(AROUND + np.timedelta64(20, "D")).at(place.range_rsun, place.longitude_deg)
    assert later[0] < now[0] - 20


def test_places_outside_the_wind_have_no_speed(one_week: WindAssimilation) -> None:
    found = one_week.speeds(Places(np.array([10.0, 100.0, 300.0]), np.zeros(3), np.full(3, AROUND)))
    assert np.isfinite(found.mean_km_s).tolist() == [False, True, False]
    assert np.isfinite(found.sd_km_s).tolist() == [False, True, False]


def test_speeds_measured_inside_the_inner_boundary_do_no_harm() -> None:
    """Parker Solar Probe, whose perihelion of 2021-08-09 was at 16 solar radii."""
    around = np.datetime64("2021-08-09T19:00", "ns")
    hours = pd.DatetimeIndex(around + np.arange(-24 * 14, 24 * 14) * np.timedelta64(1, "h"))
    speeds = {name: pd.Series(400.0, index=hours) for name in ("WIND", "PSP")}
    assert np.linalg.norm(position("PSP", [around], "hee")[0]) < 30

    found = assimilate_wind(speeds, around)

    assert np.isfinite(found.boundary().ln_km_s).all()
    assert found.left_out["WIND"].rmse_km_s < 25


@pytest.mark.parametrize("speeds", [{}, {"WIND": pd.Series([400.0], index=pd.DatetimeIndex([AROUND]))}])
def test_too_few_speeds_are_no_wind(speeds: dict[str, pd.Series]) -> None:
    with pytest.raises(NoDataError, match="at least 24 are needed"):
        assimilate_wind(speeds, AROUND)


@pytest.mark.parametrize(
    ("text", "error", "reason"),
    [
        ("2012 1 0 9999\n", NoDataError, "no hour with a speed"),
        ("2012 1 0\n", InputError, "3 columns"),
        ("2012 1 25 400\n", InputError, "no such hour"),
        ("2012 367 0 400\n", InputError, "no such hour"),
        ("2012 1 0 -400\n", InputError, "no solar wind"),
        ("<html>not found</html>\n", InputError, "cannot be read"),
        ("", InputError, "cannot be read"),
    ],
)
def test_bad_list_is_refused_in_one_line(tmp_path: Path, text: str, error: type[Exception], reason: str) -> None:
    path = tmp_path / "omni.lst"
    path.write_text(text)
    with pytest.raises(error, match=reason) as caught:
        hourly_speeds(path)
    assert "\n" not in str(caught.value)

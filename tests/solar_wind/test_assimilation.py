from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bella.exceptions import InputError, NoDataError
from bella.solar_wind import assimilate_wind, hourly_speeds, steady_wind
from bella.spacecraft import position
from tests.solar_wind.in_situ import AROUND, FLEET, lists_of


def test_real_rotation_of_2012_is_explained(tmp_path: Path, reference_files: Path) -> None:
    speeds = lists_of(tmp_path, reference_files)
    at = pd.Timestamp("2012-06-07T19:00")
    assert [speeds[name][at] for name in FLEET] == [649, 352, 342]

    found = assimilate_wind(speeds, AROUND)

    # an independent implementation: 107, 145, 155 km/s before; 34, 111, 96 after; errors of 17 to 26 km/s
    assert [found.prior_rmse_km_s[name] for name in FLEET] == pytest.approx([107, 145, 155], abs=2)
    assert [found.rmse_km_s[name] for name in FLEET] == pytest.approx([34, 111, 96], abs=2)
    assert found.boundary_sd_km_s.min() == pytest.approx(17, abs=1)
    assert found.boundary_sd_km_s.max() == pytest.approx(26, abs=2)


def simulated(boundary: np.ndarray, fleet: tuple[str, ...], noise_km_s: float = 0.0) -> dict[str, pd.Series]:
    """What a fleet measures in a wind that rotates with the Sun."""
    hours = AROUND + np.arange(-24 * 15, 24 * 15) * np.timedelta64(1, "h")
    wind, random = steady_wind(boundary), np.random.default_rng(4)
    speeds = {}
    for name in fleet:
        place = position(name, hours, "carrington")
        longitude = np.degrees(np.arctan2(place[:, 1], place[:, 0]))
        values = wind.at(np.linalg.norm(place, axis=1), longitude) + noise_km_s * random.standard_normal(hours.size)
        speeds[name] = pd.Series(values, index=pd.DatetimeIndex(hours))
    return speeds


def test_known_wind_is_found_within_its_errors() -> None:
    boundary = 380 + 60 * np.sin(np.radians(np.arange(128) * 360 / 128)) + 20 * np.cos(np.arange(128) * np.pi / 32)

    found = assimilate_wind(simulated(boundary, FLEET, noise_km_s=20.0), AROUND)

    pull = (found.boundary_km_s - boundary) / found.boundary_sd_km_s
    assert np.abs(pull).max() < 3
    assert max(found.rmse_km_s.values()) < 30


def test_where_nothing_is_measured_the_climate_stays() -> None:
    speeds = simulated(np.full(128, 500.0), ("WIND",))
    week = {"WIND": speeds["WIND"]["2012-06-05":"2012-06-11"]}

    found = assimilate_wind(week, AROUND)

    assert found.boundary_sd_km_s.max() == pytest.approx(90, rel=0.01)
    assert found.boundary_sd_km_s.min() < 40
    assert found.boundary_km_s[found.boundary_sd_km_s.argmax()] == pytest.approx(350, abs=5)


def test_speeds_measured_inside_the_inner_boundary_do_no_harm() -> None:
    """Parker Solar Probe, whose perihelion of 2021-08-09 was at 16 solar radii."""
    around = np.datetime64("2021-08-09T19:00", "ns")
    hours = pd.DatetimeIndex(around + np.arange(-24 * 14, 24 * 14) * np.timedelta64(1, "h"))
    speeds = {name: pd.Series(400.0, index=hours) for name in ("WIND", "PSP")}
    assert np.linalg.norm(position("PSP", [around], "hee")[0]) < 30

    found = assimilate_wind(speeds, around)

    assert np.isfinite(found.boundary_km_s).all()
    assert found.rmse_km_s["WIND"] < 10


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

"""Tables of users: units of any kind, times of any scale, and every wrong column named."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
from astropy import units as u
from astropy.table import MaskedColumn, QTable, Table
from astropy.time import Time
from astropy.utils.masked import Masked

from bella.arrivals import check_arrivals
from bella.exceptions import InputError
from bella.user_tables import arrival_frame

UTC = ["2012-06-07T19:30:00", "2012-06-07T19:31:00", "2012-06-07T19:32:30"]
NAMES = ["WIND", "STEREO-A", "STEREO-B"]


def columns(**changes: Any) -> dict[str, Any]:
    plain = {"observatory": NAMES, "frequency_mhz": [0.5, 0.5, 0.5], "arrival_utc": UTC, "sigma_s": [10.0, 20.0, 30.0]}
    made = plain | changes
    return {name: values for name, values in made.items() if values is not None}


EXPECTED = check_arrivals(arrival_frame(columns()))


@pytest.mark.parametrize(
    "changed",
    [
        {"frequency_mhz": None, "frequency": [500, 500, 500] * u.kHz},
        {"frequency_mhz": [5e5, 5e5, 5e5] * u.Hz},
        {"sigma_s": None, "sigma": np.array([10, 20, 30]) / 60 * u.min},
        {"arrival_utc": None, "time": Time(UTC, scale="utc")},
        {"arrival_utc": None, "arrival_time": Time(UTC, scale="utc").tt},
        {"arrival_utc": None, "arrival": Time(UTC, scale="utc").tai},
        {"sigma_s": Masked([10.0, 20.0, 30.0] * u.s, mask=[False] * 3)},
    ],
)
def test_units_and_scales_are_converted(changed: dict[str, Any]) -> None:
    for table in (columns(**changed), QTable(columns(**changed))):
        found = check_arrivals(arrival_frame(table))
        for name in ("frequency_mhz", "sigma_s"):
            np.testing.assert_allclose(found[name], EXPECTED[name], rtol=1e-12)
        away = found["arrival_utc"].to_numpy() - EXPECTED["arrival_utc"].to_numpy()
        assert np.abs(away / np.timedelta64(1, "us")).max() < 1


def test_positions_with_units_are_in_solar_radii() -> None:
    where = {"x": [1.0, 0.0, 0.0] * u.au, "y": [0.0, 1.0, -1.0] * u.au, "z": [0.0, 0.0, 6957.0] * u.km}
    found = check_arrivals(arrival_frame(columns(**where)))
    assert found["x_rsun"][0] == pytest.approx(215.032, abs=1e-3)
    assert found["z_rsun"][2] == pytest.approx(0.01)


def test_a_plain_table_with_units_and_a_frame_of_quantities_are_taken() -> None:
    table = Table(columns(frequency_mhz=None, frequency=[500.0] * 3))
    table["frequency"].unit = "kHz"
    frame = pd.DataFrame(columns(sigma_s=None)).assign(sigma=pd.Series([10 * u.s, 20 * u.s, 0.5 * u.min], dtype=object))
    assert arrival_frame(table)["frequency_mhz"].tolist() == [0.5] * 3
    assert arrival_frame(frame)["sigma_s"].tolist() == [10.0, 20.0, 30.0]


def test_a_table_of_the_package_passes_through() -> None:
    again = check_arrivals(arrival_frame(EXPECTED))
    pd.testing.assert_frame_equal(again, EXPECTED)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"frequency_mhz": None, "frequency": [0.5] * 3}, r"column frequency: has no unit; name it frequency_mhz"),
        ({"sigma_s": None, "sigma": [1.0] * 3}, r"column sigma: has no unit"),
        ({"sigma_s": [1.0, 1.0, 1.0] * u.km}, r"column sigma_s: its unit is km, and should be one of time"),
        ({"sigma_s": [1.0, np.nan, 1.0]}, r"column sigma_s: row 2 is NaN"),
        ({"frequency_mhz": [0.5, 0.5, np.nan] * u.MHz}, r"column frequency_mhz: row 3 is NaN"),
        ({"sigma_s": MaskedColumn([1.0, 1.0, 1.0], mask=[0, 0, 1])}, r"column sigma_s: row 3 is masked"),
        ({"sigma_s": Masked([1.0, 1.0, 1.0] * u.s, mask=[1, 0, 0])}, r"column sigma_s: row 1 is masked"),
        ({"observatory": MaskedColumn(NAMES, mask=[0, 1, 0])}, r"column observatory: row 2 is masked"),
        ({"sigma_s": None}, r"column sigma_s is missing"),
        ({"sigma": [1.0] * 3 * u.s}, r"column sigma: sigma_s is given twice"),
        ({"sigma_s": [1.0] * 2 * u.s}, r"column sigma_s: has 2 rows, and observatory 3"),
        ({"sigma_s": np.ones((3, 1)) * u.s}, r"column sigma_s: has 2 dimensions"),
    ],
)
def test_what_is_wrong_is_named(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        arrival_frame(columns(**changed))


def test_a_masked_time_is_named() -> None:
    moments = Time(Masked(np.array(UTC), mask=[False, True, False]))
    with pytest.raises(InputError, match="column time: row 2 is masked"):
        arrival_frame(columns(arrival_utc=None, time=moments))


def test_quantities_and_bare_numbers_in_one_column_are_told_apart() -> None:
    frame = pd.DataFrame(columns(sigma_s=None)).assign(sigma=pd.Series([10 * u.s, 20.0, 30 * u.s], dtype=object))
    with pytest.raises(InputError, match="column sigma: row 2 has no unit"):
        arrival_frame(frame)


def test_a_column_given_twice_is_named() -> None:
    frame = pd.DataFrame(columns())
    with pytest.raises(InputError, match="column sigma_s: is given twice"):
        arrival_frame(pd.concat([frame, frame[["sigma_s"]]], axis=1))


def test_what_is_no_table_is_refused() -> None:
    with pytest.raises(InputError, match="list is no table"):
        arrival_frame([1, 2, 3])  # type: ignore[arg-type]

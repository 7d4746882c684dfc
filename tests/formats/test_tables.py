"""The localisation table: the numbers of the solution, in the order that scripts rely on."""

import csv
import datetime
import io
import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.arrivals import check_arrivals
from bella.bursts import published_arrivals
from bella.formats import COLUMNS, localisation_csv, localisation_records
from bella.formats.tables import track_numbers
from bella.multilateration import localise
from bella.records import JointTrack, Moment, Parameter

PLANE = [
    "frequency_mhz",
    "x_rsun",
    "y_rsun",
    "z_rsun",
    "cov_xx_rsun2",
    "cov_xy_rsun2",
    "cov_yy_rsun2",
    "area68_rsun2",
    "area95_rsun2",
    "modes",
    "emission_utc",
    "v_over_c",
    "v_over_c_sd",
    "contraction_x",
    "contraction_y",
    "contraction_v",
    "log_evidence",
    "flags",
    "method",
    "preset",
]
SPACE = ["cov_xz_rsun2", "cov_yz_rsun2", "cov_zz_rsun2"]


@pytest.fixture(scope="module")
def solution() -> xr.Dataset:
    return localise(check_arrivals(published_arrivals(np.array([0.2, 0.5, 1.0]))), draws=20)


@pytest.fixture(scope="module")
def records(solution) -> list[dict[str, object]]:
    return localisation_records(solution)


def read(text: str) -> pd.DataFrame:
    return pd.read_csv(io.StringIO(text), comment="#", keep_default_na=False)


def test_records_hold_the_numbers_of_the_solution(solution, records) -> None:
    assert len(records) == 3
    for row, record in enumerate(records):
        assert tuple(record) == COLUMNS
        at = solution.isel(frequency=row)
        assert record["frequency_mhz"] == float(at["frequency"])
        assert record["flags"] == str(at["flags"].item())
        assert type(record["modes"]) is int
        for name in PLANE[1:-3]:
            if name != "emission_utc":
                assert record[name] == float(at[name]), name
        assert all(record[name] is None for name in SPACE)


def test_emission_times_are_utc_to_the_millisecond(solution, records) -> None:
    reference = pd.Timestamp(solution.attrs["reference_time"])
    for row, record in enumerate(records):
        emitted = record["emission_utc"]
        assert isinstance(emitted, datetime.datetime)
        assert emitted.utcoffset() == datetime.timedelta(0)
        expected = float(solution["emission_s"][row])
        assert (emitted - reference.to_pydatetime()).total_seconds() == pytest.approx(expected, abs=6e-4)


def test_columns_are_in_order_and_those_of_space_left_out_in_the_plane(records) -> None:
    table = read(localisation_csv(records, {"frame": "HEE", "method": "posterior", "preset": "default"}))

    assert table.columns.tolist() == PLANE
    assert set(table["method"]) == {"posterior"}
    assert [name for name in COLUMNS if name not in SPACE] == PLANE[:-2]


def test_solutions_in_space_have_their_columns_after_those_of_the_plane(records) -> None:
    spatial = [record | dict.fromkeys(SPACE, 1.5) for record in records]
    columns = read(localisation_csv(spatial, {"method": "posterior", "preset": "default"})).columns.tolist()

    assert columns == PLANE[:7] + SPACE + PLANE[7:]


def test_the_csv_gives_the_numbers_back(records) -> None:
    table = read(localisation_csv(records, {"method": "posterior", "preset": "default"}))

    for name in PLANE[:-3]:
        if name == "emission_utc":
            assert [pd.Timestamp(t).to_pydatetime() for t in table[name]] == [record[name] for record in records]
            assert table[name].str.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z").all()
        else:
            np.testing.assert_allclose(table[name].astype(float), [record[name] for record in records], rtol=1e-9)
    assert table["flags"].tolist() == [record["flags"] for record in records]


def test_comments_come_first_and_begin_with_a_hash(records) -> None:
    lines = localisation_csv(records, {"frame": "HEE", "preset": "default"}).splitlines()

    assert lines[:2] == ["# frame: HEE", "# preset: default"]
    assert lines[2].startswith("frequency_mhz,")
    assert len(lines) == 3 + len(records)
    assert {len(row) for row in csv.reader(lines[2:])} == {len(PLANE) - 1}


def test_what_is_not_known_is_empty(solution) -> None:
    unknown = solution.assign(log_evidence=solution["log_evidence"] * np.nan)
    records = localisation_records(unknown)
    assert [record["log_evidence"] for record in records] == [None] * 3

    text = localisation_csv(records, {"method": "nuts", "preset": "default"})
    assert set(read(text)["log_evidence"]) == {""}
    assert "nan" not in text.lower()


def test_records_without_their_times_are_json(records) -> None:
    bare = [{name: value for name, value in record.items() if name != "emission_utc"} for record in records]
    assert json.loads(json.dumps(bare, allow_nan=False)) == bare


def test_an_empty_table_has_its_heading() -> None:
    lines = localisation_csv([], {"method": "posterior", "preset": "default"}).splitlines()
    assert lines == ["# method: posterior", "# preset: default", ",".join(PLANE)]


def test_a_track_has_its_medians_and_the_ends_of_their_68_percent_intervals() -> None:
    numbers = dict(zip(("q2_5", "q16", "q50", "q84", "q97_5", "mean", "sd"), range(1, 8), strict=True))
    speed = Parameter(**{name: 100.0 + one for name, one in numbers.items()}, contraction=0.5)
    track = JointTrack(
        model="a spiral",
        rotation_period_d=25.38,
        epoch_utc="2012-06-07T19:29:00.000Z",
        phi0_deg=Parameter(),
        v_sw_km_s=speed,
        beam_speed_c=Parameter(),
        release_utc=Moment(q16="2012-06-07T19:19:00.000Z", q50="2012-06-07T19:20:00.000Z", sd=30.0),
    )
    row = track_numbers(track)
    assert [row[f"v_sw{end}"] for end in ("_km_s", "_low_km_s", "_high_km_s", "_contraction")] == [103, 102, 104, 0.5]
    assert (row["release_utc"], row["release_sd_s"]) == ("2012-06-07T19:20:00.000Z", 30.0)
    assert row["phi0_deg"] is None

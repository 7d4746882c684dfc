"""The arrival table: what is refused, what is taken, and that writing loses nothing that matters."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bella.arrivals import (
    MAX_ROWS,
    OPTIONAL,
    REQUIRED,
    ArrivalGrid,
    arrival_grid,
    arrivals_csv,
    check_arrivals,
    check_covariance,
    error_scale_s,
    evenly_spread,
    locate_receivers,
    parse_arrivals,
    read_arrivals,
    reference_utc,
)
from bella.bursts import published_arrivals
from bella.exceptions import InputError, NoDataError
from bella.spacecraft import position_hee

HEADING = "observatory,frequency_mhz,arrival_utc,sigma_s,edge"
ROWS = (
    "WIND,0.5,2012-06-07T19:30:00.250Z,7,half_maximum",
    "STEREO-A,0.5,2012-06-07T19:31:00Z,8,half_maximum",
    "STEREO-B,0.5,2012-06-07T19:32:00Z,9,half_maximum",
)
GOOD = "\n".join([HEADING, *ROWS]) + "\n"
PLACED = "\n".join(
    [HEADING + ",flag,x_rsun,y_rsun,z_rsun"]
    + [f"{name}{row[row.index(',') :]},,{i}0,{i}1,-{i}" for i, (name, row) in enumerate(zip("ABC", ROWS, strict=True))]
)


def refusal(text: str) -> str:
    with pytest.raises(InputError) as caught:
        parse_arrivals(text, source="table.csv")
    message = str(caught.value)
    assert message.startswith("table.csv: ")
    assert len(message.splitlines()) == 1
    assert len(message) < 400
    return message


def cell(row: int, old: str, new: str) -> str:
    lines = [HEADING, *ROWS]
    assert old in lines[row]
    lines[row] = lines[row].replace(old, new)
    return "\n".join(lines)


def test_a_good_table_has_typed_columns() -> None:
    table = parse_arrivals(GOOD)

    assert tuple(table.columns) == REQUIRED + OPTIONAL
    assert table["arrival_utc"].dtype == "datetime64[ns]"
    assert table["arrival_utc"].iloc[0] == pd.Timestamp("2012-06-07T19:30:00.250")
    assert table["sigma_s"].tolist() == [7.0, 8.0, 9.0]
    assert table["flag"].tolist() == ["", "", ""]
    assert table[["x_rsun", "y_rsun", "z_rsun"]].isna().all(axis=None)


@pytest.mark.parametrize("name", REQUIRED)
def test_a_missing_column_is_named(name) -> None:
    assert f"column {name} is missing" in refusal(GOOD.replace(name, "other", 1))


@pytest.mark.parametrize(
    ("row", "old", "new", "column"),
    [
        (2, ",8,", ",nan,", "sigma_s"),
        (2, ",8,", ",inf,", "sigma_s"),
        (2, ",8,", ",1e400,", "sigma_s"),
        (2, ",8,", ",,", "sigma_s"),
        (2, ",8,", ",0,", "sigma_s"),
        (2, ",8,", ",-1,", "sigma_s"),
        (2, ",8,", ",86401,", "sigma_s"),
        (2, ",8,", ",eight,", "sigma_s"),
        (1, ",7,", ",True,", "sigma_s"),
        (3, "0.5", "-0.5", "frequency_mhz"),
        (3, "0.5", "0", "frequency_mhz"),
        (3, "0.5", "NaN", "frequency_mhz"),
        (3, "0.5", "1e9", "frequency_mhz"),
        (3, "0.5", "", "frequency_mhz"),
        (1, "2012-06-07T19:30:00.250Z", "", "arrival_utc"),
        (1, "2012-06-07T19:30:00.250Z", "NaT", "arrival_utc"),
        (1, "2012-06-07T19:30:00.250Z", "07/06/2012 19:30", "arrival_utc"),
        (1, "2012-06-07T19:30:00.250Z", "1339097400", "arrival_utc"),
        (1, "2012-06-07T19:30:00.250Z", "2012-06-07T25:30:00Z", "arrival_utc"),
        (1, "2012-06-07T19:30:00.250Z", "now", "arrival_utc"),
        (1, "2012-06-07T19:30:00.250Z", "today", "arrival_utc"),
        (1, "2012", "1500", "arrival_utc"),
        (1, "2012", "0001", "arrival_utc"),
        (1, "2012", "9999", "arrival_utc"),
        (1, "06-07", "06-08", "arrival_utc"),
        (1, "2012-06-07T19:30:00.250Z", "2012-06-07T19:30:00.250-10:00", "arrival_utc"),
        (2, "STEREO-A", "", "observatory"),
        (2, "STEREO-A", "   ", "observatory"),
        (2, "STEREO-A", '"STEREO\nA"', "observatory"),
        (2, "STEREO-A", "STEREO\0A", "observatory"),
        (2, "STEREO-A", "X" * 500 + "\t", None),
        (3, "half_maximum", "gauss_hermite", "edge"),
        (3, "half_maximum", "", "edge"),
        (3, ",9,half_maximum", ",9", "edge"),
        (3, "STEREO-B", "STEREO-A", "frequency_mhz"),
    ],
)
def test_a_wrong_value_is_named_by_row_and_column(row, old, new, column) -> None:
    if column is None:
        assert parse_arrivals(cell(row, old, new))["observatory"].iloc[row - 1] == "X" * 500
    else:
        assert f"row {row}, column {column}: " in refusal(cell(row, old, new))


def test_a_long_wrong_value_is_shown_in_short() -> None:
    assert "'99999" in refusal(cell(1, ",7,", "," + "9" * 100_000 + ","))


def test_the_same_channel_twice_is_refused() -> None:
    assert "row 4, column frequency_mhz: '0.5' occurs twice" in refusal(GOOD + ROWS[0])
    assert "row 4, column frequency_mhz" in refusal(GOOD + ROWS[0].replace("0.5", "0.50").replace("WIND", " WIND "))


@pytest.mark.parametrize("kept", [1, 2])
def test_fewer_than_three_spacecraft_are_refused(kept) -> None:
    message = refusal("\n".join([HEADING, *ROWS[:kept]]))
    assert "column observatory: only " in message
    assert "3 or more" in message


def test_three_spacecraft_without_a_common_frequency_are_refused() -> None:
    table = parse_arrivals(GOOD.replace("STEREO-B,0.5", "STEREO-B,0.6"))
    with pytest.raises(InputError, match="no frequency has arrival times of 3"):
        arrival_grid(locate_receivers(table))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "\n\n",
        "   ",
        "# only a comment\n",
        HEADING,
        "\0\0\0",
        "\ud800",
        '"' + GOOD,
        '{"observatory": "WIND"}',
        "<html><body>not found</body></html>",
        GOOD.replace(",", "|"),
        GOOD + "WIND,0.4,2012-06-07T19:30:00Z,7,half_maximum,extra,extra\n",
        "\n".join([HEADING] + [row + "," for row in ROWS]),
        "\n".join([HEADING] + [row + ",extra,extra" for row in ROWS]),
        "\x89PNG\r\n\x1a\n\0\0\0\rIHDR",
    ],
)
def test_what_is_not_a_table_is_refused(text) -> None:
    refusal(text)


def test_rows_longer_than_the_heading_are_called_that() -> None:
    assert "more columns than the header" in refusal("\n".join([HEADING] + [row + "," for row in ROWS]))


def test_files_that_cannot_be_read_are_refused(tmp_path) -> None:
    binary, folder = tmp_path / "binary.csv", tmp_path
    binary.write_bytes(b"\xff\xfe\x00\x89PNG" + bytes(range(256)))
    for path in (binary, folder, tmp_path / "absent.csv"):
        with pytest.raises(InputError, match=r"cannot be read|not text in UTF-8|not a CSV table") as caught:
            read_arrivals(path)
        assert len(str(caught.value).splitlines()) == 1


def test_a_huge_table_is_refused() -> None:
    rows = "\n".join(f"WIND,{1 + i * 1e-6:.6f},2012-06-07T19:30:00Z,7,e" for i in range(MAX_ROWS + 1))
    assert f"has {MAX_ROWS + 1} rows" in refusal(f"{HEADING}\n{rows}")


@pytest.mark.parametrize(
    "text",
    [
        "﻿" + GOOD,
        "﻿# made by hand\n" + GOOD,
        "# made by hand, 1 June\n" + GOOD + "# the end",
        GOOD.replace("\n", "\r\n"),
        GOOD.replace("\n", "\r"),
        GOOD.replace("\n", "\n\n"),
        GOOD.replace(",", ", "),
        GOOD.replace(",7,", ",7.0 ,"),
        GOOD.replace("Z", ""),
        GOOD.replace(",", ";"),
        GOOD.replace(",", "\t"),
        GOOD.replace(",", ";").replace("0.5;", "0,5;"),
        GOOD.replace("0.5,", "5.0D-01,"),
        GOOD.replace(HEADING, HEADING.upper().replace(",", " , ")),
        GOOD.replace("T", " ", 0).replace("07T", "07 "),
        GOOD.replace("T19:30:00.250Z", "T21:30:00.250+02:00"),
        GOOD.replace("2012-06-07T19:30:00.250Z", "2012-06-08T01:30:00.250+06:00"),
    ],
)
def test_harmless_varieties_are_taken(text) -> None:
    pd.testing.assert_frame_equal(parse_arrivals(text), parse_arrivals(GOOD))


def test_a_hash_inside_a_row_is_no_comment() -> None:
    """Cutting rows there would drop the positions behind it without a word."""
    table = parse_arrivals(PLACED.replace("half_maximum,,", "half_maximum,see note #3,"))

    assert table["flag"].tolist() == ["see note #3"] * 3
    assert table["x_rsun"].tolist() == [0.0, 10.0, 20.0]


def test_a_name_that_would_be_read_as_a_comment_is_refused() -> None:
    assert "row 1, column observatory: '#A' is not a name" in refusal(GOOD.replace("WIND", '"#A"'))


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (",10,11,-1", ",10,,-1", "row 2, column y_rsun: '' is empty; give all three or none"),
        (",10,11,-1", ",10,nan,-1", "row 2, column y_rsun: 'nan' is not a number"),
        (",10,11,-1", ",10,11,inf", "row 2, column z_rsun: 'inf' is not a number"),
        (",10,11,-1", ",1e9,11,-1", "row 2, column x_rsun: '1e9' is not a number between -21503.2 and 21503.2"),
        ("z_rsun", "other", "column z_rsun is missing; give all of"),
    ],
)
def test_partial_positions_are_refused(old, new, reason) -> None:
    assert reason in refusal(PLACED.replace(old, new))


def test_an_unknown_observatory_needs_a_position() -> None:
    table = parse_arrivals(GOOD.replace("STEREO-B", "ULYSSES"), source="t")
    with pytest.raises(InputError, match=r"^t: row 3, column observatory: 'ULYSSES' is not in the ephemeris; add"):
        locate_receivers(table)

    located = locate_receivers(parse_arrivals(PLACED))
    assert located["y_rsun"].tolist() == [1.0, 11.0, 21.0]


def test_a_time_outside_the_ephemeris_is_no_data() -> None:
    with pytest.raises(NoDataError, match=r"^t: .*2150"):
        locate_receivers(parse_arrivals(GOOD.replace("2012-", "2150-"), source="t"))


def test_a_table_keeps_its_name_through_all_that_is_done_with_it() -> None:
    apart = parse_arrivals(GOOD.replace("WIND,0.5", "WIND,0.6"), source="mine.csv")
    with pytest.raises(InputError, match=r"^mine\.csv: no frequency has arrival times of 3"):
        arrival_grid(locate_receivers(check_arrivals(apart)))


def test_a_table_of_a_spreadsheet_in_utf_16_is_read(tmp_path) -> None:
    (tmp_path / "sheet.csv").write_text(GOOD, encoding="utf-16")
    pd.testing.assert_frame_equal(read_arrivals(tmp_path / "sheet.csv"), parse_arrivals(GOOD))


def test_receivers_are_placed_at_their_own_times_in_one_frame() -> None:
    table = locate_receivers(parse_arrivals(GOOD))
    epoch = np.datetime64("2012-06-07T19:30:00", "ns")

    assert reference_utc(table) == epoch
    for _, row in table.iterrows():
        where = position_hee(row["observatory"], np.datetime64(row["arrival_utc"], "ns"), epoch)[0]
        np.testing.assert_allclose(row[["x_rsun", "y_rsun", "z_rsun"]].to_numpy(dtype=float), where)


@pytest.mark.parametrize("column", ["observatory", "edge", "frequency_mhz", "sigma_s", "arrival_utc"])
def test_missing_values_in_a_frame_are_refused(column) -> None:
    frame = parse_arrivals(GOOD)
    frame[column] = frame[column].astype(object)
    frame.loc[1, column] = None

    with pytest.raises(InputError, match=f"row 2, column {column}"):
        check_arrivals(frame)


def test_checking_twice_changes_nothing() -> None:
    once = parse_arrivals(PLACED)

    pd.testing.assert_frame_equal(check_arrivals(once), once)
    pd.testing.assert_frame_equal(check_arrivals(once.set_index(pd.Index([7, 7, 7]))), once)


def test_times_before_1970_keep_their_order() -> None:
    table = parse_arrivals(GOOD.replace("2012-", "1960-"))
    assert reference_utc(table) == np.datetime64("1960-06-07T19:30:00", "ns")


def test_writing_keeps_milliseconds_and_ten_digits(tmp_path) -> None:
    table = check_arrivals(published_arrivals())
    path = tmp_path / "arrivals.csv"
    path.write_text(arrivals_csv(table))
    again = read_arrivals(path)

    assert "x_rsun" not in path.read_text().splitlines()[0]
    np.testing.assert_allclose(again["frequency_mhz"], table["frequency_mhz"], rtol=1e-9)
    np.testing.assert_allclose(again["sigma_s"], table["sigma_s"], rtol=1e-9)
    late = (table["arrival_utc"] - again["arrival_utc"]) / pd.Timedelta("1ms")
    assert late.between(0, 1, inclusive="left").all()
    path.write_text(arrivals_csv(again))
    pd.testing.assert_frame_equal(read_arrivals(path), again)


@given(
    st.lists(
        st.tuples(
            st.text(st.characters(categories=["L", "N", "P"]), min_size=1, max_size=8).filter(lambda t: t[0] != "#"),
            st.floats(1e-9, 86_400, allow_nan=False),
            st.integers(0, 20_000_000),
            st.text(st.characters(categories=["L", "N", "P", "Zs"]), max_size=8),
            st.floats(-1e4, 1e4),
        ),
        min_size=3,
        max_size=6,
        unique_by=lambda row: row[0],
    )
)
@settings(max_examples=60, deadline=None)
def test_any_valid_table_survives_writing(rows) -> None:
    start = pd.Timestamp("2012-06-07T12:00:00")
    frame = pd.DataFrame(
        [
            {
                "observatory": name,
                "frequency_mhz": 0.5,
                "arrival_utc": start + pd.Timedelta(ms, unit="ms"),
                "sigma_s": sigma,
                "edge": "half_maximum",
                "flag": flag.strip(),
                "x_rsun": x,
                "y_rsun": -x,
                "z_rsun": 0.0,
            }
            for name, sigma, ms, flag, x in rows
        ]
    )
    table = check_arrivals(frame)
    again = parse_arrivals(arrivals_csv(table))

    assert again["observatory"].tolist() == table["observatory"].tolist()
    assert again["flag"].tolist() == table["flag"].tolist()
    assert again["arrival_utc"].tolist() == table["arrival_utc"].tolist()
    np.testing.assert_allclose(again["sigma_s"], table["sigma_s"], rtol=1e-9)
    np.testing.assert_allclose(again["x_rsun"], table["x_rsun"], rtol=1e-9)


def refused_or_taken(text: str) -> None:
    try:
        table = parse_arrivals(text)
    except InputError as error:
        lines = str(error).splitlines()
    else:
        lines = ["taken"]
        assert table[list(REQUIRED)].notna().all(axis=None)
    assert len(lines) == 1


@given(st.text())
@settings(max_examples=150, deadline=None)
def test_any_text_is_refused_in_one_line(text) -> None:
    refused_or_taken(text)


@given(st.text(max_size=40), st.integers(0, len(GOOD)), st.integers(0, 30))
@settings(max_examples=250, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_any_damage_to_a_good_table_is_refused_in_one_line_or_harmless(text, start, length) -> None:
    refused_or_taken(GOOD[:start] + text + GOOD[start + length :])


@given(st.lists(st.text(max_size=12), min_size=5, max_size=5))
@settings(max_examples=150, deadline=None)
def test_any_cells_are_refused_in_one_line_or_taken(cells) -> None:
    quoted = ",".join('"' + value.replace('"', '""') + '"' for value in cells)
    refused_or_taken("\n".join([HEADING, *ROWS, quoted]))


def test_frequencies_are_picked_evenly_in_logarithm() -> None:
    frequency_mhz = np.concatenate([np.linspace(1.0, 2.0, 200), np.array([4.0, 8.0, 16.0])])
    places = evenly_spread(frequency_mhz, 5)
    np.testing.assert_allclose(frequency_mhz[places], [1.0, 2.0, 4.0, 8.0, 16.0])
    assert evenly_spread(frequency_mhz[::-1], 3).tolist() == sorted(evenly_spread(frequency_mhz[::-1], 3).tolist())
    assert evenly_spread(np.array([0.3]), 5).tolist() == [0]


def test_errors_of_the_delay_last_along_the_band() -> None:
    frequency = np.array([0.2, 0.2 * np.exp(0.8), 2.0])
    times = np.zeros((3, 2))
    grid = ArrivalGrid(
        frequency,
        ("A", "B"),
        times,
        times + 1.0,
        np.ones((3, 2, 3)),
        np.datetime64("2012-06-07", "ns"),
        "half_rise",
        delay_sd_s=np.array([[4.0, 1.0], [2.0, 1.0], [1.0, 1.0]]),
        shape_length_ln_f=0.1,
    )
    covariance = grid.covariance_s2()

    assert np.diag(covariance) == pytest.approx([17.0, 2.0, 5.0, 2.0, 2.0, 2.0])
    assert covariance[0, 2] == pytest.approx(4.0 * 2.0 * np.exp(-0.5 * 0.8**2))
    assert covariance[0, 1] == covariance[0, 3] == 0.0


def test_names_of_spacecraft_are_those_that_people_write() -> None:
    text = GOOD.replace("WIND", "Wind").replace("STEREO-A", "STA").replace("STEREO-B", "stereo behind")
    assert parse_arrivals(text)["observatory"].to_list() == ["WIND", "STEREO-A", "STEREO-B"]


def test_a_mistyped_name_is_refused_unless_its_row_gives_its_position() -> None:
    assert "row 2, column observatory" in refusal(cell(2, "STEREO-A", "Solar Orbitr"))
    assert "did you mean SOLO?" in refusal(cell(2, "STEREO-A", "Solar Orbitr"))
    assert parse_arrivals(PLACED.replace("B,", "Solar Orbitr,"))["observatory"].iloc[1] == "Solar Orbitr"


def test_rounding_is_no_asymmetry_of_a_covariance_but_a_thousandth_is() -> None:
    covariance = np.diag([1e6, 4.0, 9.0])
    covariance[0, 1] = 1e-6
    check_covariance(covariance, 3)
    covariance[0, 1] = 1e3
    with pytest.raises(InputError, match="symmetric"):
        check_covariance(covariance, 3)


def test_errors_of_edges_grow_less_than_the_rise_about_its_middle() -> None:
    scale_s = error_scale_s(np.array([10.0, 40.0, 160.0]))

    np.testing.assert_allclose(scale_s, [40.0 * 0.25**0.75, 40.0, 40.0 * 4**0.75])

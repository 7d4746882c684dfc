"""Published lists are read as they are, and what is no such list is refused in one line."""

import json
from contextlib import suppress
from copy import deepcopy
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bella.exceptions import InputError
from bella.linked_events import Event, EventList, read_event_list
from bella.linked_events.lists import LARGEST_LIST_BYTES
from tests.linked_events.published import (
    BEGIN_UNIX_S,
    DONKI_CMES,
    DONKI_FLARES,
    DONKI_PARTICLES,
    FILES,
    GOES,
    SWPC,
    SWPC_JSON,
    TFCAT,
)

BEGIN, PEAK = datetime(2012, 6, 7, 19, 24, tzinfo=UTC), datetime(2012, 6, 7, 19, 35, tzinfo=UTC)
LIGHT_TO_EARTH_S = 506.4
"""Earth was 1.0148 au from the Sun on that day (Astronomical Almanac), and 1 au takes 499.005 s."""


def read(folder: Path, content: Any, name: str = "list.json", **options: Any) -> EventList:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return read_event_list(path, **options)


def only(found: EventList) -> Event:
    (event,) = found.events
    assert (found.left_out, found.reason) == (0, "")
    return event


def test_edited_events_of_swpc(tmp_path: Path) -> None:
    found = read(tmp_path, SWPC, "20120607events.txt")
    first, before, last = found.events
    assert (first.kind, first.event_id, first.size, first.region) == ("flare", "SWPC:20120607T1924", "C3.4", 11494)
    assert (first.start_utc, first.peak_utc) == (BEGIN, PEAK)
    assert first.end_utc == datetime(2012, 6, 7, 19, 46, tzinfo=UTC)
    assert (first.latitude_deg, first.longitude_deg) == (-17.0, 62.0)
    assert (before.start_utc.hour, before.start_utc.minute, before.peak_utc) == (23, 50, None)
    assert before.end_utc == datetime(2012, 6, 8, 0, 12, tzinfo=UTC)
    assert (before.region, before.latitude_deg) == (None, None)
    assert last.peak_utc == datetime(2012, 6, 8, 0, 3, tzinfo=UTC)
    assert (first.start_utc - first.at_sun_utc).total_seconds() == pytest.approx(LIGHT_TO_EARTH_S, abs=0.3)


@pytest.mark.parametrize(
    ("content", "event_id"),
    [
        (SWPC_JSON, "SWPC:20120607T1924"),
        (GOES, "GOES:20120607T1924"),
        (DONKI_FLARES, "DONKI:2012-06-07T19:24:00-FLR-001"),
    ],
    ids=["swpc", "goes", "donki"],
)
def test_a_flare_is_the_same_from_every_list(tmp_path: Path, content: Any, event_id: str) -> None:
    event = only(read(tmp_path, content))
    assert (event.event_id, event.kind, event.size, event.observer) == (event_id, "flare", "C3.4", "EARTH")
    assert (event.start_utc, event.peak_utc) == (BEGIN, PEAK)
    if event.source != "GOES":
        assert (event.latitude_deg, event.longitude_deg, event.region) == (-17.0, 62.0, 11494)


def test_places_are_positive_to_the_west_and_north(tmp_path: Path) -> None:
    for place, expected in {
        "N05E110": (5.0, -110.0),
        "s17w62": (-17.0, 62.0),
        "N95W10": (None, None),
        "": (None, None),
    }.items():
        event = only(read(tmp_path, [DONKI_FLARES[0] | {"sourceLocation": place}]))
        assert (event.latitude_deg, event.longitude_deg) == expected


def test_a_cme_has_the_speed_of_its_best_analysis(tmp_path: Path) -> None:
    event = only(read(tmp_path, DONKI_CMES))
    assert (event.kind, event.size, event.published_id) == ("cme", "560 km/s", "2012-06-07T20:00:00-CME-001")
    assert event.start_utc == datetime(2012, 6, 7, 20, tzinfo=UTC)
    assert (event.longitude_deg, event.region, event.link) == (None, None, "")
    without = only(read(tmp_path, [DONKI_CMES[0] | {"cmeAnalyses": None}]))
    assert without.size == ""


def test_particles_name_what_measured_them(tmp_path: Path) -> None:
    event = only(read(tmp_path, DONKI_PARTICLES))
    assert (event.kind, event.size) == ("particles", "STEREO A: IMPACT 13-100 MeV")
    assert event.start_utc == datetime(2012, 6, 7, 20, 20, tzinfo=UTC)


def test_radio_bursts_of_tfcat_are_boxes_in_time_and_frequency(tmp_path: Path) -> None:
    first, second = read(tmp_path, TFCAT).events
    assert (first.kind, first.published_id, first.observer) == ("radio", "17", "STEREO-A")
    assert first.start_utc.timestamp() == BEGIN_UNIX_S
    assert first.end_utc == first.start_utc + timedelta(seconds=1500)
    assert (first.f_low_mhz, first.f_high_mhz) == (0.2, 16.0)
    assert second.start_utc == first.start_utc + timedelta(seconds=90_000)
    # STEREO-A was 0.9604 au from the Sun
    assert (first.start_utc - first.at_sun_utc).total_seconds() == pytest.approx(0.9604 * 499.005, abs=2.0)
    solo = deepcopy(TFCAT)
    solo["crs"]["properties"]["ref_position_id"] = "solar-orbiter"
    solo["features"] = [
        {"id": 1, "geometry": {"type": "Point", "coordinates": [datetime(2022, 4, 2, tzinfo=UTC).timestamp(), 900.0]}}
    ]
    event = only(read(tmp_path, solo))
    assert event.observer == "SOLO"
    assert 150 < (event.start_utc - event.at_sun_utc).total_seconds() < 200  # near 0.36 au


@pytest.mark.parametrize(
    "written",
    [
        "2012-06-07T19:24Z",
        "2012-06-07T19:24:00",
        "2012-06-07 19:24",
        "2012-06-07T21:24:00+02:00",
        "2012-06-07T15:24-04:00",
    ],
)
def test_times_are_utc_in_whatever_zone_they_are_written(tmp_path: Path, written: str) -> None:
    row = DONKI_FLARES[0] | {"beginTime": written}
    assert only(read(tmp_path, [row])).start_utc == BEGIN


def test_a_row_that_says_nothing_is_left_out_and_counted(tmp_path: Path) -> None:
    good = [DONKI_FLARES[0] | {"flrID": f"{number}"} for number in range(4)]
    for wrong, said in (
        ({"beginTime": "yesterday"}, "'yesterday' is not a time"),
        ({"beginTime": None}, "None is not a time"),
        ({"classType": "strong"}, "'STRONG' is not a class"),
        ({"flrID": ""}, "has no id"),
        ({"beginTime": "1912-06-07T19:24Z"}, "1912-06-07 is before 1990"),
        ({"beginTime": "2092-06-07T19:24Z", "peakTime": None}, "2092-06-07T19:24Z is in the future"),
        ({"peakTime": "2012-06-07T18:00Z"}, "peak_utc is 2012-06-07T18:00Z, and the event begins 2012-06-07T19:24Z"),
    ):
        found = read(tmp_path, [*good, DONKI_FLARES[0] | wrong])
        assert (len(found.events), found.left_out) == (4, 1), said
        assert found.reason.startswith("row 5: ")
        assert said in found.reason
    found = read(tmp_path, [*good, {"flrID": "x"}, "text"])
    assert (len(found.events), found.left_out, found.reason) == (4, 2, "row 5: it has no beginTime")


def test_the_future_is_later_than_the_time_of_reading(tmp_path: Path) -> None:
    two = [*DONKI_FLARES, DONKI_FLARES[0] | {"flrID": "later", "beginTime": "2012-06-09T00:00Z", "peakTime": None}]
    assert read(tmp_path, two, now=BEGIN).left_out == 1
    assert read(tmp_path, two, now=BEGIN + timedelta(days=1)).left_out == 0


def test_an_event_that_is_there_twice_counts_once_as_it_was_written_last(tmp_path: Path) -> None:
    event = only(read(tmp_path, [*DONKI_FLARES, DONKI_FLARES[0] | {"classType": "M1.0"}]))
    assert event.size == "M1.0"


def test_a_list_without_events_is_a_list(tmp_path: Path) -> None:
    assert read(tmp_path, []).events == ()
    quiet = SWPC.partition("5190")[0] + "NO EVENT REPORTS.\n"
    assert read(tmp_path, quiet, "20120607events.txt").events == ()


def test_numbers_of_regions_are_those_of_their_time(tmp_path: Path) -> None:
    old = SWPC.replace(":Date: 2012 06 07", ":Date: 2000 06 07").replace("1494", "9026")
    assert read(tmp_path, old, "20000607events.txt").events[0].region == 9026


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "is empty"),
        (" \n", "is empty"),
        ("[{", "is damaged"),
        ("<html>Service unavailable</html>", "is none of the known lists"),
        ({"error": "API key missing"}, "API key missing"),
        ([1, 2], "its rows are no objects"),
        ([{"foo": 1, "bar": 2}], "fields bar, foo"),
        ([{"flrID": "a"}, {"flrID": "b"}], "2 of 2 rows are not usable (row 1: it has no beginTime)"),
        (SWPC.replace(":Date: 2012 06 07", ":Date: 2012 16 07"), "2012 16 07 is not a day"),
        ({"type": "FeatureCollection", "features": []}, "is not TFCat 1.0 (it has no crs)"),
        ("[" * 100_000, "nested too deeply"),
    ],
)
def test_nonsense_is_refused_in_one_line(tmp_path: Path, content: Any, said: str) -> None:
    with pytest.raises(InputError) as found:
        read(tmp_path, content)
    assert said in str(found.value)
    assert str(found.value).startswith("list.json")
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(
    ("name", "value"), [("time_coords_id", "jd"), ("spectral_coords", {"type": "wavelength", "unit": "kHz"})]
)
def test_tfcat_in_other_coordinates_is_refused(tmp_path: Path, name: str, value: Any) -> None:
    other = deepcopy(TFCAT)
    other["crs"]["properties"][name] = value
    with pytest.raises(InputError, match="times must be unix and spectra frequencies"):
        read(tmp_path, other)


def test_a_file_that_is_too_large_or_away_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "large.json"
    with path.open("wb") as file:
        file.truncate(LARGEST_LIST_BYTES + 1)
    with pytest.raises(InputError, match="256 MB"):
        read_event_list(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_event_list(tmp_path / "none.json")


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_damaged_lists_end_in_events_or_in_one_line(tmp_path: Path, data: st.DataObject) -> None:
    content = bytearray(data.draw(st.sampled_from(list(FILES.values()))).encode())
    for _ in range(data.draw(st.integers(1, 6))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place : place + data.draw(st.integers(0, 4))] = data.draw(st.binary(max_size=4))
    path = tmp_path / "damaged.json"
    path.write_bytes(content)
    with suppress(InputError):
        read_event_list(path)

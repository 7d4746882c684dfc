"""Folders of published files: which are used, what they hold, and what is said where there is none."""

import os
from pathlib import Path

import numpy as np
import pytest

from bella.exceptions import InputError
from bella.solar_wind import InSitu, hourly_speeds, regions_around, speeds_around
from tests.solar_wind.test_context import HOLES, SUMMARY

BURST = np.datetime64("2012-06-07T19:30", "ns")
FIRST_HOUR = np.datetime64("2012-05-01T00", "h")


def hours(path: Path, speed_km_s: float, days: int = 90) -> None:
    """Write a list with one speed."""
    utc = FIRST_HOUR + np.arange(24 * days)
    day = (utc.astype("datetime64[D]") - np.datetime64("2012-01-01")).astype(int) + 1
    hour = (utc - utc.astype("datetime64[D]")).astype(int)
    path.parent.mkdir(exist_ok=True)
    path.write_text("".join(f"2012 {d} {h} {speed_km_s:g}\n" for d, h in zip(day, hour, strict=True)))


def digests(found: InSitu) -> list[str]:
    return [file.sha256 for file in found.used]


def test_name_of_a_file_says_whose_speeds_it_holds(tmp_path: Path) -> None:
    for name in ("omni2_2012.lst", "STA_2012.txt", "below/stereo-b-2012.dat"):
        hours(tmp_path / name, 400.0)
    for name in ("notes.txt", "omni2_2012.fmt", "voyager.lst"):
        (tmp_path / name).write_text("no speeds\n")

    found = speeds_around(tmp_path, BURST)

    assert list(found.speeds) == ["STEREO-A", "STEREO-B", "WIND"]
    assert (found.left_out, found.reason) == ((), "")
    assert found.speeds["WIND"].index.min() >= BURST - np.timedelta64(14, "D")
    assert found.speeds["WIND"].index.max() <= BURST + np.timedelta64(14, "D")
    assert found.at(BURST) == dict.fromkeys(found.speeds, 400.0)
    assert found.at(BURST + np.timedelta64(30, "D")) == {}


def test_speed_at_a_time_is_that_of_its_hour(tmp_path: Path) -> None:
    day_of_year = 159  # 7 June 2012
    lines = (f"2012 {day_of_year} {hour} {300 + hour}\n" for hour in range(24) if not 20 <= hour < 23)
    (tmp_path / "omni.lst").write_text("".join(lines))
    found = speeds_around(tmp_path, BURST)
    for clock, speed in (("19:01", 319), ("19:59", 319), ("21:25", 319), ("21:35", 323), ("23:59", 323)):
        assert found.at(np.datetime64(f"2012-06-07T{clock}", "ns")) == {"WIND": speed}


def test_a_damaged_file_costs_its_spacecraft_only_and_is_named(tmp_path: Path) -> None:
    hours(tmp_path / "omni.lst", 400.0)
    (tmp_path / "sta.lst").write_text("<html>not found</html>\n")

    found = speeds_around(tmp_path, BURST)

    assert list(found.speeds) == ["WIND"]
    (said,) = found.left_out
    assert said.startswith("left out: sta.lst cannot be read")
    assert "\n" not in said


def test_speeds_of_a_spacecraft_whose_place_is_not_known_are_left_out(tmp_path: Path) -> None:
    hours(tmp_path / "omni.lst", 400.0)
    hours(tmp_path / "psp.lst", 300.0)  # six years before its launch

    found = speeds_around(tmp_path, BURST)

    assert list(found.speeds) == ["WIND"]
    assert found.left_out == (
        "left out: psp.lst, no position of PSP is known then; bella update-ephemeris may bring it",
    )


def test_checksum_is_that_of_the_hours_of_the_rotation(tmp_path: Path) -> None:
    path = tmp_path / "omni.lst"
    hours(path, 400.0)
    before = digests(speeds_around(tmp_path, BURST))
    path.write_text(path.read_text() + "2012 300 5 500\n")
    assert digests(speeds_around(tmp_path, BURST)) == before, "an hour of October says nothing of June"
    hours(tmp_path / "omni_corrected.lst", 410.0, days=45)
    corrected = speeds_around(tmp_path, BURST)
    assert digests(corrected) != before
    assert corrected.speeds["WIND"].iloc[0] == 410.0, "of two files the last one counts"


@pytest.mark.parametrize(
    ("folder", "reason"),
    [(None, "set BELLA_IN_SITU"), ("nowhere", "is not there"), ("empty", "add hourly lists"), ("old", "2012-06-07")],
)
def test_no_speeds_say_what_to_do(tmp_path: Path, folder: str | None, reason: str) -> None:
    (tmp_path / "empty").mkdir()
    hours(tmp_path / "old" / "omni.lst", 400.0, days=5)

    found = speeds_around(None if folder is None else tmp_path / folder, BURST)

    assert found.speeds == {}
    assert reason in found.reason
    assert "\n" not in found.reason


def test_yearly_file_of_omni_is_read_as_it_is_published(tmp_path: Path) -> None:
    words = [f"{number}.5" for number in range(55)]
    words[:3], words[24] = ["2012", "159", "19"], "649."
    path = tmp_path / "omni2_2012.dat"
    path.write_text("  ".join(words) + "\n" + "  ".join([*words, "0.007"][:56]).replace(" 19 ", " 20 ") + "\n")
    with pytest.raises(InputError, match="cannot be read"):
        hourly_speeds(path)
    path.write_text("  ".join(words) + "\n")
    speeds = hourly_speeds(path)
    assert (speeds.index[0], speeds.iloc[0]) == (np.datetime64("2012-06-07T19"), 649.0)


HOURS = [(2012, 366, hour, 400.5 + hour) for hour in range(12)]
WAYS = {
    "commas": "\n".join("{},{},{},{}".format(*one) for one in HOURS),
    "heading": "YEAR DOY HR  1\n" + "\n".join("{} {} {} {}".format(*one) for one in HOURS),
    "page": "<pre>YEAR;DOY;HR;V\n" + "\n".join("{};{};{};{}".format(*one) for one in HOURS) + "\n</pre>",
    "mark": "\ufeff" + "\n".join("{} {} {} {}".format(*one) for one in HOURS),
    "fill": "\n".join("{} {} {} {}".format(*one) for one in [*HOURS, (2012, 365, 1, 999.9), (2012, 365, 2, -1e31)]),
}


@pytest.mark.parametrize("text", WAYS.values(), ids=WAYS.keys())
def test_lists_are_read_as_people_save_them(tmp_path: Path, text: str) -> None:
    (tmp_path / "wind.lst").write_text(text, encoding="utf-8")
    speeds = hourly_speeds(tmp_path / "wind.lst")
    assert speeds.to_list() == [one[3] for one in HOURS]
    assert speeds.index[0] == np.datetime64("2012-12-31")


@pytest.mark.parametrize(
    ("name", "row", "reason"),
    [
        ("wind.lst", "2013 366 {} 40{}", "line 1: no such hour"),
        ("wind.lst", "2112 100 {} 40{}", "line 1: no such hour"),
        ("wind.lst", "2012 100 {} 40{}000", "no solar wind has: give km/s"),
        ("omni2_2012.dat", "2013 100 {} 40{}", "is named after 2012, but begins in 2013"),
    ],
)
def test_lists_that_cannot_be_meant_are_refused(tmp_path: Path, name: str, row: str, reason: str) -> None:
    (tmp_path / name).write_text("\n".join(row.format(hour, hour) for hour in range(9)))
    with pytest.raises(InputError, match=f"{name}.*{reason}"):
        hourly_speeds(tmp_path / name)


def test_nearest_files_of_regions_are_taken(tmp_path: Path) -> None:
    (tmp_path / "2012_SRS").mkdir()
    (tmp_path / "2012_SRS" / "20120608SRS.txt").write_text(SUMMARY)
    (tmp_path / "2012_SRS" / "20120607SRS.txt").write_text("an older one, not read\n")
    (tmp_path / "coronal-holes-20120607T1200.csv").write_text(HOLES)

    found = regions_around(tmp_path, BURST)

    assert [file.name for file in found.used] == ["20120608SRS.txt", "coronal-holes-20120607T1200.csv"]
    assert {region.kind for region in found.regions} == {"active region", "coronal hole"}
    assert (found.left_out, found.reason) == ((), "")


def test_a_damaged_summary_gives_way_to_the_next(tmp_path: Path) -> None:
    (tmp_path / "20120608SRS.txt").write_text("cut\n")
    (tmp_path / "20120607SRS.txt").write_text(SUMMARY.replace("2012 Jun 08", "2012 Jun 07"))

    found = regions_around(tmp_path, BURST)

    assert [file.name for file in found.used] == ["20120607SRS.txt"]
    assert found.left_out[0].startswith("left out: 20120608SRS.txt is not a Solar Region Summary")
    assert {region.utc for region in found.regions} == {np.datetime64("2012-06-07", "ns")}


def test_what_is_no_file_or_too_large_is_left_out_and_not_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "20120608SRS.txt")
    os.mkfifo(tmp_path / "omni.lst")
    for name in ("coronal-holes-20120607T1200.csv", "sta.lst"):
        with (tmp_path / name).open("wb") as file:
            file.truncate(10 << 30)  # a hole, which takes no place on the disk
    (tmp_path / "20120607SRS.txt").write_text(SUMMARY.replace("2012 Jun 08", "2012 Jun 07"))
    hours(tmp_path / "stb.lst", 400.0)

    regions, speeds = regions_around(tmp_path, BURST), speeds_around(tmp_path, BURST)

    assert [file.name for file in regions.used] == ["20120607SRS.txt"]
    assert list(speeds.speeds) == ["STEREO-B"]
    for (pipe, large), names in (
        (regions.left_out, ("20120608SRS.txt", "coronal-holes-20120607T1200.csv")),
        (speeds.left_out, ("omni.lst", "sta.lst")),
    ):
        assert pipe.startswith(f"left out: {names[0]} is not a file")
        assert large.startswith(f"left out: {names[1]} has 10737418240 bytes, too many")


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        (None, "set BELLA_REGIONS"),
        ("nowhere", "is not there"),
        ("empty", "20120608SRS.txt"),
        ("damaged", "left out: 20120608SRS.txt is not"),
    ],
)
def test_no_regions_say_what_to_do(tmp_path: Path, name: str | None, reason: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "20120601SRS.txt").write_text(SUMMARY)
    (tmp_path / "empty" / "99999999SRS.txt").write_text(SUMMARY)
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "20120608SRS.txt").write_text("cut\n")

    found = regions_around(None if name is None else tmp_path / name, BURST)

    assert found.regions == ()
    assert reason in found.reason

"""The footpoint of the published burst, the regions of that day, and who was connected."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bella.exceptions import InputError
from bella.heliosphere import SIDEREAL_ROTATION_D, spiral_longitude_deg
from bella.solar_wind import (
    Footpoint,
    SourceRegion,
    connection_angles,
    footpoint,
    read_active_regions,
    read_coronal_holes,
    regions_near,
)
from bella.spacecraft import position

BURST = np.datetime64("2012-06-07T19:30", "ns")
MIDNIGHT = np.datetime64("2012-06-08T00:00", "ns")
SUMMARY = """:Product: 0608SRS.txt
:Issued: 2012 Jun 08 0030 UTC
# Prepared jointly by the U.S. Dept. of Commerce, NOAA,
# Space Weather Prediction Center and the U.S. Air Force.
#
Joint USAF/NOAA Solar Region Summary
SRS Number 160 Issued at 0030Z on 08 Jun 2012
Report compiled from data received at SWO on 07 Jun
I.  Regions with Sunspots.  Locations Valid at 07/2400Z
Nmbr Location  Lo  Area  Z   LL   NN Mag Type
1493 N15W36   216  0020 Hsx  02   01 Alpha
1494 S16W18   198  0190 Cso  07   08 Beta
1497 S21W43   223  0010 Bxo  03   03 Beta
1498 N08E04   176  0100 Dso  05   09 Beta
1499 N16E07   173  0180 Dai  08   12 Beta-Gamma
IA. H-alpha Plages without Spots.  Locations Valid at 07/2400Z Jun
Nmbr  Location  Lo
1495 N12W60   240
II. Regions Due to Return 08 Jun to 10 Jun
Nmbr Lat    Lo
1486 N17    101
"""
HOLES = """# drawn by hand
hole_id,lon_min_deg,lon_max_deg,lat_min_deg,lat_max_deg,polarity,source
CH1,15,45,10,50,+,SDO/AIA
CH2,170,-160,-20,0,-,synoptic map
"""


def drawn(phi0_deg: float, sd_deg: float, utc: np.datetime64 = BURST) -> Footpoint:
    return footpoint(np.random.default_rng(1).normal(phi0_deg, sd_deg, 4000), utc)


@pytest.fixture
def regions(tmp_path: Path) -> list[SourceRegion]:
    path = tmp_path / "0608SRS.txt"
    path.write_text(SUMMARY)
    return read_active_regions(path)


def test_summary_is_read_with_its_time(regions: list[SourceRegion]) -> None:
    assert [region.name for region in regions] == ["11493", "11494", "11497", "11498", "11499", "11495"]
    assert [region.longitude_deg for region in regions] == [36, 18, 43, -4, -7, 60]
    assert [region.latitude_deg for region in regions] == [15, -16, -21, 8, 16, 12]
    assert [region.width_deg for region in regions] == [2, 7, 3, 5, 8, 2]
    assert {region.utc for region in regions} == {MIDNIGHT}
    assert regions[4].remark == "Beta-Gamma"
    assert regions[5].remark == "plage"


def test_a_day_without_spots_is_no_error(tmp_path: Path) -> None:
    lines = [line for line in SUMMARY.splitlines() if not line.startswith("149")]
    spots, plages = (next(i for i, line in enumerate(lines) if line.startswith(start)) for start in ("I.", "IA."))
    lines[plages + 2 : plages + 2] = ["None"]
    lines[spots + 2 : spots + 2] = ["None"]
    path = tmp_path / "quiet.txt"
    path.write_text("\n".join(lines) + "\n")
    assert read_active_regions(path) == []


def test_footpoint_of_the_published_burst_is_near_the_regions_of_that_day(regions: list[SourceRegion]) -> None:
    found = regions_near(drawn(30.0, 10.0, MIDNIGHT), regions)

    matching = set(found.loc[found["matches"], "name"])
    assert {"11493", "11494"} <= matching
    assert matching.isdisjoint({"11498", "11499", "11495"})
    assert found["name"][0] == "11493"
    assert found["distance_deg"][0] == pytest.approx(6.0, abs=0.8)
    # of a Gaussian between 0.5 and 0.7, and between -1.55 and -0.85 standard deviations
    probability = found.set_index("name")["probability"]
    assert probability["11493"] == pytest.approx(0.066, abs=0.012)
    assert probability["11494"] == pytest.approx(0.137, abs=0.02)
    assert probability["11499"] < 0.002


def test_regions_are_turned_to_the_time_of_the_burst(regions: list[SourceRegion]) -> None:
    # 4.5 hours at 13.2 degrees a day
    assert regions[0].at(BURST).longitude_deg == pytest.approx(36 - 2.48, abs=0.05)
    assert regions[0].at(BURST).at(MIDNIGHT).longitude_deg == pytest.approx(36.0)
    later = regions[0].at(MIDNIGHT + np.timedelta64(20, "D"))
    assert later.longitude_deg == pytest.approx(36 + 20 * 13.25 - 360, abs=2.0)


def test_high_latitudes_lag_behind() -> None:
    def moved(latitude: float) -> float:
        start = SourceRegion("1", "active region", 0.0, latitude, 2.0, 2.0, MIDNIGHT, "")
        return start.at(MIDNIGHT + np.timedelta64(5, "D")).longitude_deg

    assert moved(0.0) > moved(30.0) > moved(60.0) > 0
    assert moved(30.0) == moved(-30.0)


def test_coronal_holes_are_matched_by_their_edges(tmp_path: Path) -> None:
    path = tmp_path / "holes.csv"
    path.write_text(HOLES)
    near, far = read_coronal_holes(path, BURST)

    assert (near.longitude_deg, near.width_deg, near.remark) == (30.0, 30.0, "polarity +, SDO/AIA")
    assert (far.longitude_deg, far.width_deg) == (-175.0, 30.0)
    inside = regions_near(drawn(30.0, 5.0), [far, near])
    assert list(inside["name"]) == ["CH1", "CH2"]
    assert inside["edge_deg"][0] == 0.0
    assert inside["probability"][0] > 0.99
    across = regions_near(drawn(-170.0, 3.0), [near, far])
    assert list(across["matches"]) == [True, False]
    assert across["name"][0] == "CH2"


def test_a_hole_around_a_pole_is_at_every_longitude(tmp_path: Path) -> None:
    path = tmp_path / "holes.csv"
    path.write_text(f"{HOLES.splitlines()[1]}\nN,-180,180,60,90,+,SDO/AIA\n")
    (pole,) = read_coronal_holes(path, BURST)
    assert pole.width_deg == 360.0
    near = regions_near(drawn(25.0, 3.0), [pole])
    assert (near["probability"][0], near["edge_deg"][0]) == (1.0, 0.0)


@given(phi0=st.floats(-180.0, 180.0), sd=st.floats(0.1, 40.0))
def test_longitudes_agree_between_systems(phi0: float, sd: float) -> None:
    foot = footpoint(np.random.default_rng(2).normal(phi0, sd, 500), BURST)

    meridian = np.degrees(np.arctan2(*position("EARTH", [BURST], "carrington")[0, 1::-1]))
    turned = (foot.carrington.mean_deg - foot.stonyhurst.mean_deg - meridian + 180) % 360 - 180
    assert turned == pytest.approx(0.0, abs=1e-6)
    # the ecliptic is inclined by 7.25 degrees: longitudes differ by a quarter of a degree
    assert abs((foot.stonyhurst.mean_deg - foot.hee.mean_deg + 180) % 360 - 180) < 0.3
    assert 0 <= foot.carrington.mean_deg <= 360
    for longitudes in (foot.hee, foot.stonyhurst, foot.carrington):
        assert longitudes.low_deg <= longitudes.mean_deg <= longitudes.high_deg
        assert longitudes.high_deg - longitudes.low_deg < 360


def test_interval_of_the_footpoint_is_that_of_its_draws() -> None:
    foot = drawn(179.0, 10.0)
    assert foot.hee.high_deg - foot.hee.low_deg == pytest.approx(2 * 1.96 * 10.0, rel=0.05)
    assert foot.hee.sd_deg == pytest.approx(10.0, rel=0.03)
    assert abs((foot.hee.mean_deg - 179.0 + 180) % 360 - 180) < 0.5


def test_spacecraft_on_the_spiral_of_the_source_is_connected() -> None:
    x, y, _ = position("STEREO-A", [BURST], "hee")[0]
    phi0 = np.degrees(np.arctan2(y, x)) - spiral_longitude_deg(np.array([np.hypot(x, y)]), 0.0, 400.0)
    angles = connection_angles(footpoint(phi0, BURST), {"STEREO-A": 400.0, "WIND": 400.0})

    assert angles["connection_angle_deg"][0] == pytest.approx(0.0, abs=0.5)
    assert angles["connection_angle_deg"][1] == pytest.approx(-116.9, abs=4.0)


def test_who_was_connected_to_the_published_burst() -> None:
    angles = connection_angles(drawn(30.0, 10.0), {"WIND": 649.0, "STEREO-A": 352.0, "STEREO-B": 342.0})

    omega_deg_s = 360.0 / (SIDEREAL_ROTATION_D * 86_400)
    assert angles["mapped_deg"][0] == pytest.approx(omega_deg_s * 215.07 * 695_700 / 649.0, abs=0.1)
    assert list(angles["connection_angle_deg"].abs().sort_values().index) == [0, 2, 1]
    assert angles["connection_angle_deg"][0] == pytest.approx(8.0, abs=1.0)
    assert angles["connection_angle_sd_deg"][0] == pytest.approx(10.0, rel=0.03)


@pytest.mark.parametrize(
    "text", ["", "no summary\n", SUMMARY.replace(":Issued", ":Sent"), SUMMARY[: SUMMARY.index("IA.")]]
)
def test_what_is_no_summary_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "summary.txt"
    path.write_text(text)
    with pytest.raises(InputError, match="is not a Solar Region Summary") as caught:
        read_active_regions(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "is not a CSV table"),
        ("hole_id;lon_min_deg\n1;2\n", "column lon_max_deg is missing"),
        ("hole_id,lon_min_deg\n1,2\n", "column lon_max_deg is missing"),
        (HOLES.replace("CH1,15", "CH1,x"), "row 1 has no possible extent"),
        (HOLES.replace("-20,0", "0,-20"), "row 2 has no possible extent"),
        (HOLES.replace("CH1,15", "CH1,400"), "row 1 has no possible extent"),
    ],
)
def test_bad_table_of_holes_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "holes.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=reason):
        read_coronal_holes(path, BURST)


@pytest.mark.parametrize("draws", [np.array([]), np.array([1.0, np.nan]), np.zeros((2, 2))])
def test_footpoint_without_draws_is_refused(draws: np.ndarray) -> None:
    with pytest.raises(InputError, match="finite draws"):
        footpoint(draws, BURST)


@pytest.mark.parametrize("speed", [0.0, -400.0, np.nan])
def test_no_connection_without_a_speed(speed: float) -> None:
    with pytest.raises(InputError, match="leave that spacecraft out"):
        connection_angles(drawn(30.0, 1.0), {"WIND": speed})


def test_no_region_is_an_empty_table() -> None:
    assert regions_near(drawn(30.0, 10.0), []).empty


def test_a_digit_that_is_no_number_is_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "20120608SRS.txt"
    path.write_bytes(SUMMARY.replace("Hsx  02", "Hsx  0²").encode("latin-1"))
    assert [one.width_deg for one in read_active_regions(path)][:2] == [2.0, 7.0]


def test_real_summaries_of_twenty_years_are_read(reference_files: Path) -> None:
    folder = reference_files.parent / "cases" / "real" / "srs"
    if not folder.is_dir():
        pytest.skip("no real summaries")
    found = {path.name[:8]: read_active_regions(path) for path in sorted(folder.glob("*SRS.txt"))}
    assert [len(regions) for regions in found.values()] == [4, 1, 4, 7, 9, 10, 11, 10, 2, 8, 3, 5]
    first = found["19960106"][0]
    assert (first.name, first.longitude_deg, first.latitude_deg, first.width_deg) == ("7938", 41.0, 12.0, 9.0)
    # the numbers pass 10 000, and the summaries write 0001 for 10001
    assert [one.name for one in found["20020624"]][:3] == ["10001", "10005", "10008"]
    assert "9997" in {one.name for one in found["20020624"]}
    for name, regions in found.items():
        issued = np.datetime64(f"{name[:4]}-{name[4:6]}-{name[6:]}")
        assert {one.utc for one in regions} == {issued}
        assert all(abs(one.latitude_deg) < 45 and abs(one.longitude_deg) < 95 for one in regions)

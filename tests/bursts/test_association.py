"""Which spacecraft received the same burst, and what may be placed."""

from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pandas.testing import assert_frame_equal

from bella.bursts.association import (
    AssociatedBurst,
    _named,
    _window_s,
    associate,
    association_table,
    has_position,
)
from bella.bursts.detection import DETECTION_COLUMNS, Searched, search
from bella.bursts.matched_filter import THRESHOLDS
from bella.flags import CATALOGUED, LOCALISABLE
from bella.simulation.archive_days import sky_of
from bella.simulation.nuisances import JovianArc
from bella.simulation.sky import Sky
from bella.spacecraft import position_hee
from bella.spectra import combine_receivers
from benchmarks import association as benchmark
from benchmarks.detection import FLEET, spectrum_of
from tests.bursts.recorded import DAY, IN_LINE, burst_at, recorded, sky
from tests.spectra import real_day, real_day_2020

STORM_DAY_SEED = 3


def searched(what: Sky, names: tuple[str, ...] = ("WIND", "STEREO-A", "SOLO")) -> list[Searched]:
    return [search(recorded(name, what)) for name in names]


@pytest.fixture(scope="module")
def fleet() -> list[Searched]:
    """A day with two bursts far apart in time."""
    return searched(sky([burst_at(5.0), burst_at(14.0, contrast=60.0)]))


def table_of(found: list[Searched]) -> pd.DataFrame:
    return association_table(associate(found), found)


def test_two_bursts_at_three_spacecraft_are_two_localisable_bursts(fleet: list[Searched]) -> None:
    bursts = associate(fleet)

    assert [burst.tier for burst in bursts] == [LOCALISABLE] * 2
    assert [set(burst.observatories) for burst in bursts] == [{"WIND", "STEREO-A", "SOLO"}] * 2
    assert len({burst.burst_id for burst in bursts}) == 2
    assert bursts[0].start_utc < bursts[1].start_utc


def test_table_has_every_member_with_the_name_of_its_burst(fleet: list[Searched]) -> None:
    table = table_of(fleet)
    members = table[table["tier"] != "rejected"]

    assert dict(table.dtypes.astype(str)) == DETECTION_COLUMNS
    assert table["start_utc"].is_monotonic_increasing
    assert members.groupby("burst_id")["observatory"].nunique().tolist() == [3, 3]
    for burst_id, rows in members.groupby("burst_id"):
        assert str(burst_id) == f"T3-{rows['start_utc'].min():%Y%m%d-%H%M}"


def test_order_of_spacecraft_does_not_matter(fleet: list[Searched]) -> None:
    assert_frame_equal(table_of(fleet[::-1]), table_of(fleet))


def test_two_spacecraft_place_nothing(fleet: list[Searched]) -> None:
    bursts = associate(fleet[:2])

    assert {burst.tier for burst in bursts} == {CATALOGUED}
    assert {burst.reason for burst in bursts} == {"not localisable: received by 2 of 3 spacecraft"}


def test_no_spacecraft_no_burst() -> None:
    assert associate([]) == []
    assert table_of([]).empty


def test_spacecraft_on_a_line_place_nothing() -> None:
    (burst,) = associate(searched(sky([burst_at(5.0, IN_LINE)])))

    assert len(burst.observatories) == 3
    assert burst.reason == "not localisable: spacecraft on a line"


def test_bursts_minutes_apart_are_not_placed() -> None:
    bursts = associate(searched(sky([burst_at(5.0), burst_at(5.15, contrast=60.0)])))

    assert bursts
    assert all(burst.tier == CATALOGUED for burst in bursts)
    assert any("group" in burst.reason for burst in bursts)


def test_a_day_of_nothing_but_storm_places_nothing() -> None:
    drawn = next(one for seed in range(20) if (one := sky_of(DAY, seed)).storm)
    bursts = associate(searched(sky(storm=drawn.storm)))

    assert [burst.burst_id for burst in bursts if burst.tier == LOCALISABLE] == []


def test_an_arc_that_all_spacecraft_hear_is_not_placed() -> None:
    arcs = tuple(JovianArc(40_000.0 + 900 * n, (1.5, 12.0), 150.0 * (n - 2), 60.0, 8.0) for n in range(5))
    bursts = associate(searched(sky(nuisances=arcs)))

    assert [burst for burst in bursts if burst.tier == LOCALISABLE] == []


def test_a_burst_heard_late_and_low_is_looked_for_where_another_spacecraft_heard_it() -> None:
    what = sky([burst_at(5.0, phi0_deg=0.0, directivity=0.35, contrast=300.0)])
    found = searched(what, tuple(FLEET))
    received = [set(burst.observatories) for burst in associate(found)]

    assert len(received) == 1
    alone = {one.observatory for one in found if any(not candidate.reason for candidate in one.found)}
    assert alone <= received[0]


def assert_each_detection_once(found: list[Searched], bursts: list[AssociatedBurst]) -> None:
    """Every accepted detection is in exactly one burst, and no maximum is a member twice or a member and refused."""
    members = [(member.searched.observatory, member.candidate.record) for burst in bursts for member in burst.members]
    accepted = {(one.observatory, each.record) for one in found for each in one.found if not each.reason}
    assert len(set(members)) == len(members)
    assert accepted <= set(members)
    table = association_table(bursts, found)
    assert not table.duplicated(["observatory", "start_utc", "f_low_mhz", "f_high_mhz"]).any()


@pytest.fixture(scope="module")
def crowded() -> tuple[list[Searched], list[Sky]]:
    """A simulated day with many bursts, a storm and nuisances, at four spacecraft."""
    day = date(2021, 2, 10)
    skies = [sky_of(day, STORM_DAY_SEED)]
    return [search(spectrum_of(name, day, skies, STORM_DAY_SEED)) for name in FLEET], skies


def test_each_detection_of_a_crowded_day_is_in_one_burst(crowded: tuple[list[Searched], list[Sky]]) -> None:
    found, _ = crowded
    assert_each_detection_once(found, associate(found))


def test_what_is_localisable_on_a_crowded_day_is_one_burst(crowded: tuple[list[Searched], list[Sky]]) -> None:
    found, skies = crowded
    tally = benchmark.Tally()
    benchmark.add_day(tally, skies[0], associate(found))

    assert tally.right == tally.groups
    assert tally.pure == tally.members


@pytest.fixture(scope="module")
def days_2010(reference_files: Path) -> list[Searched]:
    wind = combine_receivers(real_day.wind(reference_files, "RAD1"), real_day.wind(reference_files, "RAD2"))
    sides = [real_day.stereo(reference_files, side) for side in ("ahead", "behind")]
    return [search(one) for one in (wind, *sides)]


def test_the_group_of_2010_01_17_is_not_placed(days_2010: list[Searched]) -> None:
    table = table_of(days_2010)
    early = table[table["start_utc"].between("2010-01-17T03:55", "2010-01-17T04:06") & (table["tier"] == CATALOGUED)]

    assert set(early["observatory"]) == {"WIND", "STEREO-A", "STEREO-B"}
    assert set(early["reason"]) == {"not localisable: group"}
    assert LOCALISABLE not in set(table["tier"])


def test_the_burst_at_11_46_is_received_by_two(days_2010: list[Searched]) -> None:
    (burst,) = [one for one in associate(days_2010) if one.burst_id == "T3-20100117-1146"]

    assert burst.observatories == ("STEREO-A", "WIND")
    assert burst.reason == "not localisable: received by 2 of 3 spacecraft"


def test_no_maximum_of_2010_01_17_stands_twice(days_2010: list[Searched]) -> None:
    assert_each_detection_once(days_2010, associate(days_2010))


@pytest.fixture(scope="module")
def days_2020(reference_files: Path) -> list[Searched]:
    opened = (real_day_2020.wind, real_day_2020.stereo_a, real_day_2020.psp)
    return [search(one(reference_files)) for one in opened]


def test_of_2020_07_21_the_single_burst_is_placed_and_groups_are_not(days_2020: list[Searched]) -> None:
    tiers = {burst.burst_id: burst.tier for burst in associate(days_2020)}

    assert tiers["T3-20200721-0253"] == LOCALISABLE
    assert [burst_id for burst_id, tier in tiers.items() if tier == LOCALISABLE] == ["T3-20200721-0253"]


@pytest.mark.parametrize("start", ["02:53", "06:23", "07:03", "07:20"])
def test_bursts_of_2020_07_21_are_received_by_all_three(days_2020: list[Searched], start: str) -> None:
    bursts = {burst.burst_id: burst for burst in associate(days_2020)}

    assert set(bursts[f"T3-20200721-{start.replace(':', '')}"].observatories) == {"WIND", "STEREO-A", "PSP"}


@pytest.mark.parametrize("name", ["WIND", "STEREO", "PSP"])
def test_the_labelled_burst_of_2020_07_21_is_found(reference_files: Path, days_2020: list[Searched], name: str) -> None:
    labels = pd.read_csv(reference_files / f"labels/{name}_burst_intervals.csv").set_index("date").loc["21/07/2020"]
    (burst,) = [one for one in associate(days_2020) if one.burst_id == "T3-20200721-0623"]
    starts = {member.searched.observatory: member for member in burst.members}
    member = starts[{"STEREO": "STEREO-A"}.get(name, name)]
    begins = pd.Timestamp(member.searched.grid.start) + pd.Timedelta(minutes=member.candidate.record)

    assert pd.Timestamp(labels["B1i"]) <= begins <= pd.Timestamp(labels["B1f"])


def test_no_maximum_of_2020_07_21_stands_twice(days_2020: list[Searched]) -> None:
    assert_each_detection_once(days_2020, associate(days_2020))


def named(searched: Searched, observatory: str) -> Searched:
    """The same search under the name of another spacecraft."""
    return searched._replace(over=searched.over.assign_attrs(observatory=observatory))


def test_an_unknown_spacecraft_is_not_compared_but_stands_in_the_table(fleet: list[Searched]) -> None:
    stranger = named(fleet[0], "STRANGER")
    everyone = [*fleet, stranger]
    known = [one for one in everyone if has_position(one)]
    table = association_table(associate(everyone), everyone)
    rows = table[table["observatory"] == "STRANGER"]

    assert known == fleet
    assert len(rows) == 2
    assert set(rows["tier"]) == {CATALOGUED}
    assert set(rows["burst_id"]) == {""}
    assert_frame_equal(table[table["observatory"] != "STRANGER"].reset_index(drop=True), table_of(fleet))


def test_spacecraft_before_their_launch_have_no_position(fleet: list[Searched]) -> None:
    early = fleet[0].grid._replace(start=np.datetime64("2010-01-17", "ns"))

    assert not has_position(named(fleet[0], "PSP")._replace(grid=early))
    assert has_position(named(fleet[0], "STEREO-B")._replace(grid=early))


def test_members_heard_within_light_travel(fleet: list[Searched]) -> None:
    across_s = 2 * 215.0 * 2.32 + 60.0 * THRESHOLDS.apart_minutes  # 2 au
    for burst in associate(fleet):
        records = np.array([member.candidate.record for member in burst.members])
        assert np.ptp(records) * 60.0 <= across_s


def test_bursts_of_one_minute_have_names_of_their_own(fleet: list[Searched]) -> None:
    (first, *_) = associate(fleet)
    single = replace(first, tier=CATALOGUED)
    twice = _named([single, replace(first, tier=LOCALISABLE), single])

    assert [one.burst_id.removeprefix(first.burst_id) for one in twice] == ["", "b", "c"]
    assert twice[0].tier == LOCALISABLE, "the one that can be placed keeps the plain name"


def test_onsets_may_be_apart_by_light_travel_and_a_minute(fleet: list[Searched]) -> None:
    utc = np.datetime64("2012-06-07T19:00", "ns")
    then = fleet[0]._replace(grid=fleet[0].grid._replace(start=utc))
    where = [position_hee(name, np.array([utc]), utc)[0] for name in ("WIND", "STEREO-A")]
    light_s = np.linalg.norm(where[0] - where[1]) * 695_700.0 / 299_792.458
    assert _window_s(named(then, "WIND"), named(then, "STEREO-A")) == pytest.approx(light_s + 60.0, abs=0.1)

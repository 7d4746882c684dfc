"""Searched days, the newest first, and how much was received on each: on SQLite and PostgreSQL alike."""

from dataclasses import replace
from datetime import date, timedelta
from random import Random

import pytest

from bella.catalogue import Catalogue, DaySummary, Detection
from bella.exceptions import InputError
from tests.catalogue.test_detections import DAY, START, received

REFUSED = {"tier": "rejected", "reason": "no_drift", "burst_id": ""}
ALONE = {"tier": "catalogued", "reason": "not localisable: received by 1 of 3 spacecraft"}


def record(catalogue: Catalogue, offset: int, found: list[Detection]) -> date:
    """Record a day so many days from `DAY`, with detections given as of that one."""
    apart = timedelta(days=offset)
    moved = [replace(one, start_utc=one.start_utc + apart) for one in found]
    catalogue.record_day(replace(DAY, day=DAY.day + apart), moved)
    return DAY.day + apart


def test_a_day_counts_detections_bursts_and_what_was_placed(catalogue: Catalogue) -> None:
    shared = [received(3), received(3, "STEREO-A"), received(3, "SOLO")]
    pair = [received(7, **ALONE), received(7, "STEREO-A", **ALONE)]
    twice = [received(9, **ALONE), received(9, **ALONE)]
    elsewhere = received(10, "JUICE", tier="catalogued", reason="", burst_id="")
    record(catalogue, 0, [*shared, *pair, *twice, elsewhere, received(11, **REFUSED), received(12, "SOLO", **REFUSED)])

    (one,) = catalogue.days().days

    assert one == DaySummary(DAY, detections=8, rejected=2, bursts=3, shared=2, localised=1)


def test_days_come_newest_first_and_a_quiet_one_is_there(catalogue: Catalogue) -> None:
    record(catalogue, -40, [received(3), received(5)])
    record(catalogue, 0, [])
    record(catalogue, 1, [received(4, **REFUSED)])

    page = catalogue.days()

    assert [f"{one.searched.day}" for one in page.days] == ["2020-07-22", "2020-07-21", "2020-06-11"]
    assert [(one.detections, one.rejected, one.bursts) for one in page.days] == [(0, 1, 0), (0, 0, 0), (2, 0, 2)]
    assert (page.next_last, page.total) == (None, 3)


def test_pages_follow_one_another_without_gap_or_double(catalogue: Catalogue) -> None:
    offsets = sorted(Random(1).sample(range(400), 25), reverse=True)
    known = [record(catalogue, offset, [received(hour) for hour in range(offset % 4)]) for offset in offsets]

    seen: list[DaySummary] = []
    last = None
    while True:
        page = catalogue.days(last=last, limit=7)
        seen += page.days
        assert page.total == len(known) - len(seen) + len(page.days)
        if (last := page.next_last) is None:
            break

    assert [one.searched.day for one in seen] == known
    assert [one.bursts for one in seen] == [offset % 4 for offset in offsets]


def test_both_ends_of_a_range_belong_to_it(catalogue: Catalogue) -> None:
    for offset in range(-3, 3):
        record(catalogue, offset, [received(3)])

    page = catalogue.days(DAY.day - timedelta(days=1), DAY.day, 10)

    assert [one.searched.day.day for one in page.days] == [21, 20]
    assert [one.bursts for one in page.days] == [1, 1]
    assert page.total == 2
    assert catalogue.days(DAY.day + timedelta(days=9)).days == ()


@pytest.mark.parametrize("limit", [0, 367])
def test_a_limit_out_of_range_is_refused(catalogue: Catalogue, limit: int) -> None:
    with pytest.raises(InputError, match=f"limit is {limit}"):
        catalogue.days(limit=limit)


def test_what_is_heard_past_midnight_stays_with_its_burst(catalogue: Catalogue) -> None:
    late = [received(0, start_utc=START + timedelta(hours=23, minutes=58), burst_id="T3-20200721-2358")]
    late.append(replace(late[0], observatory="SOLO", start_utc=START + timedelta(days=1, minutes=3)))
    early = received(0, observatory="PSP", start_utc=START - timedelta(minutes=4))
    record(catalogue, 0, [*late, early])
    catalogue.record_day(replace(DAY, day=date(2020, 7, 22)), [received(30)])

    assert [one.observatory for one in catalogue.detections_of(DAY.day)] == ["PSP", "WIND", "SOLO"]
    assert [(one.bursts, one.shared) for one in catalogue.days().days] == [(1, 0), (2, 1)]
    assert catalogue.detections_of(date(2020, 7, 23)) == ()


def test_the_searched_days_beside_a_day(catalogue: Catalogue) -> None:
    before, after = record(catalogue, -9, []), record(catalogue, 30, [])

    assert catalogue.days_beside(DAY.day) == (before, after)
    assert catalogue.days_beside(before) == (None, after)
    assert catalogue.days_beside(after) == (before, None)

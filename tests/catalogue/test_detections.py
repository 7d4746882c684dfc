"""Searched days and what was received on them: replaced whole, told apart from days that were not searched."""

from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from typing import Any

import pytest

from bella.catalogue import Catalogue, Detection, DetectionQuery, SearchedDay
from bella.exceptions import InputError
from bella.records import DayAnswer

DAY = SearchedDay(date(2020, 7, 21), "a" * 64, "0.2.0", ("WIND", "STEREO-A"))
START = datetime(2020, 7, 21, tzinfo=UTC)
STOP = START + timedelta(days=1)


def found(catalogue: Catalogue, *asked: Any, **more: Any) -> tuple[Detection, ...]:
    """Detections of a question."""
    return catalogue.detections(DetectionQuery(*asked, **more)).detections


def received(hour: int, observatory: str = "WIND", **changed: object) -> Detection:
    """A detection of an hour."""
    onset = START + timedelta(hours=hour)
    one = Detection(
        observatory=observatory,
        start_utc=onset,
        peak_utc=onset + timedelta(minutes=4),
        end_utc=onset + timedelta(minutes=30),
        f_low_mhz=0.15,
        f_high_mhz=6.1,
        score=71.5,
        drift=0.2,
        peak_db=19.0,
        channels=31,
        isolated=True,
        tier="localisable",
        reason="",
        burst_id=f"T3-20200721-{hour:02d}00",
    )
    return replace(one, **changed)  # type: ignore[arg-type]


def test_a_day_comes_back_as_it_was_recorded(catalogue: Catalogue) -> None:
    given = [received(7, tier="catalogued", reason="not localisable: group", isolated=False), received(3)]
    catalogue.record_day(DAY, given)

    assert catalogue.searched_day(DAY.day) == DAY
    assert found(catalogue, START, STOP) == tuple(sorted(given, key=lambda one: one.start_utc))
    assert catalogue.searched_day(date(2020, 7, 22)) is None


def test_a_day_is_replaced_whole_and_others_stay(catalogue: Catalogue) -> None:
    other = replace(DAY, day=date(2020, 7, 20))
    catalogue.record_day(other, [replace(received(3), start_utc=START - timedelta(hours=2))])
    catalogue.record_day(DAY, [received(3), received(7)])

    again = replace(DAY, inputs_hash="b" * 64, observatories=())
    catalogue.record_day(again, [])

    assert catalogue.searched_day(DAY.day) == again
    assert found(catalogue, START, STOP) == ()
    assert len(found(catalogue, START - timedelta(days=1), STOP)) == 1


def test_a_commit_that_fails_leaves_the_day_as_it_was(catalogue: Catalogue) -> None:
    catalogue.record_day(DAY, [received(3)])

    with pytest.raises(Exception, match=r"(?i)null"):
        catalogue.record_day(replace(DAY, inputs_hash="b" * 64), [received(7), received(8, tier=None)])

    assert catalogue.searched_day(DAY.day) == DAY
    assert found(catalogue, START, STOP) == (received(3),)


def test_the_range_is_half_open_and_may_be_of_one_spacecraft(catalogue: Catalogue) -> None:
    catalogue.record_day(DAY, [received(0), received(3, "STEREO-A"), received(5)])

    assert [one.start_utc.hour for one in found(catalogue, START, START + timedelta(hours=5))] == [0, 3]
    assert [one.observatory for one in found(catalogue, START, STOP, "STEREO-A")] == ["STEREO-A"]
    assert len(found(catalogue, START, STOP, limit=2)) == 2
    with pytest.raises(InputError, match="limit is 0"):
        catalogue.detections(DetectionQuery(START, STOP, limit=0))


@pytest.mark.parametrize("answer", [DayAnswer.NO_DATA, DayAnswer.ARCHIVE_SILENT])
def test_an_outage_takes_no_answer_away(catalogue: Catalogue, answer: DayAnswer) -> None:
    silent = SearchedDay(DAY.day, "nothing", "2", (), answer, "why")
    searched = SearchedDay(DAY.day, "hash", "1", ("WIND",), DayAnswer.LOCALISED, "")
    catalogue.record_unsearched(SearchedDay(DAY.day, "nothing", "1", (), DayAnswer.NO_DATA))
    catalogue.record_unsearched(silent)
    assert catalogue.searched_day(DAY.day) == silent
    catalogue.record_day(searched, ())
    catalogue.record_unsearched(silent)
    assert catalogue.searched_day(DAY.day) == searched


def test_pages_of_detections_make_the_whole_in_both_orders(catalogue: Catalogue) -> None:
    catalogue.record_day(
        DAY, [received(3), received(3, "STEREO-A"), received(3), received(7, tier="rejected"), received(1)]
    )
    whole = found(catalogue)
    for sort, expected in (("start", whole), ("-start", whole[::-1])):
        seen: list[Detection] = []
        cursor: str | None = None
        while True:
            page = catalogue.detections(DetectionQuery(sort=sort, cursor=cursor, limit=2))  # type: ignore[arg-type]
            seen += page.detections
            assert page.total == 5
            cursor = page.next_cursor
            if cursor is None:
                break
        assert tuple(seen) == expected
    assert len(found(catalogue, tier="rejected")) == 1
    assert len(found(catalogue, burst_id=received(3).burst_id)) == 3
    cursor = catalogue.detections(DetectionQuery(limit=1)).next_cursor
    with pytest.raises(InputError, match="cursor: was given with other filters"):
        catalogue.detections(DetectionQuery(limit=1, cursor=cursor, tier="rejected"))

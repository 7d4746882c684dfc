"""Searched days and what was heard on them: replaced whole, told apart from days that were not searched."""

from dataclasses import replace
from datetime import UTC, date, datetime, timedelta

import pytest

from bella.catalogue import Catalogue, Detection, SearchedDay
from bella.exceptions import InputError
from bella.records import DayAnswer

DAY = SearchedDay(date(2020, 7, 21), "a" * 64, "0.2.0", ("WIND", "STEREO-A"))
START = datetime(2020, 7, 21, tzinfo=UTC)
STOP = START + timedelta(days=1)


def heard(hour: int, observatory: str = "WIND", **changed: object) -> Detection:
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
    found = [heard(7, tier="catalogued", reason="not localisable: group", isolated=False), heard(3)]
    catalogue.record_day(DAY, found)

    assert catalogue.searched_day(DAY.day) == DAY
    assert catalogue.detections(START, STOP) == tuple(sorted(found, key=lambda one: one.start_utc))
    assert catalogue.searched_day(date(2020, 7, 22)) is None


def test_a_day_is_replaced_whole_and_others_stay(catalogue: Catalogue) -> None:
    other = replace(DAY, day=date(2020, 7, 20))
    catalogue.record_day(other, [replace(heard(3), start_utc=START - timedelta(hours=2))])
    catalogue.record_day(DAY, [heard(3), heard(7)])

    again = replace(DAY, inputs_hash="b" * 64, observatories=())
    catalogue.record_day(again, [])

    assert catalogue.searched_day(DAY.day) == again
    assert catalogue.detections(START, STOP) == ()
    assert len(catalogue.detections(START - timedelta(days=1), STOP)) == 1


def test_a_commit_that_fails_leaves_the_day_as_it_was(catalogue: Catalogue) -> None:
    catalogue.record_day(DAY, [heard(3)])

    with pytest.raises(Exception, match=r"(?i)null"):
        catalogue.record_day(replace(DAY, inputs_hash="b" * 64), [heard(7), heard(8, tier=None)])

    assert catalogue.searched_day(DAY.day) == DAY
    assert catalogue.detections(START, STOP) == (heard(3),)


def test_the_range_is_half_open_and_may_be_of_one_spacecraft(catalogue: Catalogue) -> None:
    catalogue.record_day(DAY, [heard(0), heard(3, "STEREO-A"), heard(5)])

    assert [one.start_utc.hour for one in catalogue.detections(START, START + timedelta(hours=5))] == [0, 3]
    assert [one.observatory for one in catalogue.detections(START, STOP, "STEREO-A")] == ["STEREO-A"]
    assert len(catalogue.detections(START, STOP, None, 2)) == 2
    with pytest.raises(InputError, match="limit is 0"):
        catalogue.detections(START, STOP, None, 0)


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

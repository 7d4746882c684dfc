"""The page about the search says what the counted days add up to, and the days are those that are simulated."""

from datetime import date
from pathlib import Path

import pytest

from benchmarks.detection import FLEET
from benchmarks.detection_report import (
    DAYS,
    SEED,
    association_lines,
    counts_of,
    detection_lines,
    mirrored_a_day,
    read,
    total,
    totals,
)

DOCS = Path(__file__).parents[1] / "docs"
PAGE = (DOCS / "detection.md").read_text(encoding="utf-8")
SPACECRAFT, FLEET_DAYS = read(DOCS / "detection.csv"), read(DOCS / "association.csv")
RECOMPUTED = (3, pytest.param(44, marks=pytest.mark.acceptance))


def test_every_day_of_every_spacecraft_is_counted() -> None:
    days = {row["day"] for row in FLEET_DAYS}

    assert len(days) == len(FLEET_DAYS) == DAYS
    assert {(row["day"], row["observatory"]) for row in SPACECRAFT} == {(day, name) for day in days for name in FLEET}


def test_tables_on_the_page_are_the_sums_of_the_days() -> None:
    for line in (*detection_lines(SPACECRAFT), *association_lines(FLEET_DAYS)):
        assert line in PAGE


def test_page_tells_storms_from_other_days() -> None:
    calm, stormy = mirrored_a_day(SPACECRAFT, FLEET_DAYS)

    assert f"{calm:.2f} on days without a storm and {stormy:.1f} on days with one" in PAGE
    assert calm <= 0.1


@pytest.mark.parametrize("number", RECOMPUTED)
def test_days_can_be_counted_again(number: int) -> None:
    fleet = FLEET_DAYS[number]
    rows, row = counts_of(date.fromisoformat(fleet["day"]), SEED)

    assert row == fleet
    assert rows == [one for one in SPACECRAFT if one["day"] == fleet["day"]]


def test_what_was_asked_of_the_search_is_reached() -> None:
    score = totals(SPACECRAFT)["all"]
    recall, precision = score.found / (score.found + score.missed), score.found / (score.found + score.false)

    assert score.isolated_found / (score.isolated_found + score.isolated_missed) >= 0.95
    assert score.false / score.days <= 0.5
    assert 2 * recall * precision / (recall + precision) >= 0.80


def test_what_was_asked_of_the_comparison_is_reached() -> None:
    tally = total(FLEET_DAYS)

    assert tally.right / tally.groups >= 0.98
    assert tally.pure / tally.members >= 0.97
    assert tally.placed / tally.could >= 0.8

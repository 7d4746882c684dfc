"""Cursors: they hold what they were made of, and nothing but ours, of the same question, is taken."""

import base64
import json
from datetime import UTC, date, datetime

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import column

from bella.catalogue import BurstQuery
from bella.catalogue.paging import Key, cursor_after, mark_of, parse_cursor
from bella.exceptions import InputError

ORDER = (
    Key("start", column("start"), datetime),
    Key("day", column("day"), date, nullable=True),
    Key("number", column("number"), float, descending=True, nullable=True),
    Key("count", column("count"), int),
    Key("name", column("name"), str),
)
MARK = mark_of(BurstQuery())


@settings(derandomize=True)
@given(
    start=st.datetimes(timezones=st.just(UTC)),
    day=st.none() | st.dates(),
    number=st.none() | st.floats(allow_nan=False, allow_infinity=False),
    count=st.integers(-(2**63) + 1, 2**63 - 1),
    name=st.from_regex(r"T3-[A-Za-z0-9_-]{0,20}", fullmatch=True),
)
def test_a_cursor_holds_what_it_was_made_of(
    start: datetime, day: date | None, number: float | None, count: int, name: str
) -> None:
    row = {"start": start, "day": day, "number": number, "count": count, "name": name, "more": 1}
    cursor = cursor_after(ORDER, row, MARK)
    assert parse_cursor(ORDER, cursor, MARK) == [start, day, number, count, name]
    assert all(letter.isalnum() or letter in "-_" for letter in cursor)


def encoded(*value: object) -> str:
    return base64.urlsafe_b64encode(json.dumps(value).encode()).decode()


GOOD = ["2012-06-07T19:29:00+00:00", "2012-06-07", 1.0, 1, "A"]


@pytest.mark.parametrize(
    "cursor",
    [
        "",
        "x",
        "é",
        "not a cursor",
        "=" * 8,
        encoded(),
        encoded(MARK),
        encoded(MARK, *GOOD[:4]),
        encoded(MARK, *GOOD, "more"),
        *(
            encoded(MARK, *GOOD[:at], bad, *GOOD[at + 1 :])
            for at, bad in enumerate(["yesterday", 5, "x", None, "\ud800"])
        ),
        encoded(MARK, 5, *GOOD[1:]),
        encoded(MARK, None, *GOOD[1:]),
        encoded(MARK, "0001-01-01T00:00:00+23:00", *GOOD[1:]),
        encoded(MARK, *GOOD[:2], float("nan"), *GOOD[3:]),
        encoded(MARK, *GOOD[:3], 2**63, "A"),
        base64.urlsafe_b64encode(b'{"a": 1}').decode(),
    ],
)
def test_a_bad_cursor_is_bad_input(cursor: str) -> None:
    with pytest.raises(InputError, match=r"cursor: (is not one of ours|was given with other filters)"):
        parse_cursor(ORDER, cursor, MARK)


@given(cursor=st.text(max_size=40) | st.binary(max_size=40).map(lambda one: base64.urlsafe_b64encode(one).decode()))
@settings(derandomize=True, max_examples=300)
def test_any_text_is_bad_input(cursor: str) -> None:
    with pytest.raises(InputError, match="cursor"):
        parse_cursor(ORDER, cursor, MARK)


def test_a_cursor_of_another_question_is_refused() -> None:
    assert mark_of(BurstQuery(limit=3, cursor="x")) == MARK
    others = [
        BurstQuery(sort="-start"),
        BurstQuery(wind_min=300.0),
        BurstQuery(start=datetime(2012, 6, 7, tzinfo=UTC)),
        BurstQuery(flags=frozenset({"a"})),
        BurstQuery(flags_absent=frozenset({"a"})),
    ]
    marks = {MARK, *map(mark_of, others), mark_of(None, "days")}
    assert len(marks) == len(others) + 2
    with pytest.raises(InputError, match="other filters or another sort"):
        parse_cursor(ORDER, encoded(mark_of(others[0]), *GOOD), MARK)


def test_the_mark_of_a_question_does_not_depend_on_the_order_of_names() -> None:
    names = [f"flag_{number}" for number in range(20)]
    assert mark_of(BurstQuery(flags=frozenset(names))) == mark_of(BurstQuery(flags=frozenset(reversed(names))))

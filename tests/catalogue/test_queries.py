import base64
import json
import uuid
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from itertools import count

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import event

from bella.catalogue import BurstQuery, Catalogue, Series
from bella.catalogue.queries import cursor_after, parse_cursor
from bella.exceptions import InputError
from tests.catalogue.examples import START, burst, fitted, publication

windows = count()


def ids(catalogue: Catalogue, query: BurstQuery) -> list[str]:
    page = catalogue.bursts(query)
    assert page.total == len(page.bursts)
    return [one.burst.burst_id for one in page.bursts]


@pytest.fixture
def three(catalogue: Catalogue) -> Catalogue:
    """Bursts A, B, C, an hour apart; only B was heard by all, and the flags of A and C differ."""
    heard = {"A": ("WIND", "STEREO-A"), "B": ("WIND", "STEREO-A", "STEREO-B"), "C": ("STEREO-B", "WIND")}
    flags = {"A": ("two_modes",), "B": (), "C": ("two_modes", "outside_prior")}
    for hours, name in enumerate(heard):
        own = burst(name, START + timedelta(hours=hours), observatories=heard[name])
        catalogue.publish(publication(of=own, flags=flags[name]))
    return catalogue


def test_the_interval_is_half_open(three: Catalogue) -> None:
    hour = timedelta(hours=1)
    assert ids(three, BurstQuery()) == ["A", "B", "C"]
    assert ids(three, BurstQuery(start=START, stop=START + 2 * hour)) == ["A", "B"]
    assert ids(three, BurstQuery(start=START + timedelta(microseconds=1))) == ["B", "C"]
    assert ids(three, BurstQuery(stop=START)) == []
    assert ids(three, BurstQuery(start=START.replace(tzinfo=None) + hour, stop=START + hour)) == []


def test_all_observatories_must_have_heard_it(three: Catalogue) -> None:
    assert ids(three, BurstQuery(observatories=frozenset({"WIND"}))) == ["A", "B", "C"]
    assert ids(three, BurstQuery(observatories=frozenset({"WIND", "STEREO-A"}))) == ["A", "B"]
    assert ids(three, BurstQuery(observatories=frozenset({"STEREO-A", "STEREO-B"}))) == ["B"]
    assert ids(three, BurstQuery(observatories=frozenset({"PSP", "WIND"}))) == []


def test_none_of_the_flags_may_be_on_the_solution(three: Catalogue) -> None:
    assert ids(three, BurstQuery(flags_absent=frozenset({"outside_prior"}))) == ["A", "B"]
    assert ids(three, BurstQuery(flags_absent=frozenset({"two_modes", "unknown"}))) == ["B"]
    both = BurstQuery(flags_absent=frozenset({"two_modes"}), observatories=frozenset({"WIND"}), start=START)
    assert ids(three, both) == ["B"]


def test_the_grade_is_that_of_the_preferred_newest_solution(three: Catalogue) -> None:
    at = three.burst("B").burst
    three.publish(publication("h2", of=at, track_fit=fitted()))
    assert ids(three, BurstQuery(grades=frozenset("A"))) == ["B"]
    assert ids(three, BurstQuery(grades=frozenset("BCD"))) == ["A", "C"]
    one = three.bursts(BurstQuery(grades=frozenset("D"), limit=1))
    assert (one.bursts[0].burst.burst_id, one.total) == ("A", 2)
    three.publish(publication("h3", of=at))
    assert ids(three, BurstQuery(grades=frozenset("A"))) == []


def test_only_flags_of_the_preferred_newest_solution_count(three: Catalogue) -> None:
    without = BurstQuery(flags_absent=frozenset({"two_modes"}))
    at = three.burst("A").burst
    three.publish(publication(of=at, series=Series("gauss_hermite", "nuts", "own", 2), flags=()))
    assert ids(three, without) == ["B"]
    three.publish(publication("h2", of=at, flags=()))
    assert ids(three, without) == ["A", "B"]
    other = Series("half_maximum", "posterior", "default", 3)
    three.publish(publication("h3", of=at, series=other, flags=("two_modes",)))
    assert ids(three, without) == ["A", "B"]
    three.prefer("A", other.name)
    assert ids(three, without) == ["B"]
    preferred = three.burst("A").preferred
    assert preferred is not None
    assert preferred.flags == ("two_modes",)


def test_a_cut_page_says_so(three: Catalogue) -> None:
    page = three.bursts(BurstQuery(limit=2))
    assert ([one.burst.burst_id for one in page.bursts], page.total) == (["A", "B"], 3)
    rest = three.bursts(BurstQuery(limit=2, cursor=page.next_cursor))
    assert ([one.burst.burst_id for one in rest.bursts], rest.total, rest.next_cursor) == (["C"], 3, None)


def test_a_burst_that_arrives_between_two_pages_shifts_nothing(three: Catalogue) -> None:
    page = three.bursts(BurstQuery(limit=2))
    three.publish(publication(of=burst("AA", START + timedelta(minutes=1))))
    rest = three.bursts(BurstQuery(limit=2, cursor=page.next_cursor))
    assert [one.burst.burst_id for one in rest.bursts] == ["C"]


@pytest.fixture(scope="module")
def shared(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Catalogue]:
    file = tmp_path_factory.mktemp("pages") / "catalogue.sqlite"
    with Catalogue.open(f"sqlite:///{file}", create=True) as catalogue:
        yield catalogue


def walk(catalogue: Catalogue, start: datetime, stop: datetime, limit: int) -> list[tuple[datetime, str]]:
    seen: list[tuple[datetime, str]] = []
    cursor: str | None = None
    while True:
        page = catalogue.bursts(BurstQuery(start=start, stop=stop, cursor=cursor, limit=limit))
        assert len(page.bursts) <= limit
        seen.extend((one.burst.start_utc, one.burst.burst_id) for one in page.bursts)
        cursor = page.next_cursor
        if cursor is None:
            assert page.total == len(seen)
            return seen
        assert len(page.bursts) == limit


onsets = st.lists(st.integers(0, 5), max_size=10)


def check_walk(catalogue: Catalogue, seconds: list[int], limit: int) -> None:
    begin = START + timedelta(days=next(windows))
    given_bursts = [
        burst(f"T3-{uuid.uuid4().hex[:8]}", begin + timedelta(seconds=second, microseconds=second % 2))
        for second in seconds
    ]
    for one in given_bursts:
        catalogue.publish(publication(of=one, localisations=(), sources=(), flags=()))
    seen = walk(catalogue, begin, begin + timedelta(days=1), limit)
    assert seen == sorted((one.start_utc, one.burst_id) for one in given_bursts)


@settings(max_examples=30, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(seconds=onsets, limit=st.integers(1, 4))
def test_walking_the_pages_gives_every_burst_once_in_order(shared: Catalogue, seconds: list[int], limit: int) -> None:
    check_walk(shared, seconds, limit)


@pytest.mark.parametrize("limit", [1, 3, 7, 100])
def test_pages_are_the_same_on_each_database(catalogue: Catalogue, limit: int) -> None:
    check_walk(catalogue, [0, 3, 3, 3, 1, 0, 5], limit)


@given(start=st.datetimes(timezones=st.just(UTC)), burst_id=st.from_regex(r"T3-[A-Za-z0-9_-]{0,20}", fullmatch=True))
@settings(derandomize=True)
def test_a_cursor_holds_what_it_was_made_of(start: datetime, burst_id: str) -> None:
    cursor = cursor_after(start, burst_id)
    assert parse_cursor(cursor) == (start, burst_id)
    assert all(letter.isalnum() or letter in "-_" for letter in cursor)


def encoded(value: object) -> str:
    return base64.urlsafe_b64encode(json.dumps(value).encode()).decode()


@pytest.mark.parametrize(
    "cursor",
    [
        "",
        "x",
        "é",
        "not a cursor",
        "=" * 8,
        encoded([]),
        encoded(["2012-06-07T19:29:00+00:00"]),
        encoded(["yesterday", "A"]),
        encoded([5, "A"]),
        encoded({"a": 1, "b": 2}),
        encoded("ab"),
        encoded(["0001-01-01T00:00:00+23:00", "A"]),
    ],
)
def test_a_bad_cursor_is_bad_input(three: Catalogue, cursor: str) -> None:
    with pytest.raises(InputError, match="cursor is not valid"):
        three.bursts(BurstQuery(cursor=cursor))


@given(cursor=st.text(max_size=40) | st.binary(max_size=40).map(lambda one: base64.urlsafe_b64encode(one).decode()))
@settings(derandomize=True, max_examples=300)
def test_any_text_is_a_cursor_or_bad_input(cursor: str) -> None:
    try:
        start, _ = parse_cursor(cursor)
    except InputError:
        return
    assert start.tzinfo == UTC


@pytest.mark.parametrize("limit", [0, -1, 1001])
def test_a_limit_out_of_range_is_bad_input(catalogue: Catalogue, limit: int) -> None:
    with pytest.raises(InputError, match="give 1 to 1000"):
        catalogue.bursts(BurstQuery(limit=limit))


def test_a_page_of_many_bursts_is_read_in_a_few_queries(catalogue: Catalogue) -> None:
    for minute in range(30):
        catalogue.publish(publication(of=burst(f"T3-{minute:02}", START + timedelta(minutes=minute))))
    statements: list[str] = []
    event.listen(catalogue._engine, "before_cursor_execute", lambda *args: statements.append(args[2]))
    page = catalogue.bursts(BurstQuery(limit=30))
    assert [len(one.solutions) for one in page.bursts] == [1] * 30
    assert [one.burst.observatories for one in page.bursts] == [burst().observatories] * 30
    assert len([one for one in statements if one.startswith("SELECT")]) <= 6

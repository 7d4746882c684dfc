import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import count
from typing import Any, Literal

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import Connection, event

from bella.catalogue import BurstQuery, Catalogue, ListRead, SearchedDay, Series, queries
from bella.catalogue.kept import Kept
from bella.exceptions import InputError
from tests.catalogue.examples import SERIES, START, burst, fitted, localisation, publication
from tests.fixtures_postgres import postgres_database

windows = count()


def ids(catalogue: Catalogue, query: BurstQuery) -> list[str]:
    page = catalogue.bursts(query)
    assert page.total == len(page.bursts)
    return [one.burst.burst_id for one in page.bursts]


@pytest.fixture
def three(catalogue: Catalogue) -> Catalogue:
    """Bursts A, B, C, an hour apart; only B was received by all, and the flags of A and C differ."""
    received = {"A": ("WIND", "STEREO-A"), "B": ("WIND", "STEREO-A", "STEREO-B"), "C": ("STEREO-B", "WIND")}
    flags = {"A": ("two_modes",), "B": (), "C": ("two_modes", "outside_prior")}
    for hours, name in enumerate(received):
        own = burst(name, START + timedelta(hours=hours), observatories=received[name])
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


def test_points_are_the_preferred_answers_of_bursts_in_one_statement(three: Catalogue) -> None:
    three.publish(publication("h9", of=burst("A"), series=Series("half_maximum", "posterior", "paper", 2)))
    three.publish(publication(of=burst("D", START + timedelta(hours=3))))
    for one in three.burst("D").solutions:
        three.retract(one.solution_id, "timed on interference")
    query = BurstQuery(sort="-start", flags_absent=frozenset({"outside_prior"}))
    statements: list[str] = []
    event.listen(three._engine, "before_cursor_execute", lambda *args: statements.append(args[2]))
    page = three.points(query)
    assert len([one for one in statements if one.startswith("SELECT")]) == 1
    expected = three.bursts(query).bursts
    assert [(one.burst_id, one.start_utc, one.origin, one.answer) for one in page.points] == [
        (one.burst.burst_id, one.burst.start_utc, one.burst.origin, one.preferred and one.preferred.answer)
        for one in expected
    ]
    assert page.points[0].answer is None
    assert three.points(replace(query, limit=2)).total == len(expected) == 3


def place(catalogue: Catalogue) -> Catalogue:
    """Bursts at four longitudes, of which the last has no track; A and B are out of the ecliptic."""
    places = {"A": (26.0, 20.0), "B": (-170.0, -5.0), "C": (175.0, 0.0)}
    for hours, (name, (longitude, z)) in enumerate(places.items()):
        own = burst(name, START + timedelta(hours=hours), f_low_mhz=0.1 * (hours + 1), f_high_mhz=3.0 * (hours + 1))
        rows = (
            localisation(0.5, x_rsun=20.0 * (hours + 1), y_rsun=0.0, z_rsun=z, area68_rsun2=10.0 * (hours + 1)),
            localisation(0.25, x_rsun=30.0 * (hours + 1), y_rsun=0.0, z_rsun=z, area68_rsun2=20.0 * (hours + 1)),
            localisation(0.2, flags="multimodal", x_rsun=900.0, z_rsun=900.0, area68_rsun2=9000.0),
        )
        fit = fitted(longitude, half_width_deg=4.5 + 3.0 * hours)
        catalogue.publish(publication(of=own, track_fit=fit, localisations=rows))
    catalogue.publish(publication(of=burst("D", START + timedelta(hours=3)), localisations=()))
    return catalogue


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def placed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Catalogue]:
    """Catalogue of those four, which these tests read only."""
    with ExitStack() as opened:
        url = f"sqlite:///{tmp_path_factory.mktemp('placed') / 'catalogue.sqlite'}"
        if request.param == "postgresql":
            url = opened.enter_context(postgres_database())
        yield place(opened.enter_context(Catalogue.open(url, create=True)))


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ({"longitude_min": 20.0, "longitude_max": 30.0}, "A"),
        ({"longitude_min": 26.0, "longitude_max": 26.0}, "A"),
        ({"longitude_min": 27.0, "longitude_max": 30.0}, ""),
        ({"longitude_min": 170.0, "longitude_max": -160.0}, "BC"),
        ({"longitude_min": 170.0, "longitude_max": 190.0}, "BC"),
        ({"longitude_min": 170.0}, "C"),
        ({"longitude_max": -160.0}, "B"),
        ({"longitude_min": -190.0, "longitude_max": -165.0}, "BC"),
        ({"longitude_min": -180.0, "longitude_max": 180.0}, "ABC"),
        ({"longitude_min": 0.0, "longitude_max": 360.0}, "ABC"),
        ({"longitude_min": -174.0, "longitude_max": 174.0}, "AB"),
        ({"latitude_min": 30.0}, "A"),
        ({"latitude_min": 34.0, "latitude_max": 44.0}, "A"),
        ({"latitude_max": -7.0}, "B"),
        ({"latitude_min": 0.0}, "A"),
        ({"latitude_min": -90.0, "latitude_max": 90.0}, "AB"),
        ({"distance_min": 61.0}, "C"),
        ({"distance_min": 40.0, "distance_max": 50.0}, "B"),
        ({"distance_max": 59.0}, "AB"),
        ({"distance_min": 0.0}, "ABC"),
        ({"wind_min": 590.0, "wind_max": 590.0}, "ABC"),
        ({"wind_min": 591.0}, ""),
        ({"wind_max": 589.0}, ""),
        ({"area_min": 15.0, "area_max": 29.0}, "A"),
        ({"area_min": 30.0, "area_max": 44.0}, "B"),
        ({"area_max": 15.0}, "A"),
        ({"frequency_min": 13.0}, "D"),
        ({"frequency_max": 0.12}, "A"),
        ({"frequency_min": 4.0, "frequency_max": 5.0}, "BCD"),
        ({"tier": "final"}, "ABCD"),
        ({"tier": "preliminary"}, ""),
        ({"edges": frozenset({"half_maximum"})}, "ABCD"),
        ({"edges": frozenset({"half_rise"})}, ""),
        ({"methods": frozenset({"posterior", "nuts"}), "presets": frozenset({"default"})}, "ABCD"),
        ({"methods": frozenset({"tdoa"})}, ""),
        ({"presets": frozenset({"paper"})}, ""),
        ({"longitude_min": 0.0, "wind_min": 500.0, "distance_max": 50.0, "grades": frozenset("AB")}, "A"),
    ],
)
def test_ranges_are_those_of_the_preferred_solution(placed: Catalogue, asked: dict[str, Any], found: str) -> None:
    assert ids(placed, BurstQuery(**asked)) == list(found)


def test_ranges_follow_the_answer_when_it_changes(catalogue: Catalogue) -> None:
    placed = place(catalogue)
    west = BurstQuery(longitude_min=20.0, longitude_max=30.0)
    at = placed.burst("B").burst
    other = Series("half_maximum", "posterior", "paper", 2)
    solution = placed.publish(publication("h2", of=at, series=other, track_fit=fitted(21.0)))
    assert ids(placed, west) == ["A"]
    placed.prefer("B", other.name)
    assert ids(placed, west) == ["A", "B"]
    placed.retract(solution.solution_id, "wrong edges")
    assert ids(placed, west) == ["A"]
    placed.retract("A", "not a burst")
    assert ids(placed, west) == []
    assert [one.burst.burst_id for one in placed.bursts(BurstQuery(with_retracted=True)).bursts] == ["A", "B", "C", "D"]


def test_flags_that_are_asked_for_are_all_there(three: Catalogue) -> None:
    assert ids(three, BurstQuery(flags=frozenset({"two_modes"}))) == ["A", "C"]
    assert ids(three, BurstQuery(flags=frozenset({"two_modes", "outside_prior"}))) == ["C"]
    assert ids(three, BurstQuery(flags=frozenset({"two_modes"}), flags_absent=frozenset({"outside_prior"}))) == ["A"]


def test_what_was_changed_since_a_time_is_found(three: Catalogue) -> None:
    before = datetime.now(UTC)
    assert ids(three, BurstQuery(updated_since=before)) == []
    changes: list[Callable[[], object]] = [
        lambda: three.publish(publication("h2", of=three.burst("A").burst)),
        lambda: three.prefer("A", SERIES.name),
        lambda: three.prefer_by_rule("A"),
        lambda: three.retract("A", "not a burst"),
    ]
    for change in changes:
        since = datetime.now(UTC)
        change()
        assert ids(three, BurstQuery(updated_since=since, with_retracted=True)) == ["A"]
        updated = three.burst("A").burst.updated_utc
        assert updated is not None
        assert since <= updated <= datetime.now(UTC)
    assert ids(three, BurstQuery(updated_since=before)) == []


@pytest.mark.parametrize(
    ("sort", "expected"),
    [
        ("start", "ABCD"),
        ("-start", "DCBA"),
        ("updated", "ABCD"),
        ("-updated", "DCBA"),
        ("grade", "ABCD"),
        ("-grade", "DCBA"),
        ("longitude", "BACD"),
        ("-longitude", "CABD"),
        ("latitude", "BACD"),
        ("-latitude", "ABDC"),
        ("distance", "ABCD"),
        ("-distance", "CBAD"),
        ("wind", "ABCD"),
        ("-wind", "CBAD"),
        ("area", "ABCD"),
        ("-area", "CBAD"),
        ("frequency", "ABCD"),
        ("-frequency", "DCBA"),
    ],
)
def test_every_sort_gives_every_burst_once_whatever_the_size_of_a_page(
    placed: Catalogue, sort: str, expected: str
) -> None:
    for limit in (1, 3, 10):
        seen, cursor = [], None
        while True:
            page = placed.bursts(BurstQuery(sort=sort, limit=limit, cursor=cursor))
            seen += [one.burst.burst_id for one in page.bursts]
            cursor = page.next_cursor
            if cursor is None:
                break
        assert seen == list(expected)


def test_a_sort_that_is_not_known_is_refused_with_those_that_are(catalogue: Catalogue) -> None:
    with pytest.raises(
        InputError, match=r"sort: 'beauty' is not known; choose one of start, updated, grade, longitude"
    ):
        catalogue.bursts(BurstQuery(sort="beauty"))


def test_a_cursor_goes_with_its_question(three: Catalogue) -> None:
    cursor = three.bursts(BurstQuery(limit=1)).next_cursor
    assert len(three.bursts(BurstQuery(limit=2, cursor=cursor)).bursts) == 2
    with pytest.raises(InputError, match="cursor: was given with other filters"):
        three.bursts(BurstQuery(limit=1, cursor=cursor, sort="-start"))


def test_filters_and_orders_are_read_with_indexes(sqlite_url: str) -> None:
    """What SQLite says it will do: never every row of a table beside the bursts, and none sorted by start."""
    with Catalogue.open(sqlite_url, create=True) as opened:
        plans: list[str] = []

        def explain(connection: Connection, _cursor: object, statement: str, parameters: object, *_: object) -> None:
            if statement.startswith("SELECT"):
                rows = connection.connection.cursor().execute(f"EXPLAIN QUERY PLAN {statement}", parameters)  # type: ignore[arg-type]
                plans.extend(str(row[3]) for row in rows)

        event.listen(opened._engine, "before_cursor_execute", explain)
        for query in (BurstQuery(stop=START, sort="-start"), BurstQuery(longitude_min=10.0, wind_min=300.0)):
            plans.clear()
            opened.bursts(query)
            assert not [one for one in plans if one.startswith("SCAN")], plans
        plans.clear()
        opened.bursts(BurstQuery(sort="-start", start=START))
        assert any("ix_burst_start_utc_burst_id" in one for one in plans)


def test_the_state_of_a_list_changes_with_each_of_its_bursts(three: Catalogue) -> None:
    all_of_them, first = BurstQuery(), BurstQuery(stop=START + timedelta(minutes=1))
    before = three.state_of(all_of_them), three.state_of(first)
    assert len({*before, three.state_of(BurstQuery(sort="-start"))}) == 3
    assert three.state_of(BurstQuery(limit=1)) == before[0]
    three.retract("C", "interference")
    after = three.state_of(all_of_them), three.state_of(first)
    assert (after[0] != before[0], after[1] == before[1]) == (True, True)
    three.publish(publication(of=burst("A", START), inputs_hash="other"))
    assert three.state_of(first) != before[1]


def test_the_last_change_is_that_of_the_newest(catalogue: Catalogue) -> None:
    kinds: tuple[Literal["bursts", "days", "files", "events"], ...] = ("bursts", "days", "files", "events")
    assert [catalogue.changed_utc(one) for one in kinds] == [None] * 4
    before = datetime.now(UTC)
    catalogue.publish(publication(of=burst("B", START + timedelta(hours=1))))
    first = catalogue.changed_utc("bursts")
    catalogue.publish(publication(of=burst("A", START)))
    second = catalogue.changed_utc("bursts")
    assert first
    assert second
    assert before <= first < second <= datetime.now(UTC)
    files = catalogue.changed_utc("files")
    assert files
    assert before <= files <= second
    catalogue.record_day(SearchedDay(START.date(), "a" * 64, "0", ("WIND",)), [])
    days = catalogue.changed_utc("days")
    assert days
    assert second <= days
    read = ListRead("a", "read", "", 0, 0, "", None, None, START, START + timedelta(days=1))
    catalogue.events.note(read)
    assert catalogue.changed_utc("events") == read.read_utc
    catalogue.events.note_linked(START + timedelta(days=2))
    assert catalogue.changed_utc("events") == START + timedelta(days=2)


def test_what_is_kept_of_a_burst_is_never_older_than_the_catalogue(catalogue: Catalogue, catalogue_url: str) -> None:
    def publish(edge: str, version: str, **changes: Any) -> None:
        own = burst("A", START, **changes)
        catalogue.publish(publication(version, of=own, series=replace(SERIES, edge=edge), track_fit=fitted()))

    first = SERIES.edge
    changes: tuple[Callable[[], object], ...] = (
        lambda: publish(first, "1"),
        lambda: publish(first, "1"),
        lambda: publish(first, "2", observatories=("WIND", "PSP", "SOLO"), f_low_mhz=0.2),
        lambda: publish("half_rise", "1", end_utc=START + timedelta(hours=1)),
        lambda: catalogue.prefer("A", "half_rise", "by hand"),
        lambda: catalogue.prefer("A", "half_rise", "for another reason"),
        lambda: catalogue.prefer_by_rule("A"),
        lambda: catalogue.add_companions(f"A.{first}.posterior.default.2d.v2", {}),
        lambda: catalogue.retract("A.half_rise.posterior.default.2d.v1", "a test"),
        lambda: catalogue.retract("A", "a test"),
    )
    for change in changes:
        change()
        with Catalogue.open(catalogue_url) as fresh:
            expected = fresh.burst("A")
        assert catalogue.burst("A") == expected
        assert catalogue.bursts(BurstQuery(with_retracted=True)).bursts == (expected,)


def test_bursts_that_are_kept_are_not_read_again(three: Catalogue) -> None:
    statements: list[str] = []
    three.bursts()

    def note(connection: Connection, cursor: object, statement: str, *_: object) -> None:
        if statement.startswith("SELECT"):
            statements.append(statement)

    event.listen(three._engine, "before_cursor_execute", note)
    assert [one.burst.burst_id for one in three.bursts().bursts] == ["A", "B", "C"]
    assert len(statements) == 1
    three.retract("B", "a test")
    statements.clear()
    assert [one.burst.burst_id for one in three.bursts(BurstQuery(sort="-start", with_retracted=True)).bursts] == list(
        "CBA"
    )
    assert 1 < len(statements) <= 6


def test_bursts_beyond_the_most_make_room(catalogue: Catalogue) -> None:
    kept: queries.Summaries = Kept(2)
    for name in "ABC":
        catalogue.publish(publication(of=burst(name)))
    for _ in range(2):
        found = [queries.burst(catalogue._engine, name, kept).burst.burst_id for name in "ABC"]
        assert found == ["A", "B", "C"]
        assert len(kept._kept) == 2
        assert len(queries.bursts(catalogue._engine, BurstQuery(), kept).bursts) == 3


def test_joint_fits_are_those_of_the_tracks_without_their_profiles(catalogue: Catalogue) -> None:
    for name, fits in (("A", {"track_fit": fitted(26.0)}), ("B", {"track_fit": fitted(-40.0)}), ("C", {})):
        catalogue.publish(publication(of=burst(name), **fits))
    some = [one.solutions[0] for one in catalogue.bursts().bursts]
    statements: list[str] = []
    event.listen(catalogue._engine, "before_cursor_execute", lambda *args: statements.append(args[2]))
    for _ in range(2):
        found = catalogue.joints_of(some)
        assert len([one for one in statements if one.startswith("SELECT")]) == 1, "read once"
        assert {name.partition(".")[0] for name in found} == {"A", "B"}
    for one in some[:2]:
        track = catalogue.track(one.solution_id)
        assert track is not None
        assert found[one.solution_id] == track.joint.model_copy(update={"profile": ()})
    assert found[some[0].solution_id].phi0_deg.q50 == 26.0

"""Tables about the service itself, on both databases."""

from dataclasses import replace
from datetime import UTC, date, datetime, timedelta

import pytest

from bella.catalogue import Catalogue, Freshness, Latency, MockRun, ObservedDay, SearchedDay, SolutionTimes
from bella.catalogue.operation import BINS, ReceiverDay
from bella.exceptions import ConvergenceError, NoDataError
from bella.records import Origin
from tests.catalogue.examples import START, burst, publication

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
SECOND = timedelta(seconds=1)
FRESH = Freshness("WI_K0_WAV", "spectra", ("WIND",), 1.0, "ok", NOW, NOW, None, date(2026, 1, 1), NOW + 60 * SECOND)


def test_freshness_is_what_was_noted_last_with_spectra_first(catalogue: Catalogue) -> None:
    others = [replace(FRESH, dataset=name, kind=kind) for name, kind in (("OMNI", "in_situ"), ("A", "spectra"))]
    both = replace(FRESH, observatories=("STEREO-A", "STEREO-B"), newest_day=None, answered_utc=None)
    for one in (FRESH, *others, both, replace(both, state="silent", failures=2, message="no answer")):
        catalogue.operation.record_freshness(one)
    found = catalogue.operation.freshness()
    assert [one.dataset for one in found] == ["A", "WI_K0_WAV", "OMNI"]
    assert found[1] == replace(both, state="silent", failures=2, message="no answer")


def times(published_s: float, seen_s: float | None, origin: str = "archive") -> SolutionTimes:
    seen = None if seen_s is None else START + seen_s * SECOND
    return SolutionTimes(START, seen, None, START + 2 * SECOND, START + published_s * SECOND, origin)


def test_times_of_a_solution_are_those_that_were_noted_first(catalogue: Catalogue) -> None:
    name = catalogue.publish(publication()).solution_id
    assert catalogue.operation.times(name) is None
    catalogue.operation.record_times(name, times(10.0, 3.0))
    catalogue.operation.record_times(name, times(99.0, None))
    assert catalogue.operation.times(name) == times(10.0, 3.0)


def test_latencies_are_of_one_origin_and_leave_out_what_was_not_noted(catalogue: Catalogue) -> None:
    assert catalogue.operation.latencies()["seen_to_published"] == Latency(0, None, None, None, None)
    for number in range(1, 11):
        name = catalogue.publish(publication(f"h{number}", burst(f"T3-{number}"))).solution_id
        catalogue.operation.record_times(name, times(10.0 * number, None if number == 10 else 1.0))
    test = catalogue.publish(publication("test", burst("TEST-1"))).solution_id
    catalogue.operation.record_times(test, times(5000.0, 1.0, "test"))
    found = catalogue.operation.latencies()
    assert set(found) == {f"{name}_to_published" for name in ("seen", "fetched", "detected", "data")}
    assert found["data_to_published"] == Latency(10, 60.0, 100.0, 100.0, 100.0)
    assert found["seen_to_published"] == Latency(9, 49.0, 89.0, 89.0, 89.0)
    assert found["detected_to_published"].median_s == 58.0
    assert found["fetched_to_published"].solutions == 0
    assert catalogue.operation.latencies("test")["data_to_published"].largest_s == 5000.0


def test_old_mock_bursts_are_forgotten_with_all_of_theirs_and_others_stay(catalogue: Catalogue) -> None:
    assert catalogue.operation.last_mock() is None
    ids = {}
    for name, hours in (("TEST-old", 50), ("TEST-new", 1)):
        done = catalogue.publish(publication(name, burst(name)))
        catalogue.operation.record_times(done.solution_id, times(10.0, 1.0, "test"))
        begun = NOW - timedelta(hours=hours)
        catalogue.operation.record_mock(MockRun(begun, begun + SECOND, "ok", name, done.solution_id, 0.5))
        ids[name] = done.solution_id
    failed = NOW - timedelta(hours=60)
    catalogue.operation.record_mock(MockRun(failed, failed + SECOND, "failed", message="no burst"))
    kept = catalogue.publish(publication("kept")).burst_id
    assert catalogue.operation.solutions() == 3
    assert catalogue.operation.forget_mocks(NOW - timedelta(hours=48)) == ("TEST-old",)
    assert catalogue.operation.forget_mocks(NOW - timedelta(hours=48)) == ()
    assert catalogue.operation.times(ids["TEST-old"]) is None
    with pytest.raises(NoDataError):
        catalogue.burst("TEST-old")
    assert catalogue.burst("TEST-new").solutions
    assert catalogue.burst(kept).solutions
    assert catalogue.operation.solutions() == 2
    last = catalogue.operation.last_mock()
    assert last is not None
    assert (last.burst_id, last.off_deg, last.message) == ("TEST-new", 0.5, "")


def test_observability_of_a_day_is_replaced_and_a_day_without_it_says_so(catalogue: Catalogue) -> None:
    day = date(2021, 2, 1)
    with catalogue.lease("search", f"{day}", "run", 60.0) as lease:
        catalogue.record_day(SearchedDay(day, "hash", "1", ("WIND",)), (), lease)
    with pytest.raises(NoDataError, match="bella coverage --at 2021-02-01"):
        catalogue.operation.observed(day)
    for fraction in (0.25, 1.0):
        receiver = ReceiverDay(observatory="WIND", fraction=(fraction,) * BINS)
        one = ObservedDay(day=day, distances_rsun=(20.0,), longitudes_deg=(0.0,), receivers=(receiver,), maps=())
        catalogue.operation.record_observed(one, "hash")
    found = catalogue.operation.observed(day)
    assert found == one
    made_up = one.model_copy(update={"day": date(2021, 2, 3)})
    catalogue.operation.record_observed(made_up, "hash", Origin.SIMULATED)
    assert catalogue.operation.observed(made_up.day, tuple(Origin)) == made_up
    assert catalogue.operation.observed_between(day, made_up.day) == (one,)
    with pytest.raises(NoDataError, match="origin=simulated gives"):
        catalogue.operation.observed(made_up.day)
    assert found.at(datetime(2021, 2, 1, 23, 59, tzinfo=UTC)) == (("WIND",), None)
    with pytest.raises(NoDataError, match="2021-02-02T00:00 is not on 2021-02-01"):
        found.at(datetime(2021, 2, 2, tzinfo=UTC))


def test_work_counts_what_runs_and_what_failed_lately(catalogue: Catalogue) -> None:
    begin = datetime.now(UTC)
    assert catalogue.operation.work(begin).last_started_utc is None
    with pytest.raises(ConvergenceError), catalogue.lease("localise", "T3-1", "bad", 60.0):
        raise ConvergenceError("no mode found: widen the box")
    with catalogue.lease("localise", "T3-2", "good", 60.0):
        found = catalogue.operation.work(begin - SECOND)
        assert (found.running, found.failed) == (1, 1)
        assert found.last_started_utc is not None
        assert found.last_started_utc >= begin
        assert catalogue.operation.work(datetime.now(UTC) + 60 * SECOND).failed == 0
    assert catalogue.operation.work(begin - SECOND).running == 0

"""Status, metrics and health tell which link of the chain is broken, and only then."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from prometheus_client.parser import text_string_to_metric_families

from api.app import create_app
from bella.catalogue import Catalogue, Freshness, MockRun, Operation, SolutionTimes
from bella.pipeline.alive import LEAST_FREE_BYTES, chain
from bella.settings import Settings
from tests.api.published import published, settings_of

NOW = datetime.now(UTC)
HOUR = timedelta(hours=1)
K0 = Freshness("WI_K0_WAV", "spectra", ("WIND",), 1, "ok", NOW, NOW, None, NOW.date(), NOW + HOUR)
POSITIONS = Freshness(
    "JPL_HORIZONS", "ephemeris", ("PSP",), 0, "ok", NOW, NOW, None, NOW.date() + timedelta(days=300), NOW + HOUR
)
MOCK = MockRun(NOW - HOUR, NOW - HOUR + timedelta(seconds=40), "ok", "TEST-1", "TEST-1.half_rise", 1.5)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    settings = settings_of(tmp_path / "home", recent_days=150)
    settings.store_root.mkdir(parents=True)
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        for one in (K0, POSITIONS):
            catalogue.operation.record_freshness(one)
        catalogue.operation.record_mock(MOCK)
    return settings


@pytest.fixture
def operation(settings: Settings) -> Iterator[Operation]:
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        yield catalogue.operation


def states(operation: Operation, settings: Settings, now: datetime = NOW, since: datetime = NOW) -> dict[str, str]:
    return {one.name: one.state for one in chain(operation, settings, now, since)}


def stale(operation: Operation, settings: Settings, **when: datetime) -> set[str]:
    return {name for name, state in states(operation, settings, **when).items() if state == "stale"}


def test_a_chain_at_work_is_well(operation: Operation, settings: Settings) -> None:
    assert set(states(operation, settings).values()) == {"ok"}
    assert len(states(operation, settings)) == 6


def test_each_link_is_named_when_it_breaks(operation: Operation, settings: Settings) -> None:
    assert stale(operation, settings, now=NOW + 2.9 * HOUR) == {"worker"}
    assert stale(operation, settings, now=NOW + 3.1 * HOUR) == {"worker", "fetcher"}
    operation.record_freshness(replace(K0, state="silent", silent_since_utc=NOW - 23 * HOUR, failures=9))
    assert stale(operation, settings) == set()
    operation.record_freshness(replace(K0, state="silent", silent_since_utc=NOW - 25 * HOUR, failures=9))
    assert stale(operation, settings) == {"archive"}
    operation.record_freshness(K0)
    operation.record_freshness(replace(POSITIONS, newest_day=NOW.date()))
    assert stale(operation, settings) == set(), "positions of today are known"
    operation.record_freshness(replace(POSITIONS, newest_day=NOW.date() - timedelta(days=1)))
    assert stale(operation, settings) == {"ephemeris"}
    operation.record_freshness(POSITIONS)
    operation.record_mock(replace(MOCK, started_utc=NOW, state="failed", message="not localised"))
    assert stale(operation, settings) == {"pipeline"}


def test_what_never_began_is_missed_after_a_while_and_only_where_it_is_wanted(tmp_path: Path) -> None:
    settings = settings_of(tmp_path / "home", recent_days=150)
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        operation = catalogue.operation
        assert stale(operation, settings) == set()
        assert stale(operation, settings, now=NOW + 4 * HOUR) == {"fetcher", "worker"}
        alone = settings.model_copy(update={"recent_days": 0})
        assert stale(operation, alone, now=NOW + 4 * HOUR) == set()


def test_a_full_disk_is_named(operation: Operation, settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bella.pipeline.alive.LEAST_FREE_BYTES", LEAST_FREE_BYTES * 10**6)
    assert stale(operation, settings) == {"disk"}


def test_health_fails_with_the_name_of_the_link_and_the_api_goes_on(operation: Operation, settings: Settings) -> None:
    operation.record_freshness(replace(K0, state="silent", silent_since_utc=NOW - 99 * HOUR, message="503"))
    with TestClient(create_app(settings)) as client:
        reply = client.get("/health")
        assert reply.status_code == 503
        assert reply.json()["checks"]["archive"].startswith("stale: WI_K0_WAV silent since")
        assert client.get("/health/api").status_code == 200
        assert client.get("/api/v1/bursts").status_code == 200


def test_status_says_how_fresh_how_fast_and_what_waits(operation: Operation, settings: Settings) -> None:
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        for number in range(1, 5):
            solution = published(settings, catalogue, inputs_hash=f"{number}" * 64)
            seen, fetched = NOW - 10 * number * timedelta(seconds=1), NOW - number * timedelta(seconds=1)
            times = SolutionTimes(NOW - 24 * HOUR, seen, fetched, None, NOW)
            operation.record_times(solution.solution_id, times)
            operation.record_times(solution.solution_id, replace(times, seen_utc=None))  # the first note stays
    with TestClient(create_app(settings)) as client:
        reply = client.get("/api/v1/status")
        page = client.get("/status")
    assert reply.headers["cache-control"] == "no-store"
    said: dict[str, Any] = reply.json()
    assert [one["dataset"] for one in said["freshness"]] == ["WI_K0_WAV", "JPL_HORIZONS"]
    seen_to = said["latency"]["seen_to_published"]
    assert (seen_to["solutions"], seen_to["median_s"], seen_to["largest_s"]) == (4, 30.0, 40.0)
    assert said["latency"]["fetched_to_published"]["largest_s"] == 4.0
    assert said["latency"]["detected_to_published"]["solutions"] == 0
    assert said["last_mock_burst"]["state"] == "ok"
    assert said["queue"]["waiting_submissions"] == 0
    assert said["disk"]["free_bytes"] > 0
    assert said["solutions"] == 4
    assert page.status_code == 200
    assert "WI_K0_WAV" in page.text


def test_metrics_are_what_prometheus_reads(operation: Operation, settings: Settings) -> None:
    operation.record_freshness(
        replace(K0, state="silent", silent_since_utc=NOW - 99 * HOUR, newest_day=date(2026, 1, 1))
    )
    with TestClient(create_app(settings)) as client:
        reply = client.get("/metrics")
    assert reply.headers["content-type"].startswith("text/plain; version=")
    assert reply.headers["cache-control"] == "no-store"
    samples = {
        (one.name, *one.labels.values()): one.value
        for family in text_string_to_metric_families(reply.text)
        for one in family.samples
    }
    assert samples["bella_link_up", "archive"] == 0
    assert samples["bella_link_up", "worker"] == 1
    assert samples["bella_dataset_silent", "WI_K0_WAV"] == 1
    assert samples["bella_dataset_age_days", "WI_K0_WAV"] == (datetime.now(UTC).date() - date(2026, 1, 1)).days
    assert samples["bella_mock_burst_ok",] == 1
    assert samples["bella_mock_burst_duration_seconds",] == 40
    assert ("bella_latency_seconds", "p98", "seen_to_published") in samples


def test_an_empty_home_has_a_status_too(empty: Settings) -> None:
    with TestClient(create_app(empty)) as client:
        assert client.get("/status").status_code == 200
        assert client.get("/api/v1/status").json()["last_mock_burst"] is None
        assert client.get("/metrics").status_code == 200
        assert client.get("/health").status_code == 200

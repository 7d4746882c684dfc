"""The mock burst goes the way of real ones, and is never taken for one."""

import tempfile
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

import bella.pipeline.mock as room
from bella.catalogue import Catalogue, MockRun
from bella.exceptions import BellaError, NotPlacedError
from bella.pipeline.burst import Choice
from bella.pipeline.day import FoundDay, search_day
from bella.pipeline.mock import PREFIX, forget_mocks, run_mock_burst
from bella.settings import Settings
from bella.store import open_group

NOW = datetime(2026, 11, 28, 12, tzinfo=UTC)


@pytest.fixture(scope="module")
def sent(tmp_path_factory: pytest.TempPathFactory) -> tuple[Settings, MockRun]:
    settings = Settings(home=tmp_path_factory.mktemp("home"))
    return settings, run_mock_burst(settings, NOW)


def test_it_arrives_where_it_was_sent_from(sent: tuple[Settings, MockRun]) -> None:
    settings, run = sent
    assert run.state == "ok"
    assert run.burst_id == "TEST-20261128T120000"
    assert run.off_deg is not None
    assert abs(run.off_deg) < 30
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        solution = catalogue.solution(run.solution_id)
        assert open_group(settings.store_root, solution.store_path).sizes["frequency"] > 3
        assert catalogue.operation.last_mock() == run
        times = catalogue.operation.times(run.solution_id)
        assert times is not None
        assert times.origin == "test"
        assert times.seen_utc == times.fetched_utc == NOW
        assert catalogue.operation.latencies()["seen_to_published"].solutions == 0
        assert catalogue.operation.latencies("test")["detected_to_published"].solutions == 1
        assert catalogue.days().total == 0


def test_old_ones_are_removed_with_their_files_and_nothing_else(sent: tuple[Settings, MockRun]) -> None:
    settings, run = sent
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        operation = catalogue.operation
        assert operation.forget_mocks(NOW) == ()
        assert catalogue.solution(run.solution_id)
    forget_mocks(settings, NOW + timedelta(seconds=1))
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        with pytest.raises(BellaError):
            catalogue.solution(run.solution_id)
        assert catalogue.operation.times(run.solution_id) is None
        assert catalogue.operation.last_mock() is None
        assert catalogue.operation.solutions() == 0
    assert list(settings.store_root.glob(f"{PREFIX}*")) == []
    assert not (settings.figures_root / run.burst_id).exists()


def test_what_fails_is_noted_with_its_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = Settings(home=tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "not-there"))
    with pytest.raises((BellaError, OSError)):
        run_mock_burst(settings, NOW)
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        run = catalogue.operation.last_mock()
    assert run is not None
    assert run.state == "failed"
    assert "not-there" in run.message


def without_bursts(files: Any, known: Any) -> FoundDay:
    return replace(search_day(files, known), bursts=())


@pytest.mark.parametrize(
    ("name", "instead", "said"),
    [("search_day", without_bursts, "no burst was found"), ("Choice", lambda: Choice(method="guess"), "guess")],
)
def test_a_link_of_the_path_that_gives_nothing_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, instead: Any, said: str
) -> None:
    settings = Settings(home=tmp_path)
    monkeypatch.setattr(room, name, instead)
    with pytest.raises(NotPlacedError, match=said):
        run_mock_burst(settings, NOW)
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        run = catalogue.operation.last_mock()
    assert run is not None
    assert (run.state, run.solution_id) == ("failed", "")
    assert said in run.message

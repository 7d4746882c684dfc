"""Who waits for whom, on a real PostgreSQL: what is decided is decided on what others have just committed.

On SQLite there is one writer at a time, so that it cannot come to this.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from sqlalchemy import Connection, make_url, text, update

from bella.catalogue import Catalogue
from bella.catalogue.engine import reading, writing
from bella.catalogue.models import BurstRow, SolutionRow, StageRunRow, TrackFitRow, table_of
from bella.catalogue.preference import lock
from bella.exceptions import BusyError, InputError, NoDataError
from tests.catalogue.examples import burst, publication
from tests.waiting import until

BURST_ID = burst().burst_id
WAITING = text("SELECT count(*) FROM pg_stat_activity WHERE wait_event_type = 'Lock' AND datname = current_database()")
FITS, SOLUTIONS, BURSTS = table_of(TrackFitRow), table_of(SolutionRow), table_of(BurstRow)


@pytest.fixture
def backend() -> str:
    return "postgresql"


@pytest.fixture
def hasty(catalogue_url: str) -> Iterator[Catalogue]:
    """The same catalogue for somebody who waits 50 ms for a lock."""
    url = make_url(catalogue_url).update_query_dict({"options": "-c lock_timeout=50"})
    with Catalogue.open(url.render_as_string(hide_password=False)) as opened:
        yield opened


@contextmanager
def beside(catalogue: Catalogue, late: Callable[[], Any]) -> Iterator[tuple[Connection, "list[Future[Any]]"]]:
    """Transaction that has locked the burst, and commits when another call waits for it."""
    calls: list[Future[Any]] = []
    with ThreadPoolExecutor(1) as pool, writing(catalogue._engine) as connection:
        lock(connection, BURST_ID)
        yield connection, calls
        calls.append(pool.submit(late))
        until(lambda: _is_waiting(catalogue) or calls[0].done())


def _is_waiting(catalogue: Catalogue) -> bool:
    with reading(catalogue._engine) as connection:
        return bool(connection.execute(WAITING).scalar_one())


def test_nobody_takes_a_lease_between_the_check_and_the_commit(catalogue: Catalogue, hasty: Catalogue) -> None:
    with catalogue.lease("localise", BURST_ID, "slow", 60.0) as lease:
        with writing(catalogue._engine) as connection:
            expired = datetime.now(UTC) - timedelta(seconds=1)
            connection.execute(update(table_of(StageRunRow)).values(expires_utc=expired))

        def take() -> None:
            with pytest.raises(BusyError, match="is busy"):
                hasty.lease("localise", BURST_ID, "rival", 60.0).__enter__()

        catalogue.publish(publication(), lease, take)
    assert catalogue.stage_runs(1)[0].run_id == "slow"


def test_companions_are_added_once_by_whoever_was_first(catalogue: Catalogue) -> None:
    known = {"two_step": {}, "companions": {}, "companions_pending": True}
    name = catalogue.publish(publication(track_fit=known)).solution_id
    first = {**known, "companions": {"semp": {}}, "companions_pending": False}
    with beside(catalogue, lambda: catalogue.add_companions(name, {"fused": {}})) as (connection, calls):
        connection.execute(update(FITS).values(fit=first))
    assert calls[0].result() == catalogue.track_fit(name) == first


@pytest.mark.parametrize("table", [SOLUTIONS, BURSTS])
def test_the_first_reason_of_a_retraction_stays(catalogue: Catalogue, table: Any) -> None:
    solution_id = catalogue.publish(publication()).solution_id
    name = BURST_ID if table is BURSTS else solution_id
    with beside(catalogue, lambda: catalogue.retract(name, "the second reason")) as (connection, calls):
        connection.execute(update(table).values(retracted_utc=datetime.now(UTC), retracted_reason="the first"))
    with pytest.raises(InputError, match="the first"):
        calls[0].result()


@pytest.mark.parametrize(
    "choose", [lambda one: one.prefer(BURST_ID, "half_maximum"), lambda one: one.prefer_by_rule(BURST_ID)]
)
def test_what_was_just_retracted_is_not_preferred(catalogue: Catalogue, choose: Callable[[Catalogue], Any]) -> None:
    catalogue.publish(publication())
    with beside(catalogue, lambda: choose(catalogue)) as (connection, calls):
        connection.execute(update(SOLUTIONS).values(retracted_utc=datetime.now(UTC), retracted_reason="wrong"))
    with pytest.raises(NoDataError, match="has no solution"):
        calls[0].result()

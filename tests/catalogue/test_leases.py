import os
import threading
from datetime import UTC, date, datetime, timedelta

import pytest
from sqlalchemy import update

from bella.catalogue import Catalogue, Lease, SearchedDay
from bella.catalogue.engine import writing
from bella.catalogue.leases import Owner, is_gone, process_start, this_process
from bella.catalogue.models import StageRunRow
from bella.exceptions import BusyError, ConvergenceError, StoreError, UnreachableError
from tests.catalogue.examples import publication
from tests.waiting import until


def change(catalogue: Catalogue, **values: object) -> None:
    with writing(catalogue._engine) as connection:
        connection.execute(update(StageRunRow).values(**values))


def test_a_live_run_keeps_others_out_and_says_who_it_is(catalogue: Catalogue) -> None:
    with catalogue.lease("localise", "T3-1", "first", 60.0):
        with pytest.raises(BusyError, match=rf"run first \(process {os.getpid()} on .*wait for it"):
            catalogue.lease("localise", "T3-1", "second", 60.0).__enter__()
        with catalogue.lease("localise", "T3-2", "second", 60.0), catalogue.lease("figures", "T3-1", "second", 60.0):
            assert len(catalogue.stage_runs(10)) == 3


def test_a_run_that_ends_is_recorded_and_the_next_counts_on(catalogue: Catalogue) -> None:
    for attempt in (1, 2, 3):
        with catalogue.lease("localise", "T3-1", f"run{attempt}", 60.0) as lease:
            assert lease.attempt == attempt
            assert catalogue.stage_runs(1)[0].ended_utc is None
    (row,) = catalogue.stage_runs(10)
    assert (row.state, row.attempts, row.run_id, row.message) == ("done", 3, "run3", "")
    assert row.ended_utc is not None
    assert row.started_utc <= row.ended_utc < row.expires_utc


def test_a_run_that_fails_says_why_and_does_not_block_the_next(catalogue: Catalogue) -> None:
    with pytest.raises(ConvergenceError), catalogue.lease("localise", "T3-1", "bad", 60.0):
        raise ConvergenceError("no mode found: widen the box\nsecond line")
    (row,) = catalogue.stage_runs(10)
    assert (row.state, row.message) == ("failed", "ConvergenceError: no mode found: widen the box")
    with catalogue.lease("localise", "T3-1", "next", 60.0) as lease:
        assert lease.attempt == 2


def test_a_long_reason_is_cut(catalogue: Catalogue) -> None:
    with pytest.raises(ConvergenceError), catalogue.lease("localise", "T3-1", "bad", 60.0):
        raise ConvergenceError("no mode found " * 1000)
    assert len(catalogue.stage_runs(1)[0].message) == 2000


def test_an_expired_lease_is_taken_over_and_its_owner_notices(catalogue: Catalogue) -> None:
    with catalogue.lease("localise", "T3-1", "slow", 60.0) as slow:
        change(catalogue, expires_utc=datetime.now(UTC) - timedelta(seconds=1))
        with catalogue.lease("localise", "T3-1", "quick", 60.0):
            with pytest.raises(BusyError, match="taken over by another run"):
                slow.renew(60.0)
            assert slow.end("done") is False
            assert catalogue.stage_runs(1)[0].run_id == "quick"
    assert catalogue.stage_runs(1)[0].run_id == "quick"


def test_renewing_moves_the_expiry(catalogue: Catalogue) -> None:
    with catalogue.lease("localise", "T3-1", "long", 60.0) as lease:
        later = lease.renew(3600.0)
        assert later - lease.expires_utc > timedelta(seconds=3000)
        assert catalogue.stage_runs(1)[0].expires_utc == later


def test_a_process_number_that_was_given_again_does_not_hold_a_lease(catalogue: Catalogue) -> None:
    boot = (process_start(os.getpid()) or "").rpartition("/")[0]
    with catalogue.lease("localise", "T3-1", "old", 60.0):
        change(catalogue, process_start=f"{boot}/1")
        with catalogue.lease("localise", "T3-1", "new", 60.0) as lease:
            assert lease.attempt == 2


def test_a_run_on_another_host_holds_its_lease_until_it_expires(catalogue: Catalogue) -> None:
    with catalogue.lease("localise", "T3-1", "there", 60.0):
        change(catalogue, host="elsewhere", pid=2**22 + 1)
        with pytest.raises(BusyError, match="on elsewhere"):
            catalogue.lease("localise", "T3-1", "here", 60.0).__enter__()


def test_only_what_is_certainly_gone_is_gone() -> None:
    here = this_process()
    assert here.process_start is not None
    boot, namespace, ticks = here.process_start.split("/")
    absent = 2**22 + 1
    assert not is_gone(here)
    assert is_gone(Owner(here.host, absent, here.process_start))
    assert is_gone(Owner(here.host, here.pid, f"an-earlier-boot/{namespace}/{ticks}"))
    assert is_gone(Owner(here.host, here.pid, f"an-earlier-boot/pid:[1]/{ticks}"))
    assert not is_gone(Owner(here.host, absent, f"{boot}/pid:[1]/{ticks}"))
    assert not is_gone(Owner("elsewhere", absent, here.process_start))


def test_where_the_system_does_not_tell_starts_the_number_counts() -> None:
    here = this_process()
    assert not is_gone(Owner(here.host, here.pid, None))
    assert is_gone(Owner(here.host, 2**22 + 1, None))


def test_a_process_of_another_user_is_alive(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbid(_pid: int, _signal: int) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "kill", forbid)
    assert not is_gone(Owner(this_process().host, 1, None))


def test_whoever_changed_the_row_first_has_the_lease(postgres_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """On SQLite it cannot come to this: only one writer at a time looks at the row."""
    with Catalogue.open(postgres_url, create=True) as catalogue:
        with catalogue.lease("localise", "T3-1", "old", 60.0):
            pass

        def overtaken(*_: object) -> bool:
            change(catalogue, token="of a rival")
            return False

        monkeypatch.setattr("bella.catalogue.leases.is_held", overtaken)
        with pytest.raises(BusyError, match="another run took localise of T3-1 a moment ago"):
            catalogue.lease("localise", "T3-1", "late", 60.0).__enter__()


def test_a_catalogue_that_refuses_does_not_hide_why_a_run_failed(catalogue: Catalogue) -> None:
    def fail() -> None:
        with catalogue.lease("localise", "T3-1", "bad", 60.0):
            with writing(catalogue._engine) as connection:
                connection.exec_driver_sql("DROP TABLE stage_run")
            raise ConvergenceError("no mode found: widen the box")

    with pytest.raises(ConvergenceError, match="no mode found"):
        fail()


def test_a_lease_is_renewed_beside_the_work_however_long_that_takes(catalogue: Catalogue) -> None:
    with catalogue.lease("localise", "T3-1", "slow", 0.6) as lease:
        until(lambda: catalogue.stage_runs(1)[0].expires_utc > lease.expires_utc + timedelta(seconds=1))
        with pytest.raises(BusyError, match="run slow"):
            catalogue.lease("localise", "T3-1", "other", 0.6).__enter__()
    after = catalogue.stage_runs(1)[0].expires_utc
    assert [one for one in threading.enumerate() if one.name == "lease localise T3-1"] == []
    assert catalogue.stage_runs(1)[0].expires_utc == after, "nothing beats after the work"


@pytest.mark.parametrize("backend", ["sqlite"])
def test_a_lease_is_renewed_long_before_it_ends(catalogue: Catalogue) -> None:
    duration_s = 9.0
    with catalogue.lease("localise", "T3-1", "slow", duration_s) as lease:
        until(lambda: catalogue.stage_runs(1)[0].expires_utc > lease.expires_utc)
        renewed = catalogue.stage_runs(1)[0].expires_utc
    assert (renewed - lease.expires_utc).total_seconds() < duration_s, "before it had ended"


def test_a_heart_beats_on_after_a_database_that_was_away(catalogue: Catalogue, monkeypatch: pytest.MonkeyPatch) -> None:
    real, asked = Lease.renew, []

    def away_at_first(lease: Lease, duration_s: float) -> datetime:
        asked.append(duration_s)
        if len(asked) < 3:
            raise UnreachableError("the database is away")
        return real(lease, duration_s)

    monkeypatch.setattr(Lease, "renew", away_at_first)
    with catalogue.lease("localise", "T3-1", "slow", 0.3) as lease:
        until(lambda: len(asked) > 3)
        assert not lease.lost.is_set()


def test_a_run_that_lost_its_lease_notices_and_publishes_nothing(catalogue: Catalogue) -> None:
    with catalogue.lease("localise", "T3-1", "slow", 0.3) as lease:
        change(catalogue, token="of a rival")
        until(lease.lost.is_set)
        with pytest.raises(BusyError, match="taken over by another run"):
            catalogue.publish(publication(), lease)
        with pytest.raises(BusyError, match="taken over by another run"):
            catalogue.record_day(SearchedDay(date(2021, 2, 1), "hash", "1", ("WIND",)), (), lease)
    assert catalogue.bursts().total == 0
    assert catalogue.searched_day(date(2021, 2, 1)) is None


def test_a_heart_stops_where_the_lease_is_lost(catalogue: Catalogue) -> None:
    with catalogue.lease("localise", "T3-1", "slow", 0.3):
        change(catalogue, token="of a rival")
        until(lambda: "lease localise T3-1" not in {one.name for one in threading.enumerate()})


def test_a_lease_ends_once(catalogue: Catalogue) -> None:
    with catalogue.lease("localise", "T3-1", "mine", 60.0) as lease:
        assert lease.end("done")
        assert not lease.end("failed", "twice")
        with pytest.raises(BusyError):
            lease.renew(60.0)
    assert catalogue.stage_runs(1)[0].state == "done"


def test_a_run_that_lost_its_lease_adds_nothing_to_what_is_published(catalogue: Catalogue) -> None:
    known = {"two_step": {}, "companions": {}, "companions_pending": True}
    name = catalogue.publish(publication(track_fit=known)).solution_id
    with catalogue.lease("localise", "T3-1", "slow", 60.0) as lease:
        change(catalogue, token="of a rival")
        with pytest.raises(BusyError, match="taken over by another run"):
            catalogue.add_companions(name, {"semp": {}}, lease)
    assert catalogue.track_fit(name) == known


def test_a_run_that_holds_its_lease_publishes(catalogue: Catalogue) -> None:
    with catalogue.lease("localise", "T3-1", "run", 60.0) as lease:
        catalogue.publish(publication(), lease)
        catalogue.record_day(SearchedDay(date(2021, 2, 1), "hash", "1", ("WIND",)), (), lease)
    assert catalogue.bursts().total == 1
    assert catalogue.searched_day(date(2021, 2, 1)) is not None
    with pytest.raises(BusyError):
        catalogue.publish(publication(inputs_hash="f" * 64), lease)


def test_what_a_check_refuses_is_not_published(catalogue: Catalogue) -> None:
    def refuse() -> None:
        raise StoreError("the group has left the store")

    with pytest.raises(StoreError, match="has left"):
        catalogue.publish(publication(), None, refuse)
    assert catalogue.bursts().total == 0


def test_subjects_of_live_runs_alone_are_in_use(catalogue: Catalogue) -> None:
    with catalogue.lease("localise", "T3-1", "one", 60.0), catalogue.lease("search", "2021-02-01", "two", 60.0):
        assert catalogue.held_subjects() == {"T3-1", "2021-02-01"}
        change(catalogue, expires_utc=datetime.now(UTC) - timedelta(seconds=1))
        assert catalogue.held_subjects() == frozenset()
    with catalogue.lease("localise", "T3-1", "one", 60.0):
        pass
    assert catalogue.held_subjects() == frozenset()

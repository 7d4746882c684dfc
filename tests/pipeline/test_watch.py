"""Watch over the mirror: what came last is processed first, what failed again, what is done not at all."""

import os
import threading
import time
from collections.abc import Sequence
from concurrent.futures import Future
from contextlib import closing
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import pytest

import bella
from bella.archive import find_datasets
from bella.catalogue import Catalogue, SearchedDay
from bella.exceptions import BellaError, InputError
from bella.pipeline import watch as room
from bella.pipeline.day import KnownBurst
from bella.pipeline.day_files import DayFiles, Mirror
from bella.pipeline.outcome import FAILED, SEARCHED, DayOutcome
from bella.pipeline.run import Run
from bella.pipeline.watch import Watch, folder_times, watch_days
from bella.pipeline.workers import Workers
from bella.records import DayAnswer
from bella.settings import Settings
from tests.archive.server import cdf

(WIND,) = find_datasets(["WI_H1_WAV"])
TODAY = date(2021, 11, 20)
RUNNING = "running"
DAY = timedelta(days=1)


class Noted:
    """Executor that notes which days are processed, and says what became of them."""

    def __init__(self, state: str = SEARCHED, error: BellaError | None = None) -> None:
        self.days: list[date] = []
        self.runs: list[Run] = []
        self.running: dict[date, Future[DayOutcome]] = {}
        self.state, self.error = state, error

    def fetch(self, days: Sequence[date], archive: str, settings: Settings) -> tuple[str, ...]:
        raise AssertionError(f"{archive} was asked for {days}: that is the fetcher's part ({settings.home})")

    def submit(self, files: DayFiles, known: Sequence[KnownBurst], run: Run) -> "Future[DayOutcome]":
        assert known == ()
        self.days.append(files.day)
        self.runs.append(run)
        future: Future[DayOutcome] = Future()
        if self.state == RUNNING:
            self.running[files.day] = future
            return future
        if self.error is not None:
            future.set_exception(self.error)
            return future
        with closing(Catalogue.open(run.settings.catalogue_url)) as catalogue:
            done = SearchedDay(files.day, files.inputs_hash, bella.__version__, ("WIND",), DayAnswer.NO_BURST, "")
            with catalogue.lease("search", f"{files.day}", run.run_id, 10.0) as lease:
                catalogue.record_day(done, (), lease)
        future.set_result(DayOutcome(files.day, self.state, DayAnswer.NO_BURST))
        return future


def settings_of(home: Path, recent_days: int = 9) -> Settings:
    return Settings(home=home, recent_days=recent_days, in_situ=None, regions=None)


def run_of(settings: Settings, workers: int = 1) -> Run:
    return Run(settings, "watch", Workers(workers, settings))


def arrive(settings: Settings, day: date, seed: int = 0) -> None:
    folder = settings.mirror_root / WIND.folders(day)[0]
    folder.mkdir(parents=True, exist_ok=True)
    staged = folder / ".staged"
    staged.write_bytes(cdf(seed))
    staged.replace(folder / f"wi_h1_wav_{day:%Y%m%d}_v01.cdf")


def step(watch: Watch) -> bool:
    """Whether anything is left to be done after a look, and after what was begun is done."""
    watch.step(TODAY)
    while watch.is_busy:
        watch.wait(1.0)
    return bool(watch._waiting)


def test_the_day_whose_file_came_last_is_next(tmp_path: Path) -> None:
    settings, executor = settings_of(tmp_path), Noted()
    for before in (1, 5, 3):
        arrive(settings, TODAY - before * DAY)
    watch = Watch(run_of(settings), executor)
    assert step(watch)
    assert executor.days == [TODAY - 3 * DAY]
    arrive(settings, TODAY - 7 * DAY)
    assert step(watch)
    assert executor.days[1:] == [TODAY - 7 * DAY]
    assert step(watch)
    assert not step(watch)
    assert executor.days[2:] == [TODAY - 5 * DAY, TODAY - 1 * DAY]
    assert not step(watch)
    assert len(executor.days) == 4
    found = {one.day: one.answer for one in watch.outcomes}
    assert list(found) == [TODAY - before * DAY for before in range(9, -1, -1)]
    assert found[TODAY - 7 * DAY] is DayAnswer.NO_BURST
    assert found[TODAY] is DayAnswer.ARCHIVE_SILENT


def test_a_replaced_file_is_new_and_days_before_the_recent_ones_are_not_looked_at(tmp_path: Path) -> None:
    settings, executor = settings_of(tmp_path, recent_days=2), Noted()
    arrive(settings, TODAY - 2 * DAY)
    arrive(settings, TODAY - 3 * DAY)
    watch = Watch(run_of(settings), executor)
    assert not step(watch)
    arrive(settings, TODAY - 2 * DAY, 1)
    assert not step(watch)
    assert executor.days == [TODAY - 2 * DAY] * 2


def test_as_many_days_at_a_time_as_there_are_workers_and_no_day_that_is_done(tmp_path: Path) -> None:
    settings, executor = settings_of(tmp_path), Noted()
    for before in (4, 3, 2):
        arrive(settings, TODAY - before * DAY)
    assert step(Watch(run_of(settings, 2), executor))
    assert executor.days == [TODAY - 2 * DAY, TODAY - 3 * DAY]
    assert not step(Watch(run_of(settings, 2), executor))
    assert executor.days[2:] == [TODAY - 4 * DAY]


def test_a_day_with_newer_files_than_all_that_are_processed_does_not_wait_for_them(tmp_path: Path) -> None:
    settings, executor = settings_of(tmp_path), Noted(RUNNING)
    watch = Watch(run_of(settings), executor)
    for number, before in enumerate((4, 3, 2), 1):
        arrive(settings, TODAY - before * DAY)
        watch.step(TODAY)
        assert executor.days == [TODAY - 4 * DAY, TODAY - 3 * DAY][:number], "never more than two for a worker"
    arrive(settings, TODAY - 3 * DAY, 1)
    watch.step(TODAY)
    executor.running[TODAY - 4 * DAY].set_result(DayOutcome(TODAY - 4 * DAY, SEARCHED))
    watch.wait(1.0)
    watch.step(TODAY)
    assert executor.days[2:] == [TODAY - 2 * DAY], "a day that is being processed is not begun again meanwhile"
    for before in (3, 2):
        executor.running[TODAY - before * DAY].set_result(DayOutcome(TODAY - before * DAY, SEARCHED))
        watch.wait(1.0)
    assert not watch.is_busy
    watch.step(TODAY)
    assert executor.days[3:] == [TODAY - 3 * DAY], "its file was replaced while it was processed"


def test_a_day_is_overtaken_by_newer_files_of_its_own_alone(tmp_path: Path) -> None:
    settings, executor = settings_of(tmp_path), Noted(RUNNING)
    watch = Watch(run_of(settings), executor)
    arrive(settings, TODAY - 4 * DAY)
    watch.step(TODAY)
    files = Mirror(settings).day(TODAY - 4 * DAY)
    (run,) = executor.runs
    assert not run.is_overtaken(files)
    arrive(settings, TODAY - 3 * DAY, 2)
    watch.step(TODAY)
    assert TODAY - 4 * DAY in watch._waiting, "the file of its neighbour is one of its own, too"
    assert not run.is_overtaken(files)
    arrive(settings, TODAY - 4 * DAY, 1)
    watch.step(TODAY)
    assert run.is_overtaken(files)


def test_older_days_wait_until_a_worker_is_free(tmp_path: Path) -> None:
    settings, executor = settings_of(tmp_path), Noted(RUNNING)
    for before in (2, 3, 4):
        arrive(settings, TODAY - before * DAY)
    watch = Watch(run_of(settings), executor)
    watch.step(TODAY)
    watch.step(TODAY)
    assert executor.days == [TODAY - 4 * DAY]


def test_a_neighbour_of_the_day_of_a_new_file_comes_after_it(tmp_path: Path) -> None:
    settings, executor = settings_of(tmp_path), Noted()
    for before in (5, 4, 3, 8, 4):
        arrive(settings, TODAY - before * DAY)
    step(Watch(run_of(settings, 9), executor))
    assert executor.days == [TODAY - before * DAY for before in (4, 8, 3, 5)]


def test_a_day_that_failed_is_tried_again_after_a_while(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings, executor = settings_of(tmp_path), Noted(error=InputError("the disk is full"))
    arrive(settings, TODAY)
    watch = Watch(run_of(settings), executor)
    assert not step(watch)
    assert not step(watch)
    assert executor.days == [TODAY]
    assert watch.outcomes[-1].state == FAILED
    monkeypatch.setattr(room, "RETRY_S", -1.0)
    watch = Watch(run_of(settings), executor)
    step(watch)
    executor.error = None
    step(watch)
    assert executor.days == [TODAY] * 3
    assert watch.outcomes[-1].state == SEARCHED
    step(watch)
    assert len(executor.days) == 3


class EnoughError(Exception):
    """The test has seen what it waits for."""


def test_a_database_that_is_away_is_asked_again_until_the_time_is_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(room, "LOOK_S", 0.01)
    away = settings_of(tmp_path / "away").model_copy(update={"database_url": "postgresql+psycopg://x@127.0.0.1:9/x"})
    said: list[str] = []

    def warned(event: str, **_: object) -> None:
        said.append(event)
        if len(said) == 3:
            raise EnoughError

    monkeypatch.setattr(room.log, "warning", warned)
    with pytest.raises(EnoughError):
        watch_days(run_of(away), Noted(), datetime.now(UTC) + DAY, DAY)
    said.clear()
    with pytest.raises(BellaError, match="cannot be reached"):
        watch_days(run_of(away), Noted(), datetime.now(UTC), 1000 * DAY)
    assert len(said) == 1
    said.clear()
    foreign = tmp_path / "foreign.sqlite"
    foreign.write_bytes(os.urandom(5000))
    wrong = settings_of(tmp_path / "wrong").model_copy(update={"database_url": f"sqlite:///{foreign}"})
    with pytest.raises(BellaError):
        watch_days(run_of(wrong), Noted(), datetime.now(UTC) + DAY, DAY)
    assert not said


def test_days_under_way_are_done_before_a_watch_ends_with_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(room, "LOOK_S", 0.01)
    settings, executor = settings_of(tmp_path, recent_days=1), Noted(RUNNING)
    today = datetime.now(UTC).date()
    arrive(settings, today)
    looked: list[date] = []
    look = Watch._look

    def then_fail(self: Watch, day: date) -> None:
        looked.append(day)
        if len(looked) > 1:
            threading.Timer(0.1, executor.running[today].set_result, [DayOutcome(today, SEARCHED)]).start()
            raise InputError("the catalogue is newer")
        look(self, day)

    monkeypatch.setattr(Watch, "_look", then_fail)
    with pytest.raises(InputError, match="is newer"):
        watch_days(run_of(settings), executor, datetime.now(UTC) + DAY, DAY)
    assert executor.running[today].done()


def test_what_is_there_is_looked_at_even_where_no_time_is_left(tmp_path: Path) -> None:
    found = watch_days(run_of(settings_of(tmp_path, recent_days=1)), Noted(), datetime.now(UTC), DAY)
    assert [one.answer for one in found] == [DayAnswer.ARCHIVE_SILENT] * 2


def test_a_watch_that_is_at_work_at_its_end_goes_on_in_place_of_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(room, "LOOK_S", 0.01)
    monkeypatch.setattr(room, "LATEST", timedelta(seconds=0.2))
    end, every = datetime.now(UTC) + timedelta(seconds=0.1), timedelta(seconds=1)
    monkeypatch.setattr(Watch, "step", lambda *_: time.sleep(0.4))
    watch_days(run_of(settings_of(tmp_path)), Noted(), end, every)
    assert datetime.now(UTC) >= end + every


def test_folders_of_winds_and_regions_are_looked_at_too(tmp_path: Path) -> None:
    settings = settings_of(tmp_path).model_copy(update={"in_situ": tmp_path / "in-situ", "regions": tmp_path / "none"})
    below = tmp_path / "in-situ" / "omni"
    below.mkdir(parents=True)
    before = folder_times([TODAY], settings)
    assert set(before) == {tmp_path / "in-situ", below}
    (below / "omni2_2021.dat").touch()
    os.utime(below, ns=(1, 1))
    assert folder_times([TODAY], settings) != before


def test_a_file_of_the_day_before_is_seen_where_it_is_in_another_folder(tmp_path: Path) -> None:
    settings, year = settings_of(tmp_path), date(2022, 1, 1)
    arrive(settings, year - DAY)
    arrive(settings, year + 366 * DAY)
    assert set(folder_times([year], settings)) == {settings.mirror_root / WIND.folders(year - DAY)[0]}

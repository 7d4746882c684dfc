"""An I/O fault is not physics: nothing is said of a burst or a day that the disk or the database has stopped."""

import hashlib
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import closing, nullcontext
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from bella.archive import find_datasets
from bella.arrivals import arrivals_csv
from bella.bursts import half_maximum_arrivals
from bella.catalogue import Catalogue, submission_name
from bella.containers.bounded import ReaderProcess
from bella.exceptions import BusyError, ConvergenceError, NotPlacedError, StoreError, UnreachableError, WorkerLostError
from bella.pipeline.burst import SCIENCE_ERRORS, computed
from bella.pipeline.day import day_spectra
from bella.pipeline.day_files import Mirror
from bella.pipeline.outcome import FAILED
from bella.pipeline.run import Direct, Run, process_days, process_submissions
from bella.pipeline.workers import Workers
from bella.settings import Settings
from bella.simulation.archive_days import simulate_days
from tests.archive.server import cdf
from tests.pipeline.disks import small_disk_at
from tests.pipeline.examples import files_of

DAY = date(2012, 6, 7)
SIZE_BYTES = 24_000_000


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    with small_disk_at(tmp_path / "disk", SIZE_BYTES) as place:
        yield place


def remount(place: Path, option: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{option}", place], check=True)


def submitted(home: Path) -> Settings:
    """A home in which an arrival table waits."""
    settings = Settings(home=home, draws=200, in_situ=None, regions=None)
    text = arrivals_csv(half_maximum_arrivals(np.geomspace(0.2, 2.0, 6)))
    sha256 = hashlib.sha256(text.encode()).hexdigest()
    settings.incoming_root.mkdir(parents=True)
    name = submission_name(DAY)
    (settings.incoming_root / f"{name}.csv").write_text(text)
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        catalogue.submit("token", sha256, name)
    return settings


def run_of(settings: Settings, name: str = "run") -> Run:
    return Run(settings, name, Workers(1, settings))


def waiting(settings: Settings) -> int:
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        return len(catalogue.pending_submissions())


def fill(place: Path, left: int) -> Path:
    """Take all room of a disk but so many bytes."""
    filler = place / "filler"
    with filler.open("wb") as stream:
        os.posix_fallocate(stream.fileno(), 0, shutil.disk_usage(place).free - left)
    return filler


@pytest.mark.parametrize("left", [16_384, 400_000])
def test_a_full_disk_leaves_a_submission_waiting_and_the_next_run_finishes_it(small_disk: Path, left: int) -> None:
    settings = submitted(small_disk / "home")
    filler = fill(small_disk, left)
    with pytest.raises(StoreError) if left < 100_000 else nullcontext():
        assert process_submissions(run_of(settings)) == 0
    filler.unlink()
    assert waiting(settings) == 1

    # also where no byte was left to write that the lease of the first run ended
    assert process_submissions(run_of(settings)) == 1
    assert waiting(settings) == 0
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        (burst,) = catalogue.bursts().bursts
        assert [one.version for one in burst.solutions] == [1]
        assert all((settings.store_root / path).is_file() for path in catalogue.referenced_paths())


def test_a_read_only_disk_leaves_a_submission_waiting(small_disk: Path) -> None:
    settings = submitted(small_disk / "home")
    remount(small_disk, "ro")
    with pytest.raises(StoreError):
        process_submissions(run_of(settings))
    remount(small_disk, "rw")
    assert waiting(settings) == 1


def test_a_day_on_a_full_disk_is_failed_and_not_recorded(small_disk: Path) -> None:
    settings = Settings(home=small_disk / "home", in_situ=None, regions=None)
    (dataset,) = find_datasets(["WI_H1_WAV"])
    path = settings.mirror_root / dataset.folders(DAY)[0] / dataset.name.format(date=f"{DAY:%Y%m%d}", version="01")
    path.parent.mkdir(parents=True)
    path.write_bytes(cdf(1))
    Catalogue.open(settings.catalogue_url, create=True).close()
    filler = fill(small_disk, 0)
    with Direct(1, sleep=lambda _: None) as executor, pytest.raises(StoreError, match="check the disk"):
        process_days([DAY], None, run_of(settings), executor)
    filler.unlink()
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        assert catalogue.searched_day(DAY) is None

    # its content is no spectrum of Wind: that is an answer
    with Direct(1) as executor:
        (done,) = process_days([DAY], None, run_of(settings), executor).outcomes
    assert (done.state, done.answer) == ("not searchable", "not searchable")
    with Direct(1) as executor:
        (again,) = process_days([DAY], None, run_of(settings), executor).outcomes
    assert (again.state, again.answer) == ("nothing new", "not searchable")


def test_a_file_that_the_disk_does_not_give_is_a_failed_day(tmp_path: Path) -> None:
    settings = Settings(home=tmp_path / "home", in_situ=None, regions=None)
    (dataset,) = find_datasets(["WI_H1_WAV"])
    path = settings.mirror_root / dataset.folders(DAY)[0] / dataset.name.format(date=f"{DAY:%Y%m%d}", version="01")
    path.parent.mkdir(parents=True)
    path.write_bytes(cdf(1))
    files = Mirror(settings).day(DAY)
    path.unlink()
    with Direct(1, sleep=lambda _: None) as executor:
        from bella.pipeline.run import process_day

        with pytest.raises(StoreError, match="cannot be read"):
            executor.tried(process_day, files, (), run_of(settings))
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        assert catalogue.searched_day(DAY) is None
        assert [(one.stage, one.state) for one in catalogue.stage_runs()] == [("search", "failed")]
    assert FAILED == "failed"


def test_a_file_whose_reader_was_killed_is_read_again(tmp_path: Path) -> None:
    """The process for damaged files may be killed for want of memory: that is no damage."""
    written = simulate_days(tmp_path / "archive", [DAY], 1, ("WI_H1_WAV",))
    assert written
    files = files_of(DAY, sorted((tmp_path / "archive").rglob("*.cdf")))
    whole, _ = day_spectra(files)
    answer, kills = ReaderProcess._answer, [1]

    def killed_once(self: ReaderProcess, process: "subprocess.Popen[bytes]", cpu_s: float) -> object:
        if kills:
            kills.pop()
            process.kill()
            process.wait()
        return answer(self, process, cpu_s)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ReaderProcess, "_answer", killed_once)
        with pytest.raises(WorkerLostError):  # nothing is recorded of the day
            day_spectra(files)
        kills.append(1)
        with Direct(1, sleep=lambda _: None) as executor:
            again, left_out = executor.tried(day_spectra, files)
    assert (not kills, left_out, again.keys()) == (True, (), whole.keys())


def test_a_submission_that_was_changed_fails_once_and_says_why(tmp_path: Path) -> None:
    settings = submitted(tmp_path / "home")
    (table,) = settings.incoming_root.glob("*.csv")
    table.write_text(table.read_text() + "\n")
    assert process_submissions(run_of(settings)) == 0
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        assert catalogue.pending_submissions() == ()
        done = catalogue.submission(table.stem)
    assert (done.state, "was changed after it was submitted" in done.message) == ("failed", True)


def test_a_submission_whose_burst_is_being_done_goes_on_waiting(tmp_path: Path) -> None:
    settings = submitted(tmp_path / "home")
    with (
        closing(Catalogue.open(settings.catalogue_url)) as catalogue,
        catalogue.lease("localise", catalogue.pending_submissions()[0].submission_id, "another", 60.0),
    ):
        assert process_submissions(run_of(settings)) == 0
        assert len(catalogue.pending_submissions()) == 1


@pytest.mark.parametrize("kind", SCIENCE_ERRORS)
def test_errors_of_the_science_are_reasons(kind: type[Exception]) -> None:
    def refuse() -> None:
        raise kind("no mode")

    with pytest.raises(NotPlacedError, match="no mode"):
        computed(refuse)


@pytest.mark.parametrize("error", [StoreError("x"), BusyError("x"), UnreachableError("x"), OSError(28, "full")])
def test_other_errors_are_not(error: Exception) -> None:
    def refuse() -> None:
        raise error

    with pytest.raises(type(error)):
        computed(refuse)
    assert not isinstance(error, SCIENCE_ERRORS)
    assert issubclass(ConvergenceError, SCIENCE_ERRORS)


def test_an_error_that_may_pass_is_tried_again_and_others_are_not() -> None:
    waits: list[float] = []
    attempts: list[int] = []

    def answer(error: Exception, until: int) -> str:
        attempts.append(1)
        if len(attempts) < until:
            raise error
        return "done"

    with Direct(1, sleep=waits.append) as executor:
        assert executor.tried(answer, BusyError("held"), 3) == "done"
        assert waits == [5.0, 30.0]
        attempts.clear()
        with pytest.raises(BusyError):
            executor.tried(answer, BusyError("held"), 9)
        assert len(attempts) == 3
        attempts.clear()
        with pytest.raises(StoreError):
            executor.tried(answer, StoreError("damaged"), 9)
        assert len(attempts) == 1

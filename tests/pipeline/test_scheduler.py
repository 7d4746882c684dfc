"""Workers of a dask scheduler: real ones, killed, of another version, or away."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import distributed
import pytest

from bella.exceptions import InputError, NoDataError, WorkerLostError
from bella.pipeline import scheduler
from bella.pipeline.workers import Workers
from bella.records import DayAnswer
from bella.settings import Settings
from tests.pipeline.test_run import archive_of, contents, process
from tests.pipeline.test_workers import refuse, square

LIMIT_S = 240.0


@dataclass
class Cluster:
    """A scheduler and its workers, each a process of its own."""

    address: str
    folder: Path
    processes: list["subprocess.Popen[bytes]"]

    def add_worker(self, *options: str) -> None:
        command = [sys.executable, "-m", "distributed.cli.dask_worker", self.address, "--no-dashboard", *options]
        environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
        self.processes.append(
            subprocess.Popen([*command, "--local-directory", self.folder], env=environment, start_new_session=True)
        )


@contextmanager
def started(folder: Path) -> Iterator[Cluster]:
    """A scheduler without workers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", f"{port}"]
    first = subprocess.Popen([*command, "--no-dashboard"], start_new_session=True)
    made = Cluster(f"tcp://127.0.0.1:{port}", folder, [first])
    until = time.monotonic() + LIMIT_S
    while socket.socket().connect_ex(("127.0.0.1", port)):
        assert time.monotonic() < until
        time.sleep(0.1)
    yield made
    for one in reversed(made.processes):
        ended(one)


def ended(process: "subprocess.Popen[bytes]") -> None:
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    with started(tmp_path) as made:
        yield made


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with started(tmp_path_factory.mktemp("dask")) as made:
        made.add_worker("--nthreads", "1", "--nworkers", "2")
        yield made


def settings_of(cluster: Cluster, tmp_path: Path) -> Settings:
    return Settings(home=tmp_path / "home", dask=cluster.address)


def killed_once(marker: Path) -> int:
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def test_workers_compute_in_order_and_one_that_is_killed_loses_nothing(two_workers: Cluster, tmp_path: Path) -> None:
    with Workers(1, settings_of(two_workers, tmp_path)) as workers:
        assert workers.map(square, [(3,), (1,), (2,)]) == [9, 1, 4]
        with pytest.raises(NoDataError, match="nothing of 7"):
            workers.call(refuse, 7)
        assert workers.call(os.getpid) not in {os.getpid(), *(one.pid for one in two_workers.processes)}
        assert workers.call(os.getenv, "PREFECT_HOME") is not None, "each computes in the environment of the service"
        assert workers.call(killed_once, tmp_path / "marker") != os.getpid()
        assert (tmp_path / "marker").exists()


def test_a_worker_of_another_version_is_refused(
    two_workers: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scheduler.bella, "__version__", "99.0")
    with (
        Workers(2, settings_of(two_workers, tmp_path)) as workers,
        pytest.raises(InputError, match=r"of bella-service 99\.0"),
    ):
        workers.call(square, 2)


def test_a_worker_of_several_threads_is_refused(two_workers: Cluster, tmp_path: Path) -> None:
    two_workers.add_worker("--nthreads", "2")
    with distributed.Client(two_workers.address) as client:
        client.wait_for_workers(3, timeout=LIMIT_S)
    with Workers(2, settings_of(two_workers, tmp_path)) as workers, pytest.raises(InputError, match="--nthreads 1"):
        workers.call(square, 2)
    ended(two_workers.processes.pop())


def test_a_scheduler_that_is_away_or_alone_is_one_line(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scheduler, "ANSWER_S", 2.0)
    with Workers(2, settings_of(cluster, tmp_path)) as workers:
        with pytest.raises(WorkerLostError, match="has no workers: start some with `dask worker tcp"):
            workers.call(square, 2)
        os.killpg(cluster.processes[0].pid, signal.SIGKILL)
        cluster.processes[0].wait()
        with pytest.raises(WorkerLostError, match="does not answer: start it") as caught:
            workers.call(square, 2)
    assert caught.value.retriable
    assert "\n" not in str(caught.value)


def killed(number: int) -> None:
    os.kill(number, signal.SIGKILL)
    time.sleep(LIMIT_S)


def test_a_scheduler_that_is_killed_beside_the_work_is_an_error_that_may_pass(cluster: Cluster, tmp_path: Path) -> None:
    cluster.add_worker("--nthreads", "1")
    with (
        Workers(2, settings_of(cluster, tmp_path)) as workers,
        pytest.raises(WorkerLostError, match=r"was lost .*try again"),
    ):
        workers.call(killed, cluster.processes[0].pid)


def test_a_home_that_workers_cannot_find_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(distributed, "Client", None)
    with (
        Workers(2, Settings(home=Path("here"), dask="tcp://127.0.0.1:9")) as workers,
        pytest.raises(InputError, match="must be absolute"),
    ):
        workers.call(square, 2)


@pytest.mark.acceptance  # a whole day twice
def test_a_day_is_the_same_to_the_bit_by_workers_of_dask_and_without(two_workers: Cluster, tmp_path: Path) -> None:
    """One burst is localised, the other has a preliminary track: all that is sent to workers, and back."""
    archive = archive_of(tmp_path / "archive")
    found = []
    for name, address in (("alone", ""), ("dask", two_workers.address)):
        settings = Settings(home=tmp_path / name, dask=address, in_situ=None, regions=None, draws=200)
        assert process(settings, archive, 2 if address else 1).answer is DayAnswer.LOCALISED
        found.append(contents(settings))
    assert found[0] == found[1]
    assert len(found[0]) > 3

"""Processes that compute side by side: what they give, what one that is killed leaves, and that none is left behind."""

import functools
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from bella.exceptions import NoDataError, WorkerLostError
from bella.pipeline.workers import LATER_S, Workers
from bella.settings import Settings
from tests.waiting import until


def square(number: int) -> int:
    return number * number


def refuse(number: int) -> int:
    raise NoDataError(f"nothing of {number}")


def killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def check_order_and_errors(workers: Workers) -> None:
    assert workers.map(square, [(3,), (1,), (2,)]) == [9, 1, 4]
    with pytest.raises(NoDataError, match="nothing of 7"):
        workers.call(refuse, 7)


def test_results_come_in_the_order_of_what_was_asked_from_this_process_too(tmp_path: Path) -> None:
    with Workers(1, Settings(home=tmp_path)) as workers:
        workers.start()
        check_order_and_errors(workers)
        assert multiprocessing.active_children() == []


def test_processes_keep_the_order_have_one_thread_and_one_that_is_killed_is_an_error_that_may_pass(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    with Workers(2, Settings(home=tmp_path)) as workers:
        check_order_and_errors(workers)
        assert workers.call(os.getenv, "OMP_NUM_THREADS") == "1"
        with pytest.raises(WorkerLostError, match="try again") as caught:
            workers.map(killed, [(), (), ()])
        assert caught.value.retriable
        assert workers.map(square, [(1,), (2,), (3,)]) == [1, 4, 9], "its place is free again"
    assert multiprocessing.active_children() == []


def test_processes_begin_to_load_before_they_are_asked_for_anything(tmp_path: Path) -> None:
    with Workers(2, Settings(home=tmp_path)) as workers:
        workers.start()
        started = multiprocessing.active_children()
        assert len(started) == 2
        for one in started:  # what they load is used in `test_run.py`
            one.kill()


@pytest.mark.parametrize("number", [1, 2])
def test_the_most_urgent_is_begun_first_and_of_equals_the_first(number: int, tmp_path: Path) -> None:
    with Workers(number, Settings(home=tmp_path)) as workers:
        begun: dict[str, int] = {}
        for _ in range(number):
            workers._turns.take(0.0)
        threads = []
        for name, urgency in (("old", 1.0), ("later", 1.0 - LATER_S), ("new", 2.0), ("old too", 1.0)):
            wait = functools.partial(_noted, workers, begun, name, urgency)
            threads.append(threading.Thread(target=wait))
            threads[-1].start()
            until(lambda: len(workers._turns._waiting) == len(threads))
        workers._turns.give()
        for thread in threads:
            thread.join()
        assert sorted(begun, key=begun.__getitem__) == ["new", "old", "old too", "later"]


def _noted(workers: Workers, begun: dict[str, int], name: str, urgency: float) -> None:
    begun[name] = workers.call(time.monotonic_ns, urgency=urgency)


PARENT = """
import sys, time
from bella.pipeline.workers import Workers
from bella.settings import Settings
import os

if __name__ == "__main__":
    with Workers(2, Settings()) as workers:
        print(workers.call(os.getpid), flush=True)
        time.sleep(600)
"""


def test_workers_end_with_the_process_that_started_them(tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(PARENT)
    environment = os.environ | {"BELLA_HOME": str(tmp_path / "home")}
    parent = subprocess.Popen([sys.executable, tmp_path / "parent.py"], env=environment, stdout=subprocess.PIPE)
    assert parent.stdout is not None
    worker = Path("/proc") / parent.stdout.readline().decode().strip()
    assert worker.is_dir()
    parent.kill()
    parent.wait()
    parent.stdout.close()
    until(lambda: not worker.is_dir() or "State:\tZ" in (worker / "status").read_text())


WATCH = """
import os, sys
class Watch:
    def find_spec(name, *_):
        if name == "numpy":
            print(os.environ.get("OPENBLAS_NUM_THREADS"), os.environ.get("OMP_NUM_THREADS"), flush=True)
            os._exit(0)
sys.meta_path.insert(0, Watch)
import {module}
"""


@pytest.mark.parametrize("module", ["bella.cli", "flows.days"])
def test_linear_algebra_has_one_thread_before_it_is_loaded_unless_an_operator_says_otherwise(module: str) -> None:
    kept = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    for more, said in (({}, "1 1"), ({"OMP_NUM_THREADS": "4"}, "1 4")):
        code = [sys.executable, "-c", WATCH.format(module=module)]
        done = subprocess.run(code, env=kept | more, capture_output=True, text=True, check=True)
        assert done.stdout.strip() == said

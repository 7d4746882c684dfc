"""Processes that compute side by side. What a result is does not depend on how many there are.

Each process opens its own catalogue, computes with one thread, and ends when the process that started it does.
"""

import contextlib
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import parent_process
from pathlib import Path
from typing import Any, Self, TypeVar

from bella.exceptions import WorkerLostError
from bella.logs import log_to
from bella.pipeline.environment import prepare
from bella.settings import Settings
from bella.threads import ONE_THREAD

T = TypeVar("T")
ORPHANED = 3
"""Exit status of a worker whose parent has gone."""


class Workers:
    """A pool of processes; with one worker everything is computed in this process.

    Parameters
    ----------
    number : int
    settings : Settings
        Of the workers too.
    log : Path or None
        Where the workers log to; None for standard error.
    """

    def __init__(self, number: int, settings: Settings, log: Path | None = None) -> None:
        self.number = number
        self._given = (settings, log)
        self._pool: ProcessPoolExecutor | None = None
        self._turn = threading.Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self._turn:
            if self._pool is not None:
                self._pool.shutdown(cancel_futures=True)
                self._pool = None

    def call(self, function: Callable[..., T], *arguments: Any) -> T:
        """Result of a function of a module, computed by a worker.

        Raises
        ------
        WorkerLostError
            If the worker was killed; a later call starts others.
        """
        (result,) = self.map(function, [arguments])
        return result

    def map(self, function: Callable[..., T], arguments: Iterable[tuple[Any, ...]]) -> list[T]:
        """Results of a function for several arguments, in their order; see :meth:`call`."""
        if self.number == 1:
            return [function(*each) for each in arguments]
        with self._started() as pool:
            futures: list[Future[T]] = [pool.submit(function, *each) for each in arguments]
            return [future.result() for future in futures]

    @contextlib.contextmanager
    def _started(self) -> Iterator[ProcessPoolExecutor]:
        with self._turn:
            if self._pool is None:
                os.environ.update({**ONE_THREAD, **os.environ})  # the processes that are started have it too
                context = multiprocessing.get_context("spawn")
                self._pool = ProcessPoolExecutor(
                    self.number, mp_context=context, initializer=_begin, initargs=self._given
                )
            pool = self._pool
        try:
            yield pool
        except BrokenProcessPool as error:
            with self._turn:
                if self._pool is pool:
                    self._pool = None
            raise WorkerLostError("a worker process was killed, perhaps for want of memory: try again") from error


def _begin(settings: Settings, log: Path | None) -> None:
    """Make a process that was just started ready to compute."""
    threading.Thread(target=_end_with_parent, name="parent watch", daemon=True).start()
    prepare(settings)
    log_to(log)


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(ORPHANED)

"""Processes that compute in parallel, and the environment in which each computes.

What a result is does not depend on how many there are. Each process opens its own catalogue, computes with one thread,
and ends when the process that started it does.
"""

import contextlib
import itertools
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from multiprocessing.process import parent_process
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar, cast

from bella.exceptions import WorkerLostError
from bella.logs import log_to
from bella.settings import Settings, make_folder
from bella.spacecraft import extend_with
from bella.threads import ONE_THREAD

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess

    from bella.pipeline.scheduler import Scheduler

T = TypeVar("T")
LATER_S = 1e10
"""Is taken off the urgency of what can wait, s: more than all time since 1970."""

ORPHANED = 3
"""Exit status of a worker whose parent has gone."""


def prepare(settings: Settings) -> None:
    """Point every library that writes files at the home folder, and turn off what would call home.

    To be called before Prefect, matplotlib, numba or PyTensor are imported, which read these variables then. One that
    is set already is left as it is: an operator's choice wins. Positions of spacecraft go on with the table that the
    home folder holds, if it holds one.

    Raises
    ------
    InputError
        If the home folder cannot be made.
    """
    home, cache = settings.home.resolve(), settings.cache_root.resolve()
    make_folder(cache)
    for name, value in {
        "PREFECT_HOME": home / "prefect",
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "PREFECT_LOGGING_LEVEL": "CRITICAL",
        "PREFECT_INTERNAL_LOGGING_LEVEL": "CRITICAL",  # events cut short when the server ends are no news
        "PREFECT_SERVER_LOGGING_LEVEL": "CRITICAL",
        "PREFECT_LOGGING_TO_API_ENABLED": "false",
        "PREFECT_CLI_PROMPT": "false",
        "PREFECT_SERVER_UI_ENABLED": "false",
        "PREFECT_API_BLOCKS_REGISTER_ON_START": "false",  # none is used, and they take a second of the first start
        "DO_NOT_TRACK": "1",
        "MPLCONFIGDIR": cache / "matplotlib",
        "NUMBA_CACHE_DIR": cache / "numba",
        "PYTENSOR_FLAGS": f"base_compiledir={cache / 'pytensor'}",
        "XDG_CACHE_HOME": cache,
        "XDG_CONFIG_HOME": cache,
    }.items():
        os.environ.setdefault(name, str(value))
    extend_with(settings.ephemeris_extension)


class Turns:
    """Places to work at: each goes to the most urgent that waits, of equals to the first.

    Parameters
    ----------
    number : int
        Of places.
    """

    def __init__(self, number: int) -> None:
        self._free = number
        self._order = itertools.count()
        self._waiting: list[tuple[float, int]] = []
        self._changed = threading.Condition()

    def take(self, urgency: float) -> None:
        """Wait for a place."""
        with self._changed:
            own = (-urgency, next(self._order))
            self._waiting.append(own)
            try:
                self._changed.wait_for(lambda: self._free > 0 and own == min(self._waiting))
                self._free -= 1
            finally:
                self._waiting.remove(own)
                self._changed.notify_all()

    def give(self) -> None:
        """Leave a place to others."""
        with self._changed:
            self._free += 1
            self._changed.notify_all()


class Workers:
    """A pool of processes; with one worker everything is computed in this process.

    What is asked of them while all are busy waits, and the most urgent is begun first.

    Where settings name a dask scheduler, its workers compute instead, see :mod:`bella.pipeline.scheduler`.

    Parameters
    ----------
    settings : Settings
        Of the workers too.
    log : Path or None
        Where the workers log to; None for standard error.
    """

    def __init__(self, number: int, settings: Settings, log: Path | None = None) -> None:
        self.number = number
        self._given = (settings, log)
        self._pool: ProcessPoolExecutor | None = None
        self._scheduler: Scheduler | None = None
        self._turn = threading.Lock()
        self._turns = Turns(number)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self._turn:
            if self._pool is not None:
                self._pool.shutdown(cancel_futures=True)
                self._pool = None
            if self._scheduler is not None:
                self._scheduler.close()
                self._scheduler = None

    def start(self) -> None:
        """Let the processes begin to load what they need, so that the first who asks does not wait for that."""
        if self.number > 1 and not self._given[0].dask:
            for _ in range(self.number):
                self._processes().submit(import_module, "bella.pipeline.run")

    def call(self, function: Callable[..., T], *arguments: Any, urgency: float = 0.0) -> T:
        """Result of a function of a module, computed by a worker.

        Parameters
        ----------
        urgency : float
            The greater begins first.

        Raises
        ------
        WorkerLostError
            If the worker was killed; a later call starts others.
        """
        (result,) = self.map(function, [arguments], urgency)
        return result

    def map(self, function: Callable[..., T], arguments: Iterable[tuple[Any, ...]], urgency: float = 0.0) -> list[T]:
        """Results of a function for several arguments, in their order; see :meth:`call`."""
        if self._given[0].dask:
            return self._connected().map(function, arguments, urgency)
        if self.number == 1:
            return [self._here(function, each, urgency) for each in arguments]
        given = [self._submitted(function, each, urgency) for each in arguments]
        results = []
        for pool, future in given:
            with self._whole(pool):
                results.append(future.result())
        return results

    def _here(self, function: Callable[..., T], arguments: tuple[Any, ...], urgency: float) -> T:
        self._turns.take(urgency)
        try:
            return function(*arguments)
        finally:
            self._turns.give()

    def _submitted(
        self, function: Callable[..., T], arguments: tuple[Any, ...], urgency: float
    ) -> "tuple[ProcessPoolExecutor, Future[T]]":
        self._turns.take(urgency)
        try:
            pool = self._processes()
            with self._whole(pool):
                future = pool.submit(function, *arguments)
        except BaseException:
            self._turns.give()
            raise
        future.add_done_callback(lambda _: self._turns.give())
        return pool, future

    def _connected(self) -> "Scheduler":
        from bella.pipeline.scheduler import Scheduler  # noqa: PLC0415 - an extra of its own

        with self._turn:
            if self._scheduler is None:
                self._scheduler = Scheduler(self._given[0])
            return self._scheduler

    def _processes(self) -> ProcessPoolExecutor:
        with self._turn:
            if self._pool is None:
                os.environ.update({**ONE_THREAD, **os.environ})  # the processes that are started have it too
                context = multiprocessing.get_context("spawn")
                self._pool = ProcessPoolExecutor(
                    self.number, mp_context=context, initializer=_begin, initargs=self._given
                )
            return self._pool

    @contextlib.contextmanager
    def _whole(self, pool: ProcessPoolExecutor) -> Iterator[None]:
        """Give up a pool of which a process was killed: the next call starts another."""
        try:
            yield
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
    cast("BaseProcess", parent_process()).join()  # a process that was spawned has one
    os._exit(ORPHANED)

"""Processes that compute in parallel, and the environment in which each computes.

What a result is does not depend on how many there are. Each process opens its own catalogue, computes with one thread,
and ends when the process that started it does.
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
from typing import TYPE_CHECKING, Any, Self, TypeVar

from bella.exceptions import InputError, WorkerLostError
from bella.logs import log_to
from bella.settings import Settings
from bella.spacecraft import extend_with
from bella.threads import ONE_THREAD

if TYPE_CHECKING:
    from bella.pipeline.scheduler import Scheduler

T = TypeVar("T")
ORPHANED = 3
"""Exit status of a worker whose parent has gone."""


def prepare(settings: Settings) -> None:
    """Point every library that writes files at the home folder, and turn off what would call home.

    To be called before Prefect, matplotlib, numba or PyTensor are imported, which read these variables then. One that
    is set already is left as it is: an operator's choice wins. Positions of spacecraft go on with the table that the
    home folder holds, if it holds one.

    Parameters
    ----------
    settings : Settings

    Raises
    ------
    InputError
        If the home folder cannot be made.
    """
    home, cache = settings.home.resolve(), settings.cache_root.resolve()
    try:
        cache.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"home folder {home}: {error.strerror}; name another with --home or BELLA_HOME") from error
    for name, value in {
        "PREFECT_HOME": home / "prefect",
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "PREFECT_LOGGING_LEVEL": "CRITICAL",
        "PREFECT_INTERNAL_LOGGING_LEVEL": "CRITICAL",  # events cut short when the server ends are no news
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


class Workers:
    """A pool of processes; with one worker everything is computed in this process.

    Where settings name a dask scheduler, its workers compute instead, see :mod:`bella.pipeline.scheduler`.

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
        self._scheduler: Scheduler | None = None
        self._turn = threading.Lock()

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
        if self._given[0].dask:
            return self._connected().map(function, arguments)
        if self.number == 1:
            return [function(*each) for each in arguments]
        with self._started() as pool:
            futures: list[Future[T]] = [pool.submit(function, *each) for each in arguments]
            return [future.result() for future in futures]

    def _connected(self) -> "Scheduler":
        from bella.pipeline.scheduler import Scheduler  # noqa: PLC0415 - an extra of its own

        with self._turn:
            if self._scheduler is None:
                self._scheduler = Scheduler(self._given[0])
            return self._scheduler

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

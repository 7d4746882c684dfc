"""Workers on other machines: a dask scheduler in place of the pool of processes of this machine.

The scheduler hands each day and each burst to one of its workers. All of them see the same home folder and the same
database, and have this version of the software; a worker that is killed has its work done by another.
"""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar, cast

import bella
from bella.exceptions import InputError, WorkerLostError, require_extra
from bella.logs import log_to
from bella.pipeline.workers import prepare
from bella.settings import Settings

require_extra("distributed")

import distributed  # noqa: E402
from distributed.comm.core import CommClosedError  # noqa: E402

T = TypeVar("T")
ANSWER_S = 30.0
"""Time within which scheduler and workers must answer, s."""

LOST = (distributed.KilledWorker, distributed.CancelledError, CommClosedError, OSError, TimeoutError)
"""What a result raises where its worker, or the scheduler, has gone."""


class Scheduler:
    """Connection to a dask scheduler.

    Parameters
    ----------
    settings : Settings
        `dask` is the address of the scheduler; `home` must be absolute, for the workers find it there too.

    Raises
    ------
    WorkerLostError
        If the scheduler does not answer or has no workers.
    InputError
        If the home folder is not absolute, or a worker has another version or several threads.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings, address = settings, settings.dask
        if not settings.home.is_absolute():
            raise InputError(
                f"home folder {settings.home}: with BELLA_DASK it must be absolute, and all workers share it"
            )
        try:
            self._client = distributed.Client(address, timeout=ANSWER_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise WorkerLostError(
                f"the scheduler {address} does not answer: start it with `dask scheduler`, or unset BELLA_DASK"
            ) from error
        try:
            self._check_workers(address)
        except BaseException:
            self.close()
            raise

    def map(self, function: Callable[..., T], arguments: Iterable[tuple[Any, ...]], urgency: float = 0.0) -> list[T]:
        """Results of a function of a module for several arguments, in their order; the more urgent begin first.

        Raises
        ------
        WorkerLostError
            If three workers in turn were killed over one of them, or the scheduler has gone.
        """
        given = [(self._settings, function, *each) for each in arguments]
        futures = [self._client.submit(on_worker, *each, pure=False, priority=urgency) for each in given]
        try:
            return cast("list[T]", self._client.gather(futures))
        except LOST as error:
            cause = str(error).partition("\n")[0]
            raise WorkerLostError(
                f"a worker or the scheduler {self._settings.dask} was lost ({cause}): try again"
            ) from error

    def _check_workers(self, address: str | None) -> None:
        try:
            self._client.wait_for_workers(1, timeout=ANSWER_S)
            versions = self._client.run(_version)
        except LOST as error:
            raise WorkerLostError(
                f"the scheduler {address} has no workers: start some with `dask worker {address} --nthreads 1`"
            ) from error
        wrong = sorted(f"{name} has {one}" for name, one in versions.items() if one != bella.__version__)
        if wrong:
            raise InputError(f"worker {wrong[0]}, this run is of bella-service {bella.__version__}: install it there")
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        threads = sorted(one["name"] for one in workers if one["nthreads"] > 1)
        if threads:
            raise InputError(f"worker {threads[0]} has several threads: start workers with --nthreads 1")

    def close(self) -> None:
        """Leave the scheduler; what it still computes is given up."""
        self._client.close()


def on_worker(settings: Settings, function: Callable[..., T], *arguments: Any) -> T:
    """Result of a function, in the environment in which the service computes."""
    prepare(settings)
    log_to(None)
    return function(*arguments)


def _version() -> str:
    return bella.__version__

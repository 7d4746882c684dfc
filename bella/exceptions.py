"""One tree of errors.

Every message is one line that names what is wrong and says what to do next. Whether trying again can help is a
property of the class, so that a flow decides on retries without reading messages.
"""

from importlib.util import find_spec
from typing import ClassVar

EXTRA_OF = {
    "alembic": "service",
    "arviz": "reference",
    "distributed": "scale",
    "fastapi": "service",
    "matplotlib": "plot",
    "nutpie": "reference",
    "prefect": "service",
    "pyarrow": "parquet",
    "pymc": "reference",
    "radiospectra": "radiospectra",
    "sqlalchemy": "service",
    "typst": "plot",
    "uvicorn": "service",
    "zarr": "zarr",
}
"""Packages that a light installation does not have, and the extra that brings each."""


class BellaError(Exception):
    """Root of all errors raised on purpose.

    Attributes
    ----------
    retriable : bool
        True where the same call may succeed later without any change of its input.
    exit_code : int
        Exit status of the command line: 1 for failed, 2 for bad input.
    """

    retriable: ClassVar[bool] = False
    exit_code: ClassVar[int] = 1


class InputError(BellaError):
    """What the caller handed over is wrong; the message names the row, column or option."""

    exit_code: ClassVar[int] = 2


class GeometryError(InputError):
    """The positions of the receivers do not allow the question that was asked."""


class NoDataError(BellaError):
    """What was asked for does not exist: no such burst, no data for this time."""


class NotPlacedError(NoDataError):
    """The arrival times of a burst do not say where it was, for the reason that the message gives."""


class ConvergenceError(BellaError):
    """A sampler or solver ended without an answer that can be trusted."""


class StoreError(BellaError):
    """The catalogue or the posterior store is damaged, or of a version this code does not know."""


class BusyError(BellaError):
    """Another run is at work on the same subject, or a queue is full: try again later."""

    retriable: ClassVar[bool] = True


class UnreachableError(BellaError):
    """A service this work needs (database, archive) did not answer: try again later."""

    retriable: ClassVar[bool] = True


class WorkerLostError(BellaError):
    """A process that computes was killed, perhaps for want of memory: try again."""

    retriable: ClassVar[bool] = True


class MissingExtraError(BellaError, ImportError):
    """A package that this work needs is not installed: the message says how to install it."""


def require_extra(package: str) -> None:
    """Refuse to go on without a package that an extra brings.

    Parameters
    ----------
    package : str
        One of `EXTRA_OF`.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    if find_spec(package) is None:
        raise MissingExtraError(
            f"the package {package} is not installed: pip install 'bella-service[{EXTRA_OF[package]}]'"
        )

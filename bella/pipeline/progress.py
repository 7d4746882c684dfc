"""How far a run is, told to whoever asked: the command line draws bars, a worker does not listen."""

from collections.abc import Callable
from contextvars import ContextVar

Listener = Callable[[str, int, int], None]
"""Called with the stage, the steps done, and the steps there are."""

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


def listen(listener: Listener) -> None:
    """Tell `listener` from now on, in this context."""
    _listener.set(listener)


def counter(stage: str, total: int) -> Callable[[int], None]:
    """Count steps of a stage.

    Parameters
    ----------
    total : int
        Steps there are.

    Returns
    -------
    callable
        To be told how many steps are done since its last call.
    """
    done = 0

    def _advance(steps: int) -> None:
        nonlocal done
        done += steps
        listener = _listener.get()
        if listener is not None:
            listener(stage, done, total)

    _advance(0)
    return _advance

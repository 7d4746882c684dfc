"""Wait for what another thread or process does, on a machine that may be busy with something else."""

import time
from collections.abc import Callable

PATIENCE_S = 1800.0
"""Only a test that fails waits so long: no test says that something is quick."""


def until(condition: Callable[[], object], what: Callable[[], str] | str = "", pause_s: float = 0.05) -> None:
    """Wait for a condition; AssertionError where it does not come.

    A condition that costs the machine something, such as a request, is asked after a longer pause.
    """
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, f"not within {PATIENCE_S:g} s: {what() if callable(what) else what}"
        time.sleep(pause_s)

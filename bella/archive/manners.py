"""How an archive is treated: requests are spaced, and repeated only where that can help and not for ever."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from bella.exceptions import UnreachableError

LONGEST_WAIT_S = 60.0
Result = TypeVar("Result")


class TryAgainError(UnreachableError):
    """The archive failed in a way that may be over in seconds: worth another attempt within this run.

    Attributes
    ----------
    wait_s : float
        Least time the archive asked to wait, s.
    """

    def __init__(self, message: str, wait_s: float = 0.0) -> None:
        super().__init__(message)
        self.wait_s = wait_s


@dataclass
class Manners:
    """Pace and patience of one run towards one archive.

    Attributes
    ----------
    interval_s : float
        Least time between two requests, s.
    attempts : int
        Attempts per request, 1 or more.
    budget : int
        Further attempts left to the whole run: an archive that is down is not asked for every file.
    clock, sleep : callable
        Time, s, and a pause of so many seconds.
    """

    interval_s: float = 1.0
    attempts: int = 4
    budget: int = 20
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep
    _next_s: float = field(default=float("-inf"), init=False)
    _given_up: str = field(default="", init=False)

    def persist(self, action: Callable[[], Result]) -> Result:
        """Do something with the archive, again and again if need be.

        Parameters
        ----------
        action : callable
            One request; raises :class:`TryAgainError` where another attempt can help.

        Returns
        -------
        object
            What the action returned.

        Raises
        ------
        UnreachableError
            If no attempt succeeded, at once where earlier requests have used up the budget.
        """
        for attempt in range(self.attempts):
            self._pace()
            try:
                return action()
            except TryAgainError as error:
                if not self._goes_on(attempt, str(error)):
                    raise
                self.sleep(max(2.0**attempt, min(error.wait_s, LONGEST_WAIT_S)))
        raise AssertionError("unreachable")  # pragma: no cover

    def _pace(self) -> None:
        if self._given_up:
            raise UnreachableError(f"the archive is not asked again in this run, it failed too often: {self._given_up}")
        now = self.clock()
        if now < self._next_s:
            self.sleep(self._next_s - now)
        self._next_s = max(now, self._next_s) + self.interval_s

    def _goes_on(self, attempt: int, reason: str) -> bool:
        if self.budget <= 0:
            self._given_up = reason
            return False
        self.budget -= 1
        return attempt + 1 < self.attempts

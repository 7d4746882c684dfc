"""What became of days, and whether a run has done what it was asked for."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from typing import Any

from bella.exceptions import BellaError
from bella.pipeline.burst import Outcome
from bella.records import DayAnswer

NOTHING_NEW, SEARCHED, FAILED, OVERTAKEN = "nothing new", "searched", "failed", "overtaken"
UNANSWERED = (DayAnswer.ARCHIVE_SILENT, DayAnswer.NOT_SEARCHABLE)
"""Answers about a day that end a run as failed: they say that something has to be mended or asked again."""

LEFT_OUT, NOT_SEARCHED = "left out: ", "not searchable: "
"""Begin what the reason of a searched day says of its files, and of its spacecraft."""


@dataclass(frozen=True)
class DayOutcome:
    """What became of a day.

    Attributes
    ----------
    state : str
        "searched"; "nothing new": the same files were searched before; "failed": tried again by the next run;
        "overtaken": newer files have come, and it is begun again with them; or the answer, where there was nothing to
        search.
    answer : DayAnswer or None
        None where the run failed.
    observatories : tuple of str
        That had data.
    detections, bursts : int
        Accepted detections, and bursts that two or more spacecraft or one received.
    preliminary : tuple of Outcome
        Of bursts that two spacecraft received.
    refused : tuple of (str, str)
        Bursts that were not localised, and why.
    message : str
        Why it failed, could not be searched, or was searched without some files; empty otherwise.
    """

    day: date
    state: str
    answer: DayAnswer | None = None
    observatories: tuple[str, ...] = ()
    detections: int = 0
    bursts: int = 0
    localised: tuple[Outcome, ...] = ()
    preliminary: tuple[Outcome, ...] = ()
    refused: tuple[tuple[str, str], ...] = ()
    message: str = ""

    @property
    def new(self) -> int:
        """How many solutions were published."""
        return sum(one.new for one in (*self.localised, *self.preliminary))

    @property
    def is_whole(self) -> bool:
        """Whether no file of the day was left out: also of one that an earlier run has searched."""
        return LEFT_OUT not in self.message


def remarks(left_out: Sequence[str], not_searchable: Sequence[str]) -> str:
    """What the reason of a day says of files that were left out and spacecraft that could not be searched.

    Parameters
    ----------
    left_out, not_searchable : sequence of str
        Names, each with its reason.

    Returns
    -------
    str
        Empty where there are none.
    """
    said = [f"{LEFT_OUT}{'; '.join(left_out)}"] if left_out else []
    said += [f"{NOT_SEARCHED}{'; '.join(not_searchable)}"] if not_searchable else []
    return "; ".join(said)


class UnfinishedError(BellaError):
    """Days that failed, could not be searched, or that the archive did not answer for.

    Attributes
    ----------
    outcomes : tuple of DayOutcome
        Of all days of the run.
    """

    def __init__(self, message: str, outcomes: Sequence[DayOutcome]) -> None:
        super().__init__(message)
        self.outcomes = tuple(outcomes)

    def __reduce__(self) -> tuple[type["UnfinishedError"], tuple[str, tuple[DayOutcome, ...]]]:
        return UnfinishedError, (str(self), self.outcomes)


def check_finished(
    outcomes: Sequence[DayOutcome],
    unreachable: Sequence[str] = (),
    left_out: Sequence[str] = (),
    *,
    is_asked_for: bool = True,
) -> None:
    """Refuse to call a run done that is not.

    Parameters
    ----------
    unreachable : sequence of str
        Data sets that the archive did not answer for, each with the reason.
    left_out : sequence of str
        Files of a folder that cannot be read, each with the reason.
    is_asked_for : bool
        Whether somebody waits for these days: then one that was searched without some of its files is not done, nor is
        one for which the archive was silent. On a schedule both are, until files come: the fetcher says who is silent.

    Raises
    ------
    UnfinishedError
        In one line.
    """
    unanswered = UNANSWERED if is_asked_for else {DayAnswer.NOT_SEARCHABLE}
    open_days = [one for one in outcomes if one.state == FAILED or one.answer in unanswered]
    if open_days:
        first = open_days[0]
        said = first.message or f"{first.answer}"
        word = "days are" if len(open_days) > 1 else "day is"
        raise UnfinishedError(f"{len(open_days)} of {len(outcomes)} {word} not done: {first.day} {said}", outcomes)
    parts = [one for one in outcomes if not one.is_whole]
    if is_asked_for and parts:
        word = "days were" if len(parts) > 1 else "day was"
        said = f"{parts[0].day} {parts[0].message}"
        raise UnfinishedError(f"{len(parts)} of {len(outcomes)} {word} searched without some files: {said}", outcomes)
    if left_out:
        number = f"{len(left_out)} files were" if len(left_out) > 1 else "a file was"
        raise UnfinishedError(f"{number} left out: {left_out[0]}", outcomes)
    if unreachable:
        number = f"{len(unreachable)} data sets" if len(unreachable) > 1 else "a data set"
        raise UnfinishedError(f"{number} could not be asked for, run it again later: {unreachable[0]}", outcomes)


def summary_rows(outcomes: Iterable[DayOutcome]) -> Iterator[dict[str, Any]]:
    """One line for every day of a run."""
    for one in outcomes:
        published = (*one.localised, *one.preliminary)
        yield {
            "day": f"{one.day}",
            "state": one.state,
            "answer": one.answer.value if one.answer else None,
            "observatories": list(one.observatories),
            "detections": one.detections,
            "bursts": one.bursts,
            "localised": _bursts_of(one.localised),
            "preliminary": _bursts_of(one.preliminary),
            "answers": {
                solution.burst_id: solution.answer.sentence
                for solution in (outcome.solution for outcome in published)
                if solution.preferred
            },
            "refused": [{"burst_id": name, "reason": reason} for name, reason in one.refused],
            "message": one.message,
        }


def _bursts_of(outcomes: Iterable[Outcome]) -> list[str]:
    return sorted({outcome.solution.burst_id for outcome in outcomes})

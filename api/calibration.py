"""How often simulated bursts like a real one were answered rightly, as the replies, the page and the lists say it."""

from collections.abc import Sequence
from functools import cache

from pydantic import Field

from api.replies import Reply
from bella.calibration.found_table import FoundRow
from bella.calibration.tried import NOT_TRIED, PAGE, Answered, Tried, tried
from bella.catalogue import Solution


class CalibrationRowReply(Reply):
    """How often the intervals of one number held the truth of simulated bursts."""

    quantity: str = Field(description="position, phi0 (longitude of the spiral at 1 solar radius), wind or beam.")
    unit: str = Field(description="Of median_error and median_width.")
    edge: str = Field(description="Edge by which these bursts were timed; all where the row is of a grade.")
    grade: str = Field(description="Grade of their answers; all where the row is of an edge.")
    bursts: int = Field(description="Simulated bursts with this number.")
    cover68: float | None = Field(description="Share of truths inside the 68 % interval, and its 95 % Wilson interval.")
    cover68_low: float | None
    cover68_high: float | None
    cover95: float | None = Field(description="Share of truths inside the 95 % interval, and its 95 % Wilson interval.")
    cover95_low: float | None
    cover95_high: float | None
    median_error: float | None = Field(description="Median distance from estimate to truth.")
    median_width: float | None = Field(description="Median width of the 68 % interval.")
    seed: int = Field(description="Of the simulation.")
    bella_version: str = Field(description="That was tried.")

    @classmethod
    def of(cls, row: FoundRow) -> "CalibrationRowReply":
        """Reply for a row of the published table."""
        return cls.model_validate(row, from_attributes=True)


class CalibrationReply(Reply):
    """Simulated bursts that are like a real one, and how often their intervals held the truth."""

    stratum: str | None = Field(description="Which simulated bursts they are; null where none is like it.")
    sentence: str = Field(description="How often the 68 % intervals of their longitude held the truth.")
    rows: list[CalibrationRowReply] = Field(description="Of those with this edge, then of those with this grade.")
    page: str = Field(PAGE, description="The report on all simulated bursts, in the documentation of the software.")

    @classmethod
    def of(cls, found: Tried | None) -> "CalibrationReply":
        """Reply for what was found in the published table."""
        if found is None:
            return cls(stratum=None, sentence=NOT_TRIED, rows=[])
        return cls(
            stratum=found.stratum, sentence=found.sentence, rows=[CalibrationRowReply.of(one) for one in found.rows]
        )


def calibration_of(solution: Solution, observatories: Sequence[str]) -> CalibrationReply:
    """Simulated bursts like one that a solution places; no rows where none is.

    Parameters
    ----------
    solution : Solution
    observatories : sequence of str
        That received the burst.

    Returns
    -------
    CalibrationReply
    """
    series, answer = solution.series, solution.answer
    real = Answered(
        len(observatories),
        series.edge,
        answer.tier,
        answer.grade,
        method=series.method,
        preset=series.preset,
        origin=solution.origin,
    )
    return _reply_of(real)


@cache
def _reply_of(real: Answered) -> CalibrationReply:
    """Reply for one way of answering: there are few, and every burst of a list has one."""
    return CalibrationReply.of(tried(real))

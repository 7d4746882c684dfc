"""Replies about detections and searched days."""

from dataclasses import asdict
from datetime import date, datetime
from math import isnan

from pydantic import Field

from api.addresses import day_links
from api.replies import ORIGIN, PageReply, Reply
from bella.catalogue import UNSEARCHED, DaySummary, Detection, SearchedDay
from bella.records import DayAnswer, Origin


class DetectionReply(Reply):
    """A burst as one spacecraft received it."""

    observatory: str
    start_utc: datetime = Field(description="Onset at the highest frequency.")
    peak_utc: datetime
    end_utc: datetime
    f_low_mhz: float
    f_high_mhz: float
    score: float = Field(description="Of the matched filter, in standard deviations of noise.")
    drift: float = Field(description="Speed of the beam whose drift fits best, in units of c.")
    peak_db: float = Field(description="Peak over background, dB.")
    flux_sfu_1au: float | None = Field(description="Largest flux density at 1 au, sfu; null where not stated.")
    channels: int
    isolated: bool
    tier: str = Field(description="localisable, catalogued or rejected.")
    reason: str = Field(description="Why it is no more; empty where the burst was localised.")
    burst_id: str | None = Field(description="Burst that it belongs to; null where it was rejected.")
    origin: Origin = Field(description=ORIGIN)

    @classmethod
    def of(cls, one: Detection) -> "DetectionReply":
        """Reply for a detection of the catalogue."""
        flux = None if isnan(one.flux_sfu_1au) else one.flux_sfu_1au
        return cls(**(asdict(one) | {"burst_id": one.burst_id or None, "flux_sfu_1au": flux}))


class DetectionsReply(PageReply):
    """One page of detections."""

    detections: list[DetectionReply]


class DayReply(Reply):
    """What is known of a day."""

    day: date
    searched: bool = Field(description="False where no file of the day was processed.")
    origin: Origin | None = Field(description=ORIGIN)
    answer: DayAnswer | None = Field(description="What can be said of the day; null where it was not looked at.")
    reason: str = Field(description="Why it could not be searched, or which files were left out; mostly empty.")
    observatories: list[str] = Field(description="Spacecraft that had data; the others had none.")
    code_version: str | None

    @classmethod
    def of(cls, day: date, known: SearchedDay | None) -> "DayReply":
        """Reply for a day, with what the catalogue has of it."""
        if known is None:
            return cls(
                day=day, searched=False, answer=None, reason="", origin=None, observatories=[], code_version=None
            )
        return cls(
            day=day,
            searched=known.answer not in UNSEARCHED,
            answer=known.answer,
            reason=known.reason,
            origin=known.origin,
            observatories=list(known.observatories),
            code_version=known.code_version,
        )


class DaySummaryReply(Reply):
    """A searched day with how much was received on it, in data of one origin."""

    day: date
    origin: Origin = Field(description=ORIGIN)
    answer: DayAnswer = Field(description="What can be said of the day.")
    reason: str = Field(description="Why it could not be searched, or which files were left out; mostly empty.")
    observatories: list[str] = Field(description="Spacecraft that had data; the others had none.")
    detections: int = Field(description="Bursts as single spacecraft received them.")
    rejected: int = Field(description="Candidates that were refused.")
    bursts: int = Field(description="Bursts, each counted once whoever received it.")
    shared: int = Field(description="Of these, received by two or more spacecraft.")
    localised: int = Field(description="Of these, those with a position.")
    code_version: str
    links: dict[str, str]

    @classmethod
    def of(cls, one: DaySummary) -> "DaySummaryReply":
        """Reply for a searched day of the catalogue."""
        counts = {name: getattr(one, name) for name in ("detections", "rejected", "bursts", "shared", "localised")}
        known = one.searched
        return cls(
            day=known.day,
            origin=known.origin,
            answer=known.answer,
            reason=known.reason,
            observatories=list(known.observatories),
            code_version=known.code_version,
            links=day_links(known.day, known.origin),
            **counts,
        )


class DaysReply(PageReply):
    """Searched days, the newest first."""

    days: list[DaySummaryReply]

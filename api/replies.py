"""What the replies about days, detections, events and calibration hold, and what all replies have in common."""

from collections.abc import Sequence
from dataclasses import asdict
from datetime import date, datetime
from functools import cache
from math import isnan
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from api.links import day_links
from bella.calibration.found_table import FoundRow
from bella.calibration.tried import NOT_TRIED, PAGE, Answered, Tried, tried
from bella.catalogue import UNSEARCHED, Catalogue, DaySummary, Detection, KnownEvent, ListRead, SearchedDay, Solution
from bella.linked_events import Event, EventKind, Link
from bella.records import DayAnswer, Origin

ORIGIN = "Where the data come from: archive, event, submission, user; or simulated, test."
NEAR = "Events near a burst in time, both at the Sun: a link is no proof that one caused the other."
NO_LISTS = "No list of events is known here: a burst without events is one that was not compared with any."


class Reply(BaseModel):
    """Base of all replies."""

    model_config = ConfigDict(frozen=True)


class PageReply(Reply):
    """One page of a list."""

    total: int = Field(description="How many match, on all pages.")
    returned: int = Field(description="How many this page holds; of days, each origin counts.")
    truncated: bool = Field(description="True when more follow: go on at `next`.")
    next: str | None = Field(description="Address of the next page; null on the last.")


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


class EventReply(Reply):
    """An event as others published it; times are those at the observer."""

    event_id: str = Field(description="Source and the id that the event has there.")
    kind: EventKind = Field(description="flare, cme (first seen), particles (onset) or radio (detected by others).")
    source: str = Field(description="Who published it.")
    published_id: str = Field(description="Its id there.")
    observer: str = Field(description="Where it was seen from: EARTH, or a spacecraft.")
    start_utc: datetime
    at_sun_utc: datetime = Field(description="Start less the light travel from the Sun to the observer.")
    peak_utc: datetime | None
    end_utc: datetime | None
    size: str = Field(description="Class of a flare, speed of a CME; empty where it was not published.")
    latitude_deg: float | None = Field(description="Stonyhurst, north positive.")
    longitude_deg: float | None = Field(description="Stonyhurst, west positive.")
    region: int | None = Field(description="NOAA number of the active region.")
    f_low_mhz: float | None
    f_high_mhz: float | None
    link: str = Field(description="Page about it; empty where there is none.")

    @classmethod
    def of(cls, event: Event) -> "EventReply":
        """Reply for an event."""
        return cls(**asdict(event))


class LinkedEventReply(EventReply):
    """An event near a burst."""

    delay_s: float = Field(description="Start of the event less that of the burst, both at the Sun, s.")

    @classmethod
    def near(cls, link: Link) -> "LinkedEventReply":
        """Reply for an event that is near a burst."""
        return cls(**asdict(link.event), delay_s=link.delay_s)


class ListedEventReply(EventReply):
    """An event with the list that it is from, and its delay to each burst that it is near to, s."""

    list_name: str
    bursts: dict[str, float]

    @classmethod
    def listed(cls, known: KnownEvent) -> "ListedEventReply":
        """Reply for an event of a list."""
        return cls(**asdict(known.event), list_name=known.list_name, bursts=dict(known.bursts))


class EventListReply(Reply):
    """A list of events: how far it reaches, and how fresh it is."""

    name: str
    state: Literal["read", "refused", "gone"] = Field(
        description="read; refused (not usable: what it had before is kept); gone (its file is, its events are kept)."
    )
    events: int = Field(description="Events that are held of it.")
    left_out: int = Field(description="Rows that were not usable.")
    message: str
    first_utc: datetime | None = Field(description="Start of its first event.")
    newest_utc: datetime | None = Field(description="Start of its last event: nothing is known of later times.")
    changed_utc: datetime = Field(description="When its file was changed.")
    read_utc: datetime = Field(description="When it was looked at.")

    @classmethod
    def of(cls, one: ListRead) -> "EventListReply":
        """Reply for a list."""
        return cls.model_validate(one, from_attributes=True)


class EventsReply(PageReply):
    """One page of events by their start, and the lists that they are from."""

    events: list[ListedEventReply]
    lists: list[EventListReply]
    remark: str = NEAR


class BurstEventsReply(Reply):
    """Events near a burst, the nearest first, and the lists that it was compared with."""

    burst_id: str
    events: list[LinkedEventReply]
    lists: list[EventListReply]
    remark: str


def lists_of(catalogue: Catalogue) -> list[EventListReply]:
    """Lists of events, by name."""
    return [EventListReply.of(one) for one in catalogue.events.lists()]


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
    observatories : sequence of str
        That received the burst.
    """
    return _reply_of(solution.answered(observatories))


@cache
def _reply_of(real: Answered) -> CalibrationReply:
    """Reply for one way of answering: there are few, and every burst of a list has one."""
    return CalibrationReply.of(tried(real))

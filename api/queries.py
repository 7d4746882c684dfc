"""What may stand in the query of an address. An unknown parameter is refused: a misspelt filter must not be ignored."""

from collections.abc import Container
from dataclasses import replace
from datetime import date, datetime
from typing import Annotated, Any, Literal
from urllib.parse import urlencode

from fastapi import Path, Request
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    WithJsonSchema,
    field_validator,
)
from pydantic_core import PydanticCustomError

from api.errors import worded
from bella.answer import Grade
from bella.catalogue import RANGES, BurstQuery, DetectionQuery, EventQuery, Solution, SolutionQuery, SourceQuery
from bella.exceptions import InputError, NoDataError
from bella.flags import FLAGS
from bella.linked_events import KINDS, EventKind
from bella.records import ANNOUNCED_ORIGINS, Origin, Tier, origins_asked
from bella.spacecraft import observatory_name
from bella.times import parse_day, parse_utc

MethodName = Literal["posterior", "nuts", "tdoa"]
"""`bella.catalogue.records.METHOD_ORDER`."""

BurstSort = Literal[
    "start", "-start", "updated", "-updated", "grade", "-grade", "longitude", "-longitude", "latitude", "-latitude",
    "distance", "-distance", "wind", "-wind", "area", "-area", "frequency", "-frequency",
]  # fmt: skip
"""`bella.catalogue.BURST_SORTS`, forwards and backwards."""

DetectionTier = Literal["localisable", "catalogued", "rejected"]

MOST = 1e9
"""No number that is asked for is larger."""

BurstId = Annotated[str, Path(description="Id of a burst.", examples=["T3-20120607-1929"])]
SolutionId = Annotated[
    str,
    Path(
        description="Id of a solution.",
        examples=["T3-20120607-1929.half_maximum.posterior.default.2d.v1"],
    ),
]
DayText = Annotated[
    str,
    WithJsonSchema({"type": "string", "format": "date", "examples": ["2012-06-07"]}),
    Path(description="Day, UTC.", examples=["2012-06-07"]),
]
SubmissionId = Annotated[str, Path(description="Id of a submission.", examples=["S-20120607-0123456789ab"])]

NEWEST_FIRST: Literal["-start"] = "-start"
CURSOR = Field(None, description="Where to go on: taken from `next` of the reply before.")
EMPTY_IS_NONE = BeforeValidator(lambda value: None if value == "" else value)
"""A form sends what is not filled in as an empty text."""

_TIME_TEXT = {"type": "string", "anyOf": [{"format": "date"}, {"format": "date-time"}]}
CHOICES = ("edge", "method", "preset", "version")
"""Names of what chooses a solution."""


def _known_flag(name: str) -> str:
    if name not in FLAGS:
        raise PydanticCustomError("unknown", "no such flag; choose of {known}", {"known": ", ".join(FLAGS)})
    return name


FlagName = Annotated[str, AfterValidator(_known_flag), WithJsonSchema({"type": "string", "enum": [*FLAGS]})]

Asked = Annotated[str | None, EMPTY_IS_NONE]
TimeAsked = Annotated[str | None, EMPTY_IS_NONE, WithJsonSchema(_TIME_TEXT)]
DayAsked = Annotated[str | None, EMPTY_IS_NONE, WithJsonSchema({"type": "string", "format": "date"})]
Bound = Annotated[Annotated[float, Field(ge=-MOST, le=MOST, allow_inf_nan=False)] | None, EMPTY_IS_NONE]
Angle = Annotated[Annotated[float, Field(ge=-360, le=360, allow_inf_nan=False)] | None, EMPTY_IS_NONE]


def _named(values: object) -> object:
    """Names without empty ones, which a form sends for what is not filled in."""
    given = [values] if isinstance(values, str) else values
    return [one.strip() for one in given if str(one).strip()] if isinstance(given, list) else given


_without_empty = BeforeValidator(_named)
Names = Annotated[list[str], _without_empty]
Grades = Annotated[list[Grade], _without_empty]
Flags = Annotated[list[FlagName], _without_empty]
Methods = Annotated[list[MethodName], _without_empty]


def _bound(description: str, example: float) -> Any:
    return Field(None, description=description, examples=[example])


class Parameters(BaseModel):
    """Parameters of an address; what is none of them is refused."""

    model_config = ConfigDict(extra="forbid")


OriginText = Literal["archive", "event", "submission", "user", "simulated", "test", "all"]
OriginAsked = Annotated[
    OriginText | None,
    EMPTY_IS_NONE,
    Field(description="Origin of the data, or `all`; without it everything but simulated and test data."),
]


class OriginChoice(Parameters):
    """Data of which origin are asked for."""

    origin: OriginAsked = None

    @property
    def origins(self) -> tuple[Origin, ...]:
        """Origins that are asked for."""
        return origins_asked(self.origin)


class BurstSelection(OriginChoice):
    """Which bursts are asked for; without parameters, all that stand and are of real data."""

    start: TimeAsked = Field(None, description="Bursts that start at this UTC time or later.", examples=["2012-06-01"])
    stop: TimeAsked = Field(None, description="Bursts that start before this UTC time.", examples=["2012-07-01"])
    updated_since: TimeAsked = Field(
        None, description="Bursts of which something was changed at this UTC time or later.", examples=["2026-01-01"]
    )
    observatory: Names = Field([], description="Observatories that must all have received the burst; repeatable.")
    grade: Grades = Field([], description="Grades of the answer, such as A or AB; repeatable.", examples=[["A", "B"]])
    tier: Annotated[Tier | None, EMPTY_IS_NONE] = Field(None, description="Tier of the answer.")
    flag: Flags = Field([], description="Quality flags that the answer must all have; repeatable.")
    without_flag: Flags = Field([], description="Quality flags that the answer must not have; repeatable.")
    edge: Names = Field([], description="Edges of light curves that the answer may come from; repeatable.")
    method: Methods = Field([], description="Methods that the answer may come from; repeatable.")
    preset: Names = Field([], description="Presets that the answer may come from; repeatable.")
    frequency_min: Bound = _bound("The band reaches this frequency or higher, MHz.", 1.0)
    frequency_max: Bound = _bound("The band reaches this frequency or lower, MHz.", 10.0)
    longitude_min: Angle = _bound("Longitude at 1 solar radius, HEE degrees, west positive: from here westward.", 170.0)
    longitude_max: Angle = _bound("To here; across 180 where it is smaller than `longitude_min`.", -150.0)
    latitude_min: Angle = _bound("Sources reach this HEE latitude or farther north, degrees.", -10.0)
    latitude_max: Angle = _bound("Sources reach this HEE latitude or farther south, degrees.", 10.0)
    distance_min: Bound = _bound("Sources reach this distance from the Sun or farther, solar radii.", 20.0)
    distance_max: Bound = _bound("Sources reach this distance from the Sun or nearer, solar radii.", 100.0)
    wind_min: Bound = _bound("Speed of the solar wind at least, km/s.", 300.0)
    wind_max: Bound = _bound("Speed of the solar wind at most, km/s.", 500.0)
    area_min: Bound = _bound("Area of the 68 % region (median of all frequencies) at least, square solar radii.", 1.0)
    area_max: Bound = _bound("Area of the 68 % region at most, square solar radii.", 100.0)
    retracted: bool = Field(False, description="True: with those that were retracted.")

    @field_validator("grade", mode="before")
    @classmethod
    def _single_grades(cls, values: object) -> object:
        """Grades one by one: several may be written together."""
        given = [values] if isinstance(values, str) else values
        return [one for text in given for one in str(text).upper()] if isinstance(given, list) else given

    def query(self) -> BurstQuery:
        """Question to the catalogue.

        Raises
        ------
        InputError
            If a time cannot be read or start is not before stop.
        """
        start, stop = _interval(self.start, self.stop)
        bounds = {f"{name}_{end}": getattr(self, f"{name}_{end}") for name in RANGES for end in ("min", "max")}
        for name in RANGES:
            least, most = bounds[f"{name}_min"], bounds[f"{name}_max"]
            if name != "longitude" and least is not None and most is not None and least > most:
                raise InputError(f"{name}_min: is above {name}_max; exchange them, or leave one out")
        return BurstQuery(
            start=start,
            stop=stop,
            updated_since=parse_utc(self.updated_since, "updated_since"),
            observatories=frozenset(map(read_observatory, self.observatory)),
            grades=frozenset(self.grade),
            tier=self.tier,
            flags=frozenset(self.flag),
            flags_absent=frozenset(self.without_flag),
            edges=frozenset(self.edge),
            methods=frozenset(self.method),
            presets=frozenset(self.preset),
            **bounds,
            origins=frozenset(self.origins),
            with_retracted=self.retracted,
        )


class BurstFilter(BurstSelection):
    """Which bursts are asked for, in which order, and which page of them."""

    sort: Annotated[BurstSort, BeforeValidator(lambda value: value or NEWEST_FIRST)] = Field(
        NEWEST_FIRST, description="What orders the list; with a minus sign, from the last or largest on."
    )
    limit: int = Field(50, ge=1, le=1000, description="Bursts per reply.")
    cursor: Asked = CURSOR

    def query(self) -> BurstQuery:
        """Question to the catalogue; see `BurstSelection.query`."""
        return replace(super().query(), sort=self.sort, cursor=self.cursor, limit=self.limit)


def _interval(start: str | None, stop: str | None) -> tuple[datetime | None, datetime | None]:
    """Times of [start, stop).

    Raises
    ------
    InputError
        If one cannot be read or start is not before stop.
    """
    first, last = parse_utc(start, "start"), parse_utc(stop, "stop")
    if first and last and first >= last:
        raise InputError("start: is not before stop; exchange them, or leave one out")
    return first, last


def _days_of(first: str | None, last: str | None) -> tuple[date | None, date | None]:
    """Days of [first, last].

    Raises
    ------
    InputError
        If one cannot be read or the first is after the last.
    """
    begin, end = (
        None if text is None else parse_day(text.strip(), name) for text, name in ((first, "from"), (last, "to"))
    )
    if begin and end and begin > end:
        raise InputError("from: is after to; exchange them, or leave one out")
    return begin, end


def read_observatory(name: str) -> str:
    """Name of a spacecraft as it is used here, of a name as people write it.

    Raises
    ------
    InputError
        If it must be a typing error.
    """
    try:
        return observatory_name(name)
    except InputError as error:
        raise InputError(f"observatory: {error}") from error


class DetectionFilter(OriginChoice):
    """Which detections are asked for, in which order, and which page of them."""

    start: TimeAsked = Field(None, description="Onsets at this UTC time or later.", examples=["2020-07-21"])
    stop: TimeAsked = Field(None, description="Onsets before this UTC time.", examples=["2020-07-22"])
    observatory: Asked = Field(None, description="Spacecraft; without it, all.", examples=["WIND"])
    tier: Annotated[DetectionTier | None, EMPTY_IS_NONE] = Field(None, description="Without it, all.")
    burst: Asked = Field(None, description="Burst that they belong to; without it, all.")
    sort: Literal["start", "-start"] = Field(NEWEST_FIRST, description="By onset: ascending, or the newest first.")
    limit: int = Field(1000, ge=1, le=5000, description="Detections per reply.")
    cursor: Asked = CURSOR

    def query(self) -> DetectionQuery:
        """Question to the catalogue.

        Raises
        ------
        InputError
            If a time cannot be read or start is not before stop.
        """
        start, stop = _interval(self.start, self.stop)
        return DetectionQuery(
            start=start,
            stop=stop,
            observatory=None if self.observatory is None else read_observatory(self.observatory),
            tier=self.tier,
            burst_id=self.burst,
            sort=self.sort,
            cursor=self.cursor,
            limit=self.limit,
            origins=frozenset(self.origins),
        )


class SolutionFilter(OriginChoice):
    """Which solutions are asked for, in which order, and which page of them."""

    burst: Asked = Field(None, description="Of this burst; without it, of all.", examples=["T3-20120607-1929"])
    edge: Names = Field([], description="Edges of light curves that they come from; repeatable.")
    method: Methods = Field([], description="Methods that they come from; repeatable.")
    preset: Names = Field([], description="Presets that they come from; repeatable.")
    newest: bool = Field(False, description="True: without those that another version supersedes.")
    created_since: TimeAsked = Field(None, description="Published at this UTC time or later.", examples=["2026-01-01"])
    retracted: bool = Field(False, description="True: with those that were retracted.")
    sort: Literal["created", "-created"] = Field("-created", description="By publication; the newest first.")
    limit: int = Field(50, ge=1, le=1000, description="Solutions per reply.")
    cursor: Asked = CURSOR

    def query(self) -> SolutionQuery:
        """Question to the catalogue.

        Raises
        ------
        InputError
            If a time cannot be read.
        """
        return SolutionQuery(
            burst_id=self.burst,
            edges=frozenset(self.edge),
            methods=frozenset(self.method),
            presets=frozenset(self.preset),
            newest=self.newest,
            created_since=parse_utc(self.created_since, "created_since"),
            sort=self.sort,
            cursor=self.cursor,
            limit=self.limit,
            origins=frozenset(self.origins),
            with_retracted=self.retracted,
        )


class SourceFilter(Parameters):
    """Which files are asked for, in which order, and which page of them."""

    dataset: Asked = Field(None, description="Data set; without it, all.", examples=["WI_H1_WAV"])
    first: DayAsked = Field(None, alias="from", description="Of this day or later.", examples=["2020-07-01"])
    last: DayAsked = Field(None, alias="to", description="Of this day or earlier.", examples=["2020-07-31"])
    updated_since: TimeAsked = Field(None, description="Known, or changed, at this UTC time or later.")
    sort: Literal["day", "-day", "updated", "-updated"] = Field("-day", description="The newest day first.")
    limit: int = Field(100, ge=1, le=1000, description="Files per reply.")
    cursor: Asked = CURSOR

    def query(self) -> SourceQuery:
        """Question to the catalogue.

        Raises
        ------
        InputError
            If a day or a time cannot be read, or the first day is after the last.
        """
        first, last = _days_of(self.first, self.last)
        since = parse_utc(self.updated_since, "updated_since")
        return SourceQuery(self.dataset, first, last, since, self.sort, self.cursor, self.limit)


class EventFilter(Parameters):
    """Which events are asked for; without parameters, all from the first on."""

    start: Asked = Field(None, description="Events that start at this UTC time or later.", examples=["2012-06-07"])
    stop: Asked = Field(None, description="Events that start before this UTC time.", examples=["2012-06-08"])
    kind: list[EventKind] = Field([], description=f"{', '.join(KINDS)}; repeatable.")
    observatory: Asked = Field(None, description="Seen from there: EARTH, or a spacecraft.", examples=["SOLO"])
    linked: bool = Field(False, description="True: only events that are near a burst.")
    limit: int = Field(100, ge=1, le=1000, description="Events per reply.")
    cursor: Asked = CURSOR

    def query(self) -> EventQuery:
        """Question to the catalogue.

        Raises
        ------
        InputError
            If a time cannot be read or start is not before stop.
        """
        start, stop = parse_utc(self.start, "start"), parse_utc(self.stop, "stop")
        if start and stop and start >= stop:
            raise InputError("start: is not before stop; exchange them, or leave one out")
        observer = read_observatory(self.observatory) if self.observatory else None
        return EventQuery(start, stop, frozenset(self.kind), observer, self.linked, self.cursor, self.limit)


class DayFilter(OriginChoice):
    """Which searched days are asked for; without parameters, the newest."""

    first: DayAsked = Field(None, alias="from", description="This day or later.", examples=["2020-07-01"])
    last: DayAsked = Field(None, alias="to", description="This day or earlier.", examples=["2020-07-31"])
    limit: int = Field(62, ge=1, le=366, description="Days per reply.")
    cursor: Asked = CURSOR

    def span(self) -> tuple[date | None, date | None]:
        """First and last day; None where there is no bound.

        Raises
        ------
        InputError
            If a day cannot be read or the first is after the last.
        """
        return _days_of(self.first, self.last)

    def onward(self, last: date) -> str:
        """Query of an address that asks for the same days, but none after this one."""
        asked = {name: value for name, value in self.model_dump(by_alias=True, exclude_unset=True).items() if value}
        return urlencode({**asked, "to": last})


class AlertStreamFilter(OriginChoice):
    """Which alerts are sent."""

    after: int | None = Field(None, ge=0, description="Begin after the alert of this sequence number.")

    @property
    def announced(self) -> tuple[Origin, ...]:
        """Origins whose alerts are asked for; without a word those that everybody gets."""
        return ANNOUNCED_ORIGINS if self.origin is None else self.origins


class AlertFilter(OriginChoice):
    """Which alerts are listed."""

    after: int = Field(0, ge=0, le=2**31 - 1, description="Alerts after the one of this sequence number.")
    burst: str | None = Field(None, description="Burst that they are about; without it, all.")
    limit: int = Field(100, ge=1, le=1000, description="Alerts per reply.")

    @property
    def announced(self) -> tuple[Origin, ...]:
        """Origins whose alerts are asked for; without a word those that everybody gets."""
        return ANNOUNCED_ORIGINS if self.origin is None else self.origins


class SolutionChoice(Parameters):
    """Which solution of a burst is asked for; without parameters, the preferred one."""

    edge: str | None = Field(None, description="Definition of the edge, such as half_maximum.")
    method: str | None = Field(None, description="Method, such as posterior or nuts.")
    preset: str | None = Field(None, description="Preset, such as default, paper or bella-2024.")
    version: int | None = Field(None, ge=1, description="Version; without it, the newest.")


class SeriesChoice(Parameters):
    """Which series the figures show; without parameters, the preferred one with the other edges of its kind."""

    edge: str | None = Field(None, description="Definition of the edge, such as half_maximum; without it, all.")
    method: str | None = Field(None, description="Method, such as posterior or nuts.")
    preset: str | None = Field(None, description="Preset, such as default, paper or bella-2024.")


class FrequencyChoice(SeriesChoice):
    """Which channel of each track."""

    frequency_mhz: float = Field(
        gt=0, le=1000, allow_inf_nan=False, description="The nearest channel is taken.", examples=[0.5]
    )


def matching(solutions: tuple[Solution, ...], choice: SolutionChoice) -> list[Solution]:
    """Solutions that a choice allows, the preferred one first."""
    return [
        solution
        for solution in solutions
        if choice.edge in {None, solution.series.edge}
        and choice.method in {None, solution.series.method}
        and choice.preset in {None, solution.series.preset}
        and choice.version in {None, solution.version}
    ]


def chosen(solutions: tuple[Solution, ...], choice: SolutionChoice, burst_id: str) -> Solution:
    """The one solution that a choice means: the preferred one where the choice allows it.

    Raises
    ------
    NoDataError
        If there is none; the message lists what there is.
    """
    return _existing(matching(solutions, choice), solutions, choice, burst_id)[0]


def one_per_edge(solutions: tuple[Solution, ...], choice: SeriesChoice, burst_id: str) -> list[Solution]:
    """The solution that a choice means, and those of the other edges with the same method, preset and dimensions.

    Raises
    ------
    NoDataError
        If the burst has solutions, and none that the choice allows; the message lists what there is.
    """
    if not solutions:
        return []
    wanted = SolutionChoice(edge=choice.edge, method=choice.method, preset=choice.preset)
    fits = _existing(matching(solutions, wanted), solutions, wanted, burst_id)
    same = [one for one in fits if replace(one.series, edge=fits[0].series.edge) == fits[0].series]
    return list({one.series.edge: one for one in reversed(same)}.values())[::-1]


def _existing(
    fits: list[Solution], solutions: tuple[Solution, ...], choice: SolutionChoice, burst_id: str
) -> list[Solution]:
    if fits:
        return fits
    asked = ", ".join(f"{name} {getattr(choice, name)}" for name in CHOICES if getattr(choice, name) is not None)
    known = sorted({f"{s.series.edge}/{s.series.method}/{s.series.preset} v{s.version}" for s in solutions})
    has = ", ".join(known) or "none at all"
    raise NoDataError(f"this burst has no such series: {asked or 'none was published'}; {burst_id} has {has}")


def asked_of(request: Request, lists: Container[str] = ()) -> dict[str, Any]:
    """Query of the address, as the form of a page writes it: with empty fields, lists repeated.

    Parameters
    ----------
    lists : container of str
        Names of the fields that may be repeated.
    """
    query = request.query_params
    return {name: query.getlist(name) if name in lists else query[name] for name in dict.fromkeys(query)}


def fault_words(error: InputError | ValidationError) -> str:
    """What is wrong with a question, in one line."""
    if isinstance(error, ValidationError):
        return "; ".join(worded({**fault, "loc": ("query", *fault["loc"])}) for fault in error.errors())
    return str(error)

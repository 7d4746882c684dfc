"""Whether the service is alive: freshness of data sets, times of solutions, mock bursts, and observability of days."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import date, datetime, timedelta
from typing import Any, Literal, get_args

from pydantic import Field
from sqlalchemy import JSON, Double, Engine, ForeignKey, Row, Table, delete, func, select
from sqlalchemy.orm import Mapped, mapped_column

from bella.catalogue.engine import dialect_insert, reading, writing
from bella.catalogue.models import AlertRow, Base, DetectionRow, SolutionRow, StageRunRow, UtcTime, table_of
from bella.exceptions import NoDataError
from bella.records import REAL_ORIGINS, Origin, Record

MINUTES_PER_BIN = 60
BINS = 24 * 60 // MINUTES_PER_BIN
HAS_DATA = 0.5
"""Part of a bin with data from which on a receiver counts as there."""

MOST_TIMED = 1000
"""Newest solutions whose latencies are summarised."""


class ReceiverDay(Record):
    """Part of each hour of a day in which a receiver had data."""

    observatory: str
    fraction: tuple[float, ...] = Field(description="Of each hour, from 0 to 1.", min_length=BINS, max_length=BINS)


class FleetMap(Record):
    """Size of the 68 % region of a source in the ecliptic plane, for receivers that have data together."""

    observatories: tuple[str, ...]
    sigma_s: dict[str, float] = Field(description="Timing error that is taken for each receiver, s.")
    radius68_rsun: tuple[tuple[float | None, ...], ...] = Field(
        description="Radius of the circle that has the area of the 68 % region, solar radii; a row for each distance, "
        "in it each longitude; null where it is not known."
    )


class ObservedDay(Record):
    """Observability of a day."""

    day: date
    distances_rsun: tuple[float, ...]
    longitudes_deg: tuple[float, ...] = Field(description="HEE, west positive.")
    receivers: tuple[ReceiverDay, ...]
    maps: tuple[FleetMap, ...]

    def at(self, utc: datetime) -> "tuple[tuple[str, ...], FleetMap | None]":
        """Receivers with data in the hour of a time, and how well they locate; None where there are fewer than three.

        Raises
        ------
        NoDataError
            If the time is not on this day.
        """
        if utc.date() != self.day:
            raise NoDataError(f"{utc:%Y-%m-%dT%H:%M} is not on {self.day}")
        here = fleet_of(self.receivers, (utc.hour * 60 + utc.minute) // MINUTES_PER_BIN)
        return here, next((one for one in self.maps if one.observatories == here), None)


def fleet_of(receivers: tuple[ReceiverDay, ...], hour: int) -> tuple[str, ...]:
    """Receivers with data in an hour of a day, by name."""
    return tuple(sorted(one.observatory for one in receivers if one.fraction[hour] >= HAS_DATA))


FreshnessState = Literal["ok", "no file yet", "silent"]
"""Of a data set: the newest file that is due is held; the archive answers and has no such file; it does not answer."""


class FreshnessRow(Base):
    """Data sets that are asked for, one row each, and what came of the last time."""

    __tablename__ = "freshness"

    dataset: Mapped[str] = mapped_column(primary_key=True)
    kind: Mapped[str]
    observatories: Mapped[str]
    latency_d: Mapped[float] = mapped_column(Double)
    state: Mapped[str]
    asked_utc: Mapped[datetime] = mapped_column(UtcTime)
    answered_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    silent_since_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    newest_day: Mapped[date | None]
    next_utc: Mapped[datetime] = mapped_column(UtcTime)
    failures: Mapped[int]
    message: Mapped[str]


class SolutionTimesRow(Base):
    """How long each solution took, from the burst to its publication."""

    __tablename__ = "solution_times"

    solution_id: Mapped[str] = mapped_column(ForeignKey("solution.solution_id", ondelete="CASCADE"), primary_key=True)
    origin: Mapped[str]
    data_utc: Mapped[datetime] = mapped_column(UtcTime)
    seen_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    fetched_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    detected_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    published_utc: Mapped[datetime] = mapped_column(UtcTime, index=True)


class MockRunRow(Base):
    """Mock bursts that were sent through the whole path."""

    __tablename__ = "mock_run"

    started_utc: Mapped[datetime] = mapped_column(UtcTime, primary_key=True)
    ended_utc: Mapped[datetime] = mapped_column(UtcTime)
    state: Mapped[str]
    burst_id: Mapped[str]
    solution_id: Mapped[str]
    off_deg: Mapped[float | None] = mapped_column(Double)
    message: Mapped[str]


class ObservedDayRow(Base):
    """Observability of days, once for data of each origin, as the JSON of `ObservedDay`."""

    __tablename__ = "observed_day"

    day: Mapped[date] = mapped_column(primary_key=True)
    origin: Mapped[str] = mapped_column(primary_key=True, server_default="archive")
    inputs_hash: Mapped[str]
    content: Mapped[dict[str, Any]] = mapped_column(JSON)


@dataclass(frozen=True)
class Freshness:
    """What is known of a data set that is asked for on a schedule.

    Attributes
    ----------
    dataset, kind : str
        Its name; what it holds: ``spectra``, ``in_situ``, ``regions`` or ``ephemeris``.
    latency_d : float
        Days after which a file is usually there.
    state : str
        See `FreshnessState`.
    asked_utc : datetime
        Last time.
    answered_utc, silent_since_utc : datetime or None
        Last answer; first of the requests in a row that had none.
    newest_day : datetime.date or None
        Newest day of which a file is held.
    next_utc : datetime
        When it will be asked for again.
    failures : int
        Requests in a row without an answer.
    message : str
        Why there was none; empty otherwise.
    """

    dataset: str
    kind: str
    observatories: tuple[str, ...]
    latency_d: float
    state: FreshnessState
    asked_utc: datetime
    answered_utc: datetime | None
    silent_since_utc: datetime | None
    newest_day: date | None
    next_utc: datetime
    failures: int = 0
    message: str = ""


@dataclass(frozen=True)
class SolutionTimes:
    """When the data of a solution were taken, and when the service had them; None where that was not noted.

    Attributes
    ----------
    data_utc : datetime
        End of the burst.
    seen_utc, fetched_utc : datetime or None
        When the last of its files was first listed by the archive, and when it was in the mirror.
    detected_utc : datetime or None
        When the search of its day had ended.
    published_utc : datetime
        When the solution could be read.
    origin : str
        Of its data.
    """

    data_utc: datetime
    seen_utc: datetime | None
    fetched_utc: datetime | None
    detected_utc: datetime | None
    published_utc: datetime
    origin: str = "archive"


@dataclass(frozen=True)
class Latency:
    """Distribution of a latency, s: quantiles of the newest solutions, NaN-free; None where there is no solution."""

    solutions: int
    median_s: float | None
    p90_s: float | None
    p98_s: float | None
    largest_s: float | None


@dataclass(frozen=True)
class MockRun:
    """A mock burst that was sent through the whole path.

    Attributes
    ----------
    state : str
        ``ok`` or ``failed``.
    burst_id, solution_id : str
        What came of it; empty where nothing did.
    off_deg : float or None
        Longitude of the answer less that of the truth, degrees.
    message : str
        What failed; empty otherwise.
    """

    started_utc: datetime
    ended_utc: datetime
    state: Literal["ok", "failed"]
    burst_id: str = ""
    solution_id: str = ""
    off_deg: float | None = None
    message: str = ""


@dataclass(frozen=True)
class Work:
    """What the worker did last: runs under way, and the newest ones that ended or failed."""

    running: int
    last_started_utc: datetime | None
    failed: int


class Operation:
    """Tables about the service itself, beside those about bursts; see `Catalogue.operation`."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def freshness(self) -> tuple[Freshness, ...]:
        """Every data set that was ever asked for, by kind and name."""
        table = table_of(FreshnessRow)
        with reading(self._engine) as connection:
            rows = connection.execute(select(table).order_by(table.c.kind.desc(), table.c.dataset)).all()
        return tuple(Freshness(**(_named(row) | {"observatories": tuple(row.observatories.split())})) for row in rows)

    def record_freshness(self, one: Freshness) -> None:
        """Note what came of asking for a data set."""
        assert one.state in get_args(FreshnessState)  # noqa: S101 - a typing error of ours
        self._put(FreshnessRow, asdict(one) | {"observatories": " ".join(one.observatories)})

    def record_times(self, solution_id: str, times: SolutionTimes) -> None:
        """Note when the data of a solution came; the first note stays."""
        table = table_of(SolutionTimesRow)
        with writing(self._engine) as connection:
            values = asdict(times) | {"solution_id": solution_id}
            connection.execute(dialect_insert(connection, table).values(values).on_conflict_do_nothing())

    def times(self, solution_id: str) -> SolutionTimes | None:
        """When the data of a solution came; None where it was not noted."""
        table = table_of(SolutionTimesRow)
        with reading(self._engine) as connection:
            row = connection.execute(select(table).where(table.c.solution_id == solution_id)).one_or_none()
        if row is None:
            return None
        return _times(row)

    def times_between(self, start: datetime, stop: datetime, limit: int) -> tuple[tuple[str, SolutionTimes], ...]:
        """When the data came of solutions that were published in [start, stop), by solution id, of real data.

        Parameters
        ----------
        limit : int
            Most that are returned.

        Returns
        -------
        tuple of (str, SolutionTimes)
            By the time of publication.
        """
        table = table_of(SolutionTimesRow)
        inside = (table.c.published_utc >= start) & (table.c.published_utc < stop)
        wanted = select(table).where(inside, table.c.origin.in_(sorted(REAL_ORIGINS)))
        with reading(self._engine) as connection:
            order = (table.c.published_utc, table.c.solution_id)
            rows = connection.execute(wanted.order_by(*order).limit(limit)).all()
        return tuple((row.solution_id, _times(row)) for row in rows)

    def observed_between(self, first: date, last: date) -> tuple[ObservedDay, ...]:
        """Observability of the days of [first, last] in data of the archive, where it is known."""
        table = table_of(ObservedDayRow)
        inside = table.c.day.between(first, last) & (table.c.origin == Origin.ARCHIVE)
        wanted = select(table.c.content).where(inside).order_by(table.c.day)
        with reading(self._engine) as connection:
            return tuple(map(ObservedDay.model_validate, connection.execute(wanted).scalars()))

    def latencies(self, origin: str = "archive") -> dict[str, Latency]:
        """Distribution of latencies of the newest `MOST_TIMED` solutions.

        Parameters
        ----------
        origin : str
            Of their data.

        Returns
        -------
        dict of str to Latency
            ``seen_to_published``, ``fetched_to_published``, ``detected_to_published`` and ``data_to_published``.
        """
        table = table_of(SolutionTimesRow)
        newest = select(table).where(table.c.origin == origin).order_by(table.c.published_utc.desc()).limit(MOST_TIMED)
        with reading(self._engine) as connection:
            rows = connection.execute(newest).all()
        return {
            f"{name}_to_published": _latency(rows, f"{name}_utc") for name in ("seen", "fetched", "detected", "data")
        }

    def record_mock(self, run: MockRun) -> None:
        """Note what became of a mock burst."""
        self._put(MockRunRow, asdict(run))

    def last_mock(self) -> MockRun | None:
        """The newest mock burst; None where there was none."""
        table = table_of(MockRunRow)
        with reading(self._engine) as connection:
            row = connection.execute(select(table).order_by(table.c.started_utc.desc()).limit(1)).one_or_none()
        return None if row is None else MockRun(**_named(row))

    def forget_mocks(self, before: datetime) -> tuple[str, ...]:
        """Remove mock bursts that started earlier, with all that the catalogue has of them; returns their ids.

        Only bursts that the table of mock bursts names are removed; files of the store are left to the next sweep.
        """
        mocks = table_of(MockRunRow)
        with writing(self._engine) as connection:
            old = mocks.c.started_utc < before
            ids = tuple(connection.execute(select(mocks.c.burst_id).where(old, mocks.c.burst_id != "")).scalars())
            solutions = select(table_of(SolutionRow).c.solution_id).where(table_of(SolutionRow).c.burst_id.in_(ids))
            # what was announced stays: readers go on after its number
            kept = {table_of(DetectionRow), table_of(AlertRow), mocks}
            for table in reversed(Base.metadata.sorted_tables):  # what refers to others goes before them
                for name, wanted in (("solution_id", solutions), ("burst_id", ids)):
                    known = name in table.c and (table.c[name].foreign_keys or table.c[name].primary_key)
                    if known and table not in kept:
                        connection.execute(delete(table).where(table.c[name].in_(wanted)))
            connection.execute(delete(mocks).where(old))
        return ids

    def record_observed(self, observed: ObservedDay, inputs_hash: str, origin: Origin = Origin.ARCHIVE) -> None:
        """Replace what is known of the observability of a day in data of an origin."""
        content = observed.model_dump(mode="json")
        row = {"day": observed.day, "origin": origin, "inputs_hash": inputs_hash, "content": content}
        self._put(ObservedDayRow, row)

    def observed(self, day: date, origins: Sequence[Origin] = (Origin.ARCHIVE,)) -> ObservedDay:
        """Observability of a day in data of the first of the origins of which it is known.

        Raises
        ------
        NoDataError
            If it was not computed.
        """
        table = table_of(ObservedDayRow)
        with reading(self._engine) as connection:
            rows = connection.execute(select(table.c.origin, table.c.content).where(table.c.day == day)).all()
        known = {Origin(row.origin): row.content for row in rows}
        for origin in origins:
            if origin in known:
                return ObservedDay.model_validate(known[origin])
        choice = f"origin={min(known)} gives" if known else f"bella coverage --at {day}T12:00 computes"
        raise NoDataError(f"observability of {day} is not known: {choice} a map")

    def work(self, since: datetime) -> Work:
        """What the worker does, and did since a time."""
        table = table_of(StageRunRow)
        with reading(self._engine) as connection:
            running = connection.execute(_count(table).where(table.c.state == "running")).scalar_one()
            failed = connection.execute(
                _count(table).where(table.c.state == "failed", table.c.started_utc >= since)
            ).scalar_one()
            last = connection.execute(
                select(table.c.started_utc).order_by(table.c.started_utc.desc()).limit(1)
            ).scalar()
        return Work(running, last, failed)

    def solutions(self) -> int:
        """How many solutions there are, superseded ones too."""
        with reading(self._engine) as connection:
            number: int = connection.execute(_count(table_of(SolutionRow))).scalar_one()
        return number

    def _put(self, model: type[Base], values: dict[str, Any]) -> None:
        """Insert a row, or replace the one with the same key."""
        table = table_of(model)
        keys = [column.name for column in table.primary_key.columns]
        with writing(self._engine) as connection:
            statement = dialect_insert(connection, table).values(values)
            others = {name: statement.excluded[name] for name in values if name not in keys}
            connection.execute(statement.on_conflict_do_update(index_elements=keys, set_=others))


def _count(table: Table) -> Any:
    return select(func.count()).select_from(table)


def _times(row: Row[Any]) -> SolutionTimes:
    return SolutionTimes(**{name: value for name, value in _named(row).items() if name != "solution_id"})


def _named(row: Row[Any]) -> dict[str, Any]:
    return dict(row._mapping)


def _latency(rows: Sequence[Row[Any]], since: str) -> Latency:
    """Quantiles of the time from one of the columns to the publication; those without that time are left out."""
    steps = [row.published_utc - getattr(row, since) for row in rows if getattr(row, since) is not None]
    ordered: list[float] = sorted(step / timedelta(seconds=1) for step in steps)
    if not ordered:
        return Latency(0, None, None, None, None)

    def _at(level: float) -> float:
        return ordered[min(int(level * len(ordered)), len(ordered) - 1)]

    return Latency(len(ordered), _at(0.5), _at(0.9), _at(0.98), ordered[-1])

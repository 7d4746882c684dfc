"""Browsing bursts by what is said of them, page by page."""

import hashlib
from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Any, Literal

from sqlalchemy import ColumnElement, Connection, Engine, RowMapping, Select, bindparam, func, or_, select

from bella.answer import Answer
from bella.catalogue.engine import reading
from bella.catalogue.events import EventListRow
from bella.catalogue.kept import Kept
from bella.catalogue.models import (
    AlertRow,
    BurstObservatoryRow,
    BurstRow,
    DetectionRow,
    SearchedDayRow,
    SolutionFlagRow,
    SolutionRow,
    SourceFileRow,
    UtcTime,
    table_of,
)
from bella.catalogue.paging import Key, Page, check_limit, ordered_by, read_page
from bella.catalogue.preference import preferences
from bella.catalogue.records import (
    BURST_SORTS,
    Burst,
    BurstPage,
    BurstPoint,
    BurstQuery,
    BurstSummary,
    Held,
    PointPage,
    Solution,
)
from bella.catalogue.solutions import newest_of, retraction_of, versions_of
from bella.exceptions import InputError, NoDataError
from bella.flags import REJECTED
from bella.records import REAL_ORIGINS, Origin
from bella.units import within_half_turn_deg

Summaries = Kept[tuple[str, datetime], BurstSummary]
"""Each under its id and the time at which anything of it was changed last."""

MOST_SUMMARIES = 10_000
"""That are kept in memory, of about 6 kB each."""

HALF_TURN_DEG, TURN_DEG = 180.0, 360.0
BURSTS = table_of(BurstRow)
_LOW, _HIGH = 0, 1
_NUMBERS: dict[str, tuple[ColumnElement[Any], ColumnElement[Any]]] = {
    "frequency": (BURSTS.c.f_low_mhz, BURSTS.c.f_high_mhz),
    "latitude": (BURSTS.c.answer_latitude_low_deg, BURSTS.c.answer_latitude_high_deg),
    "distance": (BURSTS.c.answer_range_low_rsun, BURSTS.c.answer_range_high_rsun),
    "wind": (BURSTS.c.answer_v_sw_km_s, BURSTS.c.answer_v_sw_km_s),
    "area": (BURSTS.c.answer_area68_rsun2, BURSTS.c.answer_area68_rsun2),
}
"""Lowest and highest value of each number that a range may hold."""

_ORDERS: dict[str, tuple[str, ColumnElement[Any], type]] = {
    "start": ("start_utc", BURSTS.c.start_utc, datetime),
    "updated": ("updated_utc", BURSTS.c.updated_utc, datetime),
    "grade": ("sorted_by", BURSTS.c.answer_grade, str),
    "longitude": ("sorted_by", BURSTS.c.answer_phi0_deg, float),
    **{name: ("sorted_by", _NUMBERS[name][_LOW], float) for name in ("latitude", "distance", "wind", "area")},
    "frequency": ("sorted_by", BURSTS.c.f_high_mhz, float),
}


Changed = Literal["bursts", "days", "files", "events"]


def _newest(*columns: ColumnElement[Any]) -> Select[Any]:
    return select(*(select(func.max(one, type_=UtcTime)).scalar_subquery() for one in columns))


# made once: that takes longer than to execute them
_CHANGED: dict[Changed, Select[Any]] = {
    "bursts": _newest(BURSTS.c.updated_utc),
    "days": _newest(table_of(SearchedDayRow).c.searched_utc),
    "files": _newest(table_of(SourceFileRow).c.changed_utc),
    "events": _newest(table_of(EventListRow).c.read_utc, table_of(EventListRow).c.linked_utc),
}
_AS_STORED = ("burst_id", "start_utc", "end_utc", "f_low_mhz", "f_high_mhz", "spectra_path", "updated_utc")
_OF_BURST = tuple(BURSTS.c[name] for name in (*_AS_STORED, "origin", "retracted_utc", "retracted_reason"))
_OF_POINT = tuple(
    BURSTS.c[name]
    for name in ("burst_id", "start_utc", "origin", "answer_id", *(f"answer_{one}" for one in Answer.model_fields))
)
_BURST = select(*_OF_BURST).where(BURSTS.c.burst_id == bindparam("burst_id"))
_OBSERVATORIES = table_of(BurstObservatoryRow)
_RECEIVED = (
    select(_OBSERVATORIES.c.burst_id, _OBSERVATORIES.c.observatory)
    .where(_OBSERVATORIES.c.burst_id.in_(bindparam("burst_ids", expanding=True)))
    .order_by(_OBSERVATORIES.c.position)
)


def bursts(engine: Engine, query: BurstQuery, kept: Summaries) -> BurstPage:
    """One page of bursts.

    Parameters
    ----------
    query : BurstQuery
        Filters, the order, the cursor of the page before, and the size of a page (1 to 1000).

    Returns
    -------
    BurstPage
        With the cursor of the next page and the number of bursts on all pages.

    Raises
    ------
    InputError
        Where the cursor, the order or the limit is not valid.
    """
    with reading(engine) as connection:
        page = _page(connection, query, *_OF_BURST)
        return BurstPage(_summaries(connection, page.rows, kept), page.next_cursor, page.total)


def points(engine: Engine, query: BurstQuery) -> PointPage:
    """Bursts as figures of many show them, in one statement: `bursts` reads all their solutions, flags and receivers.

    Raises
    ------
    InputError
        Where the order or the limit is not valid.
    """
    with reading(engine) as connection:
        page = _page(connection, query, *_OF_POINT)
    return PointPage(tuple(map(_point, page.rows)), page.total)


def _point(row: RowMapping) -> BurstPoint:
    answer = Answer(**{name: row[f"answer_{name}"] for name in Answer.model_fields}) if row["answer_id"] else None
    return BurstPoint(row["burst_id"], row["start_utc"], Origin(row["origin"]), answer)


def _page(connection: Connection, query: BurstQuery, *columns: ColumnElement[Any]) -> Page:
    """Columns of the bursts of one page."""
    check_limit(query.limit)
    order, filters = _order(query.sort), burst_filters(query)
    found = select(*columns, order[0].column.label("sorted_by")).where(*filters)
    counted = select(func.count()).select_from(BURSTS).where(*filters)
    return read_page(connection, query, found, order, counted)


def held(engine: Engine) -> Held:
    """How much of real data there is, in one statement."""
    real, days, detections = sorted(REAL_ORIGINS), table_of(SearchedDayRow).c, table_of(DetectionRow).c
    stands = BURSTS.c.retracted_utc.is_(None) & BURSTS.c.origin.in_(real)
    solutions, alerts = table_of(SolutionRow).c, table_of(AlertRow).c
    of_real = select(BURSTS.c.burst_id).where(stands)
    counted = {
        "bursts": select(func.count()).where(stands),
        "answers": select(func.count(BURSTS.c.answer_id)).where(stands),
        "solutions": select(func.count(solutions.solution_id)).where(
            solutions.retracted_utc.is_(None), solutions.burst_id.in_(of_real)
        ),
        "detections": select(func.count(detections.detection_id)).where(
            detections.tier != REJECTED, detections.origin.in_(real)
        ),
        "days": select(func.count(days.day.distinct())).where(days.origin.in_(real)),
        "files": select(func.count()).select_from(table_of(SourceFileRow)),
        "alerts": select(func.count(alerts.sequence)).where(alerts.origin.in_(real)),
        "newest_burst_utc": select(func.max(BURSTS.c.start_utc, type_=UtcTime)).where(stands),
        "updated_utc": select(func.max(BURSTS.c.updated_utc, type_=UtcTime)).where(BURSTS.c.origin.in_(real)),
    }
    statement = select(*(one.scalar_subquery().label(name) for name, one in counted.items()))
    with reading(engine) as connection:
        return Held(**connection.execute(statement).mappings().one())


def state_of(engine: Engine, query: BurstQuery) -> str:
    """Digest of which bursts a query finds, and when what is said of each was changed last: it changes with its answer.

    Cursor and limit do not count.
    """
    order = _order(query.sort)
    found = select(BURSTS.c.burst_id, BURSTS.c.updated_utc).where(*burst_filters(query))
    digest = hashlib.sha256()
    with reading(engine) as connection:
        for row in connection.execute(found.order_by(*ordered_by(order))).yield_per(1000):
            digest.update(f"{row.burst_id} {row.updated_utc.isoformat()}\n".encode())
    return digest.hexdigest()


def changed_utc(engine: Engine, what: Changed) -> datetime | None:
    """When any of all bursts, searched days, files or lists of events was changed last; None where there is none."""
    with reading(engine) as connection:
        return max((one for one in connection.execute(_CHANGED[what]).one() if one is not None), default=None)


def _order(sort: str) -> list[Key]:
    name, descending = sort.removeprefix("-"), sort.startswith("-")
    if name not in _ORDERS:
        raise InputError(
            f"sort: {sort[:40]!r} is not known; choose one of {', '.join(BURST_SORTS)}, or -start and so on"
        )
    key, column, kind = _ORDERS[name]
    nullable = bool(column.nullable)
    return [
        Key(key, column, kind, descending, nullable=nullable),
        Key("burst_id", BURSTS.c.burst_id, str, descending),
    ]


def burst(engine: Engine, burst_id: str, kept: Summaries) -> BurstSummary:
    """One burst with the newest version of each series.

    Raises
    ------
    NoDataError
        Where there is none of that id.
    """
    with reading(engine) as connection:
        rows = connection.execute(_BURST, {"burst_id": burst_id}).mappings().all()
        summaries = _summaries(connection, rows, kept)
    if not summaries:
        raise _no_burst(burst_id)
    return summaries[0]


def _no_burst(burst_id: str) -> NoDataError:
    return NoDataError(f"there is no burst {burst_id}: ids are like T3-20120607-1929")


def versions(engine: Engine, burst_id: str) -> tuple[Solution, ...]:
    """All solutions of a burst, superseded ones too: series by series, the newest version first.

    Raises
    ------
    NoDataError
        Where there is no such burst.
    """
    with reading(engine) as connection:
        found = versions_of(connection, burst_id)
        if (
            not found
            and connection.execute(select(BURSTS.c.burst_id).where(BURSTS.c.burst_id == burst_id)).first() is None
        ):
            raise _no_burst(burst_id)
        return found


def burst_filters(query: BurstQuery) -> list[ColumnElement[bool]]:
    """Conditions of a query on bursts."""
    received = table_of(BurstObservatoryRow)
    conditions: list[ColumnElement[bool]] = [BURSTS.c.origin.in_(sorted(query.origins))]
    if not query.with_retracted:
        conditions.append(BURSTS.c.retracted_utc.is_(None))
    if query.start is not None:
        conditions.append(BURSTS.c.start_utc >= query.start)
    if query.stop is not None:
        conditions.append(BURSTS.c.start_utc < query.stop)
    if query.updated_since is not None:
        conditions.append(BURSTS.c.updated_utc >= query.updated_since)
    for name in sorted(query.observatories):
        by_this = select(received.c.burst_id).where(
            received.c.burst_id == BURSTS.c.burst_id, received.c.observatory == name
        )
        conditions.append(by_this.exists())
    return [*conditions, *_of_answers(query), *_in_ranges(query)]


def _of_answers(query: BurstQuery) -> Iterator[ColumnElement[bool]]:
    flagged = table_of(SolutionFlagRow)
    for column, names in (
        (BURSTS.c.answer_grade, query.grades),
        (BURSTS.c.answer_edge, query.edges),
        (BURSTS.c.answer_method, query.methods),
        (BURSTS.c.answer_preset, query.presets),
    ):
        if names:
            yield column.in_(sorted(names))
    if query.tier is not None:
        yield BURSTS.c.answer_tier == query.tier
    of_answer = select(flagged.c.flag).where(flagged.c.solution_id == BURSTS.c.answer_id).correlate(BURSTS)
    for name in sorted(query.flags):
        yield of_answer.where(flagged.c.flag == name).exists()
    if query.flags_absent:
        yield ~of_answer.where(flagged.c.flag.in_(sorted(query.flags_absent))).exists()


def _in_ranges(query: BurstQuery) -> Iterator[ColumnElement[bool]]:
    for name, (low, high) in _NUMBERS.items():
        least, most = getattr(query, f"{name}_min"), getattr(query, f"{name}_max")
        if least is not None:
            yield high >= least
        if most is not None:
            yield low <= most
    yield from _longitudes(query.longitude_min, query.longitude_max)


def _longitudes(first: float | None, last: float | None) -> Iterator[ColumnElement[bool]]:
    """Longitudes from the first westward to the last, of numbers that are stored from -180 to 180."""
    if first is None and last is None:
        return
    first, last = (-HALF_TURN_DEG if first is None else first), (HALF_TURN_DEG if last is None else last)
    column = BURSTS.c.answer_phi0_deg
    if last - first >= TURN_DEG:
        yield column.is_not(None)
        return
    first, last = (one if abs(one) <= HALF_TURN_DEG else float(within_half_turn_deg(one)) for one in (first, last))
    yield (column >= first) & (column <= last) if first <= last else or_(column >= first, column <= last)


def _summaries(connection: Connection, rows: Sequence[RowMapping], kept: Summaries) -> tuple[BurstSummary, ...]:
    """Bursts of a page in its order, those that were read before as they were."""
    wanted = {(row["burst_id"], row["updated_utc"]): row for row in rows}
    found = kept.of(wanted, lambda missing: _read(connection, missing))
    return tuple(found[key] for key in wanted)


def _read(connection: Connection, rows: Sequence[RowMapping]) -> tuple[BurstSummary, ...]:
    """Bursts of a page with observatories and newest solutions, in a few queries however long it is."""
    ids = [row["burst_id"] for row in rows]
    observatories: dict[str, list[str]] = {burst_id: [] for burst_id in ids}
    for burst_id, name in connection.execute(_RECEIVED, {"burst_ids": ids}):
        observatories[burst_id].append(name)
    newest: dict[str, list[Solution]] = {burst_id: [] for burst_id in ids}
    for solution in newest_of(connection, ids):
        newest[solution.burst_id].append(solution)
    preferred = preferences(connection, ids)
    return tuple(
        BurstSummary(_burst(row, observatories[one]), tuple(newest[one]), preferred.get(one))
        for row in rows
        for one in [row["burst_id"]]
    )


def _burst(row: Any, observatories: list[str]) -> Burst:
    retracted = retraction_of(row["retracted_utc"], row["retracted_reason"])
    known = {name: row[name] for name in _AS_STORED}
    return Burst(**known, observatories=tuple(observatories), origin=Origin(row["origin"]), retracted=retracted)

"""Browsing bursts by time, observatory and quality, page by page."""

import base64
import binascii
import json
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Engine, and_, func, or_, select

from bella.catalogue.engine import reading
from bella.catalogue.models import (
    BurstObservatoryRow,
    BurstRow,
    PreferenceRow,
    SolutionFlagRow,
    SolutionRow,
    as_utc,
    table_of,
)
from bella.catalogue.preference import preferences
from bella.catalogue.records import (
    Burst,
    BurstPage,
    BurstQuery,
    BurstSummary,
    Solution,
)
from bella.catalogue.solutions import SERIES_COLUMNS, is_newest, retraction_of, solution_rows
from bella.exceptions import InputError, NoDataError
from bella.records import Origin

MAX_LIMIT = 1000


def bursts(engine: Engine, query: BurstQuery) -> BurstPage:
    """One page of bursts by ascending onset.

    Parameters
    ----------
    engine : sqlalchemy.Engine
        Engine of the catalogue.
    query : BurstQuery
        Filters, the cursor of the page before, and the size of a page (1 to 1000).

    Returns
    -------
    BurstPage
        With the cursor of the next page and the number of bursts on all pages.

    Raises
    ------
    InputError
        Where the cursor or the limit is not valid.
    """
    if not 1 <= query.limit <= MAX_LIMIT:
        raise InputError(f"limit is {query.limit}: give 1 to {MAX_LIMIT}")
    table, wanted = table_of(BurstRow), _filters(query)
    after = [_after(*parse_cursor(query.cursor))] if query.cursor is not None else []
    page = select(table).where(*wanted, *after).order_by(table.c.start_utc, table.c.burst_id).limit(query.limit + 1)
    with reading(engine) as connection:
        total = connection.execute(select(func.count()).select_from(table).where(*wanted)).scalar_one()
        rows = connection.execute(page).mappings().all()
        shown = rows[: query.limit]
        summaries = _summaries(connection, shown)
    more = len(rows) > query.limit
    return BurstPage(summaries, cursor_after(shown[-1]["start_utc"], shown[-1]["burst_id"]) if more else None, total)


def burst(engine: Engine, burst_id: str) -> BurstSummary:
    """One burst with the newest version of each series.

    Raises
    ------
    NoDataError
        Where there is none of that id.
    """
    table = table_of(BurstRow)
    with reading(engine) as connection:
        rows = connection.execute(select(table).where(table.c.burst_id == burst_id)).mappings().all()
        summaries = _summaries(connection, rows)
    if not summaries:
        raise NoDataError(f"there is no burst {burst_id}: ids are like T3-20120607-1929")
    return summaries[0]


def versions(engine: Engine, burst_id: str) -> tuple[Solution, ...]:
    """All solutions of a burst, superseded ones too: series by series, the newest version first.

    Raises
    ------
    NoDataError
        Where there is no such burst.
    """
    burst(engine, burst_id)
    with reading(engine) as connection:
        return solution_rows(connection, table_of(SolutionRow).c.burst_id == burst_id)


def cursor_after(start_utc: datetime, burst_id: str) -> str:
    """Opaque cursor of the page that begins after a burst.

    Parameters
    ----------
    start_utc : datetime
        Onset of the last burst shown.
    burst_id : str
        Its id.

    Returns
    -------
    str
        URL-safe text.
    """
    return base64.urlsafe_b64encode(json.dumps([as_utc(start_utc).isoformat(), burst_id]).encode()).decode().rstrip("=")


def parse_cursor(cursor: str) -> tuple[datetime, str]:
    """What `cursor_after` was given.

    Raises
    ------
    InputError
        Where the cursor is not one of ours.
    """
    try:
        padded = cursor.encode("ascii") + b"=" * (-len(cursor) % 4)
        start, burst_id = json.loads(base64.b64decode(padded, altchars=b"-_", validate=True))
        return as_utc(datetime.fromisoformat(start)), str(burst_id).replace("\0", "")
    except (binascii.Error, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise InputError(
            "the cursor is not valid: take next_cursor of the page before, or none for the first"
        ) from error


def _after(start_utc: datetime, burst_id: str) -> ColumnElement[bool]:
    """Keyset condition; its first part is implied by the second, but lets SQLite seek in the index."""
    columns = table_of(BurstRow).c
    later = and_(columns.start_utc == start_utc, columns.burst_id > burst_id)
    return and_(columns.start_utc >= start_utc, or_(columns.start_utc > start_utc, later))


def _filters(query: BurstQuery) -> list[ColumnElement[bool]]:
    table, heard = table_of(BurstRow), table_of(BurstObservatoryRow)
    conditions: list[ColumnElement[bool]] = [table.c.origin.in_(sorted(query.origins))]
    if not query.with_retracted:
        conditions.append(table.c.retracted_utc.is_(None))
    if query.start is not None:
        conditions.append(table.c.start_utc >= query.start)
    if query.stop is not None:
        conditions.append(table.c.start_utc < query.stop)
    for name in sorted(query.observatories):
        by_this = select(heard.c.burst_id).where(heard.c.burst_id == table.c.burst_id, heard.c.observatory == name)
        conditions.append(by_this.exists())
    if query.flags_absent:
        flagged = table_of(SolutionFlagRow)
        of_solution = flagged.c.solution_id == table_of(SolutionRow).c.solution_id
        has_flag = select(flagged.c.flag).where(of_solution, flagged.c.flag.in_(sorted(query.flags_absent))).exists()
        conditions.append(~_preferred_is(has_flag))
    if query.grades:
        conditions.append(_preferred_is(table_of(SolutionRow).c.grade.in_(sorted(query.grades))))
    return conditions


def _preferred_is(condition: ColumnElement[bool]) -> ColumnElement[bool]:
    """Condition that a burst has a preferred solution for which `condition` holds."""
    solutions, preference = table_of(SolutionRow), table_of(PreferenceRow)
    same = [solutions.c[name] == preference.c[name] for name in ("burst_id", *SERIES_COLUMNS)]
    such = (
        select(solutions.c.solution_id)
        .join(preference, and_(*same))
        .where(solutions.c.burst_id == table_of(BurstRow).c.burst_id, is_newest(solutions))
        .where(condition)
    )
    return such.correlate(table_of(BurstRow)).exists()


def _summaries(connection: Connection, rows: Any) -> tuple[BurstSummary, ...]:
    """Bursts of a page with observatories and newest solutions, in a few queries however long it is."""
    heard, solutions = table_of(BurstObservatoryRow), table_of(SolutionRow)
    ids = [row["burst_id"] for row in rows]
    by_position = select(heard).where(heard.c.burst_id.in_(ids)).order_by(heard.c.position)
    observatories: dict[str, list[str]] = {burst_id: [] for burst_id in ids}
    for one in connection.execute(by_position):
        observatories[one.burst_id].append(one.observatory)
    newest: dict[str, list[Solution]] = {burst_id: [] for burst_id in ids}
    for solution in solution_rows(connection, solutions.c.burst_id.in_(ids), is_newest(solutions)):
        newest[solution.burst_id].append(solution)
    preferred = preferences(connection, ids)
    return tuple(
        BurstSummary(_burst(row, observatories[one]), tuple(newest[one]), preferred.get(one))
        for row in rows
        for one in [row["burst_id"]]
    )


def _burst(row: Any, observatories: list[str]) -> Burst:
    retracted = retraction_of(row["retracted_utc"], row["retracted_reason"])
    known = {name: row[name] for name in row if name not in {"origin", "retracted_utc", "retracted_reason"}}
    return Burst(**known, observatories=tuple(observatories), origin=Origin(row["origin"]), retracted=retracted)

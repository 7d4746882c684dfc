"""Reading solutions and what belongs to them."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import fields
from datetime import UTC, date, datetime
from itertools import starmap
from typing import Any

from sqlalchemy import (
    BindParameter,
    ColumnElement,
    Connection,
    Engine,
    Row,
    Select,
    and_,
    bindparam,
    false,
    func,
    select,
    update,
)

from bella.answer import Answer, read_track
from bella.catalogue.engine import reading
from bella.catalogue.kept import Kept
from bella.catalogue.models import (
    BurstRow,
    LocalisationRow,
    PreferenceRow,
    SolutionFlagRow,
    SolutionRow,
    SolutionSourceRow,
    SourceFileRow,
    TrackFitRow,
    table_of,
)
from bella.catalogue.paging import Key, check_limit, read_page
from bella.catalogue.records import (
    KnownSource,
    Localisation,
    Retraction,
    Series,
    Solution,
    SolutionPage,
    SolutionQuery,
    SourceFile,
    SourcePage,
    SourceQuery,
    StoredGroup,
    by_preference,
)
from bella.exceptions import NoDataError
from bella.records import JointTrack, Origin, Track

SERIES_COLUMNS = ("edge", "method", "preset", "dimensions")
_ANSWER = tuple(Answer.model_fields)
COPIED_OF_ANSWER = tuple(
    column.name for column in table_of(BurstRow).c if column.name.startswith("answer_") and column.name != "answer_id"
)
"""Columns of a burst that say what its answer says."""

_AS_STORED = (
    *("solution_id", "burst_id", "version", "supersedes", "inputs_hash", "code_version", "store_path", "store_sha256"),
    *("created_utc", "reference_utc", "spectra_path", "pruned_utc"),
)
_SOURCE = ("dataset", "day", "version", "sha256", "state", "uri")
_SOLUTION_ID: BindParameter[str] = bindparam("solution_id")
_PLACED, _FITTED, _LINK, _FILE = map(table_of, (LocalisationRow, TrackFitRow, SolutionSourceRow, SourceFileRow))
_LOCALISATIONS = (
    select(*(_PLACED.c[one.name] for one in fields(Localisation)))
    .where(_PLACED.c.solution_id == _SOLUTION_ID)
    .order_by(_PLACED.c.frequency_mhz)
)
_TRACK_FIT = select(_FITTED.c.fit).where(_FITTED.c.solution_id == _SOLUTION_ID)
_SOURCES = (
    select(*(_FILE.c[one.name] for one in fields(SourceFile)))
    .join(_LINK, _LINK.c.source_id == _FILE.c.source_id)
    .where(_LINK.c.solution_id == _SOLUTION_ID)
    .order_by(_LINK.c.position)
)
MOST_JOINTS = 10_000
"""That are kept in memory, of about 3 kB each."""


def is_newest(table: Any) -> ColumnElement[bool]:
    """Condition that no other solution supersedes one of `table`."""
    later = table_of(SolutionRow).alias("later")
    return ~select(later.c.solution_id).where(later.c.supersedes == table.c.solution_id).exists()


def solution_rows(connection: Connection, *conditions: ColumnElement[bool]) -> tuple[Solution, ...]:
    """Solutions that meet all conditions, with their flags.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        In a transaction.
    *conditions : sqlalchemy.ColumnElement of bool
        On the table of solutions.

    Returns
    -------
    tuple of Solution
        Preferred series first, newer versions first.
    """
    return _read(connection, _statements(*conditions))


def newest_of(connection: Connection, burst_ids: Sequence[str]) -> tuple[Solution, ...]:
    """Newest versions of all series of bursts; those of a burst in the order of `solution_rows`."""
    return _read(connection, _NEWEST, burst_ids=burst_ids)


def versions_of(connection: Connection, burst_id: str) -> tuple[Solution, ...]:
    """All solutions of a burst, in the order of `solution_rows`."""
    return _read(connection, _VERSIONS, burst_id=burst_id)


def _statements(*conditions: ColumnElement[bool]) -> tuple[Select[Any], Select[Any]]:
    """Statements for solutions, and for their flags; to make them takes longer than to read a few rows."""
    table, flagged, bursts = table_of(SolutionRow), table_of(SolutionFlagRow), table_of(BurstRow)
    is_preferred = func.coalesce(bursts.c.answer_id == table.c.solution_id, false())
    of_burst = [bursts.c[name].label(f"burst_{name}") for name in ("origin", "retracted_utc", "retracted_reason")]
    rows = select(table, is_preferred.label("preferred"), *of_burst)
    rows = rows.join(bursts, bursts.c.burst_id == table.c.burst_id).where(*conditions)
    chosen = select(table.c.solution_id).where(*conditions)
    flags = select(flagged.c.solution_id, flagged.c.flag).where(flagged.c.solution_id.in_(chosen))
    return rows, flags.order_by(flagged.c.position)


def _read(connection: Connection, statements: tuple[Select[Any], Select[Any]], **asked: object) -> tuple[Solution, ...]:
    rows = connection.execute(statements[0], asked).mappings().all()
    flags: dict[str, list[str]] = {}
    for solution_id, flag in connection.execute(statements[1], asked):
        flags.setdefault(solution_id, []).append(flag)
    return by_preference(_solution(row, flags.get(row["solution_id"], ())) for row in rows)


def _newest() -> tuple[Select[Any], Select[Any]]:
    """Statements for the newest versions of bursts, which are named twice: else PostgreSQL reads the others as well."""
    asked: BindParameter[Any] = bindparam("burst_ids", expanding=True)
    table = table_of(SolutionRow)
    rows, flags = _statements(table.c.burst_id.in_(asked), is_newest(table))
    return rows.where(table_of(BurstRow).c.burst_id.in_(asked)), flags


_NEWEST = _newest()
_VERSIONS = _statements(table_of(SolutionRow).c.burst_id == bindparam("burst_id"))
_ONE = _statements(table_of(SolutionRow).c.solution_id == bindparam("solution_id"))


def newest(connection: Connection, burst_id: str, series: Series) -> Solution | None:
    """Newest version of a series.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        In a transaction.
    series : Series
        Series of its solutions.

    Returns
    -------
    Solution or None
        None before the first version.
    """
    columns = table_of(SolutionRow).c
    own = [columns[name] == getattr(series, name) for name in SERIES_COLUMNS]
    last = (
        select(columns.solution_id).where(columns.burst_id == burst_id, *own).order_by(columns.version.desc()).limit(1)
    )
    found = solution_rows(connection, columns.solution_id == last.scalar_subquery())
    return found[0] if found else None


def settle_answer(connection: Connection, burst_id: str) -> Solution | None:
    """Note which solution is the answer about a burst, after anything that may have changed it.

    It is the newest version of the preferred series, where neither that nor the burst was retracted.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        In the transaction that may have changed it; it holds the row of the burst.

    Returns
    -------
    Solution or None
        None where it has none.
    """
    table, preference, bursts = table_of(SolutionRow), table_of(PreferenceRow), table_of(BurstRow)
    own = bursts.c.burst_id == burst_id
    same = [preference.c[name] == table.c[name] for name in ("burst_id", *SERIES_COLUMNS)]
    copied = [table.c[name.removeprefix("answer_")].label(name) for name in COPIED_OF_ANSWER]
    wanted = (
        select(table.c.solution_id.label("answer_id"), *copied)
        .join(preference, and_(*same))
        .join(bursts, bursts.c.burst_id == table.c.burst_id)
        .where(own, is_newest(table), table.c.retracted_utc.is_(None), bursts.c.retracted_utc.is_(None))
    )
    found = connection.execute(wanted).mappings().one_or_none()
    values = found or dict.fromkeys(("answer_id", *COPIED_OF_ANSWER))
    connection.execute(update(bursts).where(own).values(**values, updated_utc=datetime.now(UTC)))
    return None if found is None else solution_rows(connection, table.c.solution_id == found["answer_id"])[0]


def solutions(engine: Engine, query: SolutionQuery) -> SolutionPage:
    """One page of solutions by the time of their publication.

    Parameters
    ----------
    query : SolutionQuery
        Filters, the order, the cursor of the page before, and the size of a page (1 to 1000).

    Raises
    ------
    InputError
        Where the cursor or the limit is not valid.
    """
    check_limit(query.limit)
    table, bursts = table_of(SolutionRow), table_of(BurstRow)
    wanted: list[ColumnElement[bool]] = [bursts.c.origin.in_(sorted(query.origins))]
    if not query.with_retracted:
        wanted += [table.c.retracted_utc.is_(None), bursts.c.retracted_utc.is_(None)]
    if query.burst_id is not None:
        wanted.append(table.c.burst_id == query.burst_id)
    if query.created_since is not None:
        wanted.append(table.c.created_utc >= query.created_since)
    if query.newest:
        wanted.append(is_newest(table))
    for name, names in (("edge", query.edges), ("method", query.methods), ("preset", query.presets)):
        if names:
            wanted.append(table.c[name].in_(sorted(names)))
    descending = query.sort == "-created"
    order = (
        Key("created_utc", table.c.created_utc, datetime, descending),
        Key("solution_id", table.c.solution_id, str, descending),
    )
    joined = table.join(bursts, bursts.c.burst_id == table.c.burst_id)
    listed = select(table.c.created_utc, table.c.solution_id).select_from(joined).where(*wanted)
    with reading(engine) as connection:
        page = read_page(connection, query, listed, order)
        ids = [row["solution_id"] for row in page.rows]
        found = {one.solution_id: one for one in solution_rows(connection, table.c.solution_id.in_(ids))}
    return SolutionPage(tuple(found[one] for one in ids), page.next_cursor, page.total)


def solution(engine: Engine, solution_id: str) -> Solution:
    """One solution.

    Raises
    ------
    NoDataError
        Where there is none of that id.
    """
    with reading(engine) as connection:
        return _existing(connection, solution_id)


def localisations(engine: Engine, solution_id: str) -> tuple[Localisation, ...]:
    """Localisations of a solution by ascending frequency.

    Raises
    ------
    NoDataError
        Where there is no such solution.
    """
    rows = _of_solution(engine, solution_id, _LOCALISATIONS)
    return tuple(starmap(Localisation, rows))


def localisations_of(engine: Engine, solution_ids: Collection[str]) -> dict[str, list[Localisation]]:
    """Localisations of many solutions, each by ascending frequency, in one statement; none where there are none."""
    table = table_of(LocalisationRow)
    wanted = select(table).where(table.c.solution_id.in_(solution_ids))
    found: dict[str, list[Localisation]] = {one: [] for one in solution_ids}
    names = [column.name for column in table.c if column.name != "solution_id"]
    with reading(engine) as connection:
        for row in connection.execute(wanted.order_by(table.c.solution_id, table.c.frequency_mhz)).mappings():
            found[row["solution_id"]].append(Localisation(**{name: row[name] for name in names}))
    return found


def places_of(engine: Engine, solution_ids: Collection[str]) -> dict[str, list[tuple[float, float]]]:
    """Positions in the ecliptic plane of many solutions, solar radii, each by ascending frequency, in one statement."""
    columns = table_of(LocalisationRow).c
    wanted = select(columns.solution_id, columns.x_rsun, columns.y_rsun).where(columns.solution_id.in_(solution_ids))
    found: dict[str, list[tuple[float, float]]] = {one: [] for one in solution_ids}
    with reading(engine) as connection:
        for one, x_rsun, y_rsun in connection.execute(wanted.order_by(columns.solution_id, columns.frequency_mhz)):
            found[one].append((x_rsun, y_rsun))
    return found


Joints = Kept[tuple[str, datetime], JointTrack | None]
"""Each under the id of its solution and the time of its publication: nothing of it changes after that."""


def joints_of(engine: Engine, some: Iterable[Solution], kept: Joints) -> dict[str, JointTrack]:
    """Joint fits of those of many solutions that have one, without their profiles, in one statement.

    Returns
    -------
    dict of str to JointTrack
        By the id of the solution.
    """
    wanted = {(one.solution_id, one.created_utc): one.solution_id for one in some}
    found = kept.of(wanted, lambda missing: _joints(engine, missing))
    return {solution_id: joint for (solution_id, _), joint in found.items() if joint is not None}


def _joints(engine: Engine, solution_ids: Sequence[str]) -> list[JointTrack | None]:
    columns = [_FITTED.c.solution_id, _FITTED.c.fit["joint"], _FITTED.c.fit["rotation_period_d"]]
    with reading(engine) as connection:
        rows = connection.execute(select(*columns).where(_FITTED.c.solution_id.in_(solution_ids))).all()
    found = {}
    for solution_id, joint, period_d in rows:
        known = read_track({"joint": joint and {**joint, "profile": ()}, "rotation_period_d": period_d, "remark": ""})
        found[solution_id] = known.joint if known else None
    return [found.get(one) for one in solution_ids]


def track(engine: Engine, solution_id: str) -> Track | None:
    """Track of a solution as a typed record; None where no joint fit was made.

    Raises
    ------
    NoDataError
        Where there is no such solution.
    """
    return read_track(track_fit(engine, solution_id))


def track_fit(engine: Engine, solution_id: str) -> dict[str, Any]:
    """Everything that is said of the track of a solution, as the JSON that is published.

    Raises
    ------
    NoDataError
        Where there is no such solution.
    """
    ((fit,),) = _of_solution(engine, solution_id, _TRACK_FIT)
    return dict(fit)


def sources(engine: Engine, solution_id: str) -> tuple[SourceFile, ...]:
    """Inputs of a solution in the order they were published.

    Raises
    ------
    NoDataError
        Where there is no such solution.
    """
    return tuple(starmap(SourceFile, _of_solution(engine, solution_id, _SOURCES)))


def all_sources(engine: Engine, query: SourceQuery) -> SourcePage:
    """One page of the inputs of all solutions.

    Parameters
    ----------
    query : SourceQuery
        Filters, the order, the cursor of the page before, and the size of a page (1 to 1000).

    Raises
    ------
    InputError
        Where the cursor or the limit is not valid.
    """
    check_limit(query.limit)
    columns = table_of(SourceFileRow).c
    wanted: list[ColumnElement[bool]] = []
    wanted += [] if query.dataset is None else [columns.dataset == query.dataset]
    wanted += [] if query.first is None else [columns.day >= query.first]
    wanted += [] if query.last is None else [columns.day <= query.last]
    wanted += [] if query.updated_since is None else [columns.changed_utc >= query.updated_since]
    descending = query.sort.startswith("-")
    first = {
        "day": Key("day", columns.day, date, descending),
        "updated": Key("changed_utc", columns.changed_utc, datetime, descending),
    }[query.sort.removeprefix("-")]
    order = (first, Key("source_id", columns.source_id, int, descending))
    with reading(engine) as connection:
        page = read_page(connection, query, select(table_of(SourceFileRow)).where(*wanted), order)
    known = (
        KnownSource(SourceFile(**{name: row[name] for name in _SOURCE}), row["received_utc"], row["changed_utc"])
        for row in page.rows
    )
    return SourcePage(tuple(known), page.next_cursor, page.total)


def referenced_paths(engine: Engine) -> frozenset[str]:
    """Store paths the catalogue refers to: posteriors of all versions, and the spectra of each.

    Returns
    -------
    frozenset of str
        Relative to the root of the store.
    """
    solutions, bursts = table_of(SolutionRow).c, table_of(BurstRow).c
    with reading(engine) as connection:
        groups = connection.execute(select(solutions.store_path)).scalars().all()
        paths = (select(column).where(column.is_not(None)) for column in (bursts.spectra_path, solutions.spectra_path))
        spectra = [path for query in paths for path in connection.execute(query).scalars()]
        return frozenset(groups) | frozenset(spectra)


def stored_groups(engine: Engine) -> tuple[StoredGroup, ...]:
    """Every group the catalogue refers to, with its checksum where that is kept.

    Returns
    -------
    tuple of StoredGroup
        By path.
    """
    columns = table_of(SolutionRow).c
    with reading(engine) as connection:
        rows = connection.execute(select(columns.store_path, columns.store_sha256, columns.solution_id)).all()
    found = {path: StoredGroup(path, solution_id, sha256) for path, sha256, solution_id in rows}
    others = referenced_paths(engine) - found.keys()
    return tuple(sorted([*found.values(), *(StoredGroup(path, path.partition("/")[0], None) for path in others)]))


def _existing(connection: Connection, solution_id: str) -> Solution:
    found = _read(connection, _ONE, solution_id=solution_id)
    if not found:
        raise NoDataError(f"there is no solution {solution_id}: list those of its burst")
    return found[0]


def _of_solution(engine: Engine, solution_id: str, query: Select[Any]) -> Sequence[Row[Any]]:
    with reading(engine) as connection:
        found = connection.execute(query, {"solution_id": solution_id}).all()
        if not found:
            _existing(connection, solution_id)
        return found


def _solution(row: Any, flags: Iterable[str]) -> Solution:
    answer, series = ({name: row[name] for name in names} for names in (_ANSWER, SERIES_COLUMNS))
    return Solution(
        series=Series(**series),
        flags=tuple(flags),
        answer=Answer(**answer),
        preferred=bool(row["preferred"]),
        origin=Origin(row["burst_origin"]),
        retracted=retraction_of(row["retracted_utc"], row["retracted_reason"])
        or retraction_of(row["burst_retracted_utc"], row["burst_retracted_reason"]),
        **{name: row[name] for name in _AS_STORED},
    )


def retraction_of(retracted_utc: datetime | None, reason: str | None) -> Retraction | None:
    """Retraction from its columns; None where there is none."""
    return None if retracted_utc is None else Retraction(reason or "", retracted_utc)

"""Publishing a solution: everything about it becomes visible in one commit, as the next version of its series."""

import json
import math
import re
from collections.abc import Callable, Iterable
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

import structlog
from sqlalchemy import Connection, Engine, Table, and_, delete, func, insert, select, update

from bella.answer import Answer, answer_of, read_track
from bella.catalogue.alerts import note_answer
from bella.catalogue.engine import dialect_insert, insert_ignoring, reading, writing
from bella.catalogue.leases import Lease, check_held
from bella.catalogue.models import (
    BurstObservatoryRow,
    BurstRow,
    LocalisationRow,
    SolutionFlagRow,
    SolutionRow,
    SolutionSourceRow,
    SourceFileRow,
    TrackFitRow,
    table_of,
)
from bella.catalogue.preference import follow_publication, lock
from bella.catalogue.records import Burst, Publication, Series, Solution, SourceFile
from bella.catalogue.solutions import newest, settle_answer, solution, solution_rows
from bella.catalogue.submissions import refuse_withdrawn
from bella.exceptions import InputError
from bella.records import Origin, Track, origins_beside

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")

log = structlog.get_logger(__name__)


def find_solution(
    engine: Engine, burst_id: str, series: Series, inputs_hash: str, code_version: str
) -> Solution | None:
    """The newest version of a series, if it was made from these inputs by this code.

    Parameters
    ----------
    series : Series
        Series of its solutions.
    inputs_hash, code_version : str
        What a new solution would be made from, and by.

    Returns
    -------
    Solution or None
        None where there is work to do.
    """
    with reading(engine) as connection:
        return _same(connection, burst_id, series, inputs_hash, code_version)


def publish(
    engine: Engine, publication: Publication, lease: Lease | None = None, check: Callable[[], None] = lambda: None
) -> Solution:
    """Make a solution visible as the next version of its series.

    Parameters
    ----------
    publication : Publication
        The solution and all that belongs to it; its group must be in the store already.
    lease : Lease, optional
        Right to work on the burst; where it is lost nothing is published.
    check : callable, optional
        Called last in the transaction; what it raises undoes all of it. Says that the groups are in the store.

    Returns
    -------
    Solution
        The new version; or, with nothing written at all, the newest one where it has the same inputs and code.

    Raises
    ------
    InputError
        Where a name cannot be part of a solution id, or the localisations are not one per frequency.
    BusyError
        Where the lease was taken over by another run.
    """
    _check(publication)
    key = (publication.burst.burst_id, publication.series, publication.inputs_hash, publication.code_version)
    if (same := find_solution(engine, *key)) is not None:
        return same
    with writing(engine) as connection:
        # on PostgreSQL this locks the burst's row, on SQLite the transaction holds the lock: publishers queue here
        _upsert_burst(connection, publication.burst)
        _refuse_others(connection, publication.burst)
        if (same := _same(connection, *key)) is not None:
            connection.rollback()
            return same
        fit = plain_json(_as_json(publication.track_fit))
        solution_id = _insert_solution(connection, publication, answer_of(read_track(fit), publication.localisations))
        _insert_parts(connection, solution_id, publication, fit)
        published = table_of(SolutionRow).c.solution_id == solution_id
        follow_publication(connection, solution_rows(connection, published)[0])
        note_answer(connection, publication.burst.burst_id)
        new = solution_rows(connection, published)[0]
        if lease is not None:
            check_held(connection, lease)
        check()
    log.info("solution published", burst_id=new.burst_id, solution_id=solution_id, store_path=new.store_path)
    return new


def add_companions(
    engine: Engine, solution_id: str, companions: dict[str, Any], lease: Lease | None = None
) -> dict[str, Any]:
    """Add once what other methods say of the track of a solution; nothing else of it changes.

    Parameters
    ----------
    companions : dict
        By name.
    lease : Lease, optional
        Right to work on the burst; where it is lost nothing is added.

    Returns
    -------
    dict
        Track with them; or, with nothing written, with those that are there already.

    Raises
    ------
    NoDataError
        Where there is no such solution.
    BusyError
        Where the lease was taken over by another run.
    """
    fits, known = table_of(TrackFitRow), solution(engine, solution_id)
    own = fits.c.solution_id == solution_id
    with writing(engine) as connection:
        lock(connection, known.burst_id)
        fit: dict[str, Any] = connection.execute(select(fits.c.fit).where(own)).scalar_one()
        if not fit.get("companions_pending"):
            return fit
        fit = {**fit, "companions": plain_json(companions), "companions_pending": False}
        connection.execute(update(fits).where(own).values(fit=fit))
        settle_answer(connection, known.burst_id)
        if lease is not None:
            check_held(connection, lease)
    log.info("companions added", burst_id=known.burst_id, solution_id=solution_id)
    return fit


def plain_json(value: Any) -> Any:
    """JSON that any database and browser takes: numpy numbers as numbers, NaN and infinity as null.

    Parameters
    ----------
    value : Any
        Dicts, lists, numbers, text, numpy scalars and arrays.

    Returns
    -------
    Any
        The same in plain Python.

    Raises
    ------
    InputError
        Where something in it is none of these.
    """
    if isinstance(value, dict):
        return {str(name): plain_json(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain_json(one) for one in value]
    if hasattr(value, "tolist"):
        return plain_json(value.tolist())
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    try:
        json.dumps(value)
    except TypeError as error:
        raise InputError(f"a track fit cannot hold a {type(value).__name__}: give numbers and text") from error
    return value


def _as_json(track: Track | dict[str, Any]) -> dict[str, Any]:
    return track.model_dump(mode="json") if isinstance(track, Track) else track


def _same(
    connection: Connection, burst_id: str, series: Series, inputs_hash: str, code_version: str
) -> Solution | None:
    last = newest(connection, burst_id, series)
    return last if last and (last.inputs_hash, last.code_version) == (inputs_hash, code_version) else None


def _check(publication: Publication) -> None:
    series = publication.series
    for name in (publication.burst.burst_id, series.edge, series.method, series.preset):
        if not _NAME.fullmatch(name):
            raise InputError(f"{name!r} cannot be part of a solution id: use letters, digits, - and _")
    frequencies = [one.frequency_mhz for one in publication.localisations]
    if len(set(frequencies)) != len(frequencies):
        twice = next(one for one in frequencies if frequencies.count(one) > 1)
        raise InputError(f"{publication.burst.burst_id} is localised twice at {twice} MHz: give each frequency once")


def _refuse_others(connection: Connection, burst: Burst) -> None:
    """Refuse data that may not touch the burst of this id: of another origin, or of a withdrawn submission."""
    own = table_of(BurstRow).c
    kept = Origin(connection.execute(select(own.origin).where(own.burst_id == burst.burst_id)).scalar_one())
    if burst.origin not in origins_beside(kept):
        raise InputError(
            f"{burst.burst_id} is of origin {kept}, and data of origin {burst.origin} cannot change it: give them "
            "another id"
        )
    if burst.origin is Origin.SUBMISSION:
        refuse_withdrawn(connection, burst.burst_id)


def _upsert_burst(connection: Connection, burst: Burst) -> None:
    table, received = table_of(BurstRow), table_of(BurstObservatoryRow)
    values = _plain_row(asdict(burst))
    observatories = values.pop("observatories")
    values.pop("retracted")
    values.pop("updated_utc")
    statement = dialect_insert(connection, table).values(values)
    changed: dict[str, Any] = {
        name: statement.excluded[name] for name in values if name not in {"burst_id", "spectra_path", "origin"}
    }
    # a solution made without spectra does not take away those of an earlier one
    changed["spectra_path"] = func.coalesce(statement.excluded.spectra_path, table.c.spectra_path)
    connection.execute(statement.on_conflict_do_update(index_elements=["burst_id"], set_=changed))
    connection.execute(delete(received).where(received.c.burst_id == burst.burst_id))
    _insert_all(
        connection,
        received,
        ({"burst_id": burst.burst_id, "observatory": name, "position": at} for at, name in _numbered(observatories)),
    )


def _insert_solution(connection: Connection, publication: Publication, answer: Answer) -> str:
    series, burst_id = publication.series, publication.burst.burst_id
    last = newest(connection, burst_id, series)
    version = last.version + 1 if last else 1
    solution_id = f"{burst_id}.{series.edge}.{series.method}.{series.preset}.{series.dimensions}d.v{version}"
    values = {
        "solution_id": solution_id,
        "burst_id": burst_id,
        **asdict(series),
        "version": version,
        "supersedes": last.solution_id if last else None,
        "inputs_hash": publication.inputs_hash,
        "code_version": publication.code_version,
        "store_path": publication.store_path,
        "store_sha256": publication.store_sha256,
        "spectra_path": publication.burst.spectra_path,
        "created_utc": datetime.now(UTC),
        "reference_utc": publication.reference_utc,
        **answer.model_dump(),
    }
    connection.execute(insert(table_of(SolutionRow)).values(values))
    if last:
        _expect_no_companions(connection, last.solution_id)
    return solution_id


def _expect_no_companions(connection: Connection, solution_id: str) -> None:
    """Note that a superseded solution stays without companions, if it has none yet."""
    fits = table_of(TrackFitRow)
    own = fits.c.solution_id == solution_id
    fit: dict[str, Any] = connection.execute(select(fits.c.fit).where(own)).scalar_one()
    if fit.get("companions_pending"):
        connection.execute(update(fits).where(own).values(fit={**fit, "companions_pending": False}))


def _insert_parts(connection: Connection, solution_id: str, publication: Publication, fit: dict[str, Any]) -> None:
    own = {"solution_id": solution_id}
    flags = ({**own, "flag": flag, "position": at} for at, flag in _numbered(publication.flags))
    _insert_all(connection, table_of(SolutionFlagRow), flags)
    _insert_all(connection, table_of(LocalisationRow), ({**own, **asdict(one)} for one in publication.localisations))
    connection.execute(insert(table_of(TrackFitRow)).values(**own, fit=fit))
    # one order for all publishers, or two that share files could wait for one another
    files = sorted(set(publication.sources), key=lambda file: (file.dataset, file.day, file.version, file.sha256))
    ids = {_source_id(connection, file): publication.sources.index(file) for file in files}
    sources = ({**own, "source_id": source_id, "position": at} for source_id, at in ids.items())
    _insert_all(connection, table_of(SolutionSourceRow), sources)


def _source_id(connection: Connection, file: SourceFile) -> int:
    """Row of an input, inserted if need be."""
    table, now = table_of(SourceFileRow), datetime.now(UTC)
    same = and_(*(table.c[name] == getattr(file, name) for name in ("dataset", "day", "version", "sha256")))
    added = insert_ignoring(connection, table, asdict(file) | {"received_utc": now, "changed_utc": now})
    if not added:
        news = (table.c.state != file.state) | (table.c.uri != file.uri)
        values = {"state": file.state, "uri": file.uri, "changed_utc": now}
        connection.execute(update(table).where(same, news).values(values))
    return int(connection.execute(select(table.c.source_id).where(same)).scalar_one())


def _numbered(names: Iterable[str]) -> Iterable[tuple[int, str]]:
    return enumerate(dict.fromkeys(names))


def _insert_all(connection: Connection, table: Table, rows: Iterable[dict[str, Any]]) -> None:
    if values := [_plain_row(row) for row in rows]:
        connection.execute(insert(table), values)


def _plain_row(row: dict[str, Any]) -> dict[str, Any]:
    """Row without numpy's scalars, which the drivers do not all know."""
    return {name: value.item() if hasattr(value, "item") else value for name, value in row.items()}

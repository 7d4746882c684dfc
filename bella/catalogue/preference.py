"""Which series of a burst is its answer: chosen once by the rule, and changed by a person alone.

A newer version of the preferred series is preferred with it. A run that publishes another series changes the choice in
two cases only, and never one that a person made: where the preferred track has no numbers, and where it is preliminary.
Then the rule chooses again, among the series of the same method and preset.
"""

from datetime import UTC, datetime
from typing import Any

import structlog
from sqlalchemy import Connection, Engine, Row, bindparam, delete, select

from bella.catalogue.alerts import note_answer
from bella.catalogue.engine import dialect_insert, writing
from bella.catalogue.models import BurstRow, PreferenceRow, SolutionRow, table_of
from bella.catalogue.records import PERSON, RULE, Preference, Series, Solution, rule_order
from bella.catalogue.solutions import SERIES_COLUMNS, is_newest, solution_rows
from bella.exceptions import InputError, NoDataError

BY_RULE = "chosen by the rule"
_TABLE = table_of(PreferenceRow)
_OF_BURSTS = select(_TABLE).where(_TABLE.c.burst_id.in_(bindparam("burst_ids", expanding=True)))

log = structlog.get_logger(__name__)


def preferences(connection: Connection, burst_ids: list[str]) -> dict[str, Preference]:
    """Preferences of bursts, by burst id.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        In a transaction.
    """
    return {row.burst_id: _preference(row) for row in connection.execute(_OF_BURSTS, {"burst_ids": burst_ids})}


def follow_publication(connection: Connection, new: Solution) -> None:
    """Choose the preferred series of a burst after a publication, where the choice is open; see the module.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        In the transaction that publishes; it holds the row of the burst, so that publishers queue.
    new : Solution
        What was published.
    """
    kept = preferences(connection, [new.burst_id]).get(new.burst_id)
    known = _newest(connection, new.burst_id)
    if kept is None or all(one.series != kept.series for one in known):
        _store(connection, new.burst_id, min(known, key=_by_rule).series, RULE, BY_RULE)
        return
    if kept.chosen_by == PERSON or kept.series == new.series:
        return
    present = next(one for one in known if one.series == kept.series)
    if present.answer.has_track and present.answer.tier == "final":
        return
    best = min((one for one in known if _kind(one.series) == _kind(kept.series)), key=_by_rule)
    if best.series != kept.series:
        _store(connection, new.burst_id, best.series, RULE, BY_RULE)


def prefer(engine: Engine, burst_id: str, name: str, reason: str) -> Solution:
    """Pin the preferred series of a burst.

    Parameters
    ----------
    name : str
        The series, such as "half_rise/posterior/default/2d" or its first parts where these leave one; or the id of its
        newest solution.
    reason : str
        Why, in words.

    Returns
    -------
    Solution
        Now preferred.

    Raises
    ------
    NoDataError
        Where there is no such burst, or the burst has no such series.
    InputError
        Where the name leaves several series, or is that of a solution that has been superseded.
    """
    with writing(engine) as connection:
        known = _locked(connection, burst_id)
        chosen = _named(known, burst_id, name)
        _store(connection, burst_id, chosen.series, PERSON, reason)
        note_answer(connection, burst_id)
        return solution_rows(connection, table_of(SolutionRow).c.solution_id == chosen.solution_id)[0]


def prefer_by_rule(engine: Engine, burst_id: str) -> Solution:
    """Choose the preferred series of a burst by the rule among all that it has, and pin it no longer.

    Returns
    -------
    Solution
        Now preferred.

    Raises
    ------
    NoDataError
        Where there is no such burst, or it has no solution.
    """
    with writing(engine) as connection:
        best = min(_locked(connection, burst_id), key=_by_rule)
        _store(connection, burst_id, best.series, RULE, BY_RULE)
        note_answer(connection, burst_id)
        return solution_rows(connection, table_of(SolutionRow).c.solution_id == best.solution_id)[0]


def choose_again(connection: Connection, burst_id: str) -> None:
    """Let the rule choose where the newest version of the preferred series was retracted; in the same transaction."""
    kept = preferences(connection, [burst_id]).get(burst_id)
    known = _newest(connection, burst_id)
    if kept is None or any(one.series == kept.series for one in known):
        return
    if known:
        _store(connection, burst_id, min(known, key=_by_rule).series, RULE, BY_RULE)
    else:
        connection.execute(delete(_TABLE).where(_TABLE.c.burst_id == burst_id))


def lock(connection: Connection, burst_id: str) -> None:
    """Lock the row of a burst until the transaction ends, so that no one publishes meanwhile.

    Raises
    ------
    NoDataError
        Where there is no such burst.
    """
    bursts = table_of(BurstRow)
    row = connection.execute(select(bursts.c.burst_id).where(bursts.c.burst_id == burst_id).with_for_update())
    if row.first() is None:
        raise NoDataError(f"there is no burst {burst_id}: ids are like T3-20120607-1929")


def _locked(connection: Connection, burst_id: str) -> tuple[Solution, ...]:
    """Newest solutions of a burst that stand, which no one publishes meanwhile."""
    lock(connection, burst_id)
    known = _newest(connection, burst_id)
    if not known:
        raise NoDataError(f"{burst_id} has no solution: run it first")
    return known


def _newest(connection: Connection, burst_id: str) -> tuple[Solution, ...]:
    table = table_of(SolutionRow)
    stands = table.c.retracted_utc.is_(None)
    return solution_rows(connection, table.c.burst_id == burst_id, is_newest(table), stands)


def _named(known: tuple[Solution, ...], burst_id: str, name: str) -> Solution:
    """The one of the newest solutions of a burst that a name means."""
    there = ", ".join(one.series.name for one in known)
    tail = name.strip().removeprefix(f"{burst_id}.")
    for one in known:
        series, version = one.solution_id.removeprefix(f"{burst_id}.").rsplit(".v", 1)
        asked, _, wanted = tail.rpartition(".v")
        if asked == series and wanted.isdecimal() and 0 < int(wanted) < int(version):
            raise InputError(f"{name} was superseded by {one.solution_id}: name that one, or {one.series.name}")
        if tail == one.solution_id.removeprefix(f"{burst_id}."):
            return one
    parts = tail.replace(".", "/").split("/")
    fits = [one for one in known if one.series.name.split("/")[: len(parts)] == parts]
    if not fits:
        raise NoDataError(f"this burst has no such series: {name}; {burst_id} has {there}")
    if len(fits) > 1:
        raise InputError(f"{name} is not one series: name one of {', '.join(one.series.name for one in fits)}")
    return fits[0]


def _store(connection: Connection, burst_id: str, series: Series, chosen_by: str, reason: str) -> None:
    values = {
        "burst_id": burst_id,
        **{name: getattr(series, name) for name in SERIES_COLUMNS},
        "chosen_by": chosen_by,
        "reason": reason,
        "chosen_utc": datetime.now(UTC),
    }
    statement = dialect_insert(connection, _TABLE).values(values)
    changed = {name: statement.excluded[name] for name in values if name != "burst_id"}
    connection.execute(statement.on_conflict_do_update(index_elements=["burst_id"], set_=changed))
    log.info("preferred series", burst_id=burst_id, series=series.name, chosen_by=chosen_by, reason=reason)


def _by_rule(one: Solution) -> tuple[Any, ...]:
    return rule_order(one.series, one.answer)


def _kind(series: Series) -> tuple[str, str]:
    return series.method, series.preset


def _preference(row: Row[Any]) -> Preference:
    series = Series(**{name: getattr(row, name) for name in SERIES_COLUMNS})
    return Preference(series, row.chosen_by, row.reason, row.chosen_utc)

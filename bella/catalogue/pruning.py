"""Which superseded solutions may lose their draws, and where groups of the store have gone."""

from datetime import UTC, datetime

from sqlalchemy import Engine, select, update

from bella.catalogue.engine import reading, writing
from bella.catalogue.models import BurstRow, SolutionRow, table_of
from bella.catalogue.records import Solution
from bella.catalogue.solutions import solution_rows

_TABLE = table_of(SolutionRow)


def prunable(engine: Engine, before_utc: datetime) -> tuple[Solution, ...]:
    """Solutions that were superseded before a time and have not been pruned.

    Parameters
    ----------
    engine : sqlalchemy.Engine
    before_utc : datetime.datetime

    Returns
    -------
    tuple of Solution
        The newest version of a series is never among them.
    """
    later = _TABLE.alias("later")
    superseded = (
        select(later.c.solution_id)
        .where(later.c.supersedes == _TABLE.c.solution_id, later.c.created_utc < before_utc)
        .exists()
    )
    with reading(engine) as connection:
        return solution_rows(connection, superseded, _TABLE.c.pruned_utc.is_(None))


def note_pruned(engine: Engine, solution_id: str, store_path: str, store_sha256: str) -> None:
    """Let a superseded solution point to its group without draws; the group with them is swept afterwards.

    Parameters
    ----------
    engine : sqlalchemy.Engine
    solution_id : str
    store_path, store_sha256 : str
        Of the group without draws.
    """
    values = {"store_path": store_path, "store_sha256": store_sha256, "pruned_utc": datetime.now(UTC)}
    with writing(engine) as connection:
        connection.execute(update(_TABLE).where(_TABLE.c.solution_id == solution_id).values(values))


def note_packed(engine: Engine, folder: str, store_path: str) -> None:
    """Let all that refers to the folder of a group refer to its file, in one commit; the folder is swept afterwards.

    Parameters
    ----------
    engine : sqlalchemy.Engine
    folder, store_path : str
        Paths of the group before and after.
    """
    bursts = table_of(BurstRow)
    with writing(engine) as connection:
        for column in (_TABLE.c.store_path, _TABLE.c.spectra_path, bursts.c.spectra_path):
            connection.execute(update(column.table).where(column == folder).values({column.name: store_path}))

"""What lists of bursts are filtered and ordered by: the answer of each burst, when it changed, latitudes and areas.

Revision 0007. The types are written out: a revision must not change when the models do. The new numbers of older
solutions are those of their stored positions.
"""

from collections.abc import Iterator
from itertools import groupby
from types import SimpleNamespace

import sqlalchemy as sa
from alembic import op

from bella.answer import placed_numbers

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

UTC_TIME = sa.DateTime(timezone=True)
NUMBERS = ("latitude_low_deg", "latitude_high_deg", "area68_rsun2")
INDEXES = (
    ("burst", ("updated_utc", "burst_id")),
    ("burst", ("answer_id",)),
    ("solution", ("created_utc", "solution_id")),
    ("solution", ("phi0_deg",)),
)


def upgrade() -> None:
    """Add the columns, fill them, and index them."""
    never = sa.text("'1970-01-01 00:00:00.000000'")
    op.add_column("burst", sa.Column("updated_utc", UTC_TIME, nullable=False, server_default=never))
    op.add_column("burst", sa.Column("answer_id", sa.String(), nullable=True))
    for name in NUMBERS:
        op.add_column("solution", sa.Column(name, sa.Double(), nullable=True))
    connection = op.get_bind()
    number_solutions(connection)
    settle_bursts(connection)
    for table, columns in INDEXES:
        op.create_index(op.f("_".join(["ix", table, *columns])), table, list(columns))


def downgrade() -> None:
    """Remove indexes and columns."""
    for table, columns in INDEXES:
        op.drop_index(op.f("_".join(["ix", table, *columns])), table_name=table)
    for name in NUMBERS:
        op.drop_column("solution", name)
    for name in ("updated_utc", "answer_id"):
        op.drop_column("burst", name)


def number_solutions(connection: sa.Connection) -> None:
    """Latitudes and area of every solution."""
    names = ", ".join(f"{name} = :{name}" for name in NUMBERS)
    # a solution whose times are not those of one source has no numbers
    nobody = {row.solution_id for row in connection.execute(sa.text(ONE_SOURCE))}
    for solution_id, positions in _positions(connection):
        if solution_id not in nobody:
            values = placed_numbers(positions) | {"solution_id": solution_id}
            connection.execute(sa.text(f"UPDATE solution SET {names} WHERE solution_id = :solution_id"), values)  # noqa: S608 - fixed names


ONE_SOURCE = "SELECT solution_id FROM solution_flag WHERE flag = 'not_one_source'"


def _positions(connection: sa.Connection) -> Iterator[tuple[str, list[SimpleNamespace]]]:
    columns = ("x_rsun", "y_rsun", "z_rsun", "area68_rsun2")
    rows = connection.execute(
        sa.text(f"SELECT solution_id, flags, {', '.join(columns)} FROM localisation ORDER BY solution_id")  # noqa: S608 - fixed names
    )
    for solution_id, some in groupby(rows, key=lambda row: row.solution_id):
        yield (
            solution_id,
            [
                SimpleNamespace(
                    flags=row.flags,
                    **{name: _number(getattr(row, name)) for name in columns},
                )
                for row in some
            ],
        )


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def settle_bursts(connection: sa.Connection) -> None:
    """Answer of every burst, and when it was changed last."""
    connection.execute(sa.text(ANSWERS))
    for statement in CHANGES:
        connection.execute(sa.text(statement))


ANSWERS = """
UPDATE burst SET answer_id = (
    SELECT solution.solution_id FROM solution JOIN preference ON preference.burst_id = solution.burst_id
        AND preference.edge = solution.edge AND preference.method = solution.method
        AND preference.preset = solution.preset AND preference.dimensions = solution.dimensions
    WHERE solution.burst_id = burst.burst_id AND solution.retracted_utc IS NULL
        AND NOT EXISTS (SELECT 1 FROM solution AS later WHERE later.supersedes = solution.solution_id)
) WHERE retracted_utc IS NULL
"""
LATEST = (
    "SELECT max(created_utc) FROM solution WHERE solution.burst_id = burst.burst_id",
    "SELECT max(retracted_utc) FROM solution WHERE solution.burst_id = burst.burst_id",
    "SELECT chosen_utc FROM preference WHERE preference.burst_id = burst.burst_id",
    "retracted_utc",
)
CHANGES = tuple(
    f"UPDATE burst SET updated_utc = ({one}) WHERE ({one}) > updated_utc"  # noqa: S608 - fixed words
    for one in LATEST
)

"""Observability of a day once for data of each origin, as its search.

Revision 0011. The types are written out: a revision must not change when the models do.
"""

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None

OLD = "before_0011_observed_day"


def upgrade() -> None:
    """Add the origin to the key."""
    rebuild(by_origin=True)


def downgrade() -> None:
    """Remove it; days of other data than those of the archive are lost."""
    rebuild(by_origin=False)


def rebuild(*, by_origin: bool) -> None:
    """Make the table anew with the origin in its key or without it: SQLite changes no key."""
    key, kept = (["day", "origin"], "") if by_origin else (["day"], "WHERE origin = 'archive'")
    _run(f"CREATE TABLE {OLD} AS SELECT * FROM observed_day")  # noqa: S608 - fixed words
    op.drop_table("observed_day")
    op.create_table(
        "observed_day",
        sa.Column("day", sa.Date(), nullable=False),
        *([sa.Column("origin", sa.String(), nullable=False, server_default="archive")] if by_origin else []),
        sa.Column("inputs_hash", sa.String(), nullable=False),
        sa.Column("content", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint(*key, name=op.f("pk_observed_day")),
    )
    names = "day, inputs_hash, content"
    _run(f"INSERT INTO observed_day ({names}) SELECT {names} FROM {OLD} {kept}")  # noqa: S608 - fixed words
    op.drop_table(OLD)


def _run(statement: str) -> None:
    op.get_bind().execute(sa.text(statement))

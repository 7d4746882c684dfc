"""The answer about every day, and the spectra that each version of a solution was made with.

Revision 0005. Days that were searched before get their answer from their detections; every version of a solution takes
the spectra that its burst has now: which ones it was made with was not kept.
"""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0003"
branch_labels = None
depends_on = None

ANSWERS = (("localised", "localisable"), ("not localisable", "catalogued"))
"""Answer about a day, and the tier of a detection that makes it; the first that fits."""


def upgrade() -> None:
    """Add columns and fill them."""
    op.add_column("searched_day", sa.Column("answer", sa.String(), nullable=False, server_default="no burst"))
    op.add_column("searched_day", sa.Column("reason", sa.String(), nullable=True))
    op.add_column("solution", sa.Column("spectra_path", sa.String(), nullable=True))
    connection = op.get_bind()
    for answer, tier in reversed(ANSWERS):
        heard = "SELECT day FROM detection WHERE tier = :tier"
        change = sa.text(f"UPDATE searched_day SET answer = :answer WHERE day IN ({heard})")  # noqa: S608 - fixed text
        connection.execute(change, {"answer": answer, "tier": tier})
    connection.execute(
        sa.text(
            "UPDATE solution SET spectra_path = "
            "(SELECT burst.spectra_path FROM burst WHERE burst.burst_id = solution.burst_id)"
        )
    )


def downgrade() -> None:
    """Remove the columns."""
    op.drop_column("solution", "spectra_path")
    op.drop_column("searched_day", "reason")
    op.drop_column("searched_day", "answer")

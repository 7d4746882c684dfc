"""Superseded solutions without companions stay so, and say that none follow.

Revision 0009. The types are written out: a revision must not change when the models do.
"""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

FITS = sa.table("track_fit", sa.column("solution_id", sa.String()), sa.column("fit", sa.JSON()))
SOLUTIONS = sa.table("solution", sa.column("solution_id", sa.String()), sa.column("supersedes", sa.String()))


def upgrade() -> None:
    """Expect no companions of superseded solutions any more."""
    connection = op.get_bind()
    superseded = sa.select(SOLUTIONS.c.supersedes).where(SOLUTIONS.c.supersedes.is_not(None))
    for (name,) in connection.execute(superseded).all():
        own = FITS.c.solution_id == name
        fit = connection.execute(sa.select(FITS.c.fit).where(own)).scalar_one_or_none()
        if fit and fit.get("companions_pending"):
            connection.execute(sa.update(FITS).where(own).values(fit=fit | {"companions_pending": False}))


def downgrade() -> None:
    """Nothing: what was expected never came."""

"""Detections: the days that were searched for bursts, and what was found on them.

Revision 0002. The types are written out: a revision must not change when the models do.
"""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

UTC_TIME = sa.DateTime(timezone=True)


def upgrade() -> None:
    """Make both tables."""
    op.create_table(
        "searched_day",
        sa.Column("day", sa.Date(), nullable=False),
        sa.Column("inputs_hash", sa.String(), nullable=False),
        sa.Column("code_version", sa.String(), nullable=False),
        sa.Column("observatories", sa.String(), nullable=False),
        sa.Column("searched_utc", UTC_TIME, nullable=False),
        sa.PrimaryKeyConstraint("day", name=op.f("pk_searched_day")),
    )
    numbers = ("f_low_mhz", "f_high_mhz", "score", "drift", "peak_db")
    op.create_table(
        "detection",
        sa.Column("detection_id", sa.Integer(), nullable=False),
        sa.Column("day", sa.Date(), nullable=False),
        sa.Column("observatory", sa.String(), nullable=False),
        *(sa.Column(name, UTC_TIME, nullable=False) for name in ("start_utc", "peak_utc", "end_utc")),
        *(sa.Column(name, sa.Double(), nullable=False) for name in numbers),
        sa.Column("channels", sa.Integer(), nullable=False),
        sa.Column("isolated", sa.Boolean(), nullable=False),
        *(sa.Column(name, sa.String(), nullable=False) for name in ("tier", "reason", "burst_id")),
        sa.PrimaryKeyConstraint("detection_id", name=op.f("pk_detection")),
        sa.ForeignKeyConstraint(
            ["day"], ["searched_day.day"], name=op.f("fk_detection_day_searched_day"), ondelete="CASCADE"
        ),
    )
    op.create_index("ix_detection_start_utc", "detection", ["start_utc"])


def downgrade() -> None:
    """Remove both tables."""
    op.drop_table("detection")
    op.drop_table("searched_day")

"""Whether the service is alive: freshness of data sets, times of solutions, mock bursts, observability of days.

Revision 0006. The types are written out: a revision must not change when the models do.
"""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

UTC_TIME = sa.DateTime(timezone=True)


def upgrade() -> None:
    """Add the tables, and the flux of detections at 1 au."""
    op.add_column("detection", sa.Column("flux_sfu_1au", sa.Double(), nullable=True))
    op.create_table(
        "freshness",
        sa.Column("dataset", sa.String(), nullable=False),
        sa.Column("kind", sa.String(), nullable=False),
        sa.Column("observatories", sa.String(), nullable=False),
        sa.Column("latency_d", sa.Double(), nullable=False),
        sa.Column("state", sa.String(), nullable=False),
        sa.Column("asked_utc", UTC_TIME, nullable=False),
        sa.Column("answered_utc", UTC_TIME, nullable=True),
        sa.Column("silent_since_utc", UTC_TIME, nullable=True),
        sa.Column("newest_day", sa.Date(), nullable=True),
        sa.Column("next_utc", UTC_TIME, nullable=False),
        sa.Column("failures", sa.Integer(), nullable=False),
        sa.Column("message", sa.String(), nullable=False),
        sa.PrimaryKeyConstraint("dataset", name=op.f("pk_freshness")),
    )
    op.create_table(
        "solution_times",
        sa.Column("solution_id", sa.String(), nullable=False),
        sa.Column("origin", sa.String(), nullable=False),
        sa.Column("data_utc", UTC_TIME, nullable=False),
        sa.Column("seen_utc", UTC_TIME, nullable=True),
        sa.Column("fetched_utc", UTC_TIME, nullable=True),
        sa.Column("detected_utc", UTC_TIME, nullable=True),
        sa.Column("published_utc", UTC_TIME, nullable=False),
        sa.PrimaryKeyConstraint("solution_id", name=op.f("pk_solution_times")),
        sa.ForeignKeyConstraint(
            ["solution_id"],
            ["solution.solution_id"],
            name=op.f("fk_solution_times_solution_id_solution"),
            ondelete="CASCADE",
        ),
    )
    op.create_index(op.f("ix_solution_times_published_utc"), "solution_times", ["published_utc"])
    op.create_table(
        "mock_run",
        sa.Column("started_utc", UTC_TIME, nullable=False),
        sa.Column("ended_utc", UTC_TIME, nullable=False),
        *(sa.Column(name, sa.String(), nullable=False) for name in ("state", "burst_id", "solution_id")),
        sa.Column("off_deg", sa.Double(), nullable=True),
        sa.Column("message", sa.String(), nullable=False),
        sa.PrimaryKeyConstraint("started_utc", name=op.f("pk_mock_run")),
    )
    op.create_table(
        "observed_day",
        sa.Column("day", sa.Date(), nullable=False),
        sa.Column("inputs_hash", sa.String(), nullable=False),
        sa.Column("content", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("day", name=op.f("pk_observed_day")),
    )


def downgrade() -> None:
    """Remove the tables and the column."""
    op.drop_column("detection", "flux_sfu_1au")
    for name in ("observed_day", "mock_run", "solution_times", "freshness"):
        op.drop_table(name)

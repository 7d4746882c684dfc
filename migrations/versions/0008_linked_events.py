"""Published events: lists of flares, CMEs, particle events and radio bursts, and which belong to a burst.

Revision 0008. The types are written out: a revision must not change when the models do.
"""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

UTC_TIME = sa.DateTime(timezone=True)


def upgrade() -> None:
    """Add the tables."""
    op.create_table(
        "event_list",
        *(sa.Column(name, sa.String(), nullable=False) for name in ("name", "state", "sha256")),
        *(sa.Column(name, sa.Integer(), nullable=False) for name in ("events", "left_out")),
        sa.Column("message", sa.String(), nullable=False),
        *(sa.Column(name, UTC_TIME, nullable=True) for name in ("first_utc", "newest_utc")),
        *(sa.Column(name, UTC_TIME, nullable=False) for name in ("changed_utc", "read_utc")),
        sa.Column("linked_utc", UTC_TIME, nullable=True),
        sa.PrimaryKeyConstraint("name", name=op.f("pk_event_list")),
    )
    op.create_table(
        "event",
        *(
            sa.Column(name, sa.String(), nullable=False)
            for name in ("event_id", "list_name", "kind", "source", "published_id", "observer")
        ),
        *(sa.Column(name, UTC_TIME, nullable=False) for name in ("start_utc", "at_sun_utc")),
        *(sa.Column(name, UTC_TIME, nullable=True) for name in ("peak_utc", "end_utc")),
        sa.Column("size", sa.String(), nullable=False),
        *(sa.Column(name, sa.Double(), nullable=True) for name in ("latitude_deg", "longitude_deg")),
        sa.Column("region", sa.Integer(), nullable=True),
        *(sa.Column(name, sa.Double(), nullable=True) for name in ("f_low_mhz", "f_high_mhz")),
        sa.Column("link", sa.String(), nullable=False),
        sa.PrimaryKeyConstraint("event_id", name=op.f("pk_event")),
        sa.ForeignKeyConstraint(
            ["list_name"], ["event_list.name"], name=op.f("fk_event_list_name_event_list"), ondelete="CASCADE"
        ),
    )
    op.create_index(op.f("ix_event_start_utc_event_id"), "event", ["start_utc", "event_id"])
    op.create_index(op.f("ix_event_list_name"), "event", ["list_name"])
    op.create_table(
        "linked_event",
        sa.Column("burst_id", sa.String(), nullable=False),
        sa.Column("event_id", sa.String(), nullable=False),
        sa.Column("delay_s", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("burst_id", "event_id", name=op.f("pk_linked_event")),
        sa.ForeignKeyConstraint(
            ["burst_id"], ["burst.burst_id"], name=op.f("fk_linked_event_burst_id_burst"), ondelete="CASCADE"
        ),
        sa.ForeignKeyConstraint(
            ["event_id"], ["event.event_id"], name=op.f("fk_linked_event_event_id_event"), ondelete="CASCADE"
        ),
    )
    op.create_index(op.f("ix_linked_event_event_id"), "linked_event", ["event_id"])


def downgrade() -> None:
    """Remove the tables."""
    for table, index in (("linked_event", "event_id"), ("event", "list_name"), ("event", "start_utc_event_id")):
        op.drop_index(op.f(f"ix_{table}_{index}"), table_name=table)
    for table in ("linked_event", "event", "event_list"):
        op.drop_table(table)

"""What lists show, filter and order by stands with the burst itself, so that they need not read all solutions.

Revision 0010. The types are written out: a revision must not change when the models do.
"""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None

WORDS = ("edge", "method", "preset", "tier", "grade", "sentence")
NUMBERS = (
    "phi0_deg",
    "phi0_low_deg",
    "phi0_high_deg",
    "range_low_rsun",
    "range_high_rsun",
    "latitude_low_deg",
    "latitude_high_deg",
    "area68_rsun2",
    "v_sw_km_s",
    "v_sw_low_km_s",
    "v_sw_high_km_s",
)
COPIED: dict[str, sa.types.TypeEngine[Any]] = {
    **dict.fromkeys(WORDS, sa.String()),
    "has_track": sa.Boolean(),
    **dict.fromkeys(NUMBERS, sa.Double()),
}


def upgrade() -> None:
    """Add the columns, fill them from the answers, and index longitudes there."""
    for name, kind in COPIED.items():
        op.add_column("burst", sa.Column(f"answer_{name}", kind, nullable=True))
    own, theirs = (", ".join(f"{start}{name}" for name in COPIED) for start in ("answer_", "solution."))
    op.get_bind().execute(
        sa.text(f"UPDATE burst SET ({own}) = (SELECT {theirs} FROM solution WHERE solution_id = burst.answer_id)")  # noqa: S608 - fixed names
    )
    op.drop_index(op.f("ix_solution_phi0_deg"), table_name="solution")
    op.create_index(op.f("ix_burst_answer_phi0_deg"), "burst", ["answer_phi0_deg"])


def downgrade() -> None:
    """Remove index and columns."""
    op.drop_index(op.f("ix_burst_answer_phi0_deg"), table_name="burst")
    op.create_index(op.f("ix_solution_phi0_deg"), "solution", ["phi0_deg"])
    for name in COPIED:
        op.drop_column("burst", f"answer_{name}")

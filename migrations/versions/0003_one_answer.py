"""One answer per burst: grade and sentence of every solution, and the preferred series of every burst.

Revision 0003. The types are written out: a revision must not change when the models do. What older solutions say is
graded anew from their stored tracks, and the rule chooses the preferred series of every burst.
"""

import json
from datetime import UTC, datetime

import sqlalchemy as sa
from alembic import op

from bella.answer import Answer, answer_of, read_track
from bella.catalogue.records import Series, rule_order

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

NUMBERS = (
    *("phi0_deg", "phi0_low_deg", "phi0_high_deg"),
    *("range_low_rsun", "range_high_rsun"),
    *("v_sw_km_s", "v_sw_low_km_s", "v_sw_high_km_s"),
)
WORDS = ("tier", "grade", "sentence", "has_track")
SERIES = ("edge", "method", "preset", "dimensions")
UTC_TIME = sa.DateTime(timezone=True)


def upgrade() -> None:
    """Add columns and table, and fill both."""
    for name, default in (("tier", "final"), ("grade", "D"), ("sentence", "not graded")):
        op.add_column("solution", sa.Column(name, sa.String(), nullable=False, server_default=default))
    op.add_column("solution", sa.Column("has_track", sa.Boolean(), nullable=False, server_default=sa.false()))
    for name in NUMBERS:
        op.add_column("solution", sa.Column(name, sa.Double(), nullable=True))
    op.create_table(
        "preference",
        sa.Column("burst_id", sa.String(), nullable=False),
        *(sa.Column(name, sa.String(), nullable=False) for name in SERIES[:3]),
        sa.Column("dimensions", sa.Integer(), nullable=False),
        *(sa.Column(name, sa.String(), nullable=False) for name in ("chosen_by", "reason")),
        sa.Column("chosen_utc", UTC_TIME, nullable=False),
        sa.PrimaryKeyConstraint("burst_id", name=op.f("pk_preference")),
        sa.ForeignKeyConstraint(
            ["burst_id"], ["burst.burst_id"], name=op.f("fk_preference_burst_id_burst"), ondelete="CASCADE"
        ),
        sa.CheckConstraint("chosen_by IN ('rule', 'person')", name=op.f("ck_preference_chosen_by_rule_or_person")),
    )
    connection = op.get_bind()
    grade_solutions(connection)
    choose_series(connection)


def downgrade() -> None:
    """Remove both."""
    op.drop_table("preference")
    for name in (*WORDS, *NUMBERS):
        op.drop_column("solution", name)


def grade_solutions(connection: sa.Connection) -> None:
    """Answer of every solution, from its stored track and positions."""
    ids = connection.execute(sa.text("SELECT solution_id FROM solution")).scalars().all()
    names = ", ".join(f"{name} = :{name}" for name in (*WORDS, *NUMBERS))
    for solution_id in ids:
        own = {"solution_id": solution_id}
        fit = connection.execute(sa.text("SELECT fit FROM track_fit WHERE solution_id = :solution_id"), own).scalar()
        stored = json.loads(fit) if isinstance(fit, str) else fit or {}
        columns = "x_rsun, y_rsun, z_rsun, flags"
        rows = connection.execute(sa.text(f"SELECT {columns} FROM localisation WHERE solution_id = :solution_id"), own)  # noqa: S608 - fixed names
        answer = answer_of(read_track(stored), [Place(*row) for row in rows])
        connection.execute(
            sa.text(f"UPDATE solution SET {names} WHERE solution_id = :solution_id"),  # noqa: S608 - fixed names
            {name: getattr(answer, name) for name in (*WORDS, *NUMBERS)} | own,
        )


class Place:
    """Position of a row; NaN where it is not known."""

    def __init__(self, x_rsun: float | None, y_rsun: float | None, z_rsun: float | None, flags: str) -> None:
        self.x_rsun, self.y_rsun, self.z_rsun = (
            float("nan") if one is None else float(one) for one in (x_rsun, y_rsun, z_rsun)
        )
        self.area68_rsun2 = float("nan")  # the answer had no area yet
        self.flags = flags


def choose_series(connection: sa.Connection) -> None:
    """Preferred series of every burst, by the rule, among the newest versions."""
    newest = sa.text(
        "SELECT * FROM solution WHERE NOT EXISTS "
        "(SELECT 1 FROM solution AS later WHERE later.supersedes = solution.solution_id)"
    )
    found: dict[str, list[tuple[Series, Answer]]] = {}
    for row in connection.execute(newest).mappings():
        series = Series(**{name: row[name] for name in SERIES})
        answer = Answer(tier=row["tier"], grade=row["grade"], has_track=bool(row["has_track"]))
        found.setdefault(row["burst_id"], []).append((series, answer))
    table = sa.table(
        "preference",
        *(sa.column(name) for name in ("burst_id", *SERIES, "chosen_by", "reason")),
        sa.column("chosen_utc", UTC_TIME),
    )
    now = datetime.now(UTC)
    for burst_id, candidates in found.items():
        series, _ = min(candidates, key=lambda one: rule_order(*one))
        chosen = {name: getattr(series, name) for name in SERIES}
        said = {"chosen_by": "rule", "reason": "chosen by the rule", "chosen_utc": now}
        connection.execute(table.insert().values(burst_id=burst_id, **chosen, **said))

"""First tables: bursts, versioned solutions with their sources, and stage runs.

Revision 0001, the first one. The types are written out: a revision must not change when the models do.
"""

from datetime import datetime

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

UTC_TIME = sa.DateTime(timezone=True)


def text(name: str, *, nullable: bool = False) -> sa.Column[str]:
    """Text column."""
    return sa.Column(name, sa.String(), nullable=nullable)


def whole(name: str) -> sa.Column[int]:
    """Integer column."""
    return sa.Column(name, sa.Integer(), nullable=False)


def number(name: str, *, nullable: bool = True) -> sa.Column[float]:
    """Column of float64; NULL stands for NaN."""
    return sa.Column(name, sa.Double(), nullable=nullable)


def utc(name: str, *, nullable: bool = False) -> sa.Column[datetime]:
    """Column of times with the zone UTC."""
    return sa.Column(name, UTC_TIME, nullable=nullable)


def upgrade() -> None:
    """Make all tables."""
    create_bursts()
    create_sources()
    create_solutions()
    create_parts_of_solutions()
    create_localisations()
    create_stage_runs()


def downgrade() -> None:
    """Remove all tables, those that refer to others first."""
    for table in (
        "stage_run",
        "localisation",
        "track_fit",
        "solution_source",
        "solution_flag",
        "solution",
        "source_file",
        "burst_observatory",
        "burst",
    ):
        op.drop_table(table)


def create_bursts() -> None:
    """Bursts and who heard them."""
    op.create_table(
        "burst",
        text("burst_id"),
        utc("start_utc"),
        utc("end_utc"),
        number("f_low_mhz", nullable=False),
        number("f_high_mhz", nullable=False),
        text("spectra_path", nullable=True),
        sa.PrimaryKeyConstraint("burst_id", name=op.f("pk_burst")),
    )
    op.create_index("ix_burst_start_utc_burst_id", "burst", ["start_utc", "burst_id"])
    op.create_table(
        "burst_observatory",
        text("burst_id"),
        text("observatory"),
        whole("position"),
        sa.PrimaryKeyConstraint("burst_id", "observatory", name=op.f("pk_burst_observatory")),
        sa.ForeignKeyConstraint(
            ["burst_id"], ["burst.burst_id"], name=op.f("fk_burst_observatory_burst_id_burst"), ondelete="CASCADE"
        ),
    )
    op.create_index("ix_burst_observatory_observatory", "burst_observatory", ["observatory", "burst_id"])


def create_sources() -> None:
    """Inputs, and arrival tables that were handed in."""
    op.create_table(
        "source_file",
        whole("source_id"),
        text("dataset"),
        sa.Column("day", sa.Date(), nullable=False),
        text("version"),
        text("sha256"),
        text("state"),
        text("uri"),
        text("message"),
        text("burst_id", nullable=True),
        utc("received_utc"),
        utc("changed_utc"),
        sa.PrimaryKeyConstraint("source_id", name=op.f("pk_source_file")),
        sa.ForeignKeyConstraint(["burst_id"], ["burst.burst_id"], name=op.f("fk_source_file_burst_id_burst")),
        sa.UniqueConstraint(
            "dataset", "day", "version", "sha256", name=op.f("uq_source_file_dataset_day_version_sha256")
        ),
    )
    op.create_index("ix_source_file_dataset_state", "source_file", ["dataset", "state"])
    op.create_index(
        "uq_source_file_arrival_table",
        "source_file",
        ["sha256"],
        unique=True,
        sqlite_where=sa.text("dataset = 'arrival_table'"),
        postgresql_where=sa.text("dataset = 'arrival_table'"),
    )


def create_solutions() -> None:
    """Versions of solutions."""
    op.create_table(
        "solution",
        text("solution_id"),
        text("burst_id"),
        text("edge"),
        text("method"),
        text("preset"),
        whole("dimensions"),
        whole("version"),
        text("supersedes", nullable=True),
        text("inputs_hash"),
        text("code_version"),
        text("store_path"),
        text("store_sha256"),
        utc("created_utc"),
        utc("reference_utc"),
        sa.PrimaryKeyConstraint("solution_id", name=op.f("pk_solution")),
        sa.ForeignKeyConstraint(["burst_id"], ["burst.burst_id"], name=op.f("fk_solution_burst_id_burst")),
        sa.ForeignKeyConstraint(["supersedes"], ["solution.solution_id"], name=op.f("fk_solution_supersedes_solution")),
        sa.UniqueConstraint(
            "burst_id",
            "edge",
            "method",
            "preset",
            "dimensions",
            "version",
            name=op.f("uq_solution_burst_id_edge_method_preset_dimensions_version"),
        ),
        sa.UniqueConstraint("supersedes", name=op.f("uq_solution_supersedes")),
        sa.UniqueConstraint("store_path", name=op.f("uq_solution_store_path")),
        sa.CheckConstraint("version >= 1", name=op.f("ck_solution_version_from_one")),
        sa.CheckConstraint("(version = 1) = (supersedes IS NULL)", name=op.f("ck_solution_later_version_supersedes")),
    )


def create_parts_of_solutions() -> None:
    """Flags, sources and track fits of solutions."""
    op.create_table(
        "solution_flag",
        text("solution_id"),
        text("flag"),
        whole("position"),
        sa.PrimaryKeyConstraint("solution_id", "flag", name=op.f("pk_solution_flag")),
        owner("solution_flag"),
    )
    op.create_table(
        "solution_source",
        text("solution_id"),
        whole("source_id"),
        whole("position"),
        sa.PrimaryKeyConstraint("solution_id", "source_id", name=op.f("pk_solution_source")),
        owner("solution_source"),
        sa.ForeignKeyConstraint(
            ["source_id"], ["source_file.source_id"], name=op.f("fk_solution_source_source_id_source_file")
        ),
    )
    op.create_index("ix_solution_source_source_id", "solution_source", ["source_id"])
    op.create_table(
        "track_fit",
        text("solution_id"),
        sa.Column("fit", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("solution_id", name=op.f("pk_track_fit")),
        owner("track_fit"),
    )


def owner(table: str) -> sa.ForeignKeyConstraint:
    """Foreign key of a part of a solution."""
    name = op.f(f"fk_{table}_solution_id_solution")
    return sa.ForeignKeyConstraint(["solution_id"], ["solution.solution_id"], name=name, ondelete="CASCADE")


def create_localisations() -> None:
    """One row per frequency of a solution."""
    op.create_table(
        "localisation",
        text("solution_id"),
        number("frequency_mhz", nullable=False),
        number("x_rsun"),
        number("y_rsun"),
        number("z_rsun"),
        number("cov_xx_rsun2"),
        number("cov_xy_rsun2"),
        number("cov_yy_rsun2"),
        number("cov_xz_rsun2"),
        number("cov_yz_rsun2"),
        number("cov_zz_rsun2"),
        number("area68_rsun2"),
        number("area95_rsun2"),
        whole("modes"),
        utc("emission_utc"),
        number("v_over_c"),
        number("v_over_c_sd"),
        number("contraction_x"),
        number("contraction_y"),
        number("contraction_v"),
        number("log_evidence"),
        text("flags"),
        sa.PrimaryKeyConstraint("solution_id", "frequency_mhz", name=op.f("pk_localisation")),
        owner("localisation"),
    )


def create_stage_runs() -> None:
    """Leases."""
    op.create_table(
        "stage_run",
        whole("stage_run_id"),
        text("stage"),
        text("subject"),
        text("run_id"),
        text("token"),
        text("state"),
        whole("attempts"),
        text("host"),
        whole("pid"),
        text("process_start", nullable=True),
        utc("started_utc"),
        utc("expires_utc"),
        utc("ended_utc", nullable=True),
        text("message"),
        sa.PrimaryKeyConstraint("stage_run_id", name=op.f("pk_stage_run")),
        sa.UniqueConstraint("stage", "subject", name=op.f("uq_stage_run_stage_subject")),
    )
    op.create_index("ix_stage_run_started_utc", "stage_run", ["started_utc"])

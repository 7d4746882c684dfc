"""Origins of data, retractions, tokens and submissions of their own, and the outbox of alerts.

Revision 0004. The types are written out: a revision must not change when the models do. What was submitted before keeps
its burst; its state moves from the source files to a table of its own.
"""

from collections.abc import Mapping
from datetime import datetime

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

UTC_TIME = sa.DateTime(timezone=True)
BUILT_IN = "T3-20120607-1929"
"""Burst of the built-in event."""
DETECTION = (
    *("observatory", "start_utc", "peak_utc", "end_utc", "f_low_mhz", "f_high_mhz", "score", "drift", "peak_db"),
    *("channels", "isolated", "tier", "reason", "burst_id"),
)
SOURCE = ("source_id", "dataset", "day", "version", "sha256", "state", "uri", "received_utc", "changed_utc")
LINK = ("solution_id", "source_id", "position")
COPY = "before_0004_"


def upgrade() -> None:
    """Add columns and tables."""
    mark_bursts()
    mark_solutions()
    rebuild_days(by_origin=True)
    make_tokens_and_submissions()
    move_submissions()
    make_outbox()


def downgrade() -> None:
    """Remove them; days that were not searched in files of the archive, tokens, submissions and alerts are lost."""
    for table in ("delivery", "webhook", "alert"):
        op.drop_table(table)
    restore_submissions()
    for table in ("submission", "api_token"):
        op.drop_table(table)
    rebuild_days(by_origin=False)
    for name in ("retracted_utc", "retracted_reason", "pruned_utc"):
        op.drop_column("solution", name)
    for name in ("origin", "retracted_utc", "retracted_reason"):
        op.drop_column("burst", name)


def text(name: str, *, nullable: bool = False, default: str | None = None) -> sa.Column[str]:
    """Text column."""
    return sa.Column(name, sa.String(), nullable=nullable, server_default=default)


def utc(name: str, *, nullable: bool = False) -> sa.Column[datetime]:
    """Column of times with the zone UTC."""
    return sa.Column(name, UTC_TIME, nullable=nullable)


def run(statement: str) -> None:
    """Run a statement of fixed words."""
    op.get_bind().execute(sa.text(statement))


def mark_bursts() -> None:
    """Origin and retraction of bursts."""
    op.add_column("burst", text("origin", default="archive"))
    op.add_column("burst", utc("retracted_utc", nullable=True))
    op.add_column("burst", text("retracted_reason", nullable=True))
    run(f"UPDATE burst SET origin = 'event' WHERE burst_id = '{BUILT_IN}'")  # noqa: S608 - fixed words
    run(
        "UPDATE burst SET origin = 'submission' WHERE burst_id IN "
        "(SELECT burst_id FROM source_file WHERE dataset = 'arrival_table' AND burst_id IS NOT NULL) "
        "AND spectra_path IS NULL"
    )


def mark_solutions() -> None:
    """Retraction and pruning of solutions."""
    op.add_column("solution", utc("retracted_utc", nullable=True))
    op.add_column("solution", text("retracted_reason", nullable=True))
    op.add_column("solution", utc("pruned_utc", nullable=True))


def put_aside(*tables: str) -> None:
    """Copy tables and remove them: SQLite changes no key, and PostgreSQL no two constraints of one name."""
    for table in tables:
        run(f"CREATE TABLE {COPY}{table} AS SELECT * FROM {table}")  # noqa: S608 - fixed words
        op.drop_table(table)


def put_back(
    table: str, columns: tuple[str, ...], where: str = "", order: str = "", extra: Mapping[str, str] | None = None
) -> None:
    """Fill a new table from the copy of the old one, which goes; `extra` are further columns and their values."""
    more = extra or {}
    names, values = ", ".join([*columns, *more]), ", ".join([*columns, *more.values()])
    run(f"INSERT INTO {table} ({names}) SELECT {values} FROM {COPY}{table} {where} {order}")  # noqa: S608 - fixed words
    op.drop_table(f"{COPY}{table}")


def rebuild_days(*, by_origin: bool) -> None:
    """Searched days and their detections, with the origin in their keys or without it."""
    put_aside("detection", "searched_day")
    key = ["day", "origin"] if by_origin else ["day"]
    op.create_table(
        "searched_day",
        sa.Column("day", sa.Date(), nullable=False),
        *([text("origin", default="archive")] if by_origin else []),
        *(text(name) for name in ("inputs_hash", "code_version", "observatories")),
        utc("searched_utc"),
        sa.PrimaryKeyConstraint(*key, name=op.f("pk_searched_day")),
    )
    numbers = ("f_low_mhz", "f_high_mhz", "score", "drift", "peak_db")
    op.create_table(
        "detection",
        sa.Column("detection_id", sa.Integer(), nullable=False),
        sa.Column("day", sa.Date(), nullable=False),
        *([text("origin", default="archive")] if by_origin else []),
        text("observatory"),
        *(utc(name) for name in ("start_utc", "peak_utc", "end_utc")),
        *(sa.Column(name, sa.Double(), nullable=False) for name in numbers),
        sa.Column("channels", sa.Integer(), nullable=False),
        sa.Column("isolated", sa.Boolean(), nullable=False),
        *(text(name) for name in ("tier", "reason", "burst_id")),
        sa.PrimaryKeyConstraint("detection_id", name=op.f("pk_detection")),
        sa.ForeignKeyConstraint(
            key,
            [f"searched_day.{name}" for name in key],
            name=op.f(f"fk_detection_{'_'.join(key)}_searched_day"),
            ondelete="CASCADE",
        ),
    )
    op.create_index("ix_detection_start_utc", "detection", ["start_utc"])
    if by_origin:
        op.create_index("ix_detection_day_origin", "detection", ["day", "origin"])
        op.create_index("ix_detection_burst_id", "detection", ["burst_id"])
    kept = "" if by_origin else "WHERE origin = 'archive'"
    put_back("searched_day", ("day", "inputs_hash", "code_version", "observatories", "searched_utc"), kept)
    put_back("detection", ("day", *DETECTION), kept, "ORDER BY detection_id")


def make_tokens_and_submissions() -> None:
    """Tokens, and what was submitted with them."""
    op.create_table(
        "api_token",
        *(text(name) for name in ("token_id", "name", "sha256")),
        utc("created_utc"),
        utc("revoked_utc", nullable=True),
        sa.PrimaryKeyConstraint("token_id", name=op.f("pk_api_token")),
        sa.UniqueConstraint("sha256", name=op.f("uq_api_token_sha256")),
    )
    op.create_table(
        "submission",
        *(text(name) for name in ("submission_id", "token_id", "sha256", "state", "message")),
        text("burst_id", nullable=True),
        utc("received_utc"),
        utc("changed_utc"),
        sa.PrimaryKeyConstraint("submission_id", name=op.f("pk_submission")),
        sa.UniqueConstraint("token_id", "sha256", name=op.f("uq_submission_token_id_sha256")),
    )
    op.create_index("ix_submission_state_received_utc", "submission", ["state", "received_utc"])


def move_submissions() -> None:
    """Submissions of before, under their checksums; one that waits has to be sent again, with a token."""
    run(
        "INSERT INTO submission (submission_id, token_id, sha256, state, message, burst_id, received_utc, changed_utc) "
        "SELECT 'S-' || sha256, 'anonymous', sha256, CASE WHEN state = 'received' THEN 'failed' ELSE state END, "
        "CASE WHEN state = 'received' THEN 'it waited while the service was upgraded: submit it again' "
        "ELSE message END, burst_id, received_utc, changed_utc FROM source_file WHERE dataset = 'arrival_table'"
    )
    rebuild_sources(old=False)


def restore_submissions() -> None:
    """Source files with the state of a submission in them; only those that a solution was made from are there."""
    rebuild_sources(old=True)


def rebuild_sources(*, old: bool) -> None:
    """Source files and which solution was made from which."""
    put_aside("solution_source", "source_file")
    op.create_table(
        "source_file",
        sa.Column("source_id", sa.Integer(), nullable=False),
        text("dataset"),
        sa.Column("day", sa.Date(), nullable=False),
        *(text(name) for name in ("version", "sha256", "state", "uri")),
        *([text("message"), text("burst_id", nullable=True)] if old else []),
        utc("received_utc"),
        utc("changed_utc"),
        sa.PrimaryKeyConstraint("source_id", name=op.f("pk_source_file")),
        *(
            [sa.ForeignKeyConstraint(["burst_id"], ["burst.burst_id"], name=op.f("fk_source_file_burst_id_burst"))]
            if old
            else []
        ),
        sa.UniqueConstraint(
            "dataset", "day", "version", "sha256", name=op.f("uq_source_file_dataset_day_version_sha256")
        ),
    )
    if old:
        op.create_index("ix_source_file_dataset_state", "source_file", ["dataset", "state"])
        only = sa.text("dataset = 'arrival_table'")
        op.create_index(
            "uq_source_file_arrival_table",
            "source_file",
            ["sha256"],
            unique=True,
            sqlite_where=only,
            postgresql_where=only,
        )
    op.create_table(
        "solution_source",
        text("solution_id"),
        sa.Column("source_id", sa.Integer(), nullable=False),
        sa.Column("position", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("solution_id", "source_id", name=op.f("pk_solution_source")),
        sa.ForeignKeyConstraint(
            ["solution_id"],
            ["solution.solution_id"],
            name=op.f("fk_solution_source_solution_id_solution"),
            ondelete="CASCADE",
        ),
        sa.ForeignKeyConstraint(
            ["source_id"], ["source_file.source_id"], name=op.f("fk_solution_source_source_id_source_file")
        ),
    )
    op.create_index("ix_solution_source_source_id", "solution_source", ["source_id"])
    put_back("source_file", SOURCE, extra={"message": "''"} if old else {})
    put_back("solution_source", LINK)
    if op.get_bind().dialect.name == "postgresql":
        run("SELECT setval('source_file_source_id_seq', (SELECT coalesce(max(source_id), 0) + 1 FROM source_file))")


def make_outbox() -> None:
    """Alerts, their receivers, and what these do not have yet."""
    op.create_table(
        "alert",
        sa.Column("sequence", sa.Integer(), autoincrement=False, nullable=False),
        *(text(name) for name in ("alert_type", "origin", "burst_id")),
        text("solution_id", nullable=True),
        utc("created_utc"),
        sa.Column("body", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("sequence", name=op.f("pk_alert")),
    )
    op.create_index("ix_alert_burst_id_sequence", "alert", ["burst_id", "sequence"])
    op.create_table(
        "webhook",
        *(text(name) for name in ("webhook_id", "url", "secret")),
        sa.Column("with_tests", sa.Boolean(), nullable=False),
        utc("created_utc"),
        utc("removed_utc", nullable=True),
        sa.Column("failures", sa.Integer(), nullable=False),
        utc("next_attempt_utc"),
        text("message"),
        sa.PrimaryKeyConstraint("webhook_id", name=op.f("pk_webhook")),
    )
    op.create_table(
        "delivery",
        text("webhook_id"),
        sa.Column("sequence", sa.Integer(), nullable=False),
        sa.Column("attempts", sa.Integer(), nullable=False),
        utc("next_attempt_utc"),
        sa.PrimaryKeyConstraint("webhook_id", "sequence", name=op.f("pk_delivery")),
        sa.ForeignKeyConstraint(
            ["webhook_id"], ["webhook.webhook_id"], name=op.f("fk_delivery_webhook_id_webhook"), ondelete="CASCADE"
        ),
        sa.ForeignKeyConstraint(["sequence"], ["alert.sequence"], name=op.f("fk_delivery_sequence_alert")),
    )

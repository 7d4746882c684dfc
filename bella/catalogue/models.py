"""Tables of the catalogue. A change here needs a revision in the package `migrations`; a test compares the two."""

from datetime import UTC, date, datetime
from math import isnan, nan
from typing import Any, cast

from sqlalchemy import JSON, CheckConstraint, DateTime, Dialect, Double, ForeignKey, Index, MetaData, Table, false, text
from sqlalchemy import ForeignKeyConstraint as Foreign
from sqlalchemy import UniqueConstraint as Unique
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column
from sqlalchemy.types import TypeDecorator


class UtcTime(TypeDecorator[datetime]):
    """Time with the zone UTC in Python; in SQLite text of fixed width without a zone, which sorts like time."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """UTC for the database."""
        if value is None:
            return None
        utc = as_utc(value)
        return utc.replace(tzinfo=None) if dialect.name == "sqlite" else utc

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:  # noqa: ARG002
        """UTC from the database."""
        return None if value is None else as_utc(value)


class Number(TypeDecorator[float]):
    """Float that may be NaN, which SQLite cannot keep: NULL stands for it in every database."""

    impl = Double
    cache_ok = True

    def process_bind_param(self, value: float | None, dialect: Dialect) -> float | None:  # noqa: ARG002
        """NULL for NaN."""
        return None if value is None or isnan(value) else float(value)

    def process_result_value(self, value: float | None, dialect: Dialect) -> float:  # noqa: ARG002
        """NaN for NULL."""
        return nan if value is None else value


def as_utc(value: datetime) -> datetime:
    """Plain datetime with the zone UTC, to the microsecond.

    Parameters
    ----------
    value : datetime
        Any datetime, a pandas Timestamp too; without a zone it is taken as UTC.

    Returns
    -------
    datetime
        The same instant.
    """
    utc = value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)
    return datetime(utc.year, utc.month, utc.day, utc.hour, utc.minute, utc.second, utc.microsecond, tzinfo=UTC)


class Base(DeclarativeBase):
    """Root of the tables; names of constraints follow one rule so that migrations can name them."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "ck": "ck_%(table_name)s_%(constraint_name)s",
            "fk": "fk_%(table_name)s_%(column_0_N_name)s_%(referred_table_name)s",
            "pk": "pk_%(table_name)s",
        }
    )


def table_of(model: type[Base]) -> Table:
    """Table of a model, for statements that work on rows without the object layer."""
    return cast("Table", model.__table__)


class SourceFileRow(Base):
    """Inputs: files of the archive, and arrival tables that were submitted."""

    __tablename__ = "source_file"
    __table_args__ = (Unique("dataset", "day", "version", "sha256"),)

    source_id: Mapped[int] = mapped_column(primary_key=True)
    dataset: Mapped[str]
    day: Mapped[date]
    version: Mapped[str]
    sha256: Mapped[str]
    state: Mapped[str]
    uri: Mapped[str]
    received_utc: Mapped[datetime] = mapped_column(UtcTime)
    changed_utc: Mapped[datetime] = mapped_column(UtcTime)


class SearchedDayRow(Base):
    """Answers about days, once for data of each origin: what was searched, or why it was not."""

    __tablename__ = "searched_day"

    day: Mapped[date] = mapped_column(primary_key=True)
    origin: Mapped[str] = mapped_column(primary_key=True, server_default="archive")
    inputs_hash: Mapped[str]
    code_version: Mapped[str]
    observatories: Mapped[str]
    searched_utc: Mapped[datetime] = mapped_column(UtcTime)
    answer: Mapped[str] = mapped_column(server_default="no burst")
    reason: Mapped[str] = mapped_column(server_default=text("''"))


class DetectionRow(Base):
    """Bursts as one spacecraft detected them on a searched day; those of a day and an origin are replaced together."""

    __tablename__ = "detection"
    __table_args__ = (
        Foreign(["day", "origin"], ["searched_day.day", "searched_day.origin"], ondelete="CASCADE"),
        Index("ix_detection_start_utc", "start_utc"),
        Index("ix_detection_day_origin", "day", "origin"),
        Index("ix_detection_burst_id", "burst_id"),
    )

    detection_id: Mapped[int] = mapped_column(primary_key=True)
    day: Mapped[date]
    origin: Mapped[str] = mapped_column(server_default="archive")
    observatory: Mapped[str]
    start_utc: Mapped[datetime] = mapped_column(UtcTime)
    peak_utc: Mapped[datetime] = mapped_column(UtcTime)
    end_utc: Mapped[datetime] = mapped_column(UtcTime)
    f_low_mhz: Mapped[float] = mapped_column(Double)
    f_high_mhz: Mapped[float] = mapped_column(Double)
    score: Mapped[float] = mapped_column(Double)
    drift: Mapped[float] = mapped_column(Double)
    peak_db: Mapped[float] = mapped_column(Double)
    channels: Mapped[int]
    isolated: Mapped[bool]
    tier: Mapped[str]
    reason: Mapped[str]
    burst_id: Mapped[str]
    flux_sfu_1au: Mapped[float] = mapped_column(Number, nullable=True)


class BurstRow(Base):
    """Bursts, by stable id."""

    __tablename__ = "burst"
    __table_args__ = (
        Index("ix_burst_start_utc_burst_id", "start_utc", "burst_id"),
        Index("ix_burst_updated_utc_burst_id", "updated_utc", "burst_id"),
        Index("ix_burst_answer_id", "answer_id"),
        Index("ix_burst_answer_phi0_deg", "answer_phi0_deg"),
    )

    burst_id: Mapped[str] = mapped_column(primary_key=True)
    start_utc: Mapped[datetime] = mapped_column(UtcTime)
    end_utc: Mapped[datetime] = mapped_column(UtcTime)
    f_low_mhz: Mapped[float] = mapped_column(Double)
    f_high_mhz: Mapped[float] = mapped_column(Double)
    spectra_path: Mapped[str | None]
    origin: Mapped[str] = mapped_column(server_default="archive")
    retracted_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    retracted_reason: Mapped[str | None]
    updated_utc: Mapped[datetime] = mapped_column(UtcTime, server_default=text("'1970-01-01 00:00:00.000000'"))
    """When what is said of the burst was changed last."""
    answer_id: Mapped[str | None]
    """Its preferred solution: settled whenever it may have changed, with the copies of it below, which lists read."""
    answer_edge: Mapped[str | None]
    answer_method: Mapped[str | None]
    answer_preset: Mapped[str | None]
    answer_tier: Mapped[str | None]
    answer_grade: Mapped[str | None]
    answer_sentence: Mapped[str | None]
    answer_has_track: Mapped[bool | None]
    answer_phi0_deg: Mapped[float | None] = mapped_column(Double)
    answer_phi0_low_deg: Mapped[float | None] = mapped_column(Double)
    answer_phi0_high_deg: Mapped[float | None] = mapped_column(Double)
    answer_range_low_rsun: Mapped[float | None] = mapped_column(Double)
    answer_range_high_rsun: Mapped[float | None] = mapped_column(Double)
    answer_latitude_low_deg: Mapped[float | None] = mapped_column(Double)
    answer_latitude_high_deg: Mapped[float | None] = mapped_column(Double)
    answer_area68_rsun2: Mapped[float | None] = mapped_column(Double)
    answer_v_sw_km_s: Mapped[float | None] = mapped_column(Double)
    answer_v_sw_low_km_s: Mapped[float | None] = mapped_column(Double)
    answer_v_sw_high_km_s: Mapped[float | None] = mapped_column(Double)


class BurstObservatoryRow(Base):
    """Who received a burst."""

    __tablename__ = "burst_observatory"
    __table_args__ = (Index("ix_burst_observatory_observatory", "observatory", "burst_id"),)

    burst_id: Mapped[str] = mapped_column(ForeignKey("burst.burst_id", ondelete="CASCADE"), primary_key=True)
    observatory: Mapped[str] = mapped_column(primary_key=True)
    position: Mapped[int]


class SolutionRow(Base):
    """Versions of solutions; rows are only added, and marked where they are retracted or their draws are pruned."""

    __tablename__ = "solution"
    __table_args__ = (
        Unique("burst_id", "edge", "method", "preset", "dimensions", "version"),
        Unique("supersedes"),
        Unique("store_path"),
        CheckConstraint("version >= 1", name="version_from_one"),
        CheckConstraint("(version = 1) = (supersedes IS NULL)", name="later_version_supersedes"),
        Index("ix_solution_created_utc_solution_id", "created_utc", "solution_id"),
    )

    solution_id: Mapped[str] = mapped_column(primary_key=True)
    burst_id: Mapped[str] = mapped_column(ForeignKey("burst.burst_id"))
    edge: Mapped[str]
    method: Mapped[str]
    preset: Mapped[str]
    dimensions: Mapped[int]
    version: Mapped[int]
    supersedes: Mapped[str | None] = mapped_column(ForeignKey("solution.solution_id"))
    inputs_hash: Mapped[str]
    code_version: Mapped[str]
    store_path: Mapped[str]
    store_sha256: Mapped[str]
    created_utc: Mapped[datetime] = mapped_column(UtcTime)
    reference_utc: Mapped[datetime] = mapped_column(UtcTime)
    tier: Mapped[str] = mapped_column(server_default="final")
    grade: Mapped[str] = mapped_column(server_default="D")
    sentence: Mapped[str] = mapped_column(server_default="not graded")
    has_track: Mapped[bool] = mapped_column(server_default=false())
    phi0_deg: Mapped[float | None] = mapped_column(Double)
    phi0_low_deg: Mapped[float | None] = mapped_column(Double)
    phi0_high_deg: Mapped[float | None] = mapped_column(Double)
    range_low_rsun: Mapped[float | None] = mapped_column(Double)
    range_high_rsun: Mapped[float | None] = mapped_column(Double)
    v_sw_km_s: Mapped[float | None] = mapped_column(Double)
    v_sw_low_km_s: Mapped[float | None] = mapped_column(Double)
    v_sw_high_km_s: Mapped[float | None] = mapped_column(Double)
    retracted_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    retracted_reason: Mapped[str | None]
    pruned_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    spectra_path: Mapped[str | None]
    latitude_low_deg: Mapped[float | None] = mapped_column(Double)
    latitude_high_deg: Mapped[float | None] = mapped_column(Double)
    area68_rsun2: Mapped[float | None] = mapped_column(Double)


class PreferenceRow(Base):
    """Series whose newest version is the answer about a burst; by the rule, or pinned by a person."""

    __tablename__ = "preference"
    __table_args__ = (CheckConstraint("chosen_by IN ('rule', 'person')", name="chosen_by_rule_or_person"),)

    burst_id: Mapped[str] = mapped_column(ForeignKey("burst.burst_id", ondelete="CASCADE"), primary_key=True)
    edge: Mapped[str]
    method: Mapped[str]
    preset: Mapped[str]
    dimensions: Mapped[int]
    chosen_by: Mapped[str]
    reason: Mapped[str]
    chosen_utc: Mapped[datetime] = mapped_column(UtcTime)


class SolutionFlagRow(Base):
    """Quality flags of a solution."""

    __tablename__ = "solution_flag"

    solution_id: Mapped[str] = mapped_column(ForeignKey("solution.solution_id", ondelete="CASCADE"), primary_key=True)
    flag: Mapped[str] = mapped_column(primary_key=True)
    position: Mapped[int]


class SolutionSourceRow(Base):
    """Which inputs a solution was made from."""

    __tablename__ = "solution_source"
    __table_args__ = (Index("ix_solution_source_source_id", "source_id"),)

    solution_id: Mapped[str] = mapped_column(ForeignKey("solution.solution_id", ondelete="CASCADE"), primary_key=True)
    source_id: Mapped[int] = mapped_column(ForeignKey("source_file.source_id"), primary_key=True)
    position: Mapped[int]


class LocalisationRow(Base):
    """One row per frequency of a solution; columns are those of the localisation table."""

    __tablename__ = "localisation"

    solution_id: Mapped[str] = mapped_column(ForeignKey("solution.solution_id", ondelete="CASCADE"), primary_key=True)
    frequency_mhz: Mapped[float] = mapped_column(Double, primary_key=True)
    x_rsun: Mapped[float | None] = mapped_column(Number)
    y_rsun: Mapped[float | None] = mapped_column(Number)
    z_rsun: Mapped[float | None] = mapped_column(Number)
    cov_xx_rsun2: Mapped[float | None] = mapped_column(Number)
    cov_xy_rsun2: Mapped[float | None] = mapped_column(Number)
    cov_yy_rsun2: Mapped[float | None] = mapped_column(Number)
    cov_xz_rsun2: Mapped[float | None] = mapped_column(Double)
    cov_yz_rsun2: Mapped[float | None] = mapped_column(Double)
    cov_zz_rsun2: Mapped[float | None] = mapped_column(Double)
    area68_rsun2: Mapped[float | None] = mapped_column(Number)
    area95_rsun2: Mapped[float | None] = mapped_column(Number)
    modes: Mapped[int]
    emission_utc: Mapped[datetime] = mapped_column(UtcTime)
    v_over_c: Mapped[float | None] = mapped_column(Number)
    v_over_c_sd: Mapped[float | None] = mapped_column(Number)
    contraction_x: Mapped[float | None] = mapped_column(Number)
    contraction_y: Mapped[float | None] = mapped_column(Number)
    contraction_v: Mapped[float | None] = mapped_column(Number)
    log_evidence: Mapped[float | None] = mapped_column(Number)
    flags: Mapped[str]


class TrackFitRow(Base):
    """The fits to a solution's track, as the JSON that is published."""

    __tablename__ = "track_fit"

    solution_id: Mapped[str] = mapped_column(ForeignKey("solution.solution_id", ondelete="CASCADE"), primary_key=True)
    fit: Mapped[dict[str, Any]] = mapped_column(JSON)


class StageRunRow(Base):
    """Leases: the last run of a stage on a subject. `token` changes with every owner and decides races."""

    __tablename__ = "stage_run"
    __table_args__ = (Unique("stage", "subject"), Index("ix_stage_run_started_utc", "started_utc"))

    stage_run_id: Mapped[int] = mapped_column(primary_key=True)
    stage: Mapped[str]
    subject: Mapped[str]
    run_id: Mapped[str]
    token: Mapped[str]
    state: Mapped[str]
    attempts: Mapped[int]
    host: Mapped[str]
    pid: Mapped[int]
    process_start: Mapped[str | None]
    started_utc: Mapped[datetime] = mapped_column(UtcTime)
    expires_utc: Mapped[datetime] = mapped_column(UtcTime)
    ended_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    message: Mapped[str]


class TokenRow(Base):
    """Who may submit arrival tables; of the token itself only its SHA-256 is kept."""

    __tablename__ = "api_token"
    __table_args__ = (Unique("sha256"),)

    token_id: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str]
    sha256: Mapped[str]
    created_utc: Mapped[datetime] = mapped_column(UtcTime)
    revoked_utc: Mapped[datetime | None] = mapped_column(UtcTime)


class SubmissionRow(Base):
    """Arrival tables that were submitted; the same table of the same token is one submission."""

    __tablename__ = "submission"
    __table_args__ = (Unique("token_id", "sha256"), Index("ix_submission_state_received_utc", "state", "received_utc"))

    submission_id: Mapped[str] = mapped_column(primary_key=True)
    token_id: Mapped[str]
    """Of the token, or `anonymous` where submissions are open."""
    sha256: Mapped[str]
    state: Mapped[str]
    message: Mapped[str]
    burst_id: Mapped[str | None]
    received_utc: Mapped[datetime] = mapped_column(UtcTime)
    changed_utc: Mapped[datetime] = mapped_column(UtcTime)


class AlertRow(Base):
    """Alerts in the order of their commits; rows are only added, in the transaction of what they tell."""

    __tablename__ = "alert"
    __table_args__ = (Index("ix_alert_burst_id_sequence", "burst_id", "sequence"),)

    sequence: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    alert_type: Mapped[str]
    origin: Mapped[str]
    burst_id: Mapped[str]
    """No foreign key: what was told stays where a mock burst is forgotten."""
    solution_id: Mapped[str | None]
    created_utc: Mapped[datetime] = mapped_column(UtcTime)
    body: Mapped[dict[str, Any]] = mapped_column(JSON)


class WebhookRow(Base):
    """Receivers of alerts; the secret signs what is sent to them, so it is kept as it is."""

    __tablename__ = "webhook"

    webhook_id: Mapped[str] = mapped_column(primary_key=True)
    url: Mapped[str]
    secret: Mapped[str]
    with_tests: Mapped[bool]
    created_utc: Mapped[datetime] = mapped_column(UtcTime)
    removed_utc: Mapped[datetime | None] = mapped_column(UtcTime)
    failures: Mapped[int]
    next_attempt_utc: Mapped[datetime] = mapped_column(UtcTime)
    message: Mapped[str]


class DeliveryRow(Base):
    """Alerts that a receiver does not have yet; a row goes when its alert was taken or given up."""

    __tablename__ = "delivery"

    webhook_id: Mapped[str] = mapped_column(ForeignKey("webhook.webhook_id", ondelete="CASCADE"), primary_key=True)
    sequence: Mapped[int] = mapped_column(ForeignKey("alert.sequence"), primary_key=True)
    attempts: Mapped[int]
    next_attempt_utc: Mapped[datetime] = mapped_column(UtcTime)

"""What crosses rooms, typed once: parameters with their quantiles, and the track of a burst.

Everything here is frozen and is written to JSON as it stands; numbers that are not known are None.
"""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Tier = Literal["final", "preliminary"]


class Record(BaseModel):
    """Base of all records."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="null")


class Parameter(Record):
    """Posterior of one number, in the unit of its name; the median with q16 and q84 is what is shown."""

    q2_5: float | None = None
    q16: float | None = None
    q50: float | None = None
    q84: float | None = None
    q97_5: float | None = None
    mean: float | None = None
    sd: float | None = None
    contraction: float | None = Field(
        default=None, description="Width of the 68 % interval over that of the prior; null for a prior without a width."
    )


class Moment(Record):
    """Posterior of a time: UTC as ISO 8601 with Z, and its standard deviation in seconds."""

    q2_5: str | None = None
    q16: str | None = None
    q50: str | None = None
    q84: str | None = None
    q97_5: str | None = None
    mean: str | None = None
    sd: float | None = None


class Interval(Record):
    """Part of a credible region of a longitude: from `low` eastward of `high`, degrees HEE, west positive."""

    low: float
    high: float = Field(description="Above `low`; beyond 180 where the part lies across the far side.")
    probability: float


class SourceAt(Record):
    """Where a track is at one frequency."""

    frequency_mhz: float
    range_rsun: Parameter
    longitude_deg: Parameter
    beam_speed_c: Parameter | None = Field(default=None, description="Along the field line, at this distance.")


class WindPart(Record):
    """Speed of the wind in a part of a track."""

    from_rsun: float
    to_rsun: float | None
    v_sw_km_s: Parameter


class NoiseOfEdges(Record):
    """Noise of the arrival times of a burst beyond their stated errors, as fractions of the half width of the rise."""

    shape: float = Field(description="Error that is smooth along frequency within a spacecraft.")
    channel: float = Field(description="Error of each channel on its own.")
    added: float = Field(
        default=0.0, description="Part of `shape` that the table does not state: the track asks for it."
    )
    kappa: Parameter | None = Field(default=None, description="Delay of a receiver that the source does not point to.")


class JointTrack(Record):
    """One source on one Parker spiral, fitted to all arrival times of a burst together."""

    tier: Tier = "final"
    model: str
    rotation_period_d: float
    epoch_utc: str
    phi0_deg: Parameter = Field(description="Longitude of the spiral at 1 solar radius, HEE, west positive.")
    phi0_68: tuple[Interval, ...] = Field(default=(), description="Smallest region that holds 68 %.")
    phi0_95: tuple[Interval, ...] = ()
    v_sw_km_s: Parameter
    winds: tuple[WindPart, ...] = Field(default=(), description="Where the speed of the wind changes on the way.")
    beam_speed_c: Parameter = Field(description="Along the field line, between the highest and lowest frequency.")
    release_utc: Moment
    profile: tuple[SourceAt, ...] = ()
    offsets_s: dict[str, Parameter] = Field(default_factory=dict, description="Timing offset of each spacecraft.")
    noise: NoiseOfEdges | None = None
    chi2: float | None = Field(default=None, description="Of the best track, before any error is widened.")
    freedom: int | None = None
    misfit_p: float | None = Field(
        default=None, description="Probability of a larger chi2: near 0 the fit is poor, near 1 the errors too large."
    )
    log_evidence: float | None = None
    ess: float | None = None
    times: int = 0
    flags: tuple[str, ...] = ()


class Track(Record):
    """Everything that is said of the track of a burst."""

    frame: Literal["HEE"] = "HEE"
    remark: str
    rotation_period_d: float
    joint: JointTrack
    two_step: dict[str, Any] = Field(default_factory=dict)
    two_step_other_rotations: dict[str, dict[str, Any]] = Field(default_factory=dict)
    companions: dict[str, dict[str, Any]] = Field(default_factory=dict)

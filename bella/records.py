"""What crosses rooms, typed once: parameters with their quantiles, and the track of a burst.

Everything here is frozen and is written to JSON as it stands; numbers that are not known are None.
"""

import math
from datetime import date
from enum import StrEnum
from statistics import NormalDist
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

Tier = Literal["final", "preliminary"]

QUANTILES = {"q2_5": 0.025, "q16": 0.16, "q50": 0.5, "q84": 0.84, "q97_5": 0.975}
"""Quantiles that every parameter is stored with: the median, and the ends of the 68 % and the 95 % interval."""


class Origin(StrEnum):
    """Where data come from: a spectrum, and all that is made of it, carries it from file to page."""

    ARCHIVE = "archive"
    EVENT = "event"
    SUBMISSION = "submission"
    USER = "user"
    SIMULATED = "simulated"
    TEST = "test"


REAL_ORIGINS = (Origin.ARCHIVE, Origin.EVENT, Origin.SUBMISSION, Origin.USER)
"""What a query or a count holds unless another origin is asked for."""
UNREAL_ORIGINS = (Origin.SIMULATED, Origin.TEST)


_NAMESPACE = {Origin.USER: "USER", Origin.SIMULATED: "SIM", Origin.TEST: "TEST"}


def burst_name(name: str, origin: Origin) -> str:
    """Id of a burst for data of an origin: bursts of the archive and of the event share one namespace, others do not.

    Parameters
    ----------
    name : str
        Such as T3-20211120-0312.
    origin : Origin

    Returns
    -------
    str
        The same, or such as SIM-20211120-0312, so that data of one origin never touch a burst of another.
    """
    return f"{_NAMESPACE[origin]}-{name.removeprefix('T3-')}" if origin in _NAMESPACE else name


def is_named_for(name: str, origin: Origin) -> bool:
    """Whether an id is of the namespace in which bursts of an origin have theirs."""
    return name.partition("-")[0] == _NAMESPACE.get(origin, "T3")


def origins_beside(origin: Origin) -> frozenset[Origin]:
    """Origins whose bursts data of an origin may refine: archive and built-in event refine one another."""
    shared = frozenset({Origin.ARCHIVE, Origin.EVENT})
    return shared if origin in shared else frozenset({origin})


def origins_asked(text: str | None) -> tuple[Origin, ...]:
    """Origins that a query asks for: those that are real where it does not say, `all`, or one.

    Raises
    ------
    ValueError
        Where there is no such origin.
    """
    if text is None:
        return REAL_ORIGINS
    return tuple(Origin) if text == ALL_ORIGINS else (Origin(text),)


class AlertType(StrEnum):
    """What an alert says of its burst: the first answer, another one, or none; TEST where data are not real."""

    PRELIMINARY = "PRELIMINARY"
    UPDATE = "UPDATE"
    RETRACTION = "RETRACTION"
    TEST = "TEST"


ANNOUNCED_ORIGINS = (Origin.ARCHIVE, Origin.EVENT, Origin.USER)
"""Whose alerts everybody gets; those of submissions and of tests only who asks for them."""


ALL_ORIGINS = "all"
"""Stands for every origin in a query."""


class DayAnswer(StrEnum):
    """What the service can say of a day, or of one data set on a day; never one for another."""

    NO_DATA = "no data"
    ARCHIVE_SILENT = "archive silent"
    NOT_SEARCHABLE = "not searchable"
    NO_BURST = "no burst"
    NOT_LOCALISABLE = "not localisable"
    LOCALISED = "localised"


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

    @classmethod
    def gaussian(cls, mean: float, sd: float) -> "Parameter":
        """Gaussian with this mean and standard deviation; empty where one of them is not finite."""
        if not (math.isfinite(mean) and math.isfinite(sd)):
            return cls()
        quantiles = {name: mean + sd * NormalDist().inv_cdf(level) for name, level in QUANTILES.items()}
        return cls(mean=mean, sd=sd, **quantiles)


class Moment(Record):
    """Posterior of a time: UTC as ISO 8601 with Z, and its standard deviation in seconds."""

    q2_5: str | None = None
    q16: str | None = None
    q50: str | None = None
    q84: str | None = None
    q97_5: str | None = None
    mean: str | None = None
    sd: float | None = None

    @classmethod
    def after(cls, reference_utc: np.datetime64, seconds: Parameter) -> "Moment":
        """Time that is so many seconds after another."""
        start = reference_utc.astype("datetime64[ms]")
        known = {name: getattr(seconds, name) for name in (*QUANTILES, "mean")}
        stamps = {
            name: f"{start + np.timedelta64(round(value * 1e3), 'ms')}Z"
            for name, value in known.items()
            if value is not None
        }
        return cls(sd=seconds.sd, **stamps)


def finite(value: float) -> float | None:
    """A number as records hold it: None where it is not finite."""
    return float(value) if math.isfinite(value) else None


class Interval(Record):
    """Part of a credible region of a longitude: from `low` eastward of `high`, degrees HEE, west positive."""

    low: float
    high: float = Field(description="Above `low`; beyond 180 where the part lies across the far side.")
    probability: float


class Side(Record):
    """Half of the ecliptic plane, as seen from the Sun, that more probably has the source of a preliminary track."""

    middle_deg: float = Field(description="Longitude of its middle, HEE: half way between two spacecraft, or opposite.")
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


class MeasuredWind(Record):
    """Wind measured in situ as it bends one field line: mean speed from 1 solar radius to each of some distances.

    The mean speed is 1 over the mean of 1 / v along the line, so a Parker spiral of that speed turns by the same angle.
    """

    range_rsun: tuple[float, ...] = Field(description="Ascending.")
    v_sw_km_s: tuple[float, ...]
    sd_km_s: tuple[float, ...] = Field(description="Posterior standard deviation, model error included.")
    correlation: tuple[tuple[float, ...], ...] = Field(description="Of the mean speeds to any two distances.")

    def to(self, range_rsun: float) -> tuple[float, float]:
        """Mean speed from 1 solar radius to a distance and its standard deviation, km/s; at least to the first one."""
        speed, sd = (np.interp(range_rsun, self.range_rsun, values) for values in (self.v_sw_km_s, self.sd_km_s))
        return float(speed), float(sd)


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
    phi0_probability: tuple[float, ...] = Field(
        default=(), description="Of equal parts of the circle from -180 deg on; of a preliminary track."
    )
    side: Side | None = Field(default=None, description="Of the source at 0.5 MHz; of a preliminary track.")
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
    error_scale: float = Field(default=1.0, description="Factor by which errors were widened where the fit is poor.")
    log_evidence: float | None = None
    ess: float | None = None
    times: int = 0
    flags: tuple[str, ...] = ()


class PreliminaryLevel(Record):
    """Where the final longitude of a burst is in the posterior that its preliminary track had."""

    solution_id: str = Field(description="Of the preliminary track.")
    phi0_deg: float = Field(description="Final longitude at 1 solar radius, median.")
    level: float = Field(description="Probability of the smallest region that reaches it: uniform where honest.")


class Track(Record):
    """Everything that is said of the track of a burst."""

    frame: Literal["HEE"] = "HEE"
    remark: str
    rotation_period_d: float
    joint: JointTrack
    two_step: dict[str, Any] = Field(default_factory=dict)
    two_step_other_rotations: dict[str, dict[str, Any]] = Field(default_factory=dict)
    companions: dict[str, dict[str, Any]] = Field(default_factory=dict)
    companions_pending: bool = Field(
        default=False, description="Whether `companions` are still being computed: they follow under the same id."
    )
    preliminary: PreliminaryLevel | None = Field(
        default=None, description="Of a burst that only two spacecraft had received before: how well that held."
    )


class AlertSource(Record):
    """Apparent source at one frequency: HEE, solar radii; covariances with z are None in the plane."""

    frequency_mhz: float
    emission_utc: str
    x_rsun: float
    y_rsun: float
    z_rsun: float
    cov_xx_rsun2: float | None = None
    cov_xy_rsun2: float | None = None
    cov_yy_rsun2: float | None = None
    cov_xz_rsun2: float | None = None
    cov_yz_rsun2: float | None = None
    cov_zz_rsun2: float | None = None


class Alert(Record):
    """What an alert says of a burst when its answer changes, as it was at that moment."""

    sequence: int = Field(description="Of all alerts in the order of their commits, from 1, without gaps.")
    record_number: int = Field(description="Of the alerts of this burst, from 1.")
    alert_type: AlertType
    created_utc: str
    origin: Origin
    burst_id: str
    start_utc: str
    end_utc: str
    f_low_mhz: float
    f_high_mhz: float
    observatories: tuple[str, ...]
    solution_id: str | None = Field(default=None, description="The answer; of a retraction the one that was it.")
    retracted_reason: str | None = Field(default=None, description="Why there is no answer any more.")
    tier: Tier = "final"
    grade: str = ""
    sentence: str = ""
    reference_utc: str | None = Field(default=None, description="Epoch of the HEE axes.")
    phi0_deg: float | None = None
    phi0_low_deg: float | None = None
    phi0_high_deg: float | None = None
    phi0_68: tuple[Interval, ...] = ()
    sources: tuple[AlertSource, ...] = ()
    flags: tuple[str, ...] = ()


class Prediction(Record):
    """Size of the 68 % region of a source in the ecliptic plane by distance and direction, for a fleet on a day."""

    day: date
    sigma_s: float = Field(description="Timing error that is taken for every receiver, s.")
    frequency_mhz: float
    frequency_rsun: float = Field(
        description="Where the density of Leblanc et al. (1998) emits this frequency as harmonic, solar radii."
    )
    receivers_rsun: dict[str, tuple[float, float, float]] = Field(description="HEE at noon, solar radii.")
    missing: dict[str, str] = Field(description="Spacecraft that were asked for and whose position is not known.")
    localisable: bool = Field(description="Three or more spacecraft: a source could be located.")
    distances_rsun: tuple[float, ...]
    longitudes_deg: tuple[float, ...] = Field(description="HEE, west positive.")
    radius68_rsun: tuple[tuple[float | None, ...], ...] = Field(
        description="Radius of the circle that has the area of the 68 % region, solar radii; a row for each distance, "
        "in it each longitude; null where it is not known."
    )

    def row(self, distance_rsun: float) -> tuple[float | None, ...]:
        """Radii at one of the distances."""
        return self.radius68_rsun[self.distances_rsun.index(distance_rsun)]

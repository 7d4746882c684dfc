"""What the replies hold. Every time is UTC, every position HEE in solar radii."""

from collections.abc import Sequence
from datetime import date, datetime
from functools import lru_cache
from typing import Any, Literal
from urllib.parse import urlencode

from pydantic import ConfigDict, Field
from typing_extensions import TypeAliasType

from api.links import API, burst_links, linked, zarr_path
from api.replies import ORIGIN, CalibrationReply, LinkedEventReply, PageReply, Reply, calibration_of
from bella.catalogue import BurstSummary, Retraction, Solution, Submission
from bella.flags import APPARENT_SOURCE
from bella.linked_events import Link
from bella.records import JointTrack, Origin

Json = TypeAliasType("Json", "str | bool | int | float | list[Json] | dict[str, Json] | None")
"""Any value of JSON."""


class RetractionReply(Reply):
    """Why and when something was retracted; it stays where it is, and is no answer any more."""

    reason: str
    retracted_utc: datetime

    @classmethod
    def of(cls, retracted: Retraction | None) -> "RetractionReply | None":
        """Reply for a retraction; None where there is none."""
        return None if retracted is None else cls(**vars(retracted))


class SourceReply(Reply):
    """An input of a solution."""

    dataset: str
    day: date
    version: str
    sha256: str = Field(description="Checksum of the file.")
    uri: str = Field(description="Name of the file.")


class Said(Reply):
    """What a solution says of its burst, and whether that is the answer."""

    preferred: bool = Field(
        description="Whether this is the answer about the burst: see docs/quality-flags.md, grades."
    )
    grade: str = Field(description="A (best) to D (no single answer): see docs/quality-flags.md, grades.")
    tier: str = Field(description="final, or preliminary where two spacecraft received the burst.")
    sentence: str = Field(description="The answer in plain words: longitude west or east of Earth, distances, wind.")


def said_of(solution: Solution) -> dict[str, Any]:
    """Fields of `Said` for a solution of the catalogue."""
    answer = solution.answer
    return {
        "preferred": solution.preferred,
        "grade": answer.grade,
        "tier": answer.tier,
        "sentence": answer.sentence,
    }


@lru_cache(maxsize=1000)
def _pick(edge: str, method: str, preset: str, version: int) -> str:
    """Query of an address that picks a version of a series: a list has many, and few that differ."""
    return urlencode({"edge": edge, "method": method, "preset": preset, "version": version})


class SolutionReply(Said):
    """One localisation of one burst; nothing of it but `preferred` changes once it is published."""

    solution_id: str
    burst_id: str
    edge: str
    method: str
    preset: str
    dimensions: int
    version: int
    phi0_deg: float | None = Field(description="Median longitude of the spiral at 1 solar radius, HEE, west positive.")
    phi0_low_deg: float | None = Field(description="Ends of its 68 % interval.")
    phi0_high_deg: float | None
    range_low_rsun: float | None = Field(description="Distance of the nearest and of the farthest source.")
    range_high_rsun: float | None
    latitude_low_deg: float | None = Field(
        description="HEE latitude of the southernmost source; null where sources were taken to be in the ecliptic."
    )
    latitude_high_deg: float | None = Field(description="Of the northernmost.")
    area68_rsun2: float | None = Field(description="Area of the 68 % region, median of all frequencies.")
    v_sw_km_s: float | None = Field(description="Median speed of the wind; null where it was not measured.")
    v_sw_low_km_s: float | None = Field(description="Ends of its 68 % interval.")
    v_sw_high_km_s: float | None
    supersedes: str | None = Field(description="Solution that this one replaces.")
    origin: Origin = Field(description=ORIGIN)
    retracted: RetractionReply | None = Field(description="Of this solution or of its burst; null where it stands.")
    pruned_utc: datetime | None = Field(
        description="When the draws of a superseded version were removed from the store; everything else is kept."
    )
    flags: list[str]
    inputs_hash: str
    code_version: str
    store_sha256: str
    created_utc: datetime = Field(description="When this solution was published.")
    reference_utc: datetime = Field(description="Epoch of the HEE axes.")
    links: dict[str, str]

    @classmethod
    def of(cls, solution: Solution) -> "SolutionReply":
        """Reply for a solution of the catalogue."""
        series = solution.series
        burst = linked(f"{API}/bursts/{solution.burst_id}")
        own = linked(f"{API}/solutions/{solution.solution_id}")
        pick = _pick(series.edge, series.method, series.preset, solution.version)
        numbers = solution.answer.model_dump(exclude={"tier", "grade", "sentence", "has_track"})
        return cls(
            **said_of(solution),
            **numbers,
            solution_id=solution.solution_id,
            burst_id=solution.burst_id,
            edge=series.edge,
            method=series.method,
            preset=series.preset,
            dimensions=series.dimensions,
            version=solution.version,
            supersedes=solution.supersedes,
            origin=solution.origin,
            retracted=RetractionReply.of(solution.retracted),
            pruned_utc=solution.pruned_utc,
            flags=list(solution.flags),
            inputs_hash=solution.inputs_hash,
            code_version=solution.code_version,
            store_sha256=solution.store_sha256,
            created_utc=solution.created_utc,
            reference_utc=solution.reference_utc,
            links={
                "self": own,
                "track": f"{burst}/track?{pick}",
                "track_csv": f"{burst}/track?{pick}&format=csv",
                "posterior": f"{burst}/posterior?{pick}",
                "zarr": linked(zarr_path(solution)),
                "calibration": f"{own}/calibration",
            },
        )


class SolutionWithSourcesReply(SolutionReply):
    """One solution with the files it was made from, and how often such answers held."""

    sources: list[SourceReply]
    calibration: CalibrationReply = Field(description="How often answers about simulated bursts like this one held.")


class SolutionsReply(PageReply):
    """One page of solutions."""

    solutions: list[SolutionReply]


class FileReply(SourceReply):
    """A file of the archive, or a submitted table, that solutions were made from."""

    state: str
    received_utc: datetime = Field(description="Since when the catalogue knows of it.")
    changed_utc: datetime


class FilesReply(PageReply):
    """One page of files."""

    files: list[FileReply]


class PreferenceReply(Reply):
    """Which series of a burst is preferred, who chose it, why and when."""

    edge: str
    method: str
    preset: str
    dimensions: int
    chosen_by: str = Field(description="rule, or person where it was pinned.")
    reason: str
    chosen_utc: datetime


class BurstReply(Reply):
    """One burst with the newest solution of each series, the preferred one first."""

    burst_id: str
    start_utc: datetime
    end_utc: datetime
    f_low_mhz: float
    f_high_mhz: float
    observatories: list[str]
    origin: Origin = Field(description=ORIGIN)
    updated_utc: datetime | None = Field(description="When what is said of the burst was changed last.")
    retracted: RetractionReply | None = Field(description="Null where the burst stands.")
    remark: str = APPARENT_SOURCE
    grade: str | None = Field(description="Of the preferred solution; null where there is none that stands.")
    tier: str | None
    sentence: str | None = Field(description="The answer about this burst: that of the preferred solution.")
    calibration: CalibrationReply | None = Field(
        description="How often answers about simulated bursts like this one held; null where there is no answer."
    )
    preferred_solution: str | None
    preference: PreferenceReply | None
    solutions: list[SolutionReply]
    events: list[LinkedEventReply] | None = Field(
        None, description="Published events near the burst, the nearest first; null in lists of bursts."
    )
    links: dict[str, str]

    @classmethod
    def of(cls, summary: BurstSummary, near: Sequence[Link] | None = None) -> "BurstReply":
        """Reply for a burst of the catalogue, with the events near it where these are given."""
        burst, kept, preferred = summary.burst, summary.preference, summary.preferred
        said = said_of(preferred) if preferred else dict.fromkeys(Said.model_fields)
        if burst.retracted:
            said["sentence"] = f"retracted: {burst.retracted.reason}"
        chosen = kept and PreferenceReply(
            **vars(kept.series), chosen_by=kept.chosen_by, reason=kept.reason, chosen_utc=kept.chosen_utc
        )
        return cls(
            **{name: said[name] for name in ("grade", "tier", "sentence")},
            calibration=calibration_of(preferred, burst.observatories) if preferred else None,
            preferred_solution=preferred.solution_id if preferred else None,
            preference=chosen,
            burst_id=burst.burst_id,
            start_utc=burst.start_utc,
            end_utc=burst.end_utc,
            f_low_mhz=burst.f_low_mhz,
            f_high_mhz=burst.f_high_mhz,
            observatories=list(burst.observatories),
            origin=burst.origin,
            updated_utc=burst.updated_utc,
            retracted=RetractionReply.of(burst.retracted),
            solutions=[SolutionReply.of(solution) for solution in summary.solutions],
            events=None if near is None else [LinkedEventReply.near(one) for one in near],
            links=burst_links(burst),
        )


class BurstsReply(PageReply):
    """One page of bursts."""

    bursts: list[BurstReply]


class VersionReply(SolutionReply):
    """A solution with the one that replaced it."""

    superseded_by: str | None


class VersionsReply(Reply):
    """All solutions that were ever published for a burst."""

    burst_id: str
    versions: list[VersionReply]


class TrackFitReply(Reply):
    """Every fit to the track of a solution; parameters have mean, sd and quantiles, and None where there is no fit."""

    model_config = ConfigDict(frozen=True, extra="allow")
    __pydantic_extra__: dict[str, Json]

    frame: Literal["HEE"] = "HEE"
    remark: str = APPARENT_SOURCE
    rotation_period_d: float | None = Field(
        default=None, description="Rotation period of the Sun, days, that the speeds of `joint` and `two_step` rest on."
    )
    joint: JointTrack | dict[str, Json] | None = Field(
        default=None,
        description="One source on one spiral, fitted to the arrival times of all frequencies together; distance "
        "and time of emission are free (docs/tracks.md). Its draws are `joint_draws` of the Zarr group. Flags: "
        "docs/quality-flags.md, track fit.",
    )
    two_step: dict[str, Json] | None = Field(
        default=None, description="Line through the positions; errors are formal and too small."
    )
    two_step_other_rotations: dict[str, dict[str, Json]] = Field(
        default_factory=dict, description="The same by other rotation periods, days."
    )
    companions: dict[str, dict[str, Json]] = Field(
        default_factory=dict,
        description="What other methods say: `semp`, `weighted`, `piecewise`, `density_excess`, `scattering`, "
        "`footpoint`, `wind`, `triangulation`, `fused`, `models`. Each has `flags`; with `not_computed` it "
        "has a `reason` and nothing else.",
    )
    companions_pending: bool = Field(
        default=False,
        description="Whether `companions` are still being computed: they follow within minutes under the same id, "
        "unless a newer version comes first; nothing else of the solution changes.",
    )
    published: dict[str, Json] | None = Field(default=None, description="What a paper says of this track, if it does.")


class LocalisationReply(Reply):
    """Apparent source at one frequency: HEE, solar radii; null for what is not known."""

    frequency_mhz: float
    x_rsun: float | None = Field(description="To Earth.")
    y_rsun: float | None = Field(description="West.")
    z_rsun: float | None = Field(description="Ecliptic north.")
    cov_xx_rsun2: float | None
    cov_xy_rsun2: float | None
    cov_yy_rsun2: float | None
    cov_xz_rsun2: float | None = Field(description="Null, like the others of z, for a source in the ecliptic.")
    cov_yz_rsun2: float | None
    cov_zz_rsun2: float | None
    area68_rsun2: float | None = Field(description="Area of the 68 % region (its section by the ecliptic).")
    area95_rsun2: float | None
    modes: int = Field(description="Separate parts of the 95 % region.")
    emission_utc: datetime = Field(description="When the wave left the source.")
    v_over_c: float | None = Field(description="Propagation speed.")
    v_over_c_sd: float | None
    contraction_x: float | None = Field(description="Posterior over prior width.")
    contraction_y: float | None
    contraction_v: float | None
    log_evidence: float | None
    flags: str = Field(description="Separated by semicolons.")


class TrackReply(Said):
    """Localisation table and track fit of one solution."""

    burst_id: str
    frame: Literal["HEE"] = "HEE"
    remark: str = APPARENT_SOURCE
    solution: SolutionReply
    track_fit: TrackFitReply
    localisations: list[LocalisationReply]


class PosteriorReply(Said):
    """Summary of a posterior, per frequency; the draws are in the Zarr group at `zarr_url`."""

    burst_id: str
    frame: Literal["HEE"] = "HEE"
    remark: str = APPARENT_SOURCE
    solution: SolutionReply
    zarr_url: str
    draws: int = Field(description="Draws per frequency in the Zarr group.")
    units: dict[str, str]
    summary: dict[str, list[float | bool | str | None]] = Field(
        description="One list per variable, as long as `frequency_mhz`."
    )
    attributes: dict[str, Json]


class OutlineReply(Reply):
    """Outline of a region, solar radii; null between its parts."""

    x: list[float | None]
    y: list[float | None]


class RegionReply(Reply):
    """Numbers and credible regions of one track at one channel."""

    edge: str
    label: str = Field(description="The edge in words.")
    solution_id: str
    preferred: bool
    frequency_mhz: float
    x_rsun: float | None
    y_rsun: float | None
    range_rsun: float | None
    range_sd_rsun: float | None
    longitude_deg: float | None
    longitude_sd_deg: float | None
    area68_rsun2: float | None
    area95_rsun2: float | None
    contraction_v: float | None
    speed: str = Field(description="What the times say of the propagation speed.")
    region68: OutlineReply
    region95: OutlineReply


class TableColumnReply(Reply):
    """A column of a table."""

    name: str
    kind: Literal["time", "float", "int", "bool", "text"]
    unit: str | None
    ucd: str
    description: str


class TableReply(Reply):
    """A table: what holds for all of it, its columns, and its rows; null for what is not known."""

    table: str
    title: str
    header: dict[str, str]
    columns: list[TableColumnReply]
    rows: list[dict[str, str | bool | int | float | None]]


class RegionsReply(Reply):
    """Credible regions of each track at the channel nearest to a frequency."""

    burst_id: str
    frame: Literal["HEE"] = "HEE"
    remark: str = APPARENT_SOURCE
    regions: list[RegionReply]


class SubmissionReply(Reply):
    """An arrival table that was submitted: waiting for the next run, localised, refused by it, or withdrawn."""

    submission_id: str = Field(description="Also the id of its burst; never that of a burst of the archive.")
    sha256: str = Field(description="Checksum of the table.")
    state: str = Field(description="received, done, failed or withdrawn.")
    message: str
    burst_id: str | None
    received_utc: datetime
    changed_utc: datetime
    links: dict[str, str]

    @classmethod
    def of(cls, submission: Submission) -> "SubmissionReply":
        """Reply for a submission of the catalogue."""
        waiting = "waits for the next scheduled run" if submission.state == "received" else ""
        links = {"self": linked(f"{API}/arrivals/{submission.submission_id}")}
        if submission.burst_id:
            links["burst"] = linked(f"{API}/bursts/{submission.burst_id}")
        return cls(
            submission_id=submission.submission_id,
            sha256=submission.sha256,
            state=submission.state,
            message=submission.message or waiting,
            burst_id=submission.burst_id,
            received_utc=submission.received_utc,
            changed_utc=submission.changed_utc,
            links=links,
        )


class HealthReply(Reply):
    """Whether the service can answer."""

    status: Literal["ok", "failing"]
    version: str
    checks: dict[str, str]

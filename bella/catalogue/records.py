"""What goes into the catalogue and comes out of it: frozen records, without a trace of SQL.

All times are UTC; a time without a zone is taken as UTC on the way in, and has the zone UTC on the way out.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from datetime import date, datetime
from math import nan
from typing import Any, Literal

from bella.answer import Answer
from bella.calibration.tried import Answered
from bella.records import REAL_ORIGINS, Alert, DayAnswer, Origin, Track

METHOD_ORDER = ("posterior", "nuts", "tdoa")
PRESET_ORDER = ("default", "robust", "free-speed", "subluminal", "paper", "bella-2024")
EDGE_ORDER = ("shared_profile", "half_rise", "half_maximum", "gauss_hermite")
RULE, PERSON = "rule", "person"
"""Who chose the preferred series of a burst."""


@dataclass(frozen=True)
class SourceFile:
    """One input: an archive file of one day, or a submitted arrival table."""

    dataset: str
    day: date
    version: str
    sha256: str
    state: str
    uri: str


@dataclass(frozen=True)
class Retraction:
    """Why and when something was retracted."""

    reason: str
    retracted_utc: datetime


@dataclass(frozen=True)
class Burst:
    """One Type III burst: when, between which frequencies (MHz), who detected it, and where its data come from.

    `retracted` is set by a person alone, and `updated_utc` (when what is said of it was changed last) by the catalogue:
    what is published with them is ignored.
    """

    burst_id: str
    start_utc: datetime
    end_utc: datetime
    f_low_mhz: float
    f_high_mhz: float
    observatories: tuple[str, ...]
    spectra_path: str | None = None
    origin: Origin = Origin.ARCHIVE
    retracted: Retraction | None = None
    updated_utc: datetime | None = field(default=None, compare=False)


@dataclass(frozen=True)
class SearchedDay:
    """The answer about a day: in which files it was searched, by which code, of which spacecraft, and what came of it.

    A spacecraft that is not among the observatories had no data; one that is and has no detection received no burst.
    `reason` says why a day could not be searched, or which data sets could not be asked for. A day is kept once for
    each origin of its files.
    """

    day: date
    inputs_hash: str
    code_version: str
    observatories: tuple[str, ...]
    answer: DayAnswer = DayAnswer.NO_BURST
    reason: str = ""
    origin: Origin = Origin.ARCHIVE


@dataclass(frozen=True)
class Detection:
    """A burst as one spacecraft received it; the columns of the detection table.

    `burst_id` is empty for what was rejected. A tier "localisable" says that the burst has a position, any other comes
    with its reason.
    """

    observatory: str
    start_utc: datetime
    peak_utc: datetime
    end_utc: datetime
    f_low_mhz: float
    f_high_mhz: float
    score: float
    drift: float
    peak_db: float
    channels: int
    isolated: bool
    tier: str
    reason: str
    burst_id: str
    origin: Origin = Origin.ARCHIVE
    flux_sfu_1au: float = nan


@dataclass(frozen=True)
class DaySummary:
    """A searched day with how much was received on it.

    `detections` are those that were not `rejected`; `shared` bursts were received by two or more spacecraft,
    `localised` ones have a position.
    """

    searched: SearchedDay
    detections: int
    rejected: int
    bursts: int
    shared: int
    localised: int


@dataclass(frozen=True)
class DayPage:
    """Searched days, the newest first, each once for every origin of its files.

    `next_last` is the day to go on with, and `next_cursor` the same as a cursor; None at the end. `total` counts all
    days.
    """

    days: tuple[DaySummary, ...]
    next_last: date | None
    next_cursor: str | None
    total: int


@dataclass(frozen=True)
class Series:
    """The choices that make solutions of one burst comparable as versions of one another."""

    edge: str
    method: str
    preset: str
    dimensions: int

    @property
    def name(self) -> str:
        """The series in one word, such as "half_rise/posterior/default/2d"."""
        return f"{self.edge}/{self.method}/{self.preset}/{self.dimensions}d"


@dataclass(frozen=True)
class Preference:
    """Which series of a burst is the preferred one, who chose it, why and when."""

    series: Series
    chosen_by: Literal["rule", "person"]
    reason: str
    chosen_utc: datetime


@dataclass(frozen=True)
class Localisation:
    """Where the source was at one frequency: HEE, solar radii; the columns of the localisation table.

    The covariances with z are None in the plane. A number that could not be determined is NaN.
    """

    frequency_mhz: float
    x_rsun: float
    y_rsun: float
    z_rsun: float
    cov_xx_rsun2: float
    cov_xy_rsun2: float
    cov_yy_rsun2: float
    cov_xz_rsun2: float | None
    cov_yz_rsun2: float | None
    cov_zz_rsun2: float | None
    area68_rsun2: float
    area95_rsun2: float
    modes: int
    emission_utc: datetime
    v_over_c: float
    v_over_c_sd: float
    contraction_x: float
    contraction_y: float
    contraction_v: float
    log_evidence: float
    flags: str


@dataclass(frozen=True)
class Solution:
    """One version of the localisation of one burst; its numbers never change once it is there.

    `preferred` says whether this is the newest version of the preferred series of its burst, `retracted` whether it or
    its burst was retracted, and `pruned_utc` when the draws of a superseded version were removed from the store.
    """

    solution_id: str
    burst_id: str
    series: Series
    version: int
    supersedes: str | None
    inputs_hash: str
    code_version: str
    flags: tuple[str, ...]
    store_path: str
    store_sha256: str
    created_utc: datetime
    reference_utc: datetime
    answer: Answer
    preferred: bool
    spectra_path: str | None = None
    origin: Origin = Origin.ARCHIVE
    retracted: Retraction | None = None
    pruned_utc: datetime | None = None

    def answered(self, observatories: Collection[str]) -> Answered:
        """How the burst was timed, localised and graded, which says what simulated bursts are like it.

        Parameters
        ----------
        observatories : collection of str
            That received the burst.
        """
        series, answer = self.series, self.answer
        return Answered(
            len(observatories),
            series.edge,
            answer.tier,
            answer.grade,
            method=series.method,
            preset=series.preset,
            origin=self.origin,
        )


@dataclass(frozen=True, order=True)
class StoredGroup:
    """A group of the store that the catalogue refers to: a posterior with its checksum, or spectra without one."""

    store_path: str
    belongs_to: str
    sha256: str | None


@dataclass(frozen=True)
class Publication:
    """Everything that becomes visible with one solution, in one commit."""

    burst: Burst
    series: Series
    inputs_hash: str
    code_version: str
    flags: tuple[str, ...]
    store_path: str
    store_sha256: str
    reference_utc: datetime
    localisations: tuple[Localisation, ...]
    track_fit: Track | dict[str, Any]
    sources: tuple[SourceFile, ...]


RANGES = {
    "frequency": "MHz",
    "longitude": "degrees HEE, west positive",
    "latitude": "degrees HEE, north positive",
    "distance": "solar radii",
    "wind": "km/s",
    "area": "square solar radii",
}
"""What bursts can be asked for by a range, `..._min` to `..._max`, and its unit."""

BURST_SORTS = ("start", "updated", "grade", "longitude", "latitude", "distance", "wind", "area", "frequency")
"""What bursts can be ordered by; with a minus sign in front, from the last or largest on."""


@dataclass(frozen=True)
class BurstQuery:
    """Which bursts, in which order, and which page of them.

    The onset is in [start, stop), all of `observatories` detected it, what is said of it was changed at `updated_since`
    or later, the data are of one of `origins`, and it was not retracted unless `with_retracted`. All else is asked of
    the preferred solution: it has all of `flags` and none of `flags_absent`, one of `grades`, `edges`, `methods` and
    `presets` (any where these are empty), and the tier.

    Bounds belong to their ranges. The band of the burst, its distances and latitudes reach into theirs, median
    longitude, wind and area lie in theirs; what has no such number is in no range of it. Longitudes (HEE, degrees)
    run westward from `longitude_min` to `longitude_max`, across 180 where the second is smaller.
    """

    start: datetime | None = None
    stop: datetime | None = None
    observatories: frozenset[str] = field(default_factory=frozenset)
    flags: frozenset[str] = field(default_factory=frozenset)
    flags_absent: frozenset[str] = field(default_factory=frozenset)
    grades: frozenset[str] = field(default_factory=frozenset)
    edges: frozenset[str] = field(default_factory=frozenset)
    methods: frozenset[str] = field(default_factory=frozenset)
    presets: frozenset[str] = field(default_factory=frozenset)
    tier: str | None = None
    updated_since: datetime | None = None
    frequency_min: float | None = None
    frequency_max: float | None = None
    longitude_min: float | None = None
    longitude_max: float | None = None
    latitude_min: float | None = None
    latitude_max: float | None = None
    distance_min: float | None = None
    distance_max: float | None = None
    wind_min: float | None = None
    wind_max: float | None = None
    area_min: float | None = None
    area_max: float | None = None
    sort: str = "start"
    cursor: str | None = None
    limit: int = 100
    origins: frozenset[Origin] = frozenset(REAL_ORIGINS)
    with_retracted: bool = False


@dataclass(frozen=True)
class BurstSummary:
    """A burst with the newest version of each series, the preferred one first, and how that was chosen."""

    burst: Burst
    solutions: tuple[Solution, ...]
    preference: Preference | None = None

    @property
    def preferred(self) -> Solution | None:
        """The answer about this burst; None where it has no solution."""
        return next((one for one in self.solutions if one.preferred), None)


@dataclass(frozen=True)
class BurstPage:
    """One page of bursts; `next_cursor` is None on the last, `total` counts all pages."""

    bursts: tuple[BurstSummary, ...]
    next_cursor: str | None
    total: int


@dataclass(frozen=True)
class BurstPoint:
    """A burst as a figure of many shows it: its preferred answer, None where it has none, without all else."""

    burst_id: str
    start_utc: datetime
    origin: Origin
    answer: Answer | None


@dataclass(frozen=True)
class PointPage:
    """Bursts of a figure in the order that was asked for; `total` counts those beyond the limit, too."""

    points: tuple[BurstPoint, ...]
    total: int


@dataclass(frozen=True)
class DetectionQuery:
    """Which detections, in which order, and which page of them.

    The onset is in [start, stop); the spacecraft, the tier and the burst are these where they are given.
    """

    start: datetime | None = None
    stop: datetime | None = None
    observatory: str | None = None
    tier: str | None = None
    burst_id: str | None = None
    sort: Literal["start", "-start"] = "start"
    cursor: str | None = None
    limit: int = 1000
    origins: frozenset[Origin] = frozenset(REAL_ORIGINS)


@dataclass(frozen=True)
class DetectionPage:
    """One page of detections; `next_cursor` is None on the last, `total` counts all pages."""

    detections: tuple[Detection, ...]
    next_cursor: str | None
    total: int


@dataclass(frozen=True)
class SolutionQuery:
    """Which solutions, in which order, and which page of them.

    All versions; or with `newest` those that no other one supersedes. They were published at `created_since` or later,
    and not retracted unless `with_retracted`.
    """

    burst_id: str | None = None
    edges: frozenset[str] = field(default_factory=frozenset)
    methods: frozenset[str] = field(default_factory=frozenset)
    presets: frozenset[str] = field(default_factory=frozenset)
    newest: bool = False
    created_since: datetime | None = None
    sort: Literal["created", "-created"] = "-created"
    cursor: str | None = None
    limit: int = 100
    origins: frozenset[Origin] = frozenset(REAL_ORIGINS)
    with_retracted: bool = False


@dataclass(frozen=True)
class SolutionPage:
    """One page of solutions; `next_cursor` is None on the last, `total` counts all pages."""

    solutions: tuple[Solution, ...]
    next_cursor: str | None
    total: int


@dataclass(frozen=True)
class SourceQuery:
    """Which inputs, in which order, and which page of them: of days in [first, last], changed since a time."""

    dataset: str | None = None
    first: date | None = None
    last: date | None = None
    updated_since: datetime | None = None
    sort: Literal["day", "-day", "updated", "-updated"] = "-day"
    cursor: str | None = None
    limit: int = 100


@dataclass(frozen=True)
class KnownSource:
    """An input with the time since which the catalogue knows of it, and that of its last change."""

    file: SourceFile
    received_utc: datetime
    changed_utc: datetime


@dataclass(frozen=True)
class SourcePage:
    """One page of inputs; `next_cursor` is None on the last, `total` counts all pages."""

    sources: tuple[KnownSource, ...]
    next_cursor: str | None
    total: int


@dataclass(frozen=True)
class Held:
    """How much of real data the catalogue has: what stands, and detections that were not rejected."""

    bursts: int
    answers: int
    solutions: int
    detections: int
    days: int
    files: int
    alerts: int
    newest_burst_utc: datetime | None
    updated_utc: datetime | None


@dataclass(frozen=True)
class StageRun:
    """The last run of a stage on a subject: who, when, how often it was tried, how it ended."""

    stage: str
    subject: str
    run_id: str
    state: str
    attempts: int
    host: str
    pid: int
    started_utc: datetime
    expires_utc: datetime
    ended_utc: datetime | None
    message: str


@dataclass(frozen=True)
class Token:
    """Who may submit; the token itself is not kept."""

    token_id: str
    name: str
    created_utc: datetime
    revoked_utc: datetime | None


@dataclass(frozen=True)
class Submission:
    """An arrival table that was submitted: received, done, failed or withdrawn, and the burst it became."""

    submission_id: str
    token_id: str
    sha256: str
    state: str
    message: str
    burst_id: str | None
    received_utc: datetime
    changed_utc: datetime


@dataclass(frozen=True)
class Webhook:
    """A receiver of alerts: since when, with what success, and how many alerts wait for it."""

    webhook_id: str
    url: str
    secret: str = field(repr=False)
    with_tests: bool
    created_utc: datetime
    removed_utc: datetime | None
    failures: int
    next_attempt_utc: datetime
    message: str
    waiting: int = 0


@dataclass(frozen=True)
class Delivery:
    """An alert that a receiver does not have yet, and how often it was refused."""

    alert: Alert
    attempts: int


def rule_order(series: Series, answer: Answer) -> tuple[int, int, bool, bool, int, int, str]:
    """Sort key of the rule that chooses the preferred series of a burst.

    Method (posterior first), preset (default first), a track with numbers before none, tier final before preliminary,
    edge (shared_profile, half_rise, half_maximum, gauss_hermite, then others), fewer dimensions before more.

    Parameters
    ----------
    answer : Answer
        Of the newest version of that series.

    Returns
    -------
    tuple
        Smaller is preferred.
    """
    return (
        _rank(METHOD_ORDER, series.method),
        _rank(PRESET_ORDER, series.preset),
        not answer.has_track,
        answer.tier != "final",
        edge_rank(series.edge),
        series.dimensions,
        series.name,
    )


def edge_rank(edge: str) -> int:
    """Place of an edge in the order of the rule, from 0; edges that it does not name are last."""
    return _rank(EDGE_ORDER, edge)


def by_preference(solutions: Iterable[Solution]) -> tuple[Solution, ...]:
    """Solutions with the preferred series first, the others by the rule, newer versions before older ones.

    Returns
    -------
    tuple of Solution
        The same, sorted; retracted series last.
    """
    found = sorted(solutions, key=lambda one: -one.version)
    newest: dict[tuple[str, Series], Solution] = {}
    for one in found:
        newest.setdefault((one.burst_id, one.series), one)

    def _key(one: Solution) -> tuple[bool, bool, tuple[Any, ...]]:
        head = newest[one.burst_id, one.series]
        return not head.preferred, head.retracted is not None, rule_order(head.series, head.answer)

    return tuple(sorted(found, key=_key))


def _rank(order: tuple[str, ...], name: str) -> int:
    return order.index(name) if name in order else len(order)

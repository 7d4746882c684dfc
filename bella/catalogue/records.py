"""What goes into the catalogue and comes out of it: frozen records, without a trace of SQL.

All times are UTC; a time without a zone is taken as UTC on the way in, and has the zone UTC on the way out.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import date, datetime
from typing import Any

METHOD_ORDER = ("posterior", "nuts", "tdoa")
PRESET_ORDER = ("default", "robust", "free-speed", "subluminal", "paper", "bella-2024")
EDGE_ORDER = ("half_rise", "half_maximum", "gauss_hermite")


@dataclass(frozen=True)
class SourceFile:
    """One input: an archive file of one day, or an arrival table that was handed in."""

    dataset: str
    day: date
    version: str
    sha256: str
    state: str
    uri: str


@dataclass(frozen=True)
class Burst:
    """One Type III burst: when, between which frequencies (MHz), and who heard it."""

    burst_id: str
    start_utc: datetime
    end_utc: datetime
    f_low_mhz: float
    f_high_mhz: float
    observatories: tuple[str, ...]
    spectra_path: str | None = None


@dataclass(frozen=True)
class SearchedDay:
    """A day whose spectra were searched for bursts: in which files, by which code, of which spacecraft.

    A spacecraft that is not among the observatories had no data; one that is and has no detection heard no burst.
    """

    day: date
    inputs_hash: str
    code_version: str
    observatories: tuple[str, ...]


@dataclass(frozen=True)
class Detection:
    """A burst as one spacecraft heard it; the columns of the detection table.

    `burst_id` is empty for what was rejected. A tier "localisable" says that the burst was placed, any other comes with
    its reason.
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


@dataclass(frozen=True)
class DaySummary:
    """A searched day with how much was heard on it.

    `detections` are those that were not `rejected`; `shared` bursts were heard by two or more spacecraft,
    `localised` ones were placed.
    """

    searched: SearchedDay
    detections: int
    rejected: int
    bursts: int
    shared: int
    localised: int


@dataclass(frozen=True)
class DayPage:
    """Searched days, the newest first; `next_last` is the day to go on with, None at the end, `total` counts all."""

    days: tuple[DaySummary, ...]
    next_last: date | None
    total: int


@dataclass(frozen=True)
class Series:
    """The choices that make solutions of one burst comparable as versions of one another."""

    edge: str
    method: str
    preset: str
    dimensions: int


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
    """One version of the localisation of one burst; never changed once it is there."""

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
    track_fit: dict[str, Any]
    sources: tuple[SourceFile, ...]


@dataclass(frozen=True)
class BurstQuery:
    """Which bursts, and which page of them.

    The onset is in [start, stop), all of `observatories` heard it, and the preferred solution has none of
    `flags_absent`.
    """

    start: datetime | None = None
    stop: datetime | None = None
    observatories: frozenset[str] = field(default_factory=frozenset)
    flags_absent: frozenset[str] = field(default_factory=frozenset)
    cursor: str | None = None
    limit: int = 100


@dataclass(frozen=True)
class BurstSummary:
    """A burst with the newest version of each series, the preferred one first."""

    burst: Burst
    solutions: tuple[Solution, ...]

    @property
    def preferred(self) -> Solution | None:
        """The solution to show where only one is shown, see `series_order`."""
        return self.solutions[0] if self.solutions else None


@dataclass(frozen=True)
class BurstPage:
    """One page of bursts by onset; `next_cursor` is None on the last, `total` counts all pages."""

    bursts: tuple[BurstSummary, ...]
    next_cursor: str | None
    total: int


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
class Submission:
    """An arrival table that was handed in: received, done or failed, and the burst it became."""

    sha256: str
    file_name: str
    state: str
    message: str
    burst_id: str | None
    received_utc: datetime
    changed_utc: datetime


def series_order(series: Series) -> tuple[int, int, int, int]:
    """Sort key that puts the preferred series first.

    Method before preset before edge, each in the order of the constants of this module and unknown names last; then
    more dimensions before fewer.

    Parameters
    ----------
    series : Series
        Series of a solution.

    Returns
    -------
    tuple of int
        Smaller is preferred.
    """
    return (
        _rank(METHOD_ORDER, series.method),
        _rank(PRESET_ORDER, series.preset),
        _rank(EDGE_ORDER, series.edge),
        -series.dimensions,
    )


def by_preference(solutions: Iterable[Solution]) -> tuple[Solution, ...]:
    """Solutions with the preferred series first and newer versions before older ones.

    Parameters
    ----------
    solutions : iterable of Solution
        Solutions of one burst.

    Returns
    -------
    tuple of Solution
        The same, sorted.
    """

    def _key(one: Solution) -> tuple[tuple[int, int, int, int], str, int]:
        return series_order(one.series), one.solution_id.rpartition(".")[0], -one.version

    return tuple(sorted(solutions, key=_key))


def _rank(order: tuple[str, ...], name: str) -> int:
    return order.index(name) if name in order else len(order)

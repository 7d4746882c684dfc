"""Simulated bursts through detection, timing, localisation, track and grade, as bursts of a day go, and their truth.

The bursts are those of :mod:`bella.simulation.strata`, whose laws none of the steps knows, with seeds for judging.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
import xarray as xr

from bella.answer import answer_of
from bella.arrivals import ArrivalGrid, arrival_grid, locate_receivers
from bella.bursts.association import AssociatedBurst, Member, associate
from bella.bursts.detection import search
from bella.bursts.matched_filter import THRESHOLDS
from bella.bursts.timing import (
    EDGES,
    HALF_RISE,
    SHARED,
    arrival_table,
    burst_spectrum,
    channel_arrivals,
    shared_frequencies_mhz,
    time_burst,
    why_not_timed,
)
from bella.exceptions import BellaError, InputError
from bella.flags import APPARENT_SOURCE
from bella.multilateration import localise
from bella.records import Interval, JointTrack, Parameter, Track
from bella.simulation.strata import FLEETS, STRATA, SimulatedCase, isolated_burst, judging_seed
from bella.tracks import fit_preliminary, fit_track
from bella.units import FloatArray, within_half_turn_deg

FOUND_STRATA = ("clean", "slowing", "directional", "pairs", "widths", "far side")
FOUND_FLEETS = ("2012", "2021", "pair")
"""Three spacecraft, four, and two: what real solutions have."""

SECOND_EDGE = EDGES[2]
"""A preliminary track asks a second definition of the edge."""

FOUND_WITHIN_S = 900.0
"""A burst that is found so far from the truth is another one: simulated others begin 4 minutes later or more."""

MOST_BURSTS = 1000
"""Bursts per stratum and fleet: those of the next seed begin there."""

DRAWS = 1000
INSIDE_68, INSIDE_95, BEYOND_3_SD = 2.2789, 5.9915, 11.829
"""Chi-squared of two degrees of freedom at 68 %, 95 %, and 3 standard deviations (99.73 %)."""

MOST = 0.5
"""A burst is lost if more than this share of its positions is beyond 3 standard deviations."""


@dataclass(frozen=True)
class Task:
    """One simulated burst: `number` counts the bursts for judging of a stratum and fleet."""

    stratum: str
    fleet: str
    number: int


@dataclass(frozen=True)
class Quantity:
    """One number of an answer beside its truth.

    Attributes
    ----------
    in68, in95 : float
        Whether the region of each level holds the truth; of positions, the share of frequencies where it does.
    error : float
        Of the median, in the unit of the quantity; without a sign.
    width : float
        Of the 68 % interval, all its parts together.
    """

    in68: float
    in95: float
    error: float
    width: float


@dataclass(frozen=True)
class FoundBurst:
    """What became of one simulated burst.

    Attributes
    ----------
    reason : str
        Why it has no answer; empty if it has.
    spacecraft : int
        That were timed.
    position, phi0, wind, beam : Quantity or None
        Solar radii, degrees, km/s, units of c; None where the answer has no such number.
    lost : bool
        Whether most positions are beyond 3 standard deviations.
    flags : tuple of str
        Of the track.
    """

    task: Task
    reason: str = ""
    tier: str = ""
    grade: str = ""
    edge: str = ""
    spacecraft: int = 0
    position: Quantity | None = None
    phi0: Quantity | None = None
    wind: Quantity | None = None
    beam: Quantity | None = None
    lost: bool = False
    flags: tuple[str, ...] = ()


class _Position(NamedTuple):
    x_rsun: float
    y_rsun: float
    z_rsun: float
    area68_rsun2: float
    flags: str


def tasks_of(strata: Sequence[str], bursts: int, seed: int) -> list[Task]:
    """Bursts of a run, those of one stratum after another.

    Parameters
    ----------
    strata : sequence of str
        Of `bella.simulation.strata.STRATA`.
    bursts : int
        Per stratum and fleet.

    Raises
    ------
    InputError
        If a stratum is not known, or the number or seed is out of range.
    """
    unknown = [name for name in strata if name not in STRATA]
    if unknown:
        raise InputError(f"stratum {unknown[0]!r} is not known; choose among {', '.join(STRATA)}")
    if not 1 <= bursts <= MOST_BURSTS:
        raise InputError(f"{bursts} bursts per stratum is not between 1 and {MOST_BURSTS}")
    if seed < 0:
        raise InputError(f"seed {seed} is below 0; give 0 or more")
    first = seed * MOST_BURSTS
    return [
        Task(name, fleet, number)
        for name in strata
        for fleet in FOUND_FLEETS
        for number in range(first, first + bursts)
    ]


def check_workers(workers: int) -> None:
    """Refuse a number of processes that can do nothing.

    Raises
    ------
    InputError
        If it is below 1.
    """
    if workers < 1:
        raise InputError(f"{workers} workers can do nothing; give 1 or more")


def find_all(tasks: Sequence[Task], workers: int = 1) -> Iterator[FoundBurst]:
    """Take simulated bursts through the whole pipeline, on several cores.

    Parameters
    ----------
    workers : int
        Processes; with 1 no other one is started.

    Yields
    ------
    FoundBurst
        In the order of the tasks.
    """
    check_workers(workers)
    if workers == 1:
        yield from map(find_burst, tasks)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield from pool.map(find_burst, tasks)


def find_burst(task: Task) -> FoundBurst:
    """Take one simulated burst through the whole pipeline: :func:`follow` of :func:`case_of`."""
    return follow(task, case_of(task))


def case_of(task: Task) -> SimulatedCase:
    """Simulated burst of a task; its seed is one for judging."""
    return isolated_burst(task.stratum, task.fleet, judging_seed(task.number))


def follow(task: Task, case: SimulatedCase) -> FoundBurst:
    """Take a burst through the whole pipeline and compare the answer with its truth.

    Parameters
    ----------
    task : Task
        Under which the result is kept.
    """
    try:
        return _answered(task, case, _timed_members(case))
    except BellaError as error:
        return FoundBurst(task, reason=str(error))


def _timed_members(case: SimulatedCase) -> list[Member]:
    """Members of the burst that are fit for timing, of the detection nearest to the truth."""
    found = associate([search(spectrum) for spectrum in case.spectra.values()])
    near = [one for one in found if _apart_s(one, case) <= FOUND_WITHIN_S]
    if not near:
        raise BellaError("not detected")
    burst = min(near, key=lambda one: _apart_s(one, case))
    members = [one for one in burst.members if one.fits]
    if len(members) < len(FLEETS["pair"].datasets):
        raise BellaError(burst.reason or f"timed at {len(members)} spacecraft")
    if len(members) >= THRESHOLDS.spacecraft and burst.reason:
        raise BellaError(burst.reason)
    return members


def _apart_s(burst: AssociatedBurst, case: SimulatedCase) -> float:
    return abs(float((burst.start_utc.to_datetime64() - case.around_utc) / np.timedelta64(1, "s")))


def _answered(task: Task, case: SimulatedCase, members: Sequence[Member]) -> FoundBurst:
    parts = [burst_spectrum(one.searched, one.candidate) for one in members]
    if len(members) < THRESHOLDS.spacecraft:
        return _preliminary(task, case, parts)
    timed = time_burst(parts, SHARED)
    reason = why_not_timed(timed, [one.searched.observatory for one in members])
    if reason:
        raise BellaError(reason)
    table = arrival_table(timed, shared_frequencies_mhz(timed))
    posterior = localise(table, draws=DRAWS)
    grid = arrival_grid(locate_receivers(channel_arrivals(timed)), received_by=1)
    joint = fit_track(grid, draws=DRAWS).record
    answer = answer_of(_track(joint), _positions(posterior))
    position, lost = _position_quality(posterior, case)
    return FoundBurst(
        task,
        tier=answer.tier,
        grade=answer.grade,
        edge=timed.edge,
        spacecraft=len(grid.observatories),
        position=position,
        lost=lost,
        phi0=_longitude(joint, case.burst.phi0_deg),
        wind=_inside(joint.v_sw_km_s, case.burst.v_sw_km_s),
        beam=_inside(joint.beam_speed_c, case.mean_beam_speed_c(_ends(grid))),
        flags=joint.flags,
    )


def _preliminary(task: Task, case: SimulatedCase, parts: Sequence[xr.Dataset]) -> FoundBurst:
    grid, other = (
        arrival_grid(locate_receivers(channel_arrivals(time_burst(parts, edge))), received_by=1)
        for edge in (HALF_RISE, SECOND_EDGE)
    )
    joint = fit_preliminary(grid, other)
    answer = answer_of(_track(joint), ())
    return FoundBurst(
        task,
        tier=answer.tier,
        grade=answer.grade,
        edge=grid.edge,
        spacecraft=len(grid.observatories),
        phi0=_longitude(joint, case.burst.phi0_deg),
        flags=joint.flags,
    )


def _track(joint: JointTrack) -> Track:
    return Track(remark=APPARENT_SOURCE, rotation_period_d=joint.rotation_period_d, joint=joint)


def _positions(posterior: xr.Dataset) -> list[_Position]:
    """Rows of the localisation table, in the ecliptic plane."""
    columns = [posterior[name].to_numpy() for name in ("x_rsun", "y_rsun", "area68_rsun2", "flags")]
    return [
        _Position(float(x), float(y), 0.0, float(area), str(said)) for x, y, area, said in zip(*columns, strict=True)
    ]


def _ends(grid: ArrivalGrid) -> FloatArray:
    return grid.frequency_mhz[[0, -1]]


def _position_quality(posterior: xr.Dataset, case: SimulatedCase) -> tuple[Quantity, bool]:
    """Positions beside their truth: Gaussian regions of the covariance that the localisation table has."""
    truth = case.truth(next(iter(case.datasets)), posterior["frequency"].to_numpy())
    apart = np.stack([posterior[name].to_numpy() - truth[name].to_numpy() for name in ("x_rsun", "y_rsun")], axis=-1)
    xx, xy, yy = (posterior[f"cov_{name}_rsun2"].to_numpy() for name in ("xx", "xy", "yy"))
    covariance = np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-1)
    chi2 = np.einsum("fi,fij,fj->f", apart, np.linalg.inv(covariance), apart)
    quality = Quantity(
        in68=float((chi2 <= INSIDE_68).mean()),
        in95=float((chi2 <= INSIDE_95).mean()),
        error=float(np.median(np.hypot(*apart.T))),
        width=float(np.median(2 * np.sqrt(np.linalg.eigvalsh(covariance)[:, -1]))),
    )
    return quality, bool((chi2 > BEYOND_3_SD).mean() > MOST)


def _inside(parameter: Parameter, truth: float) -> Quantity | None:
    p = parameter
    if p.q2_5 is None or p.q16 is None or p.q50 is None or p.q84 is None or p.q97_5 is None:
        return None
    return Quantity(
        in68=float(p.q16 <= truth <= p.q84),
        in95=float(p.q2_5 <= truth <= p.q97_5),
        error=abs(p.q50 - truth),
        width=p.q84 - p.q16,
    )


def _longitude(joint: JointTrack, truth_deg: float) -> Quantity | None:
    """Longitude: one interval where the answer has one, otherwise its parts, with the middle of the likeliest."""
    middle = joint.phi0_deg.q50
    if middle is not None and len(joint.phi0_68) <= 1:
        return _inside(joint.phi0_deg, middle + within_half_turn_deg(truth_deg - middle))
    if not joint.phi0_68:
        return None
    best = max(joint.phi0_68, key=lambda part: part.probability)
    return Quantity(
        in68=float(_holds(joint.phi0_68, truth_deg)),
        in95=float(_holds(joint.phi0_95, truth_deg)),
        error=abs(within_half_turn_deg(truth_deg - (best.low + best.high) / 2)),
        width=sum(part.high - part.low for part in joint.phi0_68),
    )


def _holds(region: Sequence[Interval], longitude_deg: float) -> bool:
    return any((longitude_deg - part.low) % 360.0 <= part.high - part.low for part in region)

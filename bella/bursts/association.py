"""Which spacecraft received the same burst, and its stable name.

Two spacecraft hear a frequency at times that differ by no more than light takes from one to the other. Bursts are taken
strongest first; at every other spacecraft the best detection within that window is theirs, or, where the search alone
found nothing, what a search of the window itself finds: a source behind the Sun is received late and low.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from bella.bursts.detection import (
    GROUP,
    Candidate,
    Searched,
    candidate_at,
    detection_row,
    detection_table,
    onset_records,
    search,
    why_not_alone,
)
from bella.bursts.matched_filter import BEAM_SPEEDS_C, FREQUENCY_MHZ, STEP_S, THRESHOLDS
from bella.exceptions import InputError, NoDataError
from bella.flags import CATALOGUED, LOCALISABLE
from bella.spacecraft import position_hee
from bella.spectra import FleetPiece, receiver_position
from bella.units import C_RSUN_S, FloatArray

SLOWEST = 0
"""Index of the slowest beam: what drifts like it, or slower, may be a lane of a Type II burst."""


@dataclass(frozen=True)
class Member:
    """A burst at one spacecraft."""

    searched: Searched
    candidate: Candidate
    company: str
    """Why it is not isolated; empty if it is."""

    @property
    def unfit(self) -> str:
        """Why the spacecraft does not help to place the burst; empty if it does."""
        return self.company or ("weak" if self.candidate.score < THRESHOLDS.weak_score else "")

    @property
    def fits(self) -> bool:
        """Whether the spacecraft helps to place the burst."""
        return not self.unfit


@dataclass(frozen=True)
class AssociatedBurst:
    """A burst that one or more spacecraft received.

    Attributes
    ----------
    members : tuple of Member
        Strongest first.
    tier : str
        "localisable", or "catalogued" with the reason why it is no more.
    burst_id : str
        Name, after the onset; of several that begin in one minute all but the first have a letter behind it, from b on.
    """

    members: tuple[Member, ...]
    tier: str = CATALOGUED
    reason: str = ""
    burst_id: str = ""

    @property
    def observatories(self) -> tuple[str, ...]:
        """Who received it, strongest first."""
        return tuple(one.searched.observatory for one in self.members)

    @property
    def start_utc(self) -> pd.Timestamp:
        """Earliest onset at the highest frequency of a spacecraft."""
        return min(_start(one.searched, one.candidate) for one in self.members)


def associate(searched: Sequence[Searched]) -> list[AssociatedBurst]:
    """Bursts of the fleet.

    Parameters
    ----------
    searched : sequence of Searched
        One for each spacecraft, of about the same time; those without a position (:func:`has_position`) are left out.

    Returns
    -------
    list of AssociatedBurst
        In order of time, each accepted detection in exactly one.
    """
    searched = [one for one in searched if has_position(one)]
    free = [(one, spectrum) for spectrum in searched for one in spectrum.found if not one.reason]
    free.sort(key=lambda pair: -pair[0].score)
    taken: set[tuple[str, int]] = set()
    bursts = []
    for one, spectrum in free:
        if (spectrum.observatory, one.record) in taken:
            continue
        members = [Member(spectrum, one, why_not_alone(spectrum, one))]
        for other in searched:
            if other.observatory != spectrum.observatory:
                members += _received_by(other, members, taken)
        taken |= {(member.searched.observatory, member.candidate.record) for member in members}
        bursts.append(_judged(members))
    return sorted(_named(bursts), key=lambda burst: burst.start_utc)


def _named(bursts: Sequence[AssociatedBurst]) -> list[AssociatedBurst]:
    """Bursts with names of their own; of those that share a minute one that can be localised comes first."""
    taken: dict[str, int] = {}
    named = []
    for burst in sorted(bursts, key=lambda one: one.tier != LOCALISABLE):
        name = burst_id(burst.start_utc.to_datetime64())
        letter = "" if name not in taken else chr(ord("a") + taken[name])
        taken[name] = taken.get(name, 0) + 1
        named.append(replace(burst, burst_id=name + letter))
    return named


def has_position(searched: Searched) -> bool:
    """Whether it is known where the spacecraft of a spectrum was: others cannot be compared."""
    try:
        _position_rsun(searched)
    except NoDataError:
        return False
    return True


def in_ephemeris(searched: Searched) -> bool:
    """Whether the ephemeris knows where the spacecraft of a spectrum was; if not, its file may."""
    try:
        position_hee(searched.observatory, [searched.grid.start], searched.grid.start)
    except (InputError, NoDataError):
        return False
    return True


def association_table(bursts: Sequence[AssociatedBurst], searched: Sequence[Searched]) -> pd.DataFrame:
    """Detections of all spacecraft with the burst they belong to, and those refused or not compared.

    Parameters
    ----------
    searched : sequence of Searched
        What the bursts were found in.

    Returns
    -------
    pandas.DataFrame
        Detection table in order of time; ``tier`` and ``reason`` are those of the burst.
    """
    rows = [
        detection_row(member.searched, member.candidate, member.company)
        | {"burst_id": burst.burst_id, "tier": burst.tier, "reason": burst.reason}
        for burst in bursts
        for member in burst.members
    ]
    taken = {(member.searched.observatory, member.candidate.record) for burst in bursts for member in burst.members}
    for spectrum in searched:
        is_compared = has_position(spectrum)
        alone = [one for one in spectrum.found if not _is_taken(taken, spectrum.observatory, one)]
        rows += [detection_row(spectrum, one) for one in alone if one.reason or not is_compared]
    return detection_table(rows).sort_values(["start_utc", "observatory"], ignore_index=True)


@dataclass(frozen=True)
class FleetDetections:
    """What was found in spectra of a fleet.

    Attributes
    ----------
    table : DataFrame
        Detection table.
    searched : int
        How many spectra could be searched.
    not_searchable : tuple of str
        A line for each of the others, with the names of its files.
    not_compared : tuple of str
        Spacecraft whose position is not known.
    """

    table: pd.DataFrame
    searched: int
    not_searchable: tuple[str, ...]
    not_compared: tuple[str, ...]


def detect_in_fleet(pieces: Sequence[FleetPiece]) -> FleetDetections:
    """Search all spectra, and compare spacecraft, one piece after the other."""
    tables, refusals, unknown, number = [], [], [], 0
    for piece in pieces:
        searched = [search(one) for one in piece.spectra.values()]
        tables.append(association_table(associate(searched), searched))
        unknown += [one.observatory for one in searched if not has_position(one)]
        for one in searched:
            number += not one.not_searchable
            if one.not_searchable:
                files = ", ".join(str(name) for name in np.atleast_1d(one.over.attrs["source_files"]))
                refusals.append(f"{one.observatory} ({files}): {one.not_searchable}; give a file of another receiver")
    table = pd.concat(tables, ignore_index=True) if tables else detection_table([])
    return FleetDetections(table, number, tuple(refusals), tuple(dict.fromkeys(unknown)))


def _start(searched: Searched, one: Candidate) -> pd.Timestamp:
    highest = int(np.flatnonzero(one.hit)[-1])
    return pd.Timestamp(searched.grid.start) + pd.Timedelta(seconds=float(onset_records(one)[highest]) * STEP_S)


def _received_by(other: Searched, members: Sequence[Member], taken: set[tuple[str, int]]) -> list[Member]:
    """The same burst at another spacecraft, or nothing."""
    free = [one for one in other.found if not one.reason and (other.observatory, one.record) not in taken]
    fitting = [one for one in free if all(_may_be_same(other, one, member) for member in members)]
    if not fitting:
        fitting = [one for one in _seeded(other, members[0]) if all(_may_be_same(other, one, m) for m in members)]
        fitting = [one for one in fitting if not _is_taken(taken, other.observatory, one)]
    best = sorted(fitting, key=lambda one: -one.score)[:1]
    return [Member(other, one, why_not_alone(other, one)) for one in best]


def _is_taken(taken: set[tuple[str, int]], observatory: str, one: Candidate) -> bool:
    """Whether another burst has a member within the minutes that count as one maximum."""
    return any(
        (observatory, one.record + apart) in taken
        for apart in range(-THRESHOLDS.apart_minutes, THRESHOLDS.apart_minutes + 1)
    )


def _may_be_same(other: Searched, one: Candidate, member: Member) -> bool:
    """Whether onsets in a channel that both see are no further apart than light is."""
    both = np.flatnonzero(one.hit & member.candidate.hit)
    channel = int(both[-1]) if both.size else int(np.flatnonzero(one.hit | member.candidate.hit)[0])
    apart_s = (other.grid.start - member.searched.grid.start) / np.timedelta64(1, "s")
    apart_s += STEP_S * float(onset_records(one)[channel] - onset_records(member.candidate)[channel])
    return bool(abs(apart_s) <= _window_s(other, member.searched))


def _window_s(first: Searched, second: Searched) -> float:
    apart_rsun = np.linalg.norm(_position_rsun(first) - _position_rsun(second))
    return float(apart_rsun / C_RSUN_S) + THRESHOLDS.slack_s


def _position_rsun(searched: Searched) -> FloatArray:
    """Where the spacecraft of a spectrum was when that begins; of one the ephemeris does not know, as its file says."""
    utc = searched.grid.start
    if in_ephemeris(searched):
        return np.asarray(position_hee(searched.observatory, [utc], utc)[0])
    middle = utc + np.timedelta64(round(STEP_S * len(searched.grid.excess_db) / 2), "s")
    return receiver_position(searched.over, middle).position_rsun


def _seeded(other: Searched, member: Member) -> list[Candidate]:
    """The best of what the filter shows in the window of a burst that another spacecraft received."""
    window_s = _window_s(other, member.searched)
    before_s = (other.grid.start - member.searched.grid.start) / np.timedelta64(1, "s")
    centre = member.candidate.record - before_s / STEP_S
    reach = window_s / STEP_S
    records = np.arange(max(0, int(centre - reach)), min(other.match.score.shape[1], int(centre + reach) + 2))
    if not records.size:
        return []
    record = int(records[other.match.score[: len(BEAM_SPEEDS_C), records].max(axis=0).argmax()])
    if other.match.score[: len(BEAM_SPEEDS_C), record].max() < THRESHOLDS.seed_score:
        return []
    one = candidate_at(other.match, record)
    rises = other.match.score[len(BEAM_SPEEDS_C) + 1 :, record].max()
    return [one._replace(reason="")] if one.hit.sum() >= THRESHOLDS.seed_hits and rises < one.score else []


def _judged(members: Sequence[Member]) -> AssociatedBurst:
    reason = _why_not_localisable(members)
    return AssociatedBurst(tuple(members), CATALOGUED if reason else LOCALISABLE, reason)


def _why_not_localisable(members: Sequence[Member]) -> str:
    company = {member.searched.observatory: member.unfit for member in members if not member.fits}
    if GROUP in company.values():
        return f"not localisable: {GROUP}"
    alone = [member for member in members if member.fits]
    if len(alone) < THRESHOLDS.spacecraft:
        rest = "".join(f", {why} at {name}" for name, why in company.items())
        return f"not localisable: received by {len(members)} of {THRESHOLDS.spacecraft} spacecraft{rest}"
    seen = np.sum([member.candidate.hit & (THRESHOLDS.low_mhz > FREQUENCY_MHZ) for member in alone], axis=0)
    if np.count_nonzero(seen >= THRESHOLDS.spacecraft) < THRESHOLDS.low_channels:
        return f"not localisable: too few channels below {THRESHOLDS.low_mhz:g} MHz in common"
    if np.median([member.candidate.drift for member in alone]) <= SLOWEST:
        return "not localisable: drifts too slowly for a beam"
    where = np.array([_position_rsun(one.searched) for one in alone])
    if _spread_rsun(where) < THRESHOLDS.spread_rsun:
        return "not localisable: spacecraft on a line"
    return ""


def _spread_rsun(where_rsun: FloatArray) -> float:
    """How far spacecraft are off the line through them, in the ecliptic plane."""
    inner = where_rsun[:, :2] - where_rsun[:, :2].mean(axis=0)
    return float(np.linalg.svd(inner, compute_uv=False)[-1])


def onset(arrivals: pd.DataFrame) -> np.datetime64:
    """Earliest arrival at the highest frequency: the moment a burst is named after.

    Parameters
    ----------
    arrivals : pandas.DataFrame
        Arrival table; needs ``frequency_mhz`` and ``arrival_utc``.

    Returns
    -------
    numpy.datetime64
        UTC, nanoseconds.

    Raises
    ------
    InputError
        If no row has an arrival time.
    """
    known = arrivals.dropna(subset=["arrival_utc"])
    if known.empty:
        raise InputError(
            "the arrival table holds no arrival time, so the burst cannot be named: add rows with arrival_utc"
        )
    highest = known.loc[known["frequency_mhz"] == known["frequency_mhz"].max(), "arrival_utc"]
    return np.datetime64(highest.min(), "ns")


def burst_id(moment: np.datetime64) -> str:
    """Name of a burst by its onset, such as ``T3-20120607-1929``.

    Parameters
    ----------
    moment : numpy.datetime64
        Onset, UTC; seconds are dropped, not rounded.

    Returns
    -------
    str
        ``T3-YYYYMMDD-HHMM``.

    Raises
    ------
    InputError
        If the onset is NaT.
    """
    if np.isnat(moment):
        raise InputError("a burst without onset has no name: give a UTC time")
    return f"T3-{pd.Timestamp(moment):%Y%m%d-%H%M}"

"""Whether spacecraft that are said to have received the same burst did: four spacecraft, simulated days."""

from dataclasses import dataclass
from datetime import date, timedelta

import numpy as np

from bella.bursts.association import AssociatedBurst, Member, associate
from bella.bursts.detection import onset_records, search
from bella.bursts.matched_filter import FREQUENCY_MHZ, STEP_S
from bella.flags import LOCALISABLE
from bella.simulation.archive_days import sky_of
from bella.simulation.burst import SimulatedBurst, arrival_s, contrast_at
from bella.simulation.sky import Sky
from benchmarks.detection import FIRST_DAY, FLEET, NEAR_S, spectrum_of, truths

AUDIBLE = 0.05
"""Peak over background from which on the search may take part of a burst."""


@dataclass
class Tally:
    """Counts over days."""

    days: int = 0
    groups: int = 0
    right: int = 0
    members: int = 0
    pure: int = 0
    could: int = 0
    placed: int = 0

    def __str__(self) -> str:
        return (
            f"{self.days} days, {self.groups} localisable: precision {self.right / max(self.groups, 1):.3f}, "
            f"member purity {self.pure / max(self.members, 1):.3f}; "
            f"of {self.could} bursts isolated and broad at three spacecraft {self.placed} are localisable"
        )


def origin(member: Member, sky: Sky) -> int:
    """Index of the burst that a member is, -1 for none; bursts of a storm count on after the others.

    It is the one whose times of arrival in the channels of the member are nearest to those of the member.
    """
    name, one = member.searched.observatory, member.candidate
    channels = np.flatnonzero(one.hit)[:: max(1, int(one.hit.sum()) // 6)]
    start = member.searched.grid.start + (onset_records(one)[channels] * STEP_S * 1e9).astype("timedelta64[ns]")
    apart = [_apart_s(burst, name, FREQUENCY_MHZ[channels], start) for burst in (*sky.bursts, *sky.storm)]
    nearest = int(np.argmin(apart)) if apart else -1
    return nearest if apart and apart[nearest] < NEAR_S else -1


def _apart_s(burst: SimulatedBurst, name: str, frequency_mhz: np.ndarray, start: np.ndarray) -> float:
    """Median distance of onsets from the arrival of a burst, s; infinite where it is not received in half of them."""
    received = contrast_at(burst, frequency_mhz, name) > AUDIBLE
    if np.count_nonzero(received) < 0.5 * received.size:
        return np.inf
    after_s = (start[received] - burst.release_utc) / np.timedelta64(1, "s")
    return float(np.median(np.abs(after_s - arrival_s(burst, frequency_mhz[received], name))))


def add_day(tally: Tally, sky: Sky, bursts: list[AssociatedBurst]) -> None:
    """Score the localisable bursts of a day."""
    tally.days += 1
    placed = set()
    for burst in bursts:
        if burst.tier != LOCALISABLE:
            continue
        origins = [origin(member, sky) for member in burst.members]
        common = max(set(origins), key=origins.count)
        tally.groups += 1
        tally.right += common >= 0 and origins.count(common) >= 3
        tally.members += len(origins)
        tally.pure += origins.count(common) if common >= 0 else 0
        placed.add(common)
    isolated = np.array([[one.is_isolated_broad for one in truths(sky, name)] for name in FLEET])
    could = set(np.flatnonzero(isolated.sum(axis=0) >= 3).tolist()) if isolated.size else set()
    tally.could += len(could)
    tally.placed += len(could & placed)


def score_days(days: int, seed: int, first: date = FIRST_DAY) -> Tally:
    """Score of simulated days."""
    tally = Tally()
    for number in range(days):
        day = first + timedelta(days=number)
        skies = [sky_of(other, seed) for other in (day - timedelta(days=1), day, day + timedelta(days=1))]
        found = [search(spectrum_of(name, day, skies, seed)) for name in FLEET]
        add_day(tally, skies[1], associate(found))
    return tally


if __name__ == "__main__":
    import sys

    print(score_days(int(sys.argv[1]), int(sys.argv[2])))

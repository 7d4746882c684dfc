"""Coverage of the answers about simulated bursts as a table, and the rows of it that stand for a real solution."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from statistics import NormalDist, median
from typing import TYPE_CHECKING

import bella
from bella.calibration.rows import parse_rows, rows_csv
from bella.records import Tier

if TYPE_CHECKING:
    from bella.calibration.found import FoundBurst, Quantity

ALL = "all"
QUANTITIES = {"position": "R_sun", "phi0": "deg", "wind": "km/s", "beam": "c"}
"""Name and unit of what is covered."""

LEVEL_68, LEVEL_95 = 0.68, 0.95
Z_95 = NormalDist().inv_cdf(0.975)
FLEET_OF = {2: "pair", 3: "2012", 4: "2021"}
"""Fleet whose bursts have as many spacecraft."""

PUBLISHED = "found.csv"


@dataclass(frozen=True)
class FoundRow:
    """Coverage of one number of the answers of one group of bursts.

    Attributes
    ----------
    stratum, fleet, tier, edge, grade : str
        The group; "all" where it is not divided.
    simulated : int
        Bursts of the stratum and fleet.
    answers : int
        Bursts of the group that have an answer.
    bursts : int
        Bursts of the group that have this number.
    cover68, cover95 : float or None
        Shares of truths inside, with 95 % Wilson intervals `_low` and `_high`; None without bursts.
    median_error, median_width : float or None
        Of the median, and width of the 68 % interval.
    lost : float or None
        Share of bursts with most positions beyond 3 standard deviations; of positions only.
    """

    stratum: str
    fleet: str
    tier: str
    edge: str
    grade: str
    quantity: str
    unit: str
    simulated: int
    answers: int
    bursts: int
    cover68: float | None
    cover68_low: float | None
    cover68_high: float | None
    cover95: float | None
    cover95_low: float | None
    cover95_high: float | None
    median_error: float | None
    median_width: float | None
    lost: float | None
    seed: int
    bella_version: str

    @property
    def departures(self) -> tuple[str, ...]:
        """In words, what does not hold: levels that the Wilson interval of their coverage leaves out."""
        levels = (
            (LEVEL_68, self.cover68, self.cover68_low, self.cover68_high),
            (LEVEL_95, self.cover95, self.cover95_low, self.cover95_high),
        )
        return tuple(
            f"the {level:.0%} interval holds {share:.2f}".replace("%", " %")
            for level, share, low, high in levels
            if share is not None and low is not None and high is not None and not low <= level <= high
        )


def wilson_interval(share: float, number: int) -> tuple[float, float]:
    """Interval of a share at 95 % (Wilson 1927, doi:10.1080/01621459.1927.10502953).

    Parameters
    ----------
    share : float
        Found among `number` independent trials; it need not be a multiple of 1 / `number`.
    """
    weight = Z_95**2 / number
    centre = (share + weight / 2) / (1 + weight)
    half = math.sqrt(share * (1 - share) * weight + weight**2 / 4) / (1 + weight)
    return max(0.0, centre - half), min(1.0, centre + half)


def found_rows(found: "Sequence[FoundBurst]", seed: int) -> list[FoundRow]:
    """Coverage of every group: each stratum and fleet, and all strata of a fleet by edge and by grade.

    Parameters
    ----------
    seed : int
        Of the run.
    """
    rows = []
    for fleet in dict.fromkeys(one.task.fleet for one in found):
        of_fleet = [one for one in found if one.task.fleet == fleet]
        for tier in _tiers(of_fleet):
            for stratum in (*dict.fromkeys(one.task.stratum for one in of_fleet), ALL):
                group = [one for one in of_fleet if stratum in {one.task.stratum, ALL}]
                rows += _group(group, (stratum, fleet, tier, ALL, ALL), seed)
            answered = [one for one in of_fleet if one.tier == tier]
            for edge in sorted({one.edge for one in answered}):
                rows += _group(of_fleet, (ALL, fleet, tier, edge, ALL), seed)
            for grade in sorted({one.grade for one in answered}):
                rows += _group(of_fleet, (ALL, fleet, tier, ALL, grade), seed)
    return rows


def _tiers(found: "Sequence[FoundBurst]") -> list[str]:
    """Tiers of the answers, and that which is expected of the fleet even where there is none."""
    expected = "preliminary" if found[0].task.fleet == FLEET_OF[2] else "final"
    return [expected, *sorted({one.tier for one in found if one.tier} - {expected})]


def _group(found: "Sequence[FoundBurst]", key: tuple[str, str, str, str, str], seed: int) -> list[FoundRow]:
    stratum, fleet, tier, edge, grade = key
    answered = [one for one in found if one.tier == tier and edge in {one.edge, ALL} and grade in {one.grade, ALL}]
    rows = []
    for name, unit in QUANTITIES.items():
        measured = [quantity for one in answered if (quantity := getattr(one, name)) is not None]
        if measured or name == "phi0":
            rows.append(
                FoundRow(
                    stratum=stratum,
                    fleet=fleet,
                    tier=tier,
                    edge=edge,
                    grade=grade,
                    quantity=name,
                    unit=unit,
                    simulated=len(found),
                    answers=len(answered),
                    bursts=len(measured),
                    lost=_share([one.lost for one in answered]) if name == "position" else None,
                    seed=seed,
                    bella_version=bella.__version__,
                    **_numbers(measured),
                )
            )
    return rows


def _share(inside: Sequence[float]) -> float:
    return sum(inside) / len(inside)


def _numbers(measured: "Sequence[Quantity]") -> dict[str, float | None]:
    if not measured:
        names = ("cover68", "cover95")
        empty = [f"{name}{end}" for name in names for end in ("", "_low", "_high")]
        return dict.fromkeys([*empty, "median_error", "median_width"])
    numbers: dict[str, float | None] = {}
    for name, share in (
        ("cover68", _share([one.in68 for one in measured])),
        ("cover95", _share([one.in95 for one in measured])),
    ):
        low, high = wilson_interval(share, len(measured))
        numbers |= {name: share, f"{name}_low": low, f"{name}_high": high}
    error, width = (median(getattr(one, name) for one in measured) for name in ("error", "width"))
    return numbers | {"median_error": error, "median_width": width}


def found_csv(rows: Sequence[FoundRow]) -> str:
    """Coverage as CSV."""
    return rows_csv(rows, FoundRow)


def parse_found(text: str) -> list[FoundRow]:
    """Rows of a table that :func:`found_csv` wrote; InputError where it is another table."""
    return parse_rows(text, FoundRow)


@lru_cache(maxsize=1)
def published_rows() -> tuple[FoundRow, ...]:
    """Table that comes with the package: that of the page of this version."""
    return tuple(parse_found((resources.files("bella.calibration") / PUBLISHED).read_text(encoding="utf-8")))


def stratum_of(
    spacecraft: int, edge: str, tier: Tier, rows: Iterable[FoundRow] | None = None, *, grade: str = ALL
) -> tuple[FoundRow, ...]:
    """Rows of the published table that stand for a real solution: bursts of all strata, timed as it was.

    Which stratum a real burst belongs to is not known, so all of them are taken together.

    Parameters
    ----------
    spacecraft : int
        That were timed.
    edge : str
        Definition of the edge of the solution; "all" for those of a grade.
    tier : {"final", "preliminary"}
    rows : iterable of FoundRow, optional
        Another table than the published one.
    grade : str
        Of the solution; "all" for those of an edge.

    Returns
    -------
    tuple of FoundRow
        One for each number of the answer; empty where no simulated burst was timed and answered in this way.
    """
    fleet = FLEET_OF.get(min(spacecraft, max(FLEET_OF)))
    key = (ALL, fleet, tier, edge, grade)
    known = published_rows() if rows is None else rows
    return tuple(one for one in known if (one.stratum, one.fleet, one.tier, one.edge, one.grade) == key and one.bursts)

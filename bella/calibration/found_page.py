"""The report on simulated bursts that went through the whole pipeline, as a page of Markdown."""

from collections.abc import Sequence

from bella.calibration.found_table import ALL, FoundRow

INTRODUCTION = """# Calibration of found bursts

Do the answers about bursts that the service finds hold what they say? Isolated bursts of laws that no step knows
([simulation.md](simulation.md)) go through detection, association, timing, localisation, track and grade as the bursts
of a day do: positions from the shared frequencies, the track from the channels, the preset `default`, the edge
`shared_profile` (where it does not converge, `half_rise`), and with two spacecraft the preliminary track of `half_rise`
with `half_maximum` as the second edge. The seeds serve for nothing but this page. Made by
`bella calibrate --found --bursts {bursts} --seed {seed}` of BELLA {version}; all numbers are in
[{table}]({table}).

Each share is that of truths inside a 68 % or a 95 % interval, with its 95 % Wilson interval in brackets; **bold** where
that leaves out 0.68 or 0.95. The positions of a burst share their errors: their share is the mean over its frequencies,
and the Wilson interval counts bursts. Their regions are the ellipses of the covariance in the localisation table.
Errors are medians of the distance from estimate to truth; widths are medians of the whole 68 % interval, of positions
two standard deviations along the longest axis. Of a longitude with several parts the error is that of the likeliest.
The truth of the beam speed is the mean along the spiral between the highest and the lowest frequency that was timed.
Lost is the share of bursts with more than half of their positions beyond 3 standard deviations. Where the answer says
"wind not measured", the interval that is stored counts.
"""

FLEETS = {"2012": "three", "2021": "four", "pair": "two"}
TITLES = {
    "position": "Positions",
    "phi0": "Longitude of the footpoint",
    "wind": "Solar wind",
    "beam": "Beam speed",
}
DIGITS = {"position": 2, "phi0": 1, "wind": 0, "beam": 3}
STRATA_HEADER = """| stratum | craft | tier | answers | bursts | 68 % | 95 % | error, {unit} | width, {unit} |{lost}
|---|---|---|---|---|---|---|---|---|{line}
"""
GROUP_HEADER = """| number | spacecraft | tier | {what} | bursts | 68 % | 95 % | error | width |
|---|---|---|---|---|---|---|---|---|
"""
ANSWERED = """
## Which bursts have an answer

Of {simulated} simulated bursts {answers} have one. The others are not detected, not received well by enough
spacecraft, or their preliminary track says too little. Shared profile: answers with this edge.

| spacecraft | simulated | answers | shared profile |
|---|---|---|---|
"""
HOLDS = """
## What does not hold

"""
CHANCE = """Of {tests} intervals about {chance:.0f} would stand here by chance if all were right.
"""


def found_page(rows: Sequence[FoundRow], *, table: str) -> str:
    """Report on a run.

    Parameters
    ----------
    rows : sequence of FoundRow
        At least one.
    table : str
        Name of the file beside the page that holds the numbers.

    Returns
    -------
    str
        Markdown.
    """
    of_strata = [one for one in rows if one.edge == one.grade == ALL]
    bursts = max(one.simulated for one in of_strata if one.stratum != ALL)
    parts = [INTRODUCTION.format(bursts=bursts, seed=rows[0].seed, version=rows[0].bella_version, table=table)]
    parts += [*_answered(rows), *_departures(of_strata)]
    for name, title in TITLES.items():
        chosen = [one for one in of_strata if one.quantity == name and one.bursts]
        if chosen:
            parts += [f"\n## {title}\n\n", _header(chosen[0]), *map(_stratum_row, chosen)]
    for what in ("edge", "grade"):
        groups = [one for one in rows if getattr(one, what) != ALL and one.bursts]
        parts += [f"\n## By {what}\n\n", GROUP_HEADER.format(what=what)]
        parts += [_group_row(one, what) for name in TITLES for one in groups if one.quantity == name]
    return "".join(parts)


def _answered(rows: Sequence[FoundRow]) -> list[str]:
    """How many bursts of each fleet have an answer, and how many of those from the shared profile."""
    longitudes = [one for one in rows if one.stratum == ALL and one.quantity == "phi0" and one.grade == ALL]
    whole = [one for one in longitudes if one.edge == ALL]
    simulated = {one.fleet: one.simulated for one in whole}
    said = ANSWERED.format(simulated=sum(simulated.values()), answers=sum(one.answers for one in whole))
    lines = []
    for fleet, number in simulated.items():
        tiers = ", ".join(f"{one.answers} {one.tier}" for one in whole if one.fleet == fleet)
        shared = sum(one.answers for one in longitudes if one.fleet == fleet and one.edge == "shared_profile")
        lines.append(f"| {FLEETS[fleet]} | {number} | {tiers} | {shared} |\n")
    return [said, *lines]


def _departures(rows: Sequence[FoundRow]) -> list[str]:
    """What the Wilson intervals leave out: all strata together first, then each."""
    departing = [one for name in TITLES for one in rows if one.quantity == name and one.departures]
    parts = [HOLDS]
    for title, chosen in (
        ("All strata together:", [one for one in departing if one.stratum == ALL]),
        ("One stratum:", [one for one in departing if one.stratum != ALL]),
    ):
        parts += [f"{title}\n\n", *(map(_departure, chosen) if chosen else ["- nothing\n"]), "\n"]
    tests = 2 * sum(one.bursts > 0 for one in rows)
    return [*parts, CHANCE.format(tests=tests, chance=0.05 * tests)]


def _departure(row: FoundRow) -> str:
    stratum = "" if row.stratum == ALL else f", {row.stratum}"
    return (
        f"- {TITLES[row.quantity]}{stratum}, {FLEETS[row.fleet]} spacecraft ({row.tier}, {row.bursts} bursts): "
        f"{' and '.join(row.departures)}\n"
    )


def _header(row: FoundRow) -> str:
    is_lost = row.lost is not None
    return STRATA_HEADER.format(unit=row.unit, lost=" lost |" if is_lost else "", line="---|" if is_lost else "")


def _stratum_row(row: FoundRow) -> str:
    cells = [row.stratum, FLEETS[row.fleet], row.tier, f"{row.answers} of {row.simulated}", *_coverage(row)]
    return _line([*cells, f"{row.lost:.2f}"] if row.lost is not None else cells)


def _group_row(row: FoundRow, what: str) -> str:
    numbers = _coverage(row)
    units = [f"{number} {row.unit}" for number in numbers[3:]]
    return _line([TITLES[row.quantity], FLEETS[row.fleet], row.tier, getattr(row, what), *numbers[:3], *units])


def _coverage(row: FoundRow) -> list[str]:
    digits = DIGITS[row.quantity]
    return [
        str(row.bursts),
        _share(row.cover68, row.cover68_low, row.cover68_high, 0.68),
        _share(row.cover95, row.cover95_low, row.cover95_high, 0.95),
        *(f"{value:.{digits}f}" for value in (row.median_error, row.median_width)),
    ]


def _share(share: float | None, low: float | None, high: float | None, level: float) -> str:
    if share is None or low is None or high is None:
        return "-"
    said = f"{share:.2f} ({low:.2f}-{high:.2f})"
    return said if low <= level <= high else f"**{said}**"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |\n"

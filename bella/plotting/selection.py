"""Bursts of a selection: longitude and solar wind against time, and their footpoints around the Sun, SVG.

A few hundred bursts are links to their pages; of more, each kind is one path, so that a thousand stay below 100 kB.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta

import numpy as np

from bella.plotting.svg import Scale, element, figure, line, number, path, words
from bella.units import DAY_S, within_half_turn_deg

CHART_SIZE, DISC_SIZE = (540.0, 280.0), 360.0
MOST_TIMES = 5
LEFT, RIGHT, TOP, BOTTOM = 56.0, 22.0, 12.0, 40.0
LONGITUDE_TICKS_DEG = (-180, -90, 0, 90, 180)
LEAST_WIND_KM_S, MOST_WIND_KM_S = 200.0, 900.0
WIND_TICKS_KM_S = (200, 400, 600, 800)
MARGIN_SHARE, LEAST_SPAN_S = 0.04, 600.0

MOST_LINKED = 300
"""More bursts than these are not links: nobody hits one of them, and each takes 300 bytes."""

GRADES = "ABCD"
SECTOR_DEG = 10
SUN_RADIUS, LONGEST_BAR, LABEL_ROOM = 44.0, 98.0, 22.0


@dataclass(frozen=True)
class Estimate:
    """A value with the ends of its 68 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Marked:
    """A burst on a figure: when, where, how fast the wind was, how sure, and where more is said of it."""

    start: datetime
    longitude_deg: Estimate | None
    wind_km_s: Estimate | None
    grade: str
    said: str
    address: str


def longitude_figure(bursts: Sequence[Marked]) -> str:
    """Longitudes of bursts against time with their 68 % intervals; those without one stand on the line below.

    Parameters
    ----------
    bursts : sequence of Marked
        At least one.
    """
    found = [_turned(one.longitude_deg) for one in bursts]
    sides = {tick: "" if tick in {0, 180, -180} else "W" if tick > 0 else "E" for tick in LONGITUDE_TICKS_DEG}
    ticks = {float(tick): f"{abs(tick)}°{side}" for tick, side in sides.items()}
    drawn = _against_time(bursts, found, (-180.0, 180.0), ticks)
    return figure("selection", CHART_SIZE, "Longitude of each burst at the Sun against time.", *drawn)


def wind_figure(bursts: Sequence[Marked]) -> str:
    """Solar wind of bursts against time with its 68 % intervals; where it was not measured, on the line below.

    Parameters
    ----------
    bursts : sequence of Marked
        At least one.
    """
    found = [[one.wind_km_s] if one.wind_km_s else [] for one in bursts]
    ticks = {float(tick): str(tick) for tick in WIND_TICKS_KM_S}
    drawn = _against_time(bursts, found, (LEAST_WIND_KM_S, MOST_WIND_KM_S), ticks)
    return figure("selection wind", CHART_SIZE, "Solar wind of each burst against time, km/s.", *drawn)


def footpoint_figure(bursts: Sequence[Marked], address: str = "") -> str:
    """How many footpoints lie in each direction, seen from ecliptic north with the Earth to the right.

    Parameters
    ----------
    address : str
        Of the list of this selection, to which the bounds of a sector are added; empty for no links.
    """
    centre, found = DISC_SIZE / 2, Counter[tuple[int, str]]()
    for one in bursts:
        if one.longitude_deg is not None:
            turned = (one.longitude_deg.value + 180.0) % 360.0 - 180.0
            found[int(turned // SECTOR_DEG) * SECTOR_DEG, one.grade] += 1
    sectors = sorted({start for start, _ in found})
    most = max((sum(found[start, grade] for grade in GRADES) for start in sectors), default=1)
    parts = [*_disc_grid(centre, most)]
    for start in sectors:
        counts = {grade: found[start, grade] for grade in GRADES if found[start, grade]}
        parts.append(_bar(centre, start, counts, most, address))
    parts.append(element("circle", cx=centre, cy=centre, r=SUN_RADIUS, class_="sun disc"))
    parts.append(words("Earth", DISC_SIZE - 8, centre - 9, class_="craft-label", text_anchor="end"))
    parts.append(element("circle", cx=DISC_SIZE - 12, cy=centre, r=4.5, class_="earth"))
    placed = sum(found.values())
    parts.append(words(str(placed), centre, centre + 4, class_="on-sun", text_anchor="middle"))
    title = "Footpoints of the bursts around the Sun, seen from ecliptic north, Earth to the right."
    return figure("footpoints", (DISC_SIZE, DISC_SIZE), title, *parts)


def selection_caption(name: str, shown: int, total: int) -> str:
    """What a figure of a selection shows, for a file of its own.

    Parameters
    ----------
    name : str
        `longitude`, `footpoints` or `wind`.
    shown, total : int
        Bursts that are drawn, and that were found.
    """
    said = {
        "longitude": "Longitude at the Sun of Type III bursts against time (HEE, west positive), with 68 % intervals; "
        "on the line below: without one.",
        "footpoints": f"Footpoints of Type III bursts by {SECTOR_DEG}° of longitude (HEE), seen from ecliptic north, "
        "Earth to the right; longer bars: more bursts.",
        "wind": "Solar wind that was measured with each burst against time, with 68 % intervals; on the line below: "
        "not measured.",
    }[name]
    part = f"{total} bursts" if shown == total else f"{shown} of {total} bursts"
    return f"{said} Green: grade A and B, orange: C, grey: D. {part}."


@dataclass(frozen=True)
class _Chart:
    across: Scale
    upward: Scale
    foot: float

    @property
    def below(self) -> float:
        """Height of the line of those without a value."""
        return self.foot - 5


def _against_time(
    bursts: Sequence[Marked], found: Sequence[list[Estimate]], ends: tuple[float, float], ticks: Mapping[float, str]
) -> Iterator[str]:
    """Values of bursts between two ends of an upward axis."""
    seconds = [one.start.timestamp() for one in bursts]
    room = max(MARGIN_SHARE * (max(seconds) - min(seconds)), LEAST_SPAN_S)
    across = Scale(min(seconds) - room, max(seconds) + room, LEFT, CHART_SIZE[0] - RIGHT)
    foot = CHART_SIZE[1] - BOTTOM
    chart = _Chart(across, Scale(*ends, foot - 16, TOP), foot)
    for tick, said in ticks.items():
        y = float(chart.upward(tick))
        yield line(across.start, y, across.end, y, class_="gridline")
        yield words(said, across.start - 6, y + 4, class_="tick", text_anchor="end")
    for moment, said in time_labels(across, MOST_TIMES):
        x = float(across(moment))
        yield line(x, TOP, x, foot, class_="gridline")
        yield words(said, x, foot + 17, class_="tick", text_anchor="middle")
    middle = (across.start + across.end) / 2
    yield words("UTC", middle, foot + 34, class_="axis-name", text_anchor="middle")
    yield from _marks(chart, list(zip(bursts, found, strict=True)))


def _turned(estimate: Estimate | None) -> list[Estimate]:
    """A longitude within half a turn; twice where its interval goes across the far side."""
    if estimate is None:
        return []
    middle = within_half_turn_deg(estimate.value)
    turns = (middle - estimate.value + turn for turn in (0.0, -360.0, 360.0))
    moved = [Estimate(middle, estimate.low + turn, estimate.high + turn) for turn in turns]
    return [one for one in moved if one.low <= 180.0 and one.high >= -180.0]


def _marks(chart: _Chart, bursts: Sequence[tuple[Marked, list[Estimate]]]) -> Iterator[str]:
    yield line(chart.across.start, chart.below, chart.across.end, chart.below, class_="gridline")
    if len(bursts) > MOST_LINKED:
        yield from _together(chart, bursts)
        return
    for one, found in bursts:
        x = chart.across.at(one.start.timestamp())
        inside = [line(x, low, x, high, class_="interval") for low, high in _ends(chart, found)]
        y = _height(chart, found)
        kind = f"grade-{one.grade}" if found else "open"
        inside.append(element("circle", cx=x, cy=y, r=4.5 if found else 4, class_=kind))
        yield element("a", element("title", one.said), *inside, href=one.address)


def _together(chart: _Chart, bursts: Sequence[tuple[Marked, list[Estimate]]]) -> Iterator[str]:
    """All bursts of a kind as one path: its points are lines without a length, drawn with a round pen."""
    intervals: list[str] = []
    points: dict[str, list[str]] = {}
    for one, found in bursts:
        x = number(chart.across.at(one.start.timestamp()))
        intervals += [f"M{x} {number(low)}V{number(high)}" for low, high in _ends(chart, found)]
        kind = f"grade-{one.grade}" if found else "open"
        points.setdefault(kind, []).append(f"M{x} {number(_height(chart, found))}h0")
    yield element("path", d="".join(intervals), class_="interval many")
    for kind, some in sorted(points.items()):
        yield element("path", d="".join(some), class_=f"points {kind}")


def _ends(chart: _Chart, found: list[Estimate]) -> list[tuple[float, float]]:
    return [(chart.upward.inside(one.low), chart.upward.inside(one.high)) for one in found]


def _height(chart: _Chart, found: list[Estimate]) -> float:
    return chart.upward.inside(found[0].value) if found else chart.below


def time_labels(across: Scale, most: int = 9) -> list[tuple[float, str]]:
    """Seconds since 1970 at which a calendar or a clock shows something round, with what it shows."""
    length_d = (across.high - across.low) / DAY_S
    first, last = (datetime.fromtimestamp(one, UTC) for one in (across.low, across.high))
    if length_d <= 1.5:
        return [(one, f"{datetime.fromtimestamp(one, UTC):%H:%M}") for one in across.time_ticks(most)]
    if length_d <= 2.5 * most:
        step = max(1, round(length_d / most))
        days = [first.date() + timedelta(days=index) for index in range(1, int(length_d) + 2, step)]
        return _kept(across, [(one, f"{one:%d %b}") for one in days])
    if length_d <= 30.5 * 2.5 * most:
        months = _months(first.date(), last.date())[:: max(1, round(length_d / 30.5 / most))]
        return _kept(across, [(one, f"{one:%b %Y}") for one in months])
    years = range(first.year, last.year + 1, max(1, round(length_d / 365.25 / most)))
    return _kept(across, [(date(year, 1, 1), str(year)) for year in years])


def _months(first: date, last: date) -> list[date]:
    count = (last.year - first.year) * 12 + last.month - first.month + 1
    return [date(first.year + (first.month - 1 + n) // 12, (first.month - 1 + n) % 12 + 1, 1) for n in range(count)]


def _kept(across: Scale, labels: Sequence[tuple[date, str]]) -> list[tuple[float, str]]:
    placed = [(datetime(one.year, one.month, one.day, tzinfo=UTC).timestamp(), said) for one, said in labels]
    return [(moment, said) for moment, said in placed if across.holds(moment)]


def _disc_grid(centre: float, most: int) -> Iterator[str]:
    """Spokes of round longitudes, and the ring that the longest bar reaches."""
    outer = SUN_RADIUS + LONGEST_BAR
    for longitude in range(-150, 181, 30):
        angle = np.radians(longitude)
        x, y = float(np.cos(angle)), -float(np.sin(angle))
        yield line(centre, centre, centre + outer * x, centre + outer * y, class_="spoke")
        side = "" if longitude in {0, 180} else "W" if longitude > 0 else "E"
        if longitude:
            place = centre + (outer + LABEL_ROOM) * x, centre + (outer + LABEL_ROOM) * y + 4
            yield words(f"{abs(longitude)}°{side}", *place, class_="spoke-label", text_anchor="middle")
    yield element("circle", cx=centre, cy=centre, r=outer, class_="ring")
    yield words(f"ring: {most} burst{'' if most == 1 else 's'}", 4, 16, class_="tick")


def _bar(centre: float, start: int, counts: dict[str, int], most: int, address: str) -> str:
    """Bursts of a sector, the best grade next to the Sun."""
    inner, parts = SUN_RADIUS, []
    for grade, count in counts.items():
        outer = inner + LONGEST_BAR * count / most
        angle = np.radians(np.linspace(start + 0.6, start + SECTOR_DEG - 0.6, 6))
        arcs = [np.column_stack([np.cos(angle), -np.sin(angle)]) * radius for radius in (inner, outer)]
        parts.append(
            path(centre + np.vstack([arcs[0], arcs[1][::-1]]), closed=True, class_=f"sector-bar grade-{grade}")
        )
        inner = outer
    total = sum(counts.values())
    said = f"{_side(start)} to {_side(start + SECTOR_DEG)}: {total} burst{'' if total == 1 else 's'}"
    title = element("title", said)
    if not address:
        return element("g", title, *parts)
    joint = "&" if "?" in address else "?"
    bounds = f"longitude_min={start}&longitude_max={start + SECTOR_DEG}"
    return element("a", title, *parts, href=f"{address}{joint}{bounds}")


def _side(longitude_deg: int) -> str:
    return f"{abs(longitude_deg)}°{'' if longitude_deg == 0 else ' W' if longitude_deg > 0 else ' E'}"

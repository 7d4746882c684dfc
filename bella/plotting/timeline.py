"""Bursts and searched days in time: bursts of a selection by longitude, and calendars from years to days."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta

from bella.plotting.svg import Scale, element, figure, line, words
from bella.units import DAY_S

WIDTH, HEIGHT = 1240.0, 230.0
LEFT, RIGHT, TOP, BOTTOM = 48.0, 14.0, 12.0, 40.0
LONGITUDE_TICKS_DEG = (-180, -90, 0, 90, 180)
MARGIN_SHARE, LEAST_SPAN_S = 0.04, 3600.0


@dataclass(frozen=True)
class Marked:
    """A burst on a figure: when, where, how sure, and where more is said of it."""

    start: datetime
    longitude_deg: float | None
    low_deg: float | None
    high_deg: float | None
    grade: str
    said: str
    address: str


def selection_figure(bursts: Sequence[Marked]) -> str:
    """Longitudes of bursts against time with their 68 % intervals, SVG; those without one stand on the line below.

    Parameters
    ----------
    bursts : sequence of Marked
        At least one.

    Returns
    -------
    str
    """
    seconds = [one.start.timestamp() for one in bursts]
    room = max(MARGIN_SHARE * (max(seconds) - min(seconds)), LEAST_SPAN_S)
    across = Scale(min(seconds) - room, max(seconds) + room, LEFT, WIDTH - RIGHT)
    upward = Scale(-180.0, 180.0, HEIGHT - BOTTOM - 16, TOP)
    below = HEIGHT - BOTTOM - 5
    parts = [*_time_axis(across), *_longitude_axis(across, upward)]
    parts.append(line(across.start, below, across.end, below, class_="gridline"))
    parts += [_mark(one, float(across(one.start.timestamp())), upward, below) for one in bursts]
    return figure("selection", (WIDTH, HEIGHT), "Longitude of each burst at the Sun against time.", *parts)


def _mark(one: Marked, x: float, upward: Scale, below: float) -> str:
    inside = [element("title", one.said)]
    if one.longitude_deg is None or one.low_deg is None or one.high_deg is None:
        inside.append(element("circle", cx=x, cy=below, r=4, class_="open"))
    else:
        for turn in (-360.0, 0.0, 360.0):
            low, high = max(one.low_deg + turn, -180.0), min(one.high_deg + turn, 180.0)
            if low <= high:
                inside.append(line(x, float(upward(low)), x, float(upward(high)), class_="error"))
        middle = (one.longitude_deg + 180.0) % 360.0 - 180.0
        inside.append(element("circle", cx=x, cy=float(upward(middle)), r=4.5, class_=f"grade-{one.grade}"))
    return element("a", *inside, href=one.address)


def _longitude_axis(across: Scale, upward: Scale) -> Iterator[str]:
    for tick in LONGITUDE_TICKS_DEG:
        y = float(upward(tick))
        side = "" if tick in {0, 180, -180} else " W" if tick > 0 else " E"
        yield line(across.start, y, across.end, y, class_="gridline")
        yield words(f"{abs(tick)}°{side}", across.start - 6, y + 4, class_="tick", text_anchor="end")


def _time_axis(across: Scale) -> Iterator[str]:
    for moment, said in time_labels(across):
        x = float(across(moment))
        yield line(x, TOP, x, HEIGHT - BOTTOM, class_="gridline")
        yield words(said, x, HEIGHT - BOTTOM + 17, class_="tick", text_anchor="middle")
    yield words("UTC", (across.start + across.end) / 2, HEIGHT - 6, class_="axis-name", text_anchor="middle")


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

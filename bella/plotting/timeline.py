"""Bursts and searched days in time: bursts of a selection by longitude, and calendars from years to days."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta

from bella.plotting.svg import Scale, element, figure, line, words
from bella.units import DAY_S

WIDTH, HEIGHT = 1240.0, 230.0
LEFT, RIGHT, TOP, BOTTOM = 48.0, 22.0, 12.0, 40.0
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
                inside.append(line(x, float(upward(low)), x, float(upward(high)), class_="interval"))
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


@dataclass(frozen=True)
class DayMark:
    """A searched day on a calendar: what can be said of it, and where more is said."""

    day: date
    answer: str
    localised: int
    said: str
    address: str


@dataclass(frozen=True)
class OnsetMark:
    """A burst on the strip of its day."""

    start: datetime
    is_localised: bool
    said: str
    address: str


CELL, ROW = 37.0, 26.0
STRIP_LEFT = 96.0


def calendar_figure(days: Sequence[DayMark]) -> str:
    """Calendar with a row for each month and a cell for each day, the newest month on top, SVG.

    Parameters
    ----------
    days : sequence of DayMark

    Returns
    -------
    str
    """
    months = sorted({(one.day.year, one.day.month) for one in days}, reverse=True)
    height = 24.0 + ROW * len(months)
    parts = [
        words(str(n), STRIP_LEFT + CELL * (n - 0.5), 14, class_="tick", text_anchor="middle") for n in range(1, 32)
    ]
    for row, (year, month) in enumerate(months):
        y, first = 22.0 + ROW * row, date(year, month, 1)
        last = date(year + month // 12, month % 12 + 1, 1) - timedelta(days=1)
        label = words(f"{first:%b %Y}", 0, y + 16, class_="month")
        parts.append(element("a", label, href=f"/days?from={first}&to={last}"))
        parts += [
            element("rect", x=STRIP_LEFT + CELL * n, y=y, width=CELL - 2, height=ROW - 3, class_="cell answer-none")
            for n in range(last.day)
        ]
    rows = {month: row for row, month in enumerate(months)}
    parts += [_cell(one, 22.0 + ROW * rows[one.day.year, one.day.month]) for one in days]
    return figure("calendar", (STRIP_LEFT + 31 * CELL, height), "Calendar of searched days by answer.", *parts)


def _cell(one: DayMark, y: float) -> str:
    x = STRIP_LEFT + CELL * (one.day.day - 1)
    box = element("rect", x=x, y=y, width=CELL - 2, height=ROW - 3, rx=3, class_=f"cell {_class(one.answer)}")
    said = str(one.localised) if one.localised else ANSWER_MARKS.get(one.answer, "")
    count = words(said, x + CELL / 2 - 1, y + 16, class_="count", text_anchor="middle")
    return element("a", element("title", one.said), box, count, href=one.address)


ANSWER_MARKS = {"no data": "\N{EM DASH}", "archive silent": "?", "not searchable": "\N{MULTIPLICATION SIGN}"}
"""So that colour is not the only difference; the others have a number, or none."""


def _class(answer: str) -> str:
    return f"answer-{answer.replace(' ', '-')}"


def strips_figure(days: Sequence[DayMark], onsets: Sequence[OnsetMark]) -> str:
    """Strip of 24 hours for each day, the newest on top, with the bursts of each, SVG.

    Parameters
    ----------
    days : sequence of DayMark
    onsets : sequence of OnsetMark

    Returns
    -------
    str
    """
    ordered = sorted(days, key=lambda one: one.day, reverse=True)
    across = Scale(0.0, DAY_S, STRIP_LEFT, WIDTH - RIGHT)
    height = 30.0 + ROW * len(ordered)
    parts = []
    for hour in range(0, 25, 3):
        x = float(across(hour * 3600.0))
        parts.append(line(x, 20, x, height - 6, class_="gridline"))
        parts.append(
            words(f"{hour:02d}:00", x, 14, class_="tick" if hour % 6 == 0 else "tick wide", text_anchor="middle")
        )
    rows = {one.day: 24.0 + ROW * row for row, one in enumerate(ordered)}
    for one in ordered:
        y, width = rows[one.day], across.end - across.start
        box = element("rect", x=across.start, y=y, width=width, height=ROW - 6, class_=f"strip {_class(one.answer)}")
        name = words(f"{one.day:%d %b %Y}", 0, y + 15, class_="month")
        parts.append(element("a", element("title", one.said), name, box, href=one.address))
    parts += [_onset(one, across, rows[one.start.date()]) for one in onsets if one.start.date() in rows]
    return figure("strips", (WIDTH, height), "Bursts of each day by the hour of their onset.", *parts)


def _onset(one: OnsetMark, across: Scale, y: float) -> str:
    x = float(across((one.start - datetime.combine(one.start.date(), datetime.min.time(), UTC)).total_seconds()))
    kind = "onset localised" if one.is_localised else "onset"
    mark = element("rect", x=x - 2.5, y=y - 1, width=5 if one.is_localised else 3, height=ROW - 4, class_=kind)
    return element("a", element("title", one.said), mark, href=one.address)

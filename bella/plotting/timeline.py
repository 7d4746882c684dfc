"""Searched days in time: calendars from years to days, and the hours of a few days with their bursts."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta

from bella.plotting.svg import Scale, element, figure, line, words
from bella.units import DAY_S

WIDTH, RIGHT = 1240.0, 22.0


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

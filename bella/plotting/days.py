"""Days: calendars from years to hours, and the spectra of all spacecraft on one day with what was found in them."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from bella.exceptions import NoDataError
from bella.flags import LOCALISABLE, REJECTED
from bella.plotting.geometry import require_columns
from bella.plotting.svg import (
    BRIGHTNESS,
    FREQUENCY_TICKS_MHZ,
    WEAK_STRETCH,
    Scale,
    element,
    figure,
    line,
    number,
    picture,
    time_of_day,
    unix_s,
    words,
)
from bella.spectra import over_background
from bella.units import DAY_S, FloatArray

PANE = re.compile(r'(<svg class="pane"[^>]* viewBox=")[\d.]+ ([\d.]+) [\d.]+ ([\d.]+)(?=")')
ONSET = re.compile(r'<text x="([\d.]+)"( y="[\d.]+" class="onset-label">[^<]*</text>)')
HOURS = re.compile(r'<g class="hours" data-top="([\d.]+)">.*?</g>')
"""What of the figure of a day depends on the part of it that is shown."""

BOX_COLUMNS = ("observatory", "start_utc", "end_utc", "f_low_mhz", "f_high_mhz", "score", "tier", "reason")
WIDTH, LEFT, RIGHT, PANEL, GAP, FOOT = 1240.0, 44.0, 20.0, 150.0, 26.0, 38.0
COLUMNS, ROWS = 720, 100
"""Of the picture of a day: two minutes wide, so that the page of four spacecraft stays below 200 kB."""

LOWEST_MHZ = 0.02
"""Bursts end above it; what receivers of plasma waves measure below would take a third of the height."""

MOST_BOXES = 300
"""More boxes than these on one spectrum cannot be chosen one by one, and hide it."""

ONSET_MARK = 8
"""Height of what stands for each of them."""

LEAST_HIGHEST_DB, MOST_HIGHEST_DB, BRIGHTEST_SHARE = 6.0, 25.0, 0.997
WIDEST_CHANNEL = 1.35
"""A channel reaches no farther than to this times, or one over this, its own frequency: bands apart stay apart."""

GAP_RECORDS = 0.75
"""A record reaches no farther than this many usual steps; what is between records farther apart stays grey."""


CELL, ROW, STRIP_LEFT, STRIP_RIGHT = 37.0, 26.0, 96.0, 22.0
ANSWER_MARKS = {"no data": "\N{EM DASH}", "archive silent": "?", "not searchable": "\N{MULTIPLICATION SIGN}"}
"""So that colour is not the only difference; the others have a number, or none."""


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


def calendar_figure(days: Sequence[DayMark]) -> str:
    """Calendar with a row for each month and a cell for each day, the newest month on top, SVG."""
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


def calendar_caption(first: date, last: date) -> str:
    """What a calendar or the hours of days show, for a file of its own."""
    return (
        f"Searched days from {first} to {last}. Filled with a number: localised bursts; framed: bursts, none of them "
        "localisable; empty: no burst; ?: archive silent; \N{MULTIPLICATION SIGN}: not searchable; \N{EM DASH}: no "
        "data. By the hour: wide bars are localised bursts, narrow ones others."
    )


def _cell(one: DayMark, y: float) -> str:
    x = STRIP_LEFT + CELL * (one.day.day - 1)
    box = element("rect", x=x, y=y, width=CELL - 2, height=ROW - 3, rx=3, class_=f"cell {_class(one.answer)}")
    said = str(one.localised) if one.localised else ANSWER_MARKS.get(one.answer, "")
    count = words(said, x + CELL / 2 - 1, y + 16, class_="count", text_anchor="middle")
    return element("a", element("title", one.said), box, count, href=one.address)


def _class(answer: str) -> str:
    return f"answer-{answer.replace(' ', '-')}"


def strips_figure(days: Sequence[DayMark], onsets: Sequence[OnsetMark]) -> str:
    """Strip of 24 hours for each day, the newest on top, with the bursts of each, SVG."""
    ordered = sorted(days, key=lambda one: one.day, reverse=True)
    across = Scale(0.0, DAY_S, STRIP_LEFT, WIDTH - STRIP_RIGHT)
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
    parts += [_onset_mark(one, across, rows[one.start.date()]) for one in onsets if one.start.date() in rows]
    return figure("strips", (WIDTH, height), "Bursts of each day by the hour of their onset.", *parts)


def _onset_mark(one: OnsetMark, across: Scale, y: float) -> str:
    x = float(across((one.start - datetime.combine(one.start.date(), datetime.min.time(), UTC)).total_seconds()))
    kind = "onset localised" if one.is_localised else "onset"
    mark = element("rect", x=x - 2.5, y=y - 1, width=5 if one.is_localised else 3, height=ROW - 4, class_=kind)
    return element("a", element("title", one.said), mark, href=one.address)


def day_figure(day: date, spectra: Sequence[xr.Dataset], detections: pd.DataFrame) -> str:
    """Spectra of a day with what was found outlined, SVG.

    Parameters
    ----------
    day : datetime.date
        UTC; what spectra hold of other days is not shown.
    spectra : sequence of xarray.Dataset
        Dynamic spectra, at least one, each of another spacecraft; shown is dB over their background, which is not
        taken away a second time from what :func:`bella.spectra.over_background` returned.
    detections : pandas.DataFrame
        Detection table, of which each box leads to its burst. What was rejected is dashed.

    Raises
    ------
    InputError
        If the quantity of a spectrum is not known, or the detection table lacks a column.
    NoDataError
        If no spectrum is of the day.
    """
    require_columns(detections, BOX_COLUMNS, "detection table")
    midnight = np.datetime64(day, "ns")
    until = midnight + np.timedelta64(1, "D")
    parts = [one.sel(time=slice(midnight, until - np.timedelta64(1, "ns"))) for one in spectra]
    shown = [one if "noise_db" in one else over_background(one) for one in parts if one.sizes["time"] > 1]
    if not shown:
        raise NoDataError(f"no spectrum has two records of {day}: there is nothing to draw")
    first, last = unix_s([midnight, until])
    time = Scale(float(first), float(last), LEFT, WIDTH - RIGHT)
    height = len(shown) * (PANEL + GAP) + FOOT
    tops = [GAP + row * (PANEL + GAP) for row in range(len(shown))]
    drawn = [part for over, top in zip(shown, tops, strict=True) for part in _panel(over, time, top, detections)]
    names = ", ".join(str(over.attrs["observatory"]) for over in shown)
    rejected = int((detections["tier"] == REJECTED).sum())
    counts = f"{len(detections) - rejected} detections and {rejected} rejected candidates"
    title = f"Dynamic spectra of {names} on {day} with {counts} outlined."
    return figure(
        "day",
        (WIDTH, height),
        title,
        *drawn,
        _hours(Scale(0.0, DAY_S, LEFT, WIDTH - RIGHT), height - FOOT),
        data_time=f"0,{DAY_S:g}",
        data_across=f"{LEFT:g},{WIDTH - RIGHT:g}",
        data_tops=",".join(f"{top:g}" for top in tops),
        data_height=f"{PANEL:g}",
        data_names=",".join(str(over.attrs["observatory"]) for over in shown),
    )


def zoomed_day(drawn: str, first_s: float, last_s: float) -> str:
    """A part of a day, of the figure of all of it.

    Parameters
    ----------
    drawn : str
        As :func:`day_figure` returned it.
    first_s, last_s : float
        Seconds after midnight, the first one earlier.
    """
    whole, part = (Scale(*ends, LEFT, WIDTH - RIGHT) for ends in ((0.0, DAY_S), (first_s, last_s)))
    left, right = (float(whole(one)) for one in (first_s, last_s))

    def _moved(label: re.Match[str]) -> str:
        moment = (float(label[1]) - whole.start) / (whole.end - whole.start) * DAY_S
        return f'<text x="{number(float(part(moment)))}"{label[2]}' if part.holds(moment) else ""

    shown = PANE.sub(rf"\g<1>{number(left)} \g<2> {number(right - left)} \g<3>", drawn)
    shown = ONSET.sub(_moved, shown)
    shown = HOURS.sub(lambda found: _hours(part, float(found[1])), shown)
    return shown.replace(f'data-time="0,{DAY_S:g}"', f'data-time="{first_s:g},{last_s:g}"')


def day_caption(day: date) -> str:
    """What the figure of a day shows, for a file of its own."""
    return (
        f"Dynamic spectra of {day}, dB over the background; grey: no data. Outlined: what was found. Green: localised, "
        "blue: other bursts, dashed: rejected."
    )


def _panel(over: xr.Dataset, time: Scale, top: float, detections: pd.DataFrame) -> Iterator[str]:
    known = over.isel(frequency=~over["interpolated"].to_numpy().astype(bool)) if "interpolated" in over else over
    frequency = known["frequency"].to_numpy().astype(np.float64)
    low = max(float(frequency.min()) / 1.05, min(LOWEST_MHZ, 0.5 * float(frequency.max())))
    scale = Scale(low, float(frequency.max()) * 1.05, top + PANEL, top, is_log=True)
    box = {"x": time.start, "y": top, "width": time.end - time.start, "height": PANEL}
    yield element("rect", **box, class_="no-data")
    name = str(over.attrs["observatory"])
    own = [
        {str(key): value for key, value in row.items()}
        for row in detections[detections["observatory"] == name].to_dict("records")
    ]
    yield element(
        "svg",
        picture(_shares(known, time, scale), BRIGHTNESS, WEAK_STRETCH, **box),
        *(_onsets_together(own, time, scale) if len(own) > MOST_BOXES else (_box(row, time, scale) for row in own)),
        class_="pane",
        **box,
        viewBox=" ".join(number(one) for one in box.values()),
        preserveAspectRatio="none",
    )
    if len(own) <= MOST_BOXES:
        yield from (_onset_label(row, time, scale) for row in own if str(row["tier"]) == LOCALISABLE)
    for tick in scale.among(FREQUENCY_TICKS_MHZ):
        y = float(scale(tick))
        yield line(time.start - 4, y, time.start, y, class_="axis")
        yield words(f"{tick:g}", time.start - 7, y + 4, class_="tick", text_anchor="end")
    yield words(name, time.start, top - 7, class_="panel-name")
    receiver = f"MHz · {over.attrs.get('receiver', '')}, {over.sizes['frequency']} channels"
    yield words(receiver, time.end, top - 7, class_="panel-unit", text_anchor="end")


def _onsets_together(rows: Sequence[dict[str, Any]], time: Scale, scale: Scale) -> Iterator[str]:
    """Onsets of more detections than anybody can choose between, at the top: a path for each kind."""
    drawn: dict[str, list[str]] = {}
    for row in rows:
        if (corners := _corners(row, time, scale)) is not None:
            drawn.setdefault(_kind(str(row["tier"])), []).append(
                f"M{number(corners[0])} {number(scale.end)}v{ONSET_MARK}"
            )
    for kind, some in drawn.items():
        yield element("path", d="".join(some), class_=f"box {kind}")


def _shares(over: xr.Dataset, time: Scale, scale: Scale) -> FloatArray:
    """Means of the records in each column of the picture, from 0 to the brightest; NaN where there is no data."""
    seconds, frequency = unix_s(over["time"].to_numpy()), over["frequency"].to_numpy().astype(np.float64)
    values = over["intensity"].transpose("frequency", "time").to_numpy().astype(np.float64)
    finite = values[np.isfinite(values)]
    brightest = float(np.quantile(finite, BRIGHTEST_SHARE)) if finite.size else 0.0
    highest = min(max(brightest, LEAST_HIGHEST_DB), MOST_HIGHEST_DB)
    rows = np.geomspace(scale.high, scale.low, ROWS)
    channel = np.abs(np.log(frequency[None, :] / rows[:, None])).argmin(axis=1)
    shown = values[channel]
    steps = np.diff(np.log(frequency))
    widest = min(float(steps.max()) if steps.size else 0.0, np.log(WIDEST_CHANNEL))
    shown[np.abs(np.log(frequency[channel] / rows)) > max(widest, 0.03), :] = np.nan
    column_s = DAY_S / COLUMNS
    record_s = float(np.median(np.diff(seconds)))
    if record_s >= column_s:
        columns = time.low + (np.arange(COLUMNS) + 0.5) * column_s
        near = np.abs(seconds[None, :] - columns[:, None]).argmin(axis=1)
        picked = shown[:, near]
        picked[:, np.abs(seconds[near] - columns) > GAP_RECORDS * record_s] = np.nan
    else:
        place = np.clip(((seconds - time.low) / column_s).astype(int), 0, COLUMNS - 1)
        total, count = np.zeros((2, ROWS, COLUMNS))
        known = np.isfinite(shown)
        np.add.at(total.T, place, np.where(known, shown, 0.0).T)
        np.add.at(count.T, place, known.T.astype(float))
        picked = np.where(count > 0, total / np.maximum(count, 1.0), np.nan)
    return np.asarray(picked / highest)


def _corners(row: dict[str, Any], time: Scale, scale: Scale) -> tuple[float, float, float, float] | None:
    """Left, top, right and bottom of the box of a detection; None where it is not on the day."""
    ends = np.clip(time(unix_s([row["start_utc"], row["end_utc"]])), time.start, time.end)
    if ends[1] <= ends[0]:
        return None
    low, high = (float(scale(row[name])) for name in ("f_low_mhz", "f_high_mhz"))
    return float(ends[0]), max(high - 2, scale.end), float(ends[1]), min(low + 2, scale.start)


def _kind(tier: str) -> str:
    return "localised" if tier == LOCALISABLE else "rejected" if tier == REJECTED else "burst"


def _onset(row: dict[str, Any]) -> str:
    return time_of_day(float(unix_s([row["start_utc"]])[0]))


def _onset_label(row: dict[str, Any], time: Scale, scale: Scale) -> str:
    """Onset of a detection above its box; nothing where that is not on the day."""
    corners = _corners(row, time, scale)
    return "" if corners is None else words(_onset(row), corners[0], scale.end - 3, class_="onset-label")


def _box(row: dict[str, Any], time: Scale, scale: Scale) -> str:
    """Outline of a detection, which leads to its burst; nothing where it is not on the day."""
    corners = _corners(row, time, scale)
    if corners is None:
        return ""
    left, top, right, bottom = corners
    tier = str(row["tier"])
    burst = str(row.get("burst_id") or "")
    said = f"{_onset(row)} {burst} {'no burst' if tier == REJECTED else tier} {row['reason']}".replace("_", " ").strip()
    shape = element("rect", x=left, y=top, width=right - left, height=bottom - top, class_=f"box {_kind(tier)}")
    inside = [element("title", said), shape]
    return element("a", *inside, href=f"#{burst}") if burst else element("g", *inside)


def _hours(time: Scale, top: float) -> str:
    """Axis of the time of day, seconds after midnight."""
    parts = []
    ticks = time.time_ticks(13)
    step_s = ticks[1] - ticks[0] if len(ticks) > 1 else 60.0
    for index, tick in enumerate(ticks):
        x = float(time(tick))
        parts.append(line(x, top, x, top + 5, class_="axis"))
        said, kind = "24:00" if tick == DAY_S else time_of_day(tick, step_s), "tick" if index % 3 == 0 else "tick wide"
        parts.append(words(said, x, top + 19, class_=kind, text_anchor="middle"))
    return element("g", *parts, class_="hours", data_top=number(top))

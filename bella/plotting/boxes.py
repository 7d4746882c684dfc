"""Boxes around the bursts that were found in a spectrum, with labels above it that keep clear of one another.

Labels stand outside the spectrum, so that none hides a burst, and a thin line leads from each to its box.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.text import Annotation
from scipy.optimize import isotonic_regression

from bella.flags import CATALOGUED, LOCALISABLE, REJECTED
from bella.plotting.printed import day_numbers, require_columns
from bella.units import FloatArray

BOX_COLUMNS = ("observatory", "start_utc", "end_utc", "f_low_mhz", "f_high_mhz", "score", "tier", "reason")

ROOM_SHARE, ROOM_BAND_SHARE = 0.003, 0.012
"""Between a burst and its box, as shares of the time and of the logarithm of the band that are shown."""

LABEL_LIFT_POINTS, LABEL_GAP_POINTS, UPRIGHT_GAP_POINTS = 13.0, 6.0, 1.5
REASON_CHARACTERS = 15
REASON_NAMES = {
    "few_channels_above_0.8_mhz": "few channels above 0.8 MHz",
    "no_drift": "no drift",
    "group": "group",
    "gap_in_flank": "gap in flank",
}

LineStyle = str | tuple[float, tuple[float, float]]


@dataclass(frozen=True)
class BoxStyle:
    """How boxes of a tier, and their labels, are drawn; widths and sizes in points."""

    outline: str
    text: str
    line: LineStyle
    width: float
    size: float


TIER_NAMES = {LOCALISABLE: "burst, localisable", CATALOGUED: "burst", REJECTED: "no burst"}
BOX_STYLES = {
    LOCALISABLE: BoxStyle("#7dffb0", "#0b6b3a", "-", 1.4, 7.5),
    CATALOGUED: BoxStyle("#5fe3f2", "#0a6377", "-", 1.1, 7.5),
    REJECTED: BoxStyle("#c3cad1", "#7b858e", (0.0, (3.0, 2.0)), 0.7, 5.8),
}
"""Outlines are hues that the colours of brightness do not have; labels are the same, dark enough for white paper."""


def shown_detections(detections: pd.DataFrame, over: xr.Dataset) -> pd.DataFrame:
    """Detections at the spacecraft of a spectrum, within its time.

    Parameters
    ----------
    detections : pandas.DataFrame
        Has `BOX_COLUMNS`; may hold other spacecraft and days.
    over : xarray.Dataset
        A dynamic spectrum.

    Returns
    -------
    pandas.DataFrame
        In order of time, with an index that counts from 0.

    Raises
    ------
    InputError
        If a column is missing.
    """
    table = require_columns(detections, BOX_COLUMNS, "detection table")
    first, last = over["time"].to_numpy()[[0, -1]]
    start, end = (pd.to_datetime(table[name]) for name in ("start_utc", "end_utc"))
    kept = (table["observatory"] == over.attrs["observatory"]) & (end >= first) & (start <= last)
    return pd.DataFrame(table[kept].sort_values("start_utc", kind="stable").reset_index(drop=True))


def draw_boxes(axes: Axes, detections: pd.DataFrame) -> list[Annotation]:
    """Outline every detection on a spectrum whose limits are set, and label it above.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Time across, frequency in MHz upwards on a logarithmic scale.
    detections : pandas.DataFrame
        As :func:`shown_detections` returns it.

    Returns
    -------
    list of Annotation
        Labels, one per detection, each above its own box: :func:`part_labels` moves them apart.
    """
    return [_draw_box(axes, row) for _, row in detections.iterrows()]


def explain_boxes(axes: Axes, detections: pd.DataFrame, drop_share: float = 0.075) -> None:
    """Say below the right end of the time axis what the outlines mean, of those that there are.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    detections : pandas.DataFrame
        As drawn.
    drop_share : float
        How far below the axis, as a share of the height of the spectrum.
    """
    handles = [
        Line2D([], [], color=style.text, ls=style.line, lw=style.width, label=TIER_NAMES[tier])
        for tier, style in BOX_STYLES.items()
        if (detections["tier"] == tier).any()
    ]
    axes.legend(
        handles=handles,
        loc="upper right",
        bbox_to_anchor=(1.0, -drop_share),
        ncols=max(len(handles), 1),
        fontsize=7.5,
        frameon=False,
        borderaxespad=0.0,
        labelcolor="linecolor",
    )


def _draw_box(axes: Axes, row: pd.Series) -> Annotation:
    style = BOX_STYLES.get(str(row["tier"]), BOX_STYLES[CATALOGUED])
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    room, ratio = ROOM_SHARE * (right - left), (high / low) ** ROOM_BAND_SHARE
    start, end = np.clip(day_numbers([row["start_utc"], row["end_utc"]]) + np.array([-room, room]), left, right)
    bottom, top = max(row["f_low_mhz"] / ratio, low), min(row["f_high_mhz"] * ratio, high)
    outline = Rectangle((start, bottom), end - start, top - bottom, fill=False, ec=style.outline, ls=style.line)
    outline.set(lw=style.width, zorder=3 if row["tier"] == REJECTED else 4)
    axes.add_patch(outline)
    axes.add_line(Line2D([start, start], [top, high], color=style.outline, lw=0.5, alpha=0.6, zorder=3))
    return _label(axes, row, start, style)


def _label(axes: Axes, row: pd.Series, onset: float, style: BoxStyle) -> Annotation:
    return axes.annotate(
        _words(row),
        (onset, 1.0),
        xycoords=axes.get_xaxis_transform(),
        xytext=(0.0, LABEL_LIFT_POINTS),
        textcoords="offset points",
        ha="center",
        va="bottom",
        fontsize=style.size,
        linespacing=1.05,
        color=style.text,
        arrowprops={"arrowstyle": "-", "lw": 0.5, "color": style.text, "shrinkA": 0, "shrinkB": 0, "relpos": (0.5, 0)},
        annotation_clip=False,
    )


def _words(row: pd.Series) -> str:
    """Onset of a burst; of what is none also why."""
    moment = f"{pd.Timestamp(row['start_utc']):%H:%M}"
    if row["tier"] != REJECTED or not row["reason"]:
        return moment
    reason = REASON_NAMES.get(str(row["reason"]), str(row["reason"]).replace("_", " "))
    return f"{fill(reason, REASON_CHARACTERS)}\n{moment}"


def part_labels(axes: Axes, labels: Sequence[Annotation], detections: pd.DataFrame) -> float:
    """Move labels apart along the top of a spectrum; turn them upright if there are many, and hide the least.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Of a figure whose layout is final across.
    labels : sequence of Annotation
        In order of time, at least one.
    detections : pandas.DataFrame
        What is labelled: where not all find a place, what is no burst goes first, then the lowest scores.

    Returns
    -------
    float
        How high labels reach above the spectrum, points.
    """
    box, inches = axes.get_window_extent(), 72.0 / axes.figure.dpi
    room, gap = box.width * inches, LABEL_GAP_POINTS
    if (_extents(labels)[:, 0] + gap).sum() > room:
        gap = UPRIGHT_GAP_POINTS
        labels = _upright(labels, detections, room)
    extents = _extents(labels)
    wanted = np.array([(axes.transData.transform((label.xy[0], 1.0))[0] - box.x0) * inches for label in labels])
    for label, place, want in zip(labels, spread(wanted, extents[:, 0] + gap, room), wanted, strict=True):
        label.set_position((place - want, LABEL_LIFT_POINTS))
    return LABEL_LIFT_POINTS + float(extents[:, 1].max())


def _upright(labels: Sequence[Annotation], detections: pd.DataFrame, room: float) -> list[Annotation]:
    """Labels that have room side by side when turned upright; the others become invisible."""
    for label in labels:
        label.set(rotation=90, text=_in_one_line(label.get_text()))
    width = _extents(labels)[:, 0] + UPRIGHT_GAP_POINTS
    order = np.lexsort((-detections["score"].to_numpy(), detections["tier"].to_numpy() == REJECTED))
    kept = set(order[np.cumsum(width[order]) <= room].tolist())
    for index, label in enumerate(labels):
        label.set_visible(index in kept)
    return [label for index, label in enumerate(labels) if index in kept]


def _in_one_line(words: str) -> str:
    *reason, moment = words.split("\n")
    return " ".join([moment, *reason])


def _extents(labels: Sequence[Annotation]) -> FloatArray:
    """Width and height of the words of labels, points, shape (N, 2)."""
    boxes = [super(Annotation, label).get_window_extent() for label in labels]
    return np.array([(box.width, box.height) for box in boxes]) * 72.0 / labels[0].figure.dpi


def spread(wanted: FloatArray, width: FloatArray, room: float) -> FloatArray:
    """Places nearest to those wanted, in the same order, at which nothing overlaps.

    Parameters
    ----------
    wanted : ndarray, shape (N,)
        Middles, ascending.
    width : ndarray, shape (N,)
        With the gap to the next; together no more than the room.
    room : float
        Everything stays between 0 and this.

    Returns
    -------
    ndarray, shape (N,)
        Middles of least squared distance from those wanted.
    """
    offset = np.concatenate([[0.0], np.cumsum(0.5 * (width[1:] + width[:-1]))])
    lowest, highest = 0.5 * width[0], room - 0.5 * width[-1] - offset[-1]
    level = isotonic_regression(wanted - offset).x
    return np.asarray(np.clip(level, lowest, max(lowest, highest)) + offset)

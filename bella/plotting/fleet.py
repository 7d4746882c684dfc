"""One day as all spacecraft heard it: their spectra one above the other on one axis of UTC, with what was found."""

from collections.abc import Sequence
from datetime import date
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bella.exceptions import NoDataError
from bella.plotting.boxes import draw_boxes, explain_boxes, part_labels, shown_detections
from bella.plotting.day import (
    NO_DATA,
    POINTS_PER_INCH,
    TITLE_LIFT_POINTS,
    draw_intensity,
    intensity_bar,
    thinned,
    time_axis,
    write_title,
)
from bella.plotting.palette import BRIGHTNESS_SCALE
from bella.plotting.printed import save_png
from bella.spectra import over_background

WIDTH_INCHES, PANEL_INCHES, FOOT_INCHES = 11.0, 2.3, 0.5
SHOWN_RECORDS = 1440
"""As many as the page has columns for them."""

LOWEST_MHZ = 0.02
"""Bursts end above it; what receivers of plasma waves measure below would take a third of the height."""

LEGEND_DROP = 0.17
COLOURS = 256
"""Enough for a scale of brightness; the file is less than half the size."""


def write_day_png(path: Path, day: date, spectra: Sequence[xr.Dataset], detections: pd.DataFrame) -> None:
    """Write the spectra of a day as a PNG, with what was found outlined; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    day : datetime.date
        UTC; what spectra hold of other days is not shown.
    spectra : sequence of xarray.Dataset
        Dynamic spectra, at least one, each of another spacecraft; shown is dB over their background, which is not
        taken away a second time from what :func:`bella.spectra.over_background` returned.
    detections : pandas.DataFrame
        Detection table. What was rejected is dashed, with its reason.

    Raises
    ------
    InputError
        If the quantity of a spectrum is not known, or the detection table lacks a column.
    NoDataError
        If no spectrum is of the day.
    """
    midnight = np.datetime64(day, "ns")
    until = midnight + np.timedelta64(1, "D")
    parts = [_within(one, midnight, until) for one in spectra]
    shown = [thinned(_over(one), SHOWN_RECORDS) for one in parts if one.sizes["time"] > 1]
    if not shown:
        raise NoDataError(f"no spectrum has two records of {day}: there is nothing to draw")
    figure = Figure(figsize=(WIDTH_INCHES, PANEL_INCHES * len(shown) + FOOT_INCHES), layout="constrained")
    rows = figure.subplots(len(shown), 1, squeeze=False)[:, 0]
    for axes, over in zip(rows, shown, strict=True):
        _draw_spectrum(figure, axes, over)
        axes.set_xlim(midnight, until)
        axes.tick_params(labelbottom=axes is rows[-1])
    rows[-1].set_xlabel("UTC")
    _outline(figure, list(rows), [(over, shown_detections(detections, over)) for over in shown])
    save_png(figure, path, colours=COLOURS)


def _within(spectrum: xr.Dataset, start: np.datetime64, stop: np.datetime64) -> xr.Dataset:
    return spectrum.sel(time=slice(start, stop - np.timedelta64(1, "ns")))


def _over(spectrum: xr.Dataset) -> xr.Dataset:
    return spectrum if "noise_db" in spectrum else over_background(spectrum)


def _draw_spectrum(figure: Figure, axes: Axes, over: xr.Dataset) -> None:
    axes.set_facecolor(NO_DATA)
    mesh = draw_intensity(axes, over, BRIGHTNESS_SCALE)
    intensity_bar(figure, axes, mesh, aspect=14).set_label("dB over background", fontsize=8)
    time_axis(axes)
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, min(LOWEST_MHZ, 0.5 * high)), high)


def _outline(figure: Figure, rows: Sequence[Axes], found: Sequence[tuple[xr.Dataset, pd.DataFrame]]) -> None:
    """Draw boxes, their labels and the titles above them; the figure grows by what the labels need."""
    labels = [draw_boxes(axes, table) for axes, (_, table) in zip(rows, found, strict=True)]
    explain_boxes(rows[-1], pd.concat([table for _, table in found], ignore_index=True), LEGEND_DROP)
    figure.draw_without_rendering()  # only now is it known how wide the spectra are, and what room labels have
    grown_points = 0.0
    for axes, own, (over, table) in zip(rows, labels, found, strict=True):
        height = part_labels(axes, own, table) if own else 0.0
        write_title(axes, over, TITLE_LIFT_POINTS + height)
        grown_points += height
    figure.set_figheight(figure.get_figheight() + grown_points / POINTS_PER_INCH)

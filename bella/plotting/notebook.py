"""Small drawings for a notebook: arrival times, detections, positions and a track, on axes of matplotlib."""

from typing import Any

import matplotlib.dates as mdates
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.patches import Rectangle

from bella.records import JointTrack

ECLIPTIC = ("x, HEE [solar radii], to Earth", "y, HEE [solar radii], west")


def draw_arrivals(frame: pd.DataFrame, ax: Any = None) -> Any:
    """Frequency against arrival time with its error, one line per spacecraft."""
    axes = _axes(ax)
    for name, rows in frame.groupby("observatory", sort=False):
        ordered = rows.sort_values("frequency_mhz")
        days = _days(ordered["arrival_utc"])
        axes.errorbar(days, ordered["frequency_mhz"], xerr=ordered["sigma_s"] / 86_400, fmt=".-", label=str(name))
    _time_axis(axes)
    axes.legend()
    return axes


def draw_detections(frame: pd.DataFrame, ax: Any = None) -> Any:
    """Box of each detection, one colour per spacecraft."""
    axes = _axes(ax)
    for number, (name, rows) in enumerate(frame.groupby("observatory", sort=False)):
        days = [_days(rows[column]) for column in ("start_utc", "end_utc")]
        band = [rows[column].to_numpy(dtype=float) for column in ("f_low_mhz", "f_high_mhz")]
        for place, (begin, end, low, high) in enumerate(zip(*days, *band, strict=True)):
            label = str(name) if place == 0 else None
            box = Rectangle((begin, low), end - begin, high - low, fill=False, edgecolor=f"C{number}", label=label)
            axes.add_patch(box)
    axes.autoscale_view()
    _time_axis(axes)
    if len(frame):
        axes.legend()
    return axes


def draw_positions(posterior: xr.Dataset, ax: Any = None) -> Any:
    """Mean positions by frequency, outlines of the 68 % regions, and the receivers."""
    axes = _axes(ax)
    for outline in posterior["region68"].to_numpy():
        axes.plot(*outline.T, color="0.7", linewidth=0.8)
    shown = axes.scatter(posterior["x_rsun"], posterior["y_rsun"], c=posterior["frequency"], zorder=3)
    axes.figure.colorbar(shown, ax=axes, label="frequency [MHz]")
    for place, name in enumerate(posterior["observatory"].to_numpy()):
        x, y, _ = np.nanmean(posterior["receiver_rsun"].to_numpy()[:, place], axis=0)
        axes.plot(x, y, "k^")
        axes.annotate(str(name), (x, y), textcoords="offset points", xytext=(5, 5))
    return _ecliptic(axes)


def draw_track(record: JointTrack, ax: Any = None) -> Any:
    """Median sources of the profile of a track."""
    axes = _axes(ax)
    places = np.array(
        [(one.range_rsun.q50, one.longitude_deg.q50, one.frequency_mhz) for one in record.profile], dtype=float
    ).reshape(-1, 3)
    angle = np.radians(places[:, 1])
    shown = axes.scatter(places[:, 0] * np.cos(angle), places[:, 0] * np.sin(angle), c=places[:, 2])
    axes.figure.colorbar(shown, ax=axes, label="frequency [MHz]")
    return _ecliptic(axes)


def _days(times: pd.Series) -> Any:
    """Times as matplotlib counts them."""
    return mdates.date2num(times.to_numpy())  # type: ignore[no-untyped-call]


def _axes(ax: Any) -> Any:
    return plt.subplots()[1] if ax is None else ax


def _ecliptic(axes: Any) -> Any:
    axes.plot(0, 0, "o", color="gold", markersize=10)
    axes.margins(0.15)  # room for the names of the spacecraft
    axes.set(xlabel=ECLIPTIC[0], ylabel=ECLIPTIC[1], aspect="equal")
    return axes


def _time_axis(axes: Any) -> None:
    axes.xaxis_date()
    axes.set(xlabel="UTC", ylabel="frequency [MHz]", yscale="log")

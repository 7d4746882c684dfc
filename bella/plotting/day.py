"""One dynamic spectrum as a PNG: what a spacecraft received, in dB over the background, as for a look at a day."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colorbar import Colorbar
from matplotlib.colors import LinearSegmentedColormap, PowerNorm
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullFormatter

from bella.plotting.boxes import draw_boxes, explain_boxes, part_labels, shown_detections
from bella.plotting.palette import BRIGHTNESS_SCALE, FREQUENCY_TICKS_MHZ
from bella.plotting.printed import save_png
from bella.spectra import over_background
from bella.units import FloatArray

MOST_RECORDS = 2880
GAP_RECORDS = 1.5
"""A record reaches no farther than this many usual steps; what is between records farther apart stays grey."""

WIDEST_CHANNEL = 1.35
"""A channel reaches no farther than to this times, or one over this, its own frequency: bands apart stay apart."""

WEAK_STRETCH = 0.6
"""Exponent of the colour scale: below one, weak bursts stand out from the quiet sky."""

LOW_TICKS_MHZ = (0.003, 0.005, 0.01)
HOURS = ("%Y", "%b", "%d %b", "%H:%M", "%H:%M", "%H:%M:%S")
LEAST_HIGHEST_DB, MOST_HIGHEST_DB = 6.0, 25.0
BRIGHTEST_SHARE = 0.997
NO_DATA = "#aab3bb"
TITLE_LIFT_POINTS = 6.0
POINTS_PER_INCH = 72.0


def write_spectrum_png(path: Path, spectrum: xr.Dataset, detections: pd.DataFrame | None = None) -> None:
    """Write the dynamic spectrum of one spacecraft as a PNG; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    spectrum : xarray.Dataset
        A dynamic spectrum of any quantity; shown is dB over its background. Channels that were not measured are left
        out, and gaps are grey.
    detections : pandas.DataFrame or None
        Detection table: what it holds of this spacecraft and time is outlined, with its onset above; what was rejected
        is dashed, with its reason.

    Raises
    ------
    InputError
        If the quantity of the spectrum is not known, or the detection table lacks a column.
    """
    save_png(_day_figure(spectrum, detections), path)


def _day_figure(spectrum: xr.Dataset, detections: pd.DataFrame | None) -> Figure:
    over = thinned(over_background(spectrum))
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    axes = figure.add_subplot(facecolor=NO_DATA)
    mesh = draw_intensity(axes, over, BRIGHTNESS_SCALE)
    intensity_bar(figure, axes, mesh, aspect=28).set_label("dB over background")
    time_axis(axes)
    axes.set_xlabel("UTC")
    height = 0.0 if detections is None else _outline(figure, axes, shown_detections(detections, over))
    write_title(axes, over, TITLE_LIFT_POINTS + height)
    figure.set_figheight(figure.get_figheight() + height / POINTS_PER_INCH)
    return figure


def _outline(figure: Figure, axes: Axes, detections: pd.DataFrame) -> float:
    """Draw boxes, and say how high their labels reach above the spectrum, points."""
    if detections.empty:
        return 0.0
    labels = draw_boxes(axes, detections)
    explain_boxes(axes, detections)
    figure.draw_without_rendering()  # only now is it known how wide the spectrum is, and what room labels have
    return part_labels(axes, labels, detections)


def draw_intensity(axes: Axes, over: xr.Dataset, scale: Sequence[tuple[float, str]]) -> QuadMesh:
    """Draw a spectrum in dB over its background: cells as far as their channels and records reach, gaps left empty.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Its frequency axis becomes logarithmic, with the limits of the channels.
    over : xarray.Dataset
        As :func:`bella.spectra.over_background` returns it.
    scale : sequence of (float, str)
        Colours from 0 to the brightest.

    Returns
    -------
    matplotlib.collections.QuadMesh
    """
    intensity = over["intensity"].transpose("frequency", "time").to_numpy().astype(np.float64)
    frequency_edges, intensity = _cells(*_channel_limits(over["frequency"].to_numpy().astype(np.float64)), intensity)
    time_edges, across = _cells(*_record_limits(over["time"].to_numpy()), intensity.T)
    mesh = axes.pcolormesh(
        time_edges.astype("datetime64[ns]"),
        frequency_edges,
        across.T,
        cmap=LinearSegmentedColormap.from_list("brightness", scale),
        norm=PowerNorm(WEAK_STRETCH, 0.0, _highest_db(intensity), clip=True),
        rasterized=True,
    )
    frequency_axis(axes, (float(frequency_edges[0]), float(frequency_edges[-1])))
    return mesh


def intensity_bar(figure: Figure, axes: Axes, mesh: QuadMesh, aspect: float) -> Colorbar:
    """Colour bar of a spectrum beside its axes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    axes : matplotlib.axes.Axes
    mesh : matplotlib.collections.QuadMesh
        As :func:`draw_intensity` returns it.
    aspect : float
        Length over width.

    Returns
    -------
    matplotlib.colorbar.Colorbar
        Without a label.
    """
    _, highest = mesh.get_clim()
    # a scale that clips would write what is above its end upon that end
    ticks = [float(tick) for tick in MaxNLocator(5).tick_values(0.0, highest) if 0.0 <= tick <= highest]
    return figure.colorbar(mesh, ax=axes, pad=0.01, aspect=aspect, extend="max", ticks=ticks)


def frequency_axis(axes: Axes, band: tuple[float, float]) -> None:
    """Make the vertical axis one of frequency.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    band : (float, float)
        MHz.
    """
    axes.set_yscale("log")
    axes.set_ylim(band)
    ticks = [tick for tick in (*LOW_TICKS_MHZ, *FREQUENCY_TICKS_MHZ) if band[0] <= tick <= band[1]]
    axes.yaxis.set_major_locator(FixedLocator(ticks))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_ylabel("Frequency (MHz)")


def time_axis(axes: Axes, *, most_ticks: int = 13) -> None:
    """Make the horizontal axis one of hours and minutes, without the day.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    most_ticks : int
    """
    locator = AutoDateLocator(minticks=min(6, most_ticks // 2), maxticks=most_ticks)  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    hours = ConciseDateFormatter(  # type: ignore[no-untyped-call]
        locator, formats=HOURS, zero_formats=HOURS, show_offset=False
    )
    axes.xaxis.set_major_formatter(hours)


def thinned(over: xr.Dataset, most_records: int = MOST_RECORDS) -> xr.Dataset:
    """What was measured, in no more records than can be told apart on paper.

    Parameters
    ----------
    over : xarray.Dataset
        A dynamic spectrum.
    most_records : int

    Returns
    -------
    xarray.Dataset
        Its intensity, without interpolated channels; means where records are too many.
    """
    kept = over[["intensity"]]
    if "interpolated" in over:
        kept = kept.isel(frequency=~over["interpolated"].to_numpy().astype(bool))
    together = -(-kept.sizes["time"] // most_records)
    fewer = kept if together == 1 else kept.coarsen(time=together, boundary="pad").mean()
    return fewer.assign_attrs(over.attrs)


def _channel_limits(frequency_mhz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where channels begin and end, MHz: half-way to the neighbour, and as far on the side without one."""
    ratio = np.sqrt(frequency_mhz[1:] / frequency_mhz[:-1]) if frequency_mhz.size > 1 else np.array([WIDEST_CHANNEL])
    down, up = np.append(ratio[0], ratio), np.append(ratio, ratio[-1])
    if frequency_mhz.size == 1:
        down = up = ratio
    return frequency_mhz / np.minimum(down, WIDEST_CHANNEL), frequency_mhz * np.minimum(up, WIDEST_CHANNEL)


def _record_limits(time: npt.NDArray[np.datetime64]) -> tuple[FloatArray, FloatArray]:
    """Where records begin and end, ns."""
    centre_ns = time.astype("datetime64[ns]").astype(np.int64).astype(np.float64)
    reach_ns = 0.5 * GAP_RECORDS * np.median(np.diff(centre_ns))
    between = 0.5 * (centre_ns[:-1] + centre_ns[1:])
    lower = np.maximum(np.concatenate([[-np.inf], between]), centre_ns - reach_ns)
    return lower, np.minimum(np.concatenate([between, [np.inf]]), centre_ns + reach_ns)


def _cells(lower: FloatArray, upper: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Edges of cells that fill the axis, and their values: an empty cell where there is a gap along the first axis."""
    before_gap = np.flatnonzero(lower[1:] - upper[:-1] > 1e-6 * (upper - lower)[1:])
    edges = np.sort(np.concatenate([lower, upper[before_gap], upper[-1:]]))
    return edges, np.insert(values, before_gap + 1, np.nan, axis=0)


def _highest_db(intensity: FloatArray) -> float:
    finite = intensity[np.isfinite(intensity)]
    brightest = float(np.quantile(finite, BRIGHTEST_SHARE)) if finite.size else 0.0
    return min(max(brightest, LEAST_HIGHEST_DB), MOST_HIGHEST_DB)


def shown_day(time: npt.NDArray[np.datetime64]) -> str:
    """Day of a time axis, or its first and last.

    Parameters
    ----------
    time : ndarray of datetime64, shape (T,)

    Returns
    -------
    str
        Such as "2010-01-17".
    """
    first, last = (str(moment.astype("datetime64[D]")) for moment in time[[0, -1]])
    return first if first == last else f"{first} to {last}"


def write_title(axes: Axes, over: xr.Dataset, lift_points: float) -> None:
    """Write above a spectrum whose it is, and how fine.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    over : xarray.Dataset
        A dynamic spectrum.
    lift_points : float
        Room between the two.
    """
    name = f"{over.attrs['observatory']}  {over.attrs['receiver']}  {shown_day(over['time'].to_numpy())}"
    axes.set_title(name, loc="left", fontsize=11, pad=lift_points)
    channels = f"{over.sizes['frequency']} channels, {float(over.attrs['integration_s']):g} s"
    axes.set_title(channels, loc="right", fontsize=8, color="0.4", pad=lift_points)

"""The figures as PNG files, drawn with matplotlib for papers and for places without a browser."""

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.dates import DateFormatter
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator
from PIL import Image

from bella.flags import APPARENT_SOURCE
from bella.plotting.constellation import REGIONS_PER_TRACK, RINGS_AU
from bella.plotting.geometry import (
    SPIRAL_POINTS,
    TrackView,
    fitted_spiral,
    polar_track,
    receiver_positions,
    region_outline,
    spread_indices,
)
from bella.plotting.palette import (
    FREQUENCY_TICKS_MHZ,
    INTENSITY_SCALE,
    SPACECRAFT,
    SUN,
    TrackStyle,
    edge_name,
    track_style,
)
from bella.plotting.spectra import QUANTITY_NAMES, Panel, burst_panels, shown_band, timed_edges
from bella.plotting.spiral_band import PERCENTS, SpiralBand, band_outline, spiral_band
from bella.units import AU_RSUN

DOTS_PER_INCH = 160


def write_constellation_png(path: Path, tracks: Sequence[TrackView]) -> None:
    """Write the constellation as a PNG; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    tracks : sequence of TrackView
    """
    figure = Figure(figsize=(7.2, 7.6), layout="constrained")
    axes = figure.add_subplot()
    channels = np.concatenate([track.posterior["frequency"].to_numpy() for track in tracks] or [np.array([0.1, 1.0])])
    norm = LogNorm(float(channels.min()), float(channels.max()))
    _draw_surroundings(axes, tracks)
    for index, track in enumerate(tracks):
        _draw_track(axes, track, track_style(track.edge, index), norm)
    _finish_constellation(figure, axes, norm)
    save_png(figure, path)


def write_spectra_png(path: Path, spectra: xr.DataTree, arrivals: Mapping[str, pd.DataFrame | xr.Dataset]) -> None:
    """Write the spectra of a burst as a PNG; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    spectra : xarray.DataTree
        One child per observatory.
    arrivals : mapping of str to pandas.DataFrame or xarray.Dataset
        Edge definition to its arrival table, or to a posterior.
    """
    panels = burst_panels(spectra)
    figure = Figure(figsize=(7.2, 2.4 * max(len(panels), 1) + 0.6), layout="constrained")
    rows = np.atleast_1d(figure.subplots(max(len(panels), 1), 1, sharex=True, sharey=True))
    edges = {edge: timed_edges(table) for edge, table in arrivals.items()}
    for axes, panel in zip(rows, panels, strict=False):
        _draw_spectrum(axes, panel)
        for index, (edge, timed) in enumerate(edges.items()):
            if panel.observatory in timed:
                points, style = timed[panel.observatory], track_style(edge, index)
                axes.plot(points.time, points.frequency_mhz, color=style.colour, lw=1.6, label=edge_name(edge))
    rows[0].set_ylim(shown_band(panels, edges.values()))
    _finish_spectra(figure, list(rows), panels)
    save_png(figure, path)


def _draw_surroundings(axes: Axes, tracks: Sequence[TrackView]) -> None:
    angle = np.linspace(0.0, 2 * np.pi, 241)
    for ring in RINGS_AU:
        radius = ring * AU_RSUN
        axes.plot(radius * np.cos(angle), radius * np.sin(angle), color="0.82", lw=0.8, zorder=0)
        axes.annotate(f"{ring:g} au", (0.5 * radius, 0.87 * radius), color="0.5", fontsize=7, ha="center")
    axes.plot(0, 0, "o", color=SUN, ms=10, mec="#a87b00", zorder=4)
    axes.annotate("Sun", (-6, 0), ha="right", va="center", fontsize=9)
    positions = {}
    for track in tracks:
        positions.update(receiver_positions(track.posterior))
    for name, (x, y, _) in positions.items():
        axes.plot(x, y, "^", color=SPACECRAFT, ms=9, zorder=5)
        axes.annotate(name, (x, y), xytext=(0, 9), textcoords="offset points", ha="center", fontsize=9)


def _draw_track(axes: Axes, track: TrackView, style: TrackStyle, norm: LogNorm) -> None:
    polar = polar_track(track.posterior)
    anchors = spread_indices(polar, REGIONS_PER_TRACK)
    for index in anchors:
        inner, outer = (region_outline(track.posterior, int(index), percent) for percent in (68, 95))
        axes.fill(*inner[np.isfinite(inner).all(axis=1)].T, color=style.colour, alpha=0.08, lw=0)
        axes.plot(*inner.T, color=style.colour, lw=0.8, alpha=0.7)
        axes.plot(*outer.T, color=style.colour, lw=0.6, ls=":", alpha=0.6)
    outward = np.linspace(1.0, AU_RSUN, SPIRAL_POINTS)
    _draw_band(axes, spiral_band(track.posterior, outward), style)
    spiral = fitted_spiral(track.track_fit, outward)
    if spiral is not None:
        axes.plot(*spiral.T, color=style.colour, lw=1.4, ls="--", label=f"Parker spiral, {track.label}")
    axes.plot(polar.x_rsun, polar.y_rsun, color=style.colour, lw=4, solid_capstyle="round", label=track.label)
    axes.scatter(
        polar.x_rsun[anchors],
        polar.y_rsun[anchors],
        c=polar.frequency_mhz[anchors],
        norm=norm,
        cmap="viridis",
        marker=style.printed_marker,
        s=46,
        edgecolors=style.colour,
        linewidths=1.6,
        zorder=6,
    )


def _draw_band(axes: Axes, band: SpiralBand | None, style: TrackStyle) -> None:
    """Where the spiral of the joint fit lies, by its draws."""
    if band is None:
        return
    for percent in PERCENTS:
        axes.fill(*band_outline(band, percent).T, color=style.shade_rgba(0.08), lw=0, zorder=1)


def _finish_constellation(figure: Figure, axes: Axes, norm: LogNorm) -> None:
    axes.set_aspect("equal")
    axes.set_xlabel(r"HEE X ($R_\odot$), Earth to the right")
    axes.set_ylabel(r"HEE Y ($R_\odot$)")
    axes.margins(0.08)
    if axes.get_legend_handles_labels()[0]:
        figure.legend(loc="outside upper center", fontsize=8, frameon=False, ncols=2)
    bar = figure.colorbar(
        ScalarMappable(norm, "viridis"),
        ax=axes,
        orientation="horizontal",
        shrink=0.6,
        aspect=40,
        label="Frequency (MHz)",
    )
    ticks = [f for f in FREQUENCY_TICKS_MHZ if (norm.vmin or 0) <= f <= (norm.vmax or np.inf)]
    bar.ax.xaxis.set_major_locator(FixedLocator(ticks))
    bar.ax.xaxis.set_minor_locator(NullLocator())
    bar.ax.xaxis.set_minor_formatter(NullFormatter())
    bar.ax.set_xticks(ticks, [f"{f:g}" for f in ticks])
    axes.set_title(
        f"68 % regions filled, 95 % dotted; wedges: joint spiral; {APPARENT_SOURCE}", fontsize=8, color="0.4"
    )


def _intensity_colours() -> LinearSegmentedColormap:
    return LinearSegmentedColormap.from_list("intensity", INTENSITY_SCALE)


def _draw_spectrum(axes: Axes, panel: Panel) -> None:
    finite = panel.intensity[np.isfinite(panel.intensity)]
    low, high = np.quantile(finite, [0.25, 0.995]) if finite.size else (0.0, 1.0)
    axes.pcolormesh(
        panel.time,
        panel.frequency_mhz,
        panel.intensity,
        cmap=_intensity_colours(),
        vmin=low,
        vmax=high,
        shading="nearest",
        rasterized=True,
    )
    axes.set_title(
        f"{panel.observatory}  ({QUANTITY_NAMES.get(panel.quantity, panel.quantity)})", fontsize=9, loc="left", pad=3
    )
    axes.set_ylabel("Frequency (MHz)")


def _finish_spectra(figure: Figure, rows: list[Axes], panels: list[Panel]) -> None:
    rows[0].set_yscale("log")
    rows[0].yaxis.set_major_locator(FixedLocator(FREQUENCY_TICKS_MHZ))
    rows[0].yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    rows[0].yaxis.set_minor_formatter(NullFormatter())
    rows[-1].xaxis.set_major_formatter(DateFormatter("%H:%M"))  # type: ignore[no-untyped-call]
    shown = [panel.time for panel in panels if panel.time.size]
    if shown:
        rows[-1].set_xlabel(f"UTC on {shown[0][0].astype('datetime64[D]')}")
        rows[-1].set_xlim(max(time[0] for time in shown), min(time[-1] for time in shown))
    handles, labels = rows[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper right", fontsize=8, frameon=False, ncols=2)


def save_png(figure: Figure, path: Path, *, colours: int | None = None) -> None:
    """Write a figure beside the target, then rename: the file appears whole or not at all.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    path : Path
        Its folder is made when it does not exist.
    colours : int or None
        Keep this many colours only: line drawings become several times smaller.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(suffix=".png", prefix=f".{path.stem}-", dir=path.parent)
    os.close(handle)
    try:
        figure.savefig(name, dpi=DOTS_PER_INCH, metadata={"Software": "BELLA service"})
        if colours is not None:
            Image.open(name).convert("RGB").quantize(colours, dither=Image.Dither.NONE).save(name, optimize=True)
        Path(name).chmod(0o644)
        Path(name).replace(path)
    finally:
        Path(name).unlink(missing_ok=True)

"""What a track says of the wind, as PNG files: the spiral in polar coordinates, and frequencies against distances."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import EllipseCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

from bella.answer import NO_SPIRAL, written_wind
from bella.exceptions import InputError
from bella.flags import APPARENT_SOURCE
from bella.heliosphere import DENSITY_MODELS, emission_frequency_mhz, spiral_longitude_deg
from bella.heliosphere.density import CORONA_RSUN
from bella.heliosphere.parker import SPIRAL_ORIGIN_RSUN
from bella.heliosphere.polar import has_longitude, planar_positions, polar_covariance
from bella.plotting.geometry import PERCENTS, PolarTrack, SpiralBand, polar_track, spiral_band, spread_indices
from bella.plotting.palette import FREQUENCY_TICKS_MHZ, TRACK_STYLES
from bella.plotting.printed import save_png
from bella.units import AU_RSUN, FloatArray

ELLIPSES = 14
DISTANCE_TICKS_RSUN = (1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 30.0, 50.0, 100.0, 200.0)
MODEL_COLOURS = ("#7a4fb5", "#11936b", "#b8508f", "#8c6d1f", "#5b6b7a")
CORRECTED_MARKERS = ("v", "^")
EMISSION_DASHES = {1: "-", 2: "--"}
LEAST_SHOWN_DEG = 10.0
DRAWN_FITS = ((0, "two_step", "two-step", "--"), (1, "weighted", "errors in both", "-"), (3, "joint", "joint", ":"))
"""Place of its style, name, words and dashes of each spiral of one speed."""


def write_polar_fit_png(path: Path, posterior: xr.Dataset, fits: Mapping[str, Any]) -> None:
    """Write longitudes against distances with the spirals fitted to them; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.
    fits : mapping
        What :func:`bella.tracks.track_fit` and :func:`bella.tracks.piecewise_fit` say of it, and ``joint``, together;
        a fit that is missing, or has no parameters, is not drawn.
    """
    track = polar_track(posterior)
    longitude = _without_jumps(track)
    figure = Figure(figsize=(7.2, 4.6), layout="constrained")
    axes = figure.add_subplot()
    norm = LogNorm(float(track.frequency_mhz.min()), float(track.frequency_mhz.max()))
    outward = np.linspace(SPIRAL_ORIGIN_RSUN, 1.05 * float(np.nanmax(track.range_rsun)), 200)
    _draw_ellipses(axes, posterior, longitude)
    axes.scatter(track.range_rsun, longitude, c=track.frequency_mhz, norm=norm, cmap="viridis", s=14, zorder=3)
    _draw_fits(axes, fits, outward, longitude)
    _draw_band(axes, spiral_band(posterior, outward), float(np.nanmedian(longitude)))
    _finish_polar(axes, longitude)
    _frequency_bar(figure, axes, norm)
    save_png(figure, path)


def _without_jumps(track: PolarTrack) -> FloatArray:
    """Longitudes that do not jump by a turn on the way outward, degrees."""
    order = np.argsort(track.range_rsun, kind="stable")
    longitude = np.empty_like(track.longitude_deg)
    longitude[order] = np.unwrap(track.longitude_deg[order], period=360.0)
    return longitude


def _draw_ellipses(axes: Axes, posterior: xr.Dataset, longitude: FloatArray) -> None:
    """One standard deviation in distance and longitude, for some of the positions that have a longitude."""
    place, covariance = polar_covariance(*planar_positions(posterior))
    distance = place[:, 0]
    far = np.flatnonzero(has_longitude(distance, covariance[:, 0, 0]))
    if not far.size:
        return
    wanted = np.linspace(distance[far].min(), distance[far].max(), ELLIPSES)
    chosen = far[np.unique(np.abs(distance[far][:, None] - wanted).argmin(axis=0))]
    squared, axis = np.linalg.eigh(covariance[chosen])
    axes.add_collection(
        EllipseCollection(
            widths=2 * np.sqrt(squared[:, 1]),
            heights=2 * np.sqrt(squared[:, 0]),
            angles=np.degrees(np.arctan2(axis[:, 1, 1], axis[:, 0, 1])),
            units="xy",
            offsets=np.column_stack([distance[chosen], longitude[chosen]]),
            offset_transform=axes.transData,
            facecolors=TRACK_STYLES[0].shade_rgba(0.07),
            edgecolors=TRACK_STYLES[0].shade_rgba(0.45),
            linewidths=0.8,
        )
    )


def _draw_band(axes: Axes, band: SpiralBand | None, middle: float) -> None:
    """Where the spiral of the joint fit lies, by its draws."""
    if band is None:
        return
    moved = float(_nearest_turn(band.median_deg, middle)[0] - band.median_deg[0])
    for percent in PERCENTS:
        axes.fill_between(
            band.range_rsun,
            band.low_deg[percent] + moved,
            band.high_deg[percent] + moved,
            color=TRACK_STYLES[3].shade_rgba(0.12 if percent == PERCENTS[0] else 0.22),
            lw=0,
            zorder=1,
            label=f"joint, {percent} %",
        )


def _draw_fits(axes: Axes, fits: Mapping[str, Any], range_rsun: FloatArray, longitude: FloatArray) -> None:
    """Lines of the unweighted, the weighted, the joint and the broken spiral."""
    middle = float(np.nanmedian(longitude))
    for place, name, words, dashes in DRAWN_FITS:
        style = TRACK_STYLES[place]
        fit = fits.get(name, {})
        if _mean(fit, "phi0_deg") is None or _mean(fit, "v_sw_km_s") is None:
            continue
        phi0, speed = float(fit["phi0_deg"]["mean"]), float(fit["v_sw_km_s"]["mean"])
        line = spiral_longitude_deg(range_rsun, phi0, speed, float(fit["rotation_period_d"]))
        label = f"{words}: {written_wind(fit)}"
        axes.plot(range_rsun, _nearest_turn(line, middle), color=style.colour, lw=1.5, ls=dashes, label=label, zorder=4)
    _draw_pieces(axes, fits.get("piecewise", {}), middle)


def _draw_pieces(axes: Axes, fit: Mapping[str, Any], middle: float) -> None:
    segments = fit.get("segments", [])
    if len(segments) < 2 or _mean(fit, "phi0_deg") is None:
        return
    edges = [SPIRAL_ORIGIN_RSUN] + [float(segment["to_rsun"]) for segment in segments]
    steps = [
        segment["slope_deg_per_rsun"]["mean"] * width for segment, width in zip(segments, np.diff(edges), strict=True)
    ]
    heights = _nearest_turn(float(fit["phi0_deg"]["mean"]) + np.cumsum([0.0, *steps]), middle)
    words = ", ".join((written_wind(segment) or NO_SPIRAL).removesuffix(" km/s") for segment in segments)
    style = TRACK_STYLES[2]
    axes.plot(edges, heights, color=style.colour, lw=1.5, ls="-.", label=f"broken: {words} km/s", zorder=4)
    axes.plot(edges[1:-1], heights[1:-1], style.printed_marker, color=style.colour, ms=6, zorder=5)


def _mean(fit: Mapping[str, Any], name: str) -> float | None:
    value = (fit.get(name) or {}).get("mean")
    return None if value is None else float(value)


def _nearest_turn(line: FloatArray, middle_deg: float) -> FloatArray:
    """A line, moved by whole turns to where the track is drawn."""
    return np.asarray(line + 360.0 * np.round((middle_deg - np.median(line)) / 360.0))


def _finish_polar(axes: Axes, longitude: FloatArray) -> None:
    low, high = float(np.nanmin(longitude)), float(np.nanmax(longitude))
    margin = max(0.35 * (high - low), LEAST_SHOWN_DEG)
    axes.set_ylim(low - margin, high + margin)
    axes.set_xlim(left=0.0)
    axes.set_xlabel(r"Distance from the Sun ($R_\odot$)")
    axes.set_ylabel("HEE longitude (degrees west of Earth)")
    axes.set_title(f"Ellipses: one standard deviation; {APPARENT_SOURCE}", fontsize=8, color="0.4")
    axes.grid(color="0.92", lw=0.8)
    axes.set_axisbelow(True)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, framealpha=0.85, edgecolor="none", loc="upper right")


def _frequency_bar(figure: Figure, axes: Axes, norm: LogNorm) -> None:
    bar = figure.colorbar(ScalarMappable(norm, "viridis"), ax=axes, aspect=32, pad=0.01, label="Frequency (MHz)")
    ticks = [f for f in FREQUENCY_TICKS_MHZ if (norm.vmin or 0) <= f <= (norm.vmax or np.inf)]
    bar.ax.yaxis.set_minor_locator(NullLocator())
    bar.ax.set_yticks(ticks, [f"{f:g}" for f in ticks])


def write_density_png(
    path: Path, posterior: xr.Dataset, corrected_rsun: Mapping[str, FloatArray] | None = None
) -> None:
    """Write frequencies against distances with what density models emit there; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.
    corrected_rsun : mapping of str to numpy.ndarray, shape (F,), optional
        Distances of the emission by the name of a correction for scattering; at most two.

    Raises
    ------
    InputError
        If there are more than two corrections, or one has not a distance for every frequency.
    """
    corrections = corrected_rsun or {}
    if len(corrections) > len(CORRECTED_MARKERS):
        raise InputError(f"{len(corrections)} corrections would hide one another: choose at most two")
    if any(np.shape(distance) != (posterior.sizes["frequency"],) for distance in corrections.values()):
        raise InputError("a correction has not one distance for every frequency: correct the whole track")
    track = polar_track(posterior)
    figure = Figure(figsize=(7.2, 5.4), layout="constrained")
    axes = figure.add_subplot()
    _draw_models(axes, track)
    shown = spread_indices(track, ELLIPSES)
    for (label, corrected), marker in zip(corrections.items(), CORRECTED_MARKERS, strict=False):
        axes.plot(
            corrected[shown],
            track.frequency_mhz[shown],
            f"{marker}-",
            color=TRACK_STYLES[1].colour,
            mfc="white",
            ms=5,
            lw=0.8,
            label=label,
            zorder=5,
        )
    _draw_apparent(axes, track, shown)
    _finish_density(figure, axes, track)
    save_png(figure, path)


def _draw_apparent(axes: Axes, track: PolarTrack, shown: Any) -> None:
    axes.errorbar(
        track.range_rsun[shown],
        track.frequency_mhz[shown],
        xerr=np.minimum(track.range_sd_rsun[shown], 0.95 * track.range_rsun[shown]),
        fmt=TRACK_STYLES[0].printed_marker,
        color=TRACK_STYLES[0].colour,
        ms=5,
        lw=1.0,
        label=APPARENT_SOURCE,
        zorder=6,
    )


def _draw_models(axes: Axes, track: PolarTrack) -> None:
    """Frequency that each model emits at each distance: fundamental drawn out, harmonic dashed."""
    (left, right), (low, high) = _shown(track)
    for colour, model in zip(MODEL_COLOURS, DENSITY_MODELS.values(), strict=True):
        distance = np.geomspace(left, max(left, min(CORONA_RSUN if model.corona_only else right, right)), 200)
        label: str | None = model.name.capitalize()
        for harmonic, dashes in EMISSION_DASHES.items():
            frequency = emission_frequency_mhz(distance, model, harmonic)
            if ((frequency > low) & (frequency < high)).any():
                axes.plot(distance, frequency, color=colour, lw=1.1, ls=dashes, alpha=0.85, label=label)
                label = None


def _shown(track: PolarTrack) -> tuple[tuple[float, float], tuple[float, float]]:
    """Distances and frequencies that the figure shows."""
    nearest = max(1.05, 0.2 * float(np.nanmin(track.range_rsun)))
    farthest = max(AU_RSUN, 1.1 * float(np.nanmax(track.range_rsun)))
    return (nearest, farthest), (float(track.frequency_mhz.min()) / 1.3, float(track.frequency_mhz.max()) * 1.3)


def _finish_density(figure: Figure, axes: Axes, track: PolarTrack) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    distances, frequencies = _shown(track)
    axes.set_xlim(distances)
    axes.set_ylim(frequencies)
    axes.xaxis.set_major_locator(FixedLocator(DISTANCE_TICKS_RSUN))
    axes.yaxis.set_major_locator(FixedLocator(FREQUENCY_TICKS_MHZ))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.set_xlabel(r"Distance from the Sun ($R_\odot$)")
    axes.set_ylabel("Frequency (MHz)")
    axes.set_title("Density models: fundamental drawn out, harmonic dashed", fontsize=8, color="0.4")
    axes.grid(color="0.92", lw=0.8)
    figure.legend(loc="outside upper center", fontsize=8, frameon=False, ncols=3)

"""Spectra of all spacecraft on the clock of the Sun, one above the other, with the edges that were timed on them.

What each spacecraft received is drawn earlier by the time that light takes to it from the Sun. A source at the Sun
would then be received at one time by all; what is left between them is where the source was.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from bella.exceptions import InputError
from bella.plotting.day import NO_DATA, draw_intensity, frequency_axis, shown_day, thinned, time_axis
from bella.plotting.palette import INTENSITY_SCALE, TRACK_STYLES, TrackStyle, edge_name, track_style
from bella.plotting.printed import ARRIVAL_COLUMNS, FLAGGED, day_numbers, is_flagged, require_columns, save_png
from bella.plotting.spectra import BAND_MARGIN
from bella.spectra import over_background, relative_power
from bella.units import DAY_S, FloatArray

EVOLUTION_COLUMNS = ("observatory", "frequency_mhz", "arrival_utc", "sigma_s")

MOST_EDGES = 45
"""More than this many per spacecraft cannot be told apart: of those, some are drawn, evenly in the logarithm of f."""

BEFORE_SHARE, AFTER_SHARE, LEAST_ROOM_D = 0.15, 0.4, 300.0 / DAY_S
"""Time shown before the first and after the last edge, as a share of the time between them."""

REFERENCE = "#9fd3ff"
DEPTH_DB = 18.0
"""A relative flux has lost its background, and with it the level that its decibels could be counted from."""

EVOLUTION = TRACK_STYLES[3]
OUTLINED = (withStroke(linewidth=3.0, foreground="#12161d"),)


@dataclass(frozen=True)
class SunClock:
    """Spectra and tables of one burst, all in time of the Sun.

    Attributes
    ----------
    spectra : mapping of str to xarray.Dataset
        In dB over background, times shifted.
    arrivals : pandas.DataFrame
        `ARRIVAL_COLUMNS` and ``sun_d``, days as matplotlib counts them.
    time_evolution : pandas.DataFrame
        `EVOLUTION_COLUMNS` and ``sun_d``; empty for none.
    light_time_s : mapping of str to float
    """

    spectra: Mapping[str, xr.Dataset]
    arrivals: pd.DataFrame
    time_evolution: pd.DataFrame
    light_time_s: Mapping[str, float]


def write_aligned_png(
    path: Path,
    spectra: Mapping[str, xr.Dataset],
    arrivals: pd.DataFrame,
    sun_light_time_s: Mapping[str, float],
    time_evolution: pd.DataFrame | None = None,
) -> None:
    """Write the spectra of a burst, each earlier by its light time, as a PNG; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    spectra : mapping of str to xarray.Dataset
        Dynamic spectrum of each observatory, from top to bottom.
    arrivals : pandas.DataFrame
        observatory, frequency_mhz, arrival_utc, sigma_s (s), edge, flag. Flagged ones are hollow and grey; rows without
        a time, and of other observatories, are left out.
    sun_light_time_s : mapping of str to float
        Of each observatory, s.
    time_evolution : pandas.DataFrame or None
        The t(f) curve: observatory, frequency_mhz, arrival_utc, sigma_s (s).

    Raises
    ------
    InputError
        If there is no spectrum, its quantity is not known, a light time is missing, or a table lacks a column.
    """
    evolution = pd.DataFrame(columns=list(EVOLUTION_COLUMNS)) if time_evolution is None else time_evolution
    save_png(_aligned_figure(_on_sun_clock(spectra, arrivals, sun_light_time_s, evolution)), path)


def _on_sun_clock(
    spectra: Mapping[str, xr.Dataset],
    arrivals: pd.DataFrame,
    light_time_s: Mapping[str, float],
    evolution: pd.DataFrame,
) -> SunClock:
    if not spectra:
        raise InputError("there is no spectrum to draw: give that of one spacecraft or more")
    missing = [name for name in spectra if not np.isfinite(light_time_s.get(name, np.nan))]
    if missing:
        raise InputError(f"the light time from the Sun to {missing[0]} is missing: give it in seconds")
    shifted = {}
    for name, spectrum in spectra.items():
        over = _above_quiet(spectrum)
        earlier = np.timedelta64(round(light_time_s[name] * 1e9), "ns")
        shifted[name] = over.assign_coords(time=over["time"].to_numpy().astype("datetime64[ns]") - earlier)
    names = list(spectra)
    timed = _shifted(require_columns(arrivals, ARRIVAL_COLUMNS, "arrival table"), light_time_s, names)
    curves = _shifted(require_columns(evolution, EVOLUTION_COLUMNS, "table of t(f)"), light_time_s, names)
    return SunClock(shifted, timed, curves, light_time_s)


def _above_quiet(spectrum: xr.Dataset) -> xr.Dataset:
    """Spectrum in dB over its background, or over a depth below the maximum of each channel where it has none left."""
    if spectrum.attrs["quantity"] != "relative_flux":
        return over_background(spectrum)
    power = relative_power(spectrum)
    lowest = power.max("time") * 10.0 ** (-DEPTH_DB / 10.0)
    over = 10.0 * np.log10((power / lowest.where(lowest > 0.0)).clip(min=1.0))
    return spectrum.assign(intensity=over.astype(np.float32))


def _shifted(table: pd.DataFrame, light_time_s: Mapping[str, float], names: Sequence[str]) -> pd.DataFrame:
    known = table[table["observatory"].isin(names) & pd.notna(table["arrival_utc"])]
    light_d = known["observatory"].map(dict(light_time_s)).to_numpy(dtype=np.float64) / DAY_S
    return known.assign(sun_d=day_numbers(known["arrival_utc"]) - light_d)


def _aligned_figure(clock: SunClock) -> Figure:
    count = len(clock.spectra)
    figure = Figure(figsize=(8.0, 2.3 * count + 0.9), layout="constrained")
    rows = list(np.atleast_1d(figure.subplots(count, 1, sharex=True, sharey=True)))
    window = _shown_time(clock)
    edges = list(dict.fromkeys(clock.arrivals["edge"]))
    for axes, name in zip(rows, clock.spectra, strict=True):
        _draw_spectrum(axes, clock.spectra[name], window)
        _draw_evolution(axes, clock.time_evolution[clock.time_evolution["observatory"] == name])
        received = clock.arrivals[clock.arrivals["observatory"] == name]
        if axes is not rows[0]:
            _draw_reference(axes, clock.arrivals, next(iter(clock.spectra)))
        for index, edge in enumerate(edges):
            _draw_edges(axes, received[received["edge"] == edge], track_style(edge, index))
        axes.set_title(name, loc="left", fontsize=10, pad=3)
        axes.set_title(f"{clock.light_time_s[name]:.1f} s of light taken off", loc="right", fontsize=8, color="0.4")
    _finish(figure, rows, clock, window)
    return figure


def _shown_time(clock: SunClock) -> tuple[float, float]:
    """Around the edges, as far as there are spectra; everything where no edge was timed in their time."""
    ends = np.array([day_numbers(spectrum["time"][[0, -1]]) for spectrum in clock.spectra.values()])
    first, last = float(ends.min()), float(ends.max())
    timed = clock.arrivals.loc[clock.arrivals["sun_d"].between(first, last), "sun_d"].to_numpy()
    if not timed.size:
        return first, last
    length = float(np.ptp(timed))
    left = timed.min() - max(BEFORE_SHARE * length, LEAST_ROOM_D)
    right = timed.max() + max(AFTER_SHARE * length, LEAST_ROOM_D)
    return max(first, float(left)), min(last, float(right))


def _draw_spectrum(axes: Axes, over: xr.Dataset, window: tuple[float, float]) -> None:
    days = day_numbers(over["time"])
    near = np.flatnonzero((days >= window[0]) & (days <= window[1]))
    axes.set_facecolor(NO_DATA)
    if near.size >= 2:
        shown = over.isel(time=slice(max(near[0] - 1, 0), near[-1] + 2))
        draw_intensity(axes, thinned(shown), INTENSITY_SCALE)


def _draw_evolution(axes: Axes, curve: pd.DataFrame) -> None:
    if curve.empty:
        return
    ordered = curve.sort_values("frequency_mhz")
    frequency, sun_d = ordered["frequency_mhz"].to_numpy(), ordered["sun_d"].to_numpy()
    sigma_d = ordered["sigma_s"].to_numpy(dtype=np.float64) / DAY_S
    axes.fill_betweenx(frequency, sun_d - sigma_d, sun_d + sigma_d, color=EVOLUTION.shade_rgba(0.35), lw=0, zorder=3)
    (line,) = axes.plot(sun_d, frequency, color=EVOLUTION.colour, lw=1.6, zorder=4, label="t(f)")
    line.set_path_effects(list(OUTLINED))


def _draw_reference(axes: Axes, arrivals: pd.DataFrame, name: str) -> None:
    """Line through the edges of the first spacecraft, which shows how much earlier or later another one received it."""
    good = arrivals[(arrivals["observatory"] == name) & ~is_flagged(arrivals)]
    line = good[good["edge"] == good["edge"].iloc[0]].sort_values("frequency_mhz") if len(good) else good
    if len(line) >= 2:
        axes.plot(
            line["sun_d"], line["frequency_mhz"], color=REFERENCE, lw=0.9, ls=(0, (4, 2)), label=f"edge at {name}"
        )


def _draw_edges(axes: Axes, edges: pd.DataFrame, style: TrackStyle) -> None:
    flagged = is_flagged(edges)
    for part, hollow in ((edges[flagged], True), (edges[~flagged], False)):
        some = part.iloc[_told_apart(part["frequency_mhz"].to_numpy(dtype=np.float64))]
        if some.empty:
            continue
        colour = FLAGGED if hollow else style.colour
        axes.errorbar(
            some["sun_d"],
            some["frequency_mhz"],
            xerr=np.nan_to_num(some["sigma_s"].to_numpy(dtype=np.float64)) / DAY_S,
            fmt=style.printed_marker,
            ms=4.6 if hollow else 3.4,
            color=colour,
            mfc="none" if hollow else colour,
            mec=colour if hollow else "white",
            mew=1.0 if hollow else 0.5,
            elinewidth=1.1,
            zorder=5 if hollow else 6,
            label=f"{edge_name(str(some['edge'].iloc[0]))}{', flagged' if hollow else ''}",
        )


def _told_apart(frequency_mhz: FloatArray) -> npt.NDArray[np.intp]:
    """Which of many channels to draw: the nearest to each of some that are even in the logarithm."""
    if frequency_mhz.size <= MOST_EDGES:
        return np.arange(frequency_mhz.size)
    logarithm = np.log(frequency_mhz)
    even = np.linspace(logarithm.min(), logarithm.max(), MOST_EDGES)
    return np.unique(np.abs(logarithm[:, np.newaxis] - even).argmin(axis=0))


def _shown_band(clock: SunClock) -> tuple[float, float]:
    timed = clock.arrivals["frequency_mhz"].to_numpy(dtype=np.float64)
    if timed.size:
        return float(timed.min()) / BAND_MARGIN, float(timed.max()) * BAND_MARGIN
    channels = np.concatenate([spectrum["frequency"].to_numpy() for spectrum in clock.spectra.values()])
    return float(channels.min()) / BAND_MARGIN, float(channels.max()) * BAND_MARGIN


def _day(clock: SunClock, window: tuple[float, float]) -> str:
    time = np.unique(np.concatenate([spectrum["time"].to_numpy() for spectrum in clock.spectra.values()]))
    days = day_numbers(time)
    return shown_day(time[(days >= window[0]) & (days <= window[1])])


def _finish(figure: Figure, rows: list[Axes], clock: SunClock, window: tuple[float, float]) -> None:
    frequency_axis(rows[0], _shown_band(clock))
    for axes in rows:
        axes.set_ylabel("Frequency (MHz)")
        axes.xaxis_date()
        axes.grid(axis="x", color="white", alpha=0.25, lw=0.6)
    time_axis(rows[-1], most_ticks=9)
    rows[-1].set_xlim(window)
    rows[-1].set_xlabel(f"Time at the Sun: UTC less the light time from the Sun, {_day(clock, window)}")
    handles = {}
    for axes in rows:
        handles.update(dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True)))
    if handles:
        figure.legend(
            handles.values(), handles.keys(), loc="outside upper right", fontsize=8, frameon=False, ncols=len(handles)
        )

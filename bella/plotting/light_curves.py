"""Light curves of a burst with the edges that were timed on them: a row per frequency, a column per spacecraft.

Each is power over its maximum in the time shown, so that a half-maximum edge crosses the line at one half. All panels
of a row are as long, and each begins as much before its own edge: the rises can be compared by eye.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.dates import DateFormatter, HourLocator, MinuteLocator
from matplotlib.figure import Figure

from bella.exceptions import InputError
from bella.plotting.palette import INK, TrackStyle, edge_name, track_style
from bella.plotting.printed import ARRIVAL_COLUMNS, FLAGGED, day_numbers, is_flagged, require_columns, save_png
from bella.spectra import power_above_background, sample_times
from bella.units import DAY_S, FloatArray

NEAREST_RATIO = 1.2
"""A channel, or an edge, farther than this from the frequency asked for is not drawn in its place."""

SHOWN_S, SHOWN_S_MHZ, BEFORE_SHARE = 240.0, 420.0, 0.3
"""Time shown: so many seconds, and as many over the frequency in MHz, since bursts last longer the lower it is."""

FEWEST_CADENCES = 8.0
TICK_MINUTES, MOST_TICKS = (1, 2, 5, 10, 15, 20, 30, 60, 120, 180, 360), 5.5
FLAGGED_TEXT = "#6f7982"
LEVEL = 0.5


@dataclass(frozen=True)
class Channel:
    """Light curve of one channel.

    Attributes
    ----------
    observatory : str
    frequency_mhz : float
    days : ndarray, shape (T,)
        Of the samples, as matplotlib counts them.
    power : ndarray, shape (T,)
        In any unit.
    edges : pandas.DataFrame
        The nearest row of the arrival table for each definition of the edge, with ``days``.
    """

    observatory: str
    frequency_mhz: float
    days: FloatArray
    power: FloatArray
    edges: pd.DataFrame


def write_light_curves_png(
    path: Path, spectra: Mapping[str, xr.Dataset], arrivals: pd.DataFrame, frequencies_mhz: Sequence[float]
) -> None:
    """Write light curves with their edges as a PNG; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    spectra : mapping of str to xarray.Dataset
        Dynamic spectrum of each observatory, from left to right.
    arrivals : pandas.DataFrame
        observatory, frequency_mhz, arrival_utc, sigma_s (s), edge, flag. Flagged ones are grey; the flag is written
        where there is no time.
    frequencies_mhz : sequence of float
        Of the rows, from top to bottom, MHz; drawn is the nearest channel that was measured.

    Raises
    ------
    InputError
        If there is no spectrum or no frequency, or the table lacks a column.
    """
    if not spectra or not len(frequencies_mhz):
        raise InputError("there is no light curve to draw: give one spectrum and one frequency or more")
    save_png(
        _light_curves_figure(spectra, require_columns(arrivals, ARRIVAL_COLUMNS, "arrival table"), frequencies_mhz),
        path,
    )


def _light_curves_figure(
    spectra: Mapping[str, xr.Dataset], arrivals: pd.DataFrame, frequencies_mhz: Sequence[float]
) -> Figure:
    rows, columns = len(frequencies_mhz), len(spectra)
    figure = Figure(figsize=(1.0 + 2.9 * max(columns, 2), 1.2 + 1.55 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False)
    styles = {edge: track_style(edge, index) for index, edge in enumerate(dict.fromkeys(arrivals["edge"]))}
    for places, frequency in zip(panels, frequencies_mhz, strict=True):
        channels = {name: _channel(spectrum, name, arrivals, frequency) for name, spectrum in spectra.items()}
        begins, length = _begins(channels), _shown_days(channels, frequency)
        for axes, (name, channel) in zip(places, channels.items(), strict=True):
            if channel is None:
                _say_nothing(axes, f"no channel near {frequency:g} MHz")
            else:
                _show_time(axes, begins[name] - BEFORE_SHARE * length, length)
                _draw_channel(axes, channel, styles)
    _finish(figure, panels, spectra, frequencies_mhz)
    return figure


def _channel(spectrum: xr.Dataset, name: str, arrivals: pd.DataFrame, frequency_mhz: float) -> Channel | None:
    """Nearest channel that was measured, unless it is far."""
    measured = spectrum
    if "interpolated" in spectrum:
        measured = spectrum.isel(frequency=np.flatnonzero(spectrum["interpolated"].to_numpy() == 0))
    known = measured["frequency"].to_numpy().astype(np.float64)
    apart = np.abs(np.log(known / frequency_mhz))
    if not apart.size or apart.min() > np.log(NEAREST_RATIO):
        return None
    one = measured.isel(frequency=[int(apart.argmin())])
    frequency = float(one["frequency"][0])
    edges = _nearest_edges(arrivals[arrivals["observatory"] == name], frequency)
    days, power = day_numbers(sample_times(one).to_numpy()[:, 0]), power_above_background(one).to_numpy()[:, 0]
    return Channel(name, frequency, days, power, edges)


def _nearest_edges(arrivals: pd.DataFrame, frequency_mhz: float) -> pd.DataFrame:
    apart = np.abs(np.log(arrivals["frequency_mhz"].to_numpy(dtype=np.float64) / frequency_mhz))
    near = arrivals.assign(apart=apart, days=day_numbers(arrivals["arrival_utc"]))[apart <= np.log(NEAREST_RATIO)]
    return pd.DataFrame(near.sort_values("apart", kind="stable").drop_duplicates("edge"))


def _begins(channels: Mapping[str, Channel | None]) -> dict[str, float]:
    """What each panel of a row is drawn around: its first edge, that of the others, or its maximum; days."""
    own = {name: _first_edge(channel) for name, channel in channels.items() if channel is not None}
    timed = [day for day in own.values() if np.isfinite(day)]
    begins = {}
    for name, day in own.items():
        channel = channels[name]
        if np.isfinite(day) or channel is None:
            begins[name] = day
        else:
            begins[name] = float(np.median(timed)) if timed else _brightest(channel)
    return begins


def _first_edge(channel: Channel) -> float:
    """First edge within the time of the light curve, the good ones first; NaN without."""
    inside = channel.edges[channel.edges["days"].between(channel.days.min(), channel.days.max())]
    good = inside[~is_flagged(inside)]
    return float((good if len(good) else inside)["days"].min())


def _brightest(channel: Channel) -> float:
    if not np.isfinite(channel.power).any():
        return float(np.median(channel.days))
    return float(channel.days[int(np.nanargmax(channel.power))])


def _shown_days(channels: Mapping[str, Channel | None], frequency_mhz: float) -> float:
    cadences = [float(np.median(np.diff(channel.days))) for channel in channels.values() if channel is not None]
    return max((SHOWN_S + SHOWN_S_MHZ / frequency_mhz) / DAY_S, FEWEST_CADENCES * max(cadences, default=0.0))


def _show_time(axes: Axes, first: float, length: float) -> None:
    axes.set_xlim(first, first + length)
    minutes = length * DAY_S / 60.0
    step = next((step for step in TICK_MINUTES if minutes / step <= MOST_TICKS), TICK_MINUTES[-1])
    by_hour = step >= 60
    locator = HourLocator(range(0, 24, step // 60)) if by_hour else MinuteLocator(range(0, 60, step))  # type: ignore[no-untyped-call]
    axes.xaxis_date()
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(DateFormatter("%H:%M"))  # type: ignore[no-untyped-call]


def _draw_channel(axes: Axes, channel: Channel, styles: Mapping[str, TrackStyle]) -> None:
    first, last = axes.get_xlim()
    axes.set_title(f"{channel.frequency_mhz:.3g} MHz", loc="right", fontsize=6.5, color="0.5", pad=1)
    axes.axhline(LEVEL, color="0.75", lw=0.7, ls=(0, (2, 2)), zorder=1)
    inside = (channel.days >= first) & (channel.days <= last) & np.isfinite(channel.power)
    highest = float(channel.power[inside].max()) if inside.any() else 0.0
    if highest > 0.0:
        axes.step(channel.days, channel.power / highest, where="mid", color=INK, lw=1.1, zorder=3)
    else:
        _say_nothing(axes, "no data")
    for place, (_, edge) in enumerate(channel.edges.iterrows()):
        _draw_edge(axes, edge, styles[str(edge["edge"])], place)


def _draw_edge(axes: Axes, edge: pd.Series, style: TrackStyle, place: int) -> None:
    """A line at the edge, its sigma as a band, and both as text; without an edge, why there is none."""
    flag = str(edge["flag"]) if pd.notna(edge["flag"]) else ""
    colour = FLAGGED if flag else style.colour
    words = flag.replace("_", " ") or "no edge"
    if np.isfinite(edge["days"]):
        sigma_s = float(np.nan_to_num(edge["sigma_s"]))
        band = np.array([-1.0, 1.0]) * sigma_s / DAY_S + edge["days"]
        axes.axvspan(band[0], band[1], color=colour, alpha=0.25, lw=0, zorder=2)
        name = edge_name(str(edge["edge"])) + (", flagged" if flag else "")
        axes.axvline(edge["days"], color=colour, lw=1.4, ls="--" if flag else "-", zorder=4, label=name)
        digits = 0 if sigma_s >= 10.0 else 1
        stamp = f"{pd.Timestamp(edge['arrival_utc']).round('s'):%H:%M:%S} ± {sigma_s:.{digits}f} s"
        words = f"{stamp}, {words}" if flag else stamp
    axes.text(
        0.97,
        0.93 - 0.13 * place,
        words,
        transform=axes.transAxes,
        ha="right",
        va="top",
        fontsize=7,
        color=FLAGGED_TEXT if flag else colour,
        zorder=5,
    )


def _say_nothing(axes: Axes, words: str) -> None:
    axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", va="center", fontsize=8, color="0.5")


def _finish(
    figure: Figure, panels: np.ndarray, spectra: Mapping[str, xr.Dataset], frequencies_mhz: Sequence[float]
) -> None:
    for axes in panels.flat:
        axes.set_ylim(-0.06, 1.14)
        axes.set_yticks([0.0, 0.5, 1.0])
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
    for axes, name in zip(panels[0], spectra, strict=True):
        axes.set_title(name, fontsize=10)
    for axes, frequency in zip(panels[:, 0], frequencies_mhz, strict=True):
        axes.set_ylabel(f"{frequency:g} MHz", fontsize=9, fontweight="bold", color=INK)
    figure.supxlabel(f"UTC, {shown_day(next(iter(spectra.values()))['time'].to_numpy())}", fontsize=9)
    figure.supylabel("Power / maximum", fontsize=9)
    handles = {str(line.get_label()): line for axes in panels.flat for line in axes.get_lines()}
    names = sorted((name for name in handles if not name.startswith("_")), key=lambda name: name.endswith(", flagged"))
    if names:
        figure.legend(
            [handles[name] for name in names],
            names,
            loc="outside upper right",
            fontsize=8,
            frameon=False,
            ncols=len(names),
        )


def shown_day(time: npt.NDArray[np.datetime64]) -> str:
    """Day of a time axis, or its first and last, such as "2010-01-17"."""
    first, last = (str(moment.astype("datetime64[D]")) for moment in time[[0, -1]])
    return first if first == last else f"{first} to {last}"

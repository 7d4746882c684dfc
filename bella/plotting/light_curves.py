"""The edges of a burst on its light curves: a panel for each channel, and all of them on the profile that they share.

Each curve is power over its maximum in the time shown, so that a half-maximum edge crosses the line at one half. All
panels of a row are as long, and each begins as much before its own edge: the rises can be compared by eye.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from bella.bursts.shared_profile import collapsed_samples
from bella.bursts.timing import TimedBurst
from bella.exceptions import InputError
from bella.plotting.export import Caption, write_figure
from bella.plotting.geometry import require_columns
from bella.plotting.spectra import SpectraView, spectra_caption, spectra_figure
from bella.plotting.svg import Scale, edge_class, edge_name, element, figure, line, number, path, time_of_day, words
from bella.plotting.svg import unix_s as seconds_of
from bella.spacecraft import light_time_s
from bella.spectra import over_background, power_above_background, sample_times
from bella.units import FloatArray

ARRIVAL_COLUMNS = ("observatory", "frequency_mhz", "arrival_utc", "sigma_s", "edge", "flag")
SAMPLE_COLUMNS = ("observatory", "frequency_mhz", "widths", "height", "fitted")

NEAREST_RATIO = 1.2
"""A channel, or an edge, farther than this from the frequency asked for is not drawn in its place."""

SHOWN_S, SHOWN_S_MHZ, BEFORE_SHARE = 240.0, 420.0, 0.3
"""Time shown: so many seconds, and as many over the frequency in MHz, since bursts last longer the lower it is."""

FEWEST_CADENCES = 8.0
MOST_TICKS = 5
LEVEL = 0.5
LOWEST, HIGHEST = -0.06, 1.14
LEFT, TOP, PANEL_WIDTH, PANEL_HEIGHT, GAP_X, GAP_Y, FOOT = 64.0, 46.0, 250.0, 112.0, 18.0, 34.0, 44.0

BANDS = 4
"""Panels of the shared profile, from high to low frequencies."""

SPAN_WIDTHS, HEIGHTS, RESIDUALS = (-4.0, 3.5), (-0.15, 1.25), (-0.2, 0.2)
"""Widths about the half-rise, heights and residuals that are shown."""

PROFILE_HEIGHT, RESIDUAL_HEIGHT = 210.0, 100.0
MOST_CHANNELS = 5
"""Of the light curves of a command."""


@dataclass(frozen=True)
class Channel:
    """Light curve of one channel.

    Attributes
    ----------
    seconds : ndarray, shape (T,)
        Of the samples, since 1970.
    power : ndarray, shape (T,)
        In any unit.
    edges : pandas.DataFrame
        The nearest row of the arrival table for each definition of the edge, with ``seconds``.
    """

    observatory: str
    frequency_mhz: float
    seconds: FloatArray
    power: FloatArray
    edges: pd.DataFrame


def light_curves_figure(
    spectra: Mapping[str, xr.Dataset], arrivals: pd.DataFrame, frequencies_mhz: Sequence[float]
) -> str:
    """Light curves with their edges, SVG.

    Parameters
    ----------
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
    require_columns(arrivals, ARRIVAL_COLUMNS, "arrival table")
    parts: list[str] = []
    for row, frequency in enumerate(frequencies_mhz):
        channels = {name: _channel(spectrum, name, arrivals, frequency) for name, spectrum in spectra.items()}
        begins, length = _begins(channels), _shown_s(channels, frequency)
        top = TOP + row * (PANEL_HEIGHT + GAP_Y)
        upward = Scale(LOWEST, HIGHEST, top + PANEL_HEIGHT, top)
        parts.append(words(f"{frequency:g} MHz", 4, top + PANEL_HEIGHT / 2, class_="panel-name"))
        for column, (name, channel) in enumerate(channels.items()):
            left = LEFT + column * (PANEL_WIDTH + GAP_X)
            first = 0.0 if channel is None else begins[name] - BEFORE_SHARE * length
            across = Scale(first, first + length, left, left + PANEL_WIDTH)
            parts += _panel(channel, across, upward, frequency)
    for column, name in enumerate(spectra):
        parts.append(words(name, LEFT + column * (PANEL_WIDTH + GAP_X), TOP - 8, class_="panel-name"))
    width = LEFT + len(spectra) * (PANEL_WIDTH + GAP_X)
    height = TOP + len(frequencies_mhz) * (PANEL_HEIGHT + GAP_Y) + FOOT - GAP_Y
    said = f"Power over its maximum against UTC, {shown_day(next(iter(spectra.values()))['time'].to_numpy())}"
    parts.append(words(said, (LEFT + width) / 2, height - 6, class_="axis-name", text_anchor="middle"))
    parts += _key(list(dict.fromkeys(arrivals["edge"])))
    return figure("light-curves", (width, height), "Light curves of a burst with the edges that were timed.", *parts)


def light_curves_caption() -> str:
    """What the figure of the light curves shows, for a file of its own."""
    return (
        "Light curves of a Type III burst, a row per frequency and a column per spacecraft. Lines: edges that were "
        "timed, with one standard deviation as a band; grey and dashed: flagged."
    )


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
    power = power_above_background(one).to_numpy()[:, 0]
    return Channel(name, frequency, seconds_of(sample_times(one).to_numpy()[:, 0]), power, edges)


def _nearest_edges(arrivals: pd.DataFrame, frequency_mhz: float) -> pd.DataFrame:
    apart = np.abs(np.log(arrivals["frequency_mhz"].to_numpy(dtype=np.float64) / frequency_mhz))
    utc = pd.to_datetime(arrivals["arrival_utc"], utc=True).dt.tz_localize(None).to_numpy("datetime64[ns]")
    seconds = np.where(np.isnat(utc), np.nan, seconds_of(utc))
    near = arrivals.assign(apart=apart, seconds=seconds)[apart <= np.log(NEAREST_RATIO)]
    return pd.DataFrame(near.sort_values("apart", kind="stable").drop_duplicates("edge"))


def _begins(channels: Mapping[str, Channel | None]) -> dict[str, float]:
    """What each panel of a row is drawn around: its first edge, that of the others, or its maximum; s since 1970."""
    own = {name: _first_edge(channel) for name, channel in channels.items() if channel is not None}
    timed = [one for one in own.values() if np.isfinite(one)]
    begins = {}
    for name, moment in own.items():
        channel = channels[name]
        if np.isfinite(moment) or channel is None:
            begins[name] = moment
        else:
            begins[name] = float(np.median(timed)) if timed else _brightest(channel)
    return begins


def _first_edge(channel: Channel) -> float:
    """First edge within the time of the light curve, the good ones first; NaN without."""
    inside = channel.edges[channel.edges["seconds"].between(channel.seconds.min(), channel.seconds.max())]
    good = inside[inside["flag"].fillna("").astype(str) == ""]
    return float((good if len(good) else inside)["seconds"].min())


def _brightest(channel: Channel) -> float:
    if not np.isfinite(channel.power).any():
        return float(np.median(channel.seconds))
    return float(channel.seconds[int(np.nanargmax(channel.power))])


def _shown_s(channels: Mapping[str, Channel | None], frequency_mhz: float) -> float:
    cadences = [float(np.median(np.diff(channel.seconds))) for channel in channels.values() if channel is not None]
    return max(SHOWN_S + SHOWN_S_MHZ / frequency_mhz, FEWEST_CADENCES * max(cadences, default=0.0))


def _panel(channel: Channel | None, across: Scale, upward: Scale, frequency_mhz: float) -> Iterator[str]:
    middle = (across.start + across.end) / 2, (upward.start + upward.end) / 2
    yield element(
        "rect",
        x=across.start,
        y=upward.end,
        width=across.end - across.start,
        height=upward.start - upward.end,
        class_="frame",
    )
    if channel is None:
        yield words(f"no channel near {frequency_mhz:g} MHz", *middle, class_="tick", text_anchor="middle")
        return
    ticks = across.time_ticks(MOST_TICKS)
    step_s = ticks[1] - ticks[0] if len(ticks) > 1 else 60.0
    for tick in ticks:
        x = float(across(tick))
        yield line(x, upward.start, x, upward.start + 4, class_="axis")
        yield words(time_of_day(tick, step_s), x, upward.start + 17, class_="tick", text_anchor="middle")
    yield words(f"{channel.frequency_mhz:.3g} MHz", across.end, upward.end - 4, class_="panel-unit", text_anchor="end")
    half = float(upward(LEVEL))
    yield line(across.start, half, across.end, half, class_="gridline dashed")
    inside = (channel.seconds >= across.low) & (channel.seconds <= across.high) & np.isfinite(channel.power)
    highest = float(channel.power[inside].max()) if inside.any() else 0.0
    if highest > 0.0:
        yield path(steps(channel.seconds, channel.power / highest, across, upward), class_="light-curve")
    else:
        yield words("no data", *middle, class_="tick", text_anchor="middle")
    for place, (_, edge) in enumerate(channel.edges.iterrows()):
        yield from _edge(edge, across, upward, place)


def steps(seconds: FloatArray, height: FloatArray, across: Scale, upward: Scale) -> FloatArray:
    """Places of a line that holds each value from half a sample before to half a sample after it, shape (2 T, 2)."""
    between = 0.5 * (seconds[1:] + seconds[:-1])
    ends = np.concatenate([seconds[:1], np.repeat(between, 2), seconds[-1:]])
    places = np.column_stack([across(ends), upward(np.repeat(height, 2))])
    places[(ends < across.low) | (ends > across.high)] = np.nan
    return places


def _edge(edge: pd.Series, across: Scale, upward: Scale, place: int) -> Iterator[str]:
    """A line at the edge, its sigma as a band, and both as text; without an edge, why there is none."""
    flag = str(edge["flag"]) if pd.notna(edge["flag"]) else ""
    kind = "flagged" if flag else edge_class(str(edge["edge"]))
    said = flag.replace("_", " ") or "no edge"
    if np.isfinite(edge["seconds"]):
        sigma_s = float(np.nan_to_num(edge["sigma_s"]))
        ends = np.clip(across(edge["seconds"] + np.array([-sigma_s, sigma_s])), across.start, across.end)
        box = {"x": float(ends[0]), "width": float(ends[1] - ends[0]), "y": upward.end}
        yield element("rect", **box, height=upward.start - upward.end, class_=f"sigma {kind}")
        if across.holds(edge["seconds"]):
            x = float(across(edge["seconds"]))
            name = element("title", edge_name(str(edge["edge"])) + (", flagged" if flag else ""))
            yield element("g", name, line(x, upward.end, x, upward.start, class_=f"edge {kind}"))
        digits = 0 if sigma_s >= 10.0 else 1
        stamp = f"{pd.Timestamp(edge['arrival_utc']).round('s'):%H:%M:%S} ± {sigma_s:.{digits}f} s"
        said = f"{stamp}, {said}" if flag else stamp
    y = upward.end + 14 + 15 * place
    yield words(said, across.end - 6, y, class_=f"edge-said halo {kind}", text_anchor="end")


def _key(edges: Sequence[str]) -> Iterator[str]:
    for index, edge in enumerate(edges):
        x = LEFT + 170 * index
        yield line(x, 14, x + 18, 14, class_=f"edge {edge_class(edge)}")
        yield words(edge_name(edge), x + 24, 18, class_="tick")


def shown_day(time: np.ndarray) -> str:
    """Day of a time axis, or its first and last, such as "2010-01-17"."""
    first, last = (str(moment.astype("datetime64[D]")) for moment in time[[0, -1]])
    return first if first == last else f"{first} to {last}"


def shared_profile_figure(samples: pd.DataFrame) -> str:
    """Light curves of a burst, shifted and stretched onto the profile that they share, SVG.

    Where they lie on one line, their spacecraft saw the same burst.

    Parameters
    ----------
    samples : pandas.DataFrame
        One row per sample: observatory; frequency_mhz; widths, its time after the half-rise in widths; height, its
        power over that of the burst; fitted, what the shared profile has there.

    Raises
    ------
    InputError
        If there is no sample, or a column is missing.
    """
    known = require_columns(samples, SAMPLE_COLUMNS, "table of samples")
    if known.empty:
        raise InputError("there is no sample to draw: fit a shared profile first")
    names = list(dict.fromkeys(known["observatory"]))
    log_f = np.log(known["frequency_mhz"].to_numpy(dtype=np.float64))
    limits = np.exp(np.linspace(log_f.max(), log_f.min(), BANDS + 1))
    foot = TOP + PROFILE_HEIGHT + GAP_Y / 2 + RESIDUAL_HEIGHT
    upper = Scale(*HEIGHTS, TOP + PROFILE_HEIGHT, TOP)
    lower = Scale(*RESIDUALS, foot, foot - RESIDUAL_HEIGHT)
    parts: list[str] = []
    for column in range(BANDS):
        left = LEFT + column * (PANEL_WIDTH + GAP_X)
        across = Scale(*SPAN_WIDTHS, left, left + PANEL_WIDTH)
        high, low = limits[column] * (1 + 1e-9), limits[column + 1] * (1 - 1e-9)
        band = known[known["frequency_mhz"].between(low, high)]
        parts += _profile_axes(across, upper, lower, is_first=column == 0)
        said = f"{limits[column + 1]:.2g} to {limits[column]:.2g} MHz"
        parts.append(words(said, across.start, TOP - 8, class_="panel-name"))
        for index, name in enumerate(names):
            rows = band[band["observatory"] == name]
            for values, upward in ((rows["height"], upper), (rows["height"] - rows["fitted"], lower)):
                parts.append(_points(rows["widths"].to_numpy(), values.to_numpy(), across, upward, index))
    for index, name in enumerate(names):
        x = LEFT + 8 + 140 * index
        parts.append(element("path", d=_mark(x, 14.0, index), class_=f"samples s{index % 5}"))
        parts.append(words(name, x + 10, 18, class_="tick"))
    width = LEFT + BANDS * (PANEL_WIDTH + GAP_X)
    parts.append(words("Power / height", 4, TOP + 14, class_="axis-name"))
    parts.append(words("less fit", 4, foot - RESIDUAL_HEIGHT + 14, class_="axis-name"))
    said = "Time after the half-rise, in widths of the rise"
    parts.append(words(said, (LEFT + width) / 2, foot + 36, class_="axis-name", text_anchor="middle"))
    title = "Light curves of all channels on the profile that they share, in four bands of frequency, and residuals."
    return figure("shared-profile", (width, foot + FOOT), title, *parts)


def shared_profile_caption() -> str:
    """What the figure of the shared profile shows, for a file of its own."""
    return (
        "Light curves of a Type III burst at all channels, shifted and stretched onto the profile that they share, in "
        "four bands of frequency; below, less the profile. On one line where all spacecraft saw the same burst."
    )


def _profile_axes(across: Scale, upper: Scale, lower: Scale, *, is_first: bool) -> Iterator[str]:
    for upward, ticks, level in ((upper, (0.0, 0.5, 1.0), LEVEL), (lower, (-0.1, 0.0, 0.1), 0.0)):
        for tick in ticks:
            y = float(upward(tick))
            yield line(across.start, y, across.end, y, class_="gridline" if tick != level else "axis")
            if is_first:
                said = f"{tick:g}".replace("-", "\N{MINUS SIGN}")
                yield words(said, across.start - 6, y + 4, class_="tick", text_anchor="end")
    for tick in across.ticks(6):
        x = float(across(tick))
        yield line(x, lower.start, x, lower.start + 4, class_="axis")
        said = f"{tick:g}".replace("-", "\N{MINUS SIGN}")
        yield words(said, x, lower.start + 17, class_="tick", text_anchor="middle")


def _points(widths: FloatArray, values: FloatArray, across: Scale, upward: Scale, index: int) -> str:
    """Samples of a spacecraft as one path; those outside the panel are left out."""
    low, high = sorted((upward.low, upward.high))
    shown = (widths >= across.low) & (widths <= across.high) & (values >= low) & (values <= high)
    places = np.column_stack([across(widths), upward(values)])[shown]
    return element("path", d="".join(_mark(x, y, index) for x, y in places), class_=f"samples s{index % 5}")


def _mark(x: float, y: float, index: int) -> str:
    """Marker of a spacecraft as part of a path: a point, a plus, a cross, a bar or a dash."""
    tails = ("h0", "m-2.5 0h5m-2.5-2.5v5", "m-2-2l4 4m0-4l-4 4", "m0-2.5v5", "m-2.5 0h5")
    return f"M{number(x)} {number(y)}{tails[index % len(tails)]}"


def write_edge_figures(
    folder: Path, spectra: Mapping[str, xr.Dataset], timed: TimedBurst, arrivals: pd.DataFrame | None
) -> None:
    """Write ``aligned.svg``, ``light_curves.svg`` and, where there is a shared profile, ``shared_profile.svg``.

    Parameters
    ----------
    folder : Path
        Is made when it does not exist.
    spectra : mapping of str to xarray.Dataset
        By observatory.
    arrivals : pandas.DataFrame or None
        Arrival table to draw beside the edges of the channels.
    """
    names = list(dict.fromkeys(timed.edges["observatory"]))
    shown = {
        name: one if one.attrs["quantity"] == "relative_flux" else over_background(one)
        for name, one in spectra.items()
        if name in names
    }
    utc = np.array([timed.reference_utc])
    from_sun_s = {name: float(light_time_s(name, utc, np.zeros(3))[0]) for name in names}
    edges = timed.edges[timed.edges["flag"] == ""]
    drawn = {str(edge): rows for edge, rows in edges.groupby("edge", sort=False)}
    if arrivals is not None:
        drawn["arrival table"] = arrivals
    earlier = {name: -one for name, one in from_sun_s.items()}
    aligned = spectra_figure(xr.DataTree.from_dict(shown), drawn, SpectraView(clock="sun", shift_s=earlier))
    write_figure(folder / "aligned.svg", aligned, Caption(spectra_caption("sun")))
    if timed.collapsed:
        profile = shared_profile_figure(collapsed_samples(timed.collapsed))
        write_figure(folder / "shared_profile.svg", profile, Caption(shared_profile_caption()))
    rows = np.unique(timed.edges.loc[timed.edges["flag"] == "", "frequency_mhz"])
    chosen = rows[np.linspace(0, rows.size - 1, min(MOST_CHANNELS, rows.size)).astype(int)][::-1]
    curves = light_curves_figure(shown, timed.edges, chosen.tolist())
    write_figure(folder / "light_curves.svg", curves, Caption(light_curves_caption()))

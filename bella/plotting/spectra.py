"""Dynamic spectra of all spacecraft, one above the other, with the edges that were timed drawn on them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from bella.plotting.svg import (
    FREQUENCY_TICKS_MHZ,
    INTENSITY,
    WEAK_STRETCH,
    Scale,
    edge_class,
    edge_name,
    element,
    figure,
    line,
    path,
    picture,
    time_of_day,
    unix_s,
    words,
)
from bella.spacecraft import OBSERVATORIES
from bella.units import DAY_S, FloatArray

Clock = Literal["spacecraft", "sun", "earth"]
"""On whose clock the spectra stand: as each spacecraft received them, or as light left the Sun, or came to Earth."""

CLOCK_NAMES: dict[Clock, str] = {
    "spacecraft": "UTC at each spacecraft",
    "sun": "UTC at the Sun: less the light time to each spacecraft",
    "earth": "UTC at Earth: less the light time to each spacecraft, with that to Earth",
}

MAX_RECORDS = 600
MAX_CHANNELS = 240
BAND_MARGIN = 1.3
BEFORE_S, AFTER_SHARE = 180.0, 0.6
"""Time shown before the first edge, and after the last one as a share of the time between them."""

WIDTH, LEFT, RIGHT, TOP, BOTTOM, GAP = 620.0, 46.0, 8.0, 22.0, 42.0, 24.0
HEIGHT = 560.0
PICTURE_ROWS = 120

QUANTITY_NAMES = {
    "db_over_background": "dB over background",
    "voltage_ratio": "voltage ratio",
    "psd_v2_hz": "V²/Hz",
    "flux_w_m2_hz": "W m⁻² Hz⁻¹",
    "relative_flux": "flux / maximum",
}


@dataclass(frozen=True)
class Panel:
    """One dynamic spectrum thinned to what a screen can show."""

    observatory: str
    time: npt.NDArray[np.datetime64]
    frequency_mhz: FloatArray
    intensity: FloatArray
    quantity: str


@dataclass(frozen=True)
class TimedEdge:
    """Arrival times of one edge definition at one observatory, shape (F,) each."""

    frequency_mhz: FloatArray
    time: npt.NDArray[np.datetime64]
    sigma_s: FloatArray


Edges = Mapping[str, Mapping[str, TimedEdge]]


@dataclass(frozen=True)
class SpectraView:
    """What of spectra is shown.

    Attributes
    ----------
    clock : str
        Whose time the shifts make.
    shift_s : mapping of str to float
        Seconds that are added to the times of a spacecraft.
    span_s : (float, float) or None
        Seconds since 1970; without it, around the edges.
    band_mhz : (float, float) or None
        Without it, around the edges.
    frequency_mhz : float or None
        Marked by a line.
    """

    clock: Clock = "spacecraft"
    shift_s: Mapping[str, float] = field(default_factory=dict)
    span_s: tuple[float, float] | None = None
    band_mhz: tuple[float, float] | None = None
    frequency_mhz: float | None = None


def spectra_figure(spectra: xr.DataTree, arrivals: Mapping[str, pd.DataFrame | xr.Dataset], look: SpectraView) -> str:
    """Figure of the spectra of one burst, SVG.

    Parameters
    ----------
    spectra : xarray.DataTree
        One child per observatory, each a DynamicSpectrum.
    arrivals : mapping of str to pandas.DataFrame or xarray.Dataset
        Edge definition to its arrival table, or to a posterior that holds ``arrival_s``.
    """
    shift = look.shift_s
    panels = [_shifted_panel(panel, shift.get(panel.observatory, 0.0)) for panel in burst_panels(spectra)]
    edges = {
        edge: {name: _shifted_edge(one, shift.get(name, 0.0)) for name, one in timed_edges(table).items()}
        for edge, table in arrivals.items()
    }
    time = Scale(*(look.span_s or shown_span(panels, edges)), LEFT, WIDTH - RIGHT)
    low, high = look.band_mhz or shown_band(panels, edges.values())
    count = max(len(panels), 1)
    height = (HEIGHT - TOP - BOTTOM - GAP * (count - 1)) / count
    tops = [TOP + row * (height + GAP) for row in range(count)]
    scales = [Scale(low, high, top + height, top, is_log=True) for top in tops]
    drawn = [
        part
        for panel, scale in zip(panels, scales, strict=False)
        for part in _panel_parts(panel, edges, time, scale, look.frequency_mhz)
    ]
    names = ", ".join(panel.observatory for panel in panels)
    title = f"Dynamic spectra of {names} on a common time axis, with the timed edges drawn on them."
    return figure(
        "spectra",
        (WIDTH, HEIGHT),
        title,
        *drawn,
        *_time_axis(time, HEIGHT - BOTTOM, CLOCK_NAMES[look.clock]),
        data_time=f"{time.low:.3f},{time.high:.3f}",
        data_band=f"{low:.5g},{high:.5g}",
        data_across=f"{LEFT:g},{WIDTH - RIGHT:g}",
        data_tops=",".join(f"{top:.1f}" for top in tops),
        data_height=f"{height:.1f}",
        data_names=",".join(panel.observatory for panel in panels),
    )


def _shifted_panel(panel: Panel, shift_s: float) -> Panel:
    return replace(panel, time=panel.time + np.timedelta64(round(shift_s * 1e9), "ns"))


def _shifted_edge(edge: TimedEdge, shift_s: float) -> TimedEdge:
    return replace(edge, time=edge.time + np.timedelta64(round(shift_s * 1e9), "ns"))


def shown_span(panels: Sequence[Panel], edges: Edges) -> tuple[float, float]:
    """Time to show first, seconds since 1970: around the edges, or all where none were timed."""
    ends = [unix_s(panel.time[[0, -1]]) for panel in panels if panel.time.size]
    first, last = (float(np.min(ends)), float(np.max(ends))) if ends else (0.0, DAY_S)
    timed = [unix_s(one.time) for edge in edges.values() for one in edge.values() if one.time.size]
    if timed:
        early, late = float(min(map(np.min, timed))), float(max(map(np.max, timed)))
        first = max(first, early - BEFORE_S)
        last = min(last, late + max(AFTER_SHARE * (late - early), 2 * BEFORE_S))
    return (first, last) if last > first else (first, first + DAY_S)


def shown_band(panels: Sequence[Panel], edges: Iterable[Mapping[str, TimedEdge]]) -> tuple[float, float]:
    """Frequencies to show first: those that were timed with a margin, or all where none were.

    Parameters
    ----------
    edges : iterable of mapping
        Arrival times per observatory, one mapping per definition of the edge.

    Returns
    -------
    low, high : float
        MHz.
    """
    timed = [points.frequency_mhz for edge in edges for points in edge.values() if points.frequency_mhz.size]
    if timed:
        channels = np.concatenate(timed)
        return float(channels.min()) / BAND_MARGIN, float(channels.max()) * BAND_MARGIN
    channels = np.concatenate([panel.frequency_mhz for panel in panels] or [np.array([0.1, 10.0])])
    return float(channels.min()) / BAND_MARGIN, float(channels.max()) * BAND_MARGIN


def burst_panels(spectra: xr.DataTree) -> list[Panel]:
    """Spectra of a burst, Wind first, thinned where they are larger than a screen."""
    names = sorted(spectra.children, key=lambda name: (_rank(name), name))
    return [_panel(name, spectra[name].to_dataset()) for name in names]


def _rank(observatory: str) -> int:
    return OBSERVATORIES.index(observatory) if observatory in OBSERVATORIES else len(OBSERVATORIES)


def timed_edges(table: pd.DataFrame | xr.Dataset) -> dict[str, TimedEdge]:
    """Arrival times per observatory, from an arrival table or from a posterior."""
    if isinstance(table, xr.Dataset):
        return {str(name): _edge_of_posterior(table.sel(observatory=name)) for name in table["observatory"].to_numpy()}
    return {
        str(name): TimedEdge(
            rows["frequency_mhz"].to_numpy(np.float64),
            rows["arrival_utc"].to_numpy("datetime64[ns]"),
            rows["sigma_s"].to_numpy(np.float64),
        )
        for name, rows in table.sort_values("frequency_mhz").groupby("observatory", sort=False)
    }


def _edge_of_posterior(posterior: xr.Dataset) -> TimedEdge:
    start = np.datetime64(str(posterior.attrs["reference_time"]).removesuffix("Z"), "ns")
    seconds = posterior["arrival_s"].to_numpy().astype(np.float64)
    received = np.isfinite(seconds)
    time = start + (seconds[received] * 1e9).astype("timedelta64[ns]")
    frequency = posterior["frequency"].to_numpy().astype(np.float64)
    return TimedEdge(frequency[received], time, posterior["sigma_s"].to_numpy().astype(np.float64)[received])


def _panel(observatory: str, spectrum: xr.Dataset) -> Panel:
    steps = {
        "time": -(-spectrum.sizes["time"] // MAX_RECORDS),
        "frequency": -(-spectrum.sizes["frequency"] // MAX_CHANNELS),
    }
    thinned = spectrum[["intensity"]]
    if max(steps.values()) > 1:
        thinned = thinned.coarsen(steps, boundary="pad").max()
    return Panel(
        observatory,
        thinned["time"].to_numpy().astype("datetime64[ns]"),
        thinned["frequency"].to_numpy().astype(np.float64),
        thinned["intensity"].transpose("frequency", "time").to_numpy().astype(np.float64),
        str(spectrum.attrs.get("quantity", "")),
    )


def _colour_range(panel: Panel) -> tuple[float, float]:
    """From the median, which is the quiet sky, to nearly the brightest."""
    finite = panel.intensity[np.isfinite(panel.intensity)]
    if finite.size == 0:
        return 0.0, 1.0
    low, high = np.quantile(finite, [0.25, 0.995])
    return float(low), float(high) if high > low else float(low) + 1.0


def sampled(panel: Panel, time: Scale, frequency: Scale) -> FloatArray:
    """Share of the colour range in each cell of a picture, the highest frequency on top; NaN where there is no data."""
    low, high = _colour_range(panel)
    seconds, rows = unix_s(panel.time), np.geomspace(frequency.high, frequency.low, PICTURE_ROWS)
    columns = np.linspace(time.low, time.high, 2 * int(abs(time.end - time.start) / 2))
    near, record_s = _nearest(seconds, columns), float(np.median(np.diff(seconds))) if seconds.size > 1 else 60.0
    channel = _nearest(np.log(panel.frequency_mhz), np.log(rows))
    ratio = np.abs(np.log(panel.frequency_mhz[channel] / rows))
    steps = np.diff(np.log(panel.frequency_mhz))
    widest = float(steps.max()) if steps.size else 0.3
    values = (panel.intensity[np.ix_(channel, near)] - low) / (high - low)
    values[:, np.abs(seconds[near] - columns) > 0.75 * record_s] = np.nan
    values[ratio > min(max(widest, 0.02), 0.35), :] = np.nan
    return np.asarray(values)


def _nearest(ascending: FloatArray, wanted: FloatArray) -> npt.NDArray[np.intp]:
    if ascending.size < 2:
        return np.zeros(wanted.size, dtype=np.intp)
    return np.searchsorted(0.5 * (ascending[1:] + ascending[:-1]), wanted)


def _panel_parts(
    panel: Panel, edges: Edges, time: Scale, frequency: Scale, frequency_mhz: float | None
) -> Iterator[str]:
    top, bottom, width = frequency.end, frequency.start, time.end - time.start
    box = {"x": time.start, "y": top, "width": width, "height": bottom - top}
    yield element("rect", **box, class_="no-data")
    yield picture(sampled(panel, time, frequency), INTENSITY, WEAK_STRETCH, **box)
    for tick in frequency.among(FREQUENCY_TICKS_MHZ):
        y = float(frequency(tick))
        yield line(time.start - 4, y, time.start, y, class_="axis")
        yield words(f"{tick:g}", time.start - 7, y + 4, class_="tick", text_anchor="end")
    unit = QUANTITY_NAMES.get(panel.quantity, panel.quantity)
    yield words(f"{panel.observatory}", time.start, top - 6, class_="panel-name")
    yield words(f"MHz · {unit}", time.end, top - 6, class_="panel-unit", text_anchor="end")
    inner = [
        _edge_parts(edge, timed[panel.observatory], time, frequency)
        for edge, timed in edges.items()
        if panel.observatory in timed
    ]
    yield element("g", *(part for parts in inner for part in parts), class_="edges")
    y = float(frequency(frequency_mhz)) if frequency_mhz is not None and frequency.holds(frequency_mhz) else -9.0
    yield line(time.start, y, time.end, y, class_="frequency")


def _edge_parts(edge: str, points: TimedEdge, time: Scale, frequency: Scale) -> Iterator[str]:
    seconds = unix_s(points.time)
    shown = (seconds >= time.low) & (seconds <= time.high)
    shown &= (points.frequency_mhz >= frequency.low) & (points.frequency_mhz <= frequency.high)
    if not shown.any():
        return
    places = np.column_stack([time(seconds), frequency(points.frequency_mhz)])
    places[~shown] = np.nan
    said = element("title", f"{edge_name(edge)}: the times that were used")
    yield element("g", said, path(places, class_="edge-under"), path(places, class_=f"edge-line {edge_class(edge)}"))


def _time_axis(time: Scale, top: float, name: str) -> Iterator[str]:
    ticks = time.time_ticks()
    step = ticks[1] - ticks[0] if len(ticks) > 1 else 60.0
    for index, tick in enumerate(ticks):
        x = float(time(tick))
        yield line(x, top, x, top + 5, class_="axis")
        kind = "tick" if index % 2 == 0 else "tick wide"
        yield words(time_of_day(tick, step), min(x, time.end - 10.0), top + 19, class_=kind, text_anchor="middle")
    day = str(np.datetime64(round(time.low), "s").astype("datetime64[D]"))
    yield words(f"{day}, {name}", 0.5 * (time.start + time.end), top + 37, class_="axis-name", text_anchor="middle")


def spectra_caption(clock: Clock) -> str:
    """What the figure of the spectra shows, for a file of its own."""
    return f"Dynamic spectra of a Type III burst with the arrival times that were used; {CLOCK_NAMES[clock]}."

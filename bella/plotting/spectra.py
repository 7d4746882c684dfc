"""Dynamic spectra of all spacecraft, one above the other, with the edges that were timed drawn on them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from bella.plotting.listing import listed, significant, stamps
from bella.plotting.palette import FREQUENCY_TICKS_MHZ, INK, INTENSITY_SCALE, TrackStyle, edge_name, track_style
from bella.spacecraft import OBSERVATORIES
from bella.units import FloatArray

MAX_RECORDS = 600
MAX_CHANNELS = 240
POINTS_PER_EDGE = 16
BAND_MARGIN = 1.3
NO_DATA = "rgba(110,125,140,0.3)"
PANEL_GAP = 0.035
TOP_PX = 72
"""Room above the panels for the legend, and above that for the toolbar."""

QUANTITY_NAMES = {
    "db_over_background": "dB over background",
    "voltage_ratio": "voltage ratio",
    "psd_v2_hz": "V²/Hz",
    "flux_w_m2_hz": "W m⁻² Hz⁻¹",
    "relative_flux": "flux / maximum",
}


@dataclass(frozen=True)
class Panel:
    """One dynamic spectrum thinned to what a screen can show.

    Attributes
    ----------
    observatory : str
    time : ndarray of datetime64, shape (T,)
    frequency_mhz : ndarray, shape (F,)
    intensity : ndarray, shape (F, T)
    quantity : str
    """

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


def spectra_figure(spectra: xr.DataTree, arrivals: Mapping[str, pd.DataFrame | xr.Dataset]) -> dict[str, Any]:
    """Plotly figure of the spectra of one burst.

    Parameters
    ----------
    spectra : xarray.DataTree
        One child per observatory, each a DynamicSpectrum.
    arrivals : mapping of str to pandas.DataFrame or xarray.Dataset
        Edge definition to its arrival table, or to a posterior that holds ``arrival_s``.

    Returns
    -------
    dict
        ``data`` and ``layout``, only lists, numbers, text and None. Edges name their definition in ``legendgroup``.
    """
    panels = burst_panels(spectra)
    edges = {edge: timed_edges(table) for edge, table in arrivals.items()}
    traces = [_heatmap(panel, row) for row, panel in enumerate(panels)]
    for index, (edge, timed) in enumerate(edges.items()):
        drawn = [(row, timed[panel.observatory]) for row, panel in enumerate(panels) if panel.observatory in timed]
        for place, (row, points) in enumerate(drawn):
            traces.append(_edge_trace(edge, points, row, track_style(edge, index), in_legend=place == 0))
    return {"data": traces, "layout": _layout(panels, shown_band(panels, edges.values()))}


def shown_band(panels: Sequence[Panel], edges: Iterable[Mapping[str, TimedEdge]]) -> tuple[float, float]:
    """Frequencies to show first: those that were timed with a margin, or all where none were.

    Parameters
    ----------
    panels : sequence of Panel
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
    return float(channels.min()), float(channels.max())


def burst_panels(spectra: xr.DataTree) -> list[Panel]:
    """Spectra of a burst, Wind first, thinned where they are larger than a screen.

    Parameters
    ----------
    spectra : xarray.DataTree

    Returns
    -------
    list of Panel
    """
    names = sorted(spectra.children, key=lambda name: (_rank(name), name))
    return [_panel(name, spectra[name].to_dataset()) for name in names]


def _rank(observatory: str) -> int:
    return OBSERVATORIES.index(observatory) if observatory in OBSERVATORIES else len(OBSERVATORIES)


def timed_edges(table: pd.DataFrame | xr.Dataset) -> dict[str, TimedEdge]:
    """Arrival times per observatory, from an arrival table or from a posterior.

    Parameters
    ----------
    table : pandas.DataFrame or xarray.Dataset

    Returns
    -------
    dict of str to TimedEdge
    """
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
    heard = np.isfinite(seconds)
    time = start + (seconds[heard] * 1e9).astype("timedelta64[ns]")
    frequency = posterior["frequency"].to_numpy().astype(np.float64)
    return TimedEdge(frequency[heard], time, posterior["sigma_s"].to_numpy().astype(np.float64)[heard])


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


def _axis_name(letter: str, row: int) -> str:
    return letter if row == 0 else f"{letter}{row + 1}"


def _colour_range(panel: Panel) -> tuple[float, float]:
    """From the median, which is the quiet sky, to nearly the brightest."""
    finite = panel.intensity[np.isfinite(panel.intensity)]
    if finite.size == 0:
        return 0.0, 1.0
    low, high = np.quantile(finite, [0.25, 0.995])
    return float(low), float(high) if high > low else float(low) + 1.0


def _heatmap(panel: Panel, row: int) -> dict[str, Any]:
    low, high = _colour_range(panel)
    unit = QUANTITY_NAMES.get(panel.quantity, panel.quantity)
    scale = max(abs(low), abs(high))
    digits = max(0, 3 - int(np.floor(np.log10(scale)))) if scale > 0 else 3
    return {
        "type": "heatmap",
        "name": panel.observatory,
        "x": stamps(panel.time),
        "y": significant(panel.frequency_mhz, 5),
        "z": listed(panel.intensity, digits),
        "zmin": low,
        "zmax": high,
        "colorscale": INTENSITY_SCALE,
        "showscale": False,
        "xaxis": "x",
        "yaxis": _axis_name("y", row),
        "hovertemplate": f"<b>{panel.observatory}</b><br>%{{x|%H:%M:%S}} UTC<br>%{{y:.3f}} MHz<br>%{{z:.3g}} {unit}"
        "<extra></extra>",
        "meta": {"role": "spectrum", "observatory": panel.observatory},
    }


def _edge_trace(edge: str, points: TimedEdge, row: int, style: TrackStyle, *, in_legend: bool) -> dict[str, Any]:
    kept = np.unique(np.linspace(0, len(points.time) - 1, POINTS_PER_EDGE).astype(np.intp))
    kept = kept[kept >= 0]
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "name": edge_name(edge),
        "x": stamps(points.time[kept]),
        "y": significant(points.frequency_mhz[kept], 5),
        "customdata": listed(points.sigma_s[kept], 1),
        "line": {"color": style.colour, "width": 2.5},
        "marker": {"symbol": style.symbol, "size": 6, "color": style.colour, "line": {"color": "#fff", "width": 1}},
        "xaxis": "x",
        "yaxis": _axis_name("y", row),
        "hovertemplate": f"<b>{edge_name(edge)}</b><br>%{{x|%H:%M:%S}} ± %{{customdata}} s<br>%{{y:.3g}} MHz"
        "<extra></extra>",
        "legendgroup": edge,
        "showlegend": in_legend,
        "meta": {"role": "edge", "edge": edge},
    }


def _layout(panels: list[Panel], band: tuple[float, float]) -> dict[str, Any]:
    count = max(len(panels), 1)
    height = (1.0 - PANEL_GAP * (count - 1)) / count
    bottoms = [1.0 - (row + 1) * height - row * PANEL_GAP for row in range(count)]
    axes = {
        f"yaxis{'' if row == 0 else row + 1}": _frequency_axis(bottom, height, row, band)
        for row, bottom in enumerate(bottoms)
    }
    return {
        **axes,
        "xaxis": {
            "type": "date",
            "title": {"text": _day(panels)},
            "anchor": _axis_name("y", count - 1),
            "hoverformat": "%H:%M:%S",
            "tickformat": "%H:%M",
            "ticks": "outside",
            "showgrid": False,
            **_common_time(panels),
        },
        "annotations": list(_panel_names(panels, bottoms, height)),
        "legend": {"orientation": "h", "x": 0.0, "y": 1.01, "yanchor": "bottom", "groupclick": "togglegroup"},
        "margin": {"l": 56, "r": 10, "t": TOP_PX, "b": 50},
        "hovermode": "closest",
        "dragmode": "zoom",
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": INK},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": NO_DATA,
        "hoverlabel": {"align": "left"},
        "uirevision": "keep",
    }


def _frequency_axis(bottom: float, height: float, row: int, band: tuple[float, float]) -> dict[str, Any]:
    axis = {
        "type": "log",
        "range": listed(np.log10(band), 4),
        "domain": [round(max(bottom, 0.0), 4), round(min(bottom + height, 1.0), 4)],
        "title": {"text": "MHz"},
        "tickvals": list(FREQUENCY_TICKS_MHZ),
        "ticktext": [f"{frequency:g}" for frequency in FREQUENCY_TICKS_MHZ],
        "ticks": "outside",
        "showgrid": False,
        "zeroline": False,
    }
    return axis if row == 0 else {**axis, "matches": "y"}


def _day(panels: list[Panel]) -> str:
    days = sorted({str(panel.time[0].astype("datetime64[D]")) for panel in panels if panel.time.size})
    return f"UTC on {days[0]}" if days else "UTC"


def _common_time(panels: list[Panel]) -> dict[str, Any]:
    shown = [panel.time for panel in panels if panel.time.size]
    if not shown:
        return {}
    ends = np.array([max(time[0] for time in shown), min(time[-1] for time in shown)])
    return {"range": stamps(ends)} if ends[0] < ends[1] else {}


def _panel_names(panels: list[Panel], bottoms: list[float], height: float) -> Iterator[dict[str, Any]]:
    for panel, bottom in zip(panels, bottoms, strict=False):
        yield {
            "text": f"<b>{panel.observatory}</b>  {QUANTITY_NAMES.get(panel.quantity, panel.quantity)}",
            "xref": "paper",
            "yref": "paper",
            "x": 0.995,
            "y": round(bottom + height - 0.012, 4),
            "xanchor": "right",
            "yanchor": "top",
            "showarrow": False,
            "bgcolor": "rgba(15,25,40,0.72)",
            "borderpad": 3,
            "font": {"color": "#ffffff", "size": 11.5},
        }

"""The constellation: Sun, spacecraft, tracks with their credible regions, and the spiral behind them.

Seen from ecliptic north with the Earth to the right: HEE X to the right, HEE Y up, solar radii.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from bella.answer import wind_gap, written_68, written_wind
from bella.flags import APPARENT_SOURCE
from bella.plotting.geometry import (
    SPIRAL_POINTS,
    PolarTrack,
    TrackView,
    fitted_spiral,
    name_places,
    nearest_index,
    polar_track,
    receiver_positions,
    region_outline,
    speed_remark,
    spread_indices,
)
from bella.plotting.listing import listed, significant
from bella.plotting.palette import (
    FAINT,
    FREQUENCY_SCALE,
    FREQUENCY_TICKS_MHZ,
    INK,
    SPACECRAFT,
    SUN,
    TrackStyle,
    edge_name,
    track_style,
)
from bella.plotting.spiral_band import PERCENTS, band_outline, spiral_band
from bella.units import AU_RSUN, FloatArray

REGIONS_PER_TRACK = 6
BAND_POINTS = 40
RINGS_AU = (0.25, 0.5, 0.75, 1.0)
NAMED_RINGS_AU = (0.5, 1.0)


def constellation_figure(tracks: Sequence[TrackView]) -> dict[str, Any]:
    """Plotly figure of the constellation.

    Parameters
    ----------
    tracks : sequence of TrackView
        In the order of the legend, the first one drawn above the others; may be empty.

    Returns
    -------
    dict
        ``data`` and ``layout``, only lists, numbers, text and None. Every trace of a track names it in ``legendgroup``
        (its edge) and says in ``meta`` what it is: ``{"role": "track" | "anchor" | "region" | "selected" | "spiral" |
        "spiral_band"}``, regions with their ``percent`` and ``frequency_mhz``.
    """
    traces = [*_surroundings(tracks)]
    styled = [(track, track_style(track.edge, index)) for index, track in enumerate(tracks)]
    for layer in (_band_traces, _region_traces, _spiral_traces, _selected_traces, _point_traces):
        for track, style in reversed(styled):
            traces.extend(layer(track, style))
    traces += [trace for track, style in styled for trace in _legend_trace(track, style)]
    if tracks:
        traces.append(_colour_bar(tracks))
    return {"data": traces, "layout": _layout(tracks)}


def selected_regions(posterior: Any, frequency_mhz: float) -> dict[str, Any]:
    """Numbers and outlines of the one channel nearest to a frequency.

    Parameters
    ----------
    posterior : xarray.Dataset
    frequency_mhz : float

    Returns
    -------
    dict
        ``frequency_mhz, x_rsun, y_rsun, range_rsun, range_sd_rsun, longitude_deg, longitude_sd_deg, area68_rsun2,
        area95_rsun2, contraction_v, speed, region68, region95``; a region is ``{"x": [...], "y": [...]}`` with None
        between its polygons.
    """
    track = polar_track(posterior)
    index = nearest_index(track.frequency_mhz, frequency_mhz)
    contraction = float(posterior["contraction_v"][index])
    numbers = {
        "frequency_mhz": significant([track.frequency_mhz[index]], 5)[0],
        "x_rsun": listed(track.x_rsun[index : index + 1])[0],
        "y_rsun": listed(track.y_rsun[index : index + 1])[0],
        "range_rsun": listed(track.range_rsun[index : index + 1])[0],
        "range_sd_rsun": listed(track.range_sd_rsun[index : index + 1])[0],
        "longitude_deg": listed(track.longitude_deg[index : index + 1])[0],
        "longitude_sd_deg": listed(track.longitude_sd_deg[index : index + 1])[0],
        "area68_rsun2": significant([float(posterior["area68_rsun2"][index])])[0],
        "area95_rsun2": significant([float(posterior["area95_rsun2"][index])])[0],
        "contraction_v": listed([contraction], 3)[0],
        "speed": speed_remark(contraction),
    }
    return numbers | {f"region{p}": _xy(region_outline(posterior, index, p)) for p in (68, 95)}


def _reach(tracks: Sequence[TrackView]) -> float:
    """Half width of the view: what is farthest out, with room for its name."""
    radii = [AU_RSUN]
    for track in tracks:
        radii += [float(np.hypot(*position[:2])) for position in receiver_positions(track.posterior).values()]
    return 1.14 * float(np.nanmax(radii))


def _xy(points: FloatArray, digits: int = 1) -> dict[str, Any]:
    return {"x": listed(points[:, 0], digits), "y": listed(points[:, 1], digits)}


def _circle(radius: float) -> FloatArray:
    angle = np.linspace(0.0, 2 * np.pi, 121)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _surroundings(tracks: Sequence[TrackView]) -> Iterator[dict[str, Any]]:
    quiet = {"type": "scatter", "mode": "lines", "hoverinfo": "skip", "showlegend": False}
    for ring in RINGS_AU:
        line = {"color": FAINT, "width": 1.4 if ring == 1.0 else 0.8}
        yield {**quiet, **_xy(_circle(ring * AU_RSUN)), "line": line, "meta": {"role": "ring"}}
    yield {
        "type": "scatter",
        "mode": "markers+text",
        "name": "Sun",
        "x": [0.0],
        "y": [0.0],
        "text": ["Sun"],
        "textposition": "middle left",
        "textfont": {"size": 12},
        "marker": {"size": 15, "color": SUN, "line": {"color": "#a87b00", "width": 1}},
        "hovertemplate": "Sun<extra></extra>",
        "showlegend": False,
        "meta": {"role": "sun"},
    }
    if tracks:
        yield _spacecraft_trace(tracks)


def _spacecraft_trace(tracks: Sequence[TrackView]) -> dict[str, Any]:
    positions: dict[str, FloatArray] = {}
    for track in tracks:
        positions = {**receiver_positions(track.posterior), **positions}
    where = np.array(list(positions.values()))
    distance = np.linalg.norm(where, axis=1) / AU_RSUN
    longitude = np.degrees(np.arctan2(where[:, 1], where[:, 0]))
    return {
        "type": "scatter",
        "mode": "markers+text",
        "name": "Spacecraft",
        **_xy(where),
        "text": list(positions),
        "textposition": name_places(where),
        "textfont": {"size": 12.5},
        "customdata": [list(row) for row in zip(listed(distance, 3), listed(longitude, 1), strict=True)],
        "hovertemplate": "<b>%{text}</b><br>%{customdata[0]} au, HEE longitude %{customdata[1]}°<extra></extra>",
        "marker": {"size": 12, "symbol": "triangle-up", "color": SPACECRAFT, "line": {"color": "#ffffff", "width": 1}},
        "showlegend": False,
        "cliponaxis": False,
        "meta": {"role": "spacecraft"},
    }


def _member(track: TrackView, role: str, **more: Any) -> dict[str, Any]:
    """Say which track a trace belongs to and what it is, so that a page can find it again."""
    return {"legendgroup": track.edge, "showlegend": False, "meta": {"role": role, "edge": track.edge, **more}}


def _region_traces(track: TrackView, style: TrackStyle) -> Iterator[dict[str, Any]]:
    polar = polar_track(track.posterior)
    for percent, fill, line in ((95, 0.0, 0.28), (68, 0.07, 0.0)):
        for index in spread_indices(polar, REGIONS_PER_TRACK):
            frequency = significant([polar.frequency_mhz[index]])[0]
            yield {
                "type": "scatter",
                "mode": "lines",
                **_xy(region_outline(track.posterior, int(index), percent)),
                "fill": "toself" if fill else "none",
                "fillcolor": style.shade(fill),
                "line": {"color": style.shade(line), "width": 0.8, "dash": "dot"},
                "name": f"{percent} % region, {frequency} MHz",
                "hoverinfo": "skip",
                **_member(track, "region", percent=percent, frequency_mhz=frequency),
            }


def _selected_traces(track: TrackView, style: TrackStyle) -> Iterator[dict[str, Any]]:
    """Regions of the one selected frequency: at first the middle of the track."""
    frequency = polar_track(track.posterior).frequency_mhz
    index = nearest_index(frequency, float(np.sqrt(frequency[0] * frequency[-1])))
    shown = significant([frequency[index]])[0]
    for percent, fill, line in ((95, 0.10, {"width": 1.5, "dash": "dash"}), (68, 0.22, {"width": 2})):
        yield {
            "type": "scatter",
            "mode": "lines",
            **_xy(region_outline(track.posterior, index, percent)),
            "fill": "toself",
            "fillcolor": style.shade(fill),
            "line": {"color": style.colour, **line},
            "name": f"{percent} % region at {shown} MHz",
            "hoverinfo": "skip",
            **_member(track, "selected", percent=percent, frequency_mhz=shown),
        }


def _spiral_traces(track: TrackView, style: TrackStyle) -> Iterator[dict[str, Any]]:
    spiral = fitted_spiral(track.track_fit, np.linspace(1.0, AU_RSUN, SPIRAL_POINTS))
    if spiral is None:
        return
    fit = track.track_fit["two_step"]
    yield {
        "type": "scatter",
        "mode": "lines",
        **_xy(spiral),
        "line": {"color": style.colour, "width": 1.6, "dash": "longdash"},
        "name": "Parker spiral",
        "hovertemplate": f"<b>Parker spiral</b>, {edge_name(track.edge)}<br>φ₀ {written_68(fit['phi0_deg'])}° at 1 R☉"
        f"<br>{_wind_remark(fit)}<extra></extra>",
        **_member(track, "spiral"),
    }


def _band_traces(track: TrackView, style: TrackStyle) -> Iterator[dict[str, Any]]:
    """Where the spiral of the joint fit lies, by its draws."""
    band = spiral_band(track.posterior, np.linspace(1.0, AU_RSUN, BAND_POINTS))
    if band is None:
        return
    for percent in PERCENTS:
        shape = {"type": "scatter", "mode": "lines", "fill": "toself", "fillcolor": style.shade(0.08)}
        role = _member(track, "spiral_band", percent=percent)
        yield {**shape, **_xy(band_outline(band, percent)), "line": {"width": 0}, "hoverinfo": "skip", **role}


def _wind_remark(fit: Mapping[str, Any]) -> str:
    gap = wind_gap(fit)
    return f"{gap}: no solar wind speed follows" if gap else f"solar wind {written_wind(fit)}"


def _point_traces(track: TrackView, style: TrackStyle) -> Iterator[dict[str, Any]]:
    polar = polar_track(track.posterior)
    place = _xy(np.column_stack([polar.x_rsun, polar.y_rsun]))
    log_frequency = listed(np.log10(polar.frequency_mhz), 3)
    yield {
        "type": "scatter",
        "mode": "lines",
        **place,
        "line": {"color": style.colour, "width": 8},
        "name": track.label,
        "hoverinfo": "skip",
        **_member(track, "band"),
    }
    yield {
        "type": "scatter",
        "mode": "markers",
        **place,
        "marker": {"size": 4.5, "color": log_frequency, "coloraxis": "coloraxis"},
        "name": track.label,
        "text": _hover_lines(track, polar),
        "hovertemplate": f"<b>{track.label}</b><br>%{{text}}<extra></extra>",
        **_member(track, "track"),
    }
    yield _anchor_trace(track, polar, style)


def _anchor_trace(track: TrackView, polar: PolarTrack, style: TrackStyle) -> dict[str, Any]:
    """The channels whose regions are drawn, with the marker that tells the tracks apart."""
    anchors = spread_indices(polar, REGIONS_PER_TRACK)
    lines = _hover_lines(track, polar)
    return {
        "type": "scatter",
        "mode": "markers",
        **_xy(np.column_stack([polar.x_rsun[anchors], polar.y_rsun[anchors]])),
        "marker": {
            "size": 9.5,
            "symbol": style.symbol,
            "color": listed(np.log10(polar.frequency_mhz[anchors]), 3),
            "coloraxis": "coloraxis",
            "line": {"color": style.colour, "width": 2.2},
        },
        "name": track.label,
        "text": [lines[index] for index in anchors],
        "hovertemplate": f"<b>{track.label}</b><br>%{{text}}<extra></extra>",
        **_member(track, "anchor"),
    }


def _legend_trace(track: TrackView, style: TrackStyle) -> Iterator[dict[str, Any]]:
    """Entry of the legend; a marker coloured by frequency would show as black there."""
    yield {
        "type": "scatter",
        "mode": "lines+markers",
        "x": [None],
        "y": [None],
        "line": {"color": style.colour, "width": 5},
        "marker": {"size": 11, "symbol": style.symbol, "color": style.colour},
        "name": track.label,
        **_member(track, "legend"),
        "showlegend": True,
    }


def _hover_lines(track: TrackView, polar: PolarTrack) -> list[str]:
    area = track.posterior["area68_rsun2"].to_numpy()
    contraction = track.posterior["contraction_v"].to_numpy()
    return [
        f"{polar.frequency_mhz[i]:.3g} MHz<br>{_from_sd(polar.range_rsun[i], polar.range_sd_rsun[i])} R☉<br>"
        f"longitude {_from_sd(polar.longitude_deg[i], polar.longitude_sd_deg[i])}°<br>"
        f"68 % area {area[i]:.0f} R☉²<br>{speed_remark(float(contraction[i]))}"
        for i in range(len(area))
    ]


def _from_sd(middle: float, sd: float) -> str:
    return written_68({"mean": float(middle), "sd": float(sd)})


def _colour_bar(tracks: Sequence[TrackView]) -> dict[str, Any]:
    """Marker without a place: the first trace with a colour scale owns the bar, whichever track is switched off."""
    ends = _log_ends(tracks)
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [None],
        "y": [None],
        "marker": {"color": [ends[0]], "coloraxis": "coloraxis"},
        "hoverinfo": "skip",
        "showlegend": False,
        "meta": {"role": "scale", "log_frequency": list(ends)},
    }


def _log_ends(tracks: Sequence[TrackView]) -> tuple[float, float]:
    channels = np.concatenate([track.posterior["frequency"].to_numpy() for track in tracks])
    return float(np.log10(channels.min())), float(np.log10(channels.max()))


def _layout(tracks: Sequence[TrackView]) -> dict[str, Any]:
    reach = _reach(tracks)
    axis = {"range": [-reach, reach], "zeroline": False, "showgrid": False, "ticks": "outside", "nticks": 7}
    ticks = {"tickvals": listed(np.log10(FREQUENCY_TICKS_MHZ), 4), "ticktext": [f"{f:g}" for f in FREQUENCY_TICKS_MHZ]}
    bar = {
        "title": {"text": "MHz ", "side": "right", "font": {"size": 12}},
        "orientation": "h",
        "thickness": 9,
        "len": 0.6,
        "x": 0.5,
        "yref": "container",
        "y": 0.0,
        "yanchor": "bottom",
        "outlinewidth": 0,
        **ticks,
    }
    return {
        "xaxis": {**axis, "title": {"text": "HEE X (R☉), Earth to the right"}, "constrain": "domain"},
        "yaxis": {**axis, "title": {"text": "HEE Y (R☉)"}, "scaleanchor": "x", "constrain": "domain"},
        "coloraxis": {"colorscale": FREQUENCY_SCALE, "colorbar": bar},
        "annotations": list(_ring_names(tracks)),
        "legend": {"orientation": "h", "x": 0.0, "y": 1.01, "yanchor": "bottom", "groupclick": "togglegroup"},
        "margin": {"l": 56, "r": 12, "t": 40, "b": 104},
        "hovermode": "closest",
        "dragmode": "zoom",
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": INK},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "hoverlabel": {"align": "left"},
        "uirevision": "keep",
        "meta": {"remark": APPARENT_SOURCE},
    }


def _ring_names(tracks: Sequence[TrackView]) -> Iterator[dict[str, Any]]:
    """Names of the rings, on the side of the Sun where no track is."""
    means = [(float(t.posterior["x_rsun"].mean()), float(t.posterior["y_rsun"].mean())) for t in tracks] or [
        (-1.0, -1.0)
    ]
    x, y = np.sum(means, axis=0)
    angle = np.arctan2(y, x) + np.pi
    for ring in NAMED_RINGS_AU:
        place = ring * AU_RSUN * np.array([np.cos(angle), np.sin(angle)])
        yield {
            "x": round(float(place[0]), 1),
            "y": round(float(place[1]), 1),
            "text": f"{ring:g} au",
            "showarrow": False,
            "font": {"size": 10.5, "color": "#7b8894"},
        }

"""The constellation: Sun, Earth and spacecraft, the track of a burst with its regions, and the spiral behind it.

Seen from ecliptic north with the Earth to the right: HEE X to the right, HEE Y up, solar radii.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from bella.answer import written_68
from bella.flags import APPARENT_SOURCE
from bella.plotting.ecliptic import (
    NOMINAL_WIND_KM_S,
    SCALE_ROOM,
    SIZE,
    Frame,
    Map,
    bodies,
    nominal_spirals,
    rings,
    spokes,
)
from bella.plotting.geometry import (
    PERCENTS,
    PolarTrack,
    TrackView,
    band_outline,
    nearest_index,
    polar_track,
    receiver_positions,
    region_outline,
    spiral_band,
    spread_indices,
)
from bella.plotting.palette import FREQUENCY_TICKS_MHZ, TrackStyle, edge_name, track_style
from bella.plotting.svg import Scale, colour_at, element, figure, path, words
from bella.records import Interval
from bella.spacecraft import position
from bella.units import AU_RSUN, FloatArray

View = Literal["track", "fleet"]

REGIONS_PER_TRACK = 6
BAND_POINTS = 48

LEAST_HALF_RSUN = 12.0
BEYOND = 1.3
"""Of the distances of a joint fit: what is farther out does not decide what is shown of its track."""


@dataclass(frozen=True)
class MapView:
    """What a map shows.

    Attributes
    ----------
    view : str
        `track`: what the first track needs; `fleet`: all spacecraft.
    frame : str
        Whose longitudes the grid shows.
    frequency_mhz : float or None
        Whose regions stand out.
    sectors : sequence of Interval
        Longitudes at the Sun, drawn where there is no track.
    receivers : mapping of str to ndarray
        HEE, solar radii; of the tracks where they have them.
    """

    view: View = "track"
    frame: Frame = "hee"
    frequency_mhz: float | None = None
    sectors: Sequence[Interval] = ()
    receivers: Mapping[str, FloatArray] = field(default_factory=dict)


def constellation_figure(tracks: Sequence[TrackView], utc: np.datetime64, look: MapView) -> str:
    """Figure of the constellation, SVG.

    Parameters
    ----------
    tracks : sequence of TrackView
        The first one with its regions and its spiral, the others as lines; may be empty.
    utc : numpy.datetime64
        Of Earth, and of the longitudes of a frame.
    look : MapView

    Returns
    -------
    str
    """
    known = dict(look.receivers)
    for track in reversed(tracks):
        known |= receiver_positions(track.posterior)
    earth = position("EARTH", utc)[0]
    chart = _map(tracks, [*known.values(), earth], look.view)
    title = "Map of the inner heliosphere with Sun, Earth, spacecraft, track, credible regions and spiral."
    styled = [(track, track_style(track.edge, index)) for index, track in enumerate(tracks)]
    others = [part for track, style in reversed(styled[1:]) for part in _line_of(track, style, chart)]
    return figure(
        "constellation",
        SIZE,
        title,
        element("rect", x=0, y=0, width=SIZE[0], height=SIZE[1], class_="sky"),
        *rings(chart),
        *spokes(chart, look.frame, utc),
        *nominal_spirals(chart, known),
        *(_sector(chart, one) for one in look.sectors),
        *(part for track, style in styled[:1] for part in _first(track, style, chart, look.frequency_mhz)),
        *others,
        element("circle", cx=chart(np.zeros((1, 2)))[0][0], cy=chart(np.zeros((1, 2)))[0][1], r=7, class_="sun"),
        *bodies(chart, known, earth),
        *(_frequency_scale(tracks[0]) if tracks else ()),
        data_centre=f"{chart.centre[0]:.2f},{chart.centre[1]:.2f}",
        data_per_rsun=f"{chart.per_rsun:.4f}",
    )


def _map(tracks: Sequence[TrackView], bodies: Sequence[FloatArray], view: View) -> Map:
    points = np.array([body[:2] for body in bodies])
    half = 1.1 * float(np.abs(points).max())
    centre = np.zeros(2)
    if view == "track" and tracks:
        shown = np.vstack([np.zeros((1, 2)), *_near(tracks[0])])
        low, high = np.nanmin(shown, axis=0), np.nanmax(shown, axis=0)
        centre, spans = (low + high) / 2, (high - low) / np.array(SIZE) * SIZE[1]
        half = max(0.62 * float(spans.max()), LEAST_HALF_RSUN)
    return Map((float(centre[0]), float(centre[1])), SIZE[1] / (2 * half))


def _near(track: TrackView) -> Iterator[FloatArray]:
    """Positions and 68 % regions of a track, as far as its joint fit goes: single channels may be far out."""
    polar = polar_track(track.posterior)
    profile = (track.track_fit.get("joint") or {}).get("profile") or ()
    far = [one["range_rsun"]["q84"] for one in profile if one["range_rsun"].get("q84") is not None]
    reach = BEYOND * max(far) if far else np.inf
    near = polar.range_rsun <= reach
    yield np.column_stack([polar.x_rsun, polar.y_rsun])[near if near.any() else slice(None)]
    for index in spread_indices(polar, REGIONS_PER_TRACK):
        outline = region_outline(track.posterior, int(index), 68)
        yield outline[np.hypot(*outline.T) <= reach]


def _sector(chart: Map, interval: Interval) -> str:
    """Longitudes at the Sun that a track without positions leaves open."""
    angle = np.radians(np.linspace(interval.low, interval.high, 40))
    arc = AU_RSUN * np.column_stack([np.cos(angle), np.sin(angle)])
    return path(chart(np.vstack([np.zeros((1, 2)), arc])), closed=True, class_="sector")


def _first(track: TrackView, style: TrackStyle, chart: Map, frequency_mhz: float | None) -> Iterator[str]:
    """The track that the map is about: band of its spiral, regions, positions by frequency."""
    polar, name = polar_track(track.posterior), f"edge-{style.name}"
    band = spiral_band(track.posterior, np.linspace(1.0, AU_RSUN, BAND_POINTS))
    if band is not None:
        for percent in PERCENTS:
            yield path(chart(band_outline(band, percent)), closed=True, class_=f"spiral-band p{percent} {name}")
        middle = np.radians(band.median_deg)
        spiral = np.column_stack([band.range_rsun * np.cos(middle), band.range_rsun * np.sin(middle)])
        yield path(chart(spiral), class_=f"spiral {name}")
    for index in spread_indices(polar, REGIONS_PER_TRACK):
        for percent in (95, 68):
            outline = region_outline(track.posterior, int(index), percent)
            yield path(chart(outline), class_=f"region p{percent} {name}")
    chosen = None if frequency_mhz is None else nearest_index(polar.frequency_mhz, frequency_mhz)
    for percent in (95, 68):
        outline = np.empty((0, 2)) if chosen is None else region_outline(track.posterior, chosen, percent)
        yield path(chart(outline) if len(outline) else outline, class_=f"selected p{percent} {name}")
    places = chart(np.column_stack([polar.x_rsun, polar.y_rsun]))
    yield path(places, class_=f"track {name}")
    yield element("g", *_dots(track, polar, places), class_="dots")


def _dots(track: TrackView, polar: PolarTrack, places: FloatArray) -> Iterator[str]:
    ends = np.log(polar.frequency_mhz.min()), np.log(polar.frequency_mhz.max())
    area = track.posterior["area68_rsun2"].to_numpy()
    for index, (x, y) in enumerate(places):
        if not np.isfinite(x):
            continue
        frequency = polar.frequency_mhz[index]
        share = (np.log(frequency) - ends[0]) / (ends[1] - ends[0]) if ends[1] > ends[0] else 0.5
        distance = written_68({"mean": float(polar.range_rsun[index]), "sd": float(polar.range_sd_rsun[index])})
        longitude = written_68({"mean": float(polar.longitude_deg[index]), "sd": float(polar.longitude_sd_deg[index])})
        said = f"{frequency:.3g} MHz: {distance} R\N{SUN}, {longitude}° HEE, 68 % area {area[index]:.0f} R\N{SUN}²"
        yield element(
            "circle",
            element("title", said),
            cx=x,
            cy=y,
            r=4.2,
            fill=colour_at(float(share)),
            data_mhz=f"{frequency:.5g}",
        )


def _line_of(track: TrackView, style: TrackStyle, chart: Map) -> Iterator[str]:
    """Another answer: its positions as a line."""
    polar = polar_track(track.posterior)
    places = chart(np.column_stack([polar.x_rsun, polar.y_rsun]))
    yield path(places, class_=f"track other edge-{style.name}")
    x, y = places[int(np.nanargmax(polar.range_rsun))]
    if 0 < x < SIZE[0] and 0 < y < SIZE[1]:
        yield words(edge_name(track.edge).removesuffix(" edge"), x + 6, y + 4, class_=f"other-label edge-{style.name}")


def _frequency_scale(track: TrackView) -> Iterator[str]:
    """Colours of the frequencies, in the corner below."""
    channels = track.posterior["frequency"].to_numpy()
    scale = Scale(float(channels.min()), float(channels.max()), 16.0, 136.0, is_log=True)
    top, count = SIZE[1] - 38.0, 24
    if scale.low == scale.high:
        return
    yield element("rect", x=6, y=top - 12, width=SCALE_ROOM[0] - 12, height=46, class_="sky under")
    for index in range(count):
        x, width = 16.0 + index * 120.0 / count, 120.0 / count + 0.6
        yield element("rect", x=x, y=top, width=width, height=7, fill=colour_at((index + 0.5) / count))
    for tick in scale.among(FREQUENCY_TICKS_MHZ):
        yield words(f"{tick:g}", float(scale(tick)), top + 25, class_="tick", text_anchor="middle")
    yield words("MHz", 142.0, top + 8, class_="tick")


def thumbnail(
    places_rsun: FloatArray, longitude_68: tuple[float, float] | None, receivers: Mapping[str, FloatArray], said: str
) -> str:
    """Small picture of a track for a list: the ring of 1 au, Sun, Earth, spacecraft, and the 68 % interval.

    Parameters
    ----------
    places_rsun : ndarray, shape (N, 2)
        HEE positions of the track.
    longitude_68 : (float, float) or None
        Degrees at the Sun.
    receivers : mapping of str to ndarray
        HEE, solar radii.
    said : str
        What a screen reader says of it.

    Returns
    -------
    str
    """
    half, scale = 36.0, 31.0 / AU_RSUN

    def _at(points: FloatArray) -> FloatArray:
        return np.asarray(half + np.atleast_2d(points)[:, :2] * (scale, -scale))

    wedge = ""
    if longitude_68 is not None:
        angle = np.radians(np.linspace(*longitude_68, 12))
        arc = AU_RSUN * np.column_stack([np.cos(angle), np.sin(angle)])
        wedge = path(_at(np.vstack([np.zeros((1, 2)), arc])), closed=True, class_="sector")
    crafts = [element("circle", cx=x, cy=y, r=2.2, class_="craft") for one in receivers.values() for x, y in _at(one)]
    return element(
        "svg",
        element("circle", cx=half, cy=half, r=31, class_="ring au"),
        wedge,
        path(_at(places_rsun), class_="track thumb") if len(places_rsun) else "",
        element("circle", cx=half, cy=half, r=3, class_="sun"),
        element("circle", cx=half + 31, cy=half, r=2.6, class_="earth"),
        *crafts,
        viewBox="0 0 72 72",
        class_="figure thumbnail",
        role="img",
        aria_label=said,
    )


def constellation_caption(frame: Frame) -> str:
    """What the figure of the constellation shows, for a file of its own."""
    named = {"hee": "HEE", "heeq": "HEEQ (Stonyhurst)", "carrington": "Carrington"}[frame]
    return (
        f"Track of a Type III burst seen from ecliptic north, Earth to the right; longitudes of the grid are {named}. "
        "Dots: source at each frequency. Filled: 68 % regions, dotted: 95 %. Wedge: spiral of the joint fit, 68 and "
        f"95 %. Thin dotted: spirals of a {NOMINAL_WIND_KM_S:g} km/s wind. {APPARENT_SOURCE.capitalize()}."
    )

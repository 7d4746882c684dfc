"""The map of the ecliptic: grid, Sun, Earth and spacecraft, the track of a burst with its regions, and its spiral.

Seen from ecliptic north with the Earth to the right: HEE X to the right, HEE Y up, solar radii.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.answer import written_68
from bella.flags import APPARENT_SOURCE
from bella.heliosphere import spiral_longitude_deg
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
from bella.plotting.svg import (
    FREQUENCY_TICKS_MHZ,
    Scale,
    colour_at,
    edge_class,
    edge_name,
    element,
    figure,
    line,
    number,
    path,
    round_step,
    words,
)
from bella.records import Interval
from bella.spacecraft import cartesian, hee_from, position
from bella.units import AU_RSUN, FloatArray

View = Literal["track", "fleet"]
Frame = Literal["hee", "heeq", "carrington"]

SIZE = (620.0, 560.0)
SPOKE_STEP_DEG = 30
RINGS_AU = (0.25, 0.5, 0.75, 1.0)
NOMINAL_WIND_KM_S, NOMINAL_PERIOD_D = 400.0, 25.38
"""Of the spirals through the spacecraft: the usual slow wind, and the sidereal rotation of Carrington."""

SPIRAL_POINTS = 48
SCALE_ROOM = (215.0, 56.0)
"""Corner of the colours, with letters as large as on a phone."""

LABEL_WIDTH, LABEL_HEIGHT = 90.0, 15.0
"""Room of the name of a body."""

BORDER = 15.0
"""Room between the border of the map and the labels of the longitudes along it."""

REGIONS_PER_TRACK = 6
BAND_POINTS = 48

LEAST_HALF_RSUN = 12.0
BEYOND = 1.3
"""Of the distances of a joint fit: what is farther out does not decide what is shown of its track."""


@dataclass(frozen=True)
class Map:
    """The part of the ecliptic that is drawn, and where it is on the figure."""

    centre: tuple[float, float]
    per_rsun: float

    def __call__(self, points: FloatArray) -> FloatArray:
        """Places of HEE points of shape (N, 2 or 3) on the figure."""
        plane = np.atleast_2d(points)[:, :2] - self.centre
        return np.asarray(np.array(SIZE) / 2 + plane * (self.per_rsun, -self.per_rsun))

    def to_border(self, angle: float, inset: float = 0.0) -> tuple[FloatArray, bool]:
        """Where a ray from the Sun leaves the figure, and whether it crosses it at all; `angle` in radians."""
        start, way = self(np.zeros((1, 2)))[0], np.array([np.cos(angle), -np.sin(angle)])
        box = np.array([[inset, SIZE[0] - inset], [inset, SIZE[1] - inset]])
        with np.errstate(divide="ignore"):
            steps = (box - start[:, np.newaxis]) / way[:, np.newaxis]
        leave = float(np.min(np.max(steps, axis=1)))
        return start + leave * way, leave > 0


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
    """
    known = dict(look.receivers)
    for track in reversed(tracks):
        known |= receiver_positions(track.posterior)
    earth = position("EARTH", utc)[0]
    chart = _map(tracks, [*known.values(), earth], look.view)
    title = "Map of the inner heliosphere with Sun, Earth, spacecraft, track, credible regions and spiral."
    others = [part for track in reversed(tracks[1:]) for part in _line_of(track, chart)]
    return figure(
        "constellation",
        SIZE,
        title,
        element("rect", x=0, y=0, width=SIZE[0], height=SIZE[1], class_="sky"),
        *rings(chart),
        *spokes(chart, look.frame, utc),
        *nominal_spirals(chart, known),
        *(_sector(chart, one) for one in look.sectors),
        *(part for track in tracks[:1] for part in _first(track, chart, look.frequency_mhz)),
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


def _first(track: TrackView, chart: Map, frequency_mhz: float | None) -> Iterator[str]:
    """The track that the map is about: band of its spiral, regions, positions by frequency."""
    polar, name = polar_track(track.posterior), edge_class(track.edge)
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
    emitted = _emitted(track.posterior)
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
            **({"data_utc": str(emitted[index])} if len(emitted) and not np.isnat(emitted[index]) else {}),
        )


def _emitted(posterior: xr.Dataset) -> npt.NDArray[np.datetime64]:
    """When each source emitted, UTC, for the animation; empty where that is not known."""
    reference = str(posterior.attrs.get("reference_time", "")).removesuffix("Z")
    if not reference or "emission_s" not in posterior:
        return np.empty(0, dtype="datetime64[s]")
    seconds = np.rint(posterior["emission_s"].to_numpy())
    known = np.isfinite(seconds)
    late = np.where(known, seconds, 0.0).astype("timedelta64[s]")
    return np.where(known, np.datetime64(reference, "s") + late, np.datetime64("NaT", "s"))


def _line_of(track: TrackView, chart: Map) -> Iterator[str]:
    """Another answer: its positions as a line."""
    polar = polar_track(track.posterior)
    places = chart(np.column_stack([polar.x_rsun, polar.y_rsun]))
    yield path(places, class_=f"track other {edge_class(track.edge)}")
    x, y = places[int(np.nanargmax(polar.range_rsun))]
    if 0 < x < SIZE[0] and 0 < y < SIZE[1]:
        yield words(
            edge_name(track.edge).removesuffix(" edge"), x + 6, y + 4, class_=f"other-label {edge_class(track.edge)}"
        )


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


def rings(chart: Map) -> Iterator[str]:
    """Circles around the Sun: quarters of an au, or round numbers of solar radii where the view is smaller."""
    sun = chart(np.zeros((1, 2)))[0]
    corners = np.array([[x, y] for x in (0.0, SIZE[0]) for y in (0.0, SIZE[1])])
    reach = float(np.linalg.norm(corners - sun, axis=1).max()) / chart.per_rsun
    step = round_step(reach / 5.0)
    in_au = reach > 1.2 * AU_RSUN
    radii = [one * AU_RSUN for one in RINGS_AU] if in_au else [step * n for n in range(1, int(reach / step) + 1)]
    for radius in radii:
        is_au = in_au and radius == AU_RSUN
        yield element("circle", cx=sun[0], cy=sun[1], r=radius * chart.per_rsun, class_="ring au" if is_au else "ring")
        label = f"{radius / AU_RSUN:g} au" if in_au else f"{radius:g} R\N{SUN}"
        x, y = chart(np.array([[radius * np.cos(np.radians(75.0)), radius * np.sin(np.radians(75.0))]]))[0]
        if 12 < y < SIZE[1] - 4 and 20 < x < SIZE[0] - 20:
            yield words(label, x, y + 4, class_="grid-label")


def spokes(chart: Map, frame: Frame, utc: np.datetime64) -> Iterator[str]:
    """Rays of round longitudes of a frame, each with its longitude where it leaves the map."""
    sun = chart(np.zeros((1, 2)))[0]
    for longitude in range(0, 360, SPOKE_STEP_DEG):
        x, y, _ = hee_from(frame, cartesian(1.0, longitude, 0.0), utc)[0]
        angle = float(np.arctan2(y, x))
        end, is_seen = chart.to_border(angle)
        if not is_seen:
            continue
        yield line(sun[0], sun[1], end[0], end[1], class_="spoke")
        place, _ = chart.to_border(angle, BORDER)
        is_free = place[0] > SCALE_ROOM[0] or place[1] < SIZE[1] - SCALE_ROOM[1]
        if is_free and np.linalg.norm(place - sun) > 60:
            anchor = "start" if place[0] < 40 else "end" if place[0] > SIZE[0] - 40 else "middle"
            aside = {"start": -9.0, "end": 9.0, "middle": 0.0}[anchor]
            said = _written(longitude, frame)
            yield words(said, place[0] + aside, place[1] + 4, class_="spoke-label", text_anchor=anchor)


def _written(longitude_deg: int, frame: Frame) -> str:
    if frame == "carrington" or longitude_deg in {0, 180}:
        return f"{longitude_deg}°"
    return f"{longitude_deg}°W" if longitude_deg < 180 else f"{360 - longitude_deg}°E"


def nominal_spirals(chart: Map, receivers: Mapping[str, FloatArray]) -> Iterator[str]:
    """Spirals of the usual slow wind from the Sun to each spacecraft."""
    for name, where in receivers.items():
        reach = float(np.hypot(*where[:2]))
        distance = np.linspace(1.0, reach, SPIRAL_POINTS)
        turned = spiral_longitude_deg(distance, 0.0, NOMINAL_WIND_KM_S, NOMINAL_PERIOD_D)
        longitude = np.radians(turned - turned[-1]) + np.arctan2(where[1], where[0])
        points = np.column_stack([distance * np.cos(longitude), distance * np.sin(longitude)])
        yield path(chart(points), class_="nominal", data_name=name)


def bodies(chart: Map, receivers: Mapping[str, FloatArray], earth: FloatArray) -> Iterator[str]:
    """Earth and spacecraft; those outside the map as an arrow at its border."""
    near_earth = [name for name, where in receivers.items() if float(np.linalg.norm(where - earth)) < 4.0]
    named = {name: where for name, where in receivers.items() if name not in near_earth}
    taken: list[tuple[float, float]] = []
    for name, where in [("Earth" + "".join(f", {one}" for one in near_earth), earth), *named.items()]:
        kind = "earth" if where is earth else "craft"
        x, y = (float(one) for one in chart(where[np.newaxis])[0])
        angle = float(np.arctan2(where[1], where[0]))
        if 8 < x < SIZE[0] - 8 and 8 < y < SIZE[1] - 8:
            yield _marker(kind, x, y)
            side, anchor = (-1.0, "end") if x > SIZE[0] - 100 else (1.0, "start")
            height = _free_height(x, y, (-7.0, 16.0, 32.0), taken)
            yield words(name, x + side * 10, height, class_="craft-label", text_anchor=anchor)
            continue
        end, is_seen = chart.to_border(angle, 34.0)
        if is_seen:
            x, y = float(end[0]), float(end[1])
            yield _triangle(x, y, f"away {kind}", f"rotate({90 - np.degrees(angle):.0f} {number(x)} {number(y)})")
            anchor = "end" if x > SIZE[0] - 120 else "start" if x < 120 else "middle"
            aside = {"end": -9, "start": 9, "middle": 0}[anchor]
            height = _free_height(x, y, (18.0, 34.0, 50.0) if y < 60 else (-8.0, 18.0, -24.0, 34.0), taken)
            yield words(name, x + aside, height, class_="craft-label", text_anchor=anchor)


def _free_height(x: float, y: float, offsets: Sequence[float], taken: list[tuple[float, float]]) -> float:
    """First height above or below a body at which its name covers no other one; it is taken then."""
    heights = [y + offset for offset in offsets]
    free = [
        one for one in heights if all(abs(x - at[0]) > LABEL_WIDTH or abs(one - at[1]) >= LABEL_HEIGHT for at in taken)
    ]
    taken.append((x, (free or heights)[0]))
    return taken[-1][1]


def _marker(kind: str, x: float, y: float) -> str:
    if kind == "earth":
        return element("circle", cx=x, cy=y, r=5.5, class_="earth")
    return _triangle(x, y, "craft")


def _triangle(x: float, y: float, kind: str, transform: str | None = None) -> str:
    return path(np.array([[x, y - 6], [x + 6, y + 5], [x - 6, y + 5]]), closed=True, class_=kind, transform=transform)


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

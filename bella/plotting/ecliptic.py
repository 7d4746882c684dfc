"""What fills the ecliptic: how well a fleet locates a source in each place, and the measured solar wind; SVG."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from bella.flags import APPARENT_SOURCE
from bella.plotting.constellation import SIZE, Map, bodies, rings, spokes
from bella.plotting.svg import Scale, colour_at, element, figure, line, path, picture, words
from bella.spacecraft import cartesian, hee_from, polar, position
from bella.units import AU_RSUN, FloatArray

if TYPE_CHECKING:
    from bella.solar_wind import FieldLine, SteadyWind

SHARES = (0.1, 0.25, 0.5, 1.0)
"""Of the distance of a source, as radius of its 68 % region: bounds of the shades."""

SWATCH, PITCH, LEGEND_WIDTH = 13.0, 20.0, 196.0

UNCERTAINTY = ("#ffffd9", "#c7e9b4", "#41b6c4", "#225ea8", "#081d58")
SPEEDS = ("#ffffe5", "#fee391", "#fe9929", "#cc4c02", "#662506")
"""Light to dark, lightness falling evenly: of standard deviations, and of speeds of the wind."""

CONTOURS_RSUN = (10.0, 15.0, 25.0, 50.0)
SD_TICKS_RSUN = (1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0, 80.0, 120.0, 200.0)
SCALE_LEFT, SCALE_PIXELS, SCALE_HEIGHT = 40.0, 540.0, 12.0
FOOT = 62.0
HATCHES = 70
PIXELS = 300
"""Of the picture of the wind, to a side."""

ALONG_HEIGHT, ALONG_LEFT = 150.0, 60.0
REACH = 1.06


def planning_figure(
    utc: np.datetime64,
    receivers: Mapping[str, FloatArray],
    longitudes_deg: Sequence[float],
    radii_rsun: Mapping[float, Sequence[float | None]],
    marked: tuple[str, float] | None = None,
) -> str:
    """Map of the ecliptic, shaded by the size of the 68 % region that a source would have there.

    Parameters
    ----------
    utc : numpy.datetime64
        Of Earth.
    receivers : mapping of str to ndarray, shape (3,)
        HEE, solar radii.
    longitudes_deg : sequence of float
        HEE, evenly spaced.
    radii_rsun : mapping of float to sequence of float or None
        Radius of the region in each direction, by distance in solar radii; empty where nothing can be located.
    marked : (str, float), optional
        Name and radius of a circle that stands out.
    """
    earth = position("EARTH", utc)[0]
    farthest = max([float(np.abs(one[:2]).max()) for one in receivers.values()] + [AU_RSUN])
    chart = Map((0.0, 0.0), SIZE[1] / (2.2 * farthest))
    return figure(
        "planning",
        SIZE,
        "Map of the inner heliosphere, shaded by how well a source would be located.",
        element("rect", x=0, y=0, width=SIZE[0], height=SIZE[1], class_="sky"),
        *_cells(chart, longitudes_deg, radii_rsun),
        *rings(chart),
        *spokes(chart, "hee", utc),
        *(_circle(chart, *marked) if marked and radii_rsun else ()),
        _sun(chart),
        *bodies(chart, receivers, earth),
        *(_legend() if radii_rsun else ()),
    )


def _cells(
    chart: Map, longitudes_deg: Sequence[float], radii_rsun: Mapping[float, Sequence[float | None]]
) -> Iterator[str]:
    distances = sorted(radii_rsun)
    if not distances:
        return
    between = np.sqrt(np.array(distances[1:]) * np.array(distances[:-1]))
    bounds = np.concatenate([[0.5 * distances[0]], between, [distances[-1] * 1.15]])
    half = 0.5 * (longitudes_deg[1] - longitudes_deg[0])
    for index, distance in enumerate(distances):
        for longitude, radius in zip(longitudes_deg, radii_rsun[distance], strict=True):
            angle = np.radians(np.linspace(longitude - half, longitude + half, 5))
            way = np.column_stack([np.cos(angle), np.sin(angle)])
            outline = chart(np.vstack([way * bounds[index], way[::-1] * bounds[index + 1]]))
            said = element("title", _said(distance, longitude, radius))
            yield element("g", said, path(outline, closed=True, class_=f"cell share-{share_class(radius, distance)}"))


def _said(distance_rsun: float, longitude_deg: float, radius_rsun: float | None) -> str:
    side = "" if longitude_deg in {0.0, -180.0} else " W" if longitude_deg > 0 else " E"
    where = f"{distance_rsun:g} R\N{SUN}, {abs(longitude_deg):.0f}°{side}"
    if radius_rsun is None:
        return f"{where}: not known"
    percent = 100.0 * radius_rsun / distance_rsun
    return f"{where}: \N{PLUS-MINUS SIGN}{radius_rsun:.0f} R\N{SUN}, {percent:.0f} % of its distance"


def share_class(radius_rsun: float | None, distance_rsun: float) -> int:
    """Which of the shades a region has, 0 for the best; one more than the last for what is not located."""
    if radius_rsun is None:
        return len(SHARES)
    return int(np.searchsorted(SHARES, radius_rsun / distance_rsun))


def _circle(chart: Map, name: str, radius_rsun: float) -> Iterator[str]:
    x, y = chart(np.zeros((1, 2)))[0]
    radius = radius_rsun * chart.per_rsun
    yield element("circle", cx=x, cy=y, r=radius, class_="marked-ring")
    yield words(name, x, y + radius + 13, class_="other-label", text_anchor="middle")


def _legend() -> Iterator[str]:
    said = [f"within {100 * share:.0f} %{'' if index else ' of its distance'}" for index, share in enumerate(SHARES)]
    top = SIZE[1] - PITCH * (len(said) + 1)
    yield element("rect", x=4, y=top - 6, width=LEGEND_WIDTH, height=SIZE[1] - top + 2, class_="sky under")
    for index, text in enumerate([*said, "not located"]):
        y = top + PITCH * index
        yield element("rect", x=10, y=y, width=SWATCH, height=SWATCH, class_=f"cell share-{index}")
        yield words(text, 10 + SWATCH + 6, y + 11, class_="legend")


def planning_caption(day: object, names: Sequence[str], sigma_s: float) -> str:
    """What the figure shows, for a file of its own."""
    return (
        f"How well {', '.join(names)} would locate a source of a Type III burst on {day}, with timing errors of "
        f"{sigma_s:g} s: radius of the 68 % region as a share of the distance from the Sun, by direction and distance "
        "in the ecliptic. From the exact posterior of noise-free arrival times at one frequency."
    )


def coverage_figure(uncertainty: xr.Dataset) -> str:
    """Map of how well a fleet locates a source in each place, SVG.

    The largest standard deviation of the exact posterior is drawn where the map has it, of the closed form otherwise;
    where the closed form is off, the map is hatched, or outlined if it is exact.

    Parameters
    ----------
    uncertainty : xarray.Dataset
        As :func:`bella.multilateration.uncertainty_map` returns it.
    """
    exact = "exact_sd_largest_rsun" in uncertainty
    sd = uncertainty["exact_sd_largest_rsun" if exact else "sd_largest_rsun"]
    x, y, values = sd["x"].to_numpy(), sd["y"].to_numpy(), sd.to_numpy()
    low, high = float(values.min()), float(values.max())
    scale = Scale(low, max(high, 1.05 * low), SCALE_LEFT, SCALE_LEFT + SCALE_PIXELS, is_log=True)  # a flat map has one
    chart = Map((float(x[0] + x[-1]) / 2, float(y[0] + y[-1]) / 2), SIZE[1] / float(y[-1] - y[0]))
    share = (scale(values[::-1]) - scale.start) / SCALE_PIXELS
    receivers = dict(
        zip(uncertainty["observatory"].to_numpy().tolist(), uncertainty["receiver_rsun"].to_numpy(), strict=True)
    )
    return figure(
        "coverage",
        (SIZE[0], SIZE[1] + FOOT),
        "Map of the standard deviation of a position in its worst direction.",
        element("rect", x=0, y=0, width=SIZE[0], height=SIZE[1] + FOOT, class_="sky"),
        picture(share, UNCERTAINTY, **_box(chart, x, y)),
        *_off(chart, uncertainty["closed_form_off"], hatched=not exact),
        *_contours(chart, sd),
        *rings(chart),
        _sun(chart),
        *bodies(chart, receivers, np.array([AU_RSUN, 0.0, 0.0])),
        *_colour_scale(scale, SD_TICKS_RSUN, UNCERTAINTY, "Standard deviation in the worst direction (R\N{SUN})"),
    )


def coverage_caption(uncertainty: xr.Dataset) -> str:
    """What the map of the uncertainty shows, for a file of its own."""
    names, sigma_s = uncertainty["observatory"].to_numpy(), uncertainty["sigma_s"].to_numpy()
    timed = ", ".join(f"{name} {value:g} s" for name, value in zip(names, sigma_s, strict=True))
    exact = "exact_sd_largest_rsun" in uncertainty
    method = "exact posterior" if exact else "closed form"
    epoch = uncertainty.attrs["epoch"]
    when = "" if epoch == "not stated" else f", {epoch.removesuffix('Z').removesuffix(':00').replace('T', ' ')} UTC"
    off = "Dashed: beyond it the closed form is off by more than 10 %." if exact else "Hatched: off by more than 10 %."
    return (
        f"Uncertainty of the position of a burst seen from ecliptic north, Earth to the right, {method}{when}. "
        f"Timing errors: {timed}. {off}"
    )


def _box(chart: Map, x: FloatArray, y: FloatArray) -> dict[str, float]:
    """Place of a picture over the nodes of a map, whose outermost ones are at its border."""
    corners = chart(np.array([[x[0], y[-1]], [x[-1], y[0]]]))
    (left, top), (right, bottom) = corners.tolist()
    return {"x": left, "y": top, "width": right - left, "height": bottom - top}


def _contours(chart: Map, field_of: xr.DataArray) -> Iterator[str]:
    x, y = field_of["x"].to_numpy(), field_of["y"].to_numpy()
    for level in CONTOURS_RSUN:
        lines = contour_lines(x, y, field_of.to_numpy(), level)
        for one in lines:
            yield path(chart(one), class_="contour")
        longest = max(lines, key=len, default=None)
        if longest is not None:
            place = chart(longest[len(longest) // 3][np.newaxis])[0]
            yield words(f"{level:g}", place[0], place[1] + 4, class_="grid-label")


def contour_lines(x: FloatArray, y: FloatArray, values: FloatArray, level: float) -> list[FloatArray]:
    """Lines on which values of shape (Y, X) have a level, each of shape (N, 2)."""
    import contourpy  # noqa: PLC0415 - of maps that are written to files only

    return [np.asarray(one) for one in contourpy.contour_generator(x, y, values).lines(level)]


def _off(chart: Map, off: xr.DataArray, *, hatched: bool) -> Iterator[str]:
    """Where the closed form is off: hatched, and outlined."""
    x, y, values = off["x"].to_numpy(), off["y"].to_numpy(), off.to_numpy().astype(float)
    if hatched and values.any():
        box = _box(chart, x, y)
        rows = values[np.linspace(0, len(y) - 1, min(len(y), HATCHES)).astype(int)]
        for row, first, last in _runs(rows):
            level = box["y"] + box["height"] * (1.0 - row / (len(rows) - 1))
            ends = box["x"] + box["width"] * np.array([first, last]) / len(x)
            yield line(float(ends[0]), level, float(ends[1]), level, class_="off-hatch")
    if 0 < values.mean() < 1:
        for one in contour_lines(x, y, values, 0.5):
            yield path(chart(one), class_="off-border")


def _runs(rows: FloatArray) -> Iterator[tuple[int, int, int]]:
    """Row, first and last column of each stretch of ones."""
    for index, row in enumerate(rows):
        ends = np.flatnonzero(np.diff(np.concatenate([[0.0], row, [0.0]])))
        for first, last in ends.reshape(-1, 2):
            yield index, int(first), int(last)


def _sun(chart: Map) -> str:
    x, y = chart(np.zeros((1, 2)))[0]
    return element("circle", cx=x, cy=y, r=7, class_="sun")


def _colour_scale(scale: Scale, ticks: Sequence[float], colours: Sequence[str], name: str) -> Iterator[str]:
    """Colours of values below a map."""
    top, count = SIZE[1] + 8.0, 60
    for index in range(count):
        x = scale.start + index * (scale.end - scale.start) / count
        width = (scale.end - scale.start) / count + 0.6
        colour = colour_at((index + 0.5) / count, colours)
        yield element("rect", x=x, y=top, width=width, height=SCALE_HEIGHT, fill=colour)
    for tick in scale.among(ticks) or [scale.low]:
        yield words(f"{tick:.3g}", float(scale(tick)), top + 27, class_="tick", text_anchor="middle")
    yield words(name, (scale.start + scale.end) / 2, top + 46, class_="axis-name", text_anchor="middle")


@dataclass(frozen=True)
class WindScene:
    """What is drawn over a map of the wind; all in HEE at one time.

    Attributes
    ----------
    source_rsun : ndarray, shape (F, 3)
        Sources of a burst, solar radii; empty for none.
    receiver_rsun : mapping of str to ndarray, shape (3,)
        Spacecraft, solar radii.
    spiral_rsun : ndarray, shape (N, 3)
        Spiral that was fitted to the sources, solar radii; empty for none.
    along_km_s, along_sd_km_s : ndarray, shape (F,)
        Speed of the wind at the sources and its standard deviation; NaN where it is not known; empty for none.
    """

    utc: np.datetime64
    source_rsun: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    field_line: "FieldLine | None" = None
    receiver_rsun: Mapping[str, FloatArray] = field(default_factory=dict)
    spiral_rsun: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    along_km_s: FloatArray = field(default_factory=lambda: np.empty(0))
    along_sd_km_s: FloatArray = field(default_factory=lambda: np.empty(0))


def wind_map_figure(wind: "SteadyWind", scene: WindScene) -> str:
    """Map of the wind with a burst in it, and the wind along its track, SVG.

    Parameters
    ----------
    wind : SteadyWind
        As :meth:`bella.solar_wind.WindAssimilation.map_at` returns it.
    """
    chart = Map((0.0, 0.0), SIZE[1] / (2 * REACH * float(wind.range_rsun[-1])))
    speeds = wind.speed_km_s[np.isfinite(wind.speed_km_s)]
    low = float(speeds.min())
    scale = Scale(low, max(float(speeds.max()), low + 1.0), SCALE_LEFT, SCALE_LEFT + SCALE_PIXELS)
    half = float(wind.range_rsun[-1])
    nodes = np.linspace(-half, half, PIXELS)
    share = (wind_on_grid(wind, nodes, scene.utc) - scale.low) / (scale.high - scale.low)
    known = np.isfinite(scene.along_km_s)
    height = SIZE[1] + FOOT + (ALONG_HEIGHT if known.any() else 0.0)
    return figure(
        "wind-map",
        (SIZE[0], height),
        "Map of the speed of the solar wind seen from ecliptic north, with track, spiral and field line.",
        element("rect", x=0, y=0, width=SIZE[0], height=height, class_="sky"),
        picture(share[::-1], SPEEDS, **_box(chart, nodes, nodes)),
        *rings(chart),
        *_track_in_wind(chart, scene),
        _sun(chart),
        *bodies(chart, scene.receiver_rsun, position("EARTH", scene.utc)[0]),
        *_colour_scale(scale, scale.ticks(8), SPEEDS, "Solar wind speed (km/s)"),
        *(_along(scene, known) if known.any() else ()),
    )


def wind_map_caption() -> str:
    """What the map of the wind shows, for a file of its own."""
    return (
        f"Solar wind seen from ecliptic north, Earth to the right, with the track of a burst ({APPARENT_SOURCE}), the "
        "spiral of the joint fit (dotted) and the field line of this wind (dashed). Below, where it is known: wind at "
        "the sources by distance, with one standard deviation."
    )


def wind_on_grid(wind: "SteadyWind", nodes_rsun: FloatArray, utc: np.datetime64) -> FloatArray:
    """Speeds at nodes of HEE x and y, shape (N, N) with y down the rows, km/s; NaN where the map has none."""
    x, y = np.meshgrid(nodes_rsun, nodes_rsun)
    step = float(wind.range_rsun[1] - wind.range_rsun[0])
    row = np.round((np.hypot(x, y) - wind.range_rsun[0]) / step).astype(int)
    _, seen_deg, _ = polar(hee_from("carrington", cartesian(1.0, wind.longitude_deg, 0.0), utc))
    order = np.argsort(seen_deg)
    ends = np.concatenate([seen_deg[order[-1:]] - 360.0, seen_deg[order], seen_deg[order[:1]] + 360.0])
    place = np.searchsorted(0.5 * (ends[1:] + ends[:-1]), np.degrees(np.arctan2(y, x))) - 1
    column = order[place % order.size]
    inside = (row >= 0) & (row < wind.range_rsun.size)
    return np.where(inside, wind.speed_km_s[np.where(inside, row, 0), column], np.nan)


def _track_in_wind(chart: Map, scene: WindScene) -> Iterator[str]:
    if len(scene.source_rsun):
        yield path(chart(scene.source_rsun), class_="track-under")
        yield path(chart(scene.source_rsun), class_="track edge-gauss_hermite")
    if scene.field_line is not None:
        angle = np.radians(scene.field_line.longitude_deg)
        places = scene.field_line.range_rsun[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        yield path(chart(places), class_="field-line")
    if len(scene.spiral_rsun):
        yield path(chart(scene.spiral_rsun), class_="fitted-spiral")


def _along(scene: WindScene, known: np.ndarray) -> Iterator[str]:
    """Wind at the sources by distance, with a band of one standard deviation."""
    distance = np.linalg.norm(scene.source_rsun[known], axis=1)
    order = np.argsort(distance)
    distance, speed, sd = distance[order], scene.along_km_s[known][order], scene.along_sd_km_s[known][order]
    top = SIZE[1] + FOOT + 22.0
    across = Scale(0.0, 1.02 * float(distance[-1]), ALONG_LEFT, SIZE[0] - 14.0)
    upward = Scale(float((speed - sd).min()) - 10.0, float((speed + sd).max()) + 10.0, top + ALONG_HEIGHT - 64.0, top)
    for tick in upward.ticks(3):
        y = float(upward(tick))
        yield line(across.start, y, across.end, y, class_="gridline")
        yield words(f"{tick:g}", across.start - 6, y + 4, class_="tick", text_anchor="end")
    for tick in across.ticks(8):
        x = float(across(tick))
        yield line(x, upward.start, x, upward.start + 4, class_="axis")
        yield words(f"{tick:g}", x, upward.start + 17, class_="tick", text_anchor="middle")
    ends = [np.column_stack([across(distance), upward(speed + side * sd)]) for side in (-1.0, 1.0)]
    yield path(np.vstack([ends[0], ends[1][::-1]]), closed=True, class_="band edge-gauss_hermite")
    yield path(np.column_stack([across(distance), upward(speed)]), class_="curve edge-gauss_hermite")
    yield words("Wind along the track (km/s)", across.start - 46, top - 8, class_="axis-name")
    middle = (across.start + across.end) / 2
    yield words(
        "Distance of the source (R\N{SUN})", middle, upward.start + 34, class_="axis-name", text_anchor="middle"
    )

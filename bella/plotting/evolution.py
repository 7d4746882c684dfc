"""A track in numbers: distance and beam speed against frequency, longitude against distance, and residuals."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from bella.answer import NO_SPIRAL, written_wind
from bella.heliosphere import DENSITY_MODELS, emission_frequency_mhz, spiral_longitude_deg
from bella.heliosphere.density import CORONA_RSUN
from bella.heliosphere.parker import SPIRAL_ORIGIN_RSUN
from bella.heliosphere.polar import has_longitude, planar_positions, polar_covariance
from bella.plotting.geometry import PERCENTS, PolarTrack, SpiralBand, polar_track, spiral_band
from bella.plotting.svg import (
    FREQUENCY_TICKS_MHZ,
    Scale,
    colour_at,
    edge_class,
    element,
    figure,
    grid,
    line,
    marks,
    path,
    words,
)
from bella.units import FloatArray

WIDTH, HEIGHT, SPIRAL_HEIGHT = 620.0, 330.0, 300.0
LEFT, RIGHT, TOP, BOTTOM = 52.0, 12.0, 24.0, 44.0
DISTANCE_TICKS_RSUN = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
SPEED_TICKS_C = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
LEADING_MODEL = "leblanc"
"""Of the density models: the one that reaches from the corona to the Earth and is used for interplanetary bursts."""

MOST_ERRORS, MOST_DOTS = 40, 80
ELLIPSES, ELLIPSE_POINTS = 14, 37
LEAST_SHOWN_DEG = 10.0
DRAWN_FITS = {"two_step": "two-step", "weighted": "errors in both", "joint": "joint"}


def evolution_figure(posterior: xr.Dataset, track_fit: Mapping[str, Any]) -> str:
    """Distance of the source and speed of the beam against frequency, and below longitude against distance; SVG.

    Parameters
    ----------
    posterior : xarray.Dataset
        Of the positions, HEE.
    track_fit : mapping
        As kept in the catalogue: the profile of its joint fit is drawn as a band, the spirals of its fits as lines.
    """
    polar = polar_track(posterior)
    profile = sorted((track_fit.get("joint") or {}).get("profile") or (), key=lambda one: one["frequency_mhz"])
    name = edge_class(str(posterior.attrs.get("edge", "")))
    band = (float(polar.frequency_mhz.min()) / 1.1, float(polar.frequency_mhz.max()) * 1.1)
    left = Scale(*band, LEFT, WIDTH / 2 - RIGHT - 6, is_log=True)
    right = Scale(*band, WIDTH / 2 + LEFT - 6, WIDTH - RIGHT, is_log=True)
    far = max(10.0, 1.3 * float(np.nanmax(polar.range_rsun)))
    distance = Scale(max(1.0, 0.6 * float(np.nanmin(polar.range_rsun))), far, HEIGHT - BOTTOM, TOP, is_log=True)
    speeds = [
        one["beam_speed_c"]["q84"] for one in profile if one.get("beam_speed_c") and one["beam_speed_c"].get("q84")
    ]
    speed = Scale(0.0, min(1.2, max(0.3, 1.15 * max(speeds, default=0.3))), HEIGHT - BOTTOM, TOP)
    parts = [
        *_axes(left, distance, DISTANCE_TICKS_RSUN, "Distance (R\N{SUN})"),
        *_models(left, distance),
        *_band(profile, "range_rsun", left, distance, name),
        *_errors(polar, left, distance, name),
        *_corrected(track_fit, left, distance),
        *_axes(right, speed, SPEED_TICKS_C, "Beam speed (c)"),
        *_band(profile, "beam_speed_c", right, speed, name),
    ]
    if not speeds:
        parts.append(
            words("not fitted", (right.start + right.end) / 2, HEIGHT / 2, class_="tick", text_anchor="middle")
        )
    parts += _spiral_panel(posterior, polar, dict(track_fit) | dict(track_fit.get("companions") or {}), name)
    title = (
        "Distance of the source from the Sun and speed of the beam against frequency, and longitude against distance, "
        "with 68 % intervals."
    )
    return figure("evolution", (WIDTH, HEIGHT + SPIRAL_HEIGHT), title, *parts)


def residual_figure(posterior: xr.Dataset) -> str:
    """Arrival times less those of the posterior mean, by spacecraft, against frequency; SVG.

    Parameters
    ----------
    posterior : xarray.Dataset
        With ``residual_s`` and ``sigma_s``.
    """
    frequency = posterior["frequency"].to_numpy().astype(np.float64)
    residual = posterior["residual_s"].to_numpy().astype(np.float64)
    across = Scale(float(frequency.min()) / 1.1, float(frequency.max()) * 1.1, LEFT, WIDTH - RIGHT, is_log=True)
    reach = max(1.0, 1.15 * float(np.nanmax(np.abs(residual), initial=0.0)))
    upward = Scale(-reach, reach, HEIGHT - BOTTOM, TOP)
    parts = [*_axes(across, upward, upward.ticks(5), "Residual of the arrival time (s)")]
    parts.append(line(across.start, float(upward(0.0)), across.end, float(upward(0.0)), class_="axis"))
    names = [str(one) for one in posterior["observatory"].to_numpy()]
    for index, name in enumerate(names):
        places = np.column_stack([across(frequency), upward(residual[:, index])])
        x = LEFT + 10 + (across.end - across.start) / max(4, len(names)) * index
        parts += [element("g", *marks(places, index), class_=f"series s{index}")]
        parts += [element("g", *marks(np.array([[x, TOP + 10.0]]), index), class_=f"series s{index}")]
        parts.append(words(name, x + 9, TOP + 14, class_="tick"))
    return figure("residuals", (WIDTH, HEIGHT), "Residuals of the arrival times of each spacecraft.", *parts)


def evolution_caption() -> str:
    """What the figure of distance, speed and longitude shows, for a file of its own."""
    return (
        "Above: distance of the source, and speed of the beam, against frequency. Points: positions with one standard "
        "deviation. Bands: joint fit, 68 %. Grey: where density models emit, Leblanc et al. (1998) thick, fundamental "
        "drawn out, harmonic dashed. Triangles: corrected for scattering as fundamental (down) or harmonic (up). "
        "Below: HEE longitude against distance, ellipses of one standard deviation, and the spirals that were fitted."
    )


def residual_caption() -> str:
    """What the figure of the residuals shows, for a file of its own."""
    return "Arrival times less those of the mean of the posterior, at each frequency and spacecraft."


def _axes(across: Scale, upward: Scale, ticks: Sequence[float], name: str) -> Iterator[str]:
    """Grid of a panel against frequency."""
    frequencies = {tick: f"{tick:g}" for tick in across.among(FREQUENCY_TICKS_MHZ)}
    yield from grid(across, upward, frequencies, _written(upward.among(ticks)), name)
    yield words("MHz", (across.start + across.end) / 2, upward.start + 36, class_="axis-name", text_anchor="middle")


def _written(ticks: Sequence[float]) -> dict[float, str]:
    return {tick: f"{tick:.3g}".replace("-", "\N{MINUS SIGN}") for tick in ticks}


def _models(across: Scale, upward: Scale) -> Iterator[str]:
    """Where density models emit each frequency: fundamental drawn out, harmonic dashed."""
    for name, model in DENSITY_MODELS.items():
        farthest = min(CORONA_RSUN, upward.high) if model.corona_only else upward.high
        if farthest <= upward.low:
            continue
        distance = np.geomspace(upward.low, farthest, 80)
        for harmonic, dashes in ((1, ""), (2, " harmonic")):
            frequency = emission_frequency_mhz(distance, model, harmonic)
            shown = (frequency >= across.low) & (frequency <= across.high)
            if shown.any():
                said = f"{model.name.capitalize()} density, {'fundamental' if harmonic == 1 else 'harmonic'}"
                places = np.column_stack([across(frequency), upward(distance)])[shown]
                kind = "model" if name == LEADING_MODEL else "model thin"
                yield element("g", element("title", said), path(places, class_=kind + dashes))


def _band(profile: Sequence[Mapping[str, Any]], key: str, across: Scale, upward: Scale, name: str) -> Iterator[str]:
    known = [(one["frequency_mhz"], one[key]) for one in profile if one.get(key) and one[key].get("q50") is not None]
    if len(known) < 2:
        return
    frequency = np.array([one for one, _ in known])
    low, middle, high = (np.array([value[end] for _, value in known], dtype=float) for end in ("q16", "q50", "q84"))
    least = upward.low if not upward.is_log else max(upward.low, 1e-6)
    low, high = np.clip(low, least, upward.high), np.clip(high, least, upward.high)
    outline = np.concatenate([np.column_stack([frequency, low]), np.column_stack([frequency, high])[::-1]])
    yield path(np.column_stack([across(outline[:, 0]), upward(outline[:, 1])]), closed=True, class_=f"band {name}")
    yield path(
        np.column_stack([across(frequency), upward(np.clip(middle, least, upward.high))]), class_=f"curve {name}"
    )


def _errors(polar: PolarTrack, across: Scale, upward: Scale, name: str) -> Iterator[str]:
    value, sd = polar.range_rsun, polar.range_sd_rsun
    kept = np.unique(np.linspace(0, len(value) - 1, MOST_ERRORS).astype(int))
    for index in kept[np.isfinite(value[kept])]:
        x = float(across(polar.frequency_mhz[index]))
        low, high = np.clip([value[index] - sd[index], value[index] + sd[index]], upward.low, upward.high)
        yield line(x, float(upward(low)), x, float(upward(high)), class_=f"error {name}")
        yield element("circle", cx=x, cy=float(upward(value[index])), r=2.4, class_=f"dot {name}")


def _corrected(track_fit: Mapping[str, Any], across: Scale, upward: Scale) -> Iterator[str]:
    """Distances of the emission by the model of scattering, if it was the fundamental or the harmonic."""
    rows = ((track_fit.get("companions") or {}).get("scattering") or {}).get("rows", ())
    for word, turn in (("fundamental", 1.0), ("harmonic", -1.0)):
        known = [(row["frequency_mhz"], row[word]["range_rsun"]) for row in rows if row[word]["range_rsun"] is not None]
        shown = [one for one in known if across.holds(one[0]) and upward.holds(one[1])]
        triangles = []
        for frequency, distance in shown:
            x, y = float(across(frequency)), float(upward(distance))
            triangles.append(
                path(np.array([[x - 4, y - 3 * turn], [x + 4, y - 3 * turn], [x, y + 4 * turn]]), closed=True)
            )
        if triangles:
            yield element("g", element("title", f"corrected for scattering, {word}"), *triangles, class_="corrected")


def _spiral_panel(posterior: xr.Dataset, polar: PolarTrack, fits: Mapping[str, Any], name: str) -> Iterator[str]:
    """Longitudes against distances with the spirals that were fitted to them."""
    longitude = _without_jumps(polar)
    low, high = float(np.nanmin(longitude)), float(np.nanmax(longitude))
    margin, middle = max(0.35 * (high - low), LEAST_SHOWN_DEG), float(np.nanmedian(longitude))
    across = Scale(0.0, 1.05 * float(np.nanmax(polar.range_rsun)), LEFT, WIDTH - RIGHT)
    upward = Scale(low - margin, high + margin, HEIGHT + SPIRAL_HEIGHT - BOTTOM, HEIGHT + TOP)
    ticks = {tick: f"{tick:g}" for tick in across.ticks(8)}
    yield from grid(across, upward, ticks, _written(upward.ticks(6)), "HEE longitude (°, west positive)")
    centre = (across.start + across.end) / 2
    yield words("Distance (R\N{SUN})", centre, upward.start + 36, class_="axis-name", text_anchor="middle")
    outward = np.linspace(SPIRAL_ORIGIN_RSUN, across.high, 60)
    band = spiral_band(posterior, outward)
    if band is not None:
        yield from _spread(band, middle, across, upward, name)
    for outline in ellipses(posterior, longitude):
        held = np.clip(outline, (across.low, upward.low), (across.high, upward.high))
        places = np.column_stack([across(held[:, 0]), upward(held[:, 1])])
        yield path(places, closed=True, class_=f"region p68 {name}")
    lines = list(spiral_lines(fits, outward, middle))
    for kind, _, line_deg in lines:
        yield path(_inside(line_deg, across, upward), class_=_fit_class(kind, name))
    share = Scale(float(polar.frequency_mhz.min()), float(polar.frequency_mhz.max()) * 1.0001, 0.0, 1.0, is_log=True)
    kept = np.unique(np.linspace(0, len(longitude) - 1, MOST_DOTS).astype(int))
    for index in kept[np.isfinite(longitude[kept])]:
        x, y = float(across(polar.range_rsun[index])), float(upward(longitude[index]))
        colour = colour_at(float(share(polar.frequency_mhz[index])))
        yield element("circle", cx=x, cy=y, r=2.6, fill=colour, class_="place")
    for row, (kind, said, _) in enumerate(lines):
        y = upward.end + 12 + 15 * row
        yield line(across.end - 276, y - 4, across.end - 252, y - 4, class_=f"{_fit_class(kind, name)} wide")
        yield words(said, across.end - 246, y, class_="tick halo wide")


def _fit_class(kind: str, edge: str) -> str:
    return f"fit joint {edge}" if kind == "joint" else f"fit {kind}"


def _without_jumps(track: PolarTrack) -> FloatArray:
    """Longitudes that do not jump by a turn on the way outward, degrees."""
    order = np.argsort(track.range_rsun, kind="stable")
    longitude = np.empty_like(track.longitude_deg)
    longitude[order] = np.unwrap(track.longitude_deg[order], period=360.0)
    return longitude


def _inside(points: FloatArray, across: Scale, upward: Scale) -> FloatArray:
    """Places of distances and longitudes, without those outside the panel."""
    held = (points[:, 0] <= across.high) & (points[:, 1] >= upward.low) & (points[:, 1] <= upward.high)
    places = np.column_stack([across(points[:, 0]), upward(points[:, 1])])
    places[~held] = np.nan
    return places


def _spread(band: SpiralBand, middle_deg: float, across: Scale, upward: Scale, name: str) -> Iterator[str]:
    """Where the spiral of the joint fit lies, by its draws."""
    moved = float(_nearest_turn(band.median_deg, middle_deg)[0] - band.median_deg[0])
    for percent in PERCENTS:
        ends = [np.clip(one[percent] + moved, upward.low, upward.high) for one in (band.low_deg, band.high_deg)]
        outline = np.concatenate(
            [np.column_stack([band.range_rsun, ends[0]]), np.column_stack([band.range_rsun, ends[1]])[::-1]]
        )
        places = np.column_stack([across(outline[:, 0]), upward(outline[:, 1])])
        yield path(places, closed=True, class_=f"spiral-band p{percent} {name}")


def ellipses(posterior: xr.Dataset, longitude_deg: FloatArray) -> Iterator[FloatArray]:
    """One standard deviation in distance and longitude, for some of the positions that have a longitude.

    Parameters
    ----------
    longitude_deg : ndarray, shape (F,)
        Of its positions, without jumps.

    Yields
    ------
    ndarray, shape (P, 2)
        Distance, solar radii, and longitude, degrees.
    """
    place, covariance = polar_covariance(*planar_positions(posterior))
    distance = place[:, 0]
    far = np.flatnonzero(has_longitude(distance, covariance[:, 0, 0]))
    if not far.size:
        return
    wanted = np.linspace(distance[far].min(), distance[far].max(), ELLIPSES)
    angle = np.linspace(0.0, 2 * np.pi, ELLIPSE_POINTS)
    for index in far[np.unique(np.abs(distance[far][:, None] - wanted).argmin(axis=0))]:
        squared, axis = np.linalg.eigh(covariance[index])
        turned = (axis * np.sqrt(np.maximum(squared, 0.0))) @ np.array([np.cos(angle), np.sin(angle)])
        yield np.array([distance[index], longitude_deg[index]]) + turned.T


def spiral_lines(
    fits: Mapping[str, Any], range_rsun: FloatArray, middle_deg: float
) -> Iterator[tuple[str, str, FloatArray]]:
    """Lines of the unweighted, the weighted, the joint and the broken spiral.

    Parameters
    ----------
    fits : mapping
        By name; one that is missing, or has no parameters, is left out.
    range_rsun : ndarray, shape (R,)
    middle_deg : float
        On the turn of this longitude.

    Yields
    ------
    points : ndarray, shape (N, 2)
        Distance, solar radii, and longitude, degrees.
    """
    for kind, said in DRAWN_FITS.items():
        fit = fits.get(kind) or {}
        if _mean(fit, "phi0_deg") is None or _mean(fit, "v_sw_km_s") is None:
            continue
        phi0, speed = float(fit["phi0_deg"]["mean"]), float(fit["v_sw_km_s"]["mean"])
        longitude = spiral_longitude_deg(range_rsun, phi0, speed, float(fit["rotation_period_d"]))
        yield kind, f"{said}: {written_wind(fit)}", np.column_stack([range_rsun, _nearest_turn(longitude, middle_deg)])
    broken = fits.get("piecewise") or {}
    segments = broken.get("segments", [])
    if len(segments) < 2 or _mean(broken, "phi0_deg") is None:
        return
    ends = [SPIRAL_ORIGIN_RSUN] + [float(segment["to_rsun"]) for segment in segments]
    steps = [one["slope_deg_per_rsun"]["mean"] * width for one, width in zip(segments, np.diff(ends), strict=True)]
    heights = _nearest_turn(float(broken["phi0_deg"]["mean"]) + np.cumsum([0.0, *steps]), middle_deg)
    said = ", ".join((written_wind(segment) or NO_SPIRAL).removesuffix(" km/s") for segment in segments)
    yield "broken", f"broken: {said} km/s", np.column_stack([ends, heights])


def _mean(fit: Mapping[str, Any], name: str) -> float | None:
    value = (fit.get(name) or {}).get("mean")
    return None if value is None else float(value)


def _nearest_turn(line_deg: FloatArray, middle_deg: float) -> FloatArray:
    """A line, moved by whole turns to where the track is drawn."""
    return np.asarray(line_deg + 360.0 * np.round((middle_deg - np.median(line_deg)) / 360.0))

"""Against frequency: distance of the source with what density models emit there, speed of the beam, and residuals."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from bella.heliosphere import DENSITY_MODELS, emission_range_rsun
from bella.plotting.geometry import PolarTrack, polar_track
from bella.plotting.palette import FREQUENCY_TICKS_MHZ, track_style
from bella.plotting.svg import Scale, element, figure, line, path, words
from bella.units import FloatArray

WIDTH, HEIGHT = 620.0, 330.0
LEFT, RIGHT, TOP, BOTTOM = 52.0, 12.0, 24.0, 44.0
DISTANCE_TICKS_RSUN = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
SPEED_TICKS_C = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
MODELS = ("leblanc",)
MOST_ERRORS = 40
RESIDUAL_MARKS = ("circle", "square", "triangle", "diamond", "cross")


def evolution_figure(posterior: xr.Dataset, track_fit: Mapping[str, Any]) -> str:
    """Distance of the source, and speed of the beam, against frequency; SVG.

    Parameters
    ----------
    posterior : xarray.Dataset
        Of the positions, HEE.
    track_fit : mapping
        As kept in the catalogue: the profile of its joint fit is drawn as a band.

    Returns
    -------
    str
    """
    polar = polar_track(posterior)
    profile = sorted((track_fit.get("joint") or {}).get("profile") or (), key=lambda one: one["frequency_mhz"])
    name = f"edge-{track_style(str(posterior.attrs.get('edge', '')), 0).name}"
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
        *_axes(left, distance, DISTANCE_TICKS_RSUN, "Distance from the Sun (R\N{SUN})"),
        *_models(left, distance),
        *_band(profile, "range_rsun", left, distance, name),
        *_errors(polar, left, distance, name),
        *_axes(right, speed, SPEED_TICKS_C, "Speed of the beam (c)"),
        *_band(profile, "beam_speed_c", right, speed, name),
    ]
    if not speeds:
        parts.append(
            words("not fitted", (right.start + right.end) / 2, HEIGHT / 2, class_="tick", text_anchor="middle")
        )
    title = "Distance of the source from the Sun, and speed of the beam, against frequency, with 68 % intervals."
    return figure("evolution", (WIDTH, HEIGHT), title, *parts)


def residual_figure(posterior: xr.Dataset) -> str:
    """Arrival times less those of the posterior mean, by spacecraft, against frequency; SVG.

    Parameters
    ----------
    posterior : xarray.Dataset
        With ``residual_s`` and ``sigma_s``.

    Returns
    -------
    str
    """
    frequency = posterior["frequency"].to_numpy().astype(np.float64)
    residual = posterior["residual_s"].to_numpy().astype(np.float64)
    across = Scale(float(frequency.min()) / 1.1, float(frequency.max()) * 1.1, LEFT, WIDTH - RIGHT, is_log=True)
    reach = max(1.0, 1.15 * float(np.nanmax(np.abs(residual), initial=0.0)))
    upward = Scale(-reach, reach, HEIGHT - BOTTOM, TOP)
    parts = [*_axes(across, upward, upward.ticks(5), "Residual of the arrival time (s)")]
    parts.append(line(across.start, float(upward(0.0)), across.end, float(upward(0.0)), class_="axis"))
    for index, name in enumerate(str(one) for one in posterior["observatory"].to_numpy()):
        places = np.column_stack([across(frequency), upward(residual[:, index])])
        x = LEFT + 10 + 110 * index
        parts += [element("g", *_marks(places, index), class_=f"series s{index}")]
        parts += [element("g", *_marks(np.array([[x, TOP + 10.0]]), index), class_=f"series s{index}")]
        parts.append(words(name, x + 9, TOP + 14, class_="tick"))
    return figure("residuals", (WIDTH, HEIGHT), "Residuals of the arrival times of each spacecraft.", *parts)


def evolution_caption() -> str:
    """What the figure of distance and speed shows, for a file of its own."""
    return (
        "Distance of the source, and speed of the beam, against frequency. Points: positions with one standard "
        "deviation. Bands: joint fit, 68 %. Grey: where the density of Leblanc et al. (1998) emits, fundamental drawn "
        "out, harmonic dashed."
    )


def residual_caption() -> str:
    """What the figure of the residuals shows, for a file of its own."""
    return "Arrival times less those of the mean of the posterior, at each frequency and spacecraft."


def _marks(places: FloatArray, index: int) -> Iterator[str]:
    """Markers of a spacecraft, so that colour is never the only difference."""
    sides = (0, 4, 3, 4, 3)[index % len(RESIDUAL_MARKS)]
    turn = (0.0, np.pi / 4, np.pi / 2, 0.0, -np.pi / 2)[index % len(RESIDUAL_MARKS)]
    for x, y in places[np.isfinite(places).all(axis=1)]:
        if not sides:
            yield element("circle", cx=x, cy=y, r=3)
            continue
        angle = turn + 2 * np.pi * np.arange(sides) / sides
        yield path(np.column_stack([x + 4 * np.cos(angle), y - 4 * np.sin(angle)]), closed=True)


def _axes(across: Scale, upward: Scale, ticks: Sequence[float], name: str) -> Iterator[str]:
    for tick in across.among(FREQUENCY_TICKS_MHZ):
        x = float(across(tick))
        yield line(x, upward.end, x, upward.start, class_="gridline")
        yield words(f"{tick:g}", x, upward.start + 18, class_="tick", text_anchor="middle")
    for tick in upward.among(ticks):
        y = float(upward(tick))
        yield line(across.start, y, across.end, y, class_="gridline")
        yield words(
            f"{tick:.3g}".replace("-", "\N{MINUS SIGN}"), across.start - 6, y + 4, class_="tick", text_anchor="end"
        )
    yield words("MHz", (across.start + across.end) / 2, upward.start + 36, class_="axis-name", text_anchor="middle")
    yield words(name, across.start - 30, upward.end - 9, class_="axis-name")


def _models(across: Scale, upward: Scale) -> Iterator[str]:
    """Where a density model emits each frequency: fundamental drawn out, harmonic dashed."""
    frequency = np.geomspace(across.low, across.high, 60)
    for name in MODELS:
        model = DENSITY_MODELS[name]
        for harmonic, kind in ((1, "model"), (2, "model harmonic")):
            distance = emission_range_rsun(frequency, model, harmonic)
            shown = np.isfinite(distance) & (distance >= upward.low) & (distance <= upward.high)
            places = np.column_stack([across(frequency), upward(np.maximum(distance, 1e-3))])[shown]
            if len(places):
                said = f"{model.name.capitalize()} density, {'fundamental' if harmonic == 1 else 'harmonic'}"
                yield element("g", element("title", said), path(places, class_=kind))


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

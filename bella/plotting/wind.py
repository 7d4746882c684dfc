"""Map of the solar wind in the ecliptic with the track of a burst, and the wind along the track, as a PNG file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from bella.flags import APPARENT_SOURCE
from bella.plotting.palette import INK, SUN, TRACK_STYLES
from bella.plotting.printed import save_png
from bella.solar_wind import FieldLine, SteadyWind
from bella.spacecraft import cartesian, hee_from, polar
from bella.units import AU_RSUN, FloatArray

OUTLINED = withStroke(linewidth=2.2, foreground="white")
RINGS_RSUN = (50.0, 100.0, 150.0)
MARGIN = 1.06


@dataclass(frozen=True)
class WindScene:
    """What is drawn over a map of the wind; all in HEE at one time.

    Attributes
    ----------
    utc : numpy.datetime64
    source_rsun : ndarray, shape (F, 3)
        Sources of a burst, solar radii; empty for none.
    field_line : FieldLine or None
    receiver_rsun : mapping of str to ndarray, shape (3,)
        Spacecraft, solar radii.
    spiral_rsun : ndarray, shape (N, 3)
        Spiral that was fitted to the sources, solar radii; empty for none.
    along_km_s, along_sd_km_s : ndarray, shape (F,)
        Speed of the wind at the sources and its standard deviation; NaN where it is not known; empty for none.
    """

    utc: np.datetime64
    source_rsun: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    field_line: FieldLine | None = None
    receiver_rsun: Mapping[str, FloatArray] = field(default_factory=dict)
    spiral_rsun: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    along_km_s: FloatArray = field(default_factory=lambda: np.empty(0))
    along_sd_km_s: FloatArray = field(default_factory=lambda: np.empty(0))


def write_wind_map_png(path: Path, wind: SteadyWind, scene: WindScene) -> None:
    """Write a map of the wind with a burst in it as a PNG; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    wind : SteadyWind
        As :meth:`bella.solar_wind.WindAssimilation.map_at` returns it.
    scene : WindScene
    """
    known = np.isfinite(scene.along_km_s)
    if known.any():
        figure = Figure(figsize=(7.2, 9.0), layout="constrained")
        axes, below = figure.subplots(2, 1, height_ratios=(4, 1))
        _draw_along(below, scene, known)
    else:
        figure = Figure(figsize=(7.2, 7.0), layout="constrained")
        axes = figure.add_subplot()
    _draw_wind(figure, axes, wind, scene.utc)
    _draw_surroundings(axes, scene.receiver_rsun)
    _draw_track(axes, scene)
    _finish(axes, wind, scene.utc)
    figure.legend(loc="outside lower center", fontsize=8, frameon=False, ncols=2)
    save_png(figure, path)


def _draw_wind(figure: Figure, axes: Axes, wind: SteadyWind, utc: np.datetime64) -> None:
    width = 360.0 / wind.longitude_deg.size
    edges = np.append(wind.longitude_deg - 0.5 * width, wind.longitude_deg[-1] + 0.5 * width)
    step = wind.range_rsun[1] - wind.range_rsun[0]
    distance = np.append(wind.range_rsun - 0.5 * step, wind.range_rsun[-1] + 0.5 * step)
    _, hee_deg, _ = polar(hee_from("carrington", cartesian(1.0, edges, 0.0), utc))
    x, y = (np.outer(distance, of(np.radians(hee_deg))) for of in (np.cos, np.sin))
    mesh = axes.pcolormesh(x, y, wind.speed_km_s, cmap="YlOrBr", shading="flat", rasterized=True, zorder=0)
    figure.colorbar(mesh, ax=axes, shrink=0.8, aspect=32, pad=0.01, label="Solar wind speed (km/s)")


def _draw_surroundings(axes: Axes, receivers: Mapping[str, FloatArray]) -> None:
    angle = np.linspace(0.0, 2 * np.pi, 361)
    axes.plot(AU_RSUN * np.cos(angle), AU_RSUN * np.sin(angle), color=INK, lw=1.1, ls=":", zorder=2, label="1 au")
    for ring in RINGS_RSUN:
        axes.plot(ring * np.cos(angle), ring * np.sin(angle), color=INK, lw=0.5, alpha=0.35, zorder=1)
        axes.annotate(f"{ring:g}", (0.0, -ring), fontsize=7, color=INK, ha="center", path_effects=[OUTLINED])
    axes.plot(0, 0, "o", color=SUN, ms=10, mec="#a87b00", zorder=5)
    for name, (x, y, _) in receivers.items():
        axes.plot(x, y, "^", color="white", mec=INK, mew=1.4, ms=9, zorder=6)
        axes.annotate(
            name,
            (x, y),
            xytext=(0, 9 if y >= 0 else -10),
            textcoords="offset points",
            ha="right" if x > 0.8 * AU_RSUN else "center",
            va="bottom" if y >= 0 else "top",
            fontsize=9,
            color=INK,
            path_effects=[OUTLINED],
            zorder=7,
        )


def _draw_track(axes: Axes, scene: WindScene) -> None:
    line = scene.field_line
    if line is not None:
        angle = np.radians(line.longitude_deg)
        x, y = line.range_rsun * np.cos(angle), line.range_rsun * np.sin(angle)
        axes.plot(x, y, color=INK, lw=1.4, ls="--", zorder=5, label="field line of this wind")
    if len(scene.spiral_rsun):
        x, y = scene.spiral_rsun[:, 0], scene.spiral_rsun[:, 1]
        axes.plot(x, y, color=TRACK_STYLES[3].colour, lw=1.4, ls=":", zorder=5, label="spiral of the joint fit")
    if len(scene.source_rsun):
        style = TRACK_STYLES[0]
        x, y = scene.source_rsun[:, 0], scene.source_rsun[:, 1]
        white = [withStroke(linewidth=5.0, foreground="white")]
        axes.plot(x, y, color=style.colour, lw=3, path_effects=white, zorder=4, label=f"track, {APPARENT_SOURCE}")


def _draw_along(axes: Axes, scene: WindScene, known: npt.NDArray[np.bool_]) -> None:
    """Wind at the sources by distance, with a band of one standard deviation."""
    distance = np.linalg.norm(scene.source_rsun[known], axis=1)
    order = np.argsort(distance)
    distance, speed, sd = distance[order], scene.along_km_s[known][order], scene.along_sd_km_s[known][order]
    colour = TRACK_STYLES[0].colour
    axes.fill_between(distance, speed - sd, speed + sd, color=colour, alpha=0.25, lw=0)
    axes.plot(distance, speed, color=colour, lw=2)
    axes.set_xlabel(r"Distance of the source ($R_\odot$)")
    axes.set_ylabel("Wind along\nthe track (km/s)")


def _finish(axes: Axes, wind: SteadyWind, utc: np.datetime64) -> None:
    reach = MARGIN * float(wind.range_rsun[-1])
    axes.set_aspect("equal")
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_xlabel(r"HEE X ($R_\odot$), Earth to the right")
    axes.set_ylabel(r"HEE Y ($R_\odot$)")
    when = str(utc.astype("datetime64[m]")).replace("T", " ")
    axes.set_title(f"Solar wind, {when} UTC", fontsize=9, loc="left", color=INK)

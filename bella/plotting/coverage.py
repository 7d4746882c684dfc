"""The uncertainty map as a PNG file."""

from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedLocator, NullLocator

from bella.plotting.palette import INK, SUN
from bella.plotting.printed import save_png
from bella.units import AU_RSUN, FloatArray

CONTOURS_RSUN = (10.0, 15.0, 25.0, 50.0)
TICKS_RSUN = (1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0, 80.0, 120.0, 200.0)
OUTLINED = withStroke(linewidth=2.2, foreground="white")
RECEIVERS_PER_LINE = 4
CROWDED_RSUN = 40.0
"""A receiver this close to another has its name on the other side."""


def write_coverage_png(path: Path, uncertainty: xr.Dataset) -> None:
    """Write an uncertainty map as a PNG; the file appears whole or not at all.

    The largest standard deviation of the exact posterior is drawn where the map has it, of the closed form otherwise;
    where the closed form is off, the map is hatched, or outlined if it is exact.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    uncertainty : xarray.Dataset
        As :func:`bella.multilateration.uncertainty_map` returns it.
    """
    figure = Figure(figsize=(7.2, 6.4), layout="constrained")
    axes = figure.add_subplot()
    exact = "exact_sd_largest_rsun" in uncertainty
    _draw_map(figure, axes, uncertainty["exact_sd_largest_rsun" if exact else "sd_largest_rsun"])
    _draw_off(axes, uncertainty["closed_form_off"], hatched=not exact)
    _draw_bodies(axes, uncertainty)
    _finish(axes, uncertainty, exact=exact)
    save_png(figure, path)


def _draw_map(figure: Figure, axes: Axes, sd: xr.DataArray) -> None:
    x, y, values = sd["x"].to_numpy(), sd["y"].to_numpy(), sd.to_numpy()
    low, high = float(values.min()), float(values.max())
    # far sources of a flat map differ in the last digits: give the scale a width
    high = max(high, 1.05 * low)
    mesh = axes.pcolormesh(x, y, values, norm=LogNorm(low, high), cmap="YlGnBu", shading="nearest", rasterized=True)
    bar = figure.colorbar(mesh, ax=axes, shrink=0.85, label=r"Standard deviation in the worst direction ($R_\odot$)")
    shown = [level for level in CONTOURS_RSUN if low < level < high]
    if shown:
        lines = axes.contour(x, y, values, levels=shown, colors=INK, linewidths=1.1)
        for label in axes.clabel(lines, fmt=lambda level: f"{level:g}", fontsize=8):
            label.set_path_effects([OUTLINED])
        bar.add_lines(lines)
    ticks = [tick for tick in TICKS_RSUN if low <= tick <= high] or [low]
    bar.ax.yaxis.set_major_locator(FixedLocator(ticks))
    bar.ax.yaxis.set_minor_locator(NullLocator())
    bar.ax.set_yticks(ticks, [f"{tick:.3g}" for tick in ticks])


def _draw_off(axes: Axes, off: xr.DataArray, *, hatched: bool) -> None:
    x, y, values = off["x"].to_numpy(), off["y"].to_numpy(), off.to_numpy().astype(float)
    if hatched and values.any():
        region = axes.contourf(x, y, values, levels=[0.5, 1.5], colors="none", hatches=["////"])
        region.set_edgecolor((1.0, 1.0, 1.0, 0.45))
        region.set_linewidth(0)
    if 0 < values.mean() < 1:
        axes.contour(x, y, values, levels=[0.5], colors="#b3261e", linewidths=1.0, linestyles="--")


def _draw_bodies(axes: Axes, uncertainty: xr.Dataset) -> None:
    angle = np.linspace(0.0, 2 * np.pi, 361)
    axes.plot(AU_RSUN * np.cos(angle), AU_RSUN * np.sin(angle), color=INK, lw=1.1, ls=":")
    axes.plot(0, 0, "o", color=SUN, ms=9, mec="#a87b00", zorder=5)
    names, positions = uncertainty["observatory"].to_numpy(), uncertainty["receiver_rsun"].to_numpy()[:, :2]
    axes.plot(*positions.T, "^", color="white", mec=INK, mew=1.4, ms=9, zorder=6)
    for name, place, above in zip(names, positions, _names_above(positions), strict=True):
        _label(axes, str(name), place, above=above)


def _names_above(positions: FloatArray) -> list[bool]:
    """Whether each name stands above its receiver: away from the Sun, unless the name of a close one is there."""
    above: list[bool] = []
    for i, place in enumerate(positions):
        close = np.flatnonzero(np.linalg.norm(positions[:i] - place, axis=1) < CROWDED_RSUN)
        above.append(not above[close[-1]] if close.size else bool(place[1] > -1))
    return above


def _label(axes: Axes, name: str, place: FloatArray, *, above: bool) -> None:
    axes.annotate(
        name,
        (place[0], place[1]),
        xytext=(0, 9 if above else -10),
        textcoords="offset points",
        ha="center",
        va="bottom" if above else "top",
        fontsize=9,
        color=INK,
        annotation_clip=True,
        path_effects=[OUTLINED],
        zorder=7,
    )


def _finish(axes: Axes, uncertainty: xr.Dataset, *, exact: bool) -> None:
    x, y = uncertainty["x"].to_numpy(), uncertainty["y"].to_numpy()
    axes.set_aspect("equal")
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(y[0], y[-1])
    axes.set_xlabel(r"HEE X ($R_\odot$), Earth to the right")
    axes.set_ylabel(r"HEE Y ($R_\odot$)")
    axes.set_title(_title(uncertainty, exact=exact), fontsize=9, loc="left", color=INK)
    hatch = Patch(facecolor="none", edgecolor="0.4", hatch="////", label="closed form off by more than 10 %")
    outline = Line2D([], [], color="#b3261e", lw=1.0, ls="--", label="border of where the closed form is within 10 %")
    au = Line2D([], [], color=INK, lw=1.1, ls=":", label="1 au")
    axes.legend(handles=[outline if exact else hatch, au], loc="upper right", fontsize=7.5, framealpha=0.9)


def _title(uncertainty: xr.Dataset, *, exact: bool) -> str:
    names, sigma_s = uncertainty["observatory"].to_numpy(), uncertainty["sigma_s"].to_numpy()
    timed = [f"{name} {value:g} s" for name, value in zip(names, sigma_s, strict=True)]
    lines = [", ".join(timed[i : i + RECEIVERS_PER_LINE]) for i in range(0, len(timed), RECEIVERS_PER_LINE)]
    method = "exact posterior" if exact else "closed form"
    epoch = uncertainty.attrs["epoch"]
    when = "" if epoch == "not stated" else f", {epoch.removesuffix('Z').removesuffix(':00').replace('T', ' ')} UTC"
    return "\n".join([f"Uncertainty of the position of a burst, {method}{when}", *lines])

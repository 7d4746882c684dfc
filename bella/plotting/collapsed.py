"""Light curves of a burst on the time axis of the profile that its spacecraft share."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bella.exceptions import InputError
from bella.plotting.palette import INK, TRACK_STYLES
from bella.plotting.printed import require_columns, save_png

COLUMNS = ("observatory", "frequency_mhz", "widths", "height", "fitted")
BANDS = 4
"""Panels, from high to low frequencies."""

SPAN = (-4.0, 3.5)
"""Widths about the half-rise that are shown."""


def write_collapsed_png(path: Path, samples: pd.DataFrame) -> None:
    """Write the light curves of a burst, shifted and stretched on one another, as a PNG.

    Where they lie on one line, their spacecraft saw the same burst.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    samples : pandas.DataFrame
        One row per sample: observatory; frequency_mhz; widths, its time after the half-rise in widths; height, its
        power over that of the burst; fitted, what the shared profile has there.

    Raises
    ------
    InputError
        If there is no sample, or a column is missing.
    """
    known = require_columns(samples, COLUMNS, "table of samples")
    if known.empty:
        raise InputError("there is no sample to draw: fit a shared profile first")
    names = list(dict.fromkeys(known["observatory"]))
    log_f = np.log(known["frequency_mhz"].to_numpy(dtype=np.float64))
    limits = np.exp(np.linspace(log_f.max(), log_f.min(), BANDS + 1))
    figure = Figure(figsize=(3.4 * BANDS, 5.6), layout="constrained")
    axes = figure.subplots(2, BANDS, sharex=True, sharey="row", height_ratios=(2, 1))
    for column in range(BANDS):
        high, low = limits[column] * (1 + 1e-9), limits[column + 1] * (1 - 1e-9)
        band = known[known["frequency_mhz"].between(low, high)]
        _draw(axes[0, column], axes[1, column], band, names)
        axes[0, column].set_title(f"{limits[column + 1]:.2g} to {limits[column]:.2g} MHz", color=INK, fontsize=10)
        axes[1, column].set_xlabel("time after half-rise / width")
    axes[0, 0].set_ylabel("power / height of the burst")
    axes[1, 0].set_ylabel("less the profile")
    axes[0, 0].legend(loc="upper left", fontsize=8, frameon=False)
    axes[0, 0].set_xlim(*SPAN)
    axes[1, 0].set_ylim(-0.2, 0.2)
    save_png(figure, path)


def _draw(curves: Axes, residuals: Axes, band: pd.DataFrame, names: list[str]) -> None:
    for number, name in enumerate(names):
        style = TRACK_STYLES[number % len(TRACK_STYLES)]
        rows = band[band["observatory"] == name]
        for axes, shown in ((curves, rows["height"]), (residuals, rows["height"] - rows["fitted"])):
            axes.scatter(
                rows["widths"], shown, s=9, alpha=0.6, color=style.colour, marker=style.printed_marker, label=name
            )
    curves.axhline(0.5, color=INK, lw=0.6, ls=":")
    residuals.axhline(0.0, color=INK, lw=0.6)

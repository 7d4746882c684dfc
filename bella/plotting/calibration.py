"""P-P curves of a calibration run as a PNG file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bella.calibration import Comparison
from bella.calibration.ranks import pp_curve, simultaneous_band
from bella.plotting.palette import INK
from bella.plotting.printed import save_png
from bella.units import FloatArray

COLUMNS = 5
POINTS = 100
COLOURS = 48
DEPARTURE = 0.12
"""Largest difference shown where the model is the truth."""
CURVES = {
    "x": ("#1f7fc1", "-"),
    "y": ("#d95f02", "-"),
    "z": ("#11936b", "-"),
    "emission": ("#b8508f", "--"),
    "speed": ("#8a6d00", ":"),
    "density": (INK, "-."),
}
MISFIT = "#b02a2a"


@dataclass(frozen=True)
class Panel:
    """P-P curves of one stratum at the probabilities 1/K, 2/K .. 1, K = `POINTS`.

    Attributes
    ----------
    title : str
    curves : mapping of str to ndarray, shape (K,)
        Share of truths below each quantile, for each of `CURVES` that there is.
    band : tuple of ndarray, each of shape (K,)
        Between which shares a curve should stay.
    declared : bool
        Whether truth and fitted model are the same.
    """

    title: str
    curves: Mapping[str, FloatArray]
    band: tuple[FloatArray, FloatArray]
    declared: bool


def comparison_panels(comparisons: Sequence[Comparison]) -> list[Panel]:
    """A panel of P-P curves for each stratum that was compared.

    Parameters
    ----------
    comparisons : sequence of Comparison

    Returns
    -------
    list of Panel
    """
    return [
        Panel(
            title=one.stratum.name,
            curves={name: pp_curve(ranks, POINTS) for name, ranks in one.ranks.items()},
            band=simultaneous_band(one.sources, POINTS),
            declared=one.stratum.misfit is None,
        )
        for one in comparisons
    ]


def write_calibration_png(path: Path, panels: Sequence[Panel]) -> None:
    """Write P-P curves, each less the diagonal, with their bands; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    panels : sequence of Panel
        At least one.
    """
    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(1.2 + 2.0 * max(columns, 3), 0.9 + 1.55 * rows), layout="constrained")
    places = np.atleast_1d(figure.subplots(rows, columns, sharex=True)).ravel()
    for axes, panel in zip(places, panels, strict=False):
        _draw_panel(axes, panel)
    for axes in places[len(panels) :]:
        axes.set_axis_off()
    handles = {str(line.get_label()): line for axes in places for line in axes.get_lines()}
    names = [name for name in CURVES if name in handles]
    figure.legend(
        [handles[name] for name in names],
        names,
        loc="outside upper center",
        ncols=len(names),
        fontsize=9,
        frameon=False,
    )
    figure.supxlabel("quantile of the posterior", fontsize=9)
    figure.supylabel("share of truths below, less the quantile", fontsize=9)
    save_png(figure, path, colours=COLOURS)


def _draw_panel(axes: Axes, panel: Panel) -> None:
    probability = np.arange(1, POINTS + 1) / POINTS
    low, high = (edge - probability for edge in panel.band)
    axes.fill_between(probability, low, high, color="0.85", lw=0)
    for name, curve in panel.curves.items():
        colour, style = CURVES[name]
        axes.plot(probability, curve - probability, color=colour, ls=style, lw=1.1, label=name)
    if panel.declared:
        reach = max(DEPARTURE, 1.6 * float(high.max()))
        axes.set_ylim(-reach, reach)
    axes.set_xlim(0, 1)
    axes.tick_params(labelsize=7)
    axes.set_title(panel.title, fontsize=8, color=INK if panel.declared else MISFIT)

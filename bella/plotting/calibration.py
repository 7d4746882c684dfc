"""P-P curves of a calibration run, SVG."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bella.calibration import Comparison
from bella.calibration.ranks import pp_curve, simultaneous_band
from bella.plotting.svg import Scale, figure, line, path, words
from bella.units import FloatArray

COLUMNS, LEAST_COLUMNS = 5, 3
POINTS = 100
DEPARTURE = 0.12
"""Least difference that a panel has room for; one whose truth the model does not know has room for all of its own."""

CURVES = ("x", "y", "z", "emission", "speed", "density")
LEFT, TOP, PANEL_WIDTH, PANEL_HEIGHT, GAP_X, GAP_Y, FOOT = 52.0, 48.0, 168.0, 96.0, 50.0, 30.0, 24.0


@dataclass(frozen=True)
class Panel:
    """P-P curves of one stratum at the probabilities 1/K, 2/K .. 1, K = `POINTS`.

    Attributes
    ----------
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
    """A panel of P-P curves for each stratum that was compared."""
    return [
        Panel(
            title=one.stratum.name,
            curves={name: pp_curve(ranks, POINTS) for name, ranks in one.ranks.items()},
            band=simultaneous_band(one.sources, POINTS),
            declared=one.stratum.misfit is None,
        )
        for one in comparisons
    ]


def calibration_figure(panels: Sequence[Panel]) -> str:
    """P-P curves, each less the diagonal, with their bands; SVG.

    Parameters
    ----------
    panels : sequence of Panel
        At least one.
    """
    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    width = LEFT + max(columns, LEAST_COLUMNS) * (PANEL_WIDTH + GAP_X)
    height = TOP + rows * (PANEL_HEIGHT + GAP_Y) + FOOT
    parts: list[str] = []
    for index, panel in enumerate(panels):
        row, column = divmod(index, columns)
        left, top = LEFT + column * (PANEL_WIDTH + GAP_X), TOP + row * (PANEL_HEIGHT + GAP_Y)
        is_last = index + columns >= len(panels)
        parts += _panel(panel, Scale(0.0, 1.0, left, left + PANEL_WIDTH), top, is_last=is_last)
    names = [name for name in CURVES if any(name in panel.curves for panel in panels)]
    for index, name in enumerate(names):
        x = LEFT + 110 * index
        parts.append(line(x, 14, x + 22, 14, class_=f"pp {name}"))
        parts.append(words(name, x + 28, 18, class_="tick"))
    parts.append(
        words("Quantile of the posterior", (LEFT + width) / 2, height - 8, class_="axis-name", text_anchor="middle")
    )
    title = "Share of truths below each quantile, less the quantile, for each case of the calibration."
    return figure("calibration", (width, height), title, *parts)


def calibration_caption() -> str:
    """What the P-P curves show, for a file of its own."""
    return (
        "Share of truths below each quantile of the posterior, less the quantile, with the band in which a curve "
        "should stay. Red titles: cases whose truth the fitted model does not know."
    )


def _panel(panel: Panel, across: Scale, top: float, *, is_last: bool) -> Iterator[str]:
    probability = np.arange(1, POINTS + 1) / POINTS
    ends = [edge - probability for edge in panel.band]
    curves = {name: curve - probability for name, curve in panel.curves.items()}
    reach = max(DEPARTURE, 1.6 * float(ends[1].max()))
    if not panel.declared:
        reach = max([reach, *(1.05 * float(np.abs(curve).max()) for curve in curves.values())])
    upward = Scale(-reach, reach, top + PANEL_HEIGHT, top)
    for tick in upward.ticks(4):
        y, said = float(upward(tick)), f"{tick:.2g}".replace("-", "\N{MINUS SIGN}")
        yield line(across.start, y, across.end, y, class_="gridline")
        yield words(said, across.start - 5, y + 4, class_="tick", text_anchor="end")
    if is_last:
        for tick in (0.0, 0.5, 1.0):
            yield words(f"{tick:g}", float(across(tick)), upward.start + 16, class_="tick", text_anchor="middle")
    places = [np.column_stack([across(probability), upward(end)]) for end in ends]
    yield path(np.vstack([places[0], places[1][::-1]]), closed=True, class_="pp-band")
    for name, curve in curves.items():
        yield path(np.column_stack([across(probability), upward(curve)]), class_=f"pp {name}")
    kind = "panel-name" if panel.declared else "panel-name misfit"
    yield words(panel.title, across.start, top - 6, class_=kind)

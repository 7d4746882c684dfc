"""Figures: the constellation with its tracks, the spectra with their timed edges, the uncertainty map, P-P curves.

The figures of the pages are SVG, written without any drawing library; the printed ones are PNG files drawn with
matplotlib, which is imported when one of their functions is first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bella.exceptions import require_extra
from bella.plotting.constellation import MapView, constellation_caption, constellation_figure, thumbnail
from bella.plotting.evolution import evolution_caption, evolution_figure, residual_caption, residual_figure
from bella.plotting.export import (
    KINDS,
    MEDIA_TYPES,
    Caption,
    Kind,
    Theme,
    exported,
    origin_warning,
    write_figure,
    write_whole,
)
from bella.plotting.fleet import day_caption, day_figure
from bella.plotting.geometry import TrackView, polar_track, selected_regions, speed_remark
from bella.plotting.palette import edge_name
from bella.plotting.planning import planning_caption, planning_figure
from bella.plotting.selection import (
    Estimate,
    Marked,
    footpoint_figure,
    longitude_figure,
    selection_caption,
    wind_figure,
)
from bella.plotting.spectra import SpectraView, spectra_caption, spectra_figure
from bella.plotting.svg import figure_style
from bella.plotting.timeline import DayMark, OnsetMark, calendar_figure, strips_figure

if TYPE_CHECKING:
    from bella.plotting.calibration import comparison_panels, write_calibration_png
    from bella.plotting.collapsed import write_collapsed_png
    from bella.plotting.coverage import write_coverage_png
    from bella.plotting.edges import write_edge_figures
    from bella.plotting.light_curves import write_light_curves_png
    from bella.plotting.quick import draw_arrivals, draw_detections, draw_positions, draw_track
    from bella.plotting.track import write_density_png, write_polar_fit_png
    from bella.plotting.wind import WindScene, write_wind_map_png

__all__ = [
    "KINDS",
    "MEDIA_TYPES",
    "Caption",
    "DayMark",
    "Estimate",
    "Kind",
    "MapView",
    "Marked",
    "OnsetMark",
    "SpectraView",
    "Theme",
    "TrackView",
    "WindScene",
    "calendar_figure",
    "comparison_panels",
    "constellation_caption",
    "constellation_figure",
    "day_caption",
    "day_figure",
    "draw_arrivals",
    "draw_detections",
    "draw_positions",
    "draw_track",
    "edge_name",
    "evolution_caption",
    "evolution_figure",
    "exported",
    "figure_style",
    "footpoint_figure",
    "longitude_figure",
    "origin_warning",
    "planning_caption",
    "planning_figure",
    "polar_track",
    "residual_caption",
    "residual_figure",
    "selected_regions",
    "selection_caption",
    "spectra_caption",
    "spectra_figure",
    "speed_remark",
    "strips_figure",
    "thumbnail",
    "wind_figure",
    "write_calibration_png",
    "write_collapsed_png",
    "write_coverage_png",
    "write_density_png",
    "write_edge_figures",
    "write_figure",
    "write_light_curves_png",
    "write_polar_fit_png",
    "write_whole",
    "write_wind_map_png",
]

_DRAWN_IN = {
    "WindScene": "bella.plotting.wind",
    "draw_arrivals": "bella.plotting.quick",
    "draw_detections": "bella.plotting.quick",
    "draw_positions": "bella.plotting.quick",
    "draw_track": "bella.plotting.quick",
    "comparison_panels": "bella.plotting.calibration",
    "write_calibration_png": "bella.plotting.calibration",
    "write_collapsed_png": "bella.plotting.collapsed",
    "write_coverage_png": "bella.plotting.coverage",
    "write_density_png": "bella.plotting.track",
    "write_edge_figures": "bella.plotting.edges",
    "write_light_curves_png": "bella.plotting.light_curves",
    "write_polar_fit_png": "bella.plotting.track",
    "write_wind_map_png": "bella.plotting.wind",
}


def __getattr__(name: str) -> Any:
    if name in _DRAWN_IN:
        require_extra("matplotlib")
        return getattr(import_module(_DRAWN_IN[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

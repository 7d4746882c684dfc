"""Figures: the constellation with its tracks, spectra with their edges, days, maps of the ecliptic, P-P curves.

All are SVG, written without any drawing library, with the colours of `figure.css`: the same on a page and in a file,
as SVG, PNG or PDF, and in a notebook. What needs more than the API may import is imported when one of its functions is
first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bella.plotting.constellation import MapView, constellation_caption, constellation_figure, thumbnail
from bella.plotting.days import (
    DayMark,
    OnsetMark,
    calendar_caption,
    calendar_figure,
    day_caption,
    day_figure,
    strips_figure,
    zoomed_day,
)
from bella.plotting.ecliptic import (
    WindScene,
    coverage_caption,
    coverage_figure,
    planning_caption,
    planning_figure,
    wind_map_caption,
    wind_map_figure,
)
from bella.plotting.evolution import evolution_caption, evolution_figure, residual_caption, residual_figure
from bella.plotting.export import (
    KINDS,
    MEDIA_TYPES,
    Caption,
    Kind,
    Theme,
    exported,
    kind_of,
    origin_warning,
    write_figure,
    write_whole,
)
from bella.plotting.geometry import TrackView, polar_track, selected_regions, speed_remark
from bella.plotting.selection import (
    Estimate,
    Marked,
    footpoint_figure,
    longitude_figure,
    selection_caption,
    wind_figure,
)
from bella.plotting.spectra import SpectraView, spectra_caption, spectra_figure
from bella.plotting.svg import edge_name, figure_style

if TYPE_CHECKING:
    from bella.plotting.calibration import calibration_caption, calibration_figure, comparison_panels
    from bella.plotting.light_curves import (
        light_curves_caption,
        light_curves_figure,
        shared_profile_caption,
        shared_profile_figure,
        write_edge_figures,
    )
    from bella.plotting.notebook import (
        Figure,
        arrivals_figure,
        detections_figure,
        positions_figure,
        track_figure,
    )

_CALIBRATION = ("calibration_caption", "calibration_figure", "comparison_panels")
_LIGHT_CURVES = (
    "light_curves_caption",
    "light_curves_figure",
    "shared_profile_caption",
    "shared_profile_figure",
    "write_edge_figures",
)
_NOTEBOOK = ("Figure", "arrivals_figure", "detections_figure", "positions_figure", "track_figure")

__all__ = [
    "KINDS",
    "MEDIA_TYPES",
    "Caption",
    "DayMark",
    "Estimate",
    "Figure",
    "Kind",
    "MapView",
    "Marked",
    "OnsetMark",
    "SpectraView",
    "Theme",
    "TrackView",
    "WindScene",
    "arrivals_figure",
    "calendar_caption",
    "calendar_figure",
    "calibration_caption",
    "calibration_figure",
    "comparison_panels",
    "constellation_caption",
    "constellation_figure",
    "coverage_caption",
    "coverage_figure",
    "day_caption",
    "day_figure",
    "detections_figure",
    "edge_name",
    "evolution_caption",
    "evolution_figure",
    "exported",
    "figure_style",
    "footpoint_figure",
    "kind_of",
    "light_curves_caption",
    "light_curves_figure",
    "longitude_figure",
    "origin_warning",
    "planning_caption",
    "planning_figure",
    "polar_track",
    "positions_figure",
    "residual_caption",
    "residual_figure",
    "selected_regions",
    "selection_caption",
    "shared_profile_caption",
    "shared_profile_figure",
    "spectra_caption",
    "spectra_figure",
    "speed_remark",
    "strips_figure",
    "thumbnail",
    "track_figure",
    "wind_figure",
    "wind_map_caption",
    "wind_map_figure",
    "write_edge_figures",
    "write_figure",
    "write_whole",
    "zoomed_day",
]


def __getattr__(name: str) -> Any:
    rooms = {"calibration": _CALIBRATION, "light_curves": _LIGHT_CURVES, "notebook": _NOTEBOOK}
    found = next((room for room, names in rooms.items() if name in names), None)
    if found is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"bella.plotting.{found}"), name)

"""What the page of a burst says of its track: every method, footpoint, wind, directions and scattering."""

from typing import Any

from api.drawing import Looked
from api.schemas import SolutionReply, figure_path
from api.summary_section import summary_words
from api.track_section import TrackSection, track_section
from api.wind_section import wind_table
from bella.catalogue import Solution
from bella.plotting import edge_name
from bella.settings import Settings

FIGURES = {
    "polar-fit": (
        "Longitude against distance",
        "Longitude of the source against its distance from the Sun, with the spirals that each method fits.",
    ),
    "density": (
        "Frequency against distance",
        "Frequency against the distance of the source, with the emission of density models.",
    ),
    "wind": (
        "Measured wind and track",
        "Map of the wind speed seen from ecliptic north, with track, spiral and field line; below, wind along it.",
    ),
    "shared-profile": (
        "Light curves on one profile",
        "All light curves, shifted and stretched onto the profile that they share: on one line where the burst is one.",
    ),
}
"""Title and description of each of `bella.settings.FIT_FIGURES`, of `WIND_FIGURE` and of `COLLAPSED_FIGURE`."""


def track_page(looked: Looked, settings: Settings) -> dict[str, Any]:
    """What the templates need for the track of the answer that is shown."""
    solution, track = looked.shown, looked.track
    section: TrackSection | None = None
    if solution:
        section = track_section(SolutionReply.of(solution), track, _drawn(solution, settings))
    return {
        "sections": [section] if section else [],
        "wind": wind_table([track]) if track else None,
        "summary": summary_words(edge_name(solution.series.edge), track) if solution and track else "",
    }


def _drawn(solution: Solution, settings: Settings) -> list[tuple[str, str, str]]:
    """Figures of a solution that the run has drawn; a run may have been killed before it did."""
    return [
        (title, figure_path(solution, name), description)
        for name, (title, description) in FIGURES.items()
        if settings.fit_figure(solution.burst_id, solution.solution_id, name).is_file()
    ]

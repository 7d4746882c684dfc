"""Figures of bursts and days, drawn after what they show is published.

A figure that cannot be drawn ends nothing, except where the disk refuses: then the burst is done again, and what was
published before is found and only drawn.
"""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import structlog
import xarray as xr

from bella import __version__
from bella.bursts.matched_filter import over_quiet
from bella.bursts.timing import SHARED
from bella.catalogue import Detection, Solution
from bella.exceptions import BellaError, StoreError
from bella.pipeline.day import day_spectra
from bella.pipeline.day_files import DayFiles
from bella.pipeline.inputs import BurstInput, origin_of
from bella.pipeline.page_figures import AnswerData, first_look, first_look_path, keep_first_look
from bella.pipeline.progress import counter
from bella.pipeline.surroundings import Surroundings, has_wind, wind_drawn
from bella.plotting import (
    Caption,
    MapView,
    SpectraView,
    TrackView,
    constellation_caption,
    constellation_figure,
    day_figure,
    edge_name,
    origin_warning,
    shared_profile_figure,
    spectra_caption,
    spectra_figure,
    write_figure,
    write_whole,
)
from bella.settings import COLLAPSED_FIGURE, WIND_FIGURE, Settings
from bella.store import open_group, open_tree

log = structlog.get_logger(__name__)

TIMES = ("start_utc", "peak_utc", "end_utc")


@dataclass(frozen=True)
class Drawn:
    """A published solution and its track, to be drawn."""

    solution: Solution
    track: dict[str, Any]

    @property
    def has_positions(self) -> bool:
        """Whether there is a source to draw: not so of a preliminary track."""
        return self.solution.answer.tier == "final"


def draw_burst(given: BurstInput, solutions: Sequence[Drawn], settings: Settings, around: Surroundings) -> None:
    """Draw constellation, wind, spectra and profile of a burst, unless all were drawn after its newest solution.

    Raises
    ------
    OSError, StoreError
        If the disk refuses.
    """
    figures = figure_paths(given, solutions, settings)
    if all(is_drawn(figure, solutions) for figure in figures):
        return
    try:
        _draw(given, solutions, settings, around)
    except (OSError, StoreError):
        raise
    except Exception as error:  # noqa: BLE001 - a picture is not worth a burst, whatever keeps it from being drawn
        log.warning("figures of the burst not drawn", reason=f"{type(error).__name__}: {error}")


def _draw(given: BurstInput, solutions: Sequence[Drawn], settings: Settings, around: Surroundings) -> None:
    positions = [one for one in solutions if one.has_positions]
    answers = {
        one.solution.solution_id: AnswerData(
            one.solution, open_group(settings.store_root, one.solution.store_path), one.track
        )
        for one in solutions
    }
    opened = [answers[one.solution.solution_id] for one in positions]
    views = [TrackView(edge_name(one.solution.series.edge), one.posterior, one.track) for one in opened]
    burst = given.burst
    said, warning = f"Burst {burst.burst_id}. BELLA service {__version__}.", origin_warning(burst.origin)
    advance = counter("figures", len(figure_paths(given, solutions, settings)))
    if positions:
        pairs = list(zip(positions, views, strict=True))
        best_first = [view for one, view in pairs if one.solution.preferred]
        best_first += [view for one, view in pairs if not one.solution.preferred]
        utc = np.datetime64(given.burst.start_utc.replace(tzinfo=None), "ns")
        path = constellation(given, positions[0].solution, settings)
        write_figure(
            path, constellation_figure(best_first, utc, MapView()), Caption(constellation_caption("hee"), said, warning)
        )
        advance(1)
    for one, view in zip(positions, views, strict=True):
        if has_wind(view.track_fit):
            wind = wind_drawn(view.posterior, view.track_fit, around)
            write_whole(wind_figure(one.solution, settings), wind)
            advance(1)
    if given.collapsed is not None:
        profile = shared_profile_figure(given.collapsed)
        for path in collapsed_figures(given, solutions, settings):
            write_whole(path, profile)
            advance(1)
    paths = {one.solution.spectra_path for one in complete(solutions)}
    trees = {path: open_tree(settings.store_root, path) if path else None for path in paths}
    for one in complete(solutions):
        shown = replace(burst, spectra_path=one.solution.spectra_path)
        look = first_look(shown, answers[one.solution.solution_id], trees[shown.spectra_path])
        keep_first_look(page_path(given, one, settings), look)
        advance(1)
    if given.spectra is not None:
        drawn = spectra_figure(given.spectra, given.channel_edges, SpectraView())
        write_figure(spectra_path(given, settings), drawn, Caption(spectra_caption("spacecraft"), said, warning))
        advance(1)


def page_path(given: BurstInput, drawn: Drawn, settings: Settings) -> Path:
    """File of what the page of a burst shows of a solution at first."""
    return first_look_path(replace(given.burst, spectra_path=drawn.solution.spectra_path), drawn.solution, settings)


def complete(solutions: Sequence[Drawn]) -> list[Drawn]:
    """Solutions whose tracks nothing will be added to."""
    return [one for one in solutions if not one.track.get("companions_pending")]


def figure_paths(given: BurstInput, solutions: Sequence[Drawn], settings: Settings) -> list[Path]:
    """Files of the figures of a run; each method and preset has a constellation of its own, the spectra are last."""
    positions = [one for one in solutions if one.has_positions]
    paths = [constellation(given, positions[0].solution, settings)] if positions else []
    paths += [wind_figure(one.solution, settings) for one in positions if has_wind(one.track)]
    paths += collapsed_figures(given, solutions, settings)
    paths += [page_path(given, one, settings) for one in complete(solutions)]
    return [*paths, *([spectra_path(given, settings)] if given.spectra is not None else [])]


def constellation(given: BurstInput, solution: Solution, settings: Settings) -> Path:
    """File of the positions of all edges of a burst."""
    name = f"constellation-{solution.series.method}-{solution.series.preset}.svg"
    return settings.figures_root / given.burst.burst_id / name


def spectra_path(given: BurstInput, settings: Settings) -> Path:
    """File of the spectra of a burst with their edges."""
    return settings.figures_root / given.burst.burst_id / "spectra.svg"


def wind_figure(solution: Solution, settings: Settings) -> Path:
    """File of the map of the wind of one solution, which is drawn where the wind was measured."""
    return settings.solution_figure(solution.burst_id, solution.solution_id, WIND_FIGURE)


def collapsed_figures(given: BurstInput, solutions: Sequence[Drawn], settings: Settings) -> list[Path]:
    """Files of the light curves on their shared profile, one for each solution that was timed by it."""
    timed = [one.solution for one in solutions if given.collapsed is not None and one.solution.series.edge == SHARED]
    return [settings.solution_figure(one.burst_id, one.solution_id, COLLAPSED_FIGURE) for one in timed]


def is_drawn(figure: Path, solutions: Sequence[Drawn]) -> bool:
    """Tell whether a figure was drawn after the solutions it shows; not so where a run was killed before it drew."""
    newest = max(one.solution.created_utc for one in solutions)
    return figure.is_file() and figure.stat().st_mtime >= newest.timestamp()


def draw_day(day: date, spectra: Sequence[xr.Dataset], found: Sequence[Detection], settings: Settings) -> bool:
    """Draw a day in place of what was drawn of it before.

    Parameters
    ----------
    spectra : sequence of xarray.Dataset
        Over their background, one of each spacecraft.

    Returns
    -------
    bool
        Whether it is drawn. If not, an earlier figure is gone too: it would not fit what is now known of the day.
    """
    path = settings.day_figure(day, origin_of(spectra))
    try:
        # without a style of its own: it becomes a part of the page
        write_whole(path, day_figure(day, spectra, detection_frame(found)))
    except Exception as error:  # noqa: BLE001 - a picture is not worth a day, whatever keeps it from being drawn
        log.warning("figure of the day not drawn", reason=f"{type(error).__name__}: {error}")
        if path.is_file():
            path.unlink()
        return False
    return True


def redraw_day(files: DayFiles, found: Sequence[Detection], settings: Settings) -> bool:
    """Draw a day that was searched before, from its files and what was found in them.

    Returns
    -------
    bool
        Whether it is drawn.
    """
    try:
        spectra = [over_quiet(one) for one in day_spectra(files)[0].values()]
    except BellaError as error:
        log.warning("figure of the day not drawn", reason=str(error))
        return False
    return draw_day(files.day, spectra, found, settings)


def detection_frame(found: Iterable[Detection]) -> pd.DataFrame:
    """Detection table of records, with times as spectra have them: UTC without a zone."""
    table = pd.DataFrame([asdict(one) for one in found], columns=list(Detection.__dataclass_fields__))
    times = {name: pd.to_datetime(table[name], utc=True).dt.tz_localize(None) for name in TIMES}
    return table.assign(**times).astype(dict.fromkeys(TIMES, "datetime64[ns]"))

"""The pages: the catalogue, one burst, and the files that they draw with."""

import statistics
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

from fastapi import APIRouter, Request, Response
from fastapi.responses import FileResponse, HTMLResponse
from pydantic import ValidationError

from api.asking import asked_of, fault_words
from api.calibration_section import calibration_of
from api.freshness import IMMUTABLE
from api.queries import BurstFilter, SeriesChoice, one_per_edge
from api.remarks import edge_remark
from api.rendering import render
from api.routers.bursts import versions_of
from api.routers.solutions import sources_of
from api.schemas import SolutionReply, burst_links, day_links, figure_path
from api.service import CatalogueHere, ServiceHere
from api.summary_section import summary_words
from api.track_section import TrackSection, track_section
from api.wind_section import wind_table
from api.wording import APPARENT_SOURCE, EDGE_DECIDES
from bella.answer import GRADES
from bella.catalogue import Burst, BurstPage, BurstQuery, Catalogue, Solution
from bella.exceptions import InputError
from bella.flags import FLAGS, HARMLESS_FLAGS, NOT_CONSTRAINED
from bella.plotting import edge_name, plotly_script
from bella.records import ALL_ORIGINS, REAL_ORIGINS, Origin, origins_beside
from bella.settings import Settings
from bella.spacecraft import OBSERVATORIES

router = APIRouter(include_in_schema=False)

FILTER_NAMES = frozenset(BurstFilter.model_fields)
LISTS = frozenset({"observatory", "without_flag"})
# the page says these two in words: beside the title and in the table of fits
SAID_ELSEWHERE = frozenset({"speed_not_constrained", "formal_errors"})

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

Track = tuple[Solution, dict[str, Any]]


@dataclass(frozen=True)
class FitRow:
    """One line of the table of fits: a definition of the edge with a rotation period."""

    solution: SolutionReply
    rotation_period_d: float
    fit: dict[str, Any]
    first: bool


@router.get("/")
def catalogue_page(request: Request, catalogue: CatalogueHere) -> HTMLResponse:
    """Bursts that match the query of the address, with a form that writes that query."""
    asked = asked_of(request, LISTS)
    page, fault = _answer(catalogue, asked)
    following = page.next_cursor if page else None
    return render(
        request,
        "catalogue.html",
        status=422 if fault else 200,
        real=REAL_ORIGINS,
        origins=[*Origin, ALL_ORIGINS],
        rows=[(summary, burst_links(summary.burst)) for summary in page.bursts] if page else [],
        page=page,
        fault=fault,
        asked={name: asked.get(name, [] if name in LISTS else "") for name in FILTER_NAMES},
        filtered=any(asked.get(name) for name in FILTER_NAMES - {"limit", "cursor"}),
        onward=urlencode({**asked, "cursor": following}, doseq=True) if following else None,
        first=urlencode({name: value for name, value in asked.items() if name != "cursor"}, doseq=True),
        is_empty=page is not None and page.total == 0 and catalogue.bursts(BurstQuery(limit=1)).total == 0,
        observatories=list(dict.fromkeys([*OBSERVATORIES, *asked.get("observatory", [])])),
        flags=FLAGS,
        harmless=HARMLESS_FLAGS,
        grades=GRADES,
        base_url=str(request.base_url).rstrip("/"),
    )


@router.get("/bursts/{burst_id}")
def burst_page(request: Request, burst_id: str, service: ServiceHere, catalogue: CatalogueHere) -> HTMLResponse:
    """Everything about one burst; where it was looked at from stands in the query and is read by the page itself."""
    summary = catalogue.burst(burst_id)
    choice = SeriesChoice(**{name: request.query_params.get(name) for name in SeriesChoice.model_fields})
    solutions = one_per_edge(summary.solutions, choice, burst_id)
    tracks = [(solution, catalogue.track_fit(solution.solution_id)) for solution in solutions]
    channels = [row.frequency_mhz for row in catalogue.localisations(solutions[0].solution_id)] if solutions else []
    return render(
        request,
        "burst.html",
        burst=summary.burst,
        is_real=summary.burst.origin in REAL_ORIGINS,
        history=catalogue.alerts(burst_id=burst_id, origins=tuple(Origin)),
        sources={one.solution_id: sources_of(catalogue, one.solution_id) for one in solutions},
        preferred=summary.preferred,
        preference=summary.preference,
        shown=solutions[0] if solutions else None,
        calibration=calibration_of(summary.preferred, summary.burst.observatories) if summary.preferred else None,
        grades=GRADES,
        links=burst_links(summary.burst),
        day_page=_day_page(catalogue, summary.burst),
        series=urlencode({name: value for name, value in choice if value}),
        series_known=_series_known(summary.solutions),
        solutions=[SolutionReply.of(solution) for solution in solutions],
        fits=_fit_rows(tracks),
        sections=_sections(tracks, service.settings),
        wind=wind_table(track for _, track in tracks),
        summary=summary_words(edge_name(tracks[0][0].series.edge), tracks[0][1]) if tracks else "",
        edges_apart=edge_remark({edge_name(s.series.edge): track for s, track in tracks}),
        flags=_flags(solutions),
        contraction=_contraction(catalogue, solutions),
        not_constrained=NOT_CONSTRAINED,
        channels=sorted(channels),
        versions=versions_of(catalogue.versions(burst_id)),
        base_url=str(request.base_url).rstrip("/"),
        apparent=APPARENT_SOURCE,
        edge_decides=EDGE_DECIDES,
    )


def _day_page(catalogue: Catalogue, burst: Burst) -> str | None:
    """Address of the page of the day of a burst; None where that was not searched in data of its origin."""
    day, origins = burst.start_utc.date(), tuple(origins_beside(burst.origin))
    known = catalogue.searched_day(day, REAL_ORIGINS if burst.origin in REAL_ORIGINS else origins)
    return day_links(day, known.origin)["page"] if known else None


@router.get("/static/plotly.min.js")
def drawing_script() -> Response:
    """The drawing script of the installed plotly package."""
    return FileResponse(plotly_script(), media_type="text/javascript", headers={"Cache-Control": IMMUTABLE})


def _answer(catalogue: Catalogue, asked: dict[str, Any]) -> tuple[BurstPage | None, str | None]:
    """Page of bursts, or what is wrong with the question."""
    try:
        return catalogue.bursts(BurstFilter.model_validate(asked).query()), None
    except (InputError, ValidationError) as error:
        return None, fault_words(error)


def _series_known(solutions: tuple[Solution, ...]) -> list[dict[str, str]]:
    """Method and preset of each series, once each, for the links that exchange one for another."""
    pairs = dict.fromkeys((solution.series.method, solution.series.preset) for solution in solutions)
    return [
        {"method": method, "preset": preset, "query": urlencode({"method": method, "preset": preset})}
        for method, preset in pairs
    ]


def _fit_rows(tracks: list[Track]) -> list[FitRow]:
    rows: list[FitRow] = []
    for solution, fit in tracks:
        reply = SolutionReply.of(solution)
        fits = {str(fit.get("rotation_period_d")): fit.get("two_step"), **fit.get("two_step_other_rotations", {})}
        known = [(period, values) for period, values in fits.items() if values]
        rows += [FitRow(reply, float(period), values, first=i == 0) for i, (period, values) in enumerate(known)]
    return rows


def _sections(tracks: list[Track], settings: Settings) -> list[TrackSection]:
    sections = [
        track_section(SolutionReply.of(solution), track, _drawn(solution, settings)) for solution, track in tracks
    ]
    return [section for section in sections if section]


def _flags(solutions: list[Solution]) -> list[tuple[str, str]]:
    """Flags of the tracks shown, each with the edges it holds for where it does not hold for all."""
    raised = sorted({flag for solution in solutions for flag in solution.flags} - SAID_ELSEWHERE)
    edges = {flag: [edge_name(one.series.edge) for one in solutions if flag in one.flags] for flag in raised}
    return [(flag, ", ".join(on) if len(on) < len(solutions) else "") for flag, on in edges.items()]


def _drawn(solution: Solution, settings: Settings) -> list[tuple[str, str, str]]:
    """Figures of a solution that the run has drawn; a run may have been killed before it did."""
    return [
        (title, figure_path(solution, name), description)
        for name, (title, description) in FIGURES.items()
        if settings.fit_figure(solution.burst_id, solution.solution_id, name).is_file()
    ]


def _contraction(catalogue: Catalogue, solutions: list[Solution]) -> float | None:
    """Median contraction of the speed over all channels of all tracks shown."""
    values = [row.contraction_v for s in solutions for row in catalogue.localisations(s.solution_id)]
    return statistics.median(values) if values else None

"""The page of one burst: its answer and figures first, then other answers, how sure it is, and all that is kept."""

from typing import Any
from urllib.parse import urlencode

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse
from markupsafe import Markup

from api.drawing import BurstView, Looked
from api.links import burst_links, day_links, site_url
from api.pages.days import place_of
from api.pages.track import track_page
from api.queries import CHOICES
from api.rendering import render, series_query, written_interval
from api.replies import calibration_of
from api.routers.bursts import versions_of
from api.routers.solutions import sources_of
from api.schemas import SolutionReply
from api.service import CatalogueHere, Service, ServiceHere
from bella.answer import GRADES
from bella.catalogue import Burst, Catalogue, Solution
from bella.exceptions import NoDataError
from bella.flags import APPARENT_SOURCE, HARMLESS_FLAGS
from bella.formats import FORMATS
from bella.plotting import (
    selected_regions,
)
from bella.records import REAL_ORIGINS, Origin, origins_beside

router = APIRouter(include_in_schema=False)

NO_TABLE = "tfcat"
"""It holds detections alone."""


@router.get("/bursts/{burst_id}")
def burst_page(request: Request, burst_id: str, service: ServiceHere, catalogue: CatalogueHere) -> HTMLResponse:
    """Everything about one burst, as the query of the address says."""
    with catalogue.snapshot():
        return _page(request, burst_id, service, catalogue)


def _page(request: Request, burst_id: str, service: Service, catalogue: Catalogue) -> HTMLResponse:
    summary = catalogue.burst(burst_id)
    burst, view = summary.burst, BurstView.lenient(request.query_params)
    looked = Looked(service, catalogue, summary, view)
    shown = looked.shown
    links = burst_links(burst)
    spectra, no_spectra = _spectra(looked)
    evolution, residuals = looked.evolution(), looked.residuals()
    versions = catalogue.versions(burst_id)
    replaced = {one.supersedes for one in versions}
    return render(
        request,
        "burst.html",
        burst=burst,
        view=view,
        is_real=burst.origin in REAL_ORIGINS,
        preferred=summary.preferred,
        preference=summary.preference,
        shown=shown,
        superseded_by=bool(shown and shown.solution_id in replaced),
        others=looked.others,
        reply=SolutionReply.of(shown) if shown else None,
        permanent=f"{links['page']}?{series_query(shown, with_version=True)}" if shown else links["page"],
        picture=f"{links['self']}/figures/constellation.png" if shown else None,
        look=_look(shown, view),
        constellation=Markup(looked.constellation()),  # noqa: S704 - drawn here, and its texts are escaped
        spectra=spectra,
        no_spectra=no_spectra,
        evolution=evolution and Markup(evolution),  # noqa: S704
        residuals=residuals and Markup(residuals),  # noqa: S704
        **_channel(looked),
        calibration=calibration_of(summary.preferred, burst.observatories) if summary.preferred else None,
        grades=GRADES,
        harmless=HARMLESS_FLAGS,
        apparent=APPARENT_SOURCE,
        links=links,
        day_page=_day_page(catalogue, burst),
        history=catalogue.alerts(burst_id=burst_id, origins=tuple(Origin)),
        versions=versions_of(versions),
        sources=sources_of(catalogue, shown.solution_id) if shown else [],
        linked=catalogue.events.of_burst(burst_id),
        event_lists=catalogue.events.lists(),
        downloads=_downloads(links, shown, is_placed=evolution is not None) if shown else [],
        site_url=site_url(request),
        **track_page(looked, service.settings),
    )


def _spectra(looked: Looked) -> tuple[Markup | None, str]:
    """Figure of the spectra, or why there is none."""
    try:
        return Markup(looked.spectra()), ""  # noqa: S704
    except NoDataError as error:
        return None, str(error)


def _channel(looked: Looked) -> dict[str, Any]:
    """Channels of the answer that is shown, and the numbers of the one that is chosen."""
    channels, wanted = looked.channels(), looked.view.frequency
    if wanted is None or not channels or looked.answer is None:
        return {"channels": channels, "channel": len(channels) // 2, "numbers": None}
    found = selected_regions(looked.answer.posterior, wanted)
    channel = min(range(len(channels)), key=lambda index: abs(channels[index] - found["frequency_mhz"]))
    distance = written_interval({"mean": found["range_rsun"], "sd": found["range_sd_rsun"]})
    longitude = written_interval({"mean": found["longitude_deg"], "sd": found["longitude_sd_deg"]})
    return {
        "channels": channels,
        "channel": channel,
        "numbers": {**found, "distance": distance, "longitude": longitude},
    }


def _look(shown: Solution | None, view: BurstView) -> str:
    """Query of a figure as it is shown, of this version of the answer."""
    asked = view.model_dump(exclude_defaults=True, exclude=set(CHOICES))
    parts = [series_query(shown, with_version=True) if shown else "", urlencode(asked, safe=",:")]
    joined = "&".join(part for part in parts if part)
    return f"?{joined}" if joined else ""


def _downloads(
    links: dict[str, str], shown: Solution, *, is_placed: bool
) -> list[tuple[str, str, list[tuple[str, str]]]]:
    """Rows of words, address, and kinds with the query that asks for each."""
    pick = series_query(shown, with_version=True)
    tables = [(one.name, f"?{pick}&format={one.name}") for one in FORMATS.values() if one.name != NO_TABLE]
    placed = [("Positions by frequency", links["track"], tables)] if is_placed else []
    return [
        *placed,
        ("Arrival times", f"{links['self']}/arrivals", tables),
        ("Posterior, summary", links["posterior"], [("json", f"?{pick}")]),
    ]


def _day_page(catalogue: Catalogue, burst: Burst) -> str | None:
    """Address of a burst on the page of its day; None where that was not searched in data of its origin."""
    day, origins = burst.start_utc.date(), tuple(origins_beside(burst.origin))
    known = catalogue.searched_day(day, REAL_ORIGINS if burst.origin in REAL_ORIGINS else origins)
    return place_of(day_links(day, known.origin)["page"], burst.burst_id) if known else None

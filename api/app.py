"""The application: `create_app` puts routers, pages, errors and headers together.

``uvicorn api.app:create_app --factory`` serves it with the settings of the environment.
"""

from typing import Any

from fastapi import FastAPI
from starlette.types import ASGIApp

from api.errors import DESCRIBED, Problem, install_error_handlers
from api.links import Prefixed
from api.middleware import UsualHeaders, install_headers
from api.pages import burst as burst_page
from api.pages import bursts as list_page
from api.pages import days, planning, submit
from api.routers import (
    alerts,
    arrivals,
    bursts,
    detections,
    events,
    figures,
    hapi,
    observability,
    quirks,
    root,
    solutions,
    status,
)
from api.service import Service
from api.static_files import router as static_files
from bella import __version__
from bella.logs import log_to
from bella.settings import Settings, read_settings

_OF_A_BURST = ("burst", "versions", "track", "posterior", "regions", "arrivals", "burst_events")
_OF_A_SOLUTION = ("solution", "calibration")
_OF_A_DAY = ("day", "observability_of_day")

ONWARD: dict[str, tuple[tuple[str, str, tuple[str, ...]], ...]] = {
    "bursts": (("burst_id", "/bursts/0/burst_id", _OF_A_BURST),),
    "latest_burst": (("burst_id", "/burst_id", _OF_A_BURST), ("solution_id", "/preferred_solution", _OF_A_SOLUTION)),
    "burst": (("burst_id", "/burst_id", _OF_A_BURST), ("solution_id", "/preferred_solution", _OF_A_SOLUTION)),
    "versions": (("solution_id", "/versions/0/solution_id", _OF_A_SOLUTION),),
    "solutions": (
        ("solution_id", "/solutions/0/solution_id", _OF_A_SOLUTION),
        ("burst_id", "/solutions/0/burst_id", _OF_A_BURST),
    ),
    "solution": (("burst_id", "/burst_id", _OF_A_BURST),),
    "days": (("day", "/days/0/day", _OF_A_DAY),),
    "submit": (("submission_id", "/submission_id", ("submission", "withdraw")),),
    "submission": (("submission_id", "/submission_id", ("submission", "withdraw")),),
}
"""Where a reply leads: by which parameter, where its value stands in the reply, and to which operations."""


class Described(FastAPI):
    """An application whose description holds the shape of its errors, and where replies lead, too."""

    def openapi(self) -> dict[str, Any]:
        """OpenAPI description of the API."""
        if self.openapi_schema is None:
            described = super().openapi()
            described["components"]["schemas"][Problem.__name__] = Problem.model_json_schema()
            for operation in (one for methods in described["paths"].values() for one in methods.values()):
                reply = next(reply for status, reply in operation["responses"].items() if status.startswith("2"))
                reply |= _links(operation["operationId"])
        return super().openapi()

    def build_middleware_stack(self) -> ASGIApp:
        """Layers of the application: the usual headers are on replies to errors that nobody foresaw, too."""
        return UsualHeaders(super().build_middleware_stack())


def _links(operation: str) -> dict[str, Any]:
    """Links of a reply, as OpenAPI describes them; nothing where there are none."""
    links = {
        name: {"operationId": name, "parameters": {parameter: f"$response.body#{pointer}"}}
        for parameter, pointer, names in ONWARD.get(operation, ())
        for name in names
    }
    return {"links": links} if links else {}


def create_app(settings: Settings | None = None) -> FastAPI:
    """Application over one home folder and one catalogue.

    Parameters
    ----------
    settings : Settings, optional
        Without it they are read from the environment, and logs go to standard error: the application is the process.
    """
    app = Described(
        title="BELLA service",
        version=__version__,
        summary="Where solar radio bursts were, and how sure we are.",
        openapi_url="/api/v1/openapi.json",
        docs_url=None,  # both viewers load their scripts from elsewhere; `api.routers.root` has its own
        redoc_url=None,
        responses=DESCRIBED,
        generate_unique_id_function=lambda route: route.name,
    )
    if settings is None:
        log_to(None)
        settings = read_settings()
    app.state.service = Service(settings)
    install_error_handlers(app)
    install_headers(app, app.state.service)
    app.add_middleware(Prefixed, prefix=settings.root_path)
    for router in (
        root.router,
        alerts.router,
        bursts.router,
        detections.router,
        solutions.router,
        figures.router,
        arrivals.router,
        bursts.tables,
        events.router,
        hapi.router,
        status.router,
        quirks.router,
        observability.router,
        days.router,
        list_page.router,
        burst_page.router,
        planning.router,
        submit.router,
        static_files,
    ):
        app.include_router(router)
    return app

"""The application: `create_app` puts routers, pages, errors and headers together.

``uvicorn api.app:create_app --factory`` serves it with the settings of the environment.
"""

from typing import Any

from fastapi import FastAPI

from api.errors import DESCRIBED, Problem, install_error_handlers
from api.headers import install_headers
from api.links import Prefixed
from api.pages import burst as burst_page
from api.pages import bursts as list_page
from api.pages import days, guide, planning, submit
from api.routers import (
    alerts,
    arrivals,
    bursts,
    detections,
    events,
    figures,
    hapi,
    health,
    observability,
    quirks,
    root,
    solutions,
    status,
    tables,
)
from api.service import Service
from api.static_files import router as static_files
from bella import __version__
from bella.logs import log_to
from bella.settings import Settings


class Described(FastAPI):
    """An application whose description holds the shape of its errors, too."""

    def openapi(self) -> dict[str, Any]:
        """OpenAPI description of the API."""
        if self.openapi_schema is None:
            super().openapi()["components"]["schemas"][Problem.__name__] = Problem.model_json_schema()
        return super().openapi()


def create_app(settings: Settings | None = None) -> FastAPI:
    """Application over one home folder and one catalogue.

    Parameters
    ----------
    settings : Settings, optional
        Without it they are read from the environment, and logs go to standard error: the application is the process.

    Returns
    -------
    FastAPI
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
        settings = Settings()
    app.state.service = Service(settings)
    install_error_handlers(app)
    install_headers(app, app.state.service)
    app.add_middleware(Prefixed, prefix=settings.root_path)
    for module in (
        root,
        alerts,
        bursts,
        detections,
        solutions,
        figures,
        arrivals,
        tables,
        events,
        hapi,
        quirks,
        health,
        status,
        observability,
        days,
        list_page,
        burst_page,
        planning,
        guide,
        submit,
    ):
        app.include_router(module.router)
    app.include_router(static_files)
    return app

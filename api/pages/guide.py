"""How to read the pages and cite what is on them, and the API for people: each address with what may be asked of it."""

from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.responses import HTMLResponse

from api.rendering import render
from bella.answer import GRADES
from bella.flags import COMPANION_FLAGS, FLAGS
from bella.records import DayAnswer

router = APIRouter(include_in_schema=False)

EXAMPLES = {
    "/api/v1/bursts": "/api/v1/bursts?limit=2",
    "/api/v1/days": "/api/v1/days?limit=3",
    "/api/v1/tracks": "/api/v1/tracks?format=csv",
    "/api/v1/localisations": "/api/v1/localisations?format=csv&limit=1",
    "/api/v1/status": "/api/v1/status",
    "/api/v1/alerts": "/api/v1/alerts",
    "/hapi/catalog": "/hapi/catalog",
    "/hapi/capabilities": "/hapi/capabilities",
    "/health": "/health",
}


@router.get("/guide")
def guide_page(request: Request) -> HTMLResponse:
    """How to read a burst, what the words and flags mean, and how to cite."""
    return render(request, "guide.html", grades=GRADES, flags=FLAGS | COMPANION_FLAGS, answers=list(DayAnswer))


@router.get("/api")
def api_page(request: Request) -> HTMLResponse:
    """Every address of the API with its parameters."""
    return render(request, "api.html", groups=_groups(request.app), base_url=str(request.base_url).rstrip("/"))


def _groups(app: FastAPI) -> dict[str, list[dict[str, Any]]]:
    """Operations of the API by topic."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for path, methods in app.openapi()["paths"].items():
        for method, operation in methods.items():
            one = {
                "method": method.upper(),
                "path": path,
                "said": operation.get("description") or operation.get("summary", ""),
                "parameters": [item for item in operation.get("parameters", []) if item["in"] == "query"],
                "example": EXAMPLES.get(path) if method == "get" else None,
            }
            groups.setdefault((operation.get("tags") or ["other"])[0], []).append(one)
    return groups

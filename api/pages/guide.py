"""How to read the pages, and how to cite what is on them."""

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from api.rendering import render
from bella.answer import GRADES
from bella.flags import COMPANION_FLAGS, FLAGS
from bella.records import DayAnswer

router = APIRouter(include_in_schema=False)


@router.get("/guide")
def guide_page(request: Request) -> HTMLResponse:
    """How to read a burst, what the words and flags mean, and how to cite."""
    return render(request, "guide.html", grades=GRADES, flags=FLAGS | COMPANION_FLAGS, answers=list(DayAnswer))

"""What is known to be odd about the instruments, and what the readers do about it."""

from datetime import date
from typing import Annotated

from fastapi import APIRouter, Query

from api.links import API
from bella.spacecraft import observatory_name
from bella.spectra import Quirk, quirks

router = APIRouter(prefix=API, tags=["service"])


@router.get("/quirks")
def known_quirks(
    observatory: Annotated[str | None, Query(description="Spacecraft, such as SOLO or Solar Orbiter.")] = None,
    day: Annotated[date | None, Query(description="Only what applies on this day, UTC.")] = None,
) -> list[Quirk]:
    """List the known quirks: instrument, dates, effect, what the readers do, source."""
    wanted = None if observatory is None else observatory_name(observatory)
    return [
        one
        for one in quirks()
        if wanted in {None, one.observatory} and (day is None or one.first <= day.isoformat() <= (one.last or "9999"))
    ]

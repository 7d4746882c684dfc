"""Your own arrival times: checked row by row and shown on a map before they are submitted with a token."""

from typing import Annotated, Any
from urllib.parse import parse_qs

import numpy as np
import pandas as pd
from fastapi import APIRouter, Depends, Request
from fastapi.responses import HTMLResponse
from markupsafe import Markup

from api.errors import TooLargeError
from api.rendering import render
from api.routers.arrivals import check_table
from api.service import CatalogueHere, ServiceHere
from bella.arrivals import MIN_OBSERVATORIES, check_arrivals, locate_receivers
from bella.csv_tables import parse_table
from bella.exceptions import InputError, NoDataError
from bella.plotting import MapView, constellation_figure

router = APIRouter(include_in_schema=False)

SOURCE = "arrival table"
MOST_FAULTS = 20
EXAMPLE = """observatory,frequency_mhz,arrival_utc,sigma_s,edge
WIND,1.0,2012-06-07T19:31:10Z,10,half_rise
STEREO-A,1.0,2012-06-07T19:31:24Z,10,half_rise
STEREO-B,1.0,2012-06-07T19:32:05Z,10,half_rise
WIND,0.5,2012-06-07T19:32:40Z,12,half_rise
STEREO-A,0.5,2012-06-07T19:33:05Z,12,half_rise
STEREO-B,0.5,2012-06-07T19:34:20Z,12,half_rise
"""


async def _table(request: Request) -> str:
    """Text of the table in a form, read no further than the largest that the service takes."""
    largest = 3 * request.app.state.service.settings.max_submission_bytes  # a form escapes bytes by three
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > largest:
            raise TooLargeError("the table is too large; check one burst at a time")
    return parse_qs(body.decode("ascii", "replace")).get("table", [""])[0].replace("\r\n", "\n")


@router.get("/submit")
def submit_page(request: Request, service: ServiceHere) -> HTMLResponse:
    """Form for arrival times."""
    return _page(request, service.settings.open_submissions, table="")


@router.post("/submit")
def checked_page(request: Request, service: ServiceHere, text: Annotated[str, Depends(_table)]) -> HTMLResponse:
    """The same with what is wrong with a table, or with the map that it belongs to; nothing is kept."""
    try:
        frame = check_table(text)
    except InputError as error:
        return _page(request, service.settings.open_submissions, table=text, status=422, faults=_faults(text, error))
    return _page(request, service.settings.open_submissions, table=text, **_preview(frame))


@router.get("/submissions/{submission_id}")
def submission_page(request: Request, submission_id: str, catalogue: CatalogueHere) -> HTMLResponse:
    """What became of a table that was submitted."""
    return render(request, "submission.html", submission=catalogue.submission(submission_id))


def _page(request: Request, is_open: bool, *, table: str, status: int = 200, **more: Any) -> HTMLResponse:
    said = {"faults": [], "figure": None, "channels": [], "observatories": [], "alone": []} | more
    base_url = str(request.base_url).rstrip("/")
    return render(
        request, "submit.html", status=status, table=table, example=EXAMPLE, is_open=is_open, base_url=base_url, **said
    )


def _faults(text: str, first: InputError) -> list[str]:
    """What is wrong with a table, each row with its own fault; otherwise what is wrong with the whole."""
    try:
        frame = parse_table(text, SOURCE)
    except InputError as error:
        return [str(error)]
    found = []
    for row in range(min(len(frame), 500)):
        try:
            locate_receivers(check_arrivals(frame.iloc[[row]].reset_index(drop=True), source=SOURCE, received_by=1))
        except (InputError, NoDataError) as error:
            found.append(str(error).replace("row 1,", f"row {row + 1},"))
        if len(found) == MOST_FAULTS:
            break
    return [one.removeprefix(f"{SOURCE}: ") for one in found or [str(first)]]


def _preview(frame: pd.DataFrame) -> dict[str, Any]:
    """Map of the receivers, and what could be located at each frequency."""
    placed = locate_receivers(frame)
    receivers = {
        str(name): rows[["x_rsun", "y_rsun", "z_rsun"]].to_numpy(dtype=np.float64).mean(axis=0)
        for name, rows in placed.groupby("observatory", sort=False)
    }
    counts = frame.groupby("frequency_mhz")["observatory"].nunique()
    utc = frame["arrival_utc"].min().to_datetime64()
    return {
        "figure": Markup(constellation_figure([], utc, MapView(view="fleet", receivers=receivers))),  # noqa: S704 - drawn here
        "observatories": list(receivers),
        "channels": [float(one) for one in counts.index[counts >= MIN_OBSERVATORIES]],
        "alone": [float(one) for one in counts.index[counts < MIN_OBSERVATORIES]],
    }

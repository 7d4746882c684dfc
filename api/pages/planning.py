"""Could a source be located: a fleet on a day, drawn and in words, before there are data."""

from datetime import date
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse
from markupsafe import Markup
from pydantic import ValidationError

from api.queries import asked_of, fault_words
from api.rendering import render
from api.routers.observability import DISTANCES_RSUN, GOOD_SHARE, ROUGH_SHARE, PlanningQuery, planning_map, verdict
from api.service import CatalogueHere
from bella.catalogue import Catalogue, ObservedDay
from bella.exceptions import InputError, NoDataError
from bella.records import Prediction
from bella.spacecraft import OBSERVATORIES, coverage

router = APIRouter(include_in_schema=False)

LISTS = frozenset({"observatory"})
VERDICTS = ("yes", "roughly", "no")
TOLD_DEG = 30
"""Step of the directions in the table."""


@router.get("/planning")
def planning_page(request: Request, catalogue: CatalogueHere) -> HTMLResponse:
    """Whether a fleet could locate a source on a day, as the query of the address says."""
    asked = asked_of(request, LISTS)
    wanted, found, fault = _answer(asked)
    defaults = PlanningQuery()
    return render(
        request,
        "planning.html",
        status=422 if fault else 200,
        observatories=list(dict.fromkeys([*OBSERVATORIES, *asked.get("observatory", [])])),
        asked={name: asked.get(name) or _written(getattr(defaults, name)) for name in PlanningQuery.model_fields},
        found=found,
        fault=fault,
        figure=Markup(planning_map(found)) if found else None,  # noqa: S704 - drawn here
        rows=(rows := _rows(found) if found and found.localisable else []),
        near=_near(rows),
        directions=[one for one in found.longitudes_deg if one % TOLD_DEG == 0] if found else [],
        good=GOOD_SHARE,
        rough=ROUGH_SHARE,
        tail="?" + wanted.query() if wanted else "",
        observed=_observed(catalogue, found) if found else None,
    )


def _answer(asked: dict[str, Any]) -> tuple[PlanningQuery | None, Prediction | None, str | None]:
    """Prediction, or what is wrong with the question."""
    try:
        wanted = PlanningQuery.model_validate({name: value for name, value in asked.items() if value != ""})
        _check_known(wanted.on)
        return wanted, wanted.prediction(), None
    except (InputError, ValidationError) as error:
        return None, None, fault_words(error)


def _check_known(day: date) -> None:
    """Refuse a day for which there are no positions to draw.

    Raises
    ------
    InputError
    """
    known = coverage("EARTH")
    first, last = (one.astype("datetime64[D]").item() for one in (known.start, known.stop))
    if not first < day < last:
        raise InputError(f"day: positions of the spacecraft are known from {first} to {last}")


def _rows(found: Prediction) -> list[dict[str, Any]]:
    """Distances that are told in words: size and verdict in each direction, and how many of the verdicts are yes."""
    rows = []
    for distance in sorted({*DISTANCES_RSUN, found.frequency_rsun}):
        radii = found.row(distance)
        verdicts = [verdict(radius, distance) for radius in radii]
        cells = [
            (radius, said)
            for longitude, radius, said in zip(found.longitudes_deg, radii, verdicts, strict=True)
            if longitude % TOLD_DEG == 0
        ]
        rows.append({"distance": distance, "cells": cells, "counts": {one: verdicts.count(one) for one in VERDICTS}})
    return rows


def _near(rows: list[dict[str, Any]]) -> float | None:
    """Distance from which on a source is located in most directions."""
    near = None
    for row in reversed(rows):
        if 2 * row["counts"]["yes"] <= sum(row["counts"].values()):
            break
        near = row["distance"]
    return near


def _observed(catalogue: Catalogue, found: Prediction) -> ObservedDay | None:
    """Which receivers did have data; None where the day was not searched."""
    try:
        return catalogue.operation.observed(found.day)
    except NoDataError:
        return None


def _written(value: object) -> object:
    return f"{value:g}" if isinstance(value, float) else value

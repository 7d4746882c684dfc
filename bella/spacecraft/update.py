"""A table that goes on where the packaged ephemeris ends."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bella.exceptions import BellaError, NoDataError, UnreachableError
from bella.spacecraft.encode import REFERENCE_UTC, Orbit, thin, to_dataset
from bella.spacecraft.ephemeris import Coverage, packaged_coverage, packaged_km, read_nodes
from bella.units import FloatArray

OVERLAP = np.timedelta64(3, "D")
"""The new table begins this long before the packaged one ends: there the two must agree, and a spline has its hold."""

LARGEST_STEP_KM = 500_000.0
"""Farthest apart that old and new trajectory may be in the overlap: a wrong frame or body is off by far more."""

Fetch = Callable[[str, np.datetime64, np.datetime64], Orbit]


class Extended(NamedTuple):
    """What became of one body."""

    body: str
    stop: np.datetime64
    """Last instant known now, UTC."""
    nodes: int
    """Nodes in the new table; 0 where nothing was added."""
    step_km: float
    """Largest distance between old and new trajectory in the overlap; NaN where nothing was added."""
    remark: str
    """Why nothing was added, or empty."""


def extend_table(
    path: Path, bodies: Sequence[str], until: np.datetime64, fetch: Fetch, advance: Callable[[], None] = lambda: None
) -> list[Extended]:
    """Ask for positions after the end of the packaged table and write them to a table of their own.

    Parameters
    ----------
    path : Path
        Table to write; appears whole or not at all. Bodies in it that nothing new is found for are kept.
    bodies : sequence of str
        What to ask for.
    until : numpy.datetime64
        Last instant wanted, UTC.
    fetch : callable
        Called with body, first and last instant; gives the nodes.
    advance : callable
        Called after every body.

    Returns
    -------
    list of Extended
        One for each body.

    Raises
    ------
    InputError
        If a body is not one to ask for.
    NoDataError
        If bodies were asked for and none of them could be extended.
    UnreachableError
        If there is no answer, or one that cannot be used; nothing is written then.
    """
    orbits, outcomes = _kept(path), []
    for body in bodies:
        outcome, orbit = _extended(body, until, fetch)
        outcomes.append(outcome)
        if orbit is not None:
            orbits[body] = orbit
        advance()
    if any(outcome.nodes for outcome in outcomes):
        _write(path, orbits)
    elif refused := [outcome.remark for outcome in outcomes if outcome.stop < until]:
        raise NoDataError(refused[0])
    return outcomes


def _kept(path: Path) -> dict[str, Orbit]:
    """Nodes the table has so far; a damaged table is replaced, since all of it can be asked for again."""
    try:
        return {body: Orbit(*nodes) for body, nodes in read_nodes(path).items()} if path.is_file() else {}
    except BellaError:
        return {}


def _extended(body: str, until: np.datetime64, fetch: Fetch) -> tuple[Extended, Orbit | None]:
    known = packaged_coverage(body)
    if until <= known.stop:
        return Extended(body, known.stop, 0, float("nan"), "known that far already"), None
    try:
        dense = fetch(body, (known.stop - OVERLAP).astype("datetime64[h]"), until)
    except NoDataError as error:
        return Extended(body, known.stop, 0, float("nan"), str(error)), None
    step_km = _step_km(body, dense, known)
    orbit = thin(dense)
    return Extended(body, _utc(orbit)[-1], len(orbit.time_ms), step_km, ""), orbit


def _utc(orbit: Orbit) -> "np.ndarray[tuple[int], np.dtype[np.datetime64]]":
    return REFERENCE_UTC + orbit.time_ms.astype("timedelta64[ms]").astype("timedelta64[ns]")


def _step_km(body: str, orbit: Orbit, known: Coverage) -> float:
    """Distance between old and new trajectory where both are known."""
    utc = _utc(orbit)
    shared = (utc >= known.start) & (utc <= known.stop)
    if not shared.any() or utc[-1] <= known.stop:
        raise UnreachableError(f"the answer about {body} does not reach across {known.stop}: try again later")
    away_km: FloatArray = np.linalg.norm(packaged_km(body, utc[shared]) - orbit.position_km[shared], axis=1)
    if away_km.max() > LARGEST_STEP_KM:
        raise UnreachableError(
            f"the answer about {body} is {away_km.max():.0f} km from where the packaged ephemeris has it; "
            "nothing is written: try again later"
        )
    return float(away_km.max())


def _write(path: Path, orbits: dict[str, Orbit]) -> None:
    table = to_dataset(orbits).assign_attrs(
        title="Heliocentric positions after the end of the packaged table",
        source="JPL Horizons (https://ssd.jpl.nasa.gov/horizons/), geometric vectors",
        history="bella update-ephemeris: thinned for cubic spline interpolation, rounded to 1 km",
        comment="Times are UTC, turned from the TDB of the service.",
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        table.to_netcdf(partial, engine="h5netcdf")
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)

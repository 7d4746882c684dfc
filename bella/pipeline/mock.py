"""The mock burst: a simulated burst through the whole path, as a sign that the path is open.

It is searched, timed, localised and published by the code that does so with real bursts; only its files are made here.
Its origin is "test" and its id begins with ``TEST-``, so that no query or count takes it for a real one. Its spectra
are the same each time: where its answer changes, the code has.
"""

import hashlib
import shutil
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import structlog

from bella.archive import Received
from bella.catalogue import Catalogue, MockRun, SourceFile
from bella.exceptions import BellaError, NotPlacedError
from bella.pipeline.burst import Choice, process_burst
from bella.pipeline.day import search_day, timed_burst
from bella.pipeline.day_files import DayFiles
from bella.pipeline.inputs import BurstInput
from bella.records import Origin
from bella.settings import Settings
from bella.simulation.strata import SimulatedCase, isolated_burst
from bella.units import within_half_turn_deg

log = structlog.get_logger(__name__)

PREFIX = "TEST-"
SCENE_DAY, SCENE_SEED = date(2021, 11, 20), 3
"""A burst that Wind, STEREO-A, PSP and Solar Orbiter see well, in November 2021: found and localised with any edge."""

EDGE = "half_rise"
DRAWS = 200
"""One edge and few draws: what counts is that the path is open."""

KEPT = timedelta(hours=48)
"""How long mock bursts are kept: longer than a receiver of alerts may be away."""


def run_mock_burst(settings: Settings, now: datetime | None = None) -> MockRun:
    """Send a mock burst through the whole path, note what became of it, and remove old ones.

    Parameters
    ----------
    now : datetime.datetime, optional
        When it begins; the time of day when not given.

    Returns
    -------
    MockRun
        In state "ok".

    Raises
    ------
    BellaError
        What failed; it is noted in the catalogue first, where that can be reached.
    """
    now = now or datetime.now(UTC)
    burst_id = f"{PREFIX}{now:%Y%m%dT%H%M%S}"
    try:
        done = _sent(settings, burst_id, now)
    except (BellaError, OSError) as error:
        _note(MockRun(now, datetime.now(UTC), "failed", message=str(error)), settings)
        raise
    _note(done, settings)
    forget_mocks(settings, now - KEPT)
    log.info("mock burst", burst_id=burst_id, off_deg=done.off_deg)
    return done


def _note(run: MockRun, settings: Settings) -> None:
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        catalogue.operation.record_mock(run)


def _sent(settings: Settings, burst_id: str, now: datetime) -> MockRun:
    """The mock burst from files to a solution."""
    case = isolated_burst("clean", SCENE_DAY, SCENE_SEED)
    with _written(case) as files:
        found = search_day(files, ())
        wanted = [one for one in found.bursts if one.is_localisable]
        if not wanted:
            reasons = "; ".join(one.reason for one in found.bursts) or "no burst was found"
            raise NotPlacedError(f"the mock burst was not found in its spectra: {reasons}")
        given = _renamed(timed_burst(files, wanted[0]), burst_id, now)
    done = process_burst(given, Choice(), settings.model_copy(update={"draws": DRAWS}), f"mock-{uuid.uuid4().hex[:8]}")
    if not done.outcomes:
        raise NotPlacedError(f"the mock burst was not localised: {done.reason}")
    solution = done.outcomes[0].solution
    longitude = solution.answer.phi0_deg
    off = None if longitude is None else float(within_half_turn_deg(longitude - case.burst.phi0_deg))
    return MockRun(now, datetime.now(UTC), "ok", burst_id, solution.solution_id, off)


def _renamed(given: BurstInput, burst_id: str, now: datetime) -> BurstInput:
    """The same burst with one edge, under an id of its own, as if its data had come now."""
    return replace(
        given,
        burst=replace(given.burst, burst_id=burst_id),
        arrivals={EDGE: given.arrivals[EDGE]},
        channel_edges={EDGE: given.channel_edges[EDGE]},
        channel_arrivals={name: table for name, table in given.channel_arrivals.items() if name == EDGE},
        origin=Origin.TEST,
        received=Received(now, now),
    )


@contextmanager
def _written(case: SimulatedCase) -> Iterator[DayFiles]:
    """Spectra of a simulated burst as files, marked as test data, for as long as they are read."""
    with tempfile.TemporaryDirectory(prefix="bella-mock-") as folder:
        paths, sources = [], []
        for name, spectrum in case.spectra.items():
            path = Path(folder) / f"mock-{name}.nc"
            spectrum.assign_attrs(origin=Origin.TEST.value).to_netcdf(path, engine="h5netcdf")
            sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
            paths.append(path)
            sources.append(SourceFile("mock", case.day, "1", sha256, "done", path.name))
        yield DayFiles(case.day, tuple(paths), tuple(sources), "mock")


def forget_mocks(settings: Settings, before: datetime) -> None:
    """Remove mock bursts that were sent earlier, then their files, which no row names any more."""
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        for burst_id in catalogue.operation.forget_mocks(before):
            assert burst_id.startswith(PREFIX)  # noqa: S101 - real bursts are never removed
            shutil.rmtree(settings.figures_root / burst_id, ignore_errors=True)
            shutil.rmtree(settings.store_root / burst_id, ignore_errors=True)

"""Flows that keep the service alive: filling the mirror, the mock burst, and housekeeping."""

from contextlib import closing
from importlib import import_module

from prefect import flow

from bella.bursts.event import EVENT
from bella.catalogue import Catalogue
from bella.exceptions import NoDataError
from bella.logs import log_to
from bella.pipeline.housekeeping import sweep_store
from bella.settings import Settings
from flows.bursts import localise_burst
from flows.tasks import run_name


@flow(name="ingest", retries=1, retry_delay_seconds=30)
def ingest() -> None:
    """Bring the mirror, the ephemeris and the surroundings up to date."""
    log_to(None)
    import_module("bella.pipeline.ingest").bring_up_to_date(Settings())


@flow(name="mock-burst")
def mock_burst() -> None:
    """Send a simulated burst through the whole path."""
    log_to(None)
    import_module("bella.pipeline.mock").run_mock_burst(Settings())


@flow(name="housekeeping")
def housekeeping() -> list[str]:
    """Sweep the store, publish the built-in event where it is not there, link events; returns what was removed."""
    log_to(None)
    settings = Settings()
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        removed = sweep_store(catalogue, settings, run_name())
        try:
            is_there = bool(catalogue.burst(EVENT.burst_id).solutions)
        except NoDataError:
            is_there = False
    if not is_there:
        localise_burst()
    if settings.events is not None and settings.events.is_dir():  # the fetcher makes it with the first file
        import_module("bella.pipeline.linked_events").refresh_events(settings)
    return removed

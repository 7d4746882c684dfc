"""Flows over single bursts, and those that keep the service alive: filling the mirror, the mock burst, housekeeping."""

from contextlib import closing
from importlib import import_module

from prefect import flow
from prefect.artifacts import create_table_artifact

from bella.bursts.event import EVENT
from bella.catalogue import Catalogue
from bella.exceptions import NotPlacedError
from bella.logs import log_to
from bella.pipeline.burst import Choice, Outcome, summary_table
from bella.pipeline.housekeeping import has_event, sweep_store
from bella.pipeline.run import Run, process_submissions
from bella.pipeline.workers import Workers
from bella.settings import Settings
from flows.tasks import burst, run_name


@flow(name="localise-burst", validate_parameters=False)
def localise_burst(subject: str = EVENT.name, choice: Choice | None = None) -> list[Outcome]:
    """Localise the built-in event with every definition of its edge, and publish what is new.

    Raises
    ------
    BellaError
        What went wrong, in one line.
    """
    settings = Settings()
    with Workers(1, settings) as workers:
        done = burst(subject, Run(settings, run_name(), workers, choice or Choice()))
    if done.reason:
        raise NotPlacedError(done.reason)
    create_table_artifact(key=done.burst_id.lower(), table=summary_table(done.outcomes))
    return list(done.outcomes)


@flow(name="submissions")
def submissions() -> int:
    """Localise the arrival tables that wait; returns how many became a burst."""
    log_to(None)  # a worker starts each run as a process of its own
    settings = Settings()
    with Workers(1, settings) as workers:
        return process_submissions(Run(settings, run_name(), workers))


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
        is_there = has_event(catalogue)
    if not is_there:
        localise_burst()
    if settings.events is not None and settings.events.is_dir():  # the fetcher makes it with the first file
        import_module("bella.pipeline.linked_events").refresh_events(settings)
    return removed

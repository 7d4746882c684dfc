"""Flows over single bursts, and those that keep the service alive: filling the mirror, the mock burst, housekeeping."""

from importlib import import_module

from prefect import flow
from prefect.artifacts import create_table_artifact

from bella.logs import log_to
from bella.pipeline.burst import Choice, Outcome, summary_table
from bella.pipeline.run import keep_house, process_submissions
from bella.settings import Settings
from flows.tasks import burst, this_run


@flow(name="localise-burst", validate_parameters=False)
def localise_burst(subject: str, choice: Choice) -> list[Outcome]:
    """Localise the built-in event with every definition of its edge, and publish what is new.

    Raises
    ------
    BellaError
        What went wrong, in one line.
    """
    with this_run(Settings(), choice=choice) as run:
        done = burst(subject, run)
    published = done.published()
    create_table_artifact(key=done.burst_id.lower(), table=summary_table(published))
    return list(published)


@flow(name="submissions")
def submissions() -> int:
    """Localise the arrival tables that wait; returns how many became a burst."""
    log_to(None)  # a worker starts each run as a process of its own
    with this_run(Settings()) as run:
        return process_submissions(run)


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


@flow(name="housekeeping", retries=1, retry_delay_seconds=30)
def housekeeping() -> list[str]:
    """Sweep the store, publish the built-in event where it is not there, link events; returns what was removed."""
    log_to(None)
    with this_run(Settings()) as run:
        return keep_house(run)

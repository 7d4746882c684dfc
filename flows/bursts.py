"""Flows over single bursts: the built-in event, and the tables that were submitted since the last time."""

from prefect import flow
from prefect.artifacts import create_table_artifact

from bella.bursts.event import EVENT
from bella.exceptions import NotPlacedError
from bella.logs import log_to
from bella.pipeline.burst import Choice, Outcome, summary_table
from bella.pipeline.run import Run, process_submissions
from bella.pipeline.workers import Workers
from bella.settings import Settings
from flows.tasks import burst, run_name


@flow(name="localise-burst", validate_parameters=False)
def localise_burst(subject: str = EVENT.name, choice: Choice | None = None) -> list[Outcome]:
    """Localise one burst with every definition of its edge, and publish what is new.

    Parameters
    ----------
    subject : str
        Date of the built-in event, or checksum of an arrival table that was submitted.
    choice : Choice, optional

    Returns
    -------
    list of Outcome
        One per definition of the edge.

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

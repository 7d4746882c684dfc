"""What the schedule runs: the built-in event, then every arrival table that was handed in since the last time."""

from contextlib import closing

import structlog
from prefect import flow

from bella.catalogue import Catalogue, Submission
from bella.exceptions import BellaError
from bella.logs import log_to
from bella.settings import Settings
from flows.localise_burst import localise_burst

log = structlog.get_logger(__name__)


@flow(name="localise-pending")
def localise_pending() -> int:
    """Localise what waits; one that fails does not stop the others.

    Returns
    -------
    int
        Number of tables that became a burst.
    """
    log_to(None)  # a worker starts each run as a process of its own
    settings = Settings()
    failure = localise_burst(return_state=True).result(raise_on_failure=False)
    if isinstance(failure, Exception):
        log.warning("built-in event failed", reason=str(failure), error=type(failure).__name__)
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        return sum(_localise_submission(catalogue, waiting) for waiting in catalogue.pending_submissions())


def _localise_submission(catalogue: Catalogue, waiting: Submission) -> bool:
    outcomes = localise_burst(subject=waiting.submission_id, preset="default", return_state=True).result(
        raise_on_failure=False
    )
    if isinstance(outcomes, Exception):
        _note_failure(catalogue, waiting, outcomes)
        return False
    catalogue.mark_submission(waiting.submission_id, state="done", message="", burst_id=outcomes[0].solution.burst_id)
    return True


def _note_failure(catalogue: Catalogue, waiting: Submission, error: Exception) -> None:
    """Record why a table failed, unless the next run may do better: then it goes on waiting."""
    unforeseen = f"the service did not foresee this: {type(error).__name__}: {error}"
    foreseen = error if isinstance(error, BellaError) else BellaError(unforeseen)
    log.warning(
        "submission failed", submission_id=waiting.submission_id, reason=str(foreseen), retriable=foreseen.retriable
    )
    if not foreseen.retriable:
        catalogue.mark_submission(waiting.submission_id, state="failed", message=str(foreseen), burst_id=None)

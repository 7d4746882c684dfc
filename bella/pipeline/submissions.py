"""Arrival tables that were submitted and wait to be localised."""

import hashlib
from contextlib import closing
from pathlib import Path

import structlog

from bella.catalogue import Catalogue, Submission
from bella.exceptions import BellaError, InputError, StoreError
from bella.pipeline.run import Run, process_subject

log = structlog.get_logger(__name__)


def process_submissions(run: Run) -> int:
    """Localise what waits; one that fails does not stop the others.

    Parameters
    ----------
    run : Run

    Returns
    -------
    int
        Number of tables that became a burst.

    Raises
    ------
    BellaError
        If the catalogue cannot be opened.
    """
    with closing(Catalogue.open(run.settings.catalogue_url, create=True)) as catalogue:
        return sum(_process_submission(catalogue, waiting, run) for waiting in catalogue.pending_submissions())


def _process_submission(catalogue: Catalogue, waiting: Submission, run: Run) -> bool:
    try:
        check_unchanged(waiting, run.settings.incoming_root)
        done = process_subject(waiting.submission_id, run)
    except Exception as error:  # noqa: BLE001 - whatever ended one must not end the others; it is noted with it
        _note_failure(catalogue, waiting, error)
        return False
    if done.reason:
        catalogue.mark_submission(waiting.submission_id, state="failed", message=done.reason, burst_id=None)
        return False
    catalogue.mark_submission(waiting.submission_id, state="done", message="", burst_id=done.burst_id)
    return True


def check_unchanged(waiting: Submission, incoming: Path) -> None:
    """Refuse a table that is not the one that was submitted.

    Parameters
    ----------
    waiting : Submission
    incoming : Path
        Folder of the submitted tables.

    Raises
    ------
    InputError
        If its checksum is another one.
    """
    table = incoming / f"{waiting.submission_id}.csv"
    if table.is_file() and hashlib.sha256(table.read_bytes()).hexdigest() != waiting.sha256:
        raise InputError(f"{table.name} was changed after it was submitted: submit it again")


def _note_failure(catalogue: Catalogue, waiting: Submission, error: Exception) -> None:
    """Record why a table failed, unless the next run may do better: then it goes on waiting."""
    unforeseen = f"the service did not foresee this: {type(error).__name__}: {error}"
    foreseen = error if isinstance(error, BellaError) else BellaError(unforeseen)
    waits = foreseen.retriable or isinstance(error, OSError | StoreError)
    log.warning("submission failed", submission_id=waiting.submission_id, reason=str(foreseen), waits=waits)
    if not waits:
        catalogue.mark_submission(waiting.submission_id, state="failed", message=str(foreseen), burst_id=None)

"""Structured logs: one JSON object per line, with the burst and run they belong to bound by whoever knows them."""

import logging
import sys
from pathlib import Path

import structlog

from bella.exceptions import StoreError


def log_nothing() -> None:
    """Drop the logs, of a command that prints what matters itself; `log_to` keeps them from then on."""
    structlog.configure(
        wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL), cache_logger_on_first_use=False
    )


def log_to(path: Path | None) -> None:
    """Send the logs to a file, or to standard error.

    Parameters
    ----------
    path : Path or None
        File to append to; its folder is made. None: standard error.

    Raises
    ------
    StoreError
        If the file cannot be written.
    """
    try:
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
        stream = sys.stderr if path is None else path.open("a", encoding="utf-8", buffering=1)
    except OSError as error:
        raise StoreError(f"{path} cannot be written ({error.strerror}): check the disk and its permissions") from error
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            structlog.processors.JSONRenderer(),
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=structlog.WriteLoggerFactory(file=stream),
        cache_logger_on_first_use=True,
    )

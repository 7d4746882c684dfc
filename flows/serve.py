"""Scheduled processing: ``python -m flows.serve`` declares the deployment and runs what is due.

It needs a Prefect server that lasts; ``PREFECT_API_URL`` says where.
"""

import sys
from datetime import UTC, datetime, timedelta
from typing import Any

from bella.catalogue import Catalogue
from bella.exceptions import BellaError
from bella.logs import log_to
from bella.settings import Settings
from flows.environment import prepare

FIRST_RUN_AFTER = timedelta(seconds=10)


def main() -> None:
    """Serve ``localise-pending/scheduled`` and, where days are asked for, ``process-recent/scheduled`` until stopped.

    Raises
    ------
    BellaError
        If the catalogue cannot be opened, or be brought to the newest revision.
    """
    settings = Settings()
    prepare(settings)
    log_to(None)
    _lay_out(settings)
    from prefect import serve  # noqa: PLC0415 - Prefect reads its settings when imported
    from prefect.schedules import Interval  # noqa: PLC0415 - the same

    from flows.pending import localise_pending  # noqa: PLC0415 - the same
    from flows.process_days import process_recent  # noqa: PLC0415 - the same

    # counted from now, so that a worker that was away does at once what it missed
    first = datetime.now(UTC) + FIRST_RUN_AFTER
    deployments: list[Any] = [  # of one kind, but Prefect's types allow for coroutines too
        localise_pending.to_deployment(
            name="scheduled",
            schedule=Interval(timedelta(seconds=settings.schedule_s), anchor_date=first),
            description="Localise the bursts whose arrival times came in since the last run.",
        )
    ]
    if settings.recent_days:
        deployments.append(
            process_recent.to_deployment(
                name="scheduled",
                schedule=Interval(timedelta(seconds=settings.recent_schedule_s), anchor_date=first),
                description="Search and localise the days whose files came in, or changed, since the last run.",
            )
        )
    # one run at a time: one that takes longer than the interval must not meet the next one
    serve(*deployments, limit=1, pause_on_shutdown=False, print_starting_message=False)


def _lay_out(settings: Settings) -> None:
    """Make schema and store before the first run, so that the API is well although nothing was localised yet."""
    settings.store_root.mkdir(parents=True, exist_ok=True)
    Catalogue.open(settings.catalogue_url, create=True).close()


if __name__ == "__main__":
    try:
        main()
    except BellaError as failure:
        sys.exit(f"flows.serve: {failure}")

"""Scheduled processing: ``python -m flows.serve [NAME ...]`` declares deployments and runs what is due.

Without names it serves all but ``ingest``, which needs a way to the archives. It needs a Prefect server that lasts;
``PREFECT_API_URL`` says where.
"""

import sys
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

from bella.catalogue import Catalogue
from bella.exceptions import BellaError, InputError
from bella.logs import log_to
from bella.pipeline.workers import prepare
from bella.settings import Settings, make_folder, read_settings

FIRST_RUN_AFTER = timedelta(seconds=10)
INGEST, SCHEDULED = "ingest", "scheduled"
MOST_RUNS = 200
"""Of one answer of Prefect's API."""


def intervals_s(settings: Settings) -> dict[str, float]:
    """Interval of every deployment, s, by the name of its flow."""
    return {
        "submissions": settings.schedule_s,
        "days": settings.days_schedule_s,
        "mock-burst": settings.mock_schedule_s,
        "housekeeping": settings.housekeeping_schedule_s,
        INGEST: settings.ingest_schedule_s,
    }


def main(names: Sequence[str] = ()) -> None:
    """Serve deployments until stopped: each is called ``NAME/scheduled`` and runs once at a time.

    Parameters
    ----------
    names : sequence of str
        Keys of :func:`intervals_s`; none for all but ``ingest``.

    Raises
    ------
    BellaError
        If a name or the address of the Prefect server is not known, or the catalogue cannot be opened or upgraded.
    """
    settings = read_settings()
    known = intervals_s(settings)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InputError(f"there is no deployment {unknown[0]!r}: choose from {', '.join(known)}")
    prepare(settings)
    from prefect import serve  # noqa: PLC0415 - Prefect reads its settings when imported
    from prefect.settings import get_current_settings  # noqa: PLC0415 - the same

    if not get_current_settings().api.url:  # the server of `bella run` schedules nothing: a worker would wait for ever
        raise InputError("PREFECT_API_URL is not set: run `prefect server start`, and set it to the address it prints")
    log_to(None)
    # schema and store are there before the first run, so that the API is well although nothing was localised yet
    make_folder(settings.store_root)
    Catalogue.open(settings.catalogue_url, create=True).close()
    from flows.tasks import answering  # noqa: PLC0415 - Prefect reads its settings when imported

    wanted = names or [name for name in known if name != INGEST]
    with answering():
        _end_dead_runs(wanted)
    serve(*_deployments(wanted, settings), pause_on_shutdown=False, print_starting_message=False)


def _deployments(names: Sequence[str], settings: Settings) -> list[Any]:
    """Deployments of Prefect; a run that is due while another of its kind is at work is cancelled, not queued."""
    from prefect.client.schemas.objects import ConcurrencyLimitConfig, ConcurrencyLimitStrategy  # noqa: PLC0415
    from prefect.schedules import Interval  # noqa: PLC0415

    from flows import bursts, days  # noqa: PLC0415

    flows = (bursts.submissions, days.recent_days, bursts.mock_burst, bursts.housekeeping, bursts.ingest)
    # counted from now, so that a worker that was away does at once what it missed
    first = datetime.now(UTC) + FIRST_RUN_AFTER
    return [
        flow.to_deployment(
            name=SCHEDULED,
            schedule=Interval(timedelta(seconds=intervals_s(settings)[flow.name]), anchor_date=first),
            description=(flow.description or "").partition("\n")[0],
            concurrency_limit=ConcurrencyLimitConfig(limit=1, collision_strategy=ConcurrencyLimitStrategy.CANCEL_NEW),
        )
        for flow in flows
        if flow.name in names
    ]


def _end_dead_runs(names: Sequence[str]) -> None:
    """Tell Prefect that runs of a worker that was killed have ended: it would keep their place for ever."""
    from prefect.client.orchestration import get_client  # noqa: PLC0415
    from prefect.client.schemas.filters import DeploymentFilter, FlowFilter, FlowRunFilter  # noqa: PLC0415
    from prefect.client.schemas.sorting import FlowRunSort  # noqa: PLC0415
    from prefect.states import Crashed  # noqa: PLC0415

    with get_client(sync_client=True) as client:
        runs = client.read_flow_runs(
            flow_filter=FlowFilter.model_validate({"name": {"any_": list(names)}}),
            flow_run_filter=FlowRunFilter.model_validate({"state": {"type": {"any_": ["RUNNING", "PENDING"]}}}),
            deployment_filter=DeploymentFilter.model_validate({"name": {"any_": [SCHEDULED]}}),
            limit=MOST_RUNS,
            sort=FlowRunSort.ID_DESC,
        )
        for run in runs:
            client.set_flow_run_state(run.id, Crashed(message="its worker was killed"))


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except BellaError as failure:
        sys.exit(f"flows.serve: {failure}")

"""Runs of two deployments that were killed, and what the worker of one of them says of them when it starts."""

import sys

from bella.pipeline.workers import prepare
from bella.settings import Settings

prepare(Settings())

from prefect.client.orchestration import get_client  # noqa: E402
from prefect.states import Running  # noqa: E402

from flows import serve  # noqa: E402
from flows.embedded import prefect_server  # noqa: E402

if __name__ == "__main__":
    with prefect_server(), get_client(sync_client=True) as client:
        runs = {}
        for deployment in serve._deployments(["submissions", "ingest"], Settings()):
            number = deployment.apply()
            runs[deployment.flow_name] = client.create_flow_run_from_deployment(number, state=Running()).id
        serve._end_dead_runs(["submissions"])
        for name, number in runs.items():
            state = client.read_flow_run(number).state
            sys.stdout.write(f"{name}: {state.type.value} {state.message}\n")

"""The real application against its own description: made-up requests, and walks from reply to reply.

Every reply must be one that the description allows: its status, its type, its schema; never an error of the server.
BELLA_API_CASES says how many requests each route gets; `make fuzz` sends 2000.
"""

import os
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
import schemathesis
from fastapi import FastAPI
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.stateful import run_state_machine_as_test
from schemathesis.specs.openapi.checks import negative_data_rejection, positive_data_acceptance

from api.app import create_app
from bella.catalogue import Catalogue
from bella.records import Origin
from tests.api.published import publish_event, publish_many, published, settings_of, synthetic_burst
from tests.api.test_description import OPERATIONS
from tests.catalogue.test_detections import DAY, received
from tests.plotting.synthetic import BURST_ID

CASES = int(os.environ.get("BELLA_API_CASES", "8"))
WITHOUT_AN_END = {"alerts_stream"}
NOT_SAID = [positive_data_acceptance]
"""That a start is before its stop, or a cursor one of ours, no schema can say."""

LENIENT = negative_data_rejection
"""A parameter that is empty, as in the query of a form, counts as left out."""

QUIET = settings(
    max_examples=CASES,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
    phases=[Phase.explicit, Phase.generate],
)


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> FastAPI:
    """Bursts with versions, spectra and a retraction, a day with detections, a submission."""
    known = settings_of(tmp_path_factory.mktemp("home"), open_submissions=True, max_submission_bytes=20_000)
    with Catalogue.open(known.catalogue_url, create=True) as catalogue:
        first, _ = publish_event(known, catalogue)
        again = catalogue.burst(first.burst_id).burst
        published(known, catalogue, burst=again, inputs_hash="b" * 64)
        publish_many(known, catalogue, 3)
        published(known, catalogue, burst=replace(synthetic_burst(burst_id="SIM-1"), origin=Origin.SIMULATED))
        catalogue.retract("T3-20120608-1929", "timed on interference")
        catalogue.record_day(DAY, [received(3), replace(received(7), tier="rejected", burst_id="")])
    return create_app(known)


@pytest.fixture(scope="module")
def schema(app: FastAPI) -> Any:
    return schemathesis.openapi.from_asgi("/api/v1/openapi.json", app)


@pytest.fixture(scope="module")
def operations(schema: Any) -> dict[str, Any]:
    """Operations of the description by name."""
    found = (one.ok() for one in schema.get_all_operations())
    return {one.definition.raw["operationId"]: one for one in found}


def known_ids(app: FastAPI) -> dict[str, list[str]]:
    catalogue = app.state.service.catalogue()
    versions = catalogue.versions(BURST_ID)
    return {
        "burst_id": [BURST_ID, "T3-20120608-1929", "SIM-1"],
        "solution_id": [one.solution_id for one in versions],
        "day": [str(DAY.day)],
        "key": ["zarr.json"],
    }


@pytest.mark.parametrize("name", sorted(OPERATIONS - WITHOUT_AN_END))
def test_every_reply_is_one_that_is_described(app: FastAPI, operations: dict[str, Any], name: str) -> None:
    ids, seen = known_ids(app), Counter[int]()
    turn = iter(range(10**9))

    @QUIET
    @given(case=operations[name].as_strategy())
    def ask(case: Any) -> None:
        number = next(turn)
        for parameter, values in ids.items():  # made-up ids lead nowhere: most requests are about something
            if parameter in case.path_parameters and number % 4:
                case.path_parameters[parameter] = values[number % len(values)]
        reply = case.call_and_validate(excluded_checks=NOT_SAID)
        seen[reply.status_code] += 1

    ask()
    assert seen.total() > 0


def test_replies_lead_from_operation_to_operation(app: FastAPI, schema: Any) -> None:
    """Walks along the links of the description, with values of earlier replies: from list to burst to track."""
    steps = Counter[tuple[str, str]]()

    class Walk(schema.exclude(operation_id=sorted(WITHOUT_AN_END)).as_state_machine()):  # type: ignore[misc]
        def validate_response(self, response: Any, case: Any, **_: Any) -> None:
            case.validate_response(response, excluded_checks=[*NOT_SAID, LENIENT])
            steps[case.operation.definition.raw["operationId"], str(response.status_code)] += 1

    run_state_machine_as_test(Walk, settings=settings(QUIET, stateful_step_count=8, max_examples=CASES))
    led = {name for name, status in steps if status == "200"} & {
        "burst",
        "track",
        "versions",
        "burst_events",
        "solution",
        "day",
    }
    assert led, "values of replies were used"


def test_links_of_replies_are_followed(app: FastAPI) -> None:
    """From the front door over every list to every reply that is linked: all of them are as described."""
    seen: set[str] = set()
    waiting = ["/api/v1"]
    with TestClient(app, raise_server_exceptions=False) as client:
        while waiting and len(seen) < 400:
            address = waiting.pop(0)
            if address in seen:
                continue
            seen.add(address)
            reply = client.get(f"{address}/zarr.json" if address.endswith(".zarr") else address)
            is_absent = re.search("no spectra are kept|is not drawn|is not known", reply.text)
            assert reply.status_code == 200 or is_absent, address
            if reply.headers["content-type"] == "application/json" and "openapi" not in reply.json():
                waiting += [one for one in addresses(reply.json()) if one not in seen]
    assert len(seen) > 50


def addresses(node: Any) -> Iterator[str]:
    """Addresses of the API in a reply: its links and the next page."""
    if isinstance(node, list):
        for one in node:
            yield from addresses(one)
    if isinstance(node, dict):
        for name, one in node.items():
            if name == "links":
                yield from (link for link in one.values() if isinstance(link, str))
            elif name == "next" and isinstance(one, str):
                yield one
            else:
                yield from addresses(one)

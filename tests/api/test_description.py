"""The description of the API: typed throughout, with stable names and examples, as JSON and as a page."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from fastapi.testclient import TestClient

from api.middleware import CONTENT_SECURITY_POLICY
from tests.plotting.synthetic import BURST_ID

OPERATIONS = {
    *("alerts", "alerts_feed", "alerts_schema", "alerts_stream", "arrivals", "burst", "bursts", "calibration"),
    *(
        "burst_events",
        "burst_figure",
        "day",
        "events",
        "day_figure",
        "days",
        "detections",
        "files",
        "health",
        "health_of_api",
    ),
    *("known_quirks", "latest_burst", "localisations", "observability", "observability_of_day", "posterior"),
    *(
        "posterior_file",
        "regions",
        "root",
        "solution",
        "solution_figure",
        "solutions",
        "status",
        "submission",
        "submit",
    ),
    *("track", "tracks", "versions", "withdraw"),
}
"""Names that clients are generated from: one that goes, or is changed, breaks them."""

NAMED = {"$ref", "anyOf", "allOf", "oneOf", "enum", "const", "type"}


@pytest.fixture
def described(client: TestClient) -> dict[str, Any]:
    found: dict[str, Any] = client.get("/api/v1/openapi.json").json()
    return found


def operations(described: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Path, method and description of every route."""
    for path, methods in described["paths"].items():
        for method, one in methods.items():
            yield path, method, one


def schemas(node: Any, where: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every schema within a description, and where it stands."""
    if isinstance(node, list):
        for number, one in enumerate(node):
            yield from schemas(one, f"{where}/{number}")
    if not isinstance(node, dict):
        return
    for name, one in node.items():
        at = f"{where}/{name}"
        above = where.rpartition("/")[2]
        if isinstance(one, dict) and (name in {"schema", "items"} or above in {"schemas", "properties", "$defs"}):
            yield at, one
        if name == "additionalProperties" and one is not False:
            yield at, one if isinstance(one, dict) else {}
        if name not in {"examples", "example", "default"}:
            yield from schemas(one, at)


def test_names_of_operations_are_those_that_clients_know(described: dict[str, Any]) -> None:
    names = [one["operationId"] for _, _, one in operations(described)]
    assert len(names) == len(set(names))
    assert set(names) >= OPERATIONS


def test_no_object_is_without_a_type(described: dict[str, Any]) -> None:
    found = dict(schemas(described))
    assert len(found) > 300
    for where, schema in found.items():
        assert NAMED & schema.keys(), f"{where} says nothing: {schema}"
        if schema.get("type") == "object":
            assert "properties" in schema or schema.get("additionalProperties"), f"{where} has no fields"
        if schema.get("type") == "array":
            assert "items" in schema or "prefixItems" in schema, f"{where} has nothing in it"


def test_every_route_has_words_examples_and_errors(described: dict[str, Any]) -> None:
    problem = described["components"]["schemas"]["Problem"]
    assert problem["required"] == ["type", "title", "status", "detail", "instance"]
    for path, method, one in operations(described):
        assert one["description"].endswith((".", "docs/calibration-found.csv.")), path
        assert {"4XX", "5XX"} <= one["responses"].keys(), path
        for status in ("4XX", "5XX"):
            content = one["responses"][status]["content"]["application/problem+json"]
            assert content["schema"] == {"$ref": "#/components/schemas/Problem"}
        if method == "get" and "posterior.zarr" not in path:
            good = one["responses"]["200"]["content"]
            untyped = [name for name, kind in good.items() if "schema" not in kind]
            assert all(name.startswith(("image/", "text/event", "application/atom")) for name in untyped), path
        for parameter in one.get("parameters", ()):
            if parameter["required"] and parameter["name"] not in {"key", "name"}:
                assert parameter["schema"].get("examples") or parameter.get("examples"), (path, parameter["name"])


def test_links_between_operations_lead_somewhere(client: TestClient, described: dict[str, Any]) -> None:
    known = {one["operationId"]: (path, method) for path, method, one in operations(described)}
    followed, some = 0, client.get("/api/v1/solutions").json()["solutions"][0]["solution_id"]
    for path, method, one in operations(described):
        reply = next(reply for status, reply in one["responses"].items() if status.startswith("2"))
        for link in reply.get("links", {}).values():
            ((parameter, expression),) = link["parameters"].items()
            target, target_method = known[link["operationId"]]
            assert f"{{{parameter}}}" in target, (path, link)
            if (method, target_method) != ("get", "get") or "days" in path or "arrivals/" in path:
                continue
            node = client.get(path.format(burst_id=BURST_ID, solution_id=some)).json()
            for step in expression.removeprefix("$response.body#/").split("/"):
                node = node[int(step) if step.isdigit() else step]
            assert (
                client.get(
                    target.format(**{parameter: node}), params={"frequency_mhz": 1} if "regions" in target else {}
                ).status_code
                == 200
            ), link
            followed += 1
    assert followed > 20


def test_the_front_door_has_counts_and_links_that_lead_somewhere(client: TestClient) -> None:
    said = client.get("/api/v1").json()
    assert said["counts"] == {
        "bursts": 8,
        "answers": 8,
        "solutions": 10,
        "detections": 0,
        "days": 0,
        "files": 2,
        "alerts": said["counts"]["alerts"],
    }
    assert said["counts"]["alerts"] >= 8
    assert said["newest_burst_utc"] == client.get("/api/v1/bursts/latest").json()["start_utc"]
    newest = client.get("/api/v1/bursts?sort=-updated&limit=1").json()["bursts"][0]
    assert said["updated_utc"] == newest["updated_utc"]
    for name, link in said["links"].items():
        assert client.get(link).status_code in {200, 503 if name == "health" else 200}, link


@pytest.mark.parametrize("path", ["/api/v1", "/api/v1/docs"])
def test_a_browser_is_shown_every_route_and_nothing_from_elsewhere(client: TestClient, path: str) -> None:
    reply = client.get(path, headers={"Accept": "text/html,application/xhtml+xml,*/*;q=0.8"})
    assert reply.headers["content-type"].startswith("text/html")
    assert "Accept" in reply.headers["vary"].split(", ")
    assert reply.headers["content-security-policy"] == CONTENT_SECURITY_POLICY
    for name in OPERATIONS:
        assert f'id="{name}"' in reply.text, name
    brief = re.search(r'GET /api/v1/bursts</code> <span class="brief">([^<]+)</span>', reply.text)
    assert brief
    assert brief[1].startswith("Bursts")
    loaded = re.findall(r"<(?:script|link|img|iframe)[^>]*(?:src|href)=\"([^\"]+)", reply.text)
    assert loaded
    assert all(one.startswith("/") for one in loaded), loaded
    assert "<script" not in reply.text


def test_examples_on_the_page_can_be_tried(client: TestClient) -> None:
    page = client.get("/api/v1/docs").text
    tried = re.findall(r'Try it: <a href="([^"]+)"', page)
    assert len(tried) >= 30
    for address in tried:
        if not address.endswith("/stream"):
            reply = client.get(address.replace("&amp;", "&"))
            # not all is in the catalogue of this test, but every address is one of the service and asks rightly
            assert reply.status_code in {200, 404, 503}, (address, reply.text)
            assert "there is nothing at this address" not in reply.text, address
            if BURST_ID in address and "default.2d" not in address:
                assert reply.status_code == 200, address

"""Headers that caches, browsers and scripts of other sites act on, on every kind of reply."""

from collections.abc import Iterator

import pytest
from fastapi.testclient import TestClient

from api import serve
from api.app import create_app
from api.middleware import CONTENT_SECURITY_POLICY
from api.routers.figures import FILE_POLICY
from bella.settings import Settings
from tests.plotting.synthetic import BURST_ID

NO_STORE, NO_CACHE, FOREVER = "no-store", "no-cache", "public, max-age=31536000, immutable"
BURST, SOLUTION = f"/api/v1/bursts/{BURST_ID}", "/api/v1/solutions/{solution}"
EXPECTED = {
    "/": (200, NO_CACHE, CONTENT_SECURITY_POLICY),
    "/guide": (200, NO_CACHE, CONTENT_SECURITY_POLICY),
    "/nowhere": (404, NO_CACHE, CONTENT_SECURITY_POLICY),
    BURST: (200, NO_CACHE, CONTENT_SECURITY_POLICY),
    "/api/v1/bursts?limit=all&format=csv": (200, NO_CACHE, CONTENT_SECURITY_POLICY),
    f"{BURST}x": (404, NO_CACHE, CONTENT_SECURITY_POLICY),
    "/unforeseen": (500, NO_CACHE, CONTENT_SECURITY_POLICY),
    f"{BURST}/figures/evolution.svg": (200, NO_CACHE, FILE_POLICY),
    "/api/v1/figures/longitude.svg": (200, NO_CACHE, FILE_POLICY),
    f"{SOLUTION}/posterior.zarr/zarr.json": (200, FOREVER, CONTENT_SECURITY_POLICY),
    "/feed.atom": (200, NO_CACHE, CONTENT_SECURITY_POLICY),
    "/hapi/catalog": (200, NO_CACHE, CONTENT_SECURITY_POLICY),
    "/static/bella.css": (200, NO_CACHE, CONTENT_SECURITY_POLICY),
    "/static/bella.css?v=1": (200, FOREVER, CONTENT_SECURITY_POLICY),
    "/status": (200, NO_CACHE, CONTENT_SECURITY_POLICY),
    "/api/v1/status": (200, NO_STORE, CONTENT_SECURITY_POLICY),
    "/metrics": (200, NO_STORE, CONTENT_SECURITY_POLICY),
    "/health": (200, NO_STORE, CONTENT_SECURITY_POLICY),
    "/health/api": (200, NO_STORE, CONTENT_SECURITY_POLICY),
}
"""Status, Cache-Control and Content-Security-Policy."""


def fail() -> None:
    raise RuntimeError


@pytest.fixture
def reader(filled: Settings) -> Iterator[TestClient]:
    app = create_app(filled)
    app.router.add_api_route("/unforeseen", fail)
    with TestClient(app, raise_server_exceptions=False) as made:
        yield made


@pytest.mark.parametrize("accept", ["*/*", "text/html,*/*"])
def test_what_a_cache_and_a_browser_may_do_with_a_reply(reader: TestClient, accept: str) -> None:
    solution = reader.get(BURST).json()["preferred_solution"]
    for address, (status, cached, policy) in EXPECTED.items():
        reply = reader.get(address.format(solution=solution), headers={"Accept": accept})
        headers = reply.headers
        found = (reply.status_code, headers["cache-control"], headers["content-security-policy"])
        assert found == (status, cached, policy), address
        assert headers["x-content-type-options"] == "nosniff", address
        assert headers["referrer-policy"] == "no-referrer", address
        is_steady = cached != NO_STORE and not address.startswith(("/status", SOLUTION))
        if (tag := headers.get("etag")) and is_steady:
            known = reader.get(reply.request.url, headers={"Accept": accept, "If-None-Match": tag})
            assert (known.status_code, known.headers["cache-control"]) == (304, cached), address


def test_policies_allow_no_scripts_but_our_own() -> None:
    policy = dict(one.strip().split(" ", 1) for one in CONTENT_SECURITY_POLICY.split(";"))
    assert policy["script-src"] == policy["style-src"] == policy["frame-ancestors"] == "'self'"
    assert policy["default-src"] == policy["base-uri"] == "'none'"
    assert "script-src" not in FILE_POLICY


def test_a_connection_ends_with_an_error_that_nobody_foresaw(reader: TestClient) -> None:
    assert reader.get("/unforeseen").headers["connection"] == "close"


def test_scripts_of_other_sites_may_read_and_ask_for_parts_but_change_nothing(client: TestClient) -> None:
    reply = client.get("/api/v1/bursts", headers={"Origin": "https://example.org"})
    assert reply.headers["access-control-allow-origin"] == "*"
    exposed = {name.strip() for name in reply.headers["access-control-expose-headers"].split(",")}
    assert {"ETag", "Retry-After", "Content-Range", "Accept-Ranges", "Content-Length"} <= exposed
    asked = {"Origin": "https://example.org", "Access-Control-Request-Method": "GET"}
    for name in ("Range", "If-None-Match", "If-Modified-Since", "Last-Event-ID"):
        allowed = client.options("/api/v1/bursts", headers=asked | {"Access-Control-Request-Headers": name})
        assert allowed.status_code == 200, name
    for method in ("POST", "DELETE", "PUT"):
        refused = client.options("/api/v1/arrivals", headers=asked | {"Access-Control-Request-Method": method})
        assert refused.status_code == 400, method


def test_a_client_has_a_minute_at_most(empty: Settings) -> None:
    assert 1 <= serve.HEAD_S <= serve.BODY_S <= 60
    options = serve.options()
    assert 1 <= options["timeout_graceful_shutdown"] <= options["timeout_keep_alive"] <= 60

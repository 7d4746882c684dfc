"""Behind a proxy with a prefix: every link leads below it, whether or not the proxy takes it off."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from api.pages.submit import EXAMPLE
from bella.exceptions import InputError
from bella.settings import Settings, read_settings
from tests.plotting.synthetic import BURST_ID

PREFIX = "/tools/bella"
HERE = ("127.0.0.1", 50000)


@pytest.fixture
def behind(filled: Settings) -> Iterator[TestClient]:
    """Reader of a service that knows its prefix."""
    with TestClient(create_app(filled.model_copy(update={"root_path": f"{PREFIX}/"}))) as reader:
        yield reader


def links(node: Any) -> Iterator[str]:
    """Addresses in a reply."""
    if isinstance(node, list):
        for one in node:
            yield from links(one)
    elif isinstance(node, dict):
        for name, one in node.items():
            if name == "links":
                yield from one.values()
            elif name in {"next", "zarr_url", "data_archive_page", "track", "$schema"} and isinstance(one, str):
                yield one
            else:
                yield from links(one)


ADDRESSES = [
    "/api/v1",
    "/api/v1/bursts?limit=2",
    "/api/v1/bursts/latest",
    f"/api/v1/bursts/{BURST_ID}",
    f"/api/v1/bursts/{BURST_ID}/track",
    f"/api/v1/bursts/{BURST_ID}/posterior",
    "/api/v1/solutions?limit=2",
    "/api/v1/files?limit=1",
    "/api/v1/alerts?limit=2",
]


@pytest.mark.parametrize("address", ADDRESSES)
def test_links_of_json_lead_below_the_prefix(behind: TestClient, address: str) -> None:
    found = [*links(behind.get(PREFIX + address).json())]
    assert found
    for link in found:
        path = link.removeprefix("http://testserver")
        assert path.startswith(f"{PREFIX}/"), link
        assert path.count(PREFIX) == 1, link
        reply = behind.get(f"{path}/zarr.json" if path.endswith(".zarr") else path)
        assert reply.status_code in {200, 503} or "no spectra are kept" in reply.text, link


def test_what_the_proxy_has_taken_off_is_the_same(behind: TestClient, filled: Settings) -> None:
    for address in ADDRESSES:
        assert behind.get(address).content == behind.get(PREFIX + address).content
    with TestClient(create_app(filled), client=HERE) as reader:
        said = {"X-Forwarded-Prefix": PREFIX}
        for address in ADDRESSES[1:]:
            assert reader.get(address, headers=said).content == behind.get(address).content
            assert PREFIX not in reader.get(address).text


@pytest.mark.parametrize("prefix", ["//elsewhere.org", '/a"b', "/<b>", "no-slash", "/", "/a b", "/%2e"])
def test_a_prefix_that_is_none_is_not_taken(filled: Settings, prefix: str) -> None:
    with TestClient(create_app(filled), client=HERE) as reader:
        plain = reader.get("/api/v1/bursts?limit=1").text
        assert reader.get("/api/v1/bursts?limit=1", headers={"X-Forwarded-Prefix": prefix}).text == plain


def test_nobody_but_a_proxy_of_this_machine_names_a_prefix(filled: Settings) -> None:
    with TestClient(create_app(filled), client=("192.0.2.1", 50000)) as reader:
        assert PREFIX not in reader.get("/api/v1", headers={"X-Forwarded-Prefix": PREFIX}).text


@pytest.mark.parametrize("address", ["/", "/days", f"/bursts/{BURST_ID}", "/api/v1/docs", "/status", "/nowhere"])
def test_pages_lead_below_the_prefix(behind: TestClient, address: str) -> None:
    page = behind.get(PREFIX + address, headers={"Accept": "text/html"}).text
    led = re.findall(r'(?:href|src|action|data-[a-z]+)="(/[^"]*)"', page)
    assert led
    for link in led:
        assert link.startswith((f"{PREFIX}/", "//")), link
        assert link.count(PREFIX) == 1, link


def test_files_feeds_and_hapi_lead_below_the_prefix(behind: TestClient) -> None:
    assert behind.get(f"{PREFIX}/static/bella.css").status_code == 200
    table = behind.get(f"{PREFIX}/api/v1/bursts?format=csv&limit=2")
    assert PREFIX in table.links["next"]["url"]
    assert behind.get(table.links["next"]["url"]).status_code == 200
    feed = behind.get(f"{PREFIX}/feed.atom").text
    addresses = re.findall(r'href="http://testserver(/[^"]*)"', feed)
    assert len(addresses) > 5
    assert all(one.startswith(f"{PREFIX}/") for one in addresses)
    assert f'href="{PREFIX}/hapi/about"' in behind.get(f"{PREFIX}/hapi").text
    assert behind.get(f"{PREFIX}/api/v1/openapi.json").json()["servers"] == [{"url": PREFIX}]
    problem = behind.get(f"{PREFIX}/api/v1/bursts/none").json()
    assert problem["instance"] == f"{PREFIX}/api/v1/bursts/none"


@pytest.mark.parametrize("prefix", ["bella", "/be lla", "https://example.org/bella"])
def test_a_setting_that_is_no_prefix_is_refused(monkeypatch: pytest.MonkeyPatch, prefix: str) -> None:
    monkeypatch.setenv("BELLA_ROOT_PATH", prefix)
    with pytest.raises(InputError, match="BELLA_ROOT_PATH"):
        read_settings()


def test_addresses_to_copy_are_whole_and_have_the_prefix_once(behind: TestClient) -> None:
    text = behind.get(f"{PREFIX}/bursts/{BURST_ID}", headers={"Accept": "text/html"}).text
    whole = re.findall(r"http://testserver(/[^\"<\s}]*)", text)
    assert len(whole) >= 3
    assert all(path.startswith(f"{PREFIX}/") and path.count(PREFIX) == 1 for path in whole), whole
    kept = behind.get(f"{PREFIX}/api/v1/bursts/{BURST_ID}/figures/constellation.svg").text
    cited = re.findall(r"http://testserver(/[^;\s<]*)", kept)
    assert cited
    assert all(path.startswith(f"{PREFIX}/api/v1/solutions/") for path in cited)
    form = behind.post(f"{PREFIX}/submit", data={"table": EXAMPLE}).text
    assert f'data-to="{PREFIX}/api/v1/arrivals" data-then="{PREFIX}/submissions/"' in form

"""Every list: HEAD says what GET sends, and who has it already gets 304 until it changes."""

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from bella.catalogue import Catalogue
from bella.settings import Settings
from tests.api.published import publish_event
from tests.plotting.synthetic import BURST_ID

DETECTIONS = "detections?start=2012-06-07&stop=2012-06-08"
ADDRESSES = [
    "/",
    f"/bursts/{BURST_ID}",
    "/api/v1/bursts",
    "/api/v1/bursts?format=csv",
    "/api/v1/tracks",
    "/api/v1/tracks?format=votable",
    "/api/v1/localisations",
    "/api/v1/localisations?format=parquet",
    f"/api/v1/{DETECTIONS}",
    f"/api/v1/bursts/{BURST_ID}/arrivals",
    "/api/v1/days",
    "/hapi/catalog",
    "/hapi/data?dataset=bursts&start=2012-06-01Z&stop=2012-07-01Z",
]


@pytest.mark.parametrize("address", ADDRESSES)
def test_head_says_what_get_sends(client: TestClient, address: str) -> None:
    plain = {"Accept-Encoding": "identity"}
    sent, head = client.get(address, headers=plain), client.head(address, headers=plain)
    assert (head.status_code, head.content) == (200, b"")
    assert int(head.headers["content-length"]) == len(sent.content)
    assert head.headers["etag"] == sent.headers["etag"]
    assert head.headers["content-type"] == sent.headers["content-type"]


@pytest.mark.parametrize("address", ADDRESSES)
@pytest.mark.parametrize("method", ["GET", "HEAD"])
def test_who_has_it_already_is_told_so(client: TestClient, address: str, method: str) -> None:
    tag = client.get(address).headers["etag"]
    again = client.request(method, address, headers={"If-None-Match": f'"other", {tag}'})
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["etag"] == tag
    assert client.request(method, address, headers={"If-None-Match": '"other"'}).status_code == 200


def test_formats_have_tags_of_their_own(client: TestClient) -> None:
    tags = {client.get("/api/v1/tracks", params={"format": name}).headers["etag"] for name in ("json", "csv", "ecsv")}
    assert len(tags) == 3


@pytest.mark.parametrize("path", ["bursts", "tracks", f"bursts/{BURST_ID}/track", DETECTIONS])
def test_a_cache_is_told_that_the_format_depends_on_what_is_accepted(client: TestClient, path: str) -> None:
    assert "Accept" in client.get(f"/api/v1/{path}").headers["vary"].split(", ")


def test_a_list_that_has_changed_is_sent_again(empty: Settings) -> None:
    with TestClient(create_app(empty)) as reader:
        tag = reader.get("/api/v1/bursts").headers["etag"]
        with Catalogue.open(empty.catalogue_url) as catalogue:
            publish_event(empty, catalogue)
        assert reader.get("/api/v1/bursts", headers={"If-None-Match": tag}).status_code == 200


def test_errors_and_what_is_written_have_no_tag(client: TestClient) -> None:
    missing = client.head("/api/v1/bursts/T3-20000101-0000")
    assert (missing.status_code, missing.content) == (404, b"")
    assert "etag" not in missing.headers
    assert client.get("/api/v1/bursts/T3-20000101-0000", headers={"If-None-Match": "*"}).status_code == 404
    assert client.head("/api/v1/alerts/stream").status_code == 405

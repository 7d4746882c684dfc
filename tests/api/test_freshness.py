"""Every list: HEAD says what GET sends, and who has it already gets 304 until it changes."""

from datetime import UTC, date, datetime, timedelta
from email.utils import format_datetime, parsedate_to_datetime

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from api.freshness import tag_of
from bella.catalogue import Catalogue, ListRead, SearchedDay
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
    assert client.request(method, address, headers={"If-None-Match": "*"}).status_code == 304
    assert client.request(method, address, headers={"If-None-Match": '"other"'}).status_code == 200


def test_formats_have_tags_of_their_own(client: TestClient) -> None:
    tags = {client.get("/api/v1/tracks", params={"format": name}).headers["etag"] for name in ("json", "csv", "ecsv")}
    assert len(tags) == 3


@pytest.mark.parametrize(
    "path", ["", "/bursts", "/bursts?limit=all&format=csv", "/tracks", f"/bursts/{BURST_ID}/track", f"/{DETECTIONS}"]
)
def test_a_cache_is_told_that_the_format_depends_on_what_is_accepted(client: TestClient, path: str) -> None:
    whole = client.get(f"/api/v1{path}")
    known = client.get(f"/api/v1{path}", headers={"If-None-Match": whole.headers["etag"]})
    for reply, status in ((whole, 200), (known, 304)):
        assert reply.status_code == status
        assert "Accept" in reply.headers["vary"].split(", ")


def test_a_list_that_has_changed_is_sent_again(empty: Settings) -> None:
    with TestClient(create_app(empty)) as reader:
        tag = reader.get("/api/v1/bursts").headers["etag"]
        with Catalogue.open(empty.catalogue_url) as catalogue:
            publish_event(empty, catalogue)
        assert reader.get("/api/v1/bursts", headers={"If-None-Match": tag}).status_code == 200


CHANGING = [
    "bursts",
    "bursts?format=csv",
    "bursts?format=csv&limit=all",
    f"bursts/{BURST_ID}",
    f"bursts/{BURST_ID}/track",
    f"bursts/{BURST_ID}/track?format=csv",
    f"bursts/{BURST_ID}/track?format=votable",
    f"bursts/{BURST_ID}/posterior",
    "tracks",
    "localisations?format=csv",
    "files",
]


@pytest.fixture
def settled(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if everything had been published long ago by a service that runs for longer."""
    monkeypatch.setattr("api.freshness.SETTLED", timedelta(days=-1))
    monkeypatch.setattr("api.freshness.STARTED_UTC", datetime(2020, 1, 1, tzinfo=UTC))


@pytest.mark.usefixtures("settled")
@pytest.mark.parametrize("address", CHANGING)
def test_who_has_it_since_its_last_change_is_told_so(client: TestClient, address: str) -> None:
    address = f"/api/v1/{address}"
    reply = client.get(address)
    modified = reply.headers["last-modified"]
    moment = parsedate_to_datetime(modified)
    assert datetime.now(UTC) - timedelta(hours=2) < moment < datetime.now(UTC)
    earlier, later = (format_datetime(moment + timedelta(seconds=one), usegmt=True) for one in (-1, 1))

    def status(**headers: str) -> int:
        return client.get(
            address, headers={name.replace("_", "-"): value for name, value in headers.items()}
        ).status_code

    assert [status(if_modified_since=one) for one in (earlier, modified, later)] == [200, 304, 304]
    assert [status(if_modified_since=one) for one in ("yesterday", "", "Thu, 99 Jan 2099 00:00:00 GMT")] == [200] * 3
    assert status(if_none_match='"other"', if_modified_since=later) == 200, "the tag decides where one is given"
    assert status(if_none_match=reply.headers["etag"], if_modified_since=earlier) == 304
    again = client.head(address, headers={"If-Modified-Since": modified})
    assert (again.status_code, again.headers["etag"]) == (304, reply.headers["etag"])


@pytest.mark.usefixtures("settled")
def test_nothing_is_older_than_the_software_that_writes_it(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    started = datetime.now(UTC).replace(microsecond=0)
    monkeypatch.setattr("api.freshness.STARTED_UTC", started)
    assert parsedate_to_datetime(client.get("/api/v1/bursts").headers["last-modified"]) == started


@pytest.mark.usefixtures("settled")
@pytest.mark.parametrize("query", ["", "&format=csv"])
def test_detections_are_as_old_as_the_last_search(empty: Settings, query: str) -> None:
    with Catalogue.open(empty.catalogue_url) as catalogue, TestClient(create_app(empty)) as reader:
        before = datetime.now(UTC).replace(microsecond=0)
        catalogue.record_day(SearchedDay(date(2012, 6, 7), "a" * 64, "0", ("WIND",)), [])
        modified = reader.get(f"/api/v1/{DETECTIONS}{query}").headers["last-modified"]
        assert before <= parsedate_to_datetime(modified) <= datetime.now(UTC)


@pytest.mark.usefixtures("settled")
def test_a_linked_event_changes_its_burst(empty: Settings) -> None:
    with Catalogue.open(empty.catalogue_url) as catalogue, TestClient(create_app(empty)) as reader:
        publish_event(empty, catalogue)
        read_utc = datetime.now(UTC).replace(microsecond=0) + timedelta(seconds=5)
        catalogue.events.replace(ListRead("goes.json", "read", "", 0, 0, "", None, None, read_utc, read_utc), [])
        reply = reader.get(f"/api/v1/bursts/{BURST_ID}")
        assert parsedate_to_datetime(reply.headers["last-modified"]) == read_utc


def test_what_may_change_again_in_the_same_minute_has_no_date(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("api.freshness.SETTLED", timedelta(days=1))  # however long ago the tests began
    assert "last-modified" not in client.get("/api/v1/bursts").headers


def test_an_empty_catalogue_has_no_date(empty: Settings, settled: None) -> None:
    with TestClient(create_app(empty)) as reader:
        for path in ("bursts", "detections", "files"):
            assert "last-modified" not in reader.get(f"/api/v1/{path}").headers


def test_other_software_has_other_tags(monkeypatch: pytest.MonkeyPatch) -> None:
    before = tag_of((), "figure")
    monkeypatch.setattr("api.freshness.__version__", "another")
    assert tag_of((), "figure") != before


def test_errors_and_what_is_written_have_no_tag(client: TestClient) -> None:
    missing = client.head("/api/v1/bursts/T3-20000101-0000")
    assert (missing.status_code, missing.content) == (404, b"")
    assert "etag" not in missing.headers
    assert client.get("/api/v1/bursts/T3-20000101-0000", headers={"If-None-Match": "*"}).status_code == 404
    assert client.head("/api/v1/alerts/stream").status_code == 405

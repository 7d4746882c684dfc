"""Lists of solutions and of the files that they were made from."""

from typing import Any

import pytest
from fastapi.testclient import TestClient

from tests.plotting.synthetic import BURST_ID


def pages(client: TestClient, address: str, name: str) -> list[dict[str, Any]]:
    """All rows of a list, page by page."""
    rows: list[dict[str, Any]] = []
    following: str | None = address
    while following:
        reply = client.get(following).json()
        rows += reply[name]
        assert (reply["returned"], reply["truncated"]) == (len(reply[name]), reply["next"] is not None)
        following = reply["next"]
        assert following or reply["total"] == len(rows)
    return rows


def test_solutions_come_page_by_page_the_newest_first(client: TestClient) -> None:
    found = pages(client, "/api/v1/solutions?limit=3", "solutions")
    created = [one["created_utc"] for one in found]
    assert created == sorted(created, reverse=True)
    assert len({one["solution_id"] for one in found}) == len(found) == 10
    assert pages(client, "/api/v1/solutions?limit=4&sort=created", "solutions") == found[::-1]


@pytest.mark.parametrize(
    ("query", "total"),
    [
        (f"burst={BURST_ID}", 3),
        (f"burst={BURST_ID}&newest=true", 2),
        (f"burst={BURST_ID}&edge=gauss_hermite", 1),
        ("edge=gauss_hermite&edge=half_maximum", 10),
        ("method=nuts", 0),
        ("preset=bella-2024&method=posterior", 10),
        ("created_since=2999-01-01", 0),
        ("created_since=2012-01-01", 10),
        ("origin=simulated", 0),
    ],
)
def test_solutions_are_filtered(client: TestClient, query: str, total: int) -> None:
    assert len(pages(client, f"/api/v1/solutions?limit=2&{query}", "solutions")) == total


def test_files_come_page_by_page(client: TestClient) -> None:
    found = pages(client, "/api/v1/files?limit=1", "files")
    assert [one["sha256"][0] for one in found] == ["b", "a"]
    assert pages(client, "/api/v1/files?limit=1&sort=updated", "files") == found[::-1]
    assert {one["dataset"] for one in found} == {"synthetic"}
    for query, total in (("dataset=other", 0), ("from=2012-06-07&to=2012-06-07", 2), ("from=2012-06-08", 0)):
        assert client.get(f"/api/v1/files?{query}").json()["total"] == total
    assert client.get("/api/v1/files?updated_since=2999-01-01").json()["total"] == 0


@pytest.mark.parametrize("path", ["solutions", "files", "detections", "days", "bursts", "tracks"])
@pytest.mark.parametrize("cursor", ["x", "%00", "W10", "é", "WyJhIl0"])
def test_a_cursor_that_is_none_of_ours_is_refused(client: TestClient, path: str, cursor: str) -> None:
    reply = client.get(f"/api/v1/{path}", params={"cursor": cursor})
    assert (reply.status_code, reply.json()["detail"].partition(":")[0]) == (422, "cursor")

"""The posterior is opened by plain xarray over HTTP."""

from collections.abc import Iterator

import httpx
import numpy as np
import pytest
import xarray as xr
from fastapi.testclient import TestClient

from bella.settings import Settings
from tests.api.published import CHANNELS, served
from tests.plotting.synthetic import BURST_ID, synthetic_posterior


@pytest.fixture(scope="module")
def address(filled: Settings) -> Iterator[str]:
    with served(filled) as base:
        yield base


def zarr_url(address: str) -> str:
    reply = httpx.get(f"{address}/api/v1/bursts/{BURST_ID}/posterior", params={"edge": "gauss_hermite"})
    url: str = reply.json()["zarr_url"]
    return url


def test_xarray_opens_the_address_and_reads_every_number(address: str) -> None:
    with xr.open_zarr(zarr_url(address), chunks=None) as group:
        read = group.load()
    expected = synthetic_posterior("gauss_hermite", frequencies=CHANNELS)
    xr.testing.assert_identical(read, expected)


def test_a_byte_range_is_a_part_of_the_file(address: str) -> None:
    url = f"{zarr_url(address)}/zarr.json"
    whole = httpx.get(url)
    middle = httpx.get(url, headers={"Range": "bytes=10-19"})
    assert (middle.status_code, middle.content) == (206, whole.content[10:20])
    assert middle.headers["content-range"] == f"bytes 10-19/{len(whole.content)}"
    tail = httpx.get(url, headers={"Range": "bytes=-7"})
    assert (tail.status_code, tail.content) == (206, whole.content[-7:])
    rest = httpx.get(url, headers={"Range": f"bytes=10-{10**9}"})
    assert (rest.status_code, rest.content) == (206, whole.content[10:])
    assert rest.headers["content-range"] == f"bytes 10-{len(whole.content) - 1}/{len(whole.content)}"
    same = httpx.get(url, headers={"Range": "bytes=0-0", "If-Range": whole.headers["etag"]})
    assert (same.status_code, same.content) == (206, whole.content[:1])
    for beyond in (f"bytes={len(whole.content)}-", "bytes=-0"):
        refused = httpx.get(url, headers={"Range": beyond})
        assert refused.status_code == 416
        assert refused.headers["content-range"] == f"bytes */{len(whole.content)}"
    all_of_it = ({"Range": "bytes=5-2"}, {"Range": "bytes=-"}, {"Range": "bytes=0-1,4-5"}, {"Range": "lines=1-2"})
    for asked in (*all_of_it, {"Range": "bytes=0-1", "If-Range": '"another"'}):
        reply = httpx.get(url, headers=asked)
        assert (reply.status_code, reply.content) == (200, whole.content)
    assert whole.headers["accept-ranges"] == "bytes"


def test_head_is_get_without_the_body(address: str) -> None:
    url = f"{zarr_url(address)}/zarr.json"
    head, whole = httpx.head(url), httpx.get(url)
    assert head.status_code == 200
    assert head.content == b""
    assert int(head.headers["content-length"]) == len(whole.content)
    assert head.headers["etag"] == whole.headers["etag"]


def test_files_never_change_and_are_not_compressed_again(address: str) -> None:
    reply = httpx.get(f"{zarr_url(address)}/zarr.json", headers={"Accept-Encoding": "gzip"})
    assert "immutable" in reply.headers["cache-control"]
    assert "content-encoding" not in reply.headers


def test_it_is_read_only(address: str) -> None:
    url = f"{zarr_url(address)}/zarr.json"
    before = httpx.get(url).content
    assert {httpx.request(method, url).status_code for method in ("PUT", "POST", "DELETE", "PATCH")} == {405}
    assert httpx.get(url).content == before


@pytest.mark.parametrize(
    "key",
    [
        "nothing",
        "",
        "draws",
        "../../../catalogue.sqlite",
        "%2e%2e/%2e%2e/%2e%2e/catalogue.sqlite",
        "..%2f..%2f..%2fcatalogue.sqlite",
        "/etc/passwd",
        "%00",
        "x" * 5000,
    ],
)
def test_nothing_outside_the_group_is_served(client: TestClient, key: str) -> None:
    burst = client.get(f"/api/v1/bursts/{BURST_ID}").json()
    link = burst["solutions"][0]["links"]["zarr"]
    reply = client.get(f"{link}/{key}")
    assert reply.status_code == 404
    assert reply.headers["content-type"] == "application/problem+json"


def test_an_unknown_solution_has_no_files(client: TestClient) -> None:
    assert client.get("/api/v1/solutions/nothing/posterior.zarr/zarr.json").status_code == 404
    assert client.get("/api/v1/solutions/nothing").status_code == 404


def test_draws_are_those_that_were_published(address: str) -> None:
    with xr.open_zarr(zarr_url(address), chunks=None) as group:
        one = group["draws"].sel(frequency=0.3, method="nearest").to_numpy()
    expected = synthetic_posterior("gauss_hermite", frequencies=CHANNELS)["draws"].sel(frequency=0.3, method="nearest")
    np.testing.assert_array_equal(one, expected)
